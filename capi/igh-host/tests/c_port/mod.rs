//! A Port as a C program has it: contexts in memory of any content, on a simulated gateway with
//! echo nodes and a stepped clock.

use std::mem::MaybeUninit;

use ecan_c_boundary::image::IGH_MCAN_OPTION_TX_RESULT;
use ecan_igh_host::adapter::config::{
    ecan_igh_config_set_ecrt, ecan_igh_config_set_pdo_multiplier, ecan_igh_config_t,
    ecan_igh_default_config,
};
use ecan_igh_host::adapter::context::{
    ecan_igh_config_set_stepped_clock, ecan_igh_context_t, ecan_igh_deinit, ecan_igh_init,
    ecan_igh_wait_op_timeout,
};
use ecan_igh_host::mcan_port::config::{
    igh_mcan_port_apply_config, igh_mcan_port_config_t, igh_mcan_port_default_config,
    igh_mcan_port_set_classic_channel, igh_mcan_port_set_options, igh_mcan_port_set_paced,
};
use ecan_igh_host::mcan_port::context::{igh_mcan_port_init, igh_mcan_port_t};
// Stores the last error.
use ecan_mcan_host as _;

/// A gateway that is ready. The contexts must not move.
pub struct CPort {
    igh: Box<MaybeUninit<ecan_igh_context_t>>,
    port: Box<MaybeUninit<igh_mcan_port_t>>,
}

impl CPort {
    /// Classic CAN on channels 0 to `channels`, not paced, with transmit results where there is
    /// more than one channel.
    pub fn ready(channels: u8) -> Self {
        let mut this = Self { igh: Box::new_uninit(), port: Box::new_uninit() };
        let mut config: Box<MaybeUninit<ecan_igh_config_t>> = Box::new_uninit();
        let mut gateways: Box<MaybeUninit<igh_mcan_port_config_t>> = Box::new_uninit();
        let (config, gateways) = (config.as_mut_ptr(), gateways.as_mut_ptr());
        // SAFETY: every pointer is valid, and each init function takes what bytes there are.
        unsafe {
            assert_eq!(ecan_igh_default_config(config), 0);
            assert_eq!(ecan_igh_config_set_ecrt(config, c"sim:echo".as_ptr()), 0);
            assert_eq!(ecan_igh_config_set_stepped_clock(config, 1), 0);
            assert_eq!(ecan_igh_config_set_pdo_multiplier(config, 8), 0);
            assert_eq!(igh_mcan_port_default_config(gateways), 0);
            for channel in 0..channels {
                assert_eq!(igh_mcan_port_set_classic_channel(gateways, 0, channel, 1_000_000), 0);
            }
            assert_eq!(igh_mcan_port_set_paced(gateways, 0, 0), 0);
            if channels > 1 {
                let results = igh_mcan_port_set_options(gateways, 0, IGH_MCAN_OPTION_TX_RESULT, 0);
                assert_eq!(results, 0);
            }
            assert_eq!(igh_mcan_port_apply_config(config, gateways), 0);
            assert_eq!(ecan_igh_init(this.igh.as_mut_ptr(), config), 0);
            assert_eq!(
                igh_mcan_port_init(this.port.as_mut_ptr(), this.igh.as_mut_ptr(), gateways),
                0
            );
            assert_eq!(ecan_igh_wait_op_timeout(this.igh.as_mut_ptr(), 30_000), 0);
        }
        this
    }

    /// The context of the master.
    #[allow(dead_code)]
    pub fn igh(&mut self) -> *mut ecan_igh_context_t {
        self.igh.as_mut_ptr()
    }

    /// The Port's context.
    pub fn port(&mut self) -> *mut igh_mcan_port_t {
        self.port.as_mut_ptr()
    }
}

impl Drop for CPort {
    fn drop(&mut self) {
        // SAFETY: the context is valid.
        unsafe { ecan_igh_deinit(self.igh.as_mut_ptr()) };
    }
}
