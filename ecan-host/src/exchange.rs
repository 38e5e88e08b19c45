//! The exchange of process data in a cycle: its phase, its result for each slave, its errors.

use ecrt_sys::Errno;
use thiserror::Error;

use crate::datagrams::DomainLayout;
use crate::master::{DomainState, WcState};

/// Errors inside the cycle: small, `Copy`, without allocation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum CycleError {
    /// A call of the master library failed.
    #[error("{call}{} failed in the cycle: {errno}", Of(*slave))]
    Library {
        /// Name of the library function.
        call: &'static str,
        /// Slave index, if the call concerns one slave.
        slave: Option<usize>,
        /// Error number of the system.
        errno: Errno,
    },
    /// The Adapter is not active, so that there is no cycle.
    #[error(
        "the bus is {is}, not active; {}",
        if *is == Phase::Down {
            "the last reconfiguration failed: call reconfigure again"
        } else {
            "call activate first"
        }
    )]
    NotActive {
        /// Current phase.
        is: Phase,
    },
}

impl CycleError {
    /// Returns whether a later cycle can succeed without a change by the application: a call of the master
    /// library failed, on a bus that may recover.
    pub fn is_temporary(&self) -> bool {
        matches!(self, Self::Library { .. })
    }

    pub(crate) fn library(call: &'static str) -> impl Fn(Errno) -> Self {
        move |errno| Self::Library { call, slave: None, errno }
    }

    pub(crate) fn of_slave(call: &'static str, slave: usize) -> impl Fn(Errno) -> Self {
        move |errno| Self::Library { call, slave: Some(slave), errno }
    }
}

struct Of(Option<usize>);

impl std::fmt::Display for Of {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.map_or(Ok(()), |slave| write!(f, " of slave {slave}"))
    }
}

ecan_protocol::text_enum! {
    /// Phase of an [`Adapter`](crate::Adapter).
    pub enum Phase;
    /// Nothing is configured, because a reconfiguration failed. Call
    /// [`Adapter::reconfigure`](crate::Adapter::reconfigure) again, or drop the Adapter.
    Down = "down";
    /// Slaves, domains and startup SDOs are configured; requests can be created.
    Configured = "configured";
    /// The master runs cyclically; the process data exist.
    Active = "active";
}

/// Delivery of one direction in the last exchange, by the working counter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Delivery {
    /// No exchange yet.
    #[default]
    None,
    /// The image was delivered.
    Confirmed,
    /// The image was not delivered.
    Missed,
    /// Unknown: with LWR and LRD a sum of 1 may be either direction; unknown also after an error
    /// of the library.
    Unknown,
}

/// Result of the last exchange with one slave.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DomainReport {
    /// Working counter of the slave's domain.
    pub working_counter: u32,
    /// Working counter of a complete exchange.
    pub expected_working_counter: u32,
    /// The master's evaluation, which decides.
    pub wc_state: WcState,
    /// Delivery of the RxPDO image.
    pub outputs: Delivery,
    /// Delivery of the TxPDO image.
    pub inputs: Delivery,
}

impl Default for DomainReport {
    fn default() -> Self {
        Self {
            working_counter: 0,
            expected_working_counter: 0,
            wc_state: WcState::Zero,
            outputs: Delivery::None,
            inputs: Delivery::None,
        }
    }
}

impl DomainReport {
    /// Returns whether both directions were exchanged. Motion waits for this in every cycle (manual
    /// 15.5.2, step 8).
    pub fn is_complete(&self) -> bool {
        self.wc_state == WcState::Complete
    }

    /// Returns whether more than one slave took part in the exchange: another one has the same process
    /// data.
    pub fn is_shared(&self) -> bool {
        self.wc_state == WcState::Incomplete && self.working_counter > self.expected_working_counter
    }

    /// Records that nothing is known of an exchange.
    #[inline]
    pub(crate) fn clear(&mut self) {
        let expected_working_counter = self.expected_working_counter;
        let (outputs, inputs) = (Delivery::Unknown, Delivery::Unknown);
        *self = Self { expected_working_counter, outputs, inputs, ..Self::default() };
    }

    /// Records the working counter of an exchange.
    #[inline]
    pub(crate) fn record(&mut self, layout: DomainLayout, state: DomainState) {
        self.working_counter = state.working_counter;
        self.wc_state = state.wc_state;
        let seen = |counted: bool| if counted { Delivery::Confirmed } else { Delivery::Missed };
        (self.outputs, self.inputs) = match state.wc_state {
            WcState::Complete => (Delivery::Confirmed, Delivery::Confirmed),
            WcState::Zero => (Delivery::Missed, Delivery::Missed),
            // Another slave has the same process data: the images are a mixture.
            WcState::Incomplete if self.is_shared() => (Delivery::Unknown, Delivery::Unknown),
            // In a single LRW a read counts 1 and a write 2, each on its own.
            WcState::Incomplete if layout.is_single_datagram() => {
                (seen(state.working_counter & 2 != 0), seen(state.working_counter & 1 != 0))
            }
            WcState::Incomplete => (Delivery::Unknown, Delivery::Unknown),
        };
    }
}
