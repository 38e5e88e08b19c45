//! Blocking calls that run the cycle.

use std::time::Duration;

use ecan_host::{
    CanController, Diagnostics, NotOperational, OpProgress, OpWait, Phase, run_in_parallel,
};
use ecan_protocol::config::NodeMode;
use ecan_protocol::device::ControllerMode;

use crate::address::GatewayHandle;
use crate::error::PortError;
use crate::gateway::Gateway;
use crate::port::Port;
use crate::session::verification::VerificationFault;

/// A cycle in which nothing is sent and everything received is discarded. Single cycles may fail:
/// the caller has a deadline.
fn empty_cycle(port: &mut Port) -> Result<(), PortError> {
    port.begin_cycle().finish();
    Ok(())
}

fn is_not_listening(fault: Option<VerificationFault>) -> bool {
    matches!(fault, Some(VerificationFault::NodeMode { .. }))
}

impl Port {
    /// Activates the bus unless it is active, and runs the cycle until every gateway is in OP,
    /// verified and ready, for at most [`startup_timeout`](Self::startup_timeout).
    ///
    /// Blocks, for seconds. Discards received frames. Continue with
    /// [`next_cycle`](Self::next_cycle).
    ///
    /// # Errors
    /// [`PortError::Adapter`] with a report of the slaves that do not reach OP;
    /// [`PortError::NotReady`] for a gateway in OP that is not ready, with the step that it waits
    /// for, or as soon as it has answered twice with a value that is not the configured one.
    pub fn wait_ready(&mut self) -> Result<(), PortError> {
        self.wait_ready_timeout(self.startup_timeout())
    }

    /// As [`wait_ready`](Self::wait_ready), with a timeout.
    ///
    /// # Errors
    /// As [`wait_ready`](Self::wait_ready).
    pub fn wait_ready_timeout(&mut self, timeout: Duration) -> Result<(), PortError> {
        self.wait_ready_with(timeout, empty_cycle)
    }

    /// As [`wait_ready`](Self::wait_ready), with the application's own cycle: from
    /// [`begin_cycle`](Self::begin_cycle) to its end, on an attached Adapter with the owner's
    /// receive before and its send after. Its errors end the wait.
    ///
    /// # Errors
    /// As [`wait_ready`](Self::wait_ready), and the application's.
    pub fn wait_ready_with<E: From<PortError>>(
        &mut self,
        timeout: Duration,
        mut cycle: impl FnMut(&mut Self) -> Result<(), E>,
    ) -> Result<(), E> {
        let failed = |error| E::from(PortError::Adapter(error));
        let mut wait = OpWait::begin(&mut self.adapter, timeout).map_err(failed)?;
        let clock = self.adapter.ecrt().clock().clone();
        let start = clock.now_ns();
        let mut is_operational = false;
        loop {
            self.wait_next_cycle();
            cycle(self)?;
            if self.adapter.should_stop() {
                return Err(failed(ecan_host::Error::Stopped));
            }
            if is_operational && self.is_ready() {
                return Ok(());
            }
            if is_operational {
                let waited_ms = (clock.now_ns() - start) / 1_000_000;
                let mut sessions = self.state.gateways.iter().map(|gateway| &gateway.session);
                if u128::from(waited_ms) > timeout.as_millis()
                    || sessions.any(|session| session.fails_for_good())
                {
                    let error = not_ready(self, waited_ms);
                    stop_not_listening(self, |port| drop(cycle(port)));
                    return Err(error.into());
                }
                continue;
            }
            match wait.progress(&mut self.adapter).map_err(failed)? {
                OpProgress::Reached => is_operational = true,
                OpProgress::Pending => {}
                OpProgress::Failed { waited_ms } => {
                    let mut report =
                        NotOperational::find(&self.adapter, waited_ms).map_err(failed)?;
                    let work = report.investigation(&self.adapter);
                    let open = self.adapter.diagnostics_opener();
                    let causes = run_in_parallel(clock.as_ref(), open, work, || {
                        self.wait_next_cycle();
                        let _ = cycle(self);
                    });
                    let causes = causes.map_err(failed)?;
                    report.explain(causes);
                    if !wait.retry(&mut self.adapter, &report).map_err(failed)? {
                        return Err(failed(ecan_host::Error::NotOperational(Box::new(report))));
                    }
                }
            }
        }
    }

    /// Takes the channels that should only listen off their buses, on gateways whose controllers are in
    /// another mode ([`VerificationFault::NodeMode`]), and returns the error of the first such gateway. For
    /// applications that do not wait by [`wait_ready`](Self::wait_ready), which does the same.
    ///
    /// Blocks, if there are such channels. Only a restart of the gateway is sure to take a channel off
    /// its bus (assumption H32): a failure is logged.
    pub fn stop_channels_not_listening(&mut self) -> Option<PortError> {
        let is_wrong = |gateway: &Gateway| is_not_listening(gateway.session.last_fault());
        self.state.gateways.iter().any(is_wrong).then(|| {
            let error = not_ready(self, 0);
            stop_not_listening(self, |port| drop(empty_cycle(port)));
            error
        })
    }

    /// Time to allow for the startup of all gateways: see
    /// [`Adapter::startup_timeout`](ecan_host::Adapter::startup_timeout).
    pub fn startup_timeout(&self) -> Duration {
        self.adapter.startup_timeout()
    }

    /// Runs `work` on another thread, with its own diagnostics handle, while this thread runs the
    /// cycle: for blocking SDO transfers on an active bus. Discards received frames and sends
    /// nothing.
    ///
    /// # Errors
    /// The handle cannot be opened.
    pub fn diagnose<R: Send>(
        &mut self,
        work: impl FnOnce(&Diagnostics) -> R + Send,
    ) -> Result<R, PortError> {
        self.diagnose_with(empty_cycle, work)
    }

    /// As [`diagnose`](Self::diagnose), with the application's own cycle.
    ///
    /// # Errors
    /// As [`diagnose`](Self::diagnose). Errors of single cycles do not end the work.
    pub fn diagnose_with<R: Send, E>(
        &mut self,
        mut cycle: impl FnMut(&mut Self) -> Result<(), E>,
        work: impl FnOnce(&Diagnostics) -> R + Send,
    ) -> Result<R, PortError> {
        if self.adapter.phase() != Phase::Active {
            return Ok(work(&self.adapter.open_diagnostics()?));
        }
        let clock = self.adapter.ecrt().clock().clone();
        let open = self.adapter.diagnostics_opener();
        Ok(run_in_parallel(clock.as_ref(), open, work, || {
            self.wait_next_cycle();
            let _ = cycle(self);
        })?)
    }
}

/// Takes the channels that should only listen off their buses, with `cycle` as the cycle.
fn stop_not_listening(port: &mut Port, mut cycle: impl FnMut(&mut Port)) {
    let mut channels = Vec::new();
    for (slave, gateway) in port.state.gateways.iter().enumerate() {
        if !is_not_listening(gateway.session.last_fault()) {
            continue;
        }
        let settings = port.config().gateways.get(slave).map(|gateway| gateway.channels);
        for (channel, settings) in (0..).zip(settings.iter().flatten()) {
            if settings.is_some_and(|channel| channel.can.node_mode == NodeMode::Listen) {
                channels.push((slave, channel));
            }
        }
    }
    if channels.is_empty() {
        return;
    }
    let stop = |diagnostics: &Diagnostics| {
        for (slave, channel) in channels {
            let controller = CanController::new(diagnostics, slave, channel);
            let mode = match controller.mode() {
                Ok(ControllerMode::Listen) => continue,
                Ok(mode) => mode.text(),
                Err(_) => "not readable",
            };
            match controller.leave_bus() {
                Ok(()) => tracing::warn!(
                    slave,
                    channel,
                    "slave {slave} channel {channel}: taken off its bus (mode: {mode})"
                ),
                Err(error) => tracing::error!(
                    slave,
                    channel,
                    "slave {slave} channel {channel}: still on its bus (mode: {mode}); restart the \
                     gateway: {error}"
                ),
            }
        }
    };
    let stopped = port.diagnose_with(
        |port| {
            cycle(port);
            Ok::<(), PortError>(())
        },
        stop,
    );
    if let Err(error) = stopped {
        tracing::error!("channels that are not listen-only are still on their buses: {error}");
    }
}

/// Error for the first gateway that is not ready.
fn not_ready(port: &Port, waited_ms: u64) -> PortError {
    let position = |is_cause: fn(&Gateway) -> bool| port.state.gateways.iter().position(is_cause);
    let slave = position(|gateway| gateway.session.fails_for_good())
        .or(position(|gateway| !gateway.session.is_ready()))
        .unwrap_or_default();
    let gateway = GatewayHandle::new(slave);
    let is_final =
        port.state.gateways.get(slave).is_some_and(|gateway| gateway.session.fails_for_good());
    PortError::NotReady {
        slave,
        session: port.session(gateway),
        waiting_for: port.waiting_for(gateway).filter(|_| !is_final),
        last_fault: port.last_verification_fault(gateway),
        waited_ms,
    }
}
