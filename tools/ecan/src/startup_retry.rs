//! Repetition of a startup that failed while the cycle runs.

use ecan_mcan_port::{PendingStep, Port};

/// Time between two looks and between two attempts, in nanoseconds.
const LOOK_NS: u64 = 1_000_000_000;
const ATTEMPT_NS: u64 = 10_000_000_000;

/// Repeats the startup of gateways that the master keeps in PREOP. It may block, which no command
/// minds: none moves axes.
#[derive(Debug, Default)]
pub struct StartupRetry {
    next_ns: u64,
}

impl StartupRetry {
    /// Once per cycle, after its end. An attempt that the master rejects is repeated later.
    pub fn step(&mut self, port: &mut Port) {
        let now_ns = port.adapter().clock().now_ns();
        if now_ns < self.next_ns || port.is_ready() {
            return;
        }
        self.next_ns = now_ns + LOOK_NS;
        let mut gateways = port.gateways();
        if gateways.any(|gateway| port.waiting_for(gateway) == Some(PendingStep::StartupRetry)) {
            let _ = port.retry_startup();
            self.next_ns = now_ns + ATTEMPT_NS;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use ecan_host::AdapterConfig;
    use ecan_mcan_port::{ChannelConfig, GatewayConfig, PortConfig};
    use ecan_sim::{ClockKind, Fault, GatewayFault, SimOptions};

    use super::*;

    #[test]
    fn failed_startup_is_repeated_in_the_cycle() {
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &options).unwrap();
        let simulation = backend.simulation.unwrap();
        let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
        let gateway = GatewayConfig::on_channel(0, ChannelConfig::classic(500_000));
        let mut port =
            Port::open(&backend.ecrt, (adapter, PortConfig::uniform(1, gateway))).unwrap();
        let silent = GatewayFault::MailboxSilent { ms: 3_000 };
        simulation.inject(Fault::Gateway { gateway: 0, fault: silent });
        port.adapter_mut().begin_op_wait(Duration::from_secs(10)).unwrap();
        let mut retry = StartupRetry::default();
        let mut cycles = 0;
        while !port.is_ready() {
            port.next_cycle().end().unwrap();
            retry.step(&mut port);
            cycles += 1;
            assert!(cycles < 100_000, "{:?}", port.session(port.gateway(0).unwrap()));
        }
        let log = simulation.kernel_log();
        assert!(log.iter().any(|line| line.contains("no response")), "{log:?}");
    }
}
