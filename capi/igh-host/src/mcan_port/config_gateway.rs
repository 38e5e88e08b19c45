//! Configuration of a gateway

use std::ffi::c_int;

use ecan_c_boundary::profile::{self, IGH_MCAN_OPTION_TX_RESULT};
use ecan_c_export::export;

use super::config::igh_mcan_port_config_t;
use crate::port_config::gateway;

/// Sets the encapsulation profiles: 0x8010:05 and 0x8011:05 (manual 9); 0 by default.
///
/// @param tx_encapsulation  Of the TxPDO, slave to master: an igh_mcan_encapsulation_t. 1 and 5
///                          bring timestamps.
/// @param rx_encapsulation  Of the RxPDO.
///
/// @usage   not rt, any thread, before apply
/// @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_ARGUMENT.
#[export(call, config config)]
pub fn igh_mcan_port_set_encapsulation(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    tx_encapsulation: c_int,
    rx_encapsulation: c_int,
) {
    let gateway = gateway(call, config, slave)?;
    let tx = profile::encapsulation(call, tx_encapsulation)?;
    gateway.rx_encapsulation = profile::encapsulation(call, rx_encapsulation)?;
    gateway.tx_encapsulation = tx;
}

/// Sets the budget policies of the images: 0x8010:06 and 0x8011:06 (manual 12); balanced by
/// default.
///
/// @param tx_budget, rx_budget  An igh_mcan_budget_t each.
///
/// @usage   not rt, any thread, before apply
/// @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_ARGUMENT.
#[export(call, config config)]
pub fn igh_mcan_port_set_budget(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    tx_budget: c_int,
    rx_budget: c_int,
) {
    let gateway = gateway(call, config, slave)?;
    let tx = profile::budget(call, tx_budget)?;
    gateway.rx_budget = profile::budget(call, rx_budget)?;
    gateway.tx_budget = tx;
}

/// Sets the options of the images: 0x8010:07 and 0x8011:07 (manual 9.1); none by default.
///
/// @param tx_options  IGH_MCAN_OPTION_ values; _TX_RESULT reports the result of every transmission.
/// @param rx_options  IGH_MCAN_OPTION_ values except _TX_RESULT.
///
/// @usage   not rt, any thread, before apply
/// @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_ARGUMENT.
#[export(call, config config)]
pub fn igh_mcan_port_set_options(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    tx_options: u8,
    rx_options: u8,
) {
    let gateway = gateway(call, config, slave)?;
    let tx = profile::options(call, tx_options)?;
    if rx_options & IGH_MCAN_OPTION_TX_RESULT != 0 {
        let text = format_args!("must not have TX_RESULT, an option of the TxPDO");
        return Err(call.argument("rx_options", text));
    }
    gateway.rx_options = profile::options(call, rx_options)?;
    gateway.tx_options = tx;
}

/// Enables pacing, which is on by default: frames that would overflow the gateway's transmit queue,
/// or for a channel that is bus-off, are rejected. Without pacing the queue drops them.
///
/// @usage   not rt, any thread, before apply
#[export(call, config config)]
pub fn igh_mcan_port_set_paced(config: *mut igh_mcan_port_config_t, slave: usize, paced: c_int) {
    gateway(call, config, slave)?.paced = paced != 0;
}

/// Sets the limits after which a gateway that was ready counts as lost: nothing is sent until it is
/// verified again.
///
/// @param hold_limit   Consecutive images without confirmed delivery; 10 by default.
/// @param input_limit  Consecutive cycles without a new TxPDO image; 100 by default, 0 for no
///                     limit.
///
/// @usage   not rt, any thread, before apply
#[export(call, config config)]
pub fn igh_mcan_port_set_limits(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    hold_limit: u16,
    input_limit: u16,
) {
    let gateway = gateway(call, config, slave)?;
    (gateway.hold_limit, gateway.input_limit) = (hold_limit, input_limit);
}

/// Allows the application bypass and the tests of 0x8030, which disconnect the CAN side; otherwise
/// a Port that finds them active does not start.
///
/// @usage   not rt, any thread, before apply
#[export(call, config config)]
pub fn igh_mcan_port_allow_diagnostic_tests(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    allow: c_int,
) {
    gateway(call, config, slave)?.allow_diagnostic_tests = allow != 0;
}
