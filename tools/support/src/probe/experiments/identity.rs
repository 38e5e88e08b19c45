//! Identity of the gateway.

use ecan_protocol::device::Capabilities;

use crate::probe::experiment::Experiment;
use crate::probe::interruption::Result;
use crate::probe::outcome::Outcome;
use crate::probe::run::Probe;
use crate::probe::stage::Stage;

pub(super) const EXPERIMENTS: &[Experiment] = &[
    Experiment {
        rows: &["H1", "S1"],
        key: "vendor_id",
        stage: Stage::Reading,
        assumption: "vendor ID 0x00004543 (invented: the manual gives none)",
        run: vendor,
    },
    Experiment {
        rows: &["H1", "S1"],
        key: "product_code",
        stage: Stage::Reading,
        assumption: "product code 0x4C495445 (invented: the manual gives none)",
        run: product,
    },
    Experiment {
        rows: &["H19"],
        key: "serial",
        stage: Stage::Reading,
        assumption: "the serial number identifies the gateway",
        run: serial,
    },
];

const VENDOR_ID: u32 = 0x4543;
const PRODUCT_CODE: u32 = 0x4C49_5445;

fn vendor(probe: &mut Probe) -> Result<Outcome> {
    let sii = probe.diagnostics.slave_info(probe.slave)?.vendor_id;
    compare(probe, sii, 1, VENDOR_ID)
}

fn product(probe: &mut Probe) -> Result<Outcome> {
    let sii = probe.diagnostics.slave_info(probe.slave)?.product_code;
    compare(probe, sii, 2, PRODUCT_CODE)
}

fn compare(probe: &Probe, sii: u32, subindex: u8, assumed: u32) -> Result<Outcome> {
    let object = probe.sdo().read(0x1018, subindex)?;
    if object != sii {
        let detail = format!("0x1018:{subindex:02} is 0x{object:08X}, the SII has 0x{sii:08X}");
        return Ok(Outcome::differs(detail));
    }
    let detail = format!("SII and 0x1018:{subindex:02} are 0x{sii:08X}");
    Ok(Outcome::decided(sii == assumed, detail).like(sii))
}

fn serial(probe: &mut Probe) -> Result<Outcome> {
    let [low, high] =
        [probe.sdo().read(Capabilities::INDEX, 7)?, probe.sdo().read(Capabilities::INDEX, 8)?];
    let serial = u64::from(high) << 32 | u64::from(low);
    if matches!(serial, 0 | u64::MAX) {
        let detail = format!("0xF000:07 and :08 are {serial}: gateways cannot be distinguished");
        return Ok(Outcome::differs(detail).like(serial));
    }
    probe.profile.serial = Some(serial);
    let version = |subindex| probe.sdo().read(Capabilities::INDEX, subindex);
    if let (Ok(major), Ok(minor)) = (version(5), version(6)) {
        probe.profile.firmware = Some((major, minor));
    }
    Ok(Outcome::holds(format!("0xF000:07 and :08 are {serial}")))
}
