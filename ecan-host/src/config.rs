//! What the Adapter is told: plain data, checked as a whole by [`AdapterConfig::check`].

use std::fmt;

use crate::startup::StartupStep;

/// Vendor id and product code of a slave (object 0x1018).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Identity {
    /// Vendor id, 0x1018:01.
    pub vendor_id: u32,
    /// Product code, 0x1018:02.
    pub product_code: u32,
}

impl fmt::Display for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "vendor 0x{:08X} product 0x{:08X}", self.vendor_id, self.product_code)
    }
}

/// Which clock the others follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ClockSource {
    /// The host's: each cycle the reference clock is corrected to the application's time, and the
    /// other slaves to the reference clock.
    #[default]
    Host,
    /// The reference clock's: a phase-locked loop shifts the points of the host's cycle until the
    /// frames pass it in phase. Sync0 is as even as the slave's oscillator then, and the delays of
    /// the host never reach it.
    ///
    /// The loop acts on [`Adapter::wait_next_cycle`](crate::Adapter::wait_next_cycle); an
    /// application with a cycle timer of its own adds
    /// [`Adapter::clock_correction_ns`](crate::Adapter::clock_correction_ns) to its next deadline.
    Reference,
}

/// Distributed clocks with Sync0 (manual 8.4, 15.6).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DcSync {
    /// Sync0 period in nanoseconds; a whole multiple of the cycle, normally the cycle itself.
    pub cycle_ns: u32,
    /// Phase of Sync0 against the start of the period, in nanoseconds, below `cycle_ns`.
    ///
    /// Outputs must have arrived before it (manual 15.6.1 lists proven values, 16.1 what happens
    /// when it is too small).
    pub shift_ns: u32,
    /// AssignActivate word of the slave. The manual does not name it; see docs/ASSUMPTIONS.md.
    pub assign_activate: u16,
    /// Which clock the others follow.
    pub source: ClockSource,
    /// Index of the slave whose clock is the reference; none takes the first on the bus that has
    /// one.
    pub reference: Option<usize>,
    /// Every so many cycles the differences between the slaves' clocks are measured, for
    /// [`ClockStatus::synchrony_ns`](crate::ClockStatus::synchrony_ns); 0 is never.
    pub monitor_every: u32,
}

impl DcSync {
    /// Sync0 once per `cycle_ns`, `shift_ns` after its start. The host's clock leads, the first
    /// slave is the reference, and the differences are measured every 100 cycles.
    pub fn new(cycle_ns: u32, shift_ns: u32) -> Self {
        Self {
            cycle_ns,
            shift_ns,
            assign_activate: 0x0300,
            source: ClockSource::Host,
            reference: None,
            monitor_every: 100,
        }
    }
}

/// One gateway on the bus.
#[derive(Debug, Clone, PartialEq)]
pub struct SlaveConfig {
    /// Station alias that `position` counts from; 0 counts from the start of the bus.
    pub alias: u16,
    /// Ring position, relative to the slave that has `alias`.
    pub position: u16,
    /// Size of the RxPDO (master to slave) in chunks of 128 bytes, the manual's N (5.2).
    pub rx_multiplier: u8,
    /// Size of the TxPDO (slave to master) in chunks of 128 bytes.
    pub tx_multiplier: u8,
    /// A fixed identity. `None` takes the identity of the slave found at the position and checks
    /// by content that it is an ECAN-Lite.
    pub identity: Option<Identity>,
    /// What the layer above needs, in order, at every (re)configuration: checks that come first
    /// run before the PDO assignment. The MCAN Port puts its own steps here, in place of those it
    /// finds.
    pub base_startup: Vec<StartupStep>,
    /// What the application adds, after that.
    pub startup: Vec<StartupStep>,
}

impl SlaveConfig {
    /// The slave at `position`, counted from the start of the bus, with N = `multiplier` both ways.
    pub fn at(position: u16, multiplier: u8) -> Self {
        Self {
            alias: 0,
            position,
            rx_multiplier: multiplier,
            tx_multiplier: multiplier,
            identity: None,
            base_startup: Vec::new(),
            startup: Vec::new(),
        }
    }
}

/// The whole configuration of an [`Adapter`](crate::Adapter).
///
/// Plain data: build it, change it, [`check`](Self::check) it as often as needed; nothing touches
/// the bus before [`Adapter::open`](crate::Adapter::open).
#[derive(Debug, Clone, PartialEq)]
pub struct AdapterConfig {
    /// Index of the EtherCAT master, 0 for `/dev/EtherCAT0`.
    pub master_index: u32,
    /// The gateways; their index here is the slave index in every call.
    pub slaves: Vec<SlaveConfig>,
    /// Period of the application's cycle in nanoseconds, shorter than the watchdog.
    pub cycle_ns: u32,
    /// Distributed clocks with Sync0; `None` runs synchronous to process data ("SM/free").
    pub dc: Option<DcSync>,
    /// States that the installed master carries process data of more than one datagram per sync
    /// manager. Without it N is limited to 11 per direction.
    pub allow_large_pdos: bool,
    /// How long the slaves may take to answer in PREOP, in milliseconds, before `open` and
    /// `reconfigure` give up.
    pub preop_timeout_ms: u32,
    /// Process data watchdog of every gateway in microseconds, a multiple of 100 from 100 to
    /// 6 553 500: when no outputs have come for so long a gateway leaves OP for SAFEOP (AL status
    /// code 0x001B), and sends no frame of the application any more. Longer than two cycles, or a
    /// single lost frame ends operation. It is always written, as a gateway keeps what the last
    /// application told it until its power goes.
    pub watchdog_us: u32,
}

/// Unit of the watchdog in microseconds: what the divider in 0x0400 makes of a slave's clock at
/// power-up. It is left alone, as not every slave controller takes another.
pub(crate) const WATCHDOG_UNIT_US: u32 = 100;
/// Longest watchdog in microseconds: the register has 16 bits.
pub(crate) const MAX_WATCHDOG_US: u32 = 0xFFFF * WATCHDOG_UNIT_US;

impl AdapterConfig {
    /// `count` slaves from position 0 on, N = 3 (384 bytes, classic CAN, manual 5.2) and the
    /// manual's first cycle of 10 ms (15.5.2); the watchdog is the 100 ms that slaves have by
    /// default (H34 of docs/ASSUMPTIONS.md).
    pub fn new(count: u16) -> Self {
        Self {
            master_index: 0,
            slaves: (0..count).map(|p| SlaveConfig::at(p, 3)).collect(),
            cycle_ns: 10_000_000,
            dc: None,
            allow_large_pdos: false,
            preop_timeout_ms: 10_000,
            watchdog_us: 100_000,
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

    /// Sets the cycle in microseconds.
    pub fn with_cycle_us(mut self, cycle_us: u32) -> Self {
        self.cycle_ns = cycle_us.saturating_mul(1_000);
        self
    }

    /// Sets the process data watchdog in microseconds.
    pub fn with_watchdog_us(mut self, watchdog_us: u32) -> Self {
        self.watchdog_us = watchdog_us;
        self
    }
}
