//! Snapshot of the last cycle
//!
//! ecan_igh_observer_update() copies it into the observer; the other functions read it there, so all
//! that they return belongs to one cycle. One thread at a time reads through an observer: another one
//! gets ECAN_ERR_BUSY. Functions return ECAN_ERR_NOT_READY for parts that the cycle did not run: before
//! the first update, of a Port or of axes that were not served in this cycle.

use std::ffi::c_int;
use std::fmt;

use ecan_c_boundary::Call;
use ecan_c_boundary::channel_status::igh_mcan_channel_status_t;
use ecan_c_boundary::result::ecan_result_t::{self, ECAN_ERR_NOT_READY, ECAN_ERR_SLAVE};
use ecan_c_export::export;
use ecan_cia402::AxesSnapshot;
use ecan_host::{CommandTicket, ObserverError, Snapshot};
use ecan_mcan_port::{PortSnapshot, SessionState};
use ecan_protocol::mapping::CHANNELS;

use super::handle::ecan_igh_observer_t;
use super::slot;
use crate::adapter::cycle::ecan_igh_domain_report_t;
use crate::cia402::state::igh_cia402_axis_state_t;
use crate::handle::{self, Kind};
use crate::mcan_port::state::igh_mcan_session_t;
use crate::mcan_port::statistics::{igh_mcan_channel_statistics_t, igh_mcan_statistics_t};

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
        slot::enter(observer.cast())
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
