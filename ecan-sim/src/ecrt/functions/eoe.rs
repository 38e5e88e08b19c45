//! EoE, which the gateway does not speak: IP parameters are taken and never reach it.

use super::{on_config, status};
use crate::ecrt::calls::Answer;
use ecrt_sys::ec_slave_config_t;
use libc::{c_char, c_int, c_uchar, in_addr};

/// Takes a parameter that the caller passes by its address.
fn by_address<T>(config: *mut ec_slave_config_t, parameter: *const T) -> Answer {
    let call = on_config(config)?;
    if parameter.is_null() { Err(libc::EFAULT) } else { call.set_ip_parameter() }
}

/// `ecrt_slave_config_eoe_mac_address`: six bytes.
pub unsafe extern "C" fn slave_config_eoe_mac_address(
    config: *mut ec_slave_config_t,
    mac_address: *const c_uchar,
) -> c_int {
    status(|| by_address(config, mac_address))
}

/// `ecrt_slave_config_eoe_ip_address`.
pub unsafe extern "C" fn slave_config_eoe_ip_address(
    config: *mut ec_slave_config_t,
    _ip_address: in_addr,
) -> c_int {
    status(|| on_config(config)?.set_ip_parameter())
}

/// `ecrt_slave_config_eoe_subnet_mask`.
pub unsafe extern "C" fn slave_config_eoe_subnet_mask(
    config: *mut ec_slave_config_t,
    _subnet_mask: in_addr,
) -> c_int {
    status(|| on_config(config)?.set_ip_parameter())
}

/// `ecrt_slave_config_eoe_default_gateway`.
pub unsafe extern "C" fn slave_config_eoe_default_gateway(
    config: *mut ec_slave_config_t,
    _gateway_address: in_addr,
) -> c_int {
    status(|| on_config(config)?.set_ip_parameter())
}

/// `ecrt_slave_config_eoe_dns_address`.
pub unsafe extern "C" fn slave_config_eoe_dns_address(
    config: *mut ec_slave_config_t,
    _dns_address: in_addr,
) -> c_int {
    status(|| on_config(config)?.set_ip_parameter())
}

/// `ecrt_slave_config_eoe_hostname`: a text.
pub unsafe extern "C" fn slave_config_eoe_hostname(
    config: *mut ec_slave_config_t,
    name: *const c_char,
) -> c_int {
    status(|| by_address(config, name))
}
