//! Configuration of an [`Adapter`](crate::Adapter) as plain data.

use std::fmt;
use std::time::Duration;

use ecan_protocol::config::{List, ListFull};
use ecan_protocol::object::SdoWrite;
use ecan_protocol::sequence::{Expectation, Step};

/// Largest number of slaves of a configuration.
pub const MAX_SLAVES: usize = 32;
/// Largest number of startup steps that the application adds, over all slaves.
pub const MAX_STARTUP_STEPS: usize = 256;

// The fields have the numbers themselves: with named constants rustc 1.95 fails ("broken MIR") at a
// closure that contains `AdapterConfig { .., ..config }`.
const _: () = assert!(MAX_SLAVES == 32 && MAX_STARTUP_STEPS == 256);

/// Unit of the watchdog: one interval of the divider that a slave has in 0x0400 at power-up. The
/// divider is never written, because not every slave controller accepts another one.
pub(crate) const WATCHDOG_UNIT: Duration = Duration::from_micros(100);
/// Longest watchdog: the register has 16 bits.
pub(crate) const MAX_WATCHDOG: Duration = Duration::from_micros(100 * 0xFFFF);

/// Vendor ID and product code of a slave (object 0x1018).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Identity {
    /// Vendor ID, 0x1018:01.
    pub vendor_id: u32,
    /// Product code, 0x1018:02.
    pub product_code: u32,
}

impl fmt::Display for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "vendor 0x{:08X} product 0x{:08X}", self.vendor_id, self.product_code)
    }
}

/// One gateway on the bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SlaveConfig {
    /// Station alias that `position` counts from; 0 counts from the start of the bus.
    pub alias: u16,
    /// Position on the bus, relative to the slave with this `alias`.
    pub position: u16,
    /// Size of the RxPDO (master to slave) in chunks of 128 bytes, the manual's N (5.2).
    pub rx_multiplier: u8,
    /// Size of the TxPDO (slave to master) in chunks of 128 bytes.
    pub tx_multiplier: u8,
    /// A fixed identity. `None` accepts the identity of the slave at the position and verifies from
    /// its object contents that it is an ECAN-Lite.
    pub identity: Option<Identity>,
}

impl SlaveConfig {
    /// The slave at `position`, counted from the start of the bus, with N = `multiplier` in both
    /// directions.
    pub fn at(position: u16, multiplier: u8) -> Self {
        Self {
            alias: 0,
            position,
            rx_multiplier: multiplier,
            tx_multiplier: multiplier,
            identity: None,
        }
    }
}

/// The first slave on the bus, with N = 3 (384 bytes, classic CAN, manual 5.2).
impl Default for SlaveConfig {
    fn default() -> Self {
        Self::at(0, 3)
    }
}

/// A startup step that the application adds to a slave.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct StartupEntry {
    /// Slave index.
    pub slave: usize,
    /// The step.
    pub step: StartupStep,
}

/// Configuration of an [`Adapter`](crate::Adapter).
///
/// Plain data: build it, change it, [`check`](Self::check) it as often as needed; nothing touches
/// the bus before [`Adapter::open`](crate::Adapter::open).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct AdapterConfig {
    /// Index of the EtherCAT master, 0 for `/dev/EtherCAT0`.
    pub master_index: u32,
    /// The gateways; the index in this list is the slave index in every call.
    pub slaves: List<SlaveConfig, 32>,
    /// Startup steps that the application adds, executed in this order after those of the
    /// [`StartupPlan`](crate::StartupPlan), at every (re)configuration.
    pub startup: List<StartupEntry, 256>,
    /// Period of the application's cycle, 100 us to 100 ms and shorter than the watchdog.
    pub cycle: Duration,
    /// Distributed clocks with Sync0; `None` runs synchronous to process data ("SM/free").
    pub dc: Option<DcSync>,
    /// States that the installed master carries process data of more than one datagram per sync
    /// manager. Without it N is limited to 11 per direction.
    pub allow_large_pdos: bool,
    /// Time in which the slaves must answer in PREOP, before `open` and `reconfigure` fail.
    pub preop_timeout: Duration,
    /// Process data watchdog of every gateway, a multiple of 100 us from 100 us to 6.5535 s: a
    /// gateway that receives no outputs for this time changes from OP to SAFEOP (AL status code
    /// 0x001B) and sends no more frames of the application. It must be longer than two cycles, or a
    /// single lost frame ends operation. It is always written, because a gateway keeps the value of
    /// the last application until its power is switched off.
    pub watchdog: Duration,
}

impl AdapterConfig {
    /// `count` slaves from position 0 on (at most [`MAX_SLAVES`]), N = 3 (384 bytes, classic CAN,
    /// manual 5.2) and the manual's first cycle of 10 ms (15.5.2); the watchdog is the slaves'
    /// default of 100 ms (H34 of docs/ASSUMPTIONS.md).
    pub fn new(count: u16) -> Self {
        let slaves = (0..count).take(MAX_SLAVES).map(|p| SlaveConfig::at(p, 3));
        Self {
            master_index: 0,
            slaves: List::collect(slaves).unwrap_or_default(),
            startup: List::new(),
            cycle: Duration::from_millis(10),
            dc: None,
            allow_large_pdos: false,
            preop_timeout: Duration::from_secs(10),
            watchdog: Duration::from_millis(100),
        }
    }

    /// Sets N of both directions on every slave.
    pub fn with_multiplier(mut self, multiplier: u8) -> Self {
        for slave in &mut self.slaves {
            slave.rx_multiplier = multiplier;
            slave.tx_multiplier = multiplier;
        }
        self
    }

    /// Sets the cycle.
    pub fn with_cycle(mut self, cycle: Duration) -> Self {
        self.cycle = cycle;
        self
    }

    /// Sets the process data watchdog.
    pub fn with_watchdog(mut self, watchdog: Duration) -> Self {
        self.watchdog = watchdog;
        self
    }

    /// The cycle in nanoseconds; a longer one than any that [`check`](Self::check) accepts is cut
    /// to `u32::MAX`.
    pub fn cycle_ns(&self) -> u32 {
        nanoseconds(self.cycle)
    }

    /// The startup steps that the application adds to a slave, in their order.
    pub fn startup_of(&self, slave: usize) -> impl Iterator<Item = StartupStep> + '_ {
        self.startup.iter().filter(move |entry| entry.slave == slave).map(|entry| entry.step)
    }

    /// Adds a startup step to a slave.
    ///
    /// # Errors
    /// [`ListFull`]: there are [`MAX_STARTUP_STEPS`] steps.
    pub fn add_startup(
        &mut self,
        slave: usize,
        step: impl Into<StartupStep>,
    ) -> Result<(), ListFull> {
        self.startup.push(StartupEntry { slave, step: step.into() })
    }
}

/// The clock that the other clocks follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum ClockSource {
    /// The host's clock: each cycle corrects the reference clock to the application's time, and the
    /// other slaves to the reference clock.
    #[default]
    Host,
    /// The reference clock: a phase-locked loop shifts the deadlines of the host's cycle until the
    /// frames pass the reference slave in phase. Sync0 is then as regular as that slave's
    /// oscillator, independent of the host's delays.
    ///
    /// The loop acts on [`Adapter::wait_next_cycle`](crate::Adapter::wait_next_cycle); an
    /// application with its own cycle timer adds
    /// [`Adapter::clock_correction_ns`](crate::Adapter::clock_correction_ns) to its next deadline.
    Reference,
}

/// Distributed clocks with Sync0 (manual 8.4, 15.6).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DcSync {
    /// Sync0 period; a whole multiple of the cycle, normally the cycle itself.
    pub cycle: Duration,
    /// Phase of Sync0 relative to the start of the period, below `cycle`.
    ///
    /// Outputs must arrive before it (manual 15.6.1 lists proven values; 16.1 describes the effect
    /// of a value that is too small). [`DcSync::planned`] chooses it; the
    /// [`Plan`](crate::Plan) warns of one among the arrivals of the outputs.
    pub shift: Duration,
    /// AssignActivate word of the slave. The manual does not state it; see docs/ASSUMPTIONS.md.
    pub assign_activate: u16,
    /// The clock that the other clocks follow.
    pub source: ClockSource,
    /// Index of the slave with the reference clock; `None` selects the first slave on the bus that
    /// has a clock.
    pub reference: Option<usize>,
    /// Period, in cycles, of the measurement of the differences between the slaves' clocks, for
    /// [`ClockStatus::synchrony_ns`](crate::ClockStatus::synchrony_ns); 0 disables it.
    pub monitor_every: u32,
}

/// At most `u32::MAX`, which the check of a configuration rejects as too long.
fn nanoseconds(duration: Duration) -> u32 {
    u32::try_from(duration.as_nanos()).unwrap_or(u32::MAX)
}

impl DcSync {
    /// Sync0 once per `cycle`, `shift` after its start. The slaves follow the host's clock,
    /// the first slave is the reference, and the differences are measured every 100 cycles.
    pub fn new(cycle: Duration, shift: Duration) -> Self {
        Self {
            cycle,
            shift,
            assign_activate: 0x0300,
            source: ClockSource::Host,
            reference: None,
            monitor_every: 100,
        }
    }

    /// `cycle` in nanoseconds, at most `u32::MAX`.
    pub fn cycle_ns(&self) -> u32 {
        nanoseconds(self.cycle)
    }

    /// `shift` in nanoseconds, at most `u32::MAX`.
    pub fn shift_ns(&self) -> u32 {
        nanoseconds(self.shift)
    }
}

/// Every fault of a configuration, in the order of its fields.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Faults<F>(pub Vec<F>);

impl<F> Faults<F> {
    /// The outcome of a check that found these faults.
    ///
    /// # Errors
    /// The faults, if there are any.
    pub fn check(faults: Vec<F>) -> Result<(), Self> {
        if faults.is_empty() { Ok(()) } else { Err(Self(faults)) }
    }
}

impl<F: fmt::Display> fmt::Display for Faults<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0.as_slice() {
            [one] => write!(f, "{one}"),
            all => {
                write!(f, "{} faults in the configuration", all.len())?;
                all.iter().try_for_each(|fault| write!(f, "\n  - {fault}"))
            }
        }
    }
}

impl<F: fmt::Debug + fmt::Display> std::error::Error for Faults<F> {}

/// One step of a slave's startup: a [`Step`] that every EtherCAT master can execute or export.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum StartupStep {
    /// Writes an object. Registered with the master, which sends it in PREOP whenever it configures
    /// the slave.
    Download(SdoWrite),
    /// Reads an object and fails if it has another value: a capability, or the readback of an apply
    /// command. Executed before the bus is active if it leads the startup, or if the application added
    /// it; in that case the slave's whole startup is executed then, which takes tens of milliseconds
    /// for each SDO. Not executed when the master configures the slave again.
    Expect {
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// Condition on its value.
        expected: Expectation,
    },
}

impl From<SdoWrite> for StartupStep {
    fn from(write: SdoWrite) -> Self {
        Self::Download(write)
    }
}

impl From<StartupStep> for Step {
    fn from(step: StartupStep) -> Self {
        match step {
            StartupStep::Download(write) => write.into(),
            StartupStep::Expect { index, subindex, expected } => {
                Self::expect_that(index, subindex, expected)
            }
        }
    }
}

impl Default for StartupStep {
    fn default() -> Self {
        Self::Download(SdoWrite::default())
    }
}

impl StartupStep {
    /// A step that expects an object to have this value.
    pub fn expect(index: u16, subindex: u8, value: u32) -> Self {
        Self::Expect { index, subindex, expected: Expectation::Equals(value.into()) }
    }

    /// Index and subindex of the object.
    pub fn object(&self) -> (u16, u8) {
        match self {
            Self::Download(sdo) => (sdo.index, sdo.subindex),
            Self::Expect { index, subindex, .. } => (*index, *subindex),
        }
    }

    /// Returns whether the step writes.
    pub fn is_download(&self) -> bool {
        matches!(self, Self::Download(_))
    }
}
