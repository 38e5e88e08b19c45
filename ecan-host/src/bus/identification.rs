//! Search of the configured slaves on the bus, and verification that they are ECAN-Lite gateways.

use ecan_protocol::device::{AlState, Recognition};

use super::capability_values::CapabilityValues;
use super::diagnostics::Diagnostics;
use crate::config::{AdapterConfig, Identity, SlaveConfig};
use crate::error::Error;

/// Verifies that every configured slave is on the bus, at a position of its own, in PREOP.
pub(crate) fn look_for_slaves(
    diagnostics: &Diagnostics,
    config: &AdapterConfig,
) -> Result<(), Error> {
    let mut positions = Vec::with_capacity(config.slaves.len());
    for slave in 0..config.slaves.len() {
        let position = diagnostics.ring_position(slave)?;
        if let Some(other) = positions.iter().position(|p| *p == position) {
            return Err(Error::SameSlave { first: other, second: slave, position });
        }
        positions.push(position);
        let found = diagnostics.slave_info(slave)?;
        if AlState::from_status(found.al_state.into()) != Some(AlState::PreOp) {
            return Err(Error::NotInPreop {
                slave,
                al_state: found.al_state,
                error_flag: found.error_flag,
                timeout: config.preop_timeout,
            });
        }
    }
    Ok(())
}

/// Values that are read of a gateway before it is configured.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Identified {
    pub(crate) identity: Identity,
    pub(crate) capabilities: CapabilityValues,
}

/// Verifies that a slave is an ECAN-Lite of the configured identity, and reads its 0xF000.
pub(crate) fn identify(
    diagnostics: &Diagnostics,
    slave: usize,
    settings: &SlaveConfig,
) -> Result<Identified, Error> {
    let info = diagnostics.slave_info(slave)?;
    let found = Identity { vendor_id: info.vendor_id, product_code: info.product_code };
    if let Some(expected) = settings.identity.filter(|expected| *expected != found) {
        return Err(Error::IdentityMismatch { slave, expected, found });
    }
    let mut capabilities = CapabilityValues::default();
    match Recognition::read(|subindex| capabilities.read(diagnostics, slave, subindex)) {
        Ok(found) if found.looks_like_ecan_lite() => {}
        Ok(found) => return Err(Error::NotAnEcanLite { slave, found }),
        Err(cause) => return Err(Error::Unrecognised { slave, cause: Box::new(cause) }),
    }
    capabilities.read_all(diagnostics, slave)?;
    for half in CapabilityValues::SERIAL {
        capabilities.read(diagnostics, slave, half)?;
    }
    Ok(Identified { identity: found, capabilities })
}
