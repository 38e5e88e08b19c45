//! Program of README.md, and of `ecan new --for axes`.

use ecan_lite::config;
use ecan_lite::prelude::*;

fn main() -> Result<()> {
    let (bus, axes) = (config::load("machine.toml")?, config::load_axes("machine.toml")?);
    // Stops the axes when it is dropped, also after an error.
    let mut owner = ecan_lite::open_axes(bus, axes, Cia402Config::default())?;
    let (port, axes) = owner.parts();
    let timeout = Duration::from_secs(10);
    axes.blocking(port, timeout).on_progress(|axis| println!("{axis}")).start_up()?;

    let mut watch = BusWatch::new(port);
    for _ in 0..1000 {
        let mut cycle = port.next_cycle();
        axes.process_rx(&mut cycle);
        axes.send_target_step(&mut cycle);
        cycle.end()?;
        watch.changes(port).for_each(|change| eprintln!("{change}"));
    }
    axes.blocking(port, timeout).on_progress(|axis| println!("{axis}")).shut_down()?;
    Ok(())
}
