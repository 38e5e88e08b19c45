//! Finding a Sync0 shift and an offset by trying them (manual 15.6.1, 16.1).

use ecan_host::{Diagnostics, Error};
use ecan_mcan_port::{Port, PortError};
use thiserror::Error;

use crate::phase_table::{PhasePoint, PhaseTable};

/// Flags of 0xB000:06 about scheduled transmission: late drop, queue full, transmit failure, missed
/// timer.
const SCHEDULE_FLAGS: u16 = 0x3C0;
/// Cycles without frames after those of two Sync0 periods, until pending frames have returned.
const IDLE_CYCLES: u64 = 4;
/// Cycles of each candidate that are not measured.
const SETTLE_CYCLES: u32 = 20;

/// Candidates of a sweep, and their duration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PhaseSweep {
    /// Sync0 shifts in nanoseconds, each below the Sync0 period.
    pub shifts_ns: Vec<u32>,
    /// Offsets after Sync0 in nanoseconds, each below the Sync0 period.
    pub offsets_ns: Vec<u32>,
    /// Measured cycles of each candidate. Rare delays of a machine show only in long runs: confirm
    /// the recommended point in a run of minutes (manual 15.6.1).
    pub cycles: u32,
}

impl PhaseSweep {
    /// Ten shifts over the whole period, six offsets from 0 to half of it, a second each at 1 ms.
    pub fn over(period_ns: u32) -> Self {
        Self {
            shifts_ns: (0..10).map(|nth| period_ns / 10 * nth).collect(),
            offsets_ns: (0..6).map(|nth| period_ns / 10 * nth).collect(),
            cycles: 1_000,
        }
    }
}

/// Error of a sweep.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PhaseSweepError {
    /// Distributed clocks are not configured.
    #[error("distributed clocks with Sync0 are not configured; a sweep needs them")]
    NoSync0,
    /// The Port failed.
    #[error(transparent)]
    Port(#[from] PortError),
    /// A shift or an offset is not below the Sync0 period.
    #[error("the {value} of {ns} ns is not below the Sync0 period of {sync0_ns} ns")]
    Beyond {
        /// The kind of the value.
        value: &'static str,
        /// The value, in nanoseconds.
        ns: u32,
        /// The Sync0 period, in nanoseconds.
        sync0_ns: u32,
    },
    /// The number of measured cycles is 0.
    #[error("0 cycles cannot be measured; set at least 1")]
    NoCycles,
}

impl PhaseSweep {
    fn check(&self, sync0_ns: u32) -> Result<(), PhaseSweepError> {
        for (value, all) in [("shift", &self.shifts_ns), ("offset", &self.offsets_ns)] {
            if let Some(&ns) = all.iter().find(|ns| **ns >= sync0_ns) {
                return Err(PhaseSweepError::Beyond { value, ns, sync0_ns });
            }
        }
        if self.cycles == 0 { Err(PhaseSweepError::NoCycles) } else { Ok(()) }
    }
}

/// Counters of all gateways.
#[derive(Debug, Clone, Default)]
struct Counts {
    /// Incomplete cycles, lost sessions, drops, host drops and accepted frames.
    sums: [u64; 5],
    /// Per gateway: frames that were to be scheduled, and those that the Port scheduled.
    scheduled: Vec<(u64, u64)>,
}

impl Counts {
    fn of(port: &Port) -> Self {
        let mut counts = Self::default();
        for gateway in port.gateways() {
            let statistics = port.statistics(gateway);
            let [incomplete, lost, other, host, accepted] = &mut counts.sums;
            *incomplete += statistics.incomplete_cycles;
            *lost += statistics.sessions_lost;
            let (mut asked, mut scheduled) = (0, 0);
            for channel in port.channels().filter(|channel| channel.gateway() == gateway) {
                let account = port.schedule_account(channel);
                asked += account.asked;
                scheduled += account.scheduled;
                *other += account.queue_full + account.not_sent;
                *host += account.rejected_late + account.withdrawn;
                *accepted += account.accepted;
            }
            counts.scheduled.push((asked, scheduled));
        }
        counts
    }
}

/// Tries every shift with every offset and reports the losses at each.
///
/// Reconfigures the Port for every shift, and restores it afterwards. `cycle` runs one cycle of the
/// application, from `begin_cycle` to its end, with its frames scheduled at the given offset, at
/// least one for each gateway and Sync0 period: a point is good only if all were accepted. Its errors
/// end the sweep. For each candidate the gateways' runtime diagnostics are cleared (0xB000:04 and
/// 0x9011:14) and read afterwards; a flag reports late frames. `progress` gets each finished point.
///
/// Blocks for the whole sweep; not for a machine in production.
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
    sweep.check(dc.cycle_ns())?;
    let mut table = PhaseTable {
        period_ns: dc.cycle_ns(),
        points: Vec::with_capacity(sweep.shifts_ns.len() * sweep.offsets_ns.len()),
    };
    let mut end = Ok(());
    'sweep: for &shift_ns in &sweep.shifts_ns {
        let mut adapter = before;
        adapter.dc = Some(ecan_host::DcSync {
            shift: std::time::Duration::from_nanos(shift_ns.into()),
            ..dc
        });
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
    for _ in 0..SETTLE_CYCLES {
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
    [
        point.incomplete_cycles,
        point.sessions_lost,
        point.rejected,
        point.host_drops,
        point.accepted,
    ] = std::array::from_fn(|sum| after.sums[sum] - before.sums[sum]);
    let config = port.adapter().config();
    let (cycle_ns, period_ns) = (config.cycle_ns(), config.dc.map_or(0, |dc| dc.cycle_ns()));
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

/// Runs cycles without frames until all frames have been sent. Drops received frames; transmit
/// results count.
fn run_idle_cycles(port: &mut Port) {
    // A pulse comes within one period, the phase after it within another.
    let config = port.adapter().config();
    let phases_ns = config.dc.map_or(0, |dc| 2 * u64::from(dc.cycle_ns()));
    for _ in 0..phases_ns.div_ceil(config.cycle_ns().max(1).into()) + IDLE_CYCLES {
        // A cycle that fails shows in the working counters.
        port.next_cycle().received().for_each(drop);
    }
}

/// Diagnostics of the gateways after a candidate.
#[derive(Debug, Clone, Copy, Default)]
struct CandidateCounts {
    flags: u16,
    /// Shortest distances of arrivals from the previous pulse and to the next one.
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
    let mut counts = CandidateCounts::default();
    for slave in 0..slaves {
        let upload = |index, subindex| diagnostics.sdo_upload_u32(slave, index, subindex);
        counts.flags |= upload(0xB000, 6)? as u16 & SCHEDULE_FLAGS;
        let clock_hz = u64::from(upload(0x8000, 4)?);
        let (least, most) = (upload(0x9011, 4)? as i32, upload(0x9011, 5)? as i32);
        let Some((after, before)) = distances(least, most, clock_hz, period_ns) else { continue };
        let (a, b) = counts.arrival_ns.unwrap_or((after, before));
        counts.arrival_ns = Some((a.min(after), b.min(before)));
    }
    Ok(counts)
}

/// Shortest distances in nanoseconds from the previous pulse and to the next one, of arrivals
/// between `least` and `most` CPU cycles after a pulse. `None` if a gateway does not measure them,
/// or the values are implausible.
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
    fn arrivals_around_a_pulse_have_their_distances() {
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
