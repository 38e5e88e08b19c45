//! SoE, VoE and EoE, which the gateway does not speak.

use ecan_sim::libethercat::{ec_soe_request_t, ec_voe_handler_t};
use ecrt_sys::{ec_al_state_t, ec_master_t, ec_request_state_t, ec_slave_config_t};
use libc::{c_char, c_int, c_uchar, in_addr, size_t};

export! {
    told ecrt_master_write_idn(
        master: *mut ec_master_t, position: u16, drive: u8, idn: u16, data: *const u8,
        size: size_t, error_code: *mut u16) -> c_int = master_write_idn;
    told ecrt_master_read_idn(
        master: *mut ec_master_t, position: u16, drive: u8, idn: u16, target: *mut u8,
        target_size: size_t, result_size: *mut size_t, error_code: *mut u16) -> c_int
        = master_read_idn;
    told ecrt_slave_config_idn(
        config: *mut ec_slave_config_t, drive: u8, idn: u16, state: ec_al_state_t,
        data: *const u8, size: size_t) -> c_int = slave_config_idn;
    told ecrt_slave_config_create_soe_request(
        config: *mut ec_slave_config_t, drive: u8, idn: u16, size: size_t)
        -> *mut ec_soe_request_t = slave_config_create_soe_request;
    silent ecrt_soe_request_idn(request: *mut ec_soe_request_t, drive: u8, idn: u16) -> c_int
        = soe_request_idn;
    silent ecrt_soe_request_timeout(request: *mut ec_soe_request_t, timeout_ms: u32) -> c_int
        = soe_request_timeout;
    silent ecrt_soe_request_data(request: *const ec_soe_request_t) -> *mut u8 = soe_request_data;
    silent ecrt_soe_request_data_size(request: *const ec_soe_request_t) -> size_t
        = soe_request_data_size;
    silent ecrt_soe_request_state(request: *mut ec_soe_request_t) -> ec_request_state_t
        = soe_request_state;
    silent ecrt_soe_request_write(request: *mut ec_soe_request_t) -> c_int = soe_request_write;
    silent ecrt_soe_request_read(request: *mut ec_soe_request_t) -> c_int = soe_request_read;

    told ecrt_slave_config_create_voe_handler(
        config: *mut ec_slave_config_t, size: size_t) -> *mut ec_voe_handler_t
        = slave_config_create_voe_handler;
    silent ecrt_voe_handler_send_header(
        handler: *mut ec_voe_handler_t, vendor_id: u32, vendor_type: u16) -> c_int
        = voe_handler_send_header;
    silent ecrt_voe_handler_received_header(
        handler: *const ec_voe_handler_t, vendor_id: *mut u32, vendor_type: *mut u16) -> c_int
        = voe_handler_received_header;
    silent ecrt_voe_handler_data(handler: *const ec_voe_handler_t) -> *mut u8 = voe_handler_data;
    silent ecrt_voe_handler_data_size(handler: *const ec_voe_handler_t) -> size_t
        = voe_handler_data_size;
    silent ecrt_voe_handler_write(handler: *mut ec_voe_handler_t, size: size_t) -> c_int
        = voe_handler_write;
    silent ecrt_voe_handler_read(handler: *mut ec_voe_handler_t) -> c_int = voe_handler_read;
    silent ecrt_voe_handler_read_nosync(handler: *mut ec_voe_handler_t) -> c_int
        = voe_handler_read_nosync;
    silent ecrt_voe_handler_execute(handler: *mut ec_voe_handler_t) -> ec_request_state_t
        = voe_handler_execute;

    told ecrt_slave_config_eoe_mac_address(
        config: *mut ec_slave_config_t, mac_address: *const c_uchar) -> c_int
        = slave_config_eoe_mac_address;
    told ecrt_slave_config_eoe_ip_address(
        config: *mut ec_slave_config_t, ip_address: in_addr) -> c_int
        = slave_config_eoe_ip_address;
    told ecrt_slave_config_eoe_subnet_mask(
        config: *mut ec_slave_config_t, subnet_mask: in_addr) -> c_int
        = slave_config_eoe_subnet_mask;
    told ecrt_slave_config_eoe_default_gateway(
        config: *mut ec_slave_config_t, gateway_address: in_addr) -> c_int
        = slave_config_eoe_default_gateway;
    told ecrt_slave_config_eoe_dns_address(
        config: *mut ec_slave_config_t, dns_address: in_addr) -> c_int
        = slave_config_eoe_dns_address;
    told ecrt_slave_config_eoe_hostname(
        config: *mut ec_slave_config_t, name: *const c_char) -> c_int
        = slave_config_eoe_hostname;
}
