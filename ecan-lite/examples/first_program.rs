//! Program of README.md, and of `ecan new --for frames`.

use ecan_lite::prelude::*;

fn main() -> Result<()> {
    let mut port = ecan_lite::open(ecan_lite::config::load("machine.toml")?)?;
    port.wait_ready()?;
    let can0 = port.channel(0, 0)?;
    let id = CanId::standard(0x123)?;
    let mut watch = BusWatch::new(&port);

    for count in 0..1000_u64 {
        let mut cycle = port.next_cycle(); // waits for its time, receives, checks the images
        for received in cycle.received() {
            println!("{received}");
        }
        // A full queue or a lost gateway is temporary; the watch tells what was lost, and why.
        cycle.send(can0, &CanFrame::classic(id, &count.to_le_bytes())?).ok_or_temporary()?;
        cycle.end()?;
        watch.changes(&port).for_each(|change| eprintln!("{change}"));
    }
    check_delivery(&port)?;
    Ok(())
}
