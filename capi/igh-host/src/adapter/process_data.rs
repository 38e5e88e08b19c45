//! Raw process data (manual 15.5.3)
//!
//! With a Port on the context the RxPDO belongs to the Port: read it, but do not write to it.

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, OutPointer, pointers};
use ecan_c_export::export;

use super::bus_state::need_slave;
use super::context::ecan_igh_context_t;

/// Stores the address and the size of an image.
fn put_image<P>(
    call: Call,
    address: OutPointer<P>,
    size: OutPointer<usize>,
    (start, bytes): (P, usize),
) -> Result<(), ecan_result_t> {
    if bytes == 0 {
        let text = format_args!("there are no process data before the bus is active");
        return Err(call.fail(ecan_result_t::ECAN_ERR_ORDER, text));
    }
    address.set(start);
    size.set(bytes);
    Ok(())
}

/// Gets the RxPDO of a slave, which the master sends to it: 128 * N continuous bytes to write the
/// next image into, with igh_mcan_pdo_writer_begin() for example.
///
/// @param rxpdo       Gets the address. Valid until the context is reconfigured or ends.
/// @param rxpdo_size  Gets the bytes.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_ORDER before the bus is active; ECAN_ERR_SLAVE.
#[export(call, layer adapter)]
pub fn ecan_igh_get_rxpdo_buffer(
    context: *mut ecan_igh_context_t,
    slave: usize,
    rxpdo: *mut *mut u8,
    rxpdo_size: *mut usize,
) {
    pointers!(call, out(rxpdo), out(rxpdo_size));
    need_slave(call, adapter, slave)?;
    let image = adapter.rx_pdo_mut(slave);
    put_image(call, rxpdo, rxpdo_size, (image.as_mut_ptr(), image.len()))
}

/// Gets the TxPDO of a slave as of the last receive: 128 * N continuous bytes, for
/// igh_mcan_pdo_parse_frames_ex() for example.
///
/// @param txpdo       Gets the address. Valid until the context is reconfigured or ends; the
///                    content changes with every receive.
/// @param txpdo_size  Gets the bytes.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  As ecan_igh_get_rxpdo_buffer().
#[export(call, layer adapter)]
pub fn ecan_igh_get_txpdo_buffer(
    context: *mut ecan_igh_context_t,
    slave: usize,
    txpdo: *mut *const u8,
    txpdo_size: *mut usize,
) {
    pointers!(call, out(txpdo), out(txpdo_size));
    need_slave(call, adapter, slave)?;
    let image = adapter.tx_pdo(slave);
    put_image(call, txpdo, txpdo_size, (image.as_ptr(), image.len()))
}
