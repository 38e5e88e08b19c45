//! Options of the cycle that all programs share.

use ecan_mcan_port::Port;

use crate::real_time::RealTimeArguments;

/// Applies the cycle timing, and measures the cycles if the user asked for real time.
pub fn run_options(port: &mut Port, thread: &RealTimeArguments, real_time: bool) {
    thread.set_timing(port.adapter_mut());
    if real_time || thread.is_given() {
        port.adapter_mut().measure_cycles();
    }
}
