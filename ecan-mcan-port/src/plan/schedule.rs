//! Whether scheduled frames reach their phase, and leave before the next one (manual 8.4, 13.8).

use std::collections::BTreeMap;

use ecan_host::AdapterConfig;
use ecan_protocol::can::FrameBits;

use super::finding::{PortPlanError, PortWarning};
use super::frame_stream::{FrameRate, FrameStream};
use super::{PortPlan, settings};
use crate::port_config::PortConfig;
use crate::schedule::config::MarginCheck;
use crate::schedule::margin::NotSchedulable;
use crate::schedule::margin::{RECOMMENDED_OFFSET_NS, ScheduleMargin};

impl PortPlan {
    /// The margin that a phase will have, as
    /// [`Port::schedule_margin`](crate::Port::schedule_margin) gives it for gateways that have the
    /// capability, which a plan cannot know.
    ///
    /// # Errors
    /// [`NotSchedulable`] if no frame can be scheduled at this phase: without Sync0, beyond the Sync0
    /// period. A slave index out of range is not supported.
    pub fn schedule_margin(
        &self,
        slave: usize,
        offset_ns: u32,
    ) -> Result<ScheduleMargin, NotSchedulable> {
        let gateway = self.gateways.get(slave).ok_or(NotSchedulable::NotSupported)?;
        gateway.schedule_times.margin(offset_ns)
    }

    pub(super) fn check_schedules(
        &mut self,
        adapter: &AdapterConfig,
        port: &PortConfig,
        traffic: &[FrameStream],
    ) {
        for stream in traffic {
            // What has no place is rejected for that.
            let (slave, Some(offset_ns)) = (stream.slave, stream.offset_ns()) else { continue };
            let Some(gateway) = port.gateways.get(slave) else { continue };
            if slave < self.gateways.len() {
                self.check_phase(slave, offset_ns, gateway.schedule.margin_check);
            }
        }
        self.check_simultaneous_frames(adapter, port, traffic);
    }

    /// An error for a phase that the Port would reject, a warning for one that it would count.
    fn check_phase(&mut self, slave: usize, offset_ns: u32, check: MarginCheck) {
        let checked = self.schedule_margin(slave, offset_ns).and_then(|margin| {
            let lacking_ns = margin.lacking_ns();
            match check {
                MarginCheck::Reject if lacking_ns > 0 => {
                    Err(NotSchedulable::NoMargin { lacking_ns })
                }
                _ => Ok(margin),
            }
        });
        let margin = match checked {
            Ok(margin) => margin,
            Err(reason) => {
                let rejection = PortPlanError::NotSchedulable { slave, offset_ns, reason };
                if !self.rejections.contains(&rejection) {
                    self.rejections.push(rejection);
                }
                return;
            }
        };
        let lacking_ns = margin.lacking_ns();
        let short =
            (lacking_ns > 0).then_some(PortWarning::NoMargin { slave, offset_ns, lacking_ns });
        let thin = margin.is_thin().then_some(PortWarning::ThinMargin { slave, offset_ns, margin });
        let small =
            (offset_ns < RECOMMENDED_OFFSET_NS).then_some(PortWarning::SmallOffset { offset_ns });
        for warning in [short, thin, small].into_iter().flatten() {
            if !self.warnings.contains(&warning) {
                self.warnings.push(warning);
            }
        }
    }

    /// Warns of more frames for one Sync0 pulse than a gateway holds, and of frames that are still
    /// on the bus when the next period begins.
    fn check_simultaneous_frames(
        &mut self,
        adapter: &AdapterConfig,
        port: &PortConfig,
        traffic: &[FrameStream],
    ) {
        let Some(sync0_ns) = adapter.dc.map(|dc| dc.cycle_ns()) else { return };
        let mut meeting: BTreeMap<usize, u32> = BTreeMap::new();
        // Per channel: the first offset, and the bus time of all that meets at a pulse.
        let mut scheduled: BTreeMap<(usize, u8), (u32, f64)> = BTreeMap::new();
        for stream in traffic {
            let Some(offset_ns) = stream.offset_ns() else { continue };
            let Some(settings) = settings(port, stream.slave, stream.channel) else { continue };
            let can = &settings.can;
            let bits = FrameBits::most(stream.frame.as_ref());
            let frames = frames_at_a_pulse(stream.rate, adapter.cycle_ns(), sync0_ns);
            let held = meeting.entry(stream.slave).or_default();
            *held = held.saturating_add(frames);
            let frames_s = f64::from(frames) * bits.seconds(can.nominal_bitrate, can.data_bitrate);
            let (first, total_s) =
                scheduled.entry((stream.slave, stream.channel)).or_insert((offset_ns, 0.0));
            *first = (*first).min(offset_ns);
            *total_s += frames_s;
        }
        for (slave, frames) in meeting {
            let depth = port.gateways.get(slave).map_or(0, |it| u32::from(it.schedule.depth));
            if frames > depth {
                self.warnings.push(PortWarning::ScheduleCrowded { slave, frames, depth });
            }
        }
        for ((slave, channel), (offset_ns, total_s)) in scheduled {
            let frames_ns = (total_s * 1e9) as u64;
            let is_phase = offset_ns < sync0_ns;
            if is_phase && u64::from(offset_ns) + frames_ns > u64::from(sync0_ns) {
                self.warnings.push(PortWarning::ScheduleOverruns {
                    slave,
                    channel,
                    offset_ns,
                    frames_ns,
                    sync0_ns,
                });
            }
        }
    }
}

/// Frames of all cycles that lie in a Sync0 period: they wait for the same pulse.
fn frames_at_a_pulse(rate: FrameRate, cycle_ns: u32, sync0_ns: u32) -> u32 {
    let cycles = (sync0_ns / cycle_ns.max(1)).max(1);
    match rate {
        FrameRate::PerCycle(frames) => frames.saturating_mul(cycles),
        FrameRate::EveryCycles(every) => cycles.div_ceil(every.max(1)),
        FrameRate::PerSecond(_) => rate.peak(cycle_ns.max(sync0_ns)),
    }
}
