//! The preflight plan of the EtherCAT side: what a configuration costs before it touches a bus.

use std::time::Duration;

use ecan_protocol::mapping::CHUNK_BYTES;
use thiserror::Error;

use crate::config::{AdapterConfig, ClockSource, DcSync};
use crate::exchange::{
    BYTE_NS, DATAGRAM_OVERHEAD_BYTES, Datagram, DatagramUse, DomainLayout, EthernetFrame,
    FRAME_OVERHEAD_BYTES, MAX_DATAGRAM_BYTES, MAX_PLAIN_MULTIPLIER,
};

/// Data of a datagram of the clocks: the low half of the system time.
const CLOCK_BYTES: usize = 4;
/// Room that a mailbox transfer needs in a cycle: all the room that a gateway has for mailboxes
/// (manual 5.3: 0x1000 to 0x10FF), in a frame of its own.
const MAILBOX_BYTES: usize = 256 + DATAGRAM_OVERHEAD_BYTES + FRAME_OVERHEAD_BYTES;
/// Time that a frame may take through the host's driver and queues, both ways together.
const HOST_NS: u64 = 60_000;
/// Time that a frame takes through a slave, both ways together.
const SLAVE_NS: u64 = 1_000;
/// Share of the cycle on the wire from which a plan warns, in percent.
const WIRE_WARNING_PERCENT: u64 = 80;

/// One slave in the plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SlavePlan {
    /// Sizes of its process data, and what follows from them: datagrams and working counter.
    pub layout: DomainLayout,
    /// When its RxPDO image has arrived, in nanoseconds after the master began to send.
    pub outputs_arrive_ns: u64,
}

/// Bandwidth for the master's mailbox traffic, in addition to the process data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MailboxBandwidth {
    /// Bytes that the master lets through per send interval before it holds mailbox traffic back:
    /// 11.25 a microsecond, 90 % of 100 Mbit/s.
    pub available_bytes: usize,
    /// Bytes of them that process data and clocks take on the wire.
    pub process_bytes: usize,
}

impl MailboxBandwidth {
    /// Bytes that are left, 0 where there are none.
    pub fn headroom_bytes(&self) -> usize {
        self.available_bytes.saturating_sub(self.process_bytes)
    }

    /// Number of largest mailbox transfers that fit into a cycle after the process data.
    pub fn transfers(&self) -> usize {
        self.headroom_bytes() / MAILBOX_BYTES
    }
}

/// Load of a configuration on the EtherCAT line in every cycle, and its consequences (manual 5.2,
/// 15.6.1).
///
/// Only arithmetic: it asks neither a master nor a slave, and any configuration has a plan, sound
/// or not. It counts the Adapter's own datagrams; the master sends few and small ones besides, and
/// on a shared bus the owner's come on top.
///
/// ```
/// use std::time::Duration;
///
/// use ecan_host::{AdapterConfig, Plan};
///
/// let config = AdapterConfig::new(3).with_multiplier(5).with_cycle(Duration::from_millis(1));
/// let plan = Plan::of(&config);
/// assert_eq!(plan.frames.len(), 3);
/// assert_eq!(plan.expected_working_counter((1, 6)), 9);
/// assert!(plan.rejections.is_empty() && plan.warnings.is_empty());
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The cycle in nanoseconds.
    pub cycle_ns: u32,
    /// One entry per slave.
    pub slaves: Vec<SlavePlan>,
    /// The Ethernet frames of a cycle, in their order.
    pub frames: Vec<EthernetFrame>,
    /// Room for mailbox traffic.
    pub mailbox: MailboxBandwidth,
    /// Errors: the configuration does not work.
    pub rejections: Vec<PlanError>,
    /// Warnings: it works with little margin.
    pub warnings: Vec<PlanWarning>,
    arrivals: Option<OutputArrivals>,
}

impl Plan {
    /// The plan of a configuration, with the default [`ImageTimes`]. Allocates; not for the cycle.
    pub fn of(config: &AdapterConfig) -> Self {
        Self::with_times(config, |_| ImageTimes::default())
    }

    /// The plan of a configuration with the times of each slave by its index. Allocates; not for the
    /// cycle.
    pub fn with_times(config: &AdapterConfig, times: impl Fn(usize) -> ImageTimes) -> Self {
        let layouts: Vec<DomainLayout> = config
            .slaves
            .iter()
            .map(|s| DomainLayout::new(s.rx_multiplier, s.tx_multiplier))
            .collect();
        let process_data = layouts.iter().enumerate().flat_map(|(slave, layout)| {
            layout.datagrams().map(move |(command, data_bytes)| Datagram {
                purpose: DatagramUse::ProcessData { slave, command },
                data_bytes,
            })
        });
        let clocks = config.dc.map_or(0, clock_datagrams);
        let clock = Datagram { purpose: DatagramUse::Clock, data_bytes: CLOCK_BYTES };
        let frames = crate::exchange::pack(process_data.chain(std::iter::repeat_n(clock, clocks)));
        let slaves = layouts
            .into_iter()
            .enumerate()
            .map(|(slave, layout)| SlavePlan {
                layout,
                outputs_arrive_ns: outputs_arrive_ns(&frames, slave),
            })
            .collect();
        let mailbox = MailboxBandwidth {
            available_bytes: (u64::from(config.cycle_ns()) * 1125 / 100_000) as usize,
            process_bytes: frames.iter().map(EthernetFrame::wire_bytes).sum(),
        };
        let mut plan = Self {
            cycle_ns: config.cycle_ns(),
            slaves,
            frames,
            mailbox,
            arrivals: None,
            rejections: Vec::new(),
            warnings: Vec::new(),
        };
        plan.check_sizes(config);
        plan.check_time();
        plan.check_watchdog(config);
        plan.check_sync0(config.dc, times);
        plan
    }

    fn check_sizes(&mut self, config: &AdapterConfig) {
        if config.allow_large_pdos {
            return;
        }
        for (slave, settings) in config.slaves.iter().enumerate() {
            let sizes = [("RxPDO", settings.rx_multiplier), ("TxPDO", settings.tx_multiplier)];
            for (pdo, multiplier) in sizes {
                if multiplier > MAX_PLAIN_MULTIPLIER {
                    self.rejections.push(PlanError::LargePdo { slave, pdo, multiplier });
                }
            }
        }
    }

    fn check_time(&mut self) {
        let (wire_ns, cycle_ns) = (self.wire_ns(), self.cycle_ns);
        let cycle = u64::from(cycle_ns);
        let (transfers, slaves) = (self.mailbox.transfers(), self.slaves.len());
        if wire_ns > cycle {
            // That mailbox traffic starves, too, goes without saying.
            self.rejections.push(PlanError::WireTime { wire_ns, cycle_ns });
            return;
        }
        if transfers == 0 {
            self.rejections.push(PlanError::MailboxStarved {
                needed: self.mailbox.process_bytes + MAILBOX_BYTES,
                available: self.mailbox.available_bytes,
                cycle_ns,
            });
        } else if transfers < slaves {
            self.warnings.push(PlanWarning::MailboxTight { transfers, slaves });
        }
        if wire_ns * 100 > cycle * WIRE_WARNING_PERCENT {
            self.warnings.push(PlanWarning::WireTime { wire_ns, cycle_ns });
        }
    }

    fn check_watchdog(&mut self, config: &AdapterConfig) {
        let watchdog_us = u32::try_from(config.watchdog.as_micros()).unwrap_or(u32::MAX);
        let cycle_ns = self.cycle_ns;
        let (watchdog_ns, cycle) = (u64::from(watchdog_us) * 1_000, u64::from(cycle_ns));
        if watchdog_ns <= cycle {
            self.rejections.push(PlanError::Watchdog { watchdog_us, cycle_ns });
        } else if watchdog_ns <= 2 * cycle {
            self.warnings.push(PlanWarning::WatchdogTight { watchdog_us, cycle_ns });
        }
    }

    /// The datagrams of a cycle in their order.
    pub fn datagrams(&self) -> impl Iterator<Item = &Datagram> {
        self.frames.iter().flat_map(|frame| &frame.datagrams)
    }

    /// Bytes of process data per cycle, both directions of all slaves.
    pub fn process_data_bytes(&self) -> usize {
        self.slaves.iter().map(|s| s.layout.rx_bytes + s.layout.tx_bytes).sum()
    }

    /// Bytes on the wire per cycle: preamble, headers, check sequences and gaps included.
    pub fn wire_bytes(&self) -> usize {
        self.mailbox.process_bytes
    }

    /// Time on the wire per cycle in nanoseconds, at 100 Mbit/s. The way through host and slaves
    /// comes on top of it until a frame is back.
    pub fn wire_ns(&self) -> u64 {
        self.wire_bytes() as u64 * BYTE_NS
    }

    /// Time after a [`send`](crate::Adapter::send) in which its frames are expected back, in
    /// nanoseconds (H33 of docs/ASSUMPTIONS.md): their time on the wire, 1 us in each slave, and in
    /// the host 60 us, but no more than an eighth of the cycle and a quarter of what wire and slaves
    /// leave of it.
    ///
    /// An application with a cycle timer of its own does not call
    /// [`receive`](crate::Adapter::receive) before.
    pub fn response_ns(&self) -> u64 {
        let cycle = u64::from(self.cycle_ns);
        let way = self.wire_ns() + self.slaves.len() as u64 * SLAVE_NS;
        way + HOST_NS.min(cycle / 8).min(cycle.saturating_sub(way) / 4)
    }

    /// Share of the cycle that goes to the wire; 1 is all of it.
    pub fn wire_share(&self) -> f64 {
        self.wire_ns() as f64 / f64::from(self.cycle_ns.max(1))
    }

    /// Working counters of a complete exchange, summed over the slaves, for a release of
    /// libethercat such as (1, 6); that of each stands in its layout.
    pub fn expected_working_counter(&self, version: (u8, u8)) -> u32 {
        self.slaves.iter().map(|s| s.layout.expected_working_counter(version)).sum()
    }
}

/// Datagrams that keep the distributed clocks together, in the fullest cycle: one sets the reference
/// clock, one carries its time to the others, one measures how far they are apart.
fn clock_datagrams(dc: DcSync) -> usize {
    1 + usize::from(dc.source == ClockSource::Host) + usize::from(dc.monitor_every > 0)
}

/// End of the last frame that carries the slave's outputs.
fn outputs_arrive_ns(frames: &[EthernetFrame], slave: usize) -> u64 {
    use crate::LogicalCommand::Read;
    let carries = |datagram: &Datagram| match datagram.purpose {
        DatagramUse::ProcessData { slave: of, command } => of == slave && command != Read,
        DatagramUse::Clock => false,
    };
    let (mut start, mut arrival) = (0, 0);
    for frame in frames {
        if frame.datagrams.iter().any(carries) {
            arrival = start + frame.end_ns();
        }
        start += frame.wire_ns();
    }
    arrival
}

fn us(ns: u64) -> f64 {
    ns as f64 / 1e3
}

fn percent(part: u64, whole: u64) -> f64 {
    100.0 * part as f64 / whole.max(1) as f64
}

fn remedy(best_ns: Option<u32>) -> String {
    match best_ns {
        Some(ns) => format!("use a shift of {:.1} us", us(ns.into())),
        None => "no shift is usable: use a smaller N or a longer cycle".to_owned(),
    }
}

/// A configuration that does not work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PlanError {
    /// N that one datagram cannot carry, without the permission for it.
    #[error(
        "slave {slave}: {pdo} size N = {multiplier} needs {} bytes, but the IgH master puts a sync \
         manager into one datagram of at most {MAX_DATAGRAM_BYTES} bytes, so N is at most \
         {MAX_PLAIN_MULTIPLIER}; a larger one would activate and then block the whole bus. Set \
         `allow_large_pdos` (option --large-pdos) only if the installed master segments process data",
        usize::from(*multiplier) * CHUNK_BYTES
    )]
    LargePdo {
        /// Slave index.
        slave: usize,
        /// "RxPDO" or "TxPDO".
        pdo: &'static str,
        /// The configured N.
        multiplier: u8,
    },
    /// The frames of a cycle take longer than the cycle.
    #[error(
        "the frames of a cycle take {:.1} us on the wire, the cycle is {:.1} us: use a smaller N \
         or a longer cycle", us(*wire_ns), us((*cycle_ns).into())
    )]
    WireTime {
        /// Time on the wire in nanoseconds.
        wire_ns: u64,
        /// The cycle in nanoseconds.
        cycle_ns: u32,
    },
    /// The watchdog of the slaves runs out between two cycles.
    #[error(
        "the process data watchdog of {} us runs out within the cycle of {} us: no slave would stay \
         in OP. Use a longer watchdog or a shorter cycle", watchdog_us, us((*cycle_ns).into())
    )]
    Watchdog {
        /// The watchdog in microseconds.
        watchdog_us: u32,
        /// The cycle in nanoseconds.
        cycle_ns: u32,
    },
    /// The process data leave no room for mailbox traffic, so that no slave would ever reach OP.
    #[error(
        "process data of {needed} bytes per cycle with mailbox do not fit a cycle of {} us, of \
         which the master fills {available} bytes at most: its mailbox traffic would starve, and \
         no slave reach OP. Use a smaller N or a longer cycle", us((*cycle_ns).into())
    )]
    MailboxStarved {
        /// Bytes needed per cycle, with one mailbox transfer.
        needed: usize,
        /// Bytes that the master lets through in a cycle.
        available: usize,
        /// The cycle in nanoseconds.
        cycle_ns: u32,
    },
}

/// A configuration that works with little margin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PlanWarning {
    /// More than 80 % of the cycle goes to the wire.
    #[error(
        "the frames of a cycle take {:.1} us on the wire, {:.0} % of the cycle of {:.1} us: a \
         frame that is sent late is not back for the next cycle. Use a smaller N or a longer cycle",
        us(*wire_ns), percent(*wire_ns, (*cycle_ns).into()), us((*cycle_ns).into())
    )]
    WireTime {
        /// Time on the wire in nanoseconds.
        wire_ns: u64,
        /// The cycle in nanoseconds.
        cycle_ns: u32,
    },
    /// The watchdog outlasts no lost frame.
    #[error(
        "the process data watchdog of {} us is no longer than two cycles of {} us: a single lost \
         frame takes the slaves out of OP. Use a longer watchdog or a shorter cycle",
        watchdog_us, us((*cycle_ns).into())
    )]
    WatchdogTight {
        /// The watchdog in microseconds.
        watchdog_us: u32,
        /// The cycle in nanoseconds.
        cycle_ns: u32,
    },
    /// Fewer mailbox transfers fit a cycle than there are slaves.
    #[error(
        "a cycle leaves room for {transfers} mailbox transfer(s) of {slaves} slaves: start-up and \
         SDOs take longer. Use a smaller N or a longer cycle"
    )]
    MailboxTight {
        /// Mailbox transfers that fit.
        transfers: usize,
        /// Number of slaves.
        slaves: usize,
    },
    /// A Sync0 pulse falls into the arrival of the outputs.
    #[error(
        "Sync0 {:.1} us after the start of the cycle falls into the arrival of the outputs, by {:.1} \
         us: outputs that arrive around or after it are missed, with missing working counters or \
         loss of OP; {} (manual 16.1)",
        us((*shift_ns).into()), us(*lacking_ns), remedy(*best_ns)
    )]
    Sync0Shift {
        /// The shift in nanoseconds.
        shift_ns: u32,
        /// Distance to the next usable shift, in nanoseconds.
        lacking_ns: u64,
        /// The shift with the largest margin, in nanoseconds; `None` if the arrivals fill the cycle.
        best_ns: Option<u32>,
    },
}

/// Times of an image in host and firmware, in nanoseconds, without its time on the wire. The manual
/// gives none; docs/ASSUMPTIONS.md states where the defaults come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageTimes {
    /// Latest time after the deadline at which the application ends its cycle: wake-up delay and run
    /// time.
    pub latest_send_ns: u32,
    /// Through host and network card.
    pub transport_ns: u32,
    /// Time of the firmware for an image after its arrival.
    pub processing_ns: u32,
}

impl Default for ImageTimes {
    /// 45 us until the send, 30 us through the host, 50 us in the firmware: with longer ones the stable point of
    /// 640 bytes at 450 us (manual 15.6.1) would lie among the arrivals.
    fn default() -> Self {
        Self { latest_send_ns: 45_000, transport_ns: 30_000, processing_ns: 50_000 }
    }
}

/// A planned shift is a multiple of this, in nanoseconds: programs take microseconds.
const SHIFT_STEP_NS: u64 = 1_000;

/// Arrival of the outputs of all slaves in a cycle, and the firmware's work on them, in nanoseconds
/// after its deadline.
///
/// ```text
///   deadline                          next deadline
///      |     [earliest..latest]             |     [..
///      |                       '---usable shifts--'
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OutputArrivals {
    /// Earliest arrival in any slave: no earlier than the bytes of its image have passed.
    pub earliest_ns: u64,
    /// Latest time at which the firmware of any slave has them, by [`ImageTimes`].
    pub latest_ns: u64,
    /// The cycle.
    pub cycle_ns: u32,
}

impl OutputArrivals {
    /// Margin of a Sync0 shift, in nanoseconds: the distance of the pulses from the arrivals before
    /// and after them. Negative if a pulse falls into the arrivals: the distance to the next usable
    /// shift.
    ///
    /// In a longer Sync0 period the shift counts from the deadline before it.
    #[must_use]
    pub fn margin_ns(&self, shift_ns: u32) -> i64 {
        let cycle = i64::from(self.cycle_ns.max(1));
        let signed = |ns: u64| i64::try_from(ns).unwrap_or(i64::MAX / 4);
        let (earliest, latest) = (signed(self.earliest_ns), signed(self.latest_ns));
        // From the latest arrival to the first pulse after it.
        let before = (i64::from(shift_ns) - latest).rem_euclid(cycle);
        // From that pulse to the earliest arrival of the next cycle.
        let after = earliest + cycle - latest - before;
        if after >= 0 { before.min(after) } else { -(cycle - before).min(-after) }
    }

    /// The first and the last usable shift, in nanoseconds, below the cycle. The first is the larger
    /// one if the usable shifts continue in the next cycle. `None` if the arrivals fill the cycle.
    #[must_use]
    pub fn usable_shifts_ns(&self) -> Option<(u32, u32)> {
        let cycle = u64::from(self.cycle_ns.max(1));
        let last = self.earliest_ns + cycle;
        let in_cycle = |ns: u64| u32::try_from(ns % cycle).unwrap_or(0);
        (self.latest_ns <= last).then(|| (in_cycle(self.latest_ns), in_cycle(last)))
    }

    /// The shift with the largest margin, in nanoseconds: the middle of the usable ones, in whole
    /// microseconds. `None` if no shift is usable.
    #[must_use]
    pub fn best_shift_ns(&self) -> Option<u32> {
        self.usable_shifts_ns()?;
        let cycle = u64::from(self.cycle_ns.max(1));
        let middle = (self.latest_ns + self.earliest_ns + cycle) / 2 % cycle;
        let rounded = u32::try_from(middle - middle % SHIFT_STEP_NS).unwrap_or(0);
        // Rounding may leave a narrow range.
        let exact = u32::try_from(middle).unwrap_or(0);
        Some(if self.margin_ns(rounded) >= 0 { rounded } else { exact })
    }
}

impl Plan {
    /// Arrival of the outputs in the slaves; `None` without slaves.
    #[must_use]
    pub fn output_arrivals(&self) -> Option<OutputArrivals> {
        self.arrivals
    }

    fn check_sync0(&mut self, dc: Option<DcSync>, times: impl Fn(usize) -> ImageTimes) {
        let earliest = |slave: &SlavePlan| slave.layout.rx_bytes as u64 * BYTE_NS;
        let latest = |(number, slave): (usize, &SlavePlan)| {
            let ImageTimes { latest_send_ns, transport_ns, processing_ns } = times(number);
            let times = [latest_send_ns, transport_ns, processing_ns];
            slave.outputs_arrive_ns + times.map(u64::from).iter().sum::<u64>()
        };
        let earliest_ns = self.slaves.iter().map(earliest).min();
        let latest_ns = self.slaves.iter().enumerate().map(latest).max();
        self.arrivals = earliest_ns.zip(latest_ns).map(|(earliest_ns, latest_ns)| OutputArrivals {
            earliest_ns,
            latest_ns,
            cycle_ns: self.cycle_ns,
        });
        let (Some(dc), Some(arrivals)) = (dc, self.arrivals) else { return };
        let shift_ns = dc.shift_ns();
        let margin_ns = arrivals.margin_ns(shift_ns);
        if margin_ns < 0 {
            self.warnings.push(PlanWarning::Sync0Shift {
                shift_ns,
                lacking_ns: margin_ns.unsigned_abs(),
                best_ns: arrivals.best_shift_ns(),
            });
        }
    }
}

impl DcSync {
    /// Sync0 once per `cycle` with the shift that the plan of `config` recommends: the middle of the
    /// usable ones ([`OutputArrivals::best_shift_ns`]). If none is usable, the end of the latest
    /// arrival, about which the plan warns. Everything else as [`DcSync::new`].
    ///
    /// Uses the slaves, their N and the cycle that `config` has now: call it after they are set, and
    /// again when one of them changes. Its `dc` is ignored.
    ///
    /// The plan assumes the times of [`ImageTimes::default`]; [`planned_with`](Self::planned_with)
    /// takes others. A product measures its shift on the machine (manual 15.6.1) and sets it with
    /// [`DcSync::new`].
    ///
    /// ```
    /// use std::time::Duration;
    ///
    /// use ecan_host::{AdapterConfig, DcSync};
    ///
    /// let mut config = AdapterConfig::new(3).with_cycle(Duration::from_millis(1));
    /// config.dc = Some(DcSync::planned(config.cycle, &config));
    /// assert_eq!(config.dc.unwrap().shift, Duration::from_micros(677));
    /// ```
    #[must_use]
    pub fn planned(cycle: Duration, config: &AdapterConfig) -> Self {
        Self::planned_with(cycle, config, |_| ImageTimes::default())
    }

    /// [`planned`](Self::planned) with the times of each slave by its index.
    #[must_use]
    pub fn planned_with(
        cycle: Duration,
        config: &AdapterConfig,
        times: impl Fn(usize) -> ImageTimes,
    ) -> Self {
        let dc = Some(Self::new(cycle, Duration::ZERO));
        let plan = Plan::with_times(&AdapterConfig { dc, ..*config }, times);
        let shift_ns = plan.output_arrivals().map_or(0, |arrivals| {
            let latest = || arrivals.latest_ns % u64::from(arrivals.cycle_ns.max(1));
            arrivals.best_shift_ns().map_or_else(latest, u64::from)
        });
        Self::new(cycle, Duration::from_nanos(shift_ns))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn margin_is_the_distance_from_the_arrivals() {
        let arrivals = OutputArrivals { earliest_ns: 30, latest_ns: 200, cycle_ns: 1_000 };
        assert_eq!(
            [200, 300, 615, 900, 0, 30].map(|shift| arrivals.margin_ns(shift)),
            [0, 100, 415, 130, 30, 0]
        );
        assert_eq!([31, 80, 150, 199].map(|shift| arrivals.margin_ns(shift)), [-1, -50, -50, -1]);
        assert_eq!(arrivals.margin_ns(2_300), 100, "third cycle of a Sync0 period");
        assert_eq!(arrivals.usable_shifts_ns(), Some((200, 30)));
    }

    #[test]
    fn arrivals_that_fill_the_cycle_leave_no_shift() {
        let arrivals = OutputArrivals { earliest_ns: 30, latest_ns: 1_100, cycle_ns: 1_000 };
        assert_eq!((arrivals.usable_shifts_ns(), arrivals.best_shift_ns()), (None, None));
        assert!((0..1_000).all(|shift| arrivals.margin_ns(shift) < 0));
    }

    /// The stable points of the manual (15.6.1), three slaves, and shifts at which outputs do not arrive before
    /// Sync0 (16.1).
    #[test]
    fn stable_points_of_the_manual_have_margins() {
        for (cycle_ms, multiplier, points) in [
            (1, 3, &[(700, 330_720), (800, 230_720), (250, -74_680)][..]),
            (1, 4, &[(0, 40_960)]),
            (1, 5, &[(450, 2_440), (650, 202_440), (800, 251_200), (300, -147_560)]),
            (2, 6, &[(600, 147_960)]),
            (2, 10, &[(1600, 502_400), (500, -156_840)]),
        ] {
            let cycle = Duration::from_millis(cycle_ms);
            let mut config = AdapterConfig::new(3).with_multiplier(multiplier).with_cycle(cycle);
            config.dc = Some(DcSync::new(cycle, Duration::ZERO));
            let arrivals = Plan::of(&config).output_arrivals().unwrap();
            for (shift_us, margin_ns) in points {
                let found = arrivals.margin_ns(shift_us * 1_000);
                assert_eq!(found, *margin_ns, "N = {multiplier}, {shift_us} us");
            }
        }
    }

    #[test]
    fn shift_among_the_arrivals_is_a_warning() {
        let mut config = AdapterConfig::new(3).with_cycle(Duration::from_millis(1));
        let mut warnings = |dc| {
            config.dc = dc;
            Plan::of(&config).warnings
        };
        let at = |us| Some(DcSync::new(Duration::from_millis(1), Duration::from_micros(us)));
        assert_eq!(warnings(None), []);
        assert_eq!(warnings(at(700)), []);
        let expected = PlanWarning::Sync0Shift {
            shift_ns: 150_000,
            lacking_ns: 150_000 - 30_720,
            best_ns: Some(677_000),
        };
        assert_eq!(warnings(at(150)), [expected]);
        assert!(expected.to_string().ends_with("use a shift of 677.0 us (manual 16.1)"));
    }

    #[test]
    fn sync0_without_slaves_has_no_arrivals() {
        let config = AdapterConfig::new(0);
        assert_eq!(Plan::of(&config).output_arrivals(), None);
        assert_eq!(DcSync::planned(config.cycle, &config).shift, Duration::ZERO);
    }

    proptest! {
        /// No shift has a larger margin than the best one, apart from its rounding.
        #[test]
        fn best_shift_has_the_largest_margin(
            slaves in 1u16..6,
            multiplier in 1u8..12,
            cycle_us in 100u32..20_000,
            other: u32,
        ) {
            let config = AdapterConfig::new(slaves)
                .with_multiplier(multiplier)
                .with_cycle(Duration::from_micros(cycle_us.into()));
            let planned = DcSync::planned(config.cycle, &config);
            let with_dc = AdapterConfig { dc: Some(planned), ..config };
            let arrivals = Plan::of(&with_dc).output_arrivals().unwrap();
            let other = other % arrivals.cycle_ns;
            let Some(best) = arrivals.best_shift_ns() else {
                prop_assert!(arrivals.margin_ns(other) < 0);
                return Ok(());
            };
            prop_assert!(best < arrivals.cycle_ns);
            prop_assert!(arrivals.margin_ns(best) >= 0);
            prop_assert!(arrivals.margin_ns(other) <= arrivals.margin_ns(best) + 1_000);
            prop_assert_eq!(planned.shift_ns(), best);
        }
    }
}
