//! Reports of `ecan-sim wire`: changes of the gateways, turnaround times, and counters at the end.

use std::fmt;
use std::fmt::Write;
use std::time::SystemTime;

use ecan_protocol::device::{AlState, AlStatusCode};
use ecan_protocol::mapping::CHANNELS;
use ecan_sim::{Wire, World};
use hdrhistogram::Histogram;

use crate::failure::Screen;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct GatewayView {
    is_responding: bool,
    is_reachable: bool,
    state: AlState,
    error: Option<AlStatusCode>,
}

impl GatewayView {
    fn of(world: &World, index: usize) -> Option<Self> {
        let gateway = world.gateway(index)?;
        Some(Self {
            is_responding: gateway.is_responding(),
            is_reachable: world.is_reachable(index),
            state: gateway.al_state(),
            error: gateway.al_error().then(|| AlStatusCode(gateway.al_status_code())),
        })
    }

    /// Describes the change since `before`; `None` if it is not relevant.
    fn changes_since(&self, before: &Self) -> Option<String> {
        match (before.is_responding, self.is_responding) {
            (true, false) => return Some("off or restarting".to_owned()),
            (false, false) => return None,
            (false, true) => return Some(format!("booted, {}", self.state)),
            (true, true) => {}
        }
        let mut parts = Vec::new();
        if before.is_reachable != self.is_reachable {
            let text = if self.is_reachable { "link restored" } else { "link lost" };
            parts.push(text.to_owned());
        }
        if before.state != self.state {
            parts.push(format!("{} -> {}", before.state, self.state));
        }
        match self.error {
            Some(code) if before.error != Some(code) => {
                let mut text = String::new();
                if before.state == self.state {
                    let _ = write!(text, "{}, ", self.state);
                }
                let _ = write!(text, "AL error {code}");
                parts.push(text);
            }
            None if before.error.is_some() && before.state == self.state => {
                parts.push(format!("{}, AL error acknowledged", self.state));
            }
            _ => {}
        }
        (!parts.is_empty()).then(|| parts.join(", "))
    }
}

#[derive(Debug, Clone)]
pub struct Watch {
    views: Vec<GatewayView>,
}

impl Watch {
    pub fn new(world: &World) -> Self {
        Self {
            views: (0..world.gateway_count()).filter_map(|i| GatewayView::of(world, i)).collect(),
        }
    }

    /// Reports each change since the last call: the gateway and a description.
    pub fn poll(&mut self, world: &World, mut report: impl FnMut(usize, String)) {
        for (index, before) in self.views.iter_mut().enumerate() {
            let Some(now) = GatewayView::of(world, index) else { continue };
            if now == *before {
                continue;
            }
            if let Some(text) = now.changes_since(before) {
                report(index, text);
            }
            *before = now;
        }
    }
}

/// Maximum recorded time, ns: a minute.
const LONGEST_NS: u64 = 60_000_000_000;

/// The system's real-time clock in nanoseconds, which also gives arrival times.
pub fn real_time_ns() -> u64 {
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    u64::try_from(now.as_nanos()).unwrap_or(u64::MAX)
}

#[derive(Debug, Clone)]
pub struct Turnaround {
    total: Histogram<u64>,
    computing: Histogram<u64>,
}

impl Turnaround {
    pub fn new() -> Self {
        // infallible: the bounds are in order, and 3 digits are supported
        let histogram = || Histogram::new_with_bounds(1, LONGEST_NS, 3).expect("valid bounds");
        Self { total: histogram(), computing: histogram() }
    }

    /// Counts a frame taken at `taken_ns` and sent back at `sent_ns`, both by the clock of the
    /// arrival time.
    pub fn count(&mut self, arrived_ns: Option<u64>, taken_ns: u64, sent_ns: u64) {
        let since = |from: u64| sent_ns.saturating_sub(from).max(1);
        self.total.saturating_record(since(arrived_ns.unwrap_or(taken_ns)));
        self.computing.saturating_record(since(taken_ns));
    }
}

impl fmt::Display for Turnaround {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.total.is_empty() {
            return write!(f, "turnaround: no frame answered");
        }
        let us = |ns: u64| ns as f64 / 1000.0;
        let figures = |histogram: &Histogram<u64>| {
            let at = |quantile| us(histogram.value_at_quantile(quantile));
            (at(0.5), at(0.99), us(histogram.max()))
        };
        let (median, p99, max) = figures(&self.total);
        writeln!(
            f,
            "turnaround: median {median:.1} us, p99 {p99:.1} us, max {max:.1} us, from the arrival \
             at the interface to the answer"
        )?;
        let (median, p99, max) = figures(&self.computing);
        write!(
            f,
            "  of which in the program: median {median:.1} us, p99 {p99:.1} us, max {max:.1} us"
        )
    }
}

/// `dropped`: frames lost in the system's queue; `unsent`: answers that did not fit the interface's
/// queue.
pub fn print_summary(wire: &Wire, dropped: u64, unsent: u64, screen: Screen) {
    let statistics = wire.statistics();
    screen.line(format_args!(
        "frames: {} EtherCAT, {} faulty, {} foreign, {} lost; {dropped} dropped by the system, \
         {unsent} answers not sent",
        statistics.frames, statistics.faulty, statistics.foreign, statistics.lost,
    ));
    let world = wire.world();
    for (index, gateway) in (0..).map_while(|index| Some((index, world.gateway(index)?))) {
        let counters = gateway.counters();
        screen.line(format_args!(
            "gateway {index}: {}, {} images received, {} sent, {} frames to the buses, {} from them",
            gateway.al_state(),
            counters.images_parsed,
            counters.images_read,
            counters.frames_on_bus,
            counters.frames_to_master,
        ));
        for channel in 0..CHANNELS {
            let (Some(bus), Some(station)) =
                (world.bus_of(index, channel), world.channel_statistics(index, channel))
            else {
                continue;
            };
            screen.line(format_args!(
                "  can{channel} on bus {}: {} sent, {} received, {} error frames on the bus",
                bus.name(),
                station.transmitted,
                station.received,
                bus.statistics().error_frames,
            ));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_are_described() {
        let off = GatewayView {
            is_responding: false,
            is_reachable: false,
            state: AlState::Init,
            error: None,
        };
        let op = GatewayView {
            is_responding: true,
            is_reachable: true,
            state: AlState::Op,
            error: None,
        };
        let init = GatewayView { state: AlState::Init, ..op };
        let watchdog = Some(AlStatusCode::SM_WATCHDOG);
        let fallen = GatewayView { state: AlState::SafeOp, error: watchdog, ..op };
        let rejected = GatewayView { error: Some(AlStatusCode::MAILBOX_CONFIGURATION), ..init };
        let cases = [
            (off, init, Some("booted, INIT")),
            (op, off, Some("off or restarting")),
            (off, GatewayView { state: AlState::PreOp, ..off }, None),
            (init, GatewayView { state: AlState::PreOp, ..init }, Some("INIT -> PREOP")),
            (
                op,
                fallen,
                Some(
                    "OP -> SAFEOP, AL error 0x001B sync manager watchdog: outputs did not arrive \
                     in time",
                ),
            ),
            (fallen, GatewayView { error: None, ..fallen }, Some("SAFEOP, AL error acknowledged")),
            (init, rejected, Some("INIT, AL error 0x0016 invalid mailbox configuration for PREOP")),
            (op, GatewayView { is_reachable: false, ..op }, Some("link lost")),
        ];
        for (before, now, text) in cases {
            assert_eq!(now.changes_since(&before).as_deref(), text, "{before:?} {now:?}");
        }
    }

    #[test]
    fn turnaround_is_measured_from_arrival_and_from_program() {
        let mut turnaround = Turnaround::new();
        assert_eq!(turnaround.to_string(), "turnaround: no frame answered");
        turnaround.count(Some(10_000), 14_000, 16_000);
        turnaround.count(None, 14_000, 16_000);
        turnaround.count(Some(20_000), 14_000, 16_000);
        let printed = turnaround.to_string();
        assert!(
            printed.starts_with("turnaround: median 2.0 us, p99 6.0 us, max 6.0 us"),
            "{printed}"
        );
        assert!(printed.ends_with("median 2.0 us, p99 2.0 us, max 2.0 us"), "{printed}");
    }
}
