//! Scheduled transmission
//!
//! Frames sent at a phase of Sync0 (manual 8.4, 13.8, 13.9): the time that they have to get there,
//! and what became of them, as far as the gateway tells. igh_mcan_port_schedule_can() and its like
//! send them.

use std::ffi::c_int;

use ecan_mcan_host::boundary::call;
use ecan_mcan_host::common::constants::ECAN_MCAN_CHANNELS;
use ecan_mcan_host::common::result::ecan_result_t;
use ecan_mcan_port::{
    ChannelDrops, MarginCheck, ScheduleAccount, ScheduleConfig, ScheduleDiagnostics, ScheduleMargin,
};

use super::config::{PortPlain, igh_mcan_port_config_t};
use super::context::igh_mcan_port_t;
use super::state::{find_channel, need_slave};
use crate::bus;

/// The times that the margin of a schedule is reckoned with, and what is done without margin. The
/// manual gives no times; docs/ASSUMPTIONS.md says where the defaults come from.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct igh_mcan_schedule_settings_t {
    /// Latest time behind the point of the grid at which the cycle is sent, in nanoseconds.
    pub latest_send_ns: u32,
    /// Way of an image through host and network card, in nanoseconds, beside its time on the wire.
    pub transport_ns: u32,
    /// What the firmware needs until a frame waits for its phase, in nanoseconds.
    pub processing_ns: u32,
    /// Interval at which the gateway's diagnostics are read once a frame was scheduled, in
    /// milliseconds; 0 never reads them.
    pub watch_ms: u32,
    /// 1 refuses frames without margin; 0 sends and counts them.
    pub refuse_without_margin: u8,
    /// 1 gives up an image of scheduled frames only that may not have arrived, since published
    /// again they could leave a period late.
    pub give_up_missed: u8,
    /// Not used.
    pub reserved: [u8; 2],
}

impl From<ScheduleConfig> for igh_mcan_schedule_settings_t {
    fn from(from: ScheduleConfig) -> Self {
        Self {
            latest_send_ns: from.latest_send_ns,
            transport_ns: from.transport_ns,
            processing_ns: from.processing_ns,
            watch_ms: from.watch_ms,
            refuse_without_margin: (from.margin_check == MarginCheck::Reject).into(),
            give_up_missed: from.give_up_missed.into(),
            reserved: [0; 2],
        }
    }
}

impl From<igh_mcan_schedule_settings_t> for ScheduleConfig {
    fn from(from: igh_mcan_schedule_settings_t) -> Self {
        Self {
            latest_send_ns: from.latest_send_ns,
            transport_ns: from.transport_ns,
            processing_ns: from.processing_ns,
            margin_check: match from.refuse_without_margin {
                0 => MarginCheck::Count,
                _ => MarginCheck::Reject,
            },
            watch_ms: from.watch_ms,
            give_up_missed: from.give_up_missed != 0,
        }
    }
}

/// Times around the Sync0 pulse that the offset of a scheduled frame counts from, in nanoseconds
/// from the point of the cycle's grid.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct igh_mcan_schedule_margin_t {
    /// Earliest arrival of the image in the gateway.
    pub earliest_arrival_ns: u64,
    /// Latest arrival of the image in the gateway.
    pub latest_arrival_ns: u64,
    /// The pulse that the offset counts from.
    pub pulse_ns: u64,
    /// The phase at which the frame leaves.
    pub release_ns: u64,
    /// From the pulse before to the earliest arrival.
    pub after_pulse_ns: i64,
    /// From the latest arrival to the pulse; negative where the pulse falls among the arrivals.
    pub before_pulse_ns: i64,
    /// From the end of the firmware's work to the phase; negative where frames may be dropped.
    pub before_release_ns: i64,
    /// The least of the three: what there is to spare.
    pub least_ns: i64,
}

impl From<ScheduleMargin> for igh_mcan_schedule_margin_t {
    fn from(from: ScheduleMargin) -> Self {
        Self {
            earliest_arrival_ns: from.earliest_arrival_ns,
            latest_arrival_ns: from.latest_arrival_ns,
            pulse_ns: from.pulse_ns,
            release_ns: from.release_ns,
            after_pulse_ns: from.after_pulse_ns,
            before_pulse_ns: from.before_pulse_ns,
            before_release_ns: from.before_release_ns,
            least_ns: from.least_ns(),
        }
    }
}

/// What became of a channel's scheduled frames. `scheduled` is the sum of `sent` to `open`; all but
/// `open` only grow.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct igh_mcan_schedule_account_t {
    /// Frames that were taken.
    pub scheduled: u64,
    /// Frames that the gateway took and, by its flags, handed to the CAN controller at their phase.
    pub sent: u64,
    /// Frames that the gateway dropped since they came behind their phase. Needs TX_RESULT.
    pub late_dropped: u64,
    /// Frames that found the gateway's schedule full. Needs TX_RESULT.
    pub queue_full: u64,
    /// Frames that the gateway did not take for another reason. Needs TX_RESULT.
    pub not_sent: u64,
    /// Frames that never left the host: discarded, or taken back since the cycle ended too late.
    pub withdrawn: u64,
    /// Frames of which it cannot be told, among them those of an image that was published again, a
    /// period late.
    pub unknown: u64,
    /// Frames of which it is not told yet.
    pub open: u64,
    /// Frames that were refused since their cycle had begun too late for the phase.
    pub refused_late: u64,
    /// Frames among `scheduled` that were taken without margin.
    pub without_margin: u64,
}

impl From<ScheduleAccount> for igh_mcan_schedule_account_t {
    fn from(from: ScheduleAccount) -> Self {
        Self {
            scheduled: from.scheduled,
            sent: from.sent,
            late_dropped: from.late_dropped,
            queue_full: from.queue_full,
            not_sent: from.not_sent,
            withdrawn: from.withdrawn,
            unknown: from.unknown,
            open: from.open,
            refused_late: from.refused_late,
            without_margin: from.without_margin,
        }
    }
}

/// Flag of 0xB000:06: a scheduled frame was dropped since its phase had passed.
pub const IGH_MCAN_SCHEDULE_LATE_DROP: u16 = 0x0040;
/// Flag of 0xB000:06: a scheduled frame found the queue full.
pub const IGH_MCAN_SCHEDULE_QUEUE_FULL: u16 = 0x0080;
/// Flag of 0xB000:06: a scheduled frame was refused by the CAN controller at its phase.
pub const IGH_MCAN_SCHEDULE_TX_FAIL: u16 = 0x0100;
/// Flag of 0xB000:06: the timer missed a phase.
pub const IGH_MCAN_SCHEDULE_TIMER_MISS: u16 = 0x0200;

/// Counters of one channel, 0x9020 to 0x9023 (manual 13.2.5).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct igh_mcan_channel_drops_t {
    /// :11 Times that the controller's FIFO was full.
    pub fifo_full: u32,
    /// :12 Frames dropped as stale.
    pub stale_drops: u32,
    /// :13 Times that the channel went off the bus.
    pub bus_offs: u32,
}

impl From<ChannelDrops> for igh_mcan_channel_drops_t {
    fn from(from: ChannelDrops) -> Self {
        Self { fifo_full: from.fifo_full, stale_drops: from.stale_drops, bus_offs: from.bus_offs }
    }
}

/// What a gateway tells of its scheduled transmission.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct igh_mcan_schedule_diagnostics_t {
    /// When the reading ended, on the clock of ecan_igh_now_ns().
    pub read_at_ns: u64,
    /// Per channel; all 0 for one that is not enabled.
    pub channels: [igh_mcan_channel_drops_t; ECAN_MCAN_CHANNELS],
    /// 0x9011:02 Sync0 pulses counted.
    pub sync0_count: u32,
    /// 0x9011:04 Smallest distance from a Sync0 pulse to the arrival of an image, in CPU cycles of
    /// the gateway (0x8000:04).
    pub phase_min_cycles: i32,
    /// 0x9011:05 Largest such distance.
    pub phase_max_cycles: i32,
    /// 0x9011:13 Longest service of scheduled frames, in CPU cycles.
    pub service_max_cycles: u32,
    /// 0xB000:06 IGH_MCAN_SCHEDULE_ values and others (manual 13.7); they stay until they are
    /// cleared.
    pub flags: u16,
    /// Not used.
    pub reserved: [u8; 6],
}

impl From<ScheduleDiagnostics> for igh_mcan_schedule_diagnostics_t {
    fn from(from: ScheduleDiagnostics) -> Self {
        Self {
            read_at_ns: from.read_at_ns,
            channels: from.channels.map(Into::into),
            sync0_count: from.sync0_count,
            phase_min_cycles: from.phase_min_cycles,
            phase_max_cycles: from.phase_max_cycles,
            service_max_cycles: from.service_max_cycles,
            flags: from.flags,
            reserved: [0; 6],
        }
    }
}

/// Fills the settings with their defaults.
///
/// @usage   rt, any thread, any time
/// @return  ECAN_OK, ECAN_ERR_NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_default_schedule(
    settings: *mut igh_mcan_schedule_settings_t,
) -> c_int {
    call("igh_mcan_port_default_schedule", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        unsafe { call.out("settings", settings)? }.set(ScheduleConfig::default().into());
        Ok(())
    })
}

/// Sets them for a gateway.
///
/// @usage   not rt, any thread, before apply
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_set_schedule(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    settings: *const igh_mcan_schedule_settings_t,
) -> c_int {
    call("igh_mcan_port_set_schedule", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (config, settings) =
            unsafe { (PortPlain::open(call, config)?, call.read("settings", settings)?) };
        config.gateway(call, slave)?.schedule = (*settings).into();
        Ok(())
    })
}

/// The margin that an offset has against cycle, wire and firmware.
///
/// @param offset_ns  Behind Sync0, in nanoseconds.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, whatever the margin is; ECAN_ERR_SCHEDULE for an offset that cannot be
///          scheduled at all; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY,
///          ECAN_ERR_SLAVE.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_get_schedule_margin(
    port: *mut igh_mcan_port_t,
    slave: usize,
    offset_ns: u32,
    margin: *mut igh_mcan_schedule_margin_t,
) -> c_int {
    call("igh_mcan_port_get_schedule_margin", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (mut bus, out) =
            unsafe { (bus::enter_port(call, port.cast())?, call.out("margin", margin)?) };
        let port = bus.need_port(call)?;
        let gateway = need_slave(call, port, slave)?;
        let margin = port.schedule_margin(gateway, offset_ns).map_err(|reason| {
            call.fail(ecan_result_t::ECAN_ERR_SCHEDULE, format_args!("{offset_ns} ns: {reason}"))
        })?;
        out.set(margin.into());
        Ok(())
    })
}

/// What became of a channel's scheduled frames.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_SLAVE,
///          ECAN_ERR_CHANNEL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_get_schedule_account(
    port: *mut igh_mcan_port_t,
    slave: usize,
    channel: u8,
    account: *mut igh_mcan_schedule_account_t,
) -> c_int {
    call("igh_mcan_port_get_schedule_account", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (mut bus, out) =
            unsafe { (bus::enter_port(call, port.cast())?, call.out("account", account)?) };
        let port = bus.need_port(call)?;
        let channel = find_channel(call, port, slave, channel)?;
        let account = channel.map(|channel| port.schedule_account(channel)).unwrap_or_default();
        out.set(account.into());
        Ok(())
    })
}

/// The last look at what the gateway tells of scheduled transmission.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_NOT_READY before the first look of this session; ECAN_ERR_NULL,
///          ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_SLAVE.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_get_schedule_diagnostics(
    port: *mut igh_mcan_port_t,
    slave: usize,
    diagnostics: *mut igh_mcan_schedule_diagnostics_t,
) -> c_int {
    call("igh_mcan_port_get_schedule_diagnostics", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (mut bus, out) =
            unsafe { (bus::enter_port(call, port.cast())?, call.out("diagnostics", diagnostics)?) };
        let port = bus.need_port(call)?;
        let gateway = need_slave(call, port, slave)?;
        let diagnostics = port.schedule_diagnostics(gateway).ok_or_else(|| {
            let words = format_args!("no look was taken at slave {slave} yet");
            call.fail(ecan_result_t::ECAN_ERR_NOT_READY, words)
        })?;
        out.set(diagnostics.into());
        Ok(())
    })
}

/// Has the gateway clear the flags of 0xB000:06, and with them its other runtime diagnostics, in
/// the cycles to come (manual 13.7, bit 5).
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_SLAVE.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_clear_schedule_flags(
    port: *mut igh_mcan_port_t,
    slave: usize,
) -> c_int {
    call("igh_mcan_port_clear_schedule_flags", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let mut bus = unsafe { bus::enter_port(call, port.cast())? };
        let port = bus.need_port(call)?;
        let gateway = need_slave(call, port, slave)?;
        port.clear_schedule_flags(gateway);
        Ok(())
    })
}
