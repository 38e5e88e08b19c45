//! A digital I/O of another vendor: a slave controller with outputs, inputs and a watchdog, without
//! firmware.

use ecan_protocol::device::{AlState, AlStatusCode};

use crate::scenario::{IoBehaviour, IoSpec};

/// Time without outputs after which they are cleared, unless the master configures another one, ns.
const WATCHDOG_NS: u64 = 100_000_000;

/// Sync managers: outputs, inputs.
const SYNC_MANAGERS: usize = 2;

/// A simulated digital I/O.
#[derive(Clone, Debug)]
pub struct IoSlave {
    spec: IoSpec,
    /// When it responds; `None` without supply.
    ready_at: Option<u64>,
    state: AlState,
    status_code: AlStatusCode,
    /// Configured lengths in bytes.
    sync_managers: [Option<u16>; SYNC_MANAGERS],
    watchdog_ns: u64,
    outputs: Vec<u8>,
    written_at: u64,
    reads: u64,
}

impl IoSlave {
    /// An I/O without supply.
    pub(crate) fn new(spec: IoSpec) -> Self {
        Self {
            ready_at: None,
            state: AlState::Init,
            status_code: AlStatusCode::OK,
            sync_managers: [None; SYNC_MANAGERS],
            watchdog_ns: WATCHDOG_NS,
            outputs: vec![0; usize::from(spec.outputs)],
            written_at: 0,
            reads: 0,
            spec,
        }
    }

    /// Its description in the scenario.
    #[must_use]
    pub fn spec(&self) -> &IoSpec {
        &self.spec
    }

    pub(crate) fn set_alias(&mut self, alias: u16) {
        self.spec.alias = alias;
    }

    /// Present AL state.
    #[must_use]
    pub fn al_state(&self) -> AlState {
        self.state
    }

    /// AL status code; 0 without an error.
    #[must_use]
    pub fn al_status_code(&self) -> u16 {
        self.status_code.0
    }

    /// Values of the outputs at `now`, ns: 0 outside OP, and after the watchdog time without a write.
    pub fn outputs(&self, now: u64) -> impl Iterator<Item = u8> {
        let is_driven =
            self.state == AlState::Op && now.saturating_sub(self.written_at) < self.watchdog_ns;
        self.outputs.iter().map(move |byte| if is_driven { *byte } else { 0 })
    }

    /// Replaces the values of the inputs.
    pub fn set_behaviour(&mut self, behaviour: IoBehaviour) {
        self.spec.behaviour = behaviour;
    }

    /// Returns whether it responds to frames.
    #[must_use]
    pub fn is_responding(&self, now: u64) -> bool {
        self.ready_at.is_some_and(|at| at <= now)
    }

    /// Switches the supply off, and on again at `on_at`.
    pub(crate) fn power(&mut self, on_at: Option<u64>) {
        let boot_ns = u64::from(self.spec.boot_ms) * 1_000_000;
        let ready_at = on_at.map(|at| at.saturating_add(boot_ns));
        *self = Self { ready_at, ..Self::new(self.spec.clone()) };
    }

    pub(crate) fn clear_registers(&mut self) {
        self.sync_managers = [None; SYNC_MANAGERS];
    }

    /// Configures SM0 or SM1; others are ignored.
    pub(crate) fn configure_sync_manager(&mut self, number: usize, length: u16) {
        if let Some(sync_manager) = self.sync_managers.get_mut(number) {
            *sync_manager = (length > 0).then_some(length);
        }
    }

    pub(crate) fn set_watchdog_ns(&mut self, ns: u64) {
        self.watchdog_ns = ns;
    }

    /// The master writes AL control. Process data need sync managers of the fixed lengths.
    pub(crate) fn request_al_state(&mut self, to: AlState) {
        let is_fit = |number: usize, bytes: u8| {
            let length = self.sync_managers.get(number).copied().flatten();
            length == (bytes > 0).then_some(u16::from(bytes))
        };
        let code = match to {
            AlState::Boot => AlStatusCode::UNKNOWN_STATE,
            AlState::Op if !matches!(self.state, AlState::SafeOp | AlState::Op) => {
                AlStatusCode::INVALID_STATE_CHANGE
            }
            AlState::SafeOp | AlState::Op if !is_fit(0, self.spec.outputs) => {
                AlStatusCode::OUTPUT_CONFIGURATION
            }
            AlState::SafeOp | AlState::Op if !is_fit(1, self.spec.inputs) => {
                AlStatusCode::INPUT_CONFIGURATION
            }
            _ => AlStatusCode::OK,
        };
        self.status_code = code;
        if code == AlStatusCode::OK {
            self.state = to;
        }
    }

    fn exchanges(&self) -> bool {
        matches!(self.state, AlState::SafeOp | AlState::Op)
    }

    /// A write to the outputs in their full length; returns whether it counts.
    pub(crate) fn write_outputs(&mut self, now: u64, data: &[u8]) -> bool {
        if !self.exchanges() || data.len() != self.outputs.len() {
            return false;
        }
        self.outputs.copy_from_slice(data);
        self.written_at = now;
        true
    }

    /// A read of the inputs in their full length; returns whether it counts.
    pub(crate) fn read_inputs(&mut self, now: u64, data: &mut [u8]) -> bool {
        if !self.exchanges() || data.len() != usize::from(self.spec.inputs) {
            return false;
        }
        self.reads = self.reads.wrapping_add(1);
        data.fill(0);
        match &self.spec.behaviour {
            IoBehaviour::Loopback => copy(data, self.outputs(now)),
            IoBehaviour::Counter => copy(data, self.reads.to_le_bytes().into_iter()),
            IoBehaviour::Fixed(values) => copy(data, values.iter().copied()),
        }
        true
    }
}

fn copy(data: &mut [u8], values: impl Iterator<Item = u8>) {
    for (byte, value) in data.iter_mut().zip(values) {
        *byte = value;
    }
}
