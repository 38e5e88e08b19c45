//! Gateways in operation during a test, and the gateways that prevented its start.

use std::panic::resume_unwind;
use std::thread;
use std::thread::ScopedJoinHandle;

use ecan_host::{AdapterConfig, Diagnostics, Ecrt, Error, spawn_scoped};
use ecan_mcan_port::{Cycle, Port, PortConfig, PortError};
use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::options::RealTimeArguments;

use crate::context::{Failure, Result};

pub(super) struct TestBus {
    port: Port,
    interrupt: Interrupt,
}

impl TestBus {
    /// Starts the gateways; `None` if the user stops.
    pub(super) fn start(
        ecrt: &Ecrt,
        (adapter, config): (AdapterConfig, PortConfig),
        real_time: &RealTimeArguments,
        interrupt: &Interrupt,
    ) -> Result<Option<Self>, PortError> {
        let mut port = Port::open(ecrt, (adapter, config))?;
        // `None` if the user stops.
        let ready: Result<(), Option<PortError>> =
            port.wait_ready_with(port.startup_timeout(), |port| {
                // Single cycles may fail; the timeout ends it all.
                port.begin_cycle().finish();
                if interrupt.is_set() { Err(None) } else { Ok(()) }
            });
        match ready {
            Ok(()) => {}
            Err(None) => return Ok(None),
            Err(Some(error)) => return Err(error),
        }
        real_time.set_timing(port.adapter_mut());
        Ok(Some(Self { port, interrupt: interrupt.clone() }))
    }

    pub(super) fn port(&self) -> &Port {
        &self.port
    }

    pub(super) fn is_interrupted(&self) -> bool {
        self.interrupt.is_set()
    }

    pub(super) fn now_ns(&self) -> u64 {
        self.port.adapter().clock().now_ns()
    }

    /// Starts the statistics of the cycle again.
    pub(super) fn measure_cycles(&mut self) {
        self.port.adapter_mut().measure_cycles();
    }

    /// Longest period of this computer since [`measure_cycles`](Self::measure_cycles), in ns.
    pub(super) fn longest_period_ns(&self) -> u64 {
        self.port.adapter().cycle_statistics().map_or(0, |statistics| statistics.period().max_ns)
    }

    /// Runs one cycle with `run` in it.
    pub(super) fn cycle<R>(&mut self, run: impl FnOnce(&mut Cycle<'_>) -> R) -> Result<R> {
        let mut cycle = self.port.next_cycle();
        let result = run(&mut cycle);
        let ended = cycle.end().map(drop);
        ended.map_err(Failure::master)?;
        Ok(result)
    }

    pub(super) fn is_ready(&self, gateway: usize) -> bool {
        self.port.gateway(gateway).is_ok_and(|gateway| self.port.gateway_is_ready(gateway))
    }

    /// Reason why a gateway is not ready.
    pub(super) fn reason(&self, gateway: usize) -> String {
        let Ok(gateway) = self.port.gateway(gateway) else { return "not configured".to_owned() };
        let session = self.port.session(gateway);
        match self.port.waiting_for(gateway) {
            Some(step) => format!("not ready: {session}; it waits for {step}"),
            None => format!("not ready: {session}"),
        }
    }

    /// Number of times that a gateway was lost.
    pub(super) fn losses(&self, gateway: usize) -> u64 {
        let gateway = self.port.gateway(gateway);
        gateway.map_or(0, |gateway| self.port.statistics(gateway).sessions_lost)
    }

    /// Waits until these gateways are ready, at most the time of a startup; `false` if the user stops.
    pub(super) fn wait_ready(&mut self, gateways: &[usize]) -> Result<bool> {
        let timeout_ns = u64::try_from(self.port.startup_timeout().as_nanos()).unwrap_or(u64::MAX);
        let end_ns = self.now_ns().saturating_add(timeout_ns);
        while !gateways.iter().all(|gateway| self.is_ready(*gateway)) && self.now_ns() < end_ns {
            if self.is_interrupted() {
                return Ok(false);
            }
            self.cycle(|_| ())?;
        }
        Ok(true)
    }

    /// Runs `work` with blocking SDO transfers for each gateway while the cycle continues, and returns
    /// the results in this order. The gateways run in parallel, in stepped time in turn.
    pub(super) fn on_each<T: Send>(
        &mut self,
        gateways: &[usize],
        work: impl Fn(&Diagnostics, usize) -> Result<T, Error> + Sync,
    ) -> Result<Vec<Result<T, Error>>> {
        let is_parallel = self.port.adapter().clock().is_free_running() && gateways.len() > 1;
        let opener = |gateway: &usize| (*gateway, self.port.adapter().diagnostics_opener());
        let openers: Vec<_> = gateways.iter().map(opener).collect();
        let work = &work;
        let done = self.port.diagnose(move |diagnostics| {
            if !is_parallel {
                return gateways.iter().map(|gateway| work(diagnostics, *gateway)).collect();
            }
            thread::scope(|scope| {
                let mut threads = Vec::new();
                for (gateway, open) in openers {
                    threads.push(spawn_scoped(scope, move || work(&open()?, gateway)));
                }
                let join = |thread: ScopedJoinHandle<'_, Result<T, Error>>| {
                    thread.join().unwrap_or_else(|panic| resume_unwind(panic))
                };
                threads.into_iter().map(|thread| thread.and_then(join)).collect()
            })
        });
        done.map_err(Failure::of_diagnosis)
    }
}

/// A gateway that did not start.
#[derive(Debug)]
pub(super) struct StartFailure {
    /// Index in the configuration.
    pub(super) gateway: usize,
    pub(super) reason: String,
    /// The cause may pass, so that another attempt is sensible.
    pub(super) is_temporary: bool,
}

/// Failures in ascending order of the gateways, at least one; all `count` gateways if the error names
/// none.
pub(super) fn start_failures(error: &PortError, count: usize) -> Vec<StartFailure> {
    let named = named_failures(error);
    if !named.is_empty() {
        return named;
    }
    let failure = |gateway| StartFailure { gateway, reason: error.to_string(), is_temporary: true };
    (0..count).map(failure).collect()
}

fn named_failures(error: &PortError) -> Vec<StartFailure> {
    let one = |gateway, is_temporary| {
        vec![StartFailure { gateway, reason: error.to_string(), is_temporary }]
    };
    match error {
        PortError::NotReady { slave, .. } => one(*slave, error.is_temporary()),
        PortError::Adapter(Error::NotOperational(report)) => {
            let failures = report.slaves.iter().map(|slave| StartFailure {
                gateway: slave.slave,
                reason: slave.to_string(),
                is_temporary: slave.cause.as_ref().is_none_or(|cause| cause.is_temporary()),
            });
            failures.collect()
        }
        PortError::Adapter(
            Error::NoSuchSlave { slave, .. }
            | Error::IdentityMismatch { slave, .. }
            | Error::NotAnEcanLite { slave, .. }
            | Error::Unrecognised { slave, .. }
            | Error::Mapping { slave, .. }
            | Error::MappingCount { slave, .. }
            | Error::Layout { slave, .. }
            | Error::NotInPreop { slave, .. }
            | Error::Sdo { slave, .. }
            | Error::Readback { slave, .. },
        ) => one(*slave, error.is_temporary()),
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use ecan_host::NotOperational;

    use super::*;

    #[test]
    fn error_without_gateway_concerns_all() {
        let empty = NotOperational { waited_ms: 1, slaves: Vec::new() };
        let error = PortError::Adapter(Error::NotOperational(Box::new(empty)));
        let gateways: Vec<_> =
            start_failures(&error, 2).iter().map(|failure| failure.gateway).collect();
        assert_eq!(gateways, [0, 1]);
    }
}
