//! Observers: `igh_observer.h`.

use std::cell::UnsafeCell;
use std::ffi::c_int;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use std::{fmt, thread};

use ecan_c_boundary::image::igh_mcan_channel_status_t;
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::result::ecan_result_t::{ECAN_ERR_NOT_READY, ECAN_ERR_SLAVE};
use ecan_c_boundary::{Call, pointers};
use ecan_c_export::export;
use ecan_cia402::AxesSnapshot;
use ecan_host::{CommandTicket, Observer, ObserverError, Snapshot};
use ecan_mcan_port::{PortSnapshot, SessionState};
use ecan_protocol::mapping::CHANNELS;

use crate::adapter::context::ecan_igh_context_t;
use crate::adapter::cycle::ecan_igh_domain_report_t;
use crate::cia402::commands::IGH_CIA402_ALL_AXES;
use crate::cia402::state::igh_cia402_axis_state_t;
use crate::handle;
use crate::handle::{Kind, Words};
use crate::mcan_port::state::{
    igh_mcan_channel_statistics_t, igh_mcan_session_t, igh_mcan_statistics_t,
};

// Section: Life of an observer
//
// A handle for other threads than the cycle's: it reads a snapshot of the last cycle, and gives
// commands that the next cycle executes. The cycle never waits for it. Only ecan_igh_observer_init()
// uses the context: from another thread it returns ECAN_ERR_BUSY while a cycle runs. All other
// functions work also then.
//
// static ecan_igh_observer_t observer;             for the monitor and the signal handler
// ecan_igh_observer_init(&observer, &igh);         in the thread of the cycle
// ...
// if (ecan_igh_observer_update(&observer) == 0) {  in the monitor's thread
//     igh_cia402_observer_get_axis_state(&observer, 0, &state);
// }
// ...
// ecan_igh_observer_request_stop(&observer, NULL); in a signal handler

/// A handle of other threads to the cycle. Any number of them per ecan_igh_context_t, one for each
/// thread that reads. Do not move or copy it.
#[repr(C)]
#[derive(Debug)]
pub struct ecan_igh_observer_t {
    /// Not for the application.
    pub opaque: [u64; 4],
}

const _: () = assert!(size_of::<ecan_igh_observer_t>() == size_of::<Words>());

/// Creates an observer. It outlives its context: ecan_igh_observer_update() reports the end. While a
/// context has observers its cycle publishes a snapshot at its end.
///
/// @param observer  Any content.
/// @param igh       The context, with or without Port and axes, which may be opened later.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_ORDER for an observer that is initialised already.
#[export(call, layer adapter, of igh)]
pub fn ecan_igh_observer_init(observer: *mut ecan_igh_observer_t, igh: *mut ecan_igh_context_t) {
    pointers!(call, out(observer));
    // SAFETY: `out` was promised that the pointer is valid for writing.
    unsafe { init(call, observer.as_ptr().cast(), adapter.observer()) }
}

/// Ends an observer, after calls of other threads with it that are in progress. Later calls return
/// ECAN_ERR_NOT_INITIALISED. Calling it again is harmless.
///
/// @usage   not rt, any thread but no signal handler, any time
#[export(call)]
pub fn ecan_igh_observer_deinit(observer: *mut ecan_igh_observer_t) {
    need(call, observer)?;
    // SAFETY: the pointer is not NULL, so valid for reading by the header's rules.
    unsafe { deinit(observer.cast()) };
}

fn need(call: Call, observer: *const ecan_igh_observer_t) -> Result<(), ecan_result_t> {
    // SAFETY: the header demands NULL or a valid pointer.
    unsafe { call.read("observer", observer) }.map(|_| ())
}

// Section: Snapshot of the last cycle
//
// ecan_igh_observer_update() copies it into the observer; the other functions read it there, so all
// that they return belongs to one cycle. One thread at a time reads through an observer: another one
// gets ECAN_ERR_BUSY. Functions return ECAN_ERR_NOT_READY for parts that the cycle did not run: before
// the first update, of a Port or of axes that were not served in this cycle.

/// Cycle of a snapshot.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ecan_igh_observed_cycle_t {
    /// Number of the cycle, from 1.
    pub cycle: u64,
    /// Its time on the clock of ecan_igh_now_ns(): its deadline, or its start without a wait for it.
    pub time_ns: u64,
    /// Delay of its start after the deadline, in nanoseconds, if has_deadline is 1.
    pub late_ns: u64,
    /// Time from its start to the end of its send, in nanoseconds.
    pub run_time_ns: u64,
    /// Cycles that missed a deadline, since ecan_igh_init().
    pub overruns: u64,
    /// Deadlines that were skipped, since ecan_igh_init().
    pub skipped: u64,
    /// Number of slaves.
    pub slave_count: u32,
    /// Number of axes; 0 if the cycle did not send targets.
    pub axis_count: u32,
    /// 1 if the cycle began with a wait for its deadline.
    pub has_deadline: u8,
    /// 1 if an observer requested the application to stop.
    pub is_stop_requested: u8,
    /// 1 if a Port ran the cycle.
    pub has_port: u8,
    /// Zero; for fields of later versions.
    pub reserved: [u8; 29],
}

/// Calls `work` with the snapshot of an observer.
fn with_snapshot<R>(
    call: Call,
    observer: *const ecan_igh_observer_t,
    work: impl FnOnce(&mut Snapshot) -> Result<R, ecan_result_t>,
) -> Result<R, ecan_result_t> {
    // SAFETY: the header demands NULL or a valid pointer.
    let entered = unsafe {
        call.read("observer", observer)?;
        enter(observer.cast())
    };
    let entered = entered.ok_or_else(|| handle::not_initialised(call, Kind::Observer))?;
    let mut snapshot = entered.snapshot().ok_or_else(|| busy(call))?;
    let snapshot =
        snapshot.as_mut().ok_or_else(|| handle::not_initialised(call, Kind::Observer))?;
    work(snapshot)
}

#[cold]
fn busy(call: Call) -> ecan_result_t {
    let text = format_args!(
        "another thread reads through this observer; use an observer for each thread that reads"
    );
    call.fail(ecan_result_t::ECAN_ERR_BUSY, text)
}

#[cold]
fn not_ready(call: Call, text: fmt::Arguments<'_>) -> ecan_result_t {
    call.fail(ECAN_ERR_NOT_READY, text)
}

#[cold]
fn no_slave(call: Call, slave: usize, count: usize) -> ecan_result_t {
    call.fail(ECAN_ERR_SLAVE, format_args!("there is no slave {slave}, the snapshot has {count}"))
}

fn with_port<R>(
    call: Call,
    observer: *const ecan_igh_observer_t,
    slave: usize,
    work: impl FnOnce(PortSnapshot<'_>) -> Option<R>,
) -> Result<R, ecan_result_t> {
    with_snapshot(call, observer, |snapshot| {
        let port = PortSnapshot::of(snapshot);
        let no_port = format_args!("no Port ran the cycle of the snapshot; update it");
        let port = port.ok_or_else(|| not_ready(call, no_port))?;
        let count = port.slave_count();
        work(port).ok_or_else(|| no_slave(call, slave, count))
    })
}

/// Takes a channel number; one that is not enabled has zeros.
fn need_channel(call: Call, channel: u8) -> Result<(), ecan_result_t> {
    if usize::from(channel) < CHANNELS {
        return Ok(());
    }
    let text = format_args!("there is no channel {channel}; allowed: 0 to {}", CHANNELS - 1);
    Err(call.fail(ecan_result_t::ECAN_ERR_CHANNEL, text))
}

/// Copies the snapshot of the last cycle into the observer. Wait-free for the cycle; repeats its copy
/// while the cycle overtakes it.
///
/// @usage   rt, any thread but one at a time, after init; takes memory after a Port or axes were opened or
///          the bus was reconfigured
/// @return  ECAN_OK; ECAN_ERR_NOT_READY before the first cycle with an observer; ECAN_ERR_ORDER if the
///          context has ended: the snapshot is that of its last cycle.
#[export(call)]
pub fn ecan_igh_observer_update(observer: *mut ecan_igh_observer_t) {
    with_snapshot(call, observer, |snapshot| match snapshot.update() {
        Ok(()) => Ok(()),
        Err(error @ ObserverError::NoCycle) => Err(not_ready(call, format_args!("{error}"))),
        Err(ObserverError::Closed) => {
            let text = format_args!("the context of the observer has ended; deinit the observer");
            Err(call.fail(ecan_result_t::ECAN_ERR_ORDER, text))
        }
    })
}

/// Gets number and times of the cycle of the snapshot.
///
/// @usage   rt, any thread but one at a time, after update
#[export(call, into cycle)]
pub fn ecan_igh_observer_get_cycle(
    observer: *mut ecan_igh_observer_t,
    cycle: *mut ecan_igh_observed_cycle_t,
) {
    with_snapshot(call, observer, |snapshot| {
        if snapshot.cycle() == 0 {
            return Err(not_ready(call, format_args!("the observer has no snapshot; update it")));
        }
        let start = snapshot.cycle_start();
        let count = |count: usize| u32::try_from(count).unwrap_or(u32::MAX);
        Ok(ecan_igh_observed_cycle_t {
            cycle: snapshot.cycle(),
            time_ns: snapshot.time_ns(),
            late_ns: start.map_or(0, |start| start.late_ns),
            run_time_ns: snapshot.run_time_ns(),
            overruns: snapshot.overruns(),
            skipped: snapshot.skipped(),
            slave_count: count(snapshot.slave_count()),
            axis_count: AxesSnapshot::of(snapshot).map_or(0, |axes| count(axes.axis_count())),
            has_deadline: start.is_some().into(),
            is_stop_requested: snapshot.is_stop_requested().into(),
            has_port: PortSnapshot::of(snapshot).is_some().into(),
            reserved: [0; 29],
        })
    })
}

/// Returns 1 if the cycle of the snapshot or an earlier one has executed a command: a quick stop was
/// given to the axis, whose state reports its effect. A quick stop that was dropped, because its axes
/// ended or others were opened before a cycle executed it, is never executed. An executed one is
/// forgotten after 63 such changes.
///
/// @param ticket  Number that the command gave; 0, of a command that was rejected, is never executed.
///
/// @usage   rt, any thread but one at a time, after update
/// @return  1 or 0; 0 after an error, which ecan_last_error_code() gives.
#[export(call, or 0)]
pub fn ecan_igh_observer_has_executed(observer: *mut ecan_igh_observer_t, ticket: u64) -> c_int {
    with_snapshot(call, observer, |snapshot| {
        Ok(snapshot.has_executed(CommandTicket::from_number(ticket)).into())
    })
}

/// Gets the result of the exchange with one slave, as ecan_igh_get_domain_report() does.
///
/// @usage   rt, any thread but one at a time, after update
#[export(call, into report)]
pub fn ecan_igh_observer_get_domain_report(
    observer: *mut ecan_igh_observer_t,
    slave: usize,
    report: *mut ecan_igh_domain_report_t,
) {
    with_snapshot(call, observer, |snapshot| {
        let report = snapshot.domain_report(slave);
        let report = report.ok_or_else(|| no_slave(call, slave, snapshot.slave_count()))?;
        Ok(report.into())
    })
}

/// Returns the state of a gateway's session, as igh_mcan_port_get_session() does.
///
/// @usage   rt, any thread but one at a time, after update
/// @return  An igh_mcan_session_t; ECAN_ERR_SLAVE, ECAN_ERR_NOT_READY.
#[export(call)]
pub fn igh_mcan_observer_get_session(observer: *mut ecan_igh_observer_t, slave: usize) -> c_int {
    let session = with_port(call, observer, slave, |port| port.session(slave))?;
    Ok(match session {
        SessionState::Waiting => igh_mcan_session_t::IGH_MCAN_SESSION_WAITING,
        SessionState::Verifying => igh_mcan_session_t::IGH_MCAN_SESSION_VERIFYING,
        SessionState::Ready => igh_mcan_session_t::IGH_MCAN_SESSION_READY,
        SessionState::Failed => igh_mcan_session_t::IGH_MCAN_SESSION_FAILED,
    } as c_int)
}

/// Gets the counters of a gateway, as igh_mcan_port_get_statistics() does.
///
/// @usage   rt, any thread but one at a time, after update
#[export(call, into statistics)]
pub fn igh_mcan_observer_get_statistics(
    observer: *mut ecan_igh_observer_t,
    slave: usize,
    statistics: *mut igh_mcan_statistics_t,
) {
    with_port(call, observer, slave, |port| port.statistics(slave)).map(Into::into)
}

/// Gets the status word of a channel, as igh_mcan_port_get_channel_status() does; zeros for a channel
/// that is not enabled.
///
/// @usage   rt, any thread but one at a time, after update
#[export(call, into status)]
pub fn igh_mcan_observer_get_channel_status(
    observer: *mut ecan_igh_observer_t,
    slave: usize,
    channel: u8,
    status: *mut igh_mcan_channel_status_t,
) {
    need_channel(call, channel)?;
    let found = with_port(call, observer, slave, |port| {
        let _ = port.session(slave)?;
        Some(port.channel_status(slave, channel).unwrap_or_default())
    });
    found.map(Into::into)
}

/// Gets the counters of a channel, as igh_mcan_port_get_channel_statistics() does; zeros for a channel
/// that is not enabled.
///
/// @usage   rt, any thread but one at a time, after update
#[export(call, into statistics)]
pub fn igh_mcan_observer_get_channel_statistics(
    observer: *mut ecan_igh_observer_t,
    slave: usize,
    channel: u8,
    statistics: *mut igh_mcan_channel_statistics_t,
) {
    need_channel(call, channel)?;
    let found = with_port(call, observer, slave, |port| {
        let _ = port.session(slave)?;
        Some(port.channel_statistics(slave, channel).unwrap_or_default())
    });
    found.map(Into::into)
}

/// Gets the state of an axis at the end of the cycle, as igh_cia402_get_axis_state() does.
///
/// @usage   rt, any thread but one at a time, after update
#[export(call, into axis_state)]
pub fn igh_cia402_observer_get_axis_state(
    observer: *mut ecan_igh_observer_t,
    axis: usize,
    axis_state: *mut igh_cia402_axis_state_t,
) {
    with_snapshot(call, observer, |snapshot| {
        let axes = AxesSnapshot::of(snapshot);
        let not_sent = format_args!("the cycle of the snapshot did not send targets; update it");
        let axes = axes.ok_or_else(|| not_ready(call, not_sent))?;
        let count = axes.axis_count();
        let no_axis = format_args!("there is no axis {axis}, the snapshot has {count}");
        let status = axes.axis(axis);
        let status = status.ok_or_else(|| call.fail(ecan_result_t::ECAN_ERR_AXIS, no_axis))?;
        Ok(status.into())
    })
}

// Section: Commands
//
// Any thread and any signal handler may give them, also while another thread reads through the same
// observer: they use atomic operations only, and store no error text. A request to stop takes effect at
// once. The cycle gives quick stops to the axes when it next sends targets: before the targets of this
// cycle, or of the next one. The quick stop is then in the image of that cycle if the gateway is ready
// and the image has room for its frame, and on the bus if the working counter of the image is complete:
// an image that was not confirmed is repeated first.
//
// Each command gives a ticket, which is not 0; ecan_igh_observer_has_executed() returns 1 for it once a
// cycle has given the command to the axis. Its effect is in the state of the axis: stop_cause and
// phase.

/// Gives a command. Stores no error text, which may be in use by what a signal handler interrupts.
fn command(
    observer: *const ecan_igh_observer_t,
    ticket: *mut u64,
    give: impl FnOnce(&Observer) -> Result<CommandTicket, ecan_result_t>,
) -> Result<(), ecan_result_t> {
    let given = give_command(observer, give);
    if !ticket.is_null() {
        let number = given.as_ref().map_or(0, |given| given.number());
        // SAFETY: not NULL, so valid for writing by the header's rules.
        unsafe { ticket.write(number) };
    }
    given.map(|_| ())
}

fn give_command(
    observer: *const ecan_igh_observer_t,
    give: impl FnOnce(&Observer) -> Result<CommandTicket, ecan_result_t>,
) -> Result<CommandTicket, ecan_result_t> {
    if observer.is_null() {
        return Err(ecan_result_t::ECAN_ERR_NULL);
    }
    // SAFETY: not NULL, so valid for reading by the header's rules.
    let entered = unsafe { enter(observer.cast()) };
    let entered = entered.ok_or(ecan_result_t::ECAN_ERR_NOT_INITIALISED)?;
    let observer = entered.observer().ok_or(ecan_result_t::ECAN_ERR_NOT_INITIALISED)?;
    if observer.is_closed() {
        return Err(ecan_result_t::ECAN_ERR_ORDER);
    }
    give(observer)
}

/// Requests the application to stop: calls that wait end with ECAN_ERR_STOPPED, except
/// igh_cia402_shutdown_timeout() and igh_cia402_stop_all_timeout(), and ecan_igh_is_stop_requested()
/// returns 1 until ecan_igh_clear_stop_request().
///
/// @param ticket  Gets the number of the command, 0 if it is rejected; may be NULL.
///
/// @usage   rt, any thread and signal handlers, after init
/// @return  ECAN_OK; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_ORDER if the context has
///          ended; without a text in ecan_last_error().
#[export(_)]
pub fn ecan_igh_observer_request_stop(observer: *mut ecan_igh_observer_t, ticket: *mut u64) {
    command(observer, ticket, |observer| Ok(observer.request_stop()))
}

/// Commands a quick stop, as igh_cia402_quick_stop() does: to one axis, or with IGH_CIA402_ALL_AXES
/// to all of all axis tables.
///
/// @param axis    Index in the axis table that was opened last, of those that are open.
/// @param ticket  Gets the number of the command, 0 if it is rejected; may be NULL.
///
/// @usage   rt, any thread and signal handlers, after init
/// @return  ECAN_OK; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_ORDER if the context has
///          ended, ECAN_ERR_AXIS; without a text in ecan_last_error().
#[export(_)]
pub fn igh_cia402_observer_quick_stop(
    observer: *mut ecan_igh_observer_t,
    axis: usize,
    ticket: *mut u64,
) {
    command(observer, ticket, |observer| match axis {
        IGH_CIA402_ALL_AXES if observer.axis_count() == 0 => Err(ecan_result_t::ECAN_ERR_AXIS),
        IGH_CIA402_ALL_AXES => Ok(observer.quick_stop_all()),
        axis => observer.quick_stop(axis).map_err(|_| ecan_result_t::ECAN_ERR_AXIS),
    })
}

/// Pause of a deinit while calls of other threads end.
const PAUSE: Duration = Duration::from_micros(20);

/// Storage of an observer. Never freed: a handle may outlive its observer.
pub(crate) struct Slot {
    /// Ends with the observer.
    generation: AtomicU64,
    /// Calls that may use the observer.
    calls: AtomicUsize,
    observer: UnsafeCell<Option<Observer>>,
    snapshot: Mutex<Option<Snapshot>>,
}

// SAFETY: `observer` is replaced only while no handle has the generation of the slot and no call is
// in progress; otherwise it is shared.
unsafe impl Sync for Slot {}

/// Free slots, and used ones with the address of their handle.
static SLOTS: Mutex<Slots> = Mutex::new(Slots { free: Vec::new(), living: Vec::new() });

struct Slots {
    free: Vec<&'static Slot>,
    living: Vec<(usize, &'static Slot)>,
}

fn slots() -> MutexGuard<'static, Slots> {
    SLOTS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A call in progress.
pub(crate) struct Entered(&'static Slot);

impl Drop for Entered {
    fn drop(&mut self) {
        self.0.calls.fetch_sub(1, Ordering::SeqCst);
    }
}

impl Entered {
    /// Atomics only.
    pub(crate) fn observer(&self) -> Option<&Observer> {
        // SAFETY: this call is counted, and has seen the generation of its handle afterwards: the
        // observer stays until it ends.
        unsafe { (*self.0.observer.get()).as_ref() }
    }

    /// The snapshot of the handle; `None` while another call uses it.
    pub(crate) fn snapshot(&self) -> Option<MutexGuard<'_, Option<Snapshot>>> {
        match self.0.snapshot.try_lock() {
            Ok(snapshot) => Some(snapshot),
            Err(std::sync::TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
            Err(std::sync::TryLockError::WouldBlock) => None,
        }
    }
}

/// Slot that a handle names, if any, with the generation of the handle.
///
/// # Safety
/// `handle` is valid for reading, with any content.
unsafe fn find(handle: *const Words) -> Option<(&'static Slot, u64)> {
    // SAFETY: the caller's promise.
    let words = unsafe { handle::sealed_words(handle, Kind::Observer) }?;
    // SAFETY: the seal says that the words are ours, and slots live for ever.
    let slot = unsafe { &*std::ptr::with_exposed_provenance::<Slot>(words.slot) };
    Some((slot, words.generation))
}

/// Starts a call; `None` for a handle that names no observer. Atomics only: for signal handlers.
///
/// # Safety
/// `handle` is valid for reading, with any content.
pub(crate) unsafe fn enter(handle: *const Words) -> Option<Entered> {
    // SAFETY: the caller's promise.
    let (slot, generation) = unsafe { find(handle) }?;
    // Before the generation: `end` looks at them in the other order.
    slot.calls.fetch_add(1, Ordering::SeqCst);
    let entered = Entered(slot);
    (slot.generation.load(Ordering::SeqCst) == generation).then_some(entered)
}

/// Stores an observer and writes its handle.
///
/// # Safety
/// `handle` is valid for writing; its content is ignored.
pub(crate) unsafe fn init(
    call: Call,
    handle: *mut Words,
    observer: Observer,
) -> Result<(), ecan_result_t> {
    let address = handle.addr();
    let found = slots().living.iter().find(|(living, _)| *living == address).copied();
    if let Some((_, slot)) = found {
        let generation = slot.generation.load(Ordering::SeqCst);
        // SAFETY: the caller's promise. Only memory that was a handle is read.
        let named = unsafe { find(handle) };
        if named.is_some_and(|(other, number)| std::ptr::eq(other, slot) && number == generation) {
            return Err(handle::reject_living(call));
        }
        // The handle was overwritten.
        end(slot, generation);
    }
    let snapshot = observer.snapshot();
    let mut slots = slots();
    let slot = slots.free.pop().unwrap_or_else(|| {
        let slot: &'static Slot = Box::leak(Box::new(Slot {
            generation: AtomicU64::new(1),
            calls: AtomicUsize::new(0),
            observer: UnsafeCell::new(None),
            snapshot: Mutex::new(None),
        }));
        std::ptr::from_ref(slot).expose_provenance();
        slot
    });
    slots.living.push((address, slot));
    // SAFETY: no handle has the generation of a free slot, so no call uses the observer.
    unsafe { *slot.observer.get() = Some(observer) };
    *slot.snapshot.lock().unwrap_or_else(PoisonError::into_inner) = Some(snapshot);
    let generation = slot.generation.load(Ordering::SeqCst);
    let address = std::ptr::from_ref(slot).addr();
    // SAFETY: the caller's promise.
    unsafe { handle::write(handle, Kind::Observer, address, generation, 0) };
    Ok(())
}

/// Ends the observer of a handle, if any, after the calls that are in progress.
///
/// # Safety
/// `handle` is valid for reading, with any content.
pub(crate) unsafe fn deinit(handle: *const Words) {
    // SAFETY: the caller's promise.
    if let Some((slot, generation)) = unsafe { find(handle) } {
        end(slot, generation);
    }
}

fn end(slot: &'static Slot, generation: u64) {
    let (now, order) = (generation.wrapping_add(1), Ordering::SeqCst);
    // One of several calls ends it.
    if slot.generation.compare_exchange(generation, now, order, order).is_err() {
        return;
    }
    // A call that comes now sees the new generation and does not touch the observer.
    while slot.calls.load(Ordering::SeqCst) != 0 {
        thread::sleep(PAUSE);
    }
    // SAFETY: no call uses the observer, and no handle has the generation.
    let observer = unsafe { (*slot.observer.get()).take() };
    let snapshot = slot.snapshot.lock().unwrap_or_else(PoisonError::into_inner).take();
    drop((observer, snapshot));
    let mut slots = slots();
    slots.living.retain(|(_, living)| !std::ptr::eq(*living, slot));
    slots.free.push(slot);
}
