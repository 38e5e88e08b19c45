//! Configuration of master, clocks and slaves, as C holds it.

use std::ffi::{c_char, c_int, c_void};
use std::time::Duration;

use ecan_c_boundary::result::ecan_result_t::{ECAN_ERR_ORDER, *};
use ecan_c_boundary::result::{ECAN_PDO_MAX_MULTIPLIER, ecan_result_t};
use ecan_c_boundary::{Call, mirror, pointers};
use ecan_c_export::export;
use ecan_host::{
    AdapterConfig, ClockSource, DcSync, Error, Identity, ImageTimes, MAX_SLAVES, MAX_STARTUP_STEPS,
    Plan, SlaveConfig, StartupPlan, StartupStep,
};
use ecan_mcan_port::{GatewayConfig, MAX_GATEWAYS, PortConfig};
use ecan_protocol::config::List;
use ecan_protocol::object::{ObjectType, SdoWrite};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::callback::StopAddress;
use crate::encoded::{Encoded, EncodedCall as _};
use crate::errors::{OrCode as _, no_slave};

// Section: Configuration
//
// Plain data: it may be copied and needs no deinit. Nothing touches the bus before
// ecan_igh_init(). Bytes that something else than this library has overwritten are
// ECAN_ERR_NOT_INITIALISED in every function.

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
    /// Slaves whose N the application has set, a bit each.
    sized: u32,
}

impl Encoded for ecan_igh_config_t {
    type Value = IghConfig;
    const SEAL: u64 = 0x6563_616e_5f69_6763;
    const INIT: &'static str = "ecan_igh_default_config";
}

impl IghConfig {
    pub(crate) fn new() -> Self {
        Self {
            adapter: AdapterConfig::new(ECAN_IGH_MAX_SLAVES as u16),
            slave_count: 1,
            ecrt: None,
            scenario: Text::EMPTY,
            is_stepped: false,
            seed: None,
            stop: None,
            port: None,
            sized: 0,
        }
    }

    /// Gives the slaves whose N the application has not set that of their gateways.
    pub(crate) fn size_slaves(&mut self, port: &PortConfig) {
        let slaves = self.adapter.slaves.iter_mut().zip(&port.gateways).enumerate();
        for (_, (slave, gateway)) in slaves.filter(|(at, _)| self.sized >> at & 1 == 0) {
            let n = gateway.default_multiplier();
            (slave.rx_multiplier, slave.tx_multiplier) = (n, n);
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

    fn set_sizes(
        &mut self,
        call: Call,
        slave: usize,
        sizes: (u8, u8),
    ) -> Result<(), ecan_result_t> {
        let config = self.slave(call, slave)?;
        (config.rx_multiplier, config.tx_multiplier) = sizes;
        self.sized |= 1 << slave;
        Ok(())
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
            sized: u32::MAX,
            ..*self
        }
    }

    /// The gateways' configuration of igh_mcan_port_apply_config().
    pub(crate) fn applied_port(&self) -> Option<PortConfig> {
        self.port.as_ref().map(|port| configured_port(port, self.slave_count))
    }

    /// The Adapter's configuration, with the configured slaves.
    pub(crate) fn adapter_config(&self) -> AdapterConfig {
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
        self.applied_port()
            .map(|port| port.startup_plan(&self.adapter_config()))
            .unwrap_or_default()
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
    config.adapter_config().check().map_err(Error::from).or_code(call)
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

// Section: Configuration of the master

/// Selects the EtherCAT master library.
///
/// Without this call the environment variable ECAN_ECRT selects it, and without that variable it is
/// the installed libethercat.so.1. The SDK never falls back to the simulator automatically.
///
/// @param setting  "" for libethercat.so.1; the path of a library; "sim" for the built-in
///                 simulator with the scenario that was suggested; "sim:echo", "sim:drives" or
///                 "sim:FILE.toml" for a scenario. NULL removes the choice. Is copied.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT, ECAN_ERR_BUFFER. ecan_igh_init() reports a library that
///          cannot be loaded.
#[export(call, config config)]
pub fn ecan_igh_config_set_ecrt(config: *mut ecan_igh_config_t, setting: *const c_char) {
    config.ecrt = if setting.is_null() {
        None
    } else {
        pointers!(call, text(setting));
        Some(Text::new(call, "setting", setting)?)
    };
}

/// Selects the EtherCAT master.
///
/// @param index  0 for /dev/EtherCAT0, the default.
///
/// @usage   not rt, any thread, before init
#[export(_, config config)]
pub fn ecan_igh_config_set_master_index(config: *mut ecan_igh_config_t, index: u32) {
    config.adapter.master_index = index;
}

/// Sets the number of ECAN-Lite slaves; slave i is at position i unless that is changed.
///
/// @param count  1 to ECAN_IGH_MAX_SLAVES.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT.
#[export(call, config config)]
pub fn ecan_igh_config_set_slave_count(config: *mut ecan_igh_config_t, count: usize) {
    if !(1..=ECAN_IGH_MAX_SLAVES).contains(&count) {
        let text = format_args!("{count} is out of range; allowed: 1 to {ECAN_IGH_MAX_SLAVES}");
        return Err(call.argument("count", text));
    }
    config.slave_count = count;
}

/// Gets the number of slaves, after igh_mcan_port_load_config() for example.
///
/// @usage   not rt, any thread, any time
#[export(call)]
pub fn ecan_igh_config_get_slave_count(config: *const ecan_igh_config_t, count: *mut usize) {
    pointers!(call, encoded(config), out(count));
    count.set(config.slave_count);
}

/// Sets the period of the application's cycle.
///
/// @param cycle_us  Microseconds, 1 to 4294967. Typical are 100 to 100000; must be shorter than the
///                  watchdog: ecan_igh_config_set_watchdog_us().
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT.
#[export(call, config config)]
pub fn ecan_igh_config_set_cycle_us(config: *mut ecan_igh_config_t, cycle_us: u32) {
    const MOST: u32 = u32::MAX / 1000;
    if !(1..=MOST).contains(&cycle_us) {
        let text = format_args!("{cycle_us} is out of range; allowed: 1 to {MOST}");
        return Err(call.argument("cycle_us", text));
    }
    config.adapter.cycle = Duration::from_micros(cycle_us.into());
}

/// Gets the period of the application's cycle.
///
/// @param cycle_ns  Nanoseconds: a file may have fractions of a microsecond.
///
/// @usage   not rt, any thread, any time
#[export(call)]
pub fn ecan_igh_config_get_cycle_ns(config: *const ecan_igh_config_t, cycle_ns: *mut u32) {
    pointers!(call, encoded(config), out(cycle_ns));
    cycle_ns.set(config.adapter.cycle_ns());
}

/// States that the installed master carries more than 1486 bytes of process data per sync manager.
/// Without it N is at most 11 (ECAN_PDO_MAX_PLAIN_MULTIPLIER).
///
/// @usage   not rt, any thread, before init
#[export(_, config config)]
pub fn ecan_igh_config_allow_large_pdos(config: *mut ecan_igh_config_t, allow: c_int) {
    config.adapter.allow_large_pdos = allow != 0;
}

/// Sets the time in which the slaves must respond in PREOP, in milliseconds; 10000 by default.
///
/// @usage   not rt, any thread, before init
#[export(_, config config)]
pub fn ecan_igh_config_set_preop_timeout_ms(config: *mut ecan_igh_config_t, timeout_ms: u32) {
    config.adapter.preop_timeout = Duration::from_millis(timeout_ms.into());
}

/// Sets the process data watchdog of the gateways: a gateway that receives no outputs for this time
/// changes from OP to SAFEOP (AL status code 0x001B) and sends no more frames of the application.
///
/// @param watchdog_us  A multiple of 100 from 100 to 6553500, 100000 by default. Must be longer
///                     than two cycles, or a single lost frame ends operation.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK. The value is checked with the others by ecan_igh_check_config() and
///          ecan_igh_init().
#[export(_, config config)]
pub fn ecan_igh_config_set_watchdog_us(config: *mut ecan_igh_config_t, watchdog_us: u32) {
    config.adapter.watchdog = Duration::from_micros(watchdog_us.into());
}

/// Sets a function that ecan_igh_init() and ecan_igh_attach() call many times per second while they
/// wait, for a master that is still scanning the bus for example: if it returns other than 0, they end
/// with ECAN_ERR_STOPPED. After them the waiting calls of all layers call it, as after
/// ecan_igh_stop_waiting_when().
///
/// @param stop  Gets `user`; NULL for none. As that of ecan_igh_stop_waiting_when(); must be valid
///              as long as a context of this configuration exists.
/// @param user  Is passed to it, in the thread that waits.
///
/// @usage   not rt, any thread, before init
#[export(_, config config)]
pub fn ecan_igh_config_stop_waiting_when(
    config: *mut ecan_igh_config_t,
    stop: Option<unsafe extern "C-unwind" fn(user: *mut c_void) -> c_int>,
    user: *mut c_void,
) {
    config.stop = stop.map(|function| StopAddress::new(function, user));
}

// Section: Configuration of the distributed clocks

mirror! {
    /// The clock that the others follow.
    pub enum ecan_igh_clock_source_t as ClockSource {
        /// The host's: the reference clock is corrected to the application's time in each cycle.
        ECAN_IGH_CLOCK_HOST = 0 => ClockSource::Host,
        /// The reference clock: a phase-locked loop shifts the deadlines of the host's cycle.
        ECAN_IGH_CLOCK_REFERENCE = 1 => ClockSource::Reference,
    }
}

/// Settings of the distributed clocks; an error if they are off.
fn dc(call: Call, config: &mut IghConfig) -> Result<&mut DcSync, ecan_result_t> {
    let dc = config.adapter.dc.as_mut();
    dc.ok_or_else(|| call.fail(ECAN_ERR_ORDER, format_args!("distributed clocks are off")))
}

/// Enables distributed clocks with Sync0 (manual 8.4, 15.6). 15.6.1 lists proven phases.
///
/// @param cycle_us  Period of Sync0 in microseconds, a whole multiple of the cycle; 0 disables
///                  distributed clocks.
/// @param shift_us  Phase of Sync0 against the start of the period, in microseconds, below it.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT. ecan_igh_check_config() checks the period against the
///          cycle.
#[export(call, config config)]
pub fn ecan_igh_config_set_dc_sync0(config: *mut ecan_igh_config_t, cycle_us: u32, shift_us: u32) {
    let cycle = duration(call, "cycle_us", cycle_us)?;
    let shift = duration(call, "shift_us", shift_us)?;
    let before = config.adapter.dc.unwrap_or(DcSync::new(cycle, shift));
    config.adapter.dc = (!cycle.is_zero()).then_some(DcSync { cycle, shift, ..before });
}

/// Enables distributed clocks with Sync0, with the shift that the plan recommends: the middle between
/// the latest arrival of the outputs in a cycle and the earliest one in the next (manual 16.1).
///
/// Uses the slaves, their PDO sizes and the cycle that the configuration has now: call it after they
/// are set, and again when one of them changes. The times of the application, the host and the
/// firmware are those of igh_mcan_port_apply_config() if it was called, otherwise 100, 30 and 50 us. A
/// product measures its shift (manual 15.6.1) and sets it with ecan_igh_config_set_dc_sync0().
///
/// @param cycle_us  Period of Sync0 in microseconds, a whole multiple of the cycle; 0 disables
///                  distributed clocks.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT.
#[export(call, config config)]
pub fn ecan_igh_config_set_dc_sync0_planned(config: *mut ecan_igh_config_t, cycle_us: u32) {
    let cycle = duration(call, "cycle_us", cycle_us)?;
    let times = |slave| config.image_times(slave);
    let DcSync { shift, .. } = DcSync::planned_with(cycle, &config.adapter_config(), times);
    let before = config.adapter.dc.unwrap_or(DcSync::new(cycle, shift));
    config.adapter.dc = (!cycle.is_zero()).then_some(DcSync { cycle, shift, ..before });
}

/// Gets the Sync0 shift and its margin by the plan: the distance of the pulses from the arrivals of
/// the outputs. If it is negative, outputs may be missed (manual 16.1).
///
/// @param shift_ns   Gets the shift in nanoseconds.
/// @param margin_ns  Gets the margin in nanoseconds; 0 without slaves.
///
/// @usage   not rt, any thread, after ecan_igh_config_set_dc_sync0 or _planned
/// @return  ECAN_OK; ECAN_ERR_ORDER if distributed clocks are off.
#[export(call)]
pub fn ecan_igh_config_get_dc_margin(
    config: *const ecan_igh_config_t,
    shift_ns: *mut u32,
    margin_ns: *mut i64,
) {
    pointers!(call, encoded(config), out(shift_ns), out(margin_ns));
    let Some(dc) = config.adapter.dc else {
        return Err(call.fail(ECAN_ERR_ORDER, format_args!("distributed clocks are off")));
    };
    let plan = Plan::with_times(&config.adapter_config(), |slave| config.image_times(slave));
    let arrivals = plan.output_arrivals();
    shift_ns.set(dc.shift_ns());
    margin_ns.set(arrivals.map_or(0, |arrivals| arrivals.margin_ns(dc.shift_ns())));
}

fn duration(call: Call, name: &'static str, us: u32) -> Result<Duration, ecan_result_t> {
    let most = u32::MAX / 1000;
    if us > most {
        let text = format_args!("{us} is out of range; allowed: 0 to {most}");
        return Err(call.argument(name, text));
    }
    Ok(Duration::from_micros(us.into()))
}

/// Sets the AssignActivate word of the slaves' distributed clocks; 0x0300 by default.
///
/// @usage   not rt, any thread, after ecan_igh_config_set_dc_sync0 and before init
/// @return  ECAN_OK; ECAN_ERR_ORDER if distributed clocks are off.
#[export(call, config config)]
pub fn ecan_igh_config_set_dc_assign_activate(config: *mut ecan_igh_config_t, word: u16) {
    dc(call, config)?.assign_activate = word;
}

/// Selects the clock that the others follow; the host's by default.
///
/// @param source  An ecan_igh_clock_source_t.
///
/// @usage   not rt, any thread, after ecan_igh_config_set_dc_sync0 and before init
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT; ECAN_ERR_ORDER if distributed clocks are off.
#[export(call, config config)]
pub fn ecan_igh_config_set_dc_source(config: *mut ecan_igh_config_t, source: c_int) {
    dc(call, config)?.source = ecan_igh_clock_source_t::to_rust(source).ok_or_else(|| {
        call.argument("source", format_args!("{source} is invalid; allowed: 0, 1"))
    })?;
}

/// Selects the slave whose clock is the reference; by default the first on the bus with a clock.
///
/// @param slave  Slave index; ecan_igh_check_config() checks it.
///
/// @usage   not rt, any thread, after ecan_igh_config_set_dc_sync0 and before init
/// @return  ECAN_OK; ECAN_ERR_ORDER if distributed clocks are off.
#[export(call, config config)]
pub fn ecan_igh_config_set_dc_reference(config: *mut ecan_igh_config_t, slave: usize) {
    dc(call, config)?.reference = Some(slave);
}

/// Sets the interval at which the differences between the slaves' clocks are measured; 100 cycles
/// by default.
///
/// @param every  Cycles from measurement to measurement; 0 for never.
///
/// @usage   not rt, any thread, after ecan_igh_config_set_dc_sync0 and before init
/// @return  ECAN_OK; ECAN_ERR_ORDER if distributed clocks are off.
#[export(call, config config)]
pub fn ecan_igh_config_set_dc_monitor(config: *mut ecan_igh_config_t, every: u32) {
    dc(call, config)?.monitor_every = every;
}

// Section: Configuration of a slave

fn multiplier(call: Call, name: &str, multiplier: u32) -> Result<u8, ecan_result_t> {
    if !(1..=ECAN_PDO_MAX_MULTIPLIER).contains(&multiplier) {
        let text =
            format_args!("{multiplier} is out of range; allowed: 1 to {ECAN_PDO_MAX_MULTIPLIER}");
        return Err(call.argument(name, text));
    }
    Ok(multiplier as u8)
}

/// Sets N of both directions on every slave: the PDOs have 128 * N bytes (manual 5.2). Without it
/// igh_mcan_port_apply_config() takes 3, and 8 for a gateway with a CAN FD channel.
///
/// @param n  1 to 24; above 11 see ecan_igh_config_allow_large_pdos().
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT.
#[export(call, config config)]
pub fn ecan_igh_config_set_pdo_multiplier(config: *mut ecan_igh_config_t, n: u32) {
    config.adapter = config.adapter.with_multiplier(multiplier(call, "n", n)?);
    config.sized = u32::MAX;
}

/// Sets N of both directions on one slave.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_ARGUMENT.
#[export(call, config config)]
pub fn ecan_igh_config_set_slave_pdo_multiplier(
    config: *mut ecan_igh_config_t,
    slave: usize,
    n: u32,
) {
    let n = multiplier(call, "n", n)?;
    config.set_sizes(call, slave, (n, n))?;
}

/// Sets N of each direction on one slave.
///
/// @param rx_n  Of the RxPDO, master to slave.
/// @param tx_n  Of the TxPDO, slave to master.
///
/// @usage   not rt, any thread, before init
/// @return  As ecan_igh_config_set_slave_pdo_multiplier().
#[export(call, config config)]
pub fn ecan_igh_config_set_slave_pdo_multipliers(
    config: *mut ecan_igh_config_t,
    slave: usize,
    rx_n: u32,
    tx_n: u32,
) {
    let sizes = (multiplier(call, "rx_n", rx_n)?, multiplier(call, "tx_n", tx_n)?);
    config.set_sizes(call, slave, sizes)?;
}

/// Gets N of each direction of one slave.
///
/// @param rx_n  Of the RxPDO, master to slave.
/// @param tx_n  Of the TxPDO, slave to master.
///
/// @usage   not rt, any thread, any time
#[export(call)]
pub fn ecan_igh_config_get_slave_pdo_multipliers(
    config: *const ecan_igh_config_t,
    slave: usize,
    rx_n: *mut u32,
    tx_n: *mut u32,
) {
    pointers!(call, encoded(config), out(rx_n), out(tx_n));
    let slave = config.slave_of(call, slave)?;
    rx_n.set(slave.rx_multiplier.into());
    tx_n.set(slave.tx_multiplier.into());
}

/// Sets the position of a slave.
///
/// @param alias     Station alias that the position counts from; 0 counts from the start of the
///                  bus.
/// @param position  Position, from 0.
///
/// @usage   not rt, any thread, before init
#[export(call, config config)]
pub fn ecan_igh_config_set_slave_position(
    config: *mut ecan_igh_config_t,
    slave: usize,
    alias: u16,
    position: u16,
) {
    let slave = config.slave(call, slave)?;
    (slave.alias, slave.position) = (alias, position);
}

/// Gets the position of a slave, as ecan_igh_config_set_slave_position() sets it.
///
/// @usage   not rt, any thread, any time
#[export(call)]
pub fn ecan_igh_config_get_slave_position(
    config: *const ecan_igh_config_t,
    slave: usize,
    alias: *mut u16,
    position: *mut u16,
) {
    pointers!(call, encoded(config), out(alias), out(position));
    let slave = config.slave_of(call, slave)?;
    alias.set(slave.alias);
    position.set(slave.position);
}

/// Sets the required vendor ID and product code (object 0x1018). Without it the SDK accepts every
/// slave whose objects identify it as an ECAN-Lite.
///
/// @usage   not rt, any thread, before init
#[export(call, config config)]
pub fn ecan_igh_config_set_slave_identity(
    config: *mut ecan_igh_config_t,
    slave: usize,
    vendor_id: u32,
    product_code: u32,
) {
    config.slave(call, slave)?.identity = Some(Identity { vendor_id, product_code });
}

/// Adds a startup SDO of the application: written after the Port's own, in the order of the calls,
/// at every (re)configuration of the slave.
///
/// @param index     Object.
/// @param subindex  Subindex.
/// @param data      Value, little endian, as on the bus. Is copied.
/// @param size      Its bytes: 1, 2 or 4.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_ARGUMENT; ECAN_ERR_FULL beyond
///          ECAN_IGH_MAX_STARTUP_SDOS.
#[must_use]
#[export(call, config config)]
pub fn ecan_igh_config_add_startup_sdo(
    config: *mut ecan_igh_config_t,
    slave: usize,
    index: u16,
    subindex: u8,
    data: *const c_void,
    size: usize,
) {
    pointers!(call, bytes(data, size));
    config.slave(call, slave)?;
    let ty = match size {
        1 => ObjectType::U8,
        2 => ObjectType::U16,
        4 => ObjectType::U32,
        _ => {
            let text = format_args!("{size} is invalid; allowed: 1, 2, 4");
            return Err(call.argument("size", text));
        }
    };
    let mut bytes = [0; 4];
    bytes[..size].copy_from_slice(data);
    let write = SdoWrite::new(index, subindex, ty, u32::from_le_bytes(bytes));
    config.add_startup(call, slave, StartupStep::Download(write))
}

/// Adds a readback to the startup of a slave, in the order of the calls: an object that must have this
/// value, or ecan_igh_init() fails. The startup is then executed once before the bus is active.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_SLAVE; ECAN_ERR_FULL beyond ECAN_IGH_MAX_STARTUP_SDOS.
#[must_use]
#[export(call, config config)]
pub fn ecan_igh_config_add_startup_readback(
    config: *mut ecan_igh_config_t,
    slave: usize,
    index: u16,
    subindex: u8,
    value: u32,
) {
    config.slave(call, slave)?;
    config.add_startup(call, slave, StartupStep::expect(index, subindex, value))
}

/// Adds default gateways up to the maximum.
pub(crate) fn extended_port(config: &PortConfig) -> PortConfig {
    let mut all = PortConfig::uniform(MAX_GATEWAYS, GatewayConfig::default());
    for (gateway, configured) in all.gateways.iter_mut().zip(config.gateways) {
        *gateway = configured;
    }
    PortConfig { filters: config.filters, ..all }
}

/// The first `count` gateways, with the filters of their enabled channels.
pub(crate) fn configured_port(config: &PortConfig, count: usize) -> PortConfig {
    let is_enabled = |slave: usize, channel: u8| {
        slave < count && config.gateways[slave].channels[usize::from(channel)].is_some()
    };
    let filters = config.filters.into_iter().filter(|f| is_enabled(f.slave, f.channel));
    PortConfig {
        gateways: List::collect(config.gateways.into_iter().take(count)).unwrap_or_default(),
        filters: List::collect(filters).unwrap_or_default(),
    }
}
