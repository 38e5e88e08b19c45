use std::path::Path;
use std::time::{Duration, Instant};

use ecan_host::Identity;

use super::gateways::{Gateways, POLL_INTERVAL};
use super::package::FirmwareFile;
use super::rejection::Rejection;
use crate::context::{Failure, Result};
use crate::ethercat_tool::{EthercatTool, SlaveEntry, ToolError, is_denial};

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
    pub fn open(named: Option<&Path>, master: u32) -> Result<Self> {
        let tool = EthercatTool::find(named, master).map_err(failure)?;
        Ok(Self { tool, opened: Instant::now() })
    }

    /// Variant for writing: Ctrl-C does not terminate the tool during a transfer.
    pub fn shielded(self) -> Self {
        Self { tool: self.tool.shielded(), ..self }
    }
}

fn failure(error: ToolError) -> Failure {
    if error.is_about_host() {
        Failure::Master(error.text())
    } else {
        Failure::Rejected(error.text())
    }
}

impl Gateways for ByTool {
    fn present(&self) -> Result<Vec<SlaveEntry>> {
        self.tool.slaves().map_err(failure)
    }

    fn identity(&self, slave: usize) -> Result<Identity> {
        let (vendor_id, product_code) = self.tool.identity(slave).map_err(failure)?;
        Ok(Identity { vendor_id, product_code })
    }

    fn number(&self, slave: usize, index: u16, subindex: u8) -> Result<u32> {
        self.tool.upload_number(slave, index, subindex).map_err(failure)
    }

    fn is_denial(&self, failure: &Failure) -> bool {
        matches!(failure, Failure::Rejected(message) if is_denial(message))
    }

    fn software_version(&self, slave: usize) -> Result<String> {
        self.tool.upload_text(slave, 0x100A).map_err(failure)
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
        std::thread::sleep(POLL_INTERVAL);
    }

    fn now(&self) -> Duration {
        self.opened.elapsed()
    }
}
