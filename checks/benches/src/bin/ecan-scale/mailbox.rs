//! Time until all gateways are ready, by the number of gateways: their startup SDOs go through the mailbox. In
//! real time, in which the gateways are read in parallel as with a real master.

use std::time::Duration;

use ecan_host::{AdapterConfig, Plan};
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig, PortError};
use ecan_sim::{ClockKind, MasterBehaviour, Scenario, SimOptions};

use crate::Fallible;
use crate::page::{Section, compared};

const GATEWAYS: [u16; 5] = [1, 2, 4, 8, 16];
const CYCLE: Duration = Duration::from_millis(2);

/// Parts of a startup, in seconds.
struct Startup {
    /// The gateways are read before the master is activated.
    reading_s: f64,
    /// The master configures the slaves and brings them to OP.
    master_s: f64,
    /// The configuration is verified.
    verification_s: f64,
}

impl Startup {
    fn total_s(&self) -> f64 {
        self.reading_s + self.master_s + self.verification_s
    }
}

pub fn section() -> Fallible<Section> {
    let mut rows = Vec::new();
    let (mut ideal, mut like_igh) = (Vec::new(), Vec::new());
    for gateways in GATEWAYS {
        let adapter = AdapterConfig::new(gateways).with_cycle(CYCLE);
        let plan = Plan::of(&adapter);
        let echo = || ecan_sim::echo(gateways.into());
        let quick = start(echo(), &adapter)?;
        let igh = start(Scenario { master: MasterBehaviour::IGH, ..echo() }, &adapter)?;
        ideal.push((gateways.into(), quick.total_s()));
        like_igh.push((gateways.into(), igh.total_s()));
        rows.push(vec![
            gateways.to_string(),
            plan.mailbox.headroom_bytes().to_string(),
            plan.mailbox.transfers().to_string(),
            format!("{:.1}", quick.total_s()),
            format!("{:.1}", igh.reading_s),
            format!("{:.1}", igh.master_s),
            format!("{:.1}", igh.verification_s),
            format!("{:.1}", igh.total_s()),
        ]);
    }
    let mut panel = compared("", "time until ready [s]", ideal, ("master like IgH", like_igh));
    panel.series[0].name = "ideal master".to_owned();
    let header = [
        "gateways",
        "bytes for mailboxes in a cycle of 2 ms",
        "transfers in a cycle",
        "until ready, ideal master, s",
        "master like IgH: reading, s",
        "startup by the master, s",
        "verification, s",
        "until ready, s",
    ];
    Ok(Section {
        name: "mailbox",
        title: "Mailbox: from the start of the program to all gateways ready, four channels each",
        x_label: "gateways",
        panels: vec![panel],
        is_simulated: true,
        header: header.map(str::to_owned).into(),
        rows,
    })
}

fn start(scenario: Scenario, adapter: &AdapterConfig) -> Fallible<Startup> {
    let options = SimOptions { clock: Some(ClockKind::Real), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(scenario, &options)?;
    let gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000));
    let config = PortConfig::uniform(adapter.slaves.len(), gateway);
    let clock = backend.ecrt.clock().clone();
    let begin_ns = clock.now_ns();
    let mut port = Port::open(&backend.ecrt, (*adapter, config))?;
    let read_ns = clock.now_ns();
    let mut op_ns = None;
    let timeout = port.startup_timeout();
    port.wait_ready_with(timeout, |port| {
        port.begin_cycle().finish();
        if op_ns.is_none() && port.adapter().all_operational()? {
            op_ns = Some(clock.now_ns());
        }
        Ok::<_, PortError>(())
    })?;
    let ready_ns = clock.now_ns();
    let op_ns = op_ns.ok_or("ready, but never in OP")?;
    let s = |from: u64, to: u64| (to - from) as f64 / 1e9;
    Ok(Startup {
        reading_s: s(begin_ns, read_ns),
        master_s: s(read_ns, op_ns),
        verification_s: s(op_ns, ready_ns),
    })
}
