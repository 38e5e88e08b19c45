//! Configuration of a channel in PREOP: node modes, bit timing, and statuses of rejected settings.

use ecan_host::Maintenance;
use ecan_protocol::can::BitTiming;
use ecan_protocol::config::{
    BitTimingMode, McanChannelConfig, MessageRamLayout, NodeMode, SamplePointWindow,
    assignment_writes,
};
use ecan_protocol::device::{AccessMode, ControllerMode};
use ecan_protocol::mapping::Direction;

use crate::probe::outcome::{Interruption, Outcome, Result, unavailable};
use crate::probe::run::Probe;
use crate::probe::sdo::{DBTP, ENDN, NBTP, controller_mode, read_register, sample_point};

/// ENDN of every M_CAN core.
const ENDIANNESS: u32 = 0x8765_4321;

pub(in crate::probe) fn core(probe: &mut Probe) -> Result<Outcome> {
    let value = read_register(probe.sdo(), 0, ENDN)?;
    let detail =
        format!("register ENDN is 0x{value:08X}, that of the M_CAN core 0x{ENDIANNESS:08X}");
    Ok(Outcome::decided(value == ENDIANNESS, detail))
}

/// Applies a node mode to channel 0 and reads the mode of its controller. No frame is sent.
fn mode_of(probe: &Probe, number: u8) -> Result<ControllerMode> {
    let sdo = probe.sdo();
    let config = McanChannelConfig {
        nominal_sample_point: SamplePointWindow::DEFAULT,
        ..McanChannelConfig::classic(500_000)
    };
    for write in config.needed_writes(0) {
        let value = if write.subindex == 8 { number.into() } else { write.value };
        sdo.write(write.index, write.subindex, value)?;
    }
    sdo.write_all([McanChannelConfig::apply_write(0)])?;
    match sdo.read(0x8001, 2)? {
        0 => controller_mode(sdo, 0),
        status => {
            crate::probe::outcome::unavailable(format!("node mode {number}: apply status {status}"))
        }
    }
}

/// Tries mode 1 first: listen-only or internal loopback, neither of which drives the bus. Mode 2 only if
/// mode 1 is listen-only, so that it is not the external loopback of the other known numbering.
pub(in crate::probe) fn node_modes(probe: &mut Probe) -> Result<Outcome> {
    let first = mode_of(probe, 1)?;
    let mut detail = format!("node mode 1 sets the controller to {}", first.text());
    match first {
        ControllerMode::Listen => {
            let second = mode_of(probe, 2)?;
            detail += &format!(", 2 to {}", second.text());
            let is_loopback = second == ControllerMode::InternalLoopback;
            if is_loopback {
                probe.profile.internal_loopback = Some(2);
            }
            Ok(Outcome::decided(is_loopback, detail))
        }
        ControllerMode::InternalLoopback => {
            probe.profile.internal_loopback = Some(1);
            Ok(Outcome::differs(detail).like("loopback_first"))
        }
        _ => Ok(Outcome::differs(detail)),
    }
}

/// Nominal and data sample point in 0.1 %.
fn sample_points(probe: &Probe) -> Result<(u32, u32)> {
    let nominal = sample_point(read_register(probe.sdo(), 0, NBTP)?, false);
    let data = sample_point(read_register(probe.sdo(), 0, DBTP)?, true);
    Ok((nominal, data))
}

pub(super) fn percent(permille: u32) -> String {
    format!("{}.{} %", permille / 10, permille % 10)
}

pub(in crate::probe) fn timing_choice(probe: &mut Probe) -> Result<Outcome> {
    let rates = McanChannelConfig { tdc: false, ..McanChannelConfig::fd(500_000, 2_000_000) };
    let window = SamplePointWindow::DEFAULT;
    let wide =
        McanChannelConfig { nominal_sample_point: window, data_sample_point: window, ..rates };
    match apply(probe, wide)? {
        0 => {}
        // no timing was found
        3 => return Ok(Outcome::differs("window 75 to 87.5 %: apply status 3")),
        status => return Ok(Outcome::undecided(format!("apply status {status}"))),
    }
    let (nominal, data) = sample_points(probe)?;
    probe.profile.sample_point_permille = Some(nominal);
    let exact = apply(probe, rates.sample_point(875, 875))?;
    let detail = format!(
        "500 kbit/s and 2 Mbit/s, 75 to 87.5 %: sample points {} and {}; exactly 87.5 %: apply status {exact}",
        percent(nominal),
        percent(data)
    );
    let is_near = |found: u32, expected: u32| found.abs_diff(expected) <= 15;
    let outcome = Outcome::decided(is_near(nominal, 812) && exact == 0, detail);
    Ok(match exact {
        0 => like_choice(outcome, nominal),
        _ => outcome.like("driver"),
    })
}

/// Names the choice of a nominal sample point from 75 to 87.5 %, in 0.1 %.
pub(super) fn like_choice(outcome: Outcome, nominal: u32) -> Outcome {
    match nominal {
        ..765 => outcome.like("lowest"),
        860.. => outcome.like("highest"),
        _ => outcome,
    }
}

pub(in crate::probe) fn manual_timing(probe: &mut Probe) -> Result<Outcome> {
    let timing = BitTiming { brp: 10, tseg1: 12, tseg2: 3, sjw: 2 };
    let config = McanChannelConfig {
        bit_timing_mode: BitTimingMode::Manual,
        manual_nominal: timing,
        ..McanChannelConfig::classic(500_000)
    };
    match apply(probe, config)? {
        0 => {}
        status => return Ok(Outcome::undecided(format!("apply status {status}"))),
    }
    let value = read_register(probe.sdo(), 0, NBTP)?;
    let (brp, tseg1, tseg2) = (value >> 16 & 0x1FF, value >> 8 & 0xFF, value & 0x7F);
    let detail = format!(
        "written: prescaler 10, segments 12 and 3; register NBTP holds {brp}, {tseg1} and {tseg2}"
    );
    let found = (brp, tseg1, tseg2);
    let outcome = Outcome::decided(found == (9, 11, 2), detail);
    Ok(if found == (10, 12, 3) { outcome.like("register_values") } else { outcome })
}

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

/// A ram_layout that needs exactly this number of bytes, a multiple of 8.
fn ram_layout(bytes: u32) -> McanChannelConfig {
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

pub(in crate::probe) fn message_ram(probe: &mut Probe) -> Result<Outcome> {
    let assumed = apply(probe, ram_layout(ASSUMED_RAM_BYTES))?;
    let beyond = apply(probe, ram_layout(ASSUMED_RAM_BYTES + 8))?;
    let text = format!(
        "layout of {ASSUMED_RAM_BYTES} bytes: apply status {assumed}, of 8 bytes more: {beyond}"
    );
    if assumed == 0 && beyond != 0 {
        return Ok(Outcome::holds(text));
    }
    let tried = if assumed == 0 { &[LARGER_RAM_BYTES][..] } else { &SMALLER_RAM_BYTES };
    for &bytes in tried {
        if apply(probe, ram_layout(bytes))? == 0 {
            return Ok(Outcome::differs(format!("{text}, of {bytes} bytes: 0")).like(bytes));
        }
    }
    Ok(Outcome::differs(text))
}

pub(in crate::probe) fn tdc_prescaler(probe: &mut Probe) -> Result<Outcome> {
    let slow = McanChannelConfig { tdc: true, ..McanChannelConfig::fd(125_000, 500_000) };
    let status = apply(probe, slow)?;
    let detail = format!("TDC at 500 kbit/s, which needs a prescaler of 4: apply status {status}");
    let outcome = Outcome::decided(status != 0, detail);
    Ok(if status == 0 { outcome.like("any") } else { outcome })
}

pub(in crate::probe) fn rejected_values(probe: &mut Probe) -> Result<Outcome> {
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

/// Writes another supported rotation, applies channel 0 in internal loopback, and writes the former one again.
pub(in crate::probe) fn rotation_effect(probe: &mut Probe) -> Result<Outcome> {
    const SYSTEM: u16 = 0x8000;
    let sdo = probe.sdo();
    let [requested, active, mask] =
        [sdo.read(SYSTEM, 12)?, sdo.read(SYSTEM, 13)?, sdo.read(SYSTEM, 14)?];
    let Some(other) = (0..8).find(|rotation| *rotation != active && mask >> rotation & 1 == 1)
    else {
        return Ok(Outcome::undecided("no other rotation is supported (0x8000:14)"));
    };
    sdo.write(SYSTEM, 12, other)?;
    let written = sdo.read(SYSTEM, 13)?;
    let applied = apply(probe, McanChannelConfig::classic(500_000))
        .and_then(|_| probe.sdo().read(SYSTEM, 13));
    sdo.write(SYSTEM, 12, requested)?;
    let applied = applied?;
    apply(probe, McanChannelConfig::classic(500_000))?;
    let detail = format!(
        "rotation {other} in place of {active}: {written} is active after the write, {applied} after an \
         apply command"
    );
    Ok(match (written == other, applied == other) {
        (true, _) => Outcome::holds(detail),
        (false, true) => Outcome::differs(detail).like("channel_apply"),
        (false, false) => Outcome::differs(detail).like("start"),
    })
}

pub(in crate::probe) fn bit_rates(probe: &mut Probe) -> Result<Outcome> {
    let fast = apply(probe, McanChannelConfig::classic(2_000_000))?;
    let slow = McanChannelConfig {
        tdc: false,
        ram: MessageRamLayout::classic(),
        ..McanChannelConfig::fd(1_000_000, 500_000)
    };
    let slow = apply(probe, slow)?;
    let detail =
        format!("nominal 2 Mbit/s: apply status {fast}; data 500 kbit/s below 1 Mbit/s: {slow}");
    let outcome = Outcome::decided(fast != 0 && slow == 0, detail);
    Ok(match (fast, slow) {
        (0, 0) => outcome.like("any"),
        (1.., 1..) => outcome.like("rejected"),
        _ => outcome,
    })
}

/// Apply status of an object while one entry has another value. The former one is written again, and applied if
/// the other one was: a rejected profile must not become an applied one.
fn status_with(
    probe: &Probe,
    (index, subindex): (u16, u8),
    value: u32,
    (command, status): (u8, u8),
) -> Result<u32> {
    let sdo = probe.sdo();
    let before = sdo.read(index, subindex)?;
    sdo.write(index, subindex, value)?;
    sdo.write(index, command, 1)?;
    let found = sdo.read(index, status)?;
    sdo.write(index, subindex, before)?;
    if found == 0 {
        sdo.write(index, command, 1)?;
    }
    Ok(found)
}

pub(in crate::probe) fn empty_mask(probe: &mut Probe) -> Result<Outcome> {
    let n = probe.sdo().read(0x8010, 3)?;
    let sdo = probe.sdo();
    // Without a matching assignment the status would be 5.
    sdo.write_all(assignment_writes(Direction::TxPdo, n as u8))?;
    let status = status_with(probe, (0x8010, 4), 0, (1, 2))?;
    let outcome = Outcome::decided(status == 3, format!("0x8010:04 = 0: apply status {status}"));
    Ok(if status == 0 { outcome.like("accepted") } else { outcome })
}

pub(in crate::probe) fn inverted_budget(probe: &mut Probe) -> Result<Outcome> {
    let most = probe.sdo().read(0x8021, 5)?;
    if most >= 8 {
        return Ok(Outcome::undecided("0x8021:05 is 8, the largest minimum"));
    }
    let status = status_with(probe, (0x8021, 4), most + 1, (2, 3))?;
    let detail = format!("0x8021:04 = {}, above :05 = {most}: apply status {status}", most + 1);
    let outcome = Outcome::decided(status != 0, detail);
    Ok(if status == 0 { outcome.like("accepted") } else { outcome })
}

pub(in crate::probe) fn compat_bits(probe: &mut Probe) -> Result<Outcome> {
    let status = status_with(probe, (0x8020, 4), 0xFFFF, (2, 3))?;
    let outcome =
        Outcome::decided(status == 0, format!("0x8020:04 = 0xFFFF: apply status {status}"));
    Ok(if status == 0 { outcome } else { outcome.like("status_1") })
}

pub(in crate::probe) fn protected_register(probe: &mut Probe) -> Result<Outcome> {
    match apply(probe, McanChannelConfig::classic(500_000))? {
        0 => {}
        status => return Ok(Outcome::undecided(format!("apply status {status}"))),
    }
    let sdo = probe.sdo();
    let before = read_register(sdo, 0, NBTP)?;
    let write = || -> Result<u32, Interruption> {
        sdo.write(0xA000, 1, NBTP.into())?;
        sdo.write(0xA000, 4, before ^ 1)?;
        sdo.write(0xA000, 2, 2)?;
        sdo.read(0xA000, 3)
    };
    let maintenance = Maintenance::new(sdo.diagnostics, sdo.slave);
    let status = maintenance.in_mode(AccessMode::Engineering, write)?;
    let after = read_register(sdo, 0, NBTP)?;
    let detail = format!(
        "write to NBTP in operation: status {status}, value 0x{before:08X} before and 0x{after:08X} after"
    );
    let outcome = Outcome::decided(status == 0 && after == before, detail);
    Ok(if (status, after) == (2, before) { outcome.like("status_2") } else { outcome })
}
