//! Statuses and abort codes of rejected settings.

use ecan_host::Maintenance;
use ecan_protocol::config::{DataSize, McanChannelConfig, NodeMode};
use ecan_protocol::device::AccessMode;

use crate::experiment::Experiment;
use crate::interruption::{Interruption, Result, unavailable};
use crate::outcome::Outcome;
use crate::probe::Probe;
use crate::registers::{self, NBTP};
use crate::stage::Stage;

pub(super) const EXPERIMENTS: &[Experiment] = &[
    Experiment {
        rows: &["H13"],
        key: "",
        stage: Stage::PreOp,
        assumption: "the Message RAM of a channel has 8192 bytes",
        run: message_ram,
    },
    Experiment {
        rows: &["H11"],
        key: "",
        stage: Stage::PreOp,
        assumption: "TDC needs a data prescaler of 1 or 2",
        run: tdc_prescaler,
    },
    Experiment {
        rows: &["S20"],
        key: "",
        stage: Stage::PreOp,
        assumption: "an unknown budget policy gives status 10, a test policy without key aborts with 0x06040043",
        run: rejected_values,
    },
    Experiment {
        rows: &["S49"],
        key: "",
        stage: Stage::PreOp,
        assumption: "a write to a protected register without INIT and CCE returns OK and has no effect",
        run: protected_register,
    },
];

/// Applies a configuration to channel 0 in internal loopback; returns the apply status.
pub(super) fn apply(probe: &Probe, config: McanChannelConfig) -> Result<u32> {
    let Some(mode) = probe.profile.internal_loopback.and_then(NodeMode::from_raw) else {
        return unavailable("the node mode of the internal loopback is not known");
    };
    let sdo = probe.sdo();
    sdo.write_all(McanChannelConfig { node_mode: mode, ..config }.needed_writes(0))?;
    sdo.write_all([McanChannelConfig::apply_write(0)])?;
    sdo.read(0x8001, 2)
}

fn message_ram(probe: &mut Probe) -> Result<Outcome> {
    let full = McanChannelConfig { tdc: false, ..McanChannelConfig::fd(500_000, 2_000_000) };
    let mut beyond = full;
    beyond.ram.rx_fifo0.data_size = DataSize::B64;
    beyond.ram.rx_fifo0.size += 1;
    let (bytes, more) = (full.message_ram_bytes(), beyond.message_ram_bytes());
    let statuses = (apply(probe, full)?, apply(probe, beyond)?);
    let detail = format!(
        "layout of {bytes} bytes: apply status {}, of {more} bytes: {}",
        statuses.0, statuses.1
    );
    Ok(Outcome::decided(statuses.0 == 0 && statuses.1 != 0, detail))
}

fn tdc_prescaler(probe: &mut Probe) -> Result<Outcome> {
    let slow = McanChannelConfig { tdc: true, ..McanChannelConfig::fd(125_000, 500_000) };
    let status = apply(probe, slow)?;
    let detail = format!("TDC at 500 kbit/s, which needs a prescaler of 4: apply status {status}");
    Ok(Outcome::decided(status != 0, detail))
}

fn rejected_values(probe: &mut Probe) -> Result<Outcome> {
    let sdo = probe.sdo();
    let budget = sdo.read(0x8010, 6)?;
    let status = match sdo.try_write(0x8010, 6, 9)? {
        Some(code) => format!("aborts with 0x{code:08X}"),
        None => {
            sdo.write(0x8010, 1, 1)?;
            let status = sdo.read(0x8010, 2)?;
            sdo.write(0x8010, 6, budget)?;
            format!("gives apply status {status}")
        }
    };
    let code = sdo.try_write(0x8030, 2, 4)?;
    if matches!(code, Some(0x0609_0011 | 0x0602_0000)) {
        return Ok(Outcome::undecided("0x8030:02 is missing"));
    }
    if code.is_none() {
        sdo.write(0x8030, 2, 0)?;
    }
    let test = match code {
        Some(code) => format!("aborts with 0x{code:08X}"),
        None => "is accepted".to_owned(),
    };
    let detail = format!("budget policy 9 {status}; a test policy without key {test}");
    Ok(Outcome::decided(status == "gives apply status 10" && code == Some(0x0604_0043), detail))
}

fn protected_register(probe: &mut Probe) -> Result<Outcome> {
    match apply(probe, McanChannelConfig::classic(500_000))? {
        0 => {}
        status => return Ok(Outcome::undecided(format!("apply status {status}"))),
    }
    let sdo = probe.sdo();
    let before = registers::read(sdo, 0, NBTP)?;
    let write = || -> Result<u32, Interruption> {
        sdo.write(0xA000, 1, NBTP.into())?;
        sdo.write(0xA000, 4, before ^ 1)?;
        sdo.write(0xA000, 2, 2)?;
        sdo.read(0xA000, 3)
    };
    let maintenance = Maintenance::new(sdo.diagnostics, sdo.slave);
    let status = maintenance.in_mode(AccessMode::Engineering, write)?;
    let after = registers::read(sdo, 0, NBTP)?;
    let detail = format!(
        "write to NBTP in operation: status {status}, value 0x{before:08X} before and 0x{after:08X} after"
    );
    Ok(Outcome::decided(status == 0 && after == before, detail))
}
