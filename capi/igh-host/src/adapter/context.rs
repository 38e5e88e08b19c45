//! Context of a master: life, library of the setting `ecrt`, simulation.

use std::ffi::{c_char, c_int, c_void};
use std::time::Duration;

use ecan_c_boundary::result::ecan_result_t::{self, ECAN_ERR_MASTER};
use ecan_c_boundary::{Call, OutPointer, pointers};
use ecan_c_export::export;
use ecan_host::{Adapter, AdapterConfig, Ecrt, Error, Master};
use ecan_lite::EcrtOptions;

use super::config::{IghConfig, Text, ecan_igh_config_t};
use crate::bus::Bus;
use crate::callback::StopCallback;
use crate::encoded::EncodedCall as _;
use crate::errors::OrCode as _;
use crate::handle::{Context, Entered, Kind};
use crate::{errors, handle};

// Section: Life of a master
//
// ecan_igh_context_t igh;
// ecan_igh_init(&igh, &config);              slaves found, everything registered
// ecan_igh_wait_op_timeout(&igh, 10000);     OP, the cycle runs
// ...
// ecan_igh_deinit(&igh);

/// A master with its slaves. Belongs to one thread at a time; do not move or copy it. What builds
/// on it (igh_mcan_port_t, igh_cia402_context_t) ends with it.
#[repr(C)]
#[derive(Debug)]
pub struct ecan_igh_context_t {
    /// Not for the application.
    pub opaque: [u64; 4],
}

impl Context for ecan_igh_context_t {
    type Object = Bus;
    const KIND: Kind = Kind::Adapter;
    type Layer<'a> = &'a mut Adapter;

    fn layer(call: Call, bus: &mut Entered<Bus>) -> Result<&mut Adapter, ecan_result_t> {
        bus.need_adapter(call)
    }
}

/// Stores a bus with an open Adapter in a context.
fn open(
    call: Call,
    context: &OutPointer<ecan_igh_context_t>,
    config: &IghConfig,
    library: impl FnOnce(Call, &IghConfig) -> Result<Library, ecan_result_t>,
    make: impl FnOnce(&Ecrt, AdapterConfig) -> Result<Adapter, ecan_result_t>,
) -> Result<(), ecan_result_t> {
    let bus = || {
        let rust = config.adapter_config();
        // A faulty configuration is reported before the library is loaded.
        rust.check().map_err(Error::from).or_code(call)?;
        let library = library(call, config)?;
        let adapter = make(&library.ecrt, rust)?;
        Ok(Bus::new(adapter, config.applied_port(), library.is_stepped))
    };
    // SAFETY: `out` was promised that the pointer is valid for writing.
    unsafe { handle::init(call, context.as_ptr().cast(), Kind::Adapter, bus) }
}

/// Opens the master of a library.
fn open_own(
    call: Call,
    context: &OutPointer<ecan_igh_context_t>,
    config: &IghConfig,
    library: impl FnOnce(Call, &IghConfig) -> Result<Library, ecan_result_t>,
) -> Result<(), ecan_result_t> {
    open(call, context, config, library, |ecrt, rust| {
        Adapter::open_with_stop(ecrt, rust, config.startup_plan(), config.stop()).or_code(call)
    })
}

/// Opens the master: checks the configuration as a whole, loads the EtherCAT master library,
/// reserves the master, finds and identifies the slaves, registers their startup SDOs (also those of
/// igh_mcan_port_apply_config()) and maps their PDOs. Writes nothing to the slaves: the master executes
/// the startup SDOs when the bus is active. A rejected one is reported by ecan_igh_wait_op_timeout() or
/// igh_mcan_port_wait_ready().
///
/// Blocks, for seconds if the master is still scanning the bus;
/// ecan_igh_config_stop_waiting_when() can end that early. A simulated library identifies itself on
/// standard error.
///
/// @param context  Any content; the manual's fragments leave it uninitialised.
/// @param config   Is copied.
///
/// @usage   not rt, any thread, any time
/// @return  ECAN_OK; ECAN_ERR_CONFIG, ECAN_ERR_ECRT, ECAN_ERR_FILE, ECAN_ERR_MASTER, ECAN_ERR_NOT_FOUND,
///          ECAN_ERR_IDENTITY, ECAN_ERR_SDO, ECAN_ERR_READBACK, ECAN_ERR_NOT_OPERATIONAL,
///          ECAN_ERR_STOPPED;
///          ECAN_ERR_ORDER for a context that is initialised already. After an error there is
///          nothing to deinit.
#[export(call)]
pub fn ecan_igh_init(context: *mut ecan_igh_context_t, config: *const ecan_igh_config_t) {
    pointers!(call, out(context), encoded(config));
    open_own(call, &context, &config, open_configured_library)
}

/// As ecan_igh_init(), with these options of a plain "sim".
pub(crate) fn init_with(
    call: Call,
    context: &OutPointer<ecan_igh_context_t>,
    config: &IghConfig,
    options: EcrtOptions,
) -> Result<(), ecan_result_t> {
    open_own(call, context, config, |call, config| open_library(call, config, options))
}

/// As [`ecan_igh_init`], on a library that a Rust program has opened, in place of the configured one: contexts that
/// share a simulation. Not for C.
///
/// # Safety
/// As for [`ecan_igh_init`].
pub unsafe fn init_on(
    context: *mut ecan_igh_context_t,
    config: *const ecan_igh_config_t,
    ecrt: &Ecrt,
) -> c_int {
    ecan_c_boundary::call("ecan_igh_init", |call| {
        pointers!(call, out(context), encoded(config));
        open_own(call, &context, &config, |_, _| Ok(Library::of(ecrt.clone())))
    })
}

/// Adds slaves to a master that the application runs itself, for other slaves on the same bus.
///
/// Requesting, activating, sending, receiving and releasing stay with the owner: call this before
/// ecrt_master_activate(), ecan_igh_owner_activated() after it, in each cycle ecan_igh_receive()
/// (or igh_mcan_port_cycle_begin()) after ecrt_master_receive() and ecan_igh_send() (or
/// igh_mcan_port_cycle_end()) before ecrt_master_send(). Functions that wait by running the cycle
/// return ECAN_ERR_ATTACHED; poll ecan_igh_is_operational() or igh_mcan_port_is_ready() instead.
/// Deinit the context before ecrt_master_deactivate() and ecrt_release_master().
///
/// The library is the libethercat that this process has loaded; it is not loaded again. Under the
/// simulated libethercat (LD_LIBRARY_PATH=build/sim) the setting `sim...` means this library. A path
/// as the setting must be that of the loaded library.
///
/// @param master  The owner's ec_master_t, reserved, of the library that this process has loaded.
///
/// @usage   not rt, the owner's thread, before ecrt_master_activate
/// @return  As ecan_igh_init(); ECAN_ERR_ECRT also if the process has loaded no libethercat, or another
///          one than the setting `ecrt` selects.
#[must_use]
#[export(call)]
pub fn ecan_igh_attach(
    context: *mut ecan_igh_context_t,
    config: *const ecan_igh_config_t,
    master: *mut c_void,
) {
    pointers!(call, out(context), out(master), encoded(config));
    open(call, &context, &config, find_loaded, |ecrt, rust| {
        // SAFETY: the header demands the owner's reserved master of this library.
        let master = unsafe { Master::from_raw(ecrt.clone(), master.as_ptr().cast()) };
        let master = master.map_err(|errno| call.fail(ECAN_ERR_MASTER, format_args!("{errno}")))?;
        let stop = config.stop();
        Adapter::attach_with_stop(ecrt, master, rust, config.startup_plan(), stop).or_code(call)
    })
}

/// Reports that the owner has activated the master.
///
/// @usage   not rt, the owner's thread, after ecrt_master_activate
/// @return  ECAN_OK; ECAN_ERR_ORDER for a context that is not attached or active already;
///          ECAN_ERR_MASTER.
#[must_use]
#[export(call, layer adapter)]
pub fn ecan_igh_owner_activated(context: *mut ecan_igh_context_t) {
    adapter.owner_activated().or_code(call)
}

/// Starts cyclic operation without waiting for OP: from now on the application runs the cycle and
/// polls ecan_igh_is_operational() or igh_mcan_port_is_ready().
///
/// @usage   not rt, the cycle's thread, after init and igh_mcan_port_init
/// @return  ECAN_OK; ECAN_ERR_ORDER if it is active already; ECAN_ERR_ATTACHED, ECAN_ERR_MASTER.
#[must_use]
#[export(call, layer adapter)]
pub fn ecan_igh_activate(context: *mut ecan_igh_context_t) {
    adapter.activate().or_code(call)
}

/// Starts cyclic operation if necessary and runs the cycle until every slave is in OP; with a Port
/// also until every gateway is verified, so that frames can be sent. Blocks and drops received
/// frames. Call igh_mcan_port_init() before, since a Port needs a bus that is not active yet.
///
/// @param timeout_ms  Milliseconds; ecan_igh_startup_timeout_ms() returns a sufficient time.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_NOT_OPERATIONAL with the state of every slave that is not in OP, the
///          reason, and ecan_last_abort_code() of a startup SDO that was aborted;
///          ECAN_ERR_VERIFICATION for a gateway in OP whose readback differs from the configuration;
///          ECAN_ERR_STOPPED, ECAN_ERR_ATTACHED, ECAN_ERR_MASTER.
#[export(call, bus bus)]
pub fn ecan_igh_wait_op_timeout(context: *mut ecan_igh_context_t, timeout_ms: u32) {
    bus.run_to_end(call)?;
    match bus.port_mut() {
        Some(port) => {
            let timeout = Duration::from_millis(timeout_ms.into());
            port.wait_ready_timeout(timeout).or_code(call)?;
            bus.watch_port();
            Ok(())
        }
        None => {
            let waited = bus.need_adapter(call)?.wait_op(Duration::from_millis(timeout_ms.into()));
            waited.or_code(call)
        }
    }
}

/// Sets a function that the waiting calls of all layers call once per cycle; if it returns other
/// than 0, they end with ECAN_ERR_STOPPED: after a signal or a pressed button, for example. Started
/// operations continue as long as the cycle runs. igh_cia402_shutdown_timeout() does not call it.
///
/// @param stop  Gets `user`; NULL for none. It should be quick; a call to the library with this
///              context returns ECAN_ERR_BUSY there. It must return: a C++ exception that leaves it
///              ends the process, with a message on standard error.
/// @param user  Is passed to it, in the thread that waits.
///
/// @usage   not rt, the cycle's thread, after init
#[export(_, layer adapter)]
pub fn ecan_igh_stop_waiting_when(
    context: *mut ecan_igh_context_t,
    stop: Option<unsafe extern "C-unwind" fn(user: *mut c_void) -> c_int>,
    user: *mut c_void,
) {
    adapter.stop_waiting_when(stop.map(|function| StopCallback { function, user }.check()));
}

/// Returns 1 if an observer requested the application to stop (ecan_igh_observer_request_stop()). All
/// calls that wait end with ECAN_ERR_STOPPED then, except igh_cia402_shutdown_timeout() and
/// igh_cia402_stop_all_timeout().
///
/// @usage   rt, the cycle's thread, after init
/// @return  1 or 0; 0 after an error, which ecan_last_error_code() gives.
#[export(_, layer adapter, or 0)]
pub fn ecan_igh_is_stop_requested(context: *mut ecan_igh_context_t) -> c_int {
    Ok(adapter.is_stop_requested().into())
}

/// Ends a request to stop: calls wait again.
///
/// @usage   rt, the cycle's thread, after init
#[export(_, layer adapter)]
pub fn ecan_igh_clear_stop_request(context: *mut ecan_igh_context_t) {
    adapter.clear_stop_request();
}

/// Leaves cyclic operation and configures the slaves again, to change N at run time for example
/// (manual 14.2). Then wait for OP again. With a Port use igh_mcan_port_reconfigure().
///
/// @usage   not rt, the cycle's thread, after init
/// @return  As ecan_igh_init(); ECAN_ERR_ORDER with a Port, ECAN_ERR_ATTACHED. A faulty
///          configuration changes nothing; after any other error reconfigure again.
#[must_use]
#[export(call, bus bus)]
pub fn ecan_igh_reconfigure(context: *mut ecan_igh_context_t, config: *const ecan_igh_config_t) {
    pointers!(call, encoded(config));
    if bus.port_mut().is_some() {
        let text = format_args!("there is a Port on it: call igh_mcan_port_reconfigure");
        return Err(call.fail(ecan_result_t::ECAN_ERR_ORDER, text));
    }
    let (startup, config) = (config.startup_plan(), config.adapter_config());
    let reconfigured = bus.need_adapter(call)?.reconfigure(config, startup);
    if reconfigured.as_ref().err().is_none_or(errors::has_changed) {
        bus.forget_configuration();
    }
    reconfigured.or_code(call)
}

/// Requests another startup of the slaves whose startup failed; igh_mcan_port_get_session() shows that
/// a gateway waits for it. The waiting calls and, at increasing intervals, the cycle of a Port request
/// it as well. With a library before version 1.6 it takes the master's semaphore, usually for
/// microseconds but without a bound: a Port does not request it there while a gateway is ready, and
/// the application calls it between two cycles, not while axes of other gateways move.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_ORDER if the bus is not active; ECAN_ERR_ATTACHED, since the owner
///          calls ecrt_master_reset(); ECAN_ERR_MASTER.
#[must_use]
#[export(call, layer adapter)]
pub fn ecan_igh_retry_startup(context: *mut ecan_igh_context_t) {
    adapter.retry_startup().or_code(call)
}

/// Leaves cyclic operation and releases the master, or detaches from the owner's. A Port and axes
/// on it end, too: axes that may move are stopped before, as by igh_cia402_context_deinit().
///
/// @usage   not rt, the cycle's thread, any time
/// @return  ECAN_OK, also for a context that is deinitialised already or never was initialised.
///          Also for a copy of it, which ends nothing. ECAN_ERR_AXES names the axes that may still
///          move; everything is closed nevertheless.
#[export(call, end bus)]
pub fn ecan_igh_deinit(context: *mut ecan_igh_context_t) {
    let left = bus.leave();
    left.map_or(Ok(()), |mut bus| bus.stop_axes()).or_code(call)
}

/// Returns a sufficient timeout for ecan_igh_wait_op_timeout(), by the startup SDOs, the cycle and
/// the number of slaves.
///
/// @usage   rt, the cycle's thread, after init
/// @return  Milliseconds; 0 if there is no context.
#[export(_, layer adapter, or 0)]
pub fn ecan_igh_startup_timeout_ms(context: *mut ecan_igh_context_t) -> u32 {
    let timeout = adapter.startup_timeout();
    Ok(u32::try_from(timeout.as_millis()).unwrap_or(u32::MAX))
}

// Section: Simulated bus
//
// The setting "sim" of ecan_igh_config_set_ecrt(), or of the environment variable ECAN_ECRT, selects
// the built-in simulator. The settings have no effect on a real bus.

/// Suggests the scenario for a plain "sim": "echo" (the default) or "drives".
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT, ECAN_ERR_BUFFER.
#[export(call, config config)]
pub fn ecan_igh_config_suggest_scenario(config: *mut ecan_igh_config_t, name: *const c_char) {
    pointers!(call, text(name));
    config.scenario = Text::new(call, "name", name)?;
}

/// Selects the clock of a simulated master, unless its scenario does. A real library ignores it.
///
/// @param stepped  0: wall-clock time, the default. Else: time passes only while the program waits
///                 for the next cycle, as fast as the machine allows; same seed, same result.
///
/// @usage   not rt, any thread, before init
#[export(_, config config)]
pub fn ecan_igh_config_set_stepped_clock(config: *mut ecan_igh_config_t, stepped: c_int) {
    config.is_stepped = stepped != 0;
}

/// Sets the seed of a simulation, in place of the scenario's.
///
/// @usage   not rt, any thread, before init
#[export(_, config config)]
pub fn ecan_igh_config_set_seed(config: *mut ecan_igh_config_t, seed: u64) {
    config.seed = Some(seed);
}

/// Returns 1 if the bus is simulated.
///
/// @usage   rt, the cycle's thread, after init
/// @return  1 or 0; 0 after an error, which ecan_last_error_code() gives.
#[export(_, layer adapter, or 0)]
pub fn ecan_igh_is_simulated(context: *mut ecan_igh_context_t) -> c_int {
    Ok(adapter.ecrt().is_simulated().into())
}

/// Returns 1 if time passes only while the program waits for the next cycle: in a simulation with a
/// stepped clock. The program must then take its own deadlines from ecan_igh_now_ns().
///
/// @usage   rt, the cycle's thread, after init
/// @return  1 or 0; 0 after an error, which ecan_last_error_code() gives.
#[export(_, bus bus, or 0)]
pub fn ecan_igh_clock_is_stepped(context: *mut ecan_igh_context_t) -> c_int {
    Ok(bus.is_stepped.into())
}

struct Library {
    ecrt: Ecrt,
    /// The library is simulated, and its time passes only while the program waits.
    is_stepped: bool,
}

impl Library {
    fn of(ecrt: Ecrt) -> Self {
        let is_stepped = ecrt.is_simulated() && !ecrt.clock().is_free_running();
        Self { ecrt, is_stepped }
    }
}

fn open_configured_library(call: Call, config: &IghConfig) -> Result<Library, ecan_result_t> {
    open_library(call, config, EcrtOptions::for_gateways(&config.adapter_config()))
}

/// Loads the library that the configuration selects. A simulated one identifies itself on standard
/// error.
fn open_library(
    call: Call,
    config: &IghConfig,
    options: EcrtOptions,
) -> Result<Library, ecan_result_t> {
    let opened = with_settings(options, config).open().or_code(call)?;
    #[cfg(feature = "sim")]
    if let Some(simulation) = &opened.simulation {
        crate::callback::write_line(&simulation.banner());
    }
    warn_of_release(&opened.ecrt);
    Ok(Library::of(opened.ecrt))
}

/// The library that this process has loaded, of which the owner of a master has its handle.
fn find_loaded(call: Call, config: &IghConfig) -> Result<Library, ecan_result_t> {
    let ecrt = with_settings(EcrtOptions::default(), config).find_loaded().or_code(call)?;
    warn_of_release(&ecrt);
    Ok(Library::of(ecrt))
}

/// Writes the warning of a release that was not tested on standard error.
fn warn_of_release(ecrt: &Ecrt) {
    if let Some(warning) = ecrt.release_warning() {
        crate::callback::write_line(&warning);
    }
}

/// Adds the settings of the configuration.
fn with_settings(options: EcrtOptions, config: &IghConfig) -> EcrtOptions {
    // CMake's ECRT_LIBRARY.
    let default_library = option_env!("ECAN_DEFAULT_ECRT").filter(|path| !path.is_empty());
    let options = EcrtOptions {
        setting: config.ecrt.as_ref().map(|text| text.get().unwrap_or_default().to_owned()),
        default_library: default_library.map(Into::into),
        ..options
    };
    #[cfg(feature = "sim")]
    let options = with_simulation(options, config);
    options
}

#[cfg(feature = "sim")]
fn with_simulation(mut options: EcrtOptions, config: &IghConfig) -> EcrtOptions {
    use ecan_lite::sim::ClockKind;

    let simulation = &mut options.simulation;
    simulation.suggested = config.scenario.get().map(str::to_owned);
    simulation.clock = Some(if config.is_stepped { ClockKind::Stepped } else { ClockKind::Real });
    simulation.seed = config.seed;
    options
}

#[cfg(all(test, feature = "sim"))]
mod tests {
    use ecan_lite::sim::ClockKind;

    use super::*;

    fn options(config: &IghConfig) -> EcrtOptions {
        with_settings(EcrtOptions::for_gateways(&config.adapter_config()), config)
    }

    #[test]
    fn simulation_has_the_settings_of_the_configuration() {
        let mut config = IghConfig::new();
        let plain = options(&config);
        assert_eq!((plain.setting, plain.simulation.gateways), (None, vec![0]));
        assert_eq!(plain.simulation.clock, Some(ClockKind::Real));
        assert_eq!(plain.simulation.carries_large_pdos, None);
        config.slave_count = 3;
        config.is_stepped = true;
        config.seed = Some(7);
        config.adapter.allow_large_pdos = true;
        let simulation = options(&config).simulation;
        assert_eq!((simulation.seed, simulation.gateways), (Some(7), vec![0; 3]));
        assert_eq!(simulation.clock, Some(ClockKind::Stepped));
        assert_eq!(simulation.carries_large_pdos, Some(true));
    }

    #[test]
    fn configuration_of_a_file_keeps_its_slaves_and_their_sizes() {
        let adapter = ecan_host::AdapterConfig::new(2).with_multiplier(5);
        let gateway = ecan_mcan_port::GatewayConfig::on_channel(
            0,
            ecan_mcan_port::ChannelConfig::fd(1_000_000, 2_000_000),
        );
        let port = ecan_mcan_port::PortConfig::uniform(2, gateway);
        let mut config = IghConfig::new().with(&adapter, port);
        config.size_slaves(&port);
        let slaves = config.adapter_config().slaves;
        assert!(slaves.iter().eq(adapter.slaves.iter()), "{slaves:?}");
        assert_eq!(config.applied_port(), Some(port));
    }
}
