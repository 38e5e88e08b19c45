//! The cycle of a Port, with the functions that send.

use std::ffi::c_int;

use ecan_c_boundary::frames::{
    IGH_MCAN_FLAG_EXT, classic_frame_at, fd_frame, igh_mcan_rx_frame_t, igh_mcan_rx_kind_t,
    igh_mcan_tx_frame_t,
};
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, OutArray, pointers};
use ecan_c_export::export;
use ecan_mcan_port::{Cycle, Received, ReceivedView, SendOptions, TransmitHint, TransmitReport};
use ecan_protocol::can::{CanId, FrameRef};
use ecan_protocol::image::Schedule;

use super::context::igh_mcan_port_t;
use super::state::need_slave;
use crate::bus::Bus;
use crate::errors;
use crate::errors::OrCode as _;
use crate::handle::Entered;

// Section: The cycle
//
// igh_mcan_port_wait_next_cycle(&mcan);
// igh_mcan_port_cycle_begin(&mcan);
// igh_mcan_port_receive(&mcan, rx, 32, &rx_count);
// igh_mcan_port_send_can(&mcan, 0, 0, 0x123, 0, data, 8);
// igh_mcan_port_cycle_end(&mcan);

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

// Section: Sending
//
// A packet is written once, directly into the PDO image. A rejected frame has no effect; after
// some codes it may be sent again in a later cycle (ecan_result_is_temporary()).

/// Image and index of a sent frame, as in an igh_mcan_rx_frame_t of kind IGH_MCAN_RX_TX_RESULT.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct igh_mcan_ticket_t {
    /// Slave index.
    pub slave: u16,
    /// Sequence of the image.
    pub sequence: u16,
    /// Index of the frame in the image, from 0.
    pub frame_index: u8,
    /// Zero; for fields of later versions.
    pub reserved: [u8; 11],
}

/// Data bytes of a classic CAN frame.
const CLASSIC_BYTES: usize = 8;

#[inline(never)]
fn send(
    call: Call,
    bus: &mut Entered<Bus>,
    slave: usize,
    channel: u8,
    frame: FrameRef<'_>,
    options: SendOptions,
) -> Result<(), ecan_result_t> {
    let mut cycle = bus.need_cycle(call)?;
    let to = cycle.channel(slave, channel).or_code(call)?;
    let sent = cycle.send_with(to, frame, options);
    drop(cycle);
    let ticket = sent.or_code(call)?;
    bus.last_ticket = Some(ticket.into());
    Ok(())
}

fn at(offset_ns: u32, tag: u16) -> SendOptions {
    Schedule { tag, offset_ns }.into()
}

/// Sends a classic CAN frame.
///
/// @param slave    Slave index.
/// @param channel  Channel of the gateway, 0 to 3.
/// @param can_id   11 bits; 29 bits with IGH_MCAN_FLAG_EXT.
/// @param flags    0, IGH_MCAN_FLAG_EXT, IGH_MCAN_FLAG_RTR.
/// @param data     Data; may be NULL if len is 0 and for a remote frame.
/// @param len      Bytes, 0 to 8; of a remote frame the requested DLC.
///
/// @usage   rt, the cycle's thread, in an open cycle
/// @return  ECAN_OK; ECAN_ERR_NO_ROOM, ECAN_ERR_QUEUE_FULL, ECAN_ERR_BUS_OFF, ECAN_ERR_NOT_READY:
///          temporary; ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL, ECAN_ERR_FRAME; ECAN_ERR_ORDER if no
///          cycle is open.
#[export(call, bus bus)]
pub fn igh_mcan_port_send_can(
    port: *mut igh_mcan_port_t,
    slave: usize,
    channel: u8,
    can_id: u32,
    flags: u8,
    data: *const u8,
    len: usize,
) {
    if flags & !IGH_MCAN_FLAG_EXT != 0 || len > CLASSIC_BYTES || data.is_null() {
        // SAFETY: the data are C's, valid or NULL as the header demands.
        let frame = unsafe { classic_frame_at(call, can_id, flags, data, len)? };
        return send(call, bus, slave, channel, frame, SendOptions::default());
    }
    // The shortest path for the most frequent kind of frame.
    let id = CanId::new(can_id, flags != 0).map_err(|error| call.error(&error))?;
    // SAFETY: the data are C's and not NULL.
    let data = unsafe { std::slice::from_raw_parts(data, len) };
    let frame = FrameRef::classic(id, data).map_err(|error| call.error(&error))?;
    // The Port checks the address.
    let reject = |error| errors::note(call, &error);
    let ticket = bus.need_cycle(call)?.send_to((slave, channel), frame, reject)?;
    bus.last_ticket = Some(ticket.into());
}

/// Sends a CAN FD frame.
///
/// @param flags  0, IGH_MCAN_FLAG_EXT, IGH_MCAN_FLAG_BRS, IGH_MCAN_FLAG_ESI; IGH_MCAN_FLAG_FD is
///               accepted.
/// @param len    Bytes: 0 to 8, 12, 16, 20, 24, 32, 48 or 64 (manual 8.2).
///
/// @usage   rt, the cycle's thread, in an open cycle
/// @return  As igh_mcan_port_send_can(); ECAN_ERR_NOT_FD for a channel of classic CAN.
#[export(call, bus bus)]
pub fn igh_mcan_port_send_canfd(
    port: *mut igh_mcan_port_t,
    slave: usize,
    channel: u8,
    can_id: u32,
    flags: u8,
    data: *const u8,
    len: usize,
) {
    pointers!(call, items(data, len));
    let frame = fd_frame(call, can_id, flags, data)?;
    send(call, bus, slave, channel, frame, SendOptions::default())
}

/// Sends a classic CAN frame at a phase of the next Sync0 period (manual 8.4, 13.8). Needs
/// distributed clocks. The gateway drops a frame that arrives after its phase.
///
/// @param offset_ns  Phase, in nanoseconds, below the Sync0 period.
/// @param tag        Tag of the application.
///
/// @usage   rt, the cycle's thread, in an open cycle
/// @return  As igh_mcan_port_send_can(); ECAN_ERR_SCHEDULE if it cannot be scheduled.
#[export(call, bus bus)]
pub fn igh_mcan_port_schedule_can(
    port: *mut igh_mcan_port_t,
    slave: usize,
    channel: u8,
    can_id: u32,
    flags: u8,
    data: *const u8,
    len: usize,
    offset_ns: u32,
    tag: u16,
) {
    // SAFETY: the data are C's, valid or NULL as the header demands.
    let frame = unsafe { classic_frame_at(call, can_id, flags, data, len)? };
    send(call, bus, slave, channel, frame, at(offset_ns, tag))
}

/// Sends a CAN FD frame at a phase of the next Sync0 period; as igh_mcan_port_schedule_can().
///
/// @usage   rt, the cycle's thread, in an open cycle
/// @return  As igh_mcan_port_send_canfd(); ECAN_ERR_SCHEDULE if it cannot be scheduled.
#[export(call, bus bus)]
pub fn igh_mcan_port_schedule_canfd(
    port: *mut igh_mcan_port_t,
    slave: usize,
    channel: u8,
    can_id: u32,
    flags: u8,
    data: *const u8,
    len: usize,
    offset_ns: u32,
    tag: u16,
) {
    pointers!(call, items(data, len));
    let frame = fd_frame(call, can_id, flags, data)?;
    send(call, bus, slave, channel, frame, at(offset_ns, tag))
}

fn send_tx(
    call: Call,
    bus: &mut Entered<Bus>,
    tx: &igh_mcan_tx_frame_t,
) -> Result<(), ecan_result_t> {
    let hint = match tx.checked_hint(call)? {
        0 => TransmitHint::Normal,
        1 => TransmitHint::HighPriority,
        2 => TransmitHint::DedicatedBuffer,
        _ => TransmitHint::Queue,
    };
    let options = SendOptions { hint, schedule: tx.schedule() };
    send(call, bus, tx.slave.into(), tx.channel, tx.frame(call)?, options)
}

/// Sends a frame that igh_mcan_tx_frame_set_can() or a similar function filled.
///
/// @usage   rt, the cycle's thread, in an open cycle
/// @return  As the functions above; ECAN_ERR_ARGUMENT for an unknown hint.
#[export(call, bus bus)]
pub fn igh_mcan_port_send(port: *mut igh_mcan_port_t, frame: *const igh_mcan_tx_frame_t) {
    pointers!(call, read(frame));
    send_tx(call, bus, frame)
}

/// Sends frames in order and stops at the first rejected one, so that the order is kept if the rest
/// is sent in a later cycle.
///
/// @param sent  Gets the number of sent frames, from the first one.
///
/// @usage   rt, the cycle's thread, in an open cycle
/// @return  ECAN_OK if all were sent; otherwise the code of the rejected one, as
///          igh_mcan_port_send().
#[export(call, bus bus)]
pub fn igh_mcan_port_send_batch(
    port: *mut igh_mcan_port_t,
    frames: *const igh_mcan_tx_frame_t,
    count: usize,
    sent: *mut usize,
) {
    pointers!(call, items(frames, count), out(sent));
    sent.set(0);
    for (done, tx) in frames.iter().enumerate() {
        send_tx(call, bus, tx)?;
        sent.set(done + 1);
    }
}

/// Runs one whole cycle, for test scripts: begin, receive, send, end. The caller keeps the period.
///
/// @param tx        Frames to send; may be NULL if tx_count is 0.
/// @param rx        Gets the received items.
/// @param rx_count  Gets the number of received items.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  ECAN_OK if all frames were sent; otherwise the first error, as the functions that it
///          stands for. The cycle is complete in any case.
#[export(call, bus bus)]
pub fn igh_mcan_port_exchange(
    port: *mut igh_mcan_port_t,
    tx: *const igh_mcan_tx_frame_t,
    tx_count: usize,
    rx: *mut igh_mcan_rx_frame_t,
    capacity: usize,
    rx_count: *mut usize,
) {
    pointers!(call, items(tx, tx_count), room(rx, capacity), out(rx_count));
    rx_count.set(0);
    let mut cycle = bus.need_port(call)?.begin_cycle();
    receive(&mut cycle, &mut rx);
    cycle.keep_open();
    rx_count.set(rx.count());
    let sent = tx.iter().try_for_each(|tx| send_tx(call, bus, tx));
    let summary = bus.need_cycle(call)?.finish();
    // The text is that of the code that is returned.
    summary.receive_error.map_or(Ok(()), Err).or_code(call)?;
    sent?;
    summary.send_error.map_or(Ok(()), Err).or_code(call)
}

/// Gets image and index of the frame that was sent last. Call it after the send whose TX_RESULT you
/// need.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_ORDER if nothing was sent yet.
#[export(call, bus bus)]
pub fn igh_mcan_port_get_last_ticket(port: *mut igh_mcan_port_t, ticket: *mut igh_mcan_ticket_t) {
    pointers!(call, out(ticket));
    let last = bus.last_ticket.ok_or_else(|| {
        call.fail(ecan_result_t::ECAN_ERR_ORDER, format_args!("nothing was sent yet"))
    })?;
    ticket.set(igh_mcan_ticket_t {
        slave: last.slave as u16,
        sequence: last.sequence as u16,
        frame_index: last.index as u8,
        reserved: [0; 11],
    });
}

/// Returns the free bytes in the image of this cycle; a packet needs 4 to 78 of them (manual 8.3).
///
/// @usage   rt, the cycle's thread, after init
/// @return  The bytes; 0 if the slave is not configured.
#[export(_, layer port, or 0)]
pub fn igh_mcan_port_image_room(port: *mut igh_mcan_port_t, slave: usize) -> usize {
    Ok(port.gateway(slave).map_or(0, |gateway| port.image_room(gateway)))
}

/// Discards every frame whose delivery to the gateway is not confirmed. The gateway may still have
/// executed frames of an unconfirmed image.
///
/// @usage   rt, the cycle's thread, after init
/// @return  The number of discarded frames, 0 or more; ECAN_ERR_SLAVE.
#[export(call, layer port)]
pub fn igh_mcan_port_discard_pending(port: *mut igh_mcan_port_t, slave: usize) -> c_int {
    let gateway = need_slave(call, port, slave)?;
    Ok(port.discard_pending(gateway) as c_int)
}

#[cfg(test)]
mod tests {
    use ecan_mcan_port::SendTicket;
    use ecan_protocol::image::ResultCode;

    use super::*;

    #[test]
    fn result_has_every_field_of_its_report() {
        let ticket = Some(SendTicket { slave: 2, sequence: 0x1234, index: 7 });
        let report = TransmitReport {
            ticket,
            slave: 2,
            channel: 3,
            code: ResultCode::BusOff,
            schedule_tag: None,
        };
        let known = tx_result(&report);
        let unknown = tx_result(&TransmitReport { ticket: None, ..report });
        let kind = igh_mcan_rx_kind_t::IGH_MCAN_RX_TX_RESULT as u8;
        assert_eq!((known.slave, known.channel, known.kind, known.result), (2, 3, kind, 5));
        assert_eq!((known.sequence, known.frame_index, known.is_known), (0x1234, 7, 1));
        assert_eq!((unknown.sequence, unknown.frame_index, unknown.is_known), (0, 0, 0));
    }
}
