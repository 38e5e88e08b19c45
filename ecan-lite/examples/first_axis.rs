//! Program of README.md.

use ecan_lite::prelude::*;

fn main() -> Result<()> {
    let gateway = GatewayConfig::on_channel(0, ChannelConfig::classic(1_000_000));
    let config = Config::new(Duration::from_millis(2)).with_gateway(gateway);
    let node = NodeId::new(1).ok_or("invalid node-ID")?;
    let shoulder = NodeAddress { slave: 0, channel: 0, node };
    let table = vec![AxisConfig::new(shoulder).with_target_step(20)];
    // Stops the axes when it is dropped, also after an error.
    let mut owner = ecan_lite::open_axes(config, table, Cia402Config::default())?;
    let (port, axes) = owner.parts();
    let timeout = Duration::from_secs(10);
    axes.blocking(port, timeout).on_progress(|axis| println!("{axis}")).start_up()?;

    for _ in 0..1000 {
        let mut cycle = port.next_cycle();
        axes.process_rx(&mut cycle);
        axes.send_target_step(&mut cycle);
        cycle.end()?;
    }
    axes.blocking(port, timeout).on_progress(|axis| println!("{axis}")).shut_down()?;
    Ok(())
}
