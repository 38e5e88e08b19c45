//! Scheduled transmission
//!
//! Frames sent at a phase of Sync0 (manual 8.4, 13.8, 13.9): the margin of their transport and
//! their results, as the gateway reports them. igh_mcan_port_schedule_can() and similar functions
//! send them.

use std::ffi::{c_char, c_int};

use ecan_c_boundary::result::{ECAN_MCAN_CHANNELS, ecan_result_t};
use ecan_c_boundary::{mirror, pointers};
use ecan_c_export::export;
use ecan_mcan_port::{
    ChannelDrops, MarginCheck, ScheduleAccount, ScheduleConfig, ScheduleDiagnostics, ScheduleFault,
    ScheduleMargin,
};

use super::config::{gateway, igh_mcan_port_config_t};
use super::context::igh_mcan_port_t;
use super::state::{find_channel, need_slave};

mirror! {
    /// Times for the margin of a schedule, and the reaction to a missing margin. The manual gives
    /// no times; docs/ASSUMPTIONS.md gives the source of the defaults.
    #[derive(Default)]
    pub struct igh_mcan_schedule_settings_t from rust: ScheduleConfig {
        /// Latest time after the deadline at which the cycle is sent, in nanoseconds.
        latest_send_ns: u32,
        /// Time of an image in host and network card, in nanoseconds, without its time on the wire.
        transport_ns: u32,
        /// Time of the firmware until a frame waits for its phase, in nanoseconds.
        processing_ns: u32,
        /// Interval at which the gateway's diagnostics are read after the first scheduled frame, in
        /// milliseconds; 0 never reads them.
        watch_ms: u32,
        /// 1 rejects frames without margin; 0 sends and counts them.
        reject_without_margin: u8 = (rust.margin_check == MarginCheck::Reject).into(),
        /// 1 discards an unconfirmed image that contains only scheduled frames: repeated, they
        /// could be sent a period late.
        discard_missed: u8 = rust.discard_missed.into(),
        /// Scheduled frames that the gateway holds, for the plan; 0 for the default.
        depth: u16,
        /// Must be 0; for fields of later versions.
        reserved: [u32; 7] = [0; 7],
    }
}

impl From<igh_mcan_schedule_settings_t> for ScheduleConfig {
    fn from(from: igh_mcan_schedule_settings_t) -> Self {
        Self {
            latest_send_ns: from.latest_send_ns,
            transport_ns: from.transport_ns,
            processing_ns: from.processing_ns,
            margin_check: match from.reject_without_margin {
                0 => MarginCheck::Count,
                _ => MarginCheck::Reject,
            },
            watch_ms: from.watch_ms,
            discard_missed: from.discard_missed != 0,
            depth: match from.depth {
                0 => Self::default().depth,
                depth => depth,
            },
        }
    }
}

mirror! {
    /// Times around the Sync0 pulse that is the reference of a scheduled frame's offset, in
    /// nanoseconds from the deadline of the cycle.
    #[derive(Default)]
    pub struct igh_mcan_schedule_margin_t from rust: ScheduleMargin {
        /// Earliest arrival of the image in the gateway.
        earliest_arrival_ns: u64,
        /// Latest arrival of the image in the gateway.
        latest_arrival_ns: u64,
        /// The pulse that is the reference of the offset.
        pulse_ns: u64,
        /// The phase at which the frame is sent.
        release_ns: u64,
        /// From the pulse before to the earliest arrival.
        after_pulse_ns: i64,
        /// From the latest arrival to the pulse; negative if the pulse falls among the arrivals.
        before_pulse_ns: i64,
        /// From the end of the firmware's work to the phase; negative if frames may be dropped.
        before_release_ns: i64,
        /// The smallest of the three.
        least_ns: i64 = rust.least_ns(),
        /// Zero; for fields of later versions.
        reserved: [u64; 4] = [0; 4],
    }
}

mirror! {
    /// Results of a channel's scheduled frames. `scheduled` is the sum of `sent` to `open`; all
    /// except `open` only grow.
    #[derive(Default)]
    pub struct igh_mcan_schedule_account_t from rust: ScheduleAccount {
        /// Accepted frames.
        scheduled: u64,
        /// Frames that the gateway accepted and, by its flags, passed to the CAN controller at
        /// their phase.
        sent: u64,
        /// Frames that the gateway rejected because its schedule was full. Needs TX_RESULT.
        queue_full: u64,
        /// Frames that the gateway rejected for another reason: bus busy, bus-off, channel not enabled. Needs
        /// TX_RESULT.
        not_sent: u64,
        /// Frames that the host did not send: discarded, or removed because the cycle ended too
        /// late.
        withdrawn: u64,
        /// Frames with an unknown result, for example of an image that was repeated a period late.
        unknown: u64,
        /// Frames without a result so far.
        open: u64,
        /// Frames that were rejected because their cycle began too late for the phase.
        rejected_late: u64 = rust.rejected_late,
        /// Frames among `scheduled` that were accepted without margin.
        without_margin: u64,
        /// Zero; for fields of later versions.
        reserved: [u64; 7] = [0; 7],
    }
}

/// Flag of 0xB000:06: a scheduled frame was dropped because its phase had passed.
pub const IGH_MCAN_SCHEDULE_LATE_DROP: u16 = 0x0040;
/// Flag of 0xB000:06: a scheduled frame found the queue full.
pub const IGH_MCAN_SCHEDULE_QUEUE_FULL: u16 = 0x0080;
/// Flag of 0xB000:06: the CAN controller rejected a scheduled frame at its phase.
pub const IGH_MCAN_SCHEDULE_TX_FAIL: u16 = 0x0100;
/// Flag of 0xB000:06: the timer missed a phase.
pub const IGH_MCAN_SCHEDULE_TIMER_MISS: u16 = 0x0200;

mirror! {
    /// Counters of one channel, 0x9020 to 0x9023 (manual 13.2.5).
    #[derive(Default)]
    pub struct igh_mcan_channel_drops_t from rust: ChannelDrops {
        /// :11 Times that the controller's FIFO was full.
        fifo_full: u32,
        /// :12 Frames dropped as stale.
        stale_drops: u32,
        /// :13 Times that the channel was bus-off.
        bus_offs: u32,
        /// Zero; for fields of later versions.
        reserved: [u32; 3] = [0; 3],
    }
}

mirror! {
    /// Diagnostics of a gateway's scheduled transmission. Each reading contains flags, stale_drops
    /// and bus_offs, and one of the other objects in turn.
    #[derive(Default)]
    pub struct igh_mcan_schedule_diagnostics_t from rust: ScheduleDiagnostics {
        /// Time at which the flags were read, on the clock of ecan_igh_now_ns().
        read_at_ns: u64,
        /// Per channel; all 0 for one that is not enabled.
        channels: [igh_mcan_channel_drops_t; ECAN_MCAN_CHANNELS] = rust.channels.map(Into::into),
        /// 0x9011:02 Number of Sync0 pulses.
        sync0_count: u32,
        /// 0x9011:04 Smallest distance from a Sync0 pulse to the arrival of an image, in CPU cycles
        /// of the gateway (0x8000:04).
        phase_min_cycles: i32,
        /// 0x9011:05 Largest such distance.
        phase_max_cycles: i32,
        /// 0x9011:13 Longest service of scheduled frames, in CPU cycles.
        service_max_cycles: u32,
        /// 0xB000:06 IGH_MCAN_SCHEDULE_ values and others (manual 13.7); they stay until they are
        /// cleared.
        flags: u16,
        /// Zero; for fields of later versions.
        reserved: [u8; 30] = [0; 30],
    }
}

mirror! {
    /// Reason for which a gateway's account of scheduled frames counts accepted frames as unknown.
    pub enum igh_mcan_schedule_fault_t from Option<ScheduleFault> {
        /// None: the results are certain, or no flags were read yet.
        IGH_MCAN_SCHEDULE_FAULT_NONE = 0 => None,
        /// Flags of 0xB000:06 report problems, but not of which frames; they stay until they are cleared.
        IGH_MCAN_SCHEDULE_FAULT_FLAGGED = 1 => Some(ScheduleFault::Flagged { .. }),
        /// An object that decides on accepted frames cannot be read; the text names it.
        IGH_MCAN_SCHEDULE_FAULT_UNREADABLE = 3 => Some(ScheduleFault::Unreadable { .. }),
        /// Another one; see the text.
        IGH_MCAN_SCHEDULE_FAULT_OTHER = 255 => _,
    }
}

/// Fills the settings with their defaults.
///
/// @usage   rt, any thread, any time
#[export(call)]
pub fn igh_mcan_port_default_schedule(settings: *mut igh_mcan_schedule_settings_t) {
    pointers!(call, out(settings));
    settings.set(ScheduleConfig::default().into());
}

/// Sets the schedule settings of a gateway.
///
/// @usage   not rt, any thread, before apply
#[export(call, config config)]
pub fn igh_mcan_port_set_schedule(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    settings: *const igh_mcan_schedule_settings_t,
) {
    pointers!(call, read(settings));
    call.reserved("settings", &settings.reserved)?;
    gateway(call, config, slave)?.schedule = (*settings).into();
}

/// Gets the margin of an offset against cycle, wire and firmware.
///
/// @param offset_ns  Time after Sync0, in nanoseconds.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, for every margin; ECAN_ERR_SCHEDULE for an offset that cannot be scheduled at
///          all; ECAN_ERR_SLAVE.
#[export(call, layer port, into margin)]
pub fn igh_mcan_port_get_schedule_margin(
    port: *mut igh_mcan_port_t,
    slave: usize,
    offset_ns: u32,
    margin: *mut igh_mcan_schedule_margin_t,
) {
    let gateway = need_slave(call, port, slave)?;
    let margin = port.schedule_margin(gateway, offset_ns).map_err(|reason| {
        call.fail(ecan_result_t::ECAN_ERR_SCHEDULE, format_args!("{offset_ns} ns: {reason}"))
    })?;
    Ok(margin.into())
}

/// Gets the results of a channel's scheduled frames.
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer port, into account)]
pub fn igh_mcan_port_get_schedule_account(
    port: *mut igh_mcan_port_t,
    slave: usize,
    channel: u8,
    account: *mut igh_mcan_schedule_account_t,
) {
    let channel = find_channel(call, port, slave, channel)?;
    let account = channel.map(|channel| port.schedule_account(channel)).unwrap_or_default();
    Ok(account.into())
}

/// Gets the last diagnostics of a gateway's scheduled transmission.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_NOT_READY until each object was read in this session; ECAN_ERR_SLAVE.
#[export(call, layer port, into diagnostics)]
pub fn igh_mcan_port_get_schedule_diagnostics(
    port: *mut igh_mcan_port_t,
    slave: usize,
    diagnostics: *mut igh_mcan_schedule_diagnostics_t,
) {
    let gateway = need_slave(call, port, slave)?;
    let diagnostics = port.schedule_diagnostics(gateway).ok_or_else(|| {
        let text = format_args!("the diagnostics of slave {slave} were not read yet");
        call.fail(ecan_result_t::ECAN_ERR_NOT_READY, text)
    })?;
    Ok(diagnostics.into())
}

/// Returns the reason for which the accounts of a gateway's scheduled frames count accepted frames as
/// unknown, by the last reading of its flags.
///
/// @usage   rt, the cycle's thread, after init
/// @return  An igh_mcan_schedule_fault_t; ECAN_ERR_SLAVE.
#[export(call, layer port)]
pub fn igh_mcan_port_get_schedule_fault(port: *mut igh_mcan_port_t, slave: usize) -> c_int {
    let gateway = need_slave(call, port, slave)?;
    Ok(igh_mcan_schedule_fault_t::from(port.schedule_fault(gateway)) as c_int)
}

/// Gets the reason of igh_mcan_port_get_schedule_fault() as text, with what to do; empty without a
/// reason.
///
/// @param text  See the rules for texts in igh_ecan_common.h.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_BUFFER.
#[export(call, layer port)]
pub fn igh_mcan_port_get_schedule_fault_text(
    port: *mut igh_mcan_port_t,
    slave: usize,
    text: *mut c_char,
    size: usize,
    needed: *mut usize,
) {
    pointers!(call, out_text(text, size, needed));
    let gateway = need_slave(call, port, slave)?;
    let fault = port.schedule_fault(gateway);
    text.put(call, &fault.map_or_else(String::new, |fault| fault.to_string()))
}

/// Clears the flags of 0xB000:06 and the gateway's other runtime diagnostics in the next cycles
/// (manual 13.7, bit 5).
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer port)]
pub fn igh_mcan_port_clear_schedule_flags(port: *mut igh_mcan_port_t, slave: usize) {
    let gateway = need_slave(call, port, slave)?;
    port.clear_schedule_flags(gateway);
}
