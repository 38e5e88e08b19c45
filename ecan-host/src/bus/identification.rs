//! Search of the configured slaves on the bus, and verification that they are ECAN-Lite gateways.

use ecan_protocol::device::{AlState, Capabilities, Recognition};

use super::diagnostics::Diagnostics;
use crate::config::{AdapterConfig, Identity, SlaveConfig};
use crate::deadline::deadline_ns;
use crate::error::Error;

const POLL_NS: u64 = 50_000_000;

pub(crate) fn wait_for_slaves(
    diagnostics: &Diagnostics,
    clock: &dyn ecrt_sys::Clock,
    config: &AdapterConfig,
) -> Result<(), Error> {
    let deadline = deadline_ns(clock, config.preop_timeout);
    loop {
        let found = look_for_slaves(diagnostics, config);
        if found.is_ok() || clock.now_ns() >= deadline {
            return found;
        }
        clock.sleep_until_ns(clock.now_ns() + POLL_NS);
    }
}

fn look_for_slaves(diagnostics: &Diagnostics, config: &AdapterConfig) -> Result<(), Error> {
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

/// Identity of a gateway for the master, and its serial number.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Identified {
    pub(crate) identity: Identity,
    /// 0xF000:07 and :08.
    pub(crate) serial: [u32; 2],
}

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
    let read = |subindex| diagnostics.sdo_upload_u32(slave, Capabilities::INDEX, subindex);
    match Recognition::read(read) {
        Ok(found) if found.looks_like_ecan_lite() => {}
        Ok(found) => return Err(Error::NotAnEcanLite { slave, found }),
        Err(cause) => return Err(Error::Unrecognised { slave, cause: Box::new(cause) }),
    }
    Ok(Identified { identity: found, serial: [read(7)?, read(8)?] })
}
