//! Configuration of a slave

use std::ffi::c_void;

use ecan_c_boundary::constants::ECAN_PDO_MAX_MULTIPLIER;
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, pointers};
use ecan_c_export::export;
use ecan_host::{Identity, StartupStep};
use ecan_protocol::object::{ObjectType, SdoWrite};

use super::config::ecan_igh_config_t;
use crate::encoded::EncodedCall as _;

fn multiplier(call: Call, name: &str, multiplier: u32) -> Result<u8, ecan_result_t> {
    if !(1..=ECAN_PDO_MAX_MULTIPLIER).contains(&multiplier) {
        let text =
            format_args!("{multiplier} is out of range; allowed: 1 to {ECAN_PDO_MAX_MULTIPLIER}");
        return Err(call.argument(name, text));
    }
    Ok(multiplier as u8)
}

/// Sets N of both directions on every slave: the PDOs have 128 * N bytes (manual 5.2).
///
/// @param n  1 to 24; above 11 see ecan_igh_config_allow_large_pdos().
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT.
#[export(call, config config)]
pub fn ecan_igh_config_set_pdo_multiplier(config: *mut ecan_igh_config_t, n: u32) {
    config.adapter = config.adapter.with_multiplier(multiplier(call, "n", n)?);
}

/// Sets N of both directions on one slave.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_ARGUMENT.
#[export(call, config config)]
pub fn ecan_igh_config_set_slave_pdo_multiplier(
    config: *mut ecan_igh_config_t,
    slave: usize,
    n: u32,
) {
    let slave = config.slave(call, slave)?;
    let n = multiplier(call, "n", n)?;
    (slave.rx_multiplier, slave.tx_multiplier) = (n, n);
}

/// Sets N of each direction on one slave.
///
/// @param rx_n  Of the RxPDO, master to slave.
/// @param tx_n  Of the TxPDO, slave to master.
///
/// @usage   not rt, any thread, before init
/// @return  As ecan_igh_config_set_slave_pdo_multiplier().
#[export(call, config config)]
pub fn ecan_igh_config_set_slave_pdo_multipliers(
    config: *mut ecan_igh_config_t,
    slave: usize,
    rx_n: u32,
    tx_n: u32,
) {
    let slave = config.slave(call, slave)?;
    let sizes = (multiplier(call, "rx_n", rx_n)?, multiplier(call, "tx_n", tx_n)?);
    (slave.rx_multiplier, slave.tx_multiplier) = sizes;
}

/// Gets N of each direction of one slave.
///
/// @param rx_n  Of the RxPDO, master to slave.
/// @param tx_n  Of the TxPDO, slave to master.
///
/// @usage   not rt, any thread, any time
#[export(call)]
pub fn ecan_igh_config_get_slave_pdo_multipliers(
    config: *const ecan_igh_config_t,
    slave: usize,
    rx_n: *mut u32,
    tx_n: *mut u32,
) {
    pointers!(call, encoded(config), out(rx_n), out(tx_n));
    let slave = config.slave_of(call, slave)?;
    rx_n.set(slave.rx_multiplier.into());
    tx_n.set(slave.tx_multiplier.into());
}

/// Sets the position of a slave.
///
/// @param alias     Station alias that the position counts from; 0 counts from the start of the
///                  bus.
/// @param position  Position, from 0.
///
/// @usage   not rt, any thread, before init
#[export(call, config config)]
pub fn ecan_igh_config_set_slave_position(
    config: *mut ecan_igh_config_t,
    slave: usize,
    alias: u16,
    position: u16,
) {
    let slave = config.slave(call, slave)?;
    (slave.alias, slave.position) = (alias, position);
}

/// Gets the position of a slave, as ecan_igh_config_set_slave_position() sets it.
///
/// @usage   not rt, any thread, any time
#[export(call)]
pub fn ecan_igh_config_get_slave_position(
    config: *const ecan_igh_config_t,
    slave: usize,
    alias: *mut u16,
    position: *mut u16,
) {
    pointers!(call, encoded(config), out(alias), out(position));
    let slave = config.slave_of(call, slave)?;
    alias.set(slave.alias);
    position.set(slave.position);
}

/// Sets the required vendor ID and product code (object 0x1018). Without it the SDK accepts every
/// slave whose objects identify it as an ECAN-Lite.
///
/// @usage   not rt, any thread, before init
#[export(call, config config)]
pub fn ecan_igh_config_set_slave_identity(
    config: *mut ecan_igh_config_t,
    slave: usize,
    vendor_id: u32,
    product_code: u32,
) {
    config.slave(call, slave)?.identity = Some(Identity { vendor_id, product_code });
}

/// Adds a startup SDO of the application: written after the Port's own, in the order of the calls,
/// at every (re)configuration of the slave.
///
/// @param index     Object.
/// @param subindex  Subindex.
/// @param data      Value, little endian, as on the bus. Is copied.
/// @param size      Its bytes: 1, 2 or 4.
///
/// @usage   not rt, any thread, before init
/// @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_ARGUMENT; ECAN_ERR_FULL beyond
///          ECAN_IGH_MAX_STARTUP_SDOS.
#[must_use]
#[export(call, config config)]
pub fn ecan_igh_config_add_startup_sdo(
    config: *mut ecan_igh_config_t,
    slave: usize,
    index: u16,
    subindex: u8,
    data: *const c_void,
    size: usize,
) {
    pointers!(call, bytes(data, size));
    config.slave(call, slave)?;
    let ty = match size {
        1 => ObjectType::U8,
        2 => ObjectType::U16,
        4 => ObjectType::U32,
        _ => {
            let text = format_args!("{size} is invalid; allowed: 1, 2, 4");
            return Err(call.argument("size", text));
        }
    };
    let mut bytes = [0; 4];
    bytes[..size].copy_from_slice(data);
    let write = SdoWrite::new(index, subindex, ty, u32::from_le_bytes(bytes));
    config.add_startup(call, slave, StartupStep::Download(write))
}
