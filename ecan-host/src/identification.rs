//! Finding the configured slaves on the bus and making sure that they are ECAN-Lite gateways.

use ecan_protocol::{AlState, Capabilities, Recognition};

use crate::config::{AdapterConfig, Identity, SlaveSettings};
use crate::diagnostics::Diagnostics;
use crate::error::Error;

/// How often the master is asked again while slaves are scanned, in nanoseconds.
const POLL_NS: u64 = 50_000_000;

/// Waits until the bus is scanned and every configured slave is in PREOP; gives ring positions.
pub(crate) fn wait_for_slaves(
    diagnostics: &Diagnostics,
    clock: &dyn ecrt_sys::Clock,
    config: &AdapterConfig,
) -> Result<Vec<u16>, Error> {
    let deadline = clock.now_ns() + u64::from(config.preop_timeout_ms) * 1_000_000;
    loop {
        let found = look_for_slaves(diagnostics, config);
        if found.is_ok() || clock.now_ns() >= deadline {
            return found;
        }
        clock.sleep_until_ns(clock.now_ns() + POLL_NS);
    }
}

fn look_for_slaves(diagnostics: &Diagnostics, config: &AdapterConfig) -> Result<Vec<u16>, Error> {
    let master = diagnostics.master();
    let info = master.info().map_err(|e| Error::library("ecrt_master", None, e))?;
    let count = if info.scan_busy { 0 } else { info.slave_count };
    let mut positions = Vec::with_capacity(config.slaves.len());
    for (slave, settings) in config.slaves.iter().enumerate() {
        let position = ring_position(diagnostics, settings, count).ok_or(Error::NoSuchSlave {
            slave,
            alias: settings.alias,
            position: settings.position,
            responding: info.slave_count,
        })?;
        let found = master
            .slave_info(position)
            .map_err(|e| Error::library("ecrt_master_get_slave", Some(slave), e))?;
        if AlState::from_status(found.al_state.into()) != Some(AlState::PreOp) {
            return Err(Error::NotInPreop {
                slave,
                al_state: found.al_state,
                error_flag: found.error_flag,
                timeout_ms: config.preop_timeout_ms,
            });
        }
        positions.push(position);
    }
    Ok(positions)
}

/// Alias 0 counts from the start of the bus, another one from the slave that has it.
fn ring_position(diagnostics: &Diagnostics, settings: &SlaveSettings, count: u32) -> Option<u16> {
    let count = u16::try_from(count).ok()?;
    let base = if settings.alias == 0 {
        0
    } else {
        (0..count).find(|p| {
            diagnostics.master().slave_info(*p).is_ok_and(|info| info.alias == settings.alias)
        })?
    };
    base.checked_add(settings.position).filter(|p| *p < count)
}

/// The identity to configure the slave with, after the check that it is what was asked for.
pub(crate) fn identify(
    diagnostics: &Diagnostics,
    slave: usize,
    settings: &SlaveSettings,
) -> Result<Identity, Error> {
    let info = diagnostics.slave_info(slave)?;
    let found = Identity { vendor_id: info.vendor_id, product_code: info.product_code };
    if let Some(wanted) = settings.identity.filter(|wanted| *wanted != found) {
        return Err(Error::WrongIdentity { slave, wanted, found });
    }
    let read = |subindex| diagnostics.sdo_upload_u32(slave, Capabilities::INDEX, subindex);
    match Recognition::read(read) {
        Ok(told) if told.looks_like_ecan_lite() => Ok(found),
        Ok(told) => Err(Error::NotAnEcanLite { slave, found: told }),
        Err(cause) => Err(Error::Unrecognised { slave, cause: Box::new(cause) }),
    }
}
