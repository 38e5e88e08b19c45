//! From a configuration to gateways in service, for as long as the user has the patience.

use std::error::Error;

use ecan_host::{Adapter, AdapterConfig, Ecrt};
use ecan_mcan_port::{Port, PortConfig, PortError};

use crate::interrupt::Interrupt;

/// Whether the startup SDOs are written before the gateways go into service.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Configure {
    /// Written, as always.
    Write,
    /// Left out: the gateways keep what they were told last.
    Keep,
}

/// Opens the gateways and waits until they are in service; `None` when the user gave up.
///
/// # Errors
/// What keeps a gateway out of service.
pub fn open(
    ecrt: &Ecrt,
    adapter: AdapterConfig,
    config: PortConfig,
    configure: Configure,
    interrupt: &Interrupt,
) -> Result<Option<Port>, Box<dyn Error>> {
    let mut port = match configure {
        Configure::Write => Port::open(ecrt, adapter, config)?,
        Configure::Keep => Port::new(Adapter::open(ecrt, adapter)?, config)?,
    };
    let ready = port.wait_ready_with(port.startup_timeout(), |port| {
        // Single cycles may fail; the timeout ends it all.
        port.begin_cycle().finish();
        if interrupt.is_set() { Err(Stop::Interrupted) } else { Ok(()) }
    });
    match ready {
        Ok(()) => Ok(Some(port)),
        Err(Stop::Interrupted) => Ok(None),
        Err(Stop::Failed(error)) => Err(error.into()),
    }
}

/// Why the way into service ended.
enum Stop {
    Interrupted,
    Failed(PortError),
}

impl From<PortError> for Stop {
    fn from(error: PortError) -> Self {
        Self::Failed(error)
    }
}
