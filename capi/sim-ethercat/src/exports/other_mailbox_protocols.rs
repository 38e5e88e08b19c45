//! SoE, VoE and EoE. The gateway supports none of them; each function returns an error.

use ecrt_sys::{
    EC_REQUEST_ERROR, Errno, ec_al_state_t, ec_master_t, ec_request_state_t, ec_slave_config_t,
};
use libc::{EOPNOTSUPP, c_char, c_int, c_uchar, in_addr, size_t};

use crate::report::reported;

/// An SoE request of IgH's interface. None exists here.
#[allow(non_camel_case_types)]
#[repr(C)]
#[derive(Debug)]
pub struct ec_soe_request_t {
    _opaque: [u8; 0],
}

/// A VoE handler of IgH's interface. None exists here.
#[allow(non_camel_case_types)]
#[repr(C)]
#[derive(Debug)]
pub struct ec_voe_handler_t {
    _opaque: [u8; 0],
}

/// Return value of a function that is not supported.
trait Unsupported {
    const ANSWER: Self;
}

impl Unsupported for c_int {
    const ANSWER: Self = -EOPNOTSUPP;
}

impl Unsupported for ec_request_state_t {
    const ANSWER: Self = EC_REQUEST_ERROR;
}

impl Unsupported for size_t {
    const ANSWER: Self = 0;
}

impl<T> Unsupported for *mut T {
    const ANSWER: Self = std::ptr::null_mut();
}

/// Exports functions that only return an error.
macro_rules! unsupported {
    ($(
        $export:ident($($argument:ident: $type:ty),*) -> $result:ty;
    )*) => { $(
        #[unsafe(no_mangle)]
        pub extern "C" fn $export($($argument: $type),*) -> $result {
            let _ = ($($argument),*);
            Errno::new(EOPNOTSUPP).set_last();
            let result: $result = Unsupported::ANSWER;
            reported(stringify!($export), result)
        }
    )* };
}

unsupported! {
    ecrt_master_write_idn(
        master: *mut ec_master_t, position: u16, drive: u8, idn: u16, data: *const u8,
        size: size_t, error_code: *mut u16) -> c_int;
    ecrt_master_read_idn(
        master: *mut ec_master_t, position: u16, drive: u8, idn: u16, target: *mut u8,
        target_size: size_t, result_size: *mut size_t, error_code: *mut u16) -> c_int;
    ecrt_slave_config_idn(
        config: *mut ec_slave_config_t, drive: u8, idn: u16, state: ec_al_state_t,
        data: *const u8, size: size_t) -> c_int;
    ecrt_slave_config_create_soe_request(
        config: *mut ec_slave_config_t, drive: u8, idn: u16, size: size_t)
        -> *mut ec_soe_request_t;
    ecrt_soe_request_idn(request: *mut ec_soe_request_t, drive: u8, idn: u16) -> c_int;
    ecrt_soe_request_timeout(request: *mut ec_soe_request_t, timeout_ms: u32) -> c_int;
    ecrt_soe_request_data(request: *const ec_soe_request_t) -> *mut u8;
    ecrt_soe_request_data_size(request: *const ec_soe_request_t) -> size_t;
    ecrt_soe_request_state(request: *mut ec_soe_request_t) -> ec_request_state_t;
    ecrt_soe_request_write(request: *mut ec_soe_request_t) -> c_int;
    ecrt_soe_request_read(request: *mut ec_soe_request_t) -> c_int;

    ecrt_slave_config_create_voe_handler(
        config: *mut ec_slave_config_t, size: size_t) -> *mut ec_voe_handler_t;
    ecrt_voe_handler_send_header(
        handler: *mut ec_voe_handler_t, vendor_id: u32, vendor_type: u16) -> c_int;
    ecrt_voe_handler_received_header(
        handler: *const ec_voe_handler_t, vendor_id: *mut u32, vendor_type: *mut u16) -> c_int;
    ecrt_voe_handler_data(handler: *const ec_voe_handler_t) -> *mut u8;
    ecrt_voe_handler_data_size(handler: *const ec_voe_handler_t) -> size_t;
    ecrt_voe_handler_write(handler: *mut ec_voe_handler_t, size: size_t) -> c_int;
    ecrt_voe_handler_read(handler: *mut ec_voe_handler_t) -> c_int;
    ecrt_voe_handler_read_nosync(handler: *mut ec_voe_handler_t) -> c_int;
    ecrt_voe_handler_execute(handler: *mut ec_voe_handler_t) -> ec_request_state_t;

    ecrt_slave_config_eoe_mac_address(
        config: *mut ec_slave_config_t, mac_address: *const c_uchar) -> c_int;
    ecrt_slave_config_eoe_ip_address(
        config: *mut ec_slave_config_t, ip_address: in_addr) -> c_int;
    ecrt_slave_config_eoe_subnet_mask(
        config: *mut ec_slave_config_t, subnet_mask: in_addr) -> c_int;
    ecrt_slave_config_eoe_default_gateway(
        config: *mut ec_slave_config_t, gateway_address: in_addr) -> c_int;
    ecrt_slave_config_eoe_dns_address(
        config: *mut ec_slave_config_t, dns_address: in_addr) -> c_int;
    ecrt_slave_config_eoe_hostname(
        config: *mut ec_slave_config_t, name: *const c_char) -> c_int;
}

#[cfg(test)]
mod tests {
    use std::ptr::{null, null_mut};

    use ecrt_sys::EC_AL_STATE_PREOP;

    use super::*;

    #[test]
    fn soe_transfer_and_request_return_an_error() {
        let mut error_code = 0xEEEE;
        let mut size = 0;
        assert_eq!(
            ecrt_master_write_idn(null_mut(), 0, 0, 32, null(), 0, &mut error_code),
            -EOPNOTSUPP
        );
        assert_eq!(
            ecrt_master_read_idn(null_mut(), 0, 0, 32, null_mut(), 0, &mut size, &mut error_code),
            -EOPNOTSUPP
        );
        let request = ecrt_slave_config_create_soe_request(null_mut(), 0, 32, 4);
        assert!(request.is_null());
        assert_eq!(Errno::last(), Errno::new(EOPNOTSUPP));
        assert!(ecrt_soe_request_data(request).is_null());
        assert_eq!(ecrt_soe_request_data_size(request), 0);
        assert_eq!(ecrt_soe_request_state(request), EC_REQUEST_ERROR);
        let answers = [
            ecrt_soe_request_idn(request, 1, 33),
            ecrt_soe_request_timeout(request, 100),
            ecrt_soe_request_read(request),
            ecrt_soe_request_write(request),
        ];
        assert_eq!(answers, [-EOPNOTSUPP; 4]);
    }

    #[test]
    fn startup_idn_is_rejected() {
        let answer = ecrt_slave_config_idn(null_mut(), 0, 32, EC_AL_STATE_PREOP, null(), 0);
        assert_eq!(answer, -EOPNOTSUPP);
    }

    #[test]
    fn voe_handler_functions_return_an_error() {
        let handler = ecrt_slave_config_create_voe_handler(null_mut(), 16);
        assert!(handler.is_null());
        assert_eq!(Errno::last(), Errno::new(EOPNOTSUPP));
        assert!(ecrt_voe_handler_data(handler).is_null());
        assert_eq!(ecrt_voe_handler_data_size(handler), 0);
        assert_eq!(ecrt_voe_handler_execute(handler), EC_REQUEST_ERROR);
        let answers = [
            ecrt_voe_handler_send_header(handler, 5, 6),
            ecrt_voe_handler_received_header(handler, null_mut(), null_mut()),
            ecrt_voe_handler_write(handler, 16),
            ecrt_voe_handler_read(handler),
            ecrt_voe_handler_read_nosync(handler),
        ];
        assert_eq!(answers, [-EOPNOTSUPP; 5]);
    }

    #[test]
    fn eoe_parameters_are_rejected() {
        let address = in_addr { s_addr: 0 };
        let answers = [
            ecrt_slave_config_eoe_mac_address(null_mut(), null()),
            ecrt_slave_config_eoe_ip_address(null_mut(), address),
            ecrt_slave_config_eoe_subnet_mask(null_mut(), address),
            ecrt_slave_config_eoe_default_gateway(null_mut(), address),
            ecrt_slave_config_eoe_dns_address(null_mut(), address),
            ecrt_slave_config_eoe_hostname(null_mut(), null()),
        ];
        assert_eq!(answers, [-EOPNOTSUPP; 6]);
    }
}
