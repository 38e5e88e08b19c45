//! Configuration
//!
//! Plain data: it may be copied and needs no end. Nothing touches the bus before ecan_igh_init().

use std::ffi::{c_char, c_int};
use std::time::Duration;

use ecan_host::{
    AdapterConfig, DcSync, Error, Identity, SlaveConfig, StartupEntry, StartupPlan, StartupStep,
};
use ecan_mcan_host::boundary::{Call, OutArray, Plain, Sealed, call, put_text};
use ecan_mcan_host::common::constants::{ECAN_DEFAULT_CYCLE_US, ECAN_DEFAULT_PDO_MULTIPLIER};
use ecan_mcan_host::common::result::ecan_result_t;
use ecan_mcan_port::PortConfig;
use ecan_protocol::config::List;

use crate::errors::{OrCode as _, no_slave};
use crate::mcan_port::config::PortPlain;

/// Most slaves of a configuration.
pub const ECAN_IGH_MAX_SLAVES: usize = 32;
/// Most startup SDOs that an application may add, of all slaves together.
pub const ECAN_IGH_MAX_STARTUP_SDOS: usize = 256;
/// Most bytes of the setting `ecrt`, NUL included.
pub const ECAN_IGH_MAX_SETTING: usize = 512;

/// What the Adapter is told. About 50 kilobytes.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct ecan_igh_config_t {
    /// Not for the application.
    pub opaque: [u64; 6144],
}

/// One slave.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SlavePlain {
    pub(crate) alias: u16,
    pub(crate) position: u16,
    pub(crate) rx_multiplier: u8,
    pub(crate) tx_multiplier: u8,
    pub(crate) identity: Option<Identity>,
}

/// A startup step of the application or of a configuration file.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StartupPlain {
    pub(crate) slave: u16,
    pub(crate) step: StartupStep,
}

/// A short text in place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Text<const N: usize> {
    bytes: [u8; N],
    length: usize,
}

impl<const N: usize> Text<N> {
    const EMPTY: Self = Self { bytes: [0; N], length: 0 };

    pub(crate) fn new(call: Call, name: &str, text: &str) -> Result<Self, ecan_result_t> {
        let mut value = Self::EMPTY;
        // As C counts, with NUL at the end.
        let Some(place) = value.bytes[..N - 1].get_mut(..text.len()) else {
            let text = format_args!("`{name}` has {} bytes, at most {} fit", text.len(), N - 1);
            return Err(call.fail(ecan_result_t::ECAN_ERR_BUFFER, text));
        };
        place.copy_from_slice(text.as_bytes());
        value.length = text.len();
        Ok(value)
    }

    pub(crate) fn get(&self) -> Option<&str> {
        let text = self.bytes.get(..self.length)?;
        std::str::from_utf8(text).ok().filter(|text| !text.is_empty())
    }
}

/// What is in an [`ecan_igh_config_t`].
pub(crate) struct AdapterPlain {
    pub(crate) master_index: u32,
    pub(crate) slave_count: usize,
    pub(crate) slaves: [SlavePlain; ECAN_IGH_MAX_SLAVES],
    pub(crate) cycle_ns: u32,
    pub(crate) dc: Option<DcSync>,
    pub(crate) allow_large_pdos: bool,
    pub(crate) preop_timeout_ms: u32,
    pub(crate) watchdog_us: u32,
    /// In order.
    pub(crate) startup: [Option<StartupPlain>; ECAN_IGH_MAX_STARTUP_SDOS],
    /// Whether the setting was set, empty included.
    pub(crate) is_ecrt_set: bool,
    pub(crate) ecrt: Text<ECAN_IGH_MAX_SETTING>,
    pub(crate) scenario: Text<64>,
    pub(crate) is_stepped: bool,
    pub(crate) seed: Option<u64>,
    /// Set by igh_mcan_port_apply_config().
    pub(crate) port: Option<PortPlain>,
}

impl Plain for AdapterPlain {
    type Storage = ecan_igh_config_t;
    const SEAL: u64 = 0x6563_616e_5f69_6763;
    const INIT: &'static str = "ecan_igh_default_config";
}

impl AdapterPlain {
    fn new() -> Self {
        let slave = |position| SlavePlain {
            alias: 0,
            position: position as u16,
            rx_multiplier: ECAN_DEFAULT_PDO_MULTIPLIER as u8,
            tx_multiplier: ECAN_DEFAULT_PDO_MULTIPLIER as u8,
            identity: None,
        };
        let defaults = AdapterConfig::new(1);
        Self {
            master_index: 0,
            slave_count: 1,
            slaves: std::array::from_fn(slave),
            cycle_ns: ECAN_DEFAULT_CYCLE_US * 1000,
            dc: None,
            allow_large_pdos: false,
            preop_timeout_ms: defaults.preop_timeout.as_millis() as u32,
            watchdog_us: defaults.watchdog.as_micros() as u32,
            startup: [None; ECAN_IGH_MAX_STARTUP_SDOS],
            is_ecrt_set: false,
            ecrt: Text::EMPTY,
            scenario: Text::EMPTY,
            is_stepped: false,
            seed: None,
            port: None,
        }
    }

    /// The configuration of C, to be changed.
    ///
    /// # Safety
    /// As for [`Sealed::change`].
    pub(crate) unsafe fn open<'a>(
        call: Call,
        config: *mut ecan_igh_config_t,
    ) -> Result<&'a mut Self, ecan_result_t> {
        // SAFETY: the caller's promise.
        unsafe { Sealed::change(call, "config", config) }
    }

    /// The configuration of C.
    ///
    /// # Safety
    /// As for [`Sealed::read`].
    pub(crate) unsafe fn read<'a>(
        call: Call,
        config: *const ecan_igh_config_t,
    ) -> Result<&'a Self, ecan_result_t> {
        // SAFETY: the caller's promise.
        unsafe { Sealed::read(call, "config", config) }
    }

    /// A slave that is configured.
    pub(crate) fn slave(
        &mut self,
        call: Call,
        slave: usize,
    ) -> Result<&mut SlavePlain, ecan_result_t> {
        let count = self.slave_count;
        self.slaves[..count].get_mut(slave).ok_or_else(|| no_slave(call, slave, count))
    }

    /// A slave that is configured, to be looked at.
    pub(crate) fn slave_of(&self, call: Call, slave: usize) -> Result<&SlavePlain, ecan_result_t> {
        let count = self.slave_count;
        self.slaves[..count].get(slave).ok_or_else(|| no_slave(call, slave, count))
    }

    /// Another startup step of a slave that is configured.
    pub(crate) fn add_startup(
        &mut self,
        call: Call,
        slave: usize,
        step: StartupStep,
    ) -> Result<(), ecan_result_t> {
        let Some(place) = self.startup.iter_mut().find(|place| place.is_none()) else {
            let text = format_args!("{ECAN_IGH_MAX_STARTUP_SDOS} startup SDOs are the most");
            return Err(call.fail(ecan_result_t::ECAN_ERR_FULL, text));
        };
        *place = Some(StartupPlain { slave: slave as u16, step });
        Ok(())
    }

    /// As an Adapter's configuration says; what it has no word for stays: the library and the
    /// simulation.
    ///
    /// # Errors
    /// More slaves or startup steps than there is room for.
    pub(crate) fn with(&self, call: Call, config: &AdapterConfig) -> Result<Self, ecan_result_t> {
        let AdapterConfig {
            master_index,
            ref slaves,
            ref startup,
            cycle: _,
            dc,
            allow_large_pdos,
            preop_timeout,
            watchdog,
        } = *config;
        let mut plain = Self {
            master_index,
            slave_count: slaves.len(),
            cycle_ns: config.cycle_ns(),
            dc,
            allow_large_pdos,
            preop_timeout_ms: u32::try_from(preop_timeout.as_millis()).unwrap_or(u32::MAX),
            watchdog_us: u32::try_from(watchdog.as_micros()).unwrap_or(u32::MAX),
            is_ecrt_set: self.is_ecrt_set,
            ecrt: self.ecrt,
            scenario: self.scenario,
            is_stepped: self.is_stepped,
            seed: self.seed,
            ..Self::new()
        };
        if slaves.len() > ECAN_IGH_MAX_SLAVES {
            let text =
                format_args!("{} gateways, {ECAN_IGH_MAX_SLAVES} are the most", slaves.len());
            return Err(call.fail(ecan_result_t::ECAN_ERR_FULL, text));
        }
        for (place, settings) in plain.slaves.iter_mut().zip(slaves) {
            // Startup steps follow; their base is made of the Port's configuration.
            let SlaveConfig { alias, position, rx_multiplier, tx_multiplier, identity } = *settings;
            *place = SlavePlain { alias, position, rx_multiplier, tx_multiplier, identity };
        }
        for entry in startup {
            plain.add_startup(call, entry.slave, entry.step)?;
        }
        Ok(plain)
    }

    /// The gateways' configuration that igh_mcan_port_apply_config() gave.
    pub(crate) fn applied(&self) -> Option<PortConfig> {
        self.port.as_ref().map(|port| port.settings(self.slave_count))
    }

    /// The Adapter's configuration.
    pub(crate) fn to_rust(&self) -> AdapterConfig {
        let slaves = self.slaves[..self.slave_count].iter().map(|slave| SlaveConfig {
            alias: slave.alias,
            position: slave.position,
            rx_multiplier: slave.rx_multiplier,
            tx_multiplier: slave.tx_multiplier,
            identity: slave.identity,
        });
        let startup = self
            .startup
            .iter()
            .flatten()
            .map(|entry| StartupEntry { slave: entry.slave.into(), step: entry.step });
        AdapterConfig {
            master_index: self.master_index,
            // infallible: both lists have the capacity of C's arrays.
            slaves: List::collect(slaves).unwrap_or_default(),
            startup: List::collect(startup).unwrap_or_default(),
            cycle: Duration::from_nanos(self.cycle_ns.into()),
            dc: self.dc,
            allow_large_pdos: self.allow_large_pdos,
            preop_timeout: Duration::from_millis(self.preop_timeout_ms.into()),
            watchdog: Duration::from_micros(self.watchdog_us.into()),
        }
    }

    /// The startup steps of the gateways.
    pub(crate) fn startup_plan(&self) -> StartupPlan {
        self.applied().map(|port| port.startup_plan(&self.to_rust())).unwrap_or_default()
    }
}

/// Fills a configuration: one slave at position 0, N = 3 (384 bytes), a cycle of 10 ms, no
/// distributed clocks, master 0, the setting `ecrt` left to the environment (manual 15.5.2).
///
/// @param config  Is overwritten, whatever it holds.
///
/// @usage   not rt, any thread, any time
/// @return  ECAN_OK or ECAN_ERR_NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_default_config(config: *mut ecan_igh_config_t) -> c_int {
    call("ecan_igh_default_config", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        unsafe { Sealed::init(call, "config", config, AdapterPlain::new()) }
    })
}

/// Checks a configuration as a whole, without touching the bus. ecan_igh_init() does it, too.
///
/// @usage   not rt, any thread, any time
/// @return  ECAN_OK; ECAN_ERR_CONFIG with every fault in ecan_last_error(); ECAN_ERR_NULL,
///          ECAN_ERR_NOT_INITIALISED.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_check_config(config: *const ecan_igh_config_t) -> c_int {
    call("ecan_igh_check_config", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let config = unsafe { AdapterPlain::read(call, config)? }.to_rust();
        config.check().map_err(Error::from).or_code(call)
    })
}

/// The setting `ecrt` of a configuration: which EtherCAT master library it asks for.
///
/// @param setting  Buffer; "" where nothing is set and the environment decides.
/// @param size     Its bytes; ECAN_IGH_MAX_SETTING are enough.
///
/// @usage   not rt, any thread, any time
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, or ECAN_ERR_BUFFER with the text cut.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_config_get_ecrt(
    config: *const ecan_igh_config_t,
    setting: *mut c_char,
    size: usize,
) -> c_int {
    call("ecan_igh_config_get_ecrt", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (config, mut room): (_, OutArray<c_char>) =
            unsafe { (AdapterPlain::read(call, config)?, call.room("setting", setting, size)?) };
        if put_text(&mut room, config.ecrt.get().unwrap_or_default()) {
            return Ok(());
        }
        Err(call.fail(ecan_result_t::ECAN_ERR_BUFFER, format_args!("{size} bytes are too few")))
    })
}
