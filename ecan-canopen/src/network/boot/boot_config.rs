//! Boot-up of one node: plain data.

use std::sync::Arc;
use std::time::Duration;

use super::identity::IdentityCheck;
use super::parameter::ParameterSet;
use crate::network::guarding_config::GuardingConfig;
use crate::network::node_action::Step;

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
