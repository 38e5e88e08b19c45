//! Gateways accessed with IgH's tool `ethercat`.

use std::path::Path;
use std::time::{Duration, Instant};

use ecan_host::Identity;
use ecan_protocol::device::Capabilities;
use ecan_protocol::object::{ObjectType, lookup};

use super::gateways::{Gateways, LOOK_EVERY, SlaveEntry};
use super::package::FirmwareFile;
use super::rejection::Rejection;
use crate::ethercat_tool::{EthercatTool, NumberType, ToolError, is_denial};
use crate::failure::Failure;

/// Name of the firmware file on a gateway (manual 15.3.1).
const FILE_NAME: &str = "ecan_lite_app";

/// Uses the tool for every access, so that the checks before and after the update use the same
/// master.
#[derive(Debug)]
pub struct ByTool {
    tool: EthercatTool,
    opened: Instant,
}

impl ByTool {
    /// Uses the given tool, or the one that is found.
    pub fn open(named: Option<&Path>, master: u32) -> Result<Self, Failure> {
        let tool = EthercatTool::find(named, master).map_err(failure)?;
        Ok(Self { tool, opened: Instant::now() })
    }

    /// Variant for writing: Ctrl-C does not terminate the tool during a transfer.
    pub fn shielded(self) -> Self {
        Self { tool: self.tool.shielded(), ..self }
    }
}

fn failure(error: ToolError) -> Failure {
    let words = match error.remedy() {
        "" => error.to_string(),
        remedy => format!("{error}; {remedy}"),
    };
    if error.is_about_host() { Failure::Master(words) } else { Failure::Rejected(words) }
}

impl Gateways for ByTool {
    fn present(&self) -> Result<Vec<SlaveEntry>, Failure> {
        let listed = self.tool.slaves().map_err(failure)?;
        let present = listed.into_iter().map(|slave| SlaveEntry {
            position: slave.position,
            alias: slave.alias,
            al_state: slave.al_state(),
            state: slave.state,
        });
        Ok(present.collect())
    }

    fn identity(&self, slave: usize) -> Result<Identity, Failure> {
        let (vendor_id, product_code) = self.tool.identity(slave).map_err(failure)?;
        Ok(Identity { vendor_id, product_code })
    }

    fn number(&self, slave: usize, subindex: u8) -> Result<u32, Failure> {
        let object = (Capabilities::INDEX, subindex);
        let kind = match lookup(object.0, subindex).map(|(_, entry)| entry.ty) {
            Some(ObjectType::U8) => NumberType::Uint8,
            Some(ObjectType::U16) => NumberType::Uint16,
            _ => NumberType::Uint32,
        };
        self.tool.upload_number(slave, object, kind).map_err(failure)
    }

    fn is_denial(&self, failure: &Failure) -> bool {
        matches!(failure, Failure::Rejected(words) if is_denial(words))
    }

    fn software_version(&self, slave: usize) -> Result<String, Failure> {
        self.tool.upload_text(slave, (0x100A, 0)).map_err(failure)
    }

    fn foe_status(&self, slave: usize) -> Result<u32, Failure> {
        self.tool.upload_number(slave, (0xB000, 11), NumberType::Uint32).map_err(failure)
    }

    fn write(
        &self,
        slave: usize,
        file: &FirmwareFile,
        _progress: &dyn Fn(u64),
    ) -> Result<(), Rejection> {
        Ok(self.tool.foe_write(slave, FILE_NAME, &file.path)?)
    }

    fn pause(&self) {
        std::thread::sleep(LOOK_EVERY);
    }

    fn now(&self) -> Duration {
        self.opened.elapsed()
    }
}
