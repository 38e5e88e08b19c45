//! Boot-up of one node.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use ecan_protocol::sequence::Expectation;

use super::boot_config::{BootConfig, BootReset};
use super::boot_error::BootError;
use super::boot_phase::BootPhase;
use super::parameter::Subject;
use super::parameter_download::{ParameterDownload, ParameterState};
use crate::network::address::{NodeAddress, NodeHandle};
use crate::network::network::Network;
use crate::network::node_action::{NodeAction, Step};
use crate::network::node_sequence::{Configuring, NodeSequence};
use crate::network::sdo_turn::{SdoTurn, TurnState};
use crate::{NmtCommand, NmtState, object};

/// Restarts of a node in one boot-up before it fails.
const MAX_RESTARTS: u8 = 3;
/// Shortest time to wait for a heartbeat or an NMT state.
const REPORT_TIMEOUT: Duration = Duration::from_millis(500);
const LOAD: u32 = u32::from_le_bytes(*b"load");

/// Progress of the boot-up of one node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BootProgress {
    /// Its name in [`BootConfig`]; may be empty.
    pub name: Arc<str>,
    /// The node.
    pub address: NodeAddress,
    /// The network is booted only with this node.
    pub is_mandatory: bool,
    /// Its phase.
    pub phase: BootPhase,
    /// Time since the boot-up began, or its duration if it has ended.
    pub elapsed: Duration,
    /// Number of written parameters.
    pub done: usize,
    /// Number of parameters.
    pub of: usize,
    /// Object of the present transfer of a parameter.
    pub subject: Option<Subject>,
    /// The node had its configuration already, by its configuration date 0x1020.
    pub is_unchanged: bool,
    /// Number of boot-ups after a restart of the node.
    pub restarts: u32,
    /// Failure of the boot-up.
    pub error: Option<BootError>,
}

/// `gripper, node 5 (slave 0, channel 1): writing parameters, 3 of 17, 0x6081:00 (Profile velocity), for 12 ms`
impl fmt::Display for BootProgress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ms = self.elapsed.as_millis();
        if !self.name.is_empty() {
            write!(f, "{}, ", self.name)?;
        }
        write!(f, "{}: ", self.address)?;
        match (&self.error, self.phase) {
            (Some(error), BootPhase::Failed) => {
                write!(f, "boot-up failed (status {}): {error}", error.cia302_status())
            }
            (_, BootPhase::Booted) if self.is_unchanged => {
                write!(f, "booted after {ms} ms, parameters unchanged")
            }
            (_, BootPhase::Booted) => {
                let plural = if self.of == 1 { "" } else { "s" };
                write!(f, "booted after {ms} ms, {} parameter{plural}", self.of)
            }
            (_, BootPhase::Waiting) => write!(f, "{}", self.phase),
            (_, phase) => {
                write!(f, "{phase}")?;
                if let Some(subject) = &self.subject {
                    let nth = (self.done + 1).min(self.of);
                    write!(f, ", {nth} of {}, {subject}", self.of)?;
                }
                if ms > 0 { write!(f, ", for {ms} ms") } else { Ok(()) }
            }
        }
    }
}

/// Boot-up of one node.
#[derive(Debug)]
pub(super) struct NodeBoot {
    pub(super) handle: NodeHandle,
    pub(super) address: NodeAddress,
    pub(super) config: BootConfig,
    phase: BootPhase,
    /// Steps of the phases with steps.
    identity: NodeSequence<Vec<Step>>,
    restore: NodeSequence<Vec<Step>>,
    further: NodeSequence<Vec<Step>>,
    start: NodeSequence<Vec<Step>>,
    parameters: ParameterDownload,
    contact: Contact,
    begin_ns: u64,
    end_ns: u64,
    /// Boot-up messages of the node that are accounted for.
    boot_ups: u32,
    restarts: u32,
    restarts_in_boot: u8,
    is_unchanged: bool,
    error: Option<BootError>,
}

/// Result of a phase in one cycle.
enum Turn {
    Wait,
    Enter(BootPhase),
    Fail(BootError),
}

/// First contact with a node.
#[derive(Debug, Default)]
struct Contact {
    turn: SdoTurn,
    is_transferring: bool,
    /// Command to send first.
    command: Option<NmtCommand>,
    /// A boot-up message is expected, since the node was reset.
    awaits_boot_up: bool,
}

impl NodeBoot {
    pub(super) fn new(handle: NodeHandle, address: NodeAddress, config: BootConfig) -> Self {
        Self {
            handle,
            address,
            phase: BootPhase::Waiting,
            identity: NodeSequence::new(identity_steps(&config)),
            restore: NodeSequence::new(restore_steps(&config)),
            further: NodeSequence::new(config.steps.clone()),
            start: NodeSequence::new(start_steps(&config)),
            parameters: ParameterDownload::new(Arc::clone(&config.parameters)),
            contact: Contact::default(),
            begin_ns: 0,
            end_ns: 0,
            boot_ups: 0,
            restarts: 0,
            restarts_in_boot: 0,
            is_unchanged: false,
            error: None,
            config,
        }
    }

    pub(super) fn phase(&self) -> BootPhase {
        self.phase
    }

    pub(super) fn progress(&self, now_ns: u64) -> BootProgress {
        let end = match self.phase {
            BootPhase::Booted | BootPhase::Failed => self.end_ns,
            BootPhase::Waiting => self.begin_ns,
            _ => now_ns,
        };
        let (done, of) = self.parameters.progress();
        let is_writing = self.phase == BootPhase::Parameters;
        BootProgress {
            name: Arc::clone(&self.config.name),
            address: self.address,
            is_mandatory: self.config.is_mandatory,
            phase: self.phase,
            elapsed: Duration::from_nanos(end.saturating_sub(self.begin_ns)),
            done,
            of,
            subject: if is_writing { self.parameters.subject() } else { None },
            is_unchanged: self.is_unchanged,
            restarts: self.restarts,
            error: self.error.clone(),
        }
    }

    /// Starts the boot-up; with the configured reset, or without one after a restart of the node.
    pub(super) fn begin(&mut self, network: &Network, reset: BootReset, now_ns: u64) {
        let (command, awaits_boot_up) = match reset {
            BootReset::None => (NmtCommand::EnterPreOperational, false),
            BootReset::Communication => (NmtCommand::ResetCommunication, true),
            BootReset::Node => (NmtCommand::ResetNode, true),
        };
        self.contact = Contact { command: Some(command), awaits_boot_up, ..Contact::default() };
        self.begin_ns = now_ns;
        self.restarts_in_boot = 0;
        self.enter_contact(network);
    }

    fn enter_contact(&mut self, network: &Network) {
        self.boot_ups = boot_ups(network, self.handle);
        self.identity.restart();
        self.restore.restart();
        self.further.restart();
        self.start.restart();
        self.parameters.restart();
        self.is_unchanged = false;
        self.error = None;
        self.phase = BootPhase::Contact;
    }

    /// Executes the boot-up, as much as possible in a cycle. Real-time safe.
    pub(super) fn advance(&mut self, network: &mut Network, now_ns: u64) {
        self.watch_restarts(network, now_ns);
        loop {
            let before = self.phase;
            let next = match before {
                BootPhase::Waiting | BootPhase::Booted | BootPhase::Failed => return,
                BootPhase::Contact => self.step_contact(network, now_ns),
                BootPhase::Identity => step(
                    &mut self.identity,
                    network,
                    self.handle,
                    now_ns,
                    (before, BootPhase::Restore),
                ),
                BootPhase::Restore => {
                    let next = step(
                        &mut self.restore,
                        network,
                        self.handle,
                        now_ns,
                        (before, BootPhase::Parameters),
                    );
                    // Its own reset is not a restart.
                    self.boot_ups = boot_ups(network, self.handle);
                    next
                }
                BootPhase::Parameters => match self.parameters.advance(network, self.handle) {
                    ParameterState::Running => Turn::Wait,
                    ParameterState::Failed(error) => Turn::Fail(BootError::Parameters(error)),
                    ParameterState::Written => Turn::Enter(BootPhase::Steps),
                    ParameterState::Unchanged => {
                        self.is_unchanged = true;
                        Turn::Enter(BootPhase::Steps)
                    }
                },
                BootPhase::Steps => step(
                    &mut self.further,
                    network,
                    self.handle,
                    now_ns,
                    (before, BootPhase::Start),
                ),
                BootPhase::Start => {
                    step(&mut self.start, network, self.handle, now_ns, (before, BootPhase::Booted))
                }
            };
            match next {
                Turn::Wait => return,
                Turn::Enter(phase) => {
                    self.phase = phase;
                    if phase == BootPhase::Booted {
                        self.end_ns = now_ns;
                        let ms = now_ns.saturating_sub(self.begin_ns) / 1_000_000;
                        tracing::info!("{}: booted after {ms} ms", self.address);
                    }
                }
                Turn::Fail(error) => return self.fail(error, now_ns),
            }
        }
    }

    fn fail(&mut self, error: BootError, now_ns: u64) {
        let status = error.cia302_status();
        tracing::error!("{}: boot-up failed (status {status}): {error}", self.address);
        self.phase = BootPhase::Failed;
        self.end_ns = now_ns;
        self.error = Some(error);
    }

    /// A boot-up message that the boot-up itself did not cause: the node restarted, or was replaced.
    fn watch_restarts(&mut self, network: &mut Network, now_ns: u64) {
        let seen = boot_ups(network, self.handle);
        if seen == self.boot_ups || !self.config.reboots {
            return;
        }
        match self.phase {
            // Expected there.
            BootPhase::Waiting | BootPhase::Contact | BootPhase::Restore => return,
            BootPhase::Booted | BootPhase::Failed => {
                self.begin(network, BootReset::None, now_ns);
            }
            _ => {
                self.cancel(network);
                self.restarts_in_boot = self.restarts_in_boot.saturating_add(1);
                if self.restarts_in_boot > MAX_RESTARTS {
                    self.boot_ups = seen;
                    let restarts = self.restarts_in_boot;
                    return self.fail(BootError::Restarts { restarts }, now_ns);
                }
                self.contact = Contact::default();
                self.enter_contact(network);
            }
        }
        self.restarts = self.restarts.saturating_add(1);
        tracing::warn!("{}: restarted, boots again", self.address);
    }

    pub(super) fn cancel(&self, network: &mut Network) {
        match self.phase {
            BootPhase::Contact if self.contact.is_transferring => network.cancel_sdo(self.handle),
            BootPhase::Identity => self.identity.cancel(network, self.handle),
            BootPhase::Restore => self.restore.cancel(network, self.handle),
            BootPhase::Parameters => self.parameters.cancel(network, self.handle),
            BootPhase::Steps => self.further.cancel(network, self.handle),
            BootPhase::Start => self.start.cancel(network, self.handle),
            _ => {}
        }
    }

    /// Sends the first command, then reads the device type until the node responds.
    fn step_contact(&mut self, network: &mut Network, now_ns: u64) -> Turn {
        let waited = Duration::from_nanos(now_ns.saturating_sub(self.begin_ns));
        if let Some(command) = self.contact.command {
            if network.nmt(self.handle, command).is_err() {
                return Turn::Wait;
            }
            self.contact.command = None;
        }
        let has_booted = boot_ups(network, self.handle) != self.boot_ups;
        // Old nodes send no boot-up message.
        let is_ready =
            !self.contact.awaits_boot_up || has_booted || waited > self.config.boot_timeout / 2;
        if is_ready && !self.contact.is_transferring {
            let started = self.contact.turn.upload(network, self.handle, (object::DEVICE_TYPE, 0));
            self.contact.is_transferring = started.unwrap_or(false);
        }
        if self.contact.is_transferring {
            match self.contact.turn.poll(network, self.handle) {
                TurnState::Busy => {}
                TurnState::Lost => self.contact.is_transferring = false,
                TurnState::Done | TurnState::Failed(crate::SdoFault::Aborted(_)) => {
                    self.contact.is_transferring = false;
                    self.boot_ups = boot_ups(network, self.handle);
                    return Turn::Enter(BootPhase::Identity);
                }
                TurnState::Failed(_) => self.contact.is_transferring = false,
            }
        }
        if waited > self.config.boot_timeout {
            if self.contact.is_transferring {
                network.cancel_sdo(self.handle);
            }
            return Turn::Fail(BootError::NoResponse { waited });
        }
        Turn::Wait
    }
}

fn step(
    sequence: &mut NodeSequence<Vec<Step>>,
    network: &mut Network,
    handle: NodeHandle,
    now_ns: u64,
    (phase, next): (BootPhase, BootPhase),
) -> Turn {
    match sequence.advance(network, handle, now_ns, |_, _, _| {}) {
        Configuring::Running => Turn::Wait,
        Configuring::Done => Turn::Enter(next),
        Configuring::Failed(failure) => Turn::Fail(BootError::Step { phase, failure }),
    }
}

fn boot_ups(network: &Network, handle: NodeHandle) -> u32 {
    network.status(handle).map_or(0, |status| status.boot_ups)
}

fn identity_steps(config: &BootConfig) -> Vec<Step> {
    let mut steps = config.identity.steps();
    if let Some(software) = config.software {
        let expected = Expectation::Equals(software.into());
        let step = Step::expect_that(object::PROGRAM_IDENTIFICATION, 1, expected);
        steps.push(step.named("software identification"));
    }
    steps
}

fn restore_steps(config: &BootConfig) -> Vec<Step> {
    let Some(subindex) = config.restores else { return Vec::new() };
    let timeout = config.boot_timeout;
    vec![
        Step::write(object::RESTORE_PARAMETERS, subindex, LOAD).named("default parameters"),
        Step::device(NodeAction::Nmt(NmtCommand::ResetNode)),
        Step::device(NodeAction::AwaitBootUp { timeout }),
    ]
}

fn start_steps(config: &BootConfig) -> Vec<Step> {
    let mut steps = Vec::new();
    let life_time = match config.guarding {
        Some(guarding) => {
            steps.extend(guarding.steps());
            steps.push(Step::device(NodeAction::AwaitGuarding(guarding)));
            Some(guarding.life_time())
        }
        None if config.heartbeat_ms > 0 => {
            let timeout = Duration::from_millis(u64::from(config.heartbeat_ms) * 7 / 2);
            let write = Step::write(object::PRODUCER_HEARTBEAT, 0, config.heartbeat_ms);
            steps.push(write.named("heartbeat"));
            steps.push(Step::device(NodeAction::AwaitHeartbeat { timeout }));
            Some(timeout)
        }
        None => None,
    };
    if config.starts {
        steps.push(Step::device(NodeAction::Nmt(NmtCommand::Start)));
        if let Some(life_time) = life_time {
            let (state, timeout) = (NmtState::Operational, life_time.max(REPORT_TIMEOUT));
            steps.push(Step::device(NodeAction::AwaitState { state, timeout }));
        }
    }
    steps
}
