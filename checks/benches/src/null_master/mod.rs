//! A master that exchanges nothing, for benchmarks of the host alone.
//!
//! A bus is configured and brought into operation on a simulated master. Then it is frozen: a wait
//! ends at once and advances the time to its end, and the functions of the cycle only succeed. The
//! TxPDO image of each domain stays as it is, or as [`replace`] made it; only its sequence number
//! increases, so that each cycle sees a new image. The measured time is the work of the host, without
//! the system calls of a real master and without the simulator.

mod timed_library;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicPtr, AtomicU64, AtomicUsize, Ordering};

use ecan_sim::libethercat as simulated;
use ecan_sim::{
    BackendError, ClockKind, EcrtVersion, Scenario, SimClock, SimOptions, Simulation, open_scenario,
};
use ecrt_sys::{
    Clock, EC_AL_STATE_OP, EC_WC_COMPLETE, Ecrt, OpenMaster, Status, ec_domain_state_t,
    ec_domain_t, ec_master_t, ec_slave_config_state_t, ec_slave_config_t,
};
use libc::c_int;

pub use timed_library::{LibraryTime, timed};

const MOST_DOMAINS: usize = 128;
const VERSION_MAGIC: u32 = 0x106;
/// Offsets in the header of an image (manual 6).
const FLAGS: usize = 1;
const SEQ_BEGIN: usize = 2;
const SEQ_END: usize = 4;
const FLAG_SEQ_WRAP: u8 = 0x10;

static IS_FROZEN: AtomicBool = AtomicBool::new(false);
static DOMAINS: [Domain; MOST_DOMAINS] = [const { Domain::unused() }; MOST_DOMAINS];

/// A domain of the process.
struct Domain {
    handle: AtomicPtr<ec_domain_t>,
    memory: AtomicPtr<u8>,
    size: AtomicUsize,
    /// Offset of its TxPDO image in the memory, once set.
    image: AtomicUsize,
}

const NO_IMAGE: usize = usize::MAX;

impl Domain {
    const fn unused() -> Self {
        Self {
            handle: AtomicPtr::new(std::ptr::null_mut()),
            memory: AtomicPtr::new(std::ptr::null_mut()),
            size: AtomicUsize::new(0),
            image: AtomicUsize::new(NO_IMAGE),
        }
    }

    /// The domain of this handle, or an unused entry.
    fn of(handle: *mut ec_domain_t) -> Option<&'static Self> {
        DOMAINS.iter().find(|domain| {
            let known = domain.handle.load(Ordering::Relaxed);
            known == handle || known.is_null()
        })
    }

    /// The domain that contains `image`, and its offset there.
    fn around(image: &[u8]) -> (&'static Self, usize) {
        let place = |domain: &Self| {
            let start = domain.memory.load(Ordering::Relaxed).addr();
            let offset = image.as_ptr().addr().checked_sub(start)?;
            (offset + image.len() <= domain.size.load(Ordering::Relaxed)).then_some(offset)
        };
        let found = DOMAINS.iter().find_map(|domain| Some((domain, place(domain)?)));
        found.expect("the image of a domain that was activated on a null master")
    }

    /// Gives the TxPDO image its next sequence number.
    fn advance(&self) {
        let image = self.image.load(Ordering::Relaxed);
        if image == NO_IMAGE {
            return;
        }
        let memory = self.memory.load(Ordering::Relaxed);
        // SAFETY: `around` has seen that a whole image lies at this place of the domain's memory,
        // and the caller of libethercat lets no slice of it live across the call.
        unsafe {
            let image = memory.add(image);
            let begin = image.add(SEQ_BEGIN).cast::<u16>();
            let sequence = u16::from_le(begin.read_unaligned()).wrapping_add(1);
            begin.write_unaligned(sequence.to_le());
            image.add(SEQ_END).cast::<u16>().write_unaligned(sequence.to_le());
            let flags = image.add(FLAGS);
            let wrap = if sequence == 0 { FLAG_SEQ_WRAP } else { 0 };
            flags.write(flags.read() & !FLAG_SEQ_WRAP | wrap);
        }
    }
}

/// A library on a simulated bus of its own, in stepped time.
///
/// # Errors
/// A faulty scenario.
pub fn open(scenario: Scenario) -> Result<Ecrt, BackendError> {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let simulation = open_scenario(scenario, &options)?.simulation.expect("a simulated library");
    let mut table = simulated::table(EcrtVersion::V1_6);
    table.domain_data = domain_data;
    table.master_receive = Status::Reported(master_receive);
    table.domain_process = Status::Reported(domain_process);
    table.domain_state = Status::Reported(domain_state);
    table.domain_queue = Status::Reported(domain_queue);
    table.master_send = Status::Reported(master_send);
    table.slave_config_state = Status::Reported(slave_config_state);
    let clock = Arc::new(FreezingClock { clock: simulation.clock(), frozen_ns: AtomicU64::new(0) });
    let scenario = simulation.scenario_name().to_owned();
    let masters = Arc::new(Masters(simulation));
    // SAFETY: the functions and handles are those of the simulated library; the replaced functions
    // pass on their arguments, or write only a result and the image of a domain.
    Ok(unsafe { Ecrt::simulated(table, masters, VERSION_MAGIC, scenario, clock) })
}

/// Replaces the TxPDO image `image` of a Port or Adapter by `bytes`.
///
/// # Panics
/// `image` is not in a domain of this process, or shorter than `bytes`.
pub fn replace(image: &[u8], bytes: &[u8]) {
    assert!(bytes.len() <= image.len());
    let (domain, offset) = Domain::around(image);
    let memory = domain.memory.load(Ordering::Relaxed);
    // SAFETY: the image lies at this place of the domain's memory and has as many bytes; what is
    // read of it later is read again.
    unsafe { memory.add(offset).copy_from_nonoverlapping(bytes.as_ptr(), bytes.len()) }
}

/// Increases the sequence number of the TxPDO image `image` in each cycle after the masters are
/// frozen.
///
/// # Panics
/// `image` is not in a domain of this process, or not an image.
pub fn keep_new(image: &[u8]) {
    assert!(image.len() >= 24, "an image has a header");
    let (domain, offset) = Domain::around(image);
    domain.image.store(offset, Ordering::Relaxed);
}

/// Freezes all masters of this process for good.
pub fn freeze() {
    IS_FROZEN.store(true, Ordering::Relaxed);
}

fn is_frozen() -> bool {
    IS_FROZEN.load(Ordering::Relaxed)
}

/// The clock of the simulation, which stops with it.
struct FreezingClock {
    clock: SimClock,
    frozen_ns: AtomicU64,
}

impl Clock for FreezingClock {
    fn now_ns(&self) -> u64 {
        if is_frozen() {
            return self.frozen_ns.load(Ordering::Relaxed);
        }
        let now_ns = self.clock.now_ns();
        self.frozen_ns.store(now_ns, Ordering::Relaxed);
        now_ns
    }

    fn sleep_until_ns(&self, deadline_ns: u64) {
        if is_frozen() {
            self.frozen_ns.fetch_max(deadline_ns, Ordering::Relaxed);
        } else {
            self.clock.sleep_until_ns(deadline_ns);
        }
    }
}

/// The masters of the simulation.
struct Masters(Simulation);

impl OpenMaster for Masters {
    fn request(&self, index: u32) -> *mut ec_master_t {
        simulated::request_master(&self.0, index)
    }

    fn open(&self, index: u32) -> *mut ec_master_t {
        simulated::open_master(&self.0, index)
    }
}

unsafe extern "C" fn domain_data(handle: *mut ec_domain_t) -> *mut u8 {
    // SAFETY: the same arguments under the same promises.
    let (memory, size) =
        unsafe { (simulated::domain_data(handle), simulated::domain_size(handle)) };
    let domain = Domain::of(handle).expect("not that many domains");
    domain.handle.store(handle, Ordering::Relaxed);
    domain.memory.store(memory, Ordering::Relaxed);
    domain.size.store(size, Ordering::Relaxed);
    memory
}

unsafe extern "C" fn master_receive(master: *mut ec_master_t) -> c_int {
    // SAFETY: the same arguments under the same promises.
    if is_frozen() { 0 } else { unsafe { simulated::master_receive(master) } }
}

unsafe extern "C" fn domain_process(handle: *mut ec_domain_t) -> c_int {
    if !is_frozen() {
        // SAFETY: the same arguments under the same promises.
        return unsafe { simulated::domain_process(handle) };
    }
    if let Some(domain) = Domain::of(handle) {
        domain.advance();
    }
    0
}

unsafe extern "C" fn domain_state(
    handle: *const ec_domain_t,
    state: *mut ec_domain_state_t,
) -> c_int {
    if !is_frozen() {
        // SAFETY: the same arguments under the same promises.
        return unsafe { simulated::domain_state(handle, state) };
    }
    let complete = ec_domain_state_t {
        working_counter: 3,
        wc_state: EC_WC_COMPLETE,
        ..ec_domain_state_t::default()
    };
    // SAFETY: the caller passes valid memory for the result.
    unsafe { state.write(complete) };
    0
}

unsafe extern "C" fn domain_queue(handle: *mut ec_domain_t) -> c_int {
    // SAFETY: the same arguments under the same promises.
    if is_frozen() { 0 } else { unsafe { simulated::domain_queue(handle) } }
}

unsafe extern "C" fn master_send(master: *mut ec_master_t) -> c_int {
    // SAFETY: the same arguments under the same promises.
    if is_frozen() { 0 } else { unsafe { simulated::master_send(master) } }
}

unsafe extern "C" fn slave_config_state(
    config: *const ec_slave_config_t,
    state: *mut ec_slave_config_state_t,
) -> c_int {
    if !is_frozen() {
        // SAFETY: the same arguments under the same promises.
        return unsafe { simulated::slave_config_state(config, state) };
    }
    let mut operational = ec_slave_config_state_t::default();
    operational.set_online(1);
    operational.set_operational(1);
    operational.set_al_state(EC_AL_STATE_OP as _);
    // SAFETY: the caller passes valid memory for the result.
    unsafe { state.write(operational) };
    0
}
