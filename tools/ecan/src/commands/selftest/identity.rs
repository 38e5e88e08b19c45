//! Identity of a gateway: recognition, identity, versions, serial number.

use ecan_protocol::device::Recognition;

use crate::commands::saved_config::wait_present;
use crate::context::{Bus, Result};
use crate::firmware_version::FirmwareVersion;

use super::report::Report;

/// Checks a slave; returns whether further tests make sense.
pub(super) fn check(
    bus: &Bus,
    slave: usize,
    expected_version: Option<&str>,
    report: &mut Report,
) -> bool {
    let info = wait_present(bus, slave).and_then(|()| Ok(bus.diagnostics().slave_info(slave)?));
    let info = match info {
        Ok(info) => info,
        Err(error) => {
            report.add("recognition", Err(error.to_string()));
            return false;
        }
    };
    (report.vendor_id, report.product_code) = (info.vendor_id, info.product_code);
    report.revision = info.revision_number;
    let recognised = recognise(bus, slave);
    let is_gateway = recognised.is_ok();
    report.add("recognition", recognised);
    if !is_gateway {
        return false;
    }
    let of_sii = [info.vendor_id, info.product_code, info.revision_number];
    report.add("identity", identity(bus, slave, of_sii));
    let running = bus.firmware_version(slave);
    report.firmware = running.as_ref().ok().and_then(|running| running.firmware.clone());
    report.add("firmware", version(running, expected_version));
    report.hardware = bus.text(slave, 0x1009).ok();
    let serial = bus.serial(slave);
    report.serial = serial.as_ref().ok().copied();
    let serial = match serial {
        Ok(0 | u64::MAX) => {
            Err("not programmed; two such gateways cannot be distinguished (assumption H19)"
                .to_owned())
        }
        Ok(serial) => Ok(serial.to_string()),
        Err(error) => Err(error.to_string()),
    };
    report.add("serial number", serial);
    true
}

fn recognise(bus: &Bus, slave: usize) -> Result<String, String> {
    let upload = |subindex| {
        let value = bus.diagnostics().sdo_upload_u32(slave, 0xF000, subindex);
        ecan_host::Error::or_assumed(value, 0xF000, subindex)
    };
    let it = Recognition::read(upload).map_err(|error| error.to_string())?;
    match it.looks_like_ecan_lite() {
        true => Ok("ECAN-Lite (0xF000)".to_owned()),
        false => Err("not an ECAN-Lite (0xF000)".to_owned()),
    }
}

/// The identity in the SII, which the master uses, must match that of the firmware.
fn identity(bus: &Bus, slave: usize, of_sii: [u32; 3]) -> Result<String, String> {
    let names = ["vendor", "product", "revision"];
    for ((subindex, name), sii) in (1..).zip(names).zip(of_sii) {
        let own = bus.read(slave, 0x1018, subindex).map_err(|error| error.to_string())?;
        if own != sii {
            return Err(format!("{name} is 0x{sii:08X} in the SII and 0x{own:08X} in 0x1018"));
        }
    }
    let [vendor, product, revision] = of_sii;
    Ok(format!("vendor 0x{vendor:08X}, product 0x{product:08X}, revision 0x{revision:08X}"))
}

fn version(running: Result<FirmwareVersion>, expected: Option<&str>) -> Result<String, String> {
    let running = running.map_err(|error| error.to_string())?;
    match expected {
        Some(expected) if !running.is_version(expected) => {
            Err(format!("{running}, expected {expected}"))
        }
        _ => Ok(running.to_string()),
    }
}
