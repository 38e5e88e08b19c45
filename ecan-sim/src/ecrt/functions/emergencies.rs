//! Emergency messages of a slave (CoE). The gateway sends none.

use super::{on_config, status};
use ecrt_sys::ec_slave_config_t;
use libc::{c_int, size_t};

/// `ecrt_slave_config_emerg_size`: sets the size of the queue.
pub unsafe extern "C" fn slave_config_emerg_size(
    config: *mut ec_slave_config_t,
    _elements: size_t,
) -> c_int {
    status(|| on_config(config)?.change(|_| Ok(())))
}

/// `ecrt_slave_config_emerg_pop`: `ENOENT`, there is no message.
pub unsafe extern "C" fn slave_config_emerg_pop(
    config: *mut ec_slave_config_t,
    _target: *mut u8,
) -> c_int {
    status(|| on_config(config).and(Err(libc::ENOENT)))
}

/// `ecrt_slave_config_emerg_clear`: clears messages and overruns.
pub unsafe extern "C" fn slave_config_emerg_clear(config: *mut ec_slave_config_t) -> c_int {
    status(|| on_config(config).map(drop))
}

/// `ecrt_slave_config_emerg_overruns`: messages that were lost.
pub unsafe extern "C" fn slave_config_emerg_overruns(config: *const ec_slave_config_t) -> c_int {
    status(|| on_config(config).map(drop))
}
