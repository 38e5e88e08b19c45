//! Preflight plan: `igh_plan.h`.

use std::ffi::c_char;

use ecan_c_boundary::frames::igh_mcan_tx_frame_t;
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, OutText, pointers};
use ecan_c_export::export;
use ecan_cia402::{Cia402Config, axis_traffic};
use ecan_host::Faults;
use ecan_mcan_port::{FrameRate, FrameRoute, FrameStream, PortConfig, PortPlan};

use crate::adapter::config::{IghConfig, configured_port, ecan_igh_config_t};
use crate::cia402::axis::igh_cia402_axis_t;
use crate::cia402::axis_table::AxisTable;
use crate::encoded::EncodedCall as _;
use crate::mcan_port::config::igh_mcan_port_config_t;

// Section: Preflight plan
//
// Load of configurations on wire, CAN buses, images and mailboxes, with warnings and errors,
// before anything touches a bus.

/// Route of the frames of a plan.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_mcan_frame_route_t {
    /// From the host through the gateway to the bus.
    IGH_MCAN_ROUTE_TO_BUS = 0,
    /// From the bus through the gateway to the host.
    IGH_MCAN_ROUTE_FROM_BUS = 1,
    /// Between other nodes: only bus time counts.
    IGH_MCAN_ROUTE_ON_BUS_ONLY = 2,
}

/// Frames of one kind on one channel, for a plan.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct igh_mcan_frame_stream_t {
    /// One of them, filled by igh_mcan_tx_frame_set_can() or a similar function; slave, channel,
    /// kind of CAN ID, flags, length and schedule are relevant.
    pub frame: igh_mcan_tx_frame_t,
    /// Number of frames ...
    pub frames: u32,
    /// ... in this number of cycles; 0 counts as 1. More than one frame needs 1.
    pub cycles: u32,
    /// An igh_mcan_frame_route_t.
    pub route: u8,
    /// Must be 0; for fields of later versions.
    pub reserved: [u8; 23],
}

impl igh_mcan_frame_stream_t {
    fn to_rust(self, call: Call) -> Result<FrameStream, ecan_result_t> {
        call.reserved("streams", &self.reserved)?;
        let route = match self.route {
            0 => FrameRoute::ToBus,
            1 => FrameRoute::FromBus,
            2 => FrameRoute::OnBusOnly,
            route => {
                let text = format_args!("{route} is invalid; allowed: igh_mcan_frame_route_t");
                return Err(call.argument("route", text));
            }
        };
        let rate = match (self.frames, self.cycles) {
            (frames, 0 | 1) => FrameRate::PerCycle(frames),
            (0, _) => FrameRate::PerCycle(0),
            (1, cycles) => FrameRate::EveryCycles(cycles),
            (frames, cycles) => {
                let text =
                    format_args!("{frames} frames in {cycles} cycles: one of them must be 1");
                return Err(call.argument("frames", text));
            }
        };
        Ok(FrameStream {
            slave: self.frame.slave.into(),
            channel: self.frame.channel,
            frame: self.frame.frame(call)?.into(),
            rate,
            way: route,
            schedule_offset_ns: self.frame.schedule().map(|schedule| schedule.offset_ns),
        })
    }
}

pub(crate) fn plan(
    call: Call,
    adapter: &IghConfig,
    port: &PortConfig,
    traffic: &[FrameStream],
    text: OutText,
) -> Result<(), ecan_result_t> {
    let config = configured_port(port, adapter.slave_count);
    let adapter = adapter.adapter_config();
    let plan = PortPlan::of(&adapter, &config, traffic);
    let stored = text.put(call, &ecan_lite::plan_table(&plan, &adapter, traffic));
    Faults::check(plan.faults(&adapter, &config))
        .map_err(|faults| call.fail(ecan_result_t::ECAN_ERR_CONFIG, format_args!("{faults}")))?;
    stored
}

/// Plans configurations for a given traffic.
///
/// @param streams  The frames; may be NULL if count is 0.
/// @param text     Gets the plan as a table with its warnings, also if the plan has errors; see the
///                 rules for texts in igh_ecan_common.h. 4096 bytes are enough for a few gateways.
///
/// @usage   not rt, any thread, any time
/// @return  ECAN_OK, also with warnings; ECAN_ERR_CONFIG if the plan has errors, all of them in
///          ecan_last_error(); ECAN_ERR_ARGUMENT, ECAN_ERR_FRAME for a stream; ECAN_ERR_BUFFER.
#[must_use]
#[export(call)]
pub fn igh_mcan_port_plan(
    igh_config: *const ecan_igh_config_t,
    config: *const igh_mcan_port_config_t,
    streams: *const igh_mcan_frame_stream_t,
    count: usize,
    text: *mut c_char,
    size: usize,
    needed: *mut usize,
) {
    pointers!(call, out_text(text, size, needed));
    pointers!(call, encoded(igh_config), encoded(config), items(streams, count));
    let traffic: Result<Vec<_>, _> = streams.iter().map(|s| s.to_rust(call)).collect();
    plan(call, &igh_config, &config, &traffic?, text)
}

// Section: Preflight plan of axes

/// Plans configurations for the process data of axes: targets, TPDOs and SYNC. As
/// igh_mcan_port_plan().
///
/// @param motion_div  Cycles from target to target; 0 counts as 1.
///
/// @usage   not rt, any thread, any time
/// @return  As igh_mcan_port_plan(); ECAN_ERR_NOT_INITIALISED also for an axis that is not filled,
///          ECAN_ERR_CONFIG also for a value out of range.
#[must_use]
#[export(call)]
pub fn igh_cia402_plan(
    igh_config: *const ecan_igh_config_t,
    config: *const igh_mcan_port_config_t,
    axes: *const igh_cia402_axis_t,
    axis_count: usize,
    motion_div: u32,
    text: *mut c_char,
    size: usize,
    needed: *mut usize,
) {
    pointers!(call, out_text(text, size, needed));
    pointers!(call, encoded(igh_config), encoded(config), items(axes, axis_count));
    let axes = AxisTable::read(call, axes)?.into_axes(call, |_| Vec::new())?;
    let settings = Cia402Config { motion_div: motion_div.max(1), ..Cia402Config::default() };
    plan(call, &igh_config, &config, &axis_traffic(&axes, &settings), text)
}
