//! Boot-up of nodes
//!
//! The nodes of a file that have no axis boot as CiA 302-2 specifies: reset, response, identity, default
//! parameters, parameters with readback, PDOs, heartbeat, start. All nodes of all channels boot in parallel,
//! from the first cycle on; the cycle executes the boot-ups. A node that fails does not stop the others.
//! A node that restarts, or is replaced, boots again automatically.

use ecan_c_boundary::mirror;
use ecan_canopen::{BootPhase, BootProgress, BootState};

mirror! {
    /// State of the boot-up of all nodes.
    pub enum igh_canopen_boot_state_t from BootState {
        /// A mandatory node is not booted yet.
        IGH_CANOPEN_BOOT_RUNNING = 0 => BootState::Running,
        /// All mandatory nodes are booted, also without any. Optional nodes may still boot, or have
        /// failed.
        IGH_CANOPEN_BOOT_DONE = 1 => BootState::Booted,
        /// A mandatory node failed.
        IGH_CANOPEN_BOOT_FAILED = 2 => BootState::Failed,
    }
}

mirror! {
    /// Phase of the boot-up of a node.
    pub enum igh_canopen_boot_phase_t from Option<BootPhase> {
        /// It does not boot: its axis configures it, or it was added without a boot-up.
        IGH_CANOPEN_BOOT_PHASE_NONE = 0 => None,
        /// Nodes that boot before are not booted yet.
        IGH_CANOPEN_BOOT_PHASE_WAITING = 1 => Some(BootPhase::Waiting),
        /// It has not responded yet.
        IGH_CANOPEN_BOOT_PHASE_CONTACT = 2 => Some(BootPhase::Contact),
        /// Device type, identity and software are compared.
        IGH_CANOPEN_BOOT_PHASE_IDENTITY = 3 => Some(BootPhase::Identity),
        /// The default parameters are restored.
        IGH_CANOPEN_BOOT_PHASE_RESTORE = 4 => Some(BootPhase::Restore),
        /// Parameters are written and read back.
        IGH_CANOPEN_BOOT_PHASE_PARAMETERS = 5 => Some(BootPhase::Parameters),
        /// PDOs are mapped.
        IGH_CANOPEN_BOOT_PHASE_PDOS = 6 => Some(BootPhase::Steps),
        /// The heartbeat is configured, and the node started.
        IGH_CANOPEN_BOOT_PHASE_START = 7 => Some(BootPhase::Start),
        /// It has its parameters and runs as configured.
        IGH_CANOPEN_BOOT_PHASE_BOOTED = 8 => Some(BootPhase::Booted),
        /// Its boot-up failed; see `status` and igh_canopen_get_boot_text().
        IGH_CANOPEN_BOOT_PHASE_FAILED = 9 => Some(BootPhase::Failed),
    }
}

mirror! {
    /// Progress of the boot-up of a node.
    pub struct igh_canopen_boot_progress_t from rust: BootProgress {
        /// Time since the boot-up began, or its duration if it has ended, in milliseconds.
        elapsed_ms: u64 = u64::try_from(rust.elapsed.as_millis()).unwrap_or(u64::MAX),
        /// Written parameters.
        done: u32 = count(rust.done),
        /// Parameters to write.
        of: u32 = count(rust.of),
        /// Boot-ups after a restart of the node.
        restarts: u32,
        /// Object whose transfer is in progress; 0 for none.
        index: u16 = rust.subject.as_ref().map_or(0, |subject| subject.index),
        /// Its subindex.
        subindex: u8 = rust.subject.as_ref().map_or(0, |subject| subject.subindex),
        /// An igh_canopen_boot_phase_t.
        phase: u8 = igh_canopen_boot_phase_t::from(Some(rust.phase)) as u8,
        /// Error status of CiA 302-2, a letter from 'A' to 'O'; 0 while there is none. 'B': no
        /// response; 'C', 'D', 'M', 'N', 'O': device type, vendor-ID, product code, revision number,
        /// serial number; 'H': software; 'J': parameters or PDOs; 'K': start.
        status: u8 = rust.error.as_ref().map_or(0, |error| error.cia302_status() as u8),
        /// 1 if the network is booted only with this node.
        is_mandatory: u8,
        /// 1 if the node had its parameters already, by its configuration date 0x1020.
        is_unchanged: u8,
        /// Zero; for fields of later versions.
        reserved: [u8; 37] = [0; 37],
    }
}

fn count(number: usize) -> u32 {
    u32::try_from(number).unwrap_or(u32::MAX)
}

impl igh_canopen_boot_progress_t {
    /// Of a node that does not boot.
    pub(super) fn none() -> Self {
        Self {
            elapsed_ms: 0,
            done: 0,
            of: 0,
            restarts: 0,
            index: 0,
            subindex: 0,
            phase: igh_canopen_boot_phase_t::IGH_CANOPEN_BOOT_PHASE_NONE as u8,
            status: 0,
            is_mandatory: 0,
            is_unchanged: 0,
            reserved: [0; 37],
        }
    }
}
