//! The preflight plan of the EtherCAT side: what a configuration costs before it touches a bus.

mod domain_layout;
mod ethernet;
mod plan_error;
mod sync0;

pub use domain_layout::{DomainLayout, LogicalCommand, MAX_DATAGRAM_BYTES, MAX_PLAIN_MULTIPLIER};
pub use ethernet::{
    BYTE_NS, DATAGRAM_OVERHEAD_BYTES, Datagram, DatagramUse, EthernetFrame, FRAME_OVERHEAD_BYTES,
};
pub use plan_error::{PlanError, PlanWarning};
pub use sync0::{ImageTimes, OutputArrivals};

use crate::config::{AdapterConfig, ClockSource, DcSync};

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
        let frames = ethernet::pack(process_data.chain(std::iter::repeat_n(clock, clocks)));
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
    use super::LogicalCommand::Read;
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
