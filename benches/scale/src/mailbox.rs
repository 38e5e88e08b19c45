//! Time until all gateways are ready, by the number of gateways: their startup SDOs go through the mailbox.

use std::time::Duration;

use ecan_host::{AdapterConfig, Plan};
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig};
use ecan_sim::{ClockKind, MasterBehaviour, Scenario, SimOptions};

use crate::Fallible;
use crate::page::{Section, compared};

const GATEWAYS: [u16; 5] = [1, 2, 4, 8, 16];
const CYCLE: Duration = Duration::from_millis(2);

pub fn section() -> Fallible<Section> {
    let mut rows = Vec::new();
    let (mut ideal, mut like_igh) = (Vec::new(), Vec::new());
    for gateways in GATEWAYS {
        let adapter = AdapterConfig::new(gateways).with_cycle(CYCLE);
        let plan = Plan::of(&adapter);
        let echo = || ecan_sim::echo(gateways.into());
        let ideal_s = ready_s(echo(), &adapter)?;
        let igh_s = ready_s(Scenario { master: MasterBehaviour::IGH, ..echo() }, &adapter)?;
        ideal.push((gateways.into(), ideal_s));
        like_igh.push((gateways.into(), igh_s));
        rows.push(vec![
            gateways.to_string(),
            plan.mailbox.headroom_bytes().to_string(),
            plan.mailbox.transfers().to_string(),
            format!("{ideal_s:.2}"),
            format!("{igh_s:.2}"),
        ]);
    }
    let mut panel = compared("", "time until ready [s]", ideal, ("master like IgH", like_igh));
    panel.series[0].name = "ideal master".to_owned();
    let header = [
        "gateways",
        "bytes for mailboxes in a cycle of 2 ms",
        "transfers in a cycle",
        "until ready, ideal master, s",
        "until ready, master like IgH, s",
    ];
    Ok(Section {
        name: "mailbox",
        title: "Mailbox: from the start of the program to all gateways ready",
        x_label: "gateways",
        panels: vec![panel],
        is_simulated: true,
        header: header.map(str::to_owned).into(),
        rows,
    })
}

fn ready_s(scenario: Scenario, adapter: &AdapterConfig) -> Fallible<f64> {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(scenario, &options)?;
    let gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000));
    let config = PortConfig::uniform(adapter.slaves.len(), gateway);
    let clock = backend.ecrt.clock().clone();
    let begin = clock.now_ns();
    let mut port = Port::open(&backend.ecrt, (*adapter, config))?;
    port.wait_ready()?;
    Ok((clock.now_ns() - begin) as f64 / 1e9)
}
