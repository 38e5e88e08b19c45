use ecan_host::{Maintenance, MaintenanceError};
use ecan_protocol::device::MaintenanceCommand;

use crate::context::{Bus, Failure, Result};

/// Clears the PDO errors of both directions, the cycle statistics, the runtime diagnostics and
/// flags.
pub(super) fn clear(bus: &Bus, slave: usize) -> Result {
    for profile in [0x8010, 0x8011] {
        bus.write(slave, profile, 8, 0b10)?;
    }
    bus.write(slave, 0x9011, 14, 1)?;
    let maintenance = Maintenance::new(bus.diagnostics(), slave);
    let cleared = maintenance.command(MaintenanceCommand::ClearDiagnostics, bus.clock());
    cleared.map_err(|error| match error {
        MaintenanceError::Device(error) => Failure::Device(error),
        other => Failure::Rejected(format!("diagnostics not cleared: {other}")),
    })
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use ecan_host::AdapterConfig;
    use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig};
    use ecan_sim::{ClockKind, SimOptions};

    use super::*;

    #[test]
    fn counters_of_an_operation_are_cleared() {
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &options).unwrap();
        let simulation = backend.simulation.clone().unwrap();
        let gateway = GatewayConfig::on_channel(0, ChannelConfig::classic(500_000));
        let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
        let mut port =
            Port::open(&backend.ecrt, (adapter, PortConfig::uniform(1, gateway))).unwrap();
        port.wait_ready().unwrap();
        simulation.pass_ns(300_000);
        let damage = |gateway: &mut ecan_sim::Gateway, now| gateway.write_outputs(now, &[0; 384]);
        let is_taken = simulation.with_world(|world| world.with_gateway(0, damage));
        assert_eq!(is_taken, Some(true));
        simulation.pass_ns(300_000);
        drop(port);
        simulation.pass_ns(2_000_000_000);

        let bus = Bus::over(&backend.ecrt);
        let counts = || {
            [(0x8011, 14), (0x8011, 15), (0x9011, 1)]
                .map(|(index, subindex)| bus.read(0, index, subindex).unwrap())
        };
        let before = counts();
        assert_eq!(before[..2], [14, 1], "an all-zero image has a bad header");
        assert!(before[2] > 0);
        clear(&bus, 0).unwrap();
        assert_eq!(counts(), [0, 0, 0]);
    }
}
