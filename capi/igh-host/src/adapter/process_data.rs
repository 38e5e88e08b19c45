//! Raw process data (manual 15.5.3)
//!
//! With a Port on the context the RxPDO is the Port's; read it, but do not write to it.

use std::ffi::c_int;

use ecan_host::Adapter;
use ecan_mcan_host::boundary::{Call, call};
use ecan_mcan_host::common::result::ecan_result_t;

use super::config::no_slave;
use super::context::ecan_igh_context_t;
use crate::bus;

/// The address and size of an image.
fn image(
    call: Call,
    adapter: &mut Adapter,
    slave: usize,
    bytes: impl FnOnce(&mut Adapter) -> (*mut u8, usize),
) -> Result<(*mut u8, usize), ecan_result_t> {
    let count = adapter.slave_count();
    if slave >= count {
        return Err(no_slave(call, slave, count));
    }
    match bytes(adapter) {
        (_, 0) => {
            let words = format_args!("there are no process data before the bus is active");
            Err(call.fail(ecan_result_t::ECAN_ERR_ORDER, words))
        }
        image => Ok(image),
    }
}

/// The RxPDO of a slave, which the master sends to it: 128 * N continuous bytes to write the next
/// image into, with igh_mcan_pdo_writer_begin() for example.
///
/// @param rxpdo       Gets the address. Valid until the context is reconfigured or ends.
/// @param rxpdo_size  Gets the bytes.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_ORDER before the bus is active; ECAN_ERR_NULL, ECAN_ERR_SLAVE,
///          ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_get_rxpdo_buffer(
    context: *mut ecan_igh_context_t,
    slave: usize,
    rxpdo: *mut *mut u8,
    rxpdo_size: *mut usize,
) -> c_int {
    call("ecan_igh_get_rxpdo_buffer", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (mut bus, address, size) = unsafe {
            (
                bus::enter(call, context.cast())?,
                call.out("rxpdo", rxpdo)?,
                call.out("rxpdo_size", rxpdo_size)?,
            )
        };
        let (data, bytes) = image(call, bus.need_adapter(call)?, slave, |adapter| {
            let image = adapter.rx_pdo_mut(slave);
            (image.as_mut_ptr(), image.len())
        })?;
        address.set(data);
        size.set(bytes);
        Ok(())
    })
}

/// The TxPDO of a slave as of the last receive: 128 * N continuous bytes, for
/// igh_mcan_pdo_parse_frames_ex() for example.
///
/// @param txpdo       Gets the address. Valid until the context is reconfigured or ends; the
///                    content changes with every receive.
/// @param txpdo_size  Gets the bytes.
///
/// @usage   rt, the cycle's thread, active bus
/// @return  As ecan_igh_get_rxpdo_buffer().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_get_txpdo_buffer(
    context: *mut ecan_igh_context_t,
    slave: usize,
    txpdo: *mut *const u8,
    txpdo_size: *mut usize,
) -> c_int {
    call("ecan_igh_get_txpdo_buffer", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (mut bus, address, size) = unsafe {
            (
                bus::enter(call, context.cast())?,
                call.out("txpdo", txpdo)?,
                call.out("txpdo_size", txpdo_size)?,
            )
        };
        let (data, bytes) = image(call, bus.need_adapter(call)?, slave, |adapter| {
            let image = adapter.tx_pdo(slave);
            (image.as_ptr().cast_mut(), image.len())
        })?;
        address.set(data);
        size.set(bytes);
        Ok(())
    })
}
