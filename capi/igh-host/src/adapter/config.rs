//! Configuration
//!
//! Plain data: it may be copied and needs no deinit. Nothing touches the bus before
//! ecan_igh_init(). Bytes that something else than this library has overwritten are
//! ECAN_ERR_NOT_INITIALISED in every function.

use std::ffi::c_char;

use ecan_c_boundary::result::ecan_result_t::{self, *};
use ecan_c_boundary::{Call, pointers};
use ecan_c_export::export;
use ecan_host::{
    AdapterConfig, Error, ImageTimes, MAX_SLAVES, MAX_STARTUP_STEPS, SlaveConfig, StartupPlan,
    StartupStep,
};
use ecan_mcan_port::PortConfig;
use ecan_protocol::config::List;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::callback::StopAddress;
use crate::encoded::{Encoded, EncodedCall as _};
use crate::errors::{OrCode as _, no_slave};
use crate::port_config;

/// Most slaves of a configuration.
pub const ECAN_IGH_MAX_SLAVES: usize = 32;
/// Most startup SDOs that an application may add, of all slaves together.
pub const ECAN_IGH_MAX_STARTUP_SDOS: usize = 256;
/// Most bytes of the setting `ecrt`, NUL included.
pub const ECAN_IGH_MAX_SETTING: usize = 512;

const _: () =
    assert!(ECAN_IGH_MAX_SLAVES == MAX_SLAVES && ECAN_IGH_MAX_STARTUP_SDOS == MAX_STARTUP_STEPS);

/// Configuration of the Adapter. About 50 kilobytes.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct ecan_igh_config_t {
    /// Not for the application.
    pub opaque: [u64; 6144],
}

/// A short text of C.
#[derive(Clone, Copy, Debug)]
pub struct Text<const N: usize> {
    bytes: [u8; N],
    length: usize,
}

impl<const N: usize> Text<N> {
    const EMPTY: Self = Self { bytes: [0; N], length: 0 };

    pub(crate) fn new(call: Call, name: &str, text: &str) -> Result<Self, ecan_result_t> {
        Self::of(text).ok_or_else(|| {
            let text = format_args!("`{name}` has {} bytes, at most {} fit", text.len(), N - 1);
            call.fail(ECAN_ERR_BUFFER, text)
        })
    }

    /// `None` for a text that does not fit.
    fn of(text: &str) -> Option<Self> {
        let mut value = Self::EMPTY;
        // As C counts, with NUL at the end.
        value.bytes[..N - 1].get_mut(..text.len())?.copy_from_slice(text.as_bytes());
        value.length = text.len();
        Some(value)
    }

    pub(crate) fn get(&self) -> Option<&str> {
        let text = self.bytes.get(..self.length)?;
        std::str::from_utf8(text).ok().filter(|text| !text.is_empty())
    }
}

impl<const N: usize> Serialize for Text<N> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.get().unwrap_or_default().serialize(serializer)
    }
}

impl<'de, const N: usize> Deserialize<'de> for Text<N> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = <&str>::deserialize(deserializer)?;
        Self::of(text).ok_or_else(|| D::Error::custom("text is too long"))
    }
}

/// Content of an [`ecan_igh_config_t`].
#[derive(Clone, Copy, Serialize, Deserialize)]
#[expect(missing_debug_implementations, reason = "no one prints 50 kilobytes")]
pub struct IghConfig {
    /// Has all slaves that a configuration may have; the first `slave_count` are configured.
    pub(crate) adapter: AdapterConfig,
    pub(crate) slave_count: usize,
    /// The choice of the application, an empty one included.
    pub(crate) ecrt: Option<Text<ECAN_IGH_MAX_SETTING>>,
    pub(crate) scenario: Text<64>,
    pub(crate) is_stepped: bool,
    pub(crate) seed: Option<u64>,
    pub(crate) stop: Option<StopAddress>,
    /// Set by igh_mcan_port_apply_config().
    pub(crate) port: Option<PortConfig>,
}

impl Encoded for ecan_igh_config_t {
    type Value = IghConfig;
    const SEAL: u64 = 0x6563_616e_5f69_6763;
    const INIT: &'static str = "ecan_igh_default_config";
}

impl IghConfig {
    fn new() -> Self {
        Self {
            adapter: AdapterConfig::new(ECAN_IGH_MAX_SLAVES as u16),
            slave_count: 1,
            ecrt: None,
            scenario: Text::EMPTY,
            is_stepped: false,
            seed: None,
            stop: None,
            port: None,
        }
    }

    /// With the longest texts.
    #[cfg(test)]
    pub(crate) fn largest() -> Self {
        fn long<const N: usize>() -> Text<N> {
            Text { bytes: [b'x'; N], length: N - 1 }
        }
        let stop = StopAddress::largest();
        Self {
            ecrt: Some(long()),
            scenario: long(),
            seed: Some(u64::MAX),
            stop: Some(stop),
            ..Self::new()
        }
    }

    /// A configured slave, to change it.
    pub(crate) fn slave(
        &mut self,
        call: Call,
        slave: usize,
    ) -> Result<&mut SlaveConfig, ecan_result_t> {
        let count = self.slave_count;
        self.adapter.slaves[..count].get_mut(slave).ok_or_else(|| no_slave(call, slave, count))
    }

    pub(crate) fn slave_of(&self, call: Call, slave: usize) -> Result<&SlaveConfig, ecan_result_t> {
        let count = self.slave_count;
        self.adapter.slaves[..count].get(slave).ok_or_else(|| no_slave(call, slave, count))
    }

    pub(crate) fn add_startup(
        &mut self,
        call: Call,
        slave: usize,
        step: impl Into<StartupStep>,
    ) -> Result<(), ecan_result_t> {
        self.slave(call, slave)?;
        self.adapter
            .add_startup(slave, step)
            .map_err(|full| call.fail(ECAN_ERR_FULL, format_args!("startup SDOs: {full}")))
    }

    /// Replaces everything except the library, the simulation and the callback.
    pub(crate) fn with(&self, adapter: &AdapterConfig, port: PortConfig) -> Self {
        let mut all = Self::new().adapter.slaves;
        for (slave, configured) in all.iter_mut().zip(adapter.slaves) {
            *slave = configured;
        }
        Self {
            adapter: AdapterConfig { slaves: all, ..*adapter },
            slave_count: adapter.slaves.len(),
            port: Some(port),
            ..*self
        }
    }

    /// The gateways' configuration of igh_mcan_port_apply_config().
    pub(crate) fn applied(&self) -> Option<PortConfig> {
        self.port.as_ref().map(|port| port_config::configured(port, self.slave_count))
    }

    /// The Adapter's configuration, with the configured slaves.
    pub(crate) fn configured(&self) -> AdapterConfig {
        let slaves = self.adapter.slaves.into_iter().take(self.slave_count);
        AdapterConfig { slaves: List::collect(slaves).unwrap_or_default(), ..self.adapter }
    }

    /// Times of a slave's images, for the plan: those of igh_mcan_port_apply_config().
    pub(crate) fn image_times(&self, slave: usize) -> ImageTimes {
        self.port.as_ref().map_or_else(ImageTimes::default, |port| port.image_times(slave))
    }

    /// The function of ecan_igh_config_stop_waiting_when().
    pub(crate) fn stop(&self) -> Option<Box<dyn Fn() -> bool + Send>> {
        // SAFETY: that function made the addresses.
        self.stop.map(|stop| unsafe { stop.callback() }.check())
    }

    pub(crate) fn startup_plan(&self) -> StartupPlan {
        self.applied().map(|port| port.startup_plan(&self.configured())).unwrap_or_default()
    }
}

/// Fills a configuration: one slave at position 0, N = 3 (384 bytes), a cycle of 10 ms, no
/// distributed clocks, master 0, the setting `ecrt` of the environment (manual 15.5.2).
///
/// @param config  Is overwritten.
///
/// @usage   not rt, any thread, any time
#[export(call)]
pub fn ecan_igh_default_config(config: *mut ecan_igh_config_t) {
    pointers!(call, out(config));
    call.encode(&config, &IghConfig::new())
}

/// Checks a configuration as a whole, without touching the bus. ecan_igh_init() does it, too.
///
/// @usage   not rt, any thread, any time
/// @return  ECAN_OK; ECAN_ERR_CONFIG with every fault in ecan_last_error().
#[must_use]
#[export(call)]
pub fn ecan_igh_check_config(config: *const ecan_igh_config_t) {
    pointers!(call, encoded(config));
    config.configured().check().map_err(Error::from).or_code(call)
}

/// Gets the setting `ecrt` of a configuration, which selects the EtherCAT master library.
///
/// @param setting  "" if nothing is set and the environment decides. See the rules for texts in
///                 igh_ecan_common.h; ECAN_IGH_MAX_SETTING bytes are enough.
///
/// @usage   not rt, any thread, any time
/// @return  ECAN_OK, ECAN_ERR_BUFFER.
#[export(call)]
pub fn ecan_igh_config_get_ecrt(
    config: *const ecan_igh_config_t,
    setting: *mut c_char,
    size: usize,
    needed: *mut usize,
) {
    pointers!(call, out_text(setting, size, needed), encoded(config));
    setting.put(call, config.ecrt.as_ref().and_then(Text::get).unwrap_or_default())
}
