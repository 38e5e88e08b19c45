//! A library that was built without the simulator: `cargo test --no-default-features`.

use std::ffi::CStr;
use std::mem::MaybeUninit;

use ecan_c_boundary::result::ecan_result_t::ECAN_ERR_ECRT;
use ecan_igh_host::adapter::config::{
    ecan_igh_config_set_ecrt, ecan_igh_config_t, ecan_igh_default_config,
};
use ecan_igh_host::adapter::context::{ecan_igh_context_t, ecan_igh_init};
use ecan_mcan_host::common::ecan_last_error;

#[test]
fn sim_without_simulator_is_rejected() {
    let mut config: Box<MaybeUninit<ecan_igh_config_t>> = Box::new_uninit();
    let mut context: MaybeUninit<ecan_igh_context_t> = MaybeUninit::uninit();
    for setting in [c"sim", c"sim:drives"] {
        // SAFETY: the pointers are valid, and the text ends with NUL.
        let code = unsafe {
            assert_eq!(ecan_igh_default_config(config.as_mut_ptr()), 0);
            assert_eq!(ecan_igh_config_set_ecrt(config.as_mut_ptr(), setting.as_ptr()), 0);
            ecan_igh_init(context.as_mut_ptr(), config.as_ptr())
        };
        assert_eq!(code, ECAN_ERR_ECRT.code());
        // SAFETY: the text ends with NUL and is not changed before it was copied.
        let text = unsafe { CStr::from_ptr(ecan_last_error()) }.to_str().unwrap();
        assert!(text.contains("built without the simulator"), "{text}");
    }
}
