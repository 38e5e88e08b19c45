//! Boot-up of the nodes of a network (CiA 302-2).

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use super::config::{BootConfig, BootError, BootPhase, BootReset};
use super::parameters::{ParameterDownload, ParameterState, Subject};
use crate::network::config::{NodeAddress, NodeHandle, Step};
use crate::network::node_sequence::{Configuring, NodeSequence};
use crate::network::node_table::{Member, NodeTable};
use crate::network::sdo::{SdoClient, SdoTurn, TurnState};
use crate::{NmtCommand, object};

/// Restarts of a node in one boot-up before it fails.
const MAX_RESTARTS: u8 = 3;

/// State of the boot-up of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BootState {
    /// A mandatory node is not booted yet.
    Running,
    /// All mandatory nodes are booted. Optional nodes may still boot, or have failed.
    Booted,
    /// A mandatory node failed.
    Failed,
}

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

/// The boot-ups of the nodes of a network.
#[derive(Debug, Default)]
pub(in crate::network) struct NetworkBoot {
    nodes: Vec<NodeBoot>,
}

impl NetworkBoot {
    /// Adds a node, or replaces the configuration of one.
    pub(in crate::network) fn add(
        &mut self,
        nodes: &mut NodeTable,
        handle: NodeHandle,
        config: BootConfig,
    ) {
        let Some(node) = nodes.node_mut(handle) else { return };
        for boot in self.nodes.iter().filter(|boot| boot.handle == handle) {
            boot.cancel(&mut node.sdo);
        }
        self.nodes.retain(|boot| boot.handle != handle);
        self.nodes.push(NodeBoot::new(handle, node.address, config));
    }

    /// Boots one node again, with its configured reset.
    pub(in crate::network) fn restart(
        &mut self,
        nodes: &mut NodeTable,
        handle: NodeHandle,
        now_ns: u64,
    ) {
        let Some(member) = nodes.member(handle) else { return };
        for boot in self.nodes.iter_mut().filter(|boot| boot.handle == handle) {
            boot.cancel(&mut member.node.sdo);
            boot.begin(&member, boot.config.reset, now_ns);
        }
    }

    /// Executes the boot-up of all nodes, once per cycle.
    pub(in crate::network) fn step(&mut self, nodes: &mut NodeTable, now_ns: u64) {
        for nth in 0..self.nodes.len() {
            let may_begin = self.may_begin(nth);
            let Some(boot) = self.nodes.get_mut(nth) else { continue };
            let Some(mut member) = nodes.member(boot.handle) else { continue };
            if may_begin {
                boot.begin(&member, boot.config.reset, now_ns);
            }
            boot.advance(&mut member, now_ns);
        }
    }

    /// State of the boot-up.
    pub(in crate::network) fn state(&self) -> BootState {
        let mut state = BootState::Booted;
        for node in self.nodes.iter().filter(|node| node.config.is_mandatory) {
            match node.phase {
                BootPhase::Booted => {}
                BootPhase::Failed => return BootState::Failed,
                _ => state = BootState::Running,
            }
        }
        state
    }

    /// Progress of each node, in the order in which they were added.
    pub(in crate::network) fn progress(
        &self,
        now_ns: u64,
    ) -> impl Iterator<Item = BootProgress> + '_ {
        self.nodes.iter().map(move |node| node.progress(now_ns))
    }

    /// Progress of one node.
    pub(in crate::network) fn progress_of(
        &self,
        handle: NodeHandle,
        now_ns: u64,
    ) -> Option<BootProgress> {
        self.nodes.iter().find(|node| node.handle == handle).map(|node| node.progress(now_ns))
    }

    /// Returns whether a node waits, and those that boot before have ended.
    fn may_begin(&self, nth: usize) -> bool {
        let Some(node) = self.nodes.get(nth).filter(|node| node.phase == BootPhase::Waiting) else {
            return false;
        };
        let before = self.nodes.iter().filter(|other| other.config.order < node.config.order);
        before.fold(true, |all, other| {
            let has_ended = match other.phase {
                BootPhase::Booted => true,
                BootPhase::Failed => !other.config.is_mandatory,
                _ => false,
            };
            all && has_ended
        })
    }
}

/// Boot-up of one node.
#[derive(Debug)]
struct NodeBoot {
    handle: NodeHandle,
    address: NodeAddress,
    config: BootConfig,
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
    fn new(handle: NodeHandle, address: NodeAddress, config: BootConfig) -> Self {
        Self {
            handle,
            address,
            phase: BootPhase::Waiting,
            identity: NodeSequence::new(config.identity_steps()),
            restore: NodeSequence::new(config.restore_steps()),
            further: NodeSequence::new(config.steps.clone()),
            start: NodeSequence::new(config.start_steps()),
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

    fn progress(&self, now_ns: u64) -> BootProgress {
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
    fn begin(&mut self, member: &Member<'_>, reset: BootReset, now_ns: u64) {
        let (command, awaits_boot_up) = match reset {
            BootReset::None => (NmtCommand::EnterPreOperational, false),
            BootReset::Communication => (NmtCommand::ResetCommunication, true),
            BootReset::Node => (NmtCommand::ResetNode, true),
        };
        self.contact = Contact { command: Some(command), awaits_boot_up, ..Contact::default() };
        self.begin_ns = now_ns;
        self.restarts_in_boot = 0;
        self.enter_contact(member);
    }

    fn enter_contact(&mut self, member: &Member<'_>) {
        self.boot_ups = member.node.nmt.boot_ups();
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
    fn advance(&mut self, member: &mut Member<'_>, now_ns: u64) {
        self.watch_restarts(member, now_ns);
        loop {
            let before = self.phase;
            let next = match before {
                BootPhase::Waiting | BootPhase::Booted | BootPhase::Failed => return,
                BootPhase::Contact => self.step_contact(member, now_ns),
                BootPhase::Identity => {
                    step(&mut self.identity, member, now_ns, (before, BootPhase::Restore))
                }
                BootPhase::Restore => {
                    let next =
                        step(&mut self.restore, member, now_ns, (before, BootPhase::Parameters));
                    // Its own reset is not a restart.
                    self.boot_ups = member.node.nmt.boot_ups();
                    next
                }
                BootPhase::Parameters => match self.parameters.advance(&mut member.node.sdo) {
                    ParameterState::Running => Turn::Wait,
                    ParameterState::Failed(error) => Turn::Fail(BootError::Parameters(error)),
                    ParameterState::Written => Turn::Enter(BootPhase::Steps),
                    ParameterState::Unchanged => {
                        self.is_unchanged = true;
                        Turn::Enter(BootPhase::Steps)
                    }
                },
                BootPhase::Steps => {
                    step(&mut self.further, member, now_ns, (before, BootPhase::Start))
                }
                BootPhase::Start => {
                    step(&mut self.start, member, now_ns, (before, BootPhase::Booted))
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
    fn watch_restarts(&mut self, member: &mut Member<'_>, now_ns: u64) {
        let seen = member.node.nmt.boot_ups();
        if seen == self.boot_ups || !self.config.reboots {
            return;
        }
        match self.phase {
            // Expected there.
            BootPhase::Waiting | BootPhase::Contact | BootPhase::Restore => return,
            BootPhase::Booted | BootPhase::Failed => {
                self.begin(member, BootReset::None, now_ns);
            }
            _ => {
                self.cancel(&mut member.node.sdo);
                self.restarts_in_boot = self.restarts_in_boot.saturating_add(1);
                if self.restarts_in_boot > MAX_RESTARTS {
                    self.boot_ups = seen;
                    let restarts = self.restarts_in_boot;
                    return self.fail(BootError::Restarts { restarts }, now_ns);
                }
                self.contact = Contact::default();
                self.enter_contact(member);
            }
        }
        self.restarts = self.restarts.saturating_add(1);
        tracing::warn!("{}: restarted, boots again", self.address);
    }

    /// Cancels the running transfer with the node.
    fn cancel(&self, client: &mut SdoClient) {
        match self.phase {
            BootPhase::Contact if self.contact.is_transferring => client.cancel(),
            BootPhase::Identity => self.identity.cancel_transfer(client),
            BootPhase::Restore => self.restore.cancel_transfer(client),
            BootPhase::Parameters => self.parameters.cancel(client),
            BootPhase::Steps => self.further.cancel_transfer(client),
            BootPhase::Start => self.start.cancel_transfer(client),
            _ => {}
        }
    }

    /// Sends the first command, then reads the device type until the node responds.
    fn step_contact(&mut self, member: &mut Member<'_>, now_ns: u64) -> Turn {
        let waited = Duration::from_nanos(now_ns.saturating_sub(self.begin_ns));
        if let Some(command) = self.contact.command {
            if !member.queue_nmt(command) {
                return Turn::Wait;
            }
            self.contact.command = None;
        }
        let has_booted = member.node.nmt.boot_ups() != self.boot_ups;
        // Old nodes send no boot-up message.
        let is_ready =
            !self.contact.awaits_boot_up || has_booted || waited > self.config.boot_timeout / 2;
        if is_ready && !self.contact.is_transferring {
            let started = self.contact.turn.upload(&mut member.node.sdo, (object::DEVICE_TYPE, 0));
            self.contact.is_transferring = started.unwrap_or(false);
        }
        if self.contact.is_transferring {
            match self.contact.turn.poll(&member.node.sdo) {
                TurnState::Busy => {}
                TurnState::Lost => self.contact.is_transferring = false,
                TurnState::Done | TurnState::Failed(crate::SdoFault::Aborted(_)) => {
                    self.contact.is_transferring = false;
                    self.boot_ups = member.node.nmt.boot_ups();
                    return Turn::Enter(BootPhase::Identity);
                }
                TurnState::Failed(_) => self.contact.is_transferring = false,
            }
        }
        if waited > self.config.boot_timeout {
            if self.contact.is_transferring {
                member.node.sdo.cancel();
            }
            return Turn::Fail(BootError::NoResponse { waited });
        }
        Turn::Wait
    }
}

fn step(
    sequence: &mut NodeSequence<Vec<Step>>,
    member: &mut Member<'_>,
    now_ns: u64,
    (phase, next): (BootPhase, BootPhase),
) -> Turn {
    match sequence.advance_member(member, now_ns, |_, _, _| {}) {
        Configuring::Running => Turn::Wait,
        Configuring::Done => Turn::Enter(next),
        Configuring::Failed(failure) => Turn::Fail(BootError::Step { phase, failure }),
    }
}
