//! Statuses and abort codes of rejected settings.

use ecan_host::Maintenance;
use ecan_protocol::config::{McanChannelConfig, NodeMode};
use ecan_protocol::device::AccessMode;

use crate::probe::experiment::Experiment;
use crate::probe::interruption::{Interruption, Result, unavailable};
use crate::probe::outcome::Outcome;
use crate::probe::registers::{self, NBTP};
use crate::probe::run::Probe;
use crate::probe::stage::Stage;

pub(super) const EXPERIMENTS: &[Experiment] = &[
    Experiment {
        rows: &["H13"],
        key: "message_ram_bytes",
        stage: Stage::PreOp,
        assumption: "the Message RAM of a channel has 8192 bytes",
        run: message_ram,
    },
    Experiment {
        rows: &["H11"],
        key: "tdc_prescaler",
        stage: Stage::PreOp,
        assumption: "TDC needs a data prescaler of 1 or 2",
        run: tdc_prescaler,
    },
    Experiment {
        rows: &["S20"],
        key: "rejected_budget",
        stage: Stage::PreOp,
        assumption: "an unknown budget policy gives status 10, a test policy without key aborts with 0x06040043",
        run: rejected_values,
    },
    Experiment {
        rows: &["S49"],
        key: "protected_register",
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

const ASSUMED_RAM_BYTES: u32 = 8192;
/// Sizes that are tried if the assumed one is too large or too small.
const SMALLER_RAM_BYTES: [u32; 3] = [6144, 4096, 2048];
const LARGER_RAM_BYTES: u32 = 16384;
/// Elements with 64 data bytes, and filters.
const ELEMENT_BYTES: u32 = 72;
const FILTER_BYTES: u32 = 448;

/// A layout that needs exactly this number of bytes, a multiple of 8.
fn layout(bytes: u32) -> McanChannelConfig {
    let mut config = McanChannelConfig { tdc: false, ..McanChannelConfig::fd(500_000, 2_000_000) };
    let ram = &mut config.ram;
    let left = bytes.saturating_sub(FILTER_BYTES);
    let mut elements = (left / ELEMENT_BYTES) as u8;
    for (count, most) in [
        (&mut ram.tx_fifo_size, 32),
        (&mut ram.rx_fifo0.size, 64),
        (&mut ram.rx_fifo1.size, 64),
        (&mut ram.rx_buffer_count, 64),
    ] {
        *count = elements.min(most);
        elements -= *count;
    }
    ram.tx_event_size = (left % ELEMENT_BYTES / 8) as u8;
    config
}

fn message_ram(probe: &mut Probe) -> Result<Outcome> {
    let assumed = apply(probe, layout(ASSUMED_RAM_BYTES))?;
    let beyond = apply(probe, layout(ASSUMED_RAM_BYTES + 8))?;
    let text = format!(
        "layout of {ASSUMED_RAM_BYTES} bytes: apply status {assumed}, of 8 bytes more: {beyond}"
    );
    if assumed == 0 && beyond != 0 {
        return Ok(Outcome::holds(text));
    }
    let tried = if assumed == 0 { &[LARGER_RAM_BYTES][..] } else { &SMALLER_RAM_BYTES };
    for &bytes in tried {
        if apply(probe, layout(bytes))? == 0 {
            return Ok(Outcome::differs(format!("{text}, of {bytes} bytes: 0")).like(bytes));
        }
    }
    Ok(Outcome::differs(text))
}

fn tdc_prescaler(probe: &mut Probe) -> Result<Outcome> {
    let slow = McanChannelConfig { tdc: true, ..McanChannelConfig::fd(125_000, 500_000) };
    let status = apply(probe, slow)?;
    let detail = format!("TDC at 500 kbit/s, which needs a prescaler of 4: apply status {status}");
    let outcome = Outcome::decided(status != 0, detail);
    Ok(if status == 0 { outcome.like("any") } else { outcome })
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
    let is_met = status == "gives apply status 10" && code == Some(0x0604_0043);
    let outcome = Outcome::decided(is_met, detail);
    Ok(if status == "gives apply status 4" { outcome.like("status_4") } else { outcome })
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
    let outcome = Outcome::decided(status == 0 && after == before, detail);
    Ok(if (status, after) == (2, before) { outcome.like("status_2") } else { outcome })
}
