//! Sends a frame every 10 ms on channel 0 of one gateway and counts the frames that return. Outages
//! (link lost, gateway restarting, queue full) are states that the loop reports and passes through;
//! only an error that nothing repairs ends the program.
//!
//! ```text
//! ECAN_ECRT=sim cargo run
//! ```

use ecan_lite::can::Session;
use ecan_lite::prelude::*;

const CYCLE: Duration = Duration::from_millis(10);
const CYCLES: u64 = 500;

fn main() -> Result<()> {
    let channel = ChannelConfig::classic(1_000_000);
    let config = Config::new(CYCLE).with_gateway(GatewayConfig::on_channel(0, channel));

    let mut port = ecan_lite::open(config)?;
    port.wait_ready()?;

    let gateway = port.gateway(0)?;
    let can0 = port.channel(0, 0)?;
    let id = CanId::standard(0x123)?;
    let mut session = Session::Ready;
    let (mut sent, mut rejected, mut received) = (0_u64, 0_u64, 0_u64);

    for count in 0..CYCLES {
        let mut cycle = port.next_cycle();
        received +=
            cycle.received().filter(|item| matches!(item, ReceivedView::Frame { .. })).count()
                as u64;

        let frame = CanFrame::classic(id, &count.to_le_bytes())?;
        match cycle.send(can0, &frame).ok_or_temporary()? {
            Some(_) => sent += 1,
            None => rejected += 1,
        }
        cycle.end()?;

        // Report each change once.
        if port.session(gateway) != session {
            session = port.session(gateway);
            println!("cycle {count}: {gateway}: {session}");
        }
    }

    println!("{sent} frames sent, {rejected} rejected during outages, {received} received");
    Ok(())
}
