//! Configuration of the Adapter: plain data, checked as a whole by [`AdapterConfig::check`].

use std::fmt;
use std::time::Duration;

use ecan_protocol::config::{List, ListFull};

use super::dc_sync::{DcSync, nanoseconds};
use crate::startup::StartupStep;

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
