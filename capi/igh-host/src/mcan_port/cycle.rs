//! The cycle
//!
//! ```c
//! igh_mcan_port_wait_next_cycle(&mcan);
//! igh_mcan_port_cycle_begin(&mcan);
//! igh_mcan_port_receive(&mcan, rx, 32, &rx_count);
//! igh_mcan_port_send_can(&mcan, 0, 0, 0x123, 0, data, 8);
//! igh_mcan_port_cycle_end(&mcan);
//! ```

use ecan_c_boundary::frames::{igh_mcan_rx_frame_t, igh_mcan_rx_kind_t};
use ecan_c_boundary::{OutArray, pointers};
use ecan_c_export::export;
use ecan_mcan_port::{Cycle, Received, ReceivedView, TransmitReport};

use super::context::igh_mcan_port_t;
use crate::errors::OrCode as _;

/// Sleeps until the next deadline; as ecan_igh_wait_next_cycle().
///
/// @usage   rt, the cycle's thread, active bus
#[export(call, bus bus)]
pub fn igh_mcan_port_wait_next_cycle(port: *mut igh_mcan_port_t) {
    bus.wait_next_cycle(call)
}

/// Receives and checks the images, and continues the verification of gateways. First in the cycle.
/// Items of the last cycle that were not received are dropped. Does nothing while a cycle is open.
/// Copy the text of an error if you need it: a frame that is rejected later in the cycle replaces
/// it.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_MASTER if a call of the library failed: the cycle is open, call
///          igh_mcan_port_cycle_end() in any case. ECAN_ERR_ORDER if the bus is not active.
#[export(call, bus bus)]
pub fn igh_mcan_port_cycle_begin(port: *mut igh_mcan_port_t) {
    bus.begin_cycle(call)?;
    bus.keep();
    let cycle = bus.need_port(call)?.begin_cycle();
    let error = cycle.receive_error();
    cycle.keep_open();
    error.map_or(Ok(()), Err).or_code(call)
}

/// Publishes the images, or repeats unconfirmed ones, and sends. Last in the cycle.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_MASTER if a call of the library failed: continue with the next
///          cycle; ECAN_ERR_ORDER if the bus is not active.
#[export(call, bus bus)]
pub fn igh_mcan_port_cycle_end(port: *mut igh_mcan_port_t) {
    bus.end_cycle(call)?;
    let port = bus.need_port(call)?;
    let ended = port.open_cycle().map(Cycle::finish);
    let error = match ended {
        Some(summary) => summary.send_error,
        None => port.repeat_images().err(),
    };
    error.map_or(Ok(()), Err).or_code(call)
}

/// Converts an item that was copied from its image.
pub(crate) fn owned_rx_frame(item: &Received) -> igh_mcan_rx_frame_t {
    match item {
        Received::Frame(received) => igh_mcan_rx_frame_t::from_frame(
            received.slave,
            received.channel,
            received.frame.as_ref(),
            received.timestamp,
            received.source.raw(),
        ),
        Received::TransmitReport(report) => tx_result(report),
    }
}

fn tx_result(report: &TransmitReport) -> igh_mcan_rx_frame_t {
    igh_mcan_rx_frame_t {
        slave: report.slave as u16,
        channel: report.channel,
        kind: igh_mcan_rx_kind_t::IGH_MCAN_RX_TX_RESULT as u8,
        result: report.code.raw(),
        sequence: report.ticket.map_or(0, |ticket| ticket.sequence),
        frame_index: report.ticket.map_or(0, |ticket| ticket.index),
        is_known: report.ticket.is_some().into(),
        ..igh_mcan_rx_frame_t::EMPTY
    }
}

/// Passes received items to C until the array is full.
pub(crate) fn receive(cycle: &mut Cycle<'_>, room: &mut OutArray<igh_mcan_rx_frame_t>) {
    let mut items = cycle.received();
    while !room.is_full()
        && let Some(item) = items.next()
    {
        // Two calls, so that the compiler builds a frame in its final location.
        match item {
            ReceivedView::Frame { slave, packet } => {
                room.push(igh_mcan_rx_frame_t::from_packet(slave, &packet))
            }
            ReceivedView::TransmitReport(report) => room.push(tx_result(&report)),
        };
    }
}

/// Receives items: frames of the buses and, with the option TX_RESULT, results of transmissions
/// (kind), in the order of the images and of the slaves. Items that do not fit remain for another
/// call in the same cycle.
///
/// @param rx        Gets the items.
/// @param capacity  Items that fit.
/// @param rx_count  Gets the number of items.
///
/// @usage   rt, the cycle's thread, in an open cycle
/// @return  ECAN_OK; ECAN_ERR_ORDER if no cycle is open.
#[export(call, bus bus)]
pub fn igh_mcan_port_receive(
    port: *mut igh_mcan_port_t,
    rx: *mut igh_mcan_rx_frame_t,
    capacity: usize,
    rx_count: *mut usize,
) {
    pointers!(call, room(rx, capacity), out(rx_count));
    rx_count.set(0);
    receive(&mut bus.need_cycle(call)?, &mut rx);
    rx_count.set(rx.count());
}
