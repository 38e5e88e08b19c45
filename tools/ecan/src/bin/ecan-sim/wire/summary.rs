use ecan_protocol::mapping::CHANNELS;
use ecan_sim::Wire;

use crate::screen::Screen;

/// `dropped`: frames lost in the system's queue; `unsent`: answers that did not fit the interface's
/// queue.
pub fn print(wire: &Wire, dropped: u64, unsent: u64, screen: Screen) {
    let statistics = wire.statistics();
    screen.line(format_args!(
        "frames: {} EtherCAT, {} faulty, {} foreign, {} lost; {dropped} dropped by the system, \
         {unsent} answers not sent",
        statistics.frames, statistics.faulty, statistics.foreign, statistics.lost,
    ));
    let world = wire.world();
    for (index, gateway) in (0..).map_while(|index| Some((index, world.gateway(index)?))) {
        let counters = gateway.counters();
        screen.line(format_args!(
            "gateway {index}: {}, {} images received, {} sent, {} frames to the buses, {} from them",
            gateway.al_state(),
            counters.images_parsed,
            counters.images_read,
            counters.frames_on_bus,
            counters.frames_to_master,
        ));
        for channel in 0..CHANNELS {
            let (Some(bus), Some(station)) =
                (world.bus_of(index, channel), world.channel_statistics(index, channel))
            else {
                continue;
            };
            screen.line(format_args!(
                "  can{channel} on bus {}: {} sent, {} received, {} error frames on the bus",
                bus.name(),
                station.transmitted,
                station.received,
                bus.statistics().error_frames,
            ));
        }
    }
}
