//! Finding a Sync0 shift and an offset by trying them (manual 15.6.1, 16.1).

use ecan_host::{Diagnostics, Error};
use ecan_mcan_port::{Port, PortError, THIN_MARGIN_NS};
use thiserror::Error;

use crate::phase_table::{PhasePoint, PhaseTable};

/// Flags of 0xB000:06 about scheduled transmission: late drop, queue full, transmit failure, missed
/// timer.
const SCHEDULE_FLAGS: u16 = 0x3C0;
/// Cycles without frames that let those under way come back, beside those of two Sync0 periods.
const QUIET_CYCLES: u64 = 4;

/// The candidates of a sweep, and how long each is tried.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PhaseSweep {
    /// Sync0 shifts in nanoseconds, each below the Sync0 period.
    pub shifts_ns: Vec<u32>,
    /// Offsets behind Sync0 in nanoseconds, each below the Sync0 period.
    pub offsets_ns: Vec<u32>,
    /// Cycles of each candidate that are not measured.
    pub settle_cycles: u32,
    /// Cycles of each candidate that are measured. The rare delays of a machine show in long runs
    /// only: let the recommended point run for minutes before it is relied on (manual 15.6.1).
    pub cycles: u32,
    /// What the arrival of images has to keep from a Sync0 pulse, in nanoseconds.
    pub arrival_margin_ns: u32,
    /// The offset margin that the recommended point shall have, in nanoseconds.
    pub offset_margin_ns: u32,
}

impl PhaseSweep {
    /// Ten shifts over the whole period, six offsets from 0 to half of it, a second each at 1 ms.
    pub fn over(period_ns: u32) -> Self {
        Self {
            shifts_ns: (0..10).map(|nth| period_ns / 10 * nth).collect(),
            offsets_ns: (0..6).map(|nth| period_ns / 10 * nth).collect(),
            settle_cycles: 20,
            cycles: 1_000,
            arrival_margin_ns: THIN_MARGIN_NS,
            offset_margin_ns: 50_000,
        }
    }
}

/// Why a sweep failed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PhaseSweepError {
    /// Distributed clocks are not configured.
    #[error("distributed clocks with Sync0 are not configured; a sweep needs them")]
    NoSync0,
    /// The Port failed.
    #[error(transparent)]
    Port(#[from] PortError),
    /// A shift is not below the Sync0 period.
    #[error("the shift of {shift_ns} ns is not below the Sync0 period of {sync0_ns} ns")]
    Shift {
        /// The shift, in nanoseconds.
        shift_ns: u32,
        /// The Sync0 period, in nanoseconds.
        sync0_ns: u32,
    },
    /// An offset is not below the Sync0 period.
    #[error("the offset of {offset_ns} ns is not below the Sync0 period of {sync0_ns} ns")]
    Offset {
        /// The offset, in nanoseconds.
        offset_ns: u32,
        /// The Sync0 period, in nanoseconds.
        sync0_ns: u32,
    },
    /// The number of measured cycles is 0.
    #[error("no cycle is to be measured: nothing would tell a good phase from a bad one")]
    NoCycles,
}

impl PhaseSweep {
    fn check(&self, sync0_ns: u32) -> Result<(), PhaseSweepError> {
        let beyond = |ns: &&u32| **ns >= sync0_ns;
        if let Some(&shift_ns) = self.shifts_ns.iter().find(beyond) {
            return Err(PhaseSweepError::Shift { shift_ns, sync0_ns });
        }
        if let Some(&offset_ns) = self.offsets_ns.iter().find(beyond) {
            return Err(PhaseSweepError::Offset { offset_ns, sync0_ns });
        }
        if self.cycles == 0 { Err(PhaseSweepError::NoCycles) } else { Ok(()) }
    }
}

/// What happened in all gateways so far.
#[derive(Debug, Clone, Default)]
struct Counts {
    incomplete_cycles: u64,
    sessions_lost: u64,
    late_drops: u64,
    other_drops: u64,
    host_drops: u64,
    taken: u64,
    /// Per gateway: frames that were to be scheduled, and those that the Port took.
    scheduled: Vec<(u64, u64)>,
}

impl Counts {
    fn of(port: &Port) -> Self {
        let mut counts = Self::default();
        for gateway in port.gateways() {
            let statistics = port.statistics(gateway);
            counts.incomplete_cycles += statistics.incomplete_cycles;
            counts.sessions_lost += statistics.sessions_lost;
            let (mut scheduled, mut asked, mut taken) = (0, 0, 0);
            for channel in port.channels().filter(|channel| channel.gateway() == gateway) {
                let account = port.schedule_account(channel);
                scheduled += account.scheduled;
                asked += account.asked;
                taken += account.accepted;
                counts.late_drops += account.late_dropped;
                counts.other_drops += account.queue_full + account.not_sent;
                counts.host_drops += account.refused_late + account.withdrawn;
            }
            counts.taken += taken;
            counts.scheduled.push((asked, scheduled));
        }
        counts
    }
}

/// Tries every shift with every offset and reports the losses at each.
///
/// Reconfigures the Port for every shift, and afterwards as it was before. `cycle` runs one cycle of
/// the application, from `begin_cycle` to its end, with its frames scheduled at the offset that it
/// gets, at least one for each gateway and Sync0 period: a point is good only if all were accepted.
/// Its errors end the sweep. For each candidate the gateways' runtime diagnostics are cleared
/// (0xB000:04 and 0x9011:14) and read afterwards. With
/// [`OptionFlags::TX_RESULT`](ecan_protocol::image::OptionFlags::TX_RESULT) late frames are counted,
/// otherwise only a flag reports them. `progress` gets each finished point.
///
/// Blocks for the whole sweep; not for a machine at work.
///
/// # Errors
/// [`PhaseSweepError`]; errors of the application. A shift with which the gateways do not become
/// ready is a point of the table.
pub fn sweep_phase<E: From<PhaseSweepError>>(
    port: &mut Port,
    sweep: &PhaseSweep,
    mut cycle: impl FnMut(&mut Port, u32) -> Result<(), E>,
    mut progress: impl FnMut(&PhasePoint),
) -> Result<PhaseTable, E> {
    let (before, config) = (*port.adapter().config(), *port.config());
    let dc = before.dc.ok_or(PhaseSweepError::NoSync0)?;
    sweep.check(dc.cycle_ns)?;
    let mut table = PhaseTable {
        period_ns: dc.cycle_ns,
        arrival_margin_ns: sweep.arrival_margin_ns,
        offset_margin_ns: sweep.offset_margin_ns,
        points: Vec::with_capacity(sweep.shifts_ns.len() * sweep.offsets_ns.len()),
    };
    let mut end = Ok(());
    'sweep: for &shift_ns in &sweep.shifts_ns {
        let mut adapter = before;
        adapter.dc = Some(ecan_host::DcSync { shift_ns, ..dc });
        let ready = port.reconfigure((adapter, config)).and_then(|()| port.wait_ready());
        for &offset_ns in &sweep.offsets_ns {
            let mut point = PhasePoint { shift_ns, offset_ns, ..PhasePoint::default() };
            match &ready {
                Ok(()) => {
                    if let Err(error) = try_phase(port, sweep, &mut point, &mut cycle) {
                        end = Err(error);
                        break 'sweep;
                    }
                }
                Err(error) => point.failure = Some(error.to_string()),
            }
            progress(&point);
            table.points.push(point);
        }
    }
    let restored = port.reconfigure((before, config)).and_then(|()| port.wait_ready());
    end?;
    restored.map_err(PhaseSweepError::from)?;
    Ok(table)
}

fn try_phase<E: From<PhaseSweepError>>(
    port: &mut Port,
    sweep: &PhaseSweep,
    point: &mut PhasePoint,
    cycle: &mut impl FnMut(&mut Port, u32) -> Result<(), E>,
) -> Result<(), E> {
    let failed = |error| PhaseSweepError::Port(PortError::Adapter(error));
    let offset_ns = point.offset_ns;
    for _ in 0..sweep.settle_cycles {
        port.wait_next_cycle();
        cycle(port, offset_ns)?;
    }
    run_idle_cycles(port);
    let slaves = port.slave_count();
    let cleared = port.diagnose(|diagnostics| clear(diagnostics, slaves));
    cleared.map_err(PhaseSweepError::from)?.map_err(failed)?;
    let before = Counts::of(port);
    for _ in 0..sweep.cycles {
        port.wait_next_cycle();
        cycle(port, offset_ns)?;
    }
    run_idle_cycles(port);
    let after = Counts::of(port);
    point.cycles = sweep.cycles.into();
    point.incomplete_cycles = after.incomplete_cycles - before.incomplete_cycles;
    point.sessions_lost = after.sessions_lost - before.sessions_lost;
    point.late_drops = after.late_drops - before.late_drops;
    point.other_drops = after.other_drops - before.other_drops;
    point.host_drops = after.host_drops - before.host_drops;
    point.taken = after.taken - before.taken;
    let config = port.adapter().config();
    let (cycle_ns, period_ns) = (config.cycle_ns(), config.dc.map_or(0, |dc| dc.cycle_ns));
    let periods = u64::from(sweep.cycles) * u64::from(cycle_ns) / u64::from(period_ns.max(1));
    for (after, before) in after.scheduled.iter().zip(&before.scheduled) {
        let (asked, scheduled) = (after.0 - before.0, after.1 - before.1);
        point.scheduled += scheduled;
        point.short_gateways += u32::from(asked > 0 && scheduled < periods);
    }
    let read = port.diagnose(|diagnostics| read(diagnostics, slaves, period_ns));
    let counts = read.map_err(PhaseSweepError::from)?.map_err(failed)?;
    point.flags = counts.flags;
    if let Some((after_ns, before_ns)) = counts.arrival_ns {
        point.arrival_after_pulse_ns = Some(after_ns);
        point.arrival_before_pulse_ns = Some(before_ns);
    }
    Ok(())
}

/// Runs cycles without frames until those sent before have left. Discards what is received, but
/// transmit results count.
fn run_idle_cycles(port: &mut Port) {
    // A pulse comes within one period, the phase after it within another.
    let config = port.adapter().config();
    let phases_ns = config.dc.map_or(0, |dc| 2 * u64::from(dc.cycle_ns));
    for _ in 0..phases_ns.div_ceil(config.cycle_ns().max(1).into()) + QUIET_CYCLES {
        // A cycle that fails shows in the working counters.
        port.next_cycle().received().for_each(drop);
    }
}

/// What the gateways told after a candidate.
#[derive(Debug, Clone, Copy, Default)]
struct CandidateCounts {
    flags: u16,
    /// Shortest distances of arrivals from the pulse before and to the pulse behind.
    arrival_ns: Option<(u32, u32)>,
}

fn clear(diagnostics: &Diagnostics, slaves: usize) -> Result<(), Error> {
    for slave in 0..slaves {
        diagnostics.sdo_download(slave, 0xB000, 4, &[1 << 5])?;
        diagnostics.sdo_download(slave, 0x9011, 14, &[1])?;
    }
    Ok(())
}

fn read(
    diagnostics: &Diagnostics,
    slaves: usize,
    period_ns: u32,
) -> Result<CandidateCounts, Error> {
    let mut told = CandidateCounts::default();
    for slave in 0..slaves {
        let upload = |index, subindex| diagnostics.sdo_upload_u32(slave, index, subindex);
        told.flags |= upload(0xB000, 6)? as u16 & SCHEDULE_FLAGS;
        let clock_hz = u64::from(upload(0x8000, 4)?);
        let (least, most) = (upload(0x9011, 4)? as i32, upload(0x9011, 5)? as i32);
        let Some((after, before)) = distances(least, most, clock_hz, period_ns) else { continue };
        let (a, b) = told.arrival_ns.unwrap_or((after, before));
        told.arrival_ns = Some((a.min(after), b.min(before)));
    }
    Ok(told)
}

/// Shortest distances in nanoseconds from the pulse before and to the pulse behind, of arrivals
/// between `least` and `most` CPU cycles behind a pulse. None where a gateway does not measure
/// them, or means something else by them.
fn distances(least: i32, most: i32, clock_hz: u64, period_ns: u32) -> Option<(u32, u32)> {
    let ns = |cycles: i32| (i64::from(cycles) * 1_000_000_000).checked_div(clock_hz as i64);
    let (least_ns, most_ns, period_ns) = (ns(least)?, ns(most)?, i64::from(period_ns));
    let is_plausible = least_ns <= most_ns && -period_ns <= least_ns && most_ns <= period_ns;
    if !is_plausible || (least, most) == (0, 0) || most_ns - least_ns > period_ns {
        return None;
    }
    let (after, before) = match (least_ns < 0, most_ns < 0) {
        (false, _) => (least_ns, period_ns - most_ns),
        (true, true) => (period_ns + least_ns, -most_ns),
        // On both sides of the pulse.
        (true, false) => (0, 0),
    };
    Some((u32::try_from(after).ok()?, u32::try_from(before).ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrivals_before_and_behind_the_pulse_have_their_distances() {
        let of = |least, most| distances(least, most, 500_000_000, 1_000_000);
        assert_eq!(of(100_000, 150_000), Some((200_000, 700_000)));
        assert_eq!(of(-150_000, -100_000), Some((700_000, 200_000)), "before the pulse");
        assert_eq!(of(-200, 50_000), Some((0, 0)), "on both sides of it");
        assert_eq!(of(0, 0), None, "not measured");
        assert_eq!(of(150_000, 100_000), None, "the wrong way round");
        assert_eq!(of(0, 500_001), None, "beyond the period");
        assert_eq!(of(-400_000, 400_000), None, "further apart than pulses");
        assert_eq!(distances(1, 2, 0, 1_000_000), None, "no clock");
    }
}
