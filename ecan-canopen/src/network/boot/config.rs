//! Boot-up of one node: plain data.

use std::sync::Arc;
use std::time::Duration;

use ecan_protocol::sequence::{Action, Expectation, StepError};
use thiserror::Error;

use super::parameters::{ParameterError, ParameterSet};
use crate::network::config::{GuardingConfig, NodeAction, Step};
use crate::network::error::StepFailure;
use crate::{NmtCommand, NmtState, object};

/// Reset of a node at the start of its boot-up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BootReset {
    /// None; the node is commanded to Pre-operational.
    None,
    /// Reset Communication: parameters of 0x1000.. as at power-on.
    #[default]
    Communication,
    /// Reset Node.
    Node,
}

/// Boot-up of one node (CiA 302-2). A clone of the name does not allocate.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BootConfig {
    /// Name for messages; may be empty.
    pub name: Arc<str>,
    /// The network is booted only with this node.
    pub is_mandatory: bool,
    /// Nodes with a lower number boot before; those with the same number boot in parallel.
    pub order: u8,
    /// Reset at the start.
    pub reset: BootReset,
    /// Longest time for the first response of the node, boot-up message included.
    pub boot_timeout: Duration,
    /// Identity that it must have.
    pub identity: IdentityCheck,
    /// Software identification 0x1F56:01 that it must have; `None` accepts every value.
    pub software: Option<u32>,
    /// Restores the default parameters (0x1011 with this subindex) and resets the node before the
    /// parameters are written.
    pub restores: Option<u8>,
    /// Parameters that it gets.
    pub parameters: Arc<ParameterSet>,
    /// Steps after the parameters, for example those of a [`PdoMapping`](crate::PdoMapping).
    pub steps: Vec<Step>,
    /// Producer heartbeat time 0x1017 in milliseconds; 0 leaves it as the parameters have it. The
    /// host watches it with three and a half times this value.
    pub heartbeat_ms: u16,
    /// Node guarding in place of the heartbeat.
    pub guarding: Option<GuardingConfig>,
    /// Commands the node to Operational at the end.
    pub starts: bool,
    /// Boots the node again after its boot-up message, if it restarted.
    pub reboots: bool,
}

impl Default for BootConfig {
    /// A mandatory node that is reset, gets 5 s and no parameters, and is started; a heartbeat of
    /// 100 ms.
    fn default() -> Self {
        Self {
            name: Arc::from(""),
            is_mandatory: true,
            order: 0,
            reset: BootReset::default(),
            boot_timeout: Duration::from_secs(5),
            identity: IdentityCheck::default(),
            software: None,
            restores: None,
            parameters: Arc::default(),
            steps: Vec::new(),
            heartbeat_ms: 100,
            guarding: None,
            starts: true,
            reboots: true,
        }
    }
}

/// Shortest time to wait for an NMT state.
const REPORT_TIMEOUT: Duration = Duration::from_millis(500);
const LOAD: u32 = u32::from_le_bytes(*b"load");

impl BootConfig {
    /// Every step of the boot-up that accesses an object, without the values of its parameters.
    pub(in crate::network) fn all_steps(&self) -> impl Iterator<Item = Step> {
        let before = self.identity_steps().into_iter().chain(self.restore_steps());
        let parameters = self.parameters.closing_steps();
        before.chain(parameters).chain(self.steps.clone()).chain(self.start_steps())
    }

    pub(super) fn identity_steps(&self) -> Vec<Step> {
        let mut steps = self.identity.steps();
        if let Some(software) = self.software {
            let expected = Expectation::Equals(software.into());
            let step = Step::expect_that(object::PROGRAM_IDENTIFICATION, 1, expected);
            steps.push(step.named("software identification"));
        }
        steps
    }

    pub(super) fn restore_steps(&self) -> Vec<Step> {
        let Some(subindex) = self.restores else { return Vec::new() };
        let timeout = self.boot_timeout;
        vec![
            Step::write(object::RESTORE_PARAMETERS, subindex, LOAD).named("default parameters"),
            Step::device(NodeAction::Nmt(NmtCommand::ResetNode)),
            Step::device(NodeAction::AwaitBootUp { timeout }),
        ]
    }

    pub(super) fn start_steps(&self) -> Vec<Step> {
        let mut steps = Vec::new();
        let life_time = match self.guarding {
            Some(guarding) => {
                steps.extend(guarding.steps());
                steps.push(Step::device(NodeAction::AwaitGuarding(guarding)));
                Some(guarding.life_time())
            }
            None if self.heartbeat_ms > 0 => {
                let timeout = Duration::from_millis(u64::from(self.heartbeat_ms) * 7 / 2);
                let write = Step::write(object::PRODUCER_HEARTBEAT, 0, self.heartbeat_ms);
                steps.push(write.named("heartbeat"));
                steps.push(Step::device(NodeAction::AwaitHeartbeat { timeout }));
                Some(timeout)
            }
            None => None,
        };
        if self.starts {
            steps.push(Step::device(NodeAction::Nmt(NmtCommand::Start)));
            if let Some(life_time) = life_time {
                let (state, timeout) = (NmtState::Operational, life_time.max(REPORT_TIMEOUT));
                steps.push(Step::device(NodeAction::AwaitState { state, timeout }));
            }
        }
        steps
    }
}

/// Failure of the boot-up of a node.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum BootError {
    /// The node sent neither a boot-up message nor a response to an SDO request.
    #[error("no response after {} ms", waited.as_millis())]
    NoResponse {
        /// Waiting time.
        waited: Duration,
    },
    /// A step failed: identity, software, default parameters, PDO mapping, heartbeat or NMT state.
    #[error("{}: {}", failure.step, failure.fault)]
    Step {
        /// Phase of the boot-up.
        phase: BootPhase,
        /// The step and its failure.
        failure: StepFailure,
    },
    /// The parameters could not be written.
    #[error("parameters: {0}")]
    Parameters(ParameterError),
    /// The node restarted again and again.
    #[error("the node restarted {restarts} times during its boot-up")]
    Restarts {
        /// Number of restarts.
        restarts: u8,
    },
}

impl BootError {
    /// Error status of CiA 302-2, a letter from A to O.
    pub fn cia302_status(&self) -> char {
        match self {
            Self::NoResponse { .. } | Self::Restarts { .. } => 'B',
            Self::Parameters(_) => 'J',
            Self::Step { phase: BootPhase::Identity, failure } => identity_status(failure),
            Self::Step { phase: BootPhase::Start, .. } => 'K',
            Self::Step { .. } => 'J',
        }
    }

    /// Returns whether the boot-up may succeed later without a change by the application.
    pub fn is_temporary(&self) -> bool {
        match self {
            Self::NoResponse { .. } | Self::Restarts { .. } => true,
            Self::Step { failure, .. } => failure.is_temporary(),
            Self::Parameters(ParameterError::Transfer { fault, .. }) => fault.is_temporary(),
            Self::Parameters(_) => false,
        }
    }
}

fn identity_status(failure: &StepFailure) -> char {
    let key = match failure.step.action {
        Action::Expect { index, subindex, .. } => (index, subindex),
        _ => return 'B',
    };
    let is_mismatch = matches!(failure.fault, StepError::Mismatch { .. });
    match key {
        (object::DEVICE_TYPE, _) if is_mismatch => 'C',
        (object::IDENTITY, 1) => 'D',
        (object::IDENTITY, 2) => 'M',
        (object::IDENTITY, 3) => 'N',
        (object::IDENTITY, 4) => 'O',
        (object::PROGRAM_IDENTIFICATION, _) => 'H',
        _ => 'B',
    }
}

ecan_protocol::text_enum! {
    /// Phase of the boot-up of a node.
    #[derive(Default)]
    pub enum BootPhase;
    /// Nodes that boot before are not booted yet.
    #[default]
    Waiting = "waiting for nodes that boot before";
    /// The node has not responded yet.
    Contact = "waiting for a response";
    /// Device type, identity and software are compared.
    Identity = "checking the identity";
    /// The default parameters are restored.
    Restore = "restoring the default parameters";
    /// Parameters are written and read back.
    Parameters = "writing parameters";
    /// The steps after the parameters, for example the PDO mapping.
    Steps = "mapping PDOs";
    /// The heartbeat is configured, and the node started.
    Start = "starting";
    /// The node has its parameters and runs as configured.
    Booted = "booted";
    /// The boot-up failed.
    Failed = "failed";
}

/// Accepted revision numbers of 0x1018:03: major revision in the upper half, minor in the lower.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RevisionCheck {
    /// Every one.
    #[default]
    Any,
    /// Exactly this one.
    Exactly(u32),
    /// The same major revision, and at least the minor one: a compatible node (CiA 301, 7.5.2.18).
    Compatible(u32),
}

/// Identity that a node must have; `None` accepts every value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct IdentityCheck {
    /// Device type 0x1000.
    pub device_type: Option<u32>,
    /// Vendor-ID 0x1018:01.
    pub vendor_id: Option<u32>,
    /// Product code 0x1018:02.
    pub product_code: Option<u32>,
    /// Revision number 0x1018:03.
    pub revision: RevisionCheck,
    /// Serial number 0x1018:04.
    pub serial_number: Option<u32>,
}

impl IdentityCheck {
    /// The steps that read and compare it, in the order of CiA 302-2.
    pub fn steps(&self) -> Vec<Step> {
        let mut steps = Vec::new();
        let mut expect = |index, subindex, name, expected| {
            steps.push(Step::expect_that(index, subindex, expected).named(name));
        };
        let equals = |value: u32| Expectation::Equals(value.into());
        if let Some(value) = self.device_type {
            expect(object::DEVICE_TYPE, 0, "device type", equals(value));
        }
        if let Some(value) = self.vendor_id {
            expect(object::IDENTITY, 1, "vendor-ID", equals(value));
        }
        if let Some(value) = self.product_code {
            expect(object::IDENTITY, 2, "product code", equals(value));
        }
        match self.revision {
            RevisionCheck::Any => {}
            RevisionCheck::Exactly(value) => {
                expect(object::IDENTITY, 3, "revision number", equals(value));
            }
            RevisionCheck::Compatible(least) => {
                let major =
                    Expectation::Masked { value: (least & 0xFFFF_0000).into(), mask: 0xFFFF_0000 };
                expect(object::IDENTITY, 3, "major revision", major);
                let least = Expectation::AtLeast(least.into());
                expect(object::IDENTITY, 3, "revision number", least);
            }
        }
        if let Some(value) = self.serial_number {
            expect(object::IDENTITY, 4, "serial number", equals(value));
        }
        steps
    }
}

#[cfg(test)]
mod tests {
    use ecan_protocol::sequence::Action;

    use super::*;

    fn accepts(check: IdentityCheck, revision: u32) -> bool {
        check.steps().iter().all(|step| match step.action {
            Action::Expect { expected, .. } => expected.is_met_by(revision.into()),
            _ => false,
        })
    }

    #[test]
    fn compatible_revision_has_the_same_major_and_no_smaller_minor() {
        let revision = RevisionCheck::Compatible(0x0002_0003);
        let check = IdentityCheck { revision, ..IdentityCheck::default() };
        let revisions = [0x0002_0002, 0x0002_0003, 0x0002_FFFF, 0x0003_0003, 0x0001_0009];
        assert_eq!(
            revisions.map(|revision| accepts(check, revision)),
            [false, true, true, false, false]
        );
        let check = IdentityCheck { revision: RevisionCheck::Exactly(7), ..check };
        assert_eq!([6, 7, 8].map(|revision| accepts(check, revision)), [false, true, false]);
    }

    #[test]
    fn steps_have_the_order_of_the_standard() {
        let check = IdentityCheck {
            device_type: Some(1),
            vendor_id: Some(2),
            product_code: Some(3),
            revision: RevisionCheck::Exactly(4),
            serial_number: Some(5),
        };
        let texts: Vec<_> = check.steps().iter().map(ToString::to_string).collect();
        let names =
            ["device type", "vendor-ID", "product code", "revision number", "serial number"];
        assert_eq!(texts.len(), names.len());
        for (text, name) in texts.iter().zip(names) {
            assert!(text.starts_with(name), "{text}");
        }
        assert!(IdentityCheck::default().steps().is_empty());
    }
}
