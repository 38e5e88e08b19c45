//! Advice for the host of a planned configuration.

use ecan_mcan_port::PortPlan;

/// Cycle below which a kernel without PREEMPT_RT is not suitable, in ns.
const STOCK_KERNEL_NS: u32 = 2_000_000;

/// Measured with IgH 1.6.2 on Debian kernels 6.1 with and without PREEMPT_RT.
pub(super) fn advice(plan: &PortPlan) -> Vec<String> {
    let mut advice = Vec::new();
    let wire = &plan.ethercat;
    if wire.slaves.iter().any(|slave| !slave.layout.is_single_datagram()) {
        advice.push(
            "from N = 6, outputs and inputs of a gateway are two datagrams: run the cycle with a \
             real-time priority (--rt-priority) above that of other programs; otherwise some cycles \
             have an incomplete working counter, and their images are repeated"
                .to_owned(),
        );
    }
    if wire.cycle_ns < STOCK_KERNEL_NS {
        advice.push(format!(
            "a cycle of {:.1} us needs a kernel with PREEMPT_RT and a real-time priority; check the \
             host with `ecan doctor`",
            f64::from(wire.cycle_ns) / 1e3
        ));
    }
    advice
}
