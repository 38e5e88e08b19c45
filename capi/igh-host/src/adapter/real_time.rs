//! Real-time thread
//!
//! Functions that make the application's thread keep its cycle (manual 13.9 and 15.5.2, step 7).

use std::ffi::c_char;

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, mirror, pointers};
use ecan_c_export::export;
use ecan_host::{
    Adapter, CycleStart, CycleStatistics, CycleTiming, Distribution, MAX_SPIN_NS, Need,
    OverrunPolicy, RealTimeConfig, RealTimeError,
};

use super::context::ecan_igh_context_t;

/// Requests of the cycle's thread to the system. Fill with ecan_igh_default_real_time(), then
/// change fields.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct ecan_igh_real_time_t {
    /// SCHED_FIFO with this priority, 1 (lowest) to 99; 0 leaves the scheduling as it is.
    pub priority: i32,
    /// 1 keeps all memory of the process in RAM.
    pub lock_memory: u8,
    /// 1 makes ecan_igh_apply_real_time() fail if a request is denied.
    pub is_required: u8,
    /// Must be 0.
    pub padding: [u8; 2],
    /// With lock_memory: bytes of the thread's stack that are touched in advance, up to 1 MiB.
    pub stack_bytes: u32,
    /// Keeps the processors out of sleep states that take longer than this time to leave, in
    /// microseconds, for as long as the process lives; -1 leaves them as they are.
    pub wake_up_latency_us: i32,
    /// CPUs that the thread may run on, bit 0 for CPU 0; 0 leaves the affinity as it is.
    pub cpu_mask: u64,
    /// Must be 0; for fields of later versions.
    pub reserved: [u64; 4],
}

mirror! {
    /// Start of a cycle as ecan_igh_wait_next_cycle() measured it.
    #[derive(Default)]
    pub struct ecan_igh_cycle_start_t from start: CycleStart {
        /// Deadline, in nanoseconds of ecan_igh_now_ns().
        deadline_ns: u64,
        /// Time from the deadline to the end of the wait, in nanoseconds.
        late_ns: u64,
        /// Deadlines that were skipped before this one.
        skipped: u64,
        /// 1 if the cycle before, with the response of the bus, took past a deadline.
        has_overrun: u8,
        /// Zero; for fields of later versions.
        reserved: [u8; 23] = [0; 23],
    }
}

mirror! {
    /// Distribution of times, in nanoseconds; all 0 if nothing was recorded.
    #[derive(Default)]
    pub struct ecan_igh_distribution_t from times: Distribution {
        /// Number of times.
        count: u64,
        /// Shortest.
        min_ns: u64,
        /// Longest.
        max_ns: u64,
        /// Mean.
        mean_ns: f64,
        /// Half of the times are at most this long.
        p50_ns: u64,
        /// 95 of 100 are at most this long.
        p95_ns: u64,
        /// 99 of 100 are at most this long.
        p99_ns: u64,
        /// 999 of 1000 are at most this long.
        p99_9_ns: u64,
        /// Zero; for fields of later versions.
        reserved: [u64; 2] = [0; 2],
    }
}

mirror! {
    /// Timing of the cycles (manual 13.9).
    #[derive(Default)]
    pub struct ecan_igh_cycle_statistics_t from measured: &CycleStatistics {
        /// From the start of a cycle to the next: the manual's master_period.
        period: ecan_igh_distribution_t = measured.period().into(),
        /// From the deadline to the start of its cycle.
        wake_up: ecan_igh_distribution_t = measured.wake_up().into(),
        /// From the start of a cycle to its ecan_igh_send().
        run_time: ecan_igh_distribution_t = measured.run_time().into(),
        /// Largest difference between a period and the configured cycle, in nanoseconds.
        max_period_error_ns: u64 = measured.max_period_error_ns(),
        /// Cycles started.
        cycles: u64 = measured.cycles(),
        /// Cycles that took past a deadline, with the response of the bus.
        overruns: u64 = measured.overruns(),
        /// Deadlines that were skipped.
        skipped: u64 = measured.skipped(),
        /// Zero; for fields of later versions.
        reserved: [u64; 8] = [0; 8],
    }
}

fn config(call: Call, requests: &ecan_igh_real_time_t) -> Result<RealTimeConfig, ecan_result_t> {
    call.reserved("settings", &requests.padding)?;
    call.reserved("settings", &requests.reserved)?;
    let need = if requests.is_required != 0 { Need::Required } else { Need::Optional };
    let priority = u8::try_from(requests.priority).map_err(|_| {
        let text = format_args!("{} is out of range; allowed: 0 to 99", requests.priority);
        call.argument("priority", text)
    })?;
    let cpus: Vec<usize> = (0..64).filter(|cpu| requests.cpu_mask >> cpu & 1 == 1).collect();
    let stack_bytes = usize::try_from(requests.stack_bytes).unwrap_or(usize::MAX);
    Ok(RealTimeConfig {
        priority: Some(priority).filter(|priority| *priority > 0),
        priority_need: need,
        cpus: Some(cpus).filter(|cpus| !cpus.is_empty()),
        cpus_need: need,
        lock_memory: (requests.lock_memory != 0).then_some(stack_bytes),
        lock_memory_need: need,
        wake_up_latency_us: u32::try_from(requests.wake_up_latency_us).ok(),
        wake_up_latency_need: need,
        timing: CycleTiming::default(),
    })
}

/// Fills the requests: nothing is requested.
///
/// @usage   rt, any thread, any time
#[export(call)]
pub fn ecan_igh_default_real_time(settings: *mut ecan_igh_real_time_t) {
    pointers!(call, out(settings));
    settings.set(ecan_igh_real_time_t {
        priority: 0,
        lock_memory: 0,
        is_required: 0,
        padding: [0; 2],
        stack_bytes: 0,
        wake_up_latency_us: -1,
        cpu_mask: 0,
        reserved: [0; 4],
    });
}

/// Applies the requests to the calling thread; locked memory applies to its whole process.
///
/// Call it once in the thread of the cycle, before the cycle and after starting threads that must
/// not inherit priority and affinity.
///
/// @param report  A line for each request: granted, or the reason and what to do. See the rules for
///                texts in igh_ecan_common.h; 1024 bytes are enough.
///
/// @usage   not rt, the cycle's thread, any time
/// @return  ECAN_OK, also if a request that is not required was denied; ECAN_ERR_PRIVILEGE if a
///          required one was denied: granted requests stay in force. ECAN_ERR_ARGUMENT for a value
///          out of range, with nothing applied. ECAN_ERR_BUFFER if only the report was cut.
#[must_use]
#[export(call)]
pub fn ecan_igh_apply_real_time(
    settings: *const ecan_igh_real_time_t,
    report: *mut c_char,
    size: usize,
    needed: *mut usize,
) {
    pointers!(call, read(settings), out_text(report, size, needed));
    let applied = config(call, settings)?.apply();
    let text = match &applied {
        Ok(report) | Err(RealTimeError::Missing(report)) => report.to_string(),
        Err(_) => String::new(),
    };
    let stored = report.put(call, &text);
    applied.map(drop).map_err(|error| {
        let code = match error {
            RealTimeError::Settings(_) => ecan_result_t::ECAN_ERR_ARGUMENT,
            _ => ecan_result_t::ECAN_ERR_PRIVILEGE,
        };
        call.fail(code, format_args!("{error}"))
    })?;
    stored
}

/// Sets how ecan_igh_wait_next_cycle() waits, from the next wait on. By default it neither spins
/// nor catches up.
///
/// @param spin_us   Microseconds before each deadline in which the thread polls the clock instead
///                  of sleeping, 0 to 1000 (manual 13.9: 100). A stepped simulation emulates it.
/// @param catch_up  Most missed cycles that are run late, one after the other with the response
///                  time of the bus between them; 0 skips missed deadlines.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT.
#[export(call, layer adapter)]
pub fn ecan_igh_set_cycle_timing(context: *mut ecan_igh_context_t, spin_us: u32, catch_up: u32) {
    let spin_ns = u64::from(spin_us) * 1000;
    if spin_ns > MAX_SPIN_NS {
        let most = MAX_SPIN_NS / 1000;
        let text = format_args!("{spin_us} is out of range; allowed: 0 to {most}");
        return Err(call.argument("spin_us", text));
    }
    let overrun = match catch_up {
        0 => OverrunPolicy::Skip,
        max_cycles => OverrunPolicy::CatchUp { max_cycles },
    };
    adapter.set_cycle_timing(CycleTiming { spin_ns, overrun });
}

/// Gets the start of the cycle as the last ecan_igh_wait_next_cycle() measured it; all 0 before the
/// first.
///
/// @usage   rt, the cycle's thread, after init
#[export(_, layer adapter, into start)]
pub fn ecan_igh_get_cycle_start(
    context: *mut ecan_igh_context_t,
    start: *mut ecan_igh_cycle_start_t,
) {
    Ok(adapter.cycle_start().into())
}

/// Starts or restarts measuring the timing of the cycles. Takes about 3 megabytes.
///
/// @usage   not rt, the cycle's thread, after init
#[export(_, layer adapter)]
pub fn ecan_igh_measure_cycles(context: *mut ecan_igh_context_t) {
    adapter.measure_cycles();
}

fn need_statistics(call: Call, adapter: &Adapter) -> Result<&CycleStatistics, ecan_result_t> {
    adapter.cycle_statistics().ok_or_else(|| {
        let text = format_args!("nothing is measured: call ecan_igh_measure_cycles first");
        call.fail(ecan_result_t::ECAN_ERR_ORDER, text)
    })
}

/// Gets the timing of the cycles since ecan_igh_measure_cycles().
///
/// @usage   not rt, the cycle's thread, after ecan_igh_measure_cycles
/// @return  ECAN_OK; ECAN_ERR_ORDER if nothing is measured.
#[export(call, layer adapter, into statistics)]
pub fn ecan_igh_get_cycle_statistics(
    context: *mut ecan_igh_context_t,
    statistics: *mut ecan_igh_cycle_statistics_t,
) {
    Ok(need_statistics(call, adapter)?.into())
}

/// Gets the timing of the cycles as text, as in manual 13.9: four lines, the first of them
/// master_period.
///
/// @param text  See the rules for texts in igh_ecan_common.h; 512 bytes are enough.
///
/// @usage   not rt, the cycle's thread, after ecan_igh_measure_cycles
/// @return  As ecan_igh_get_cycle_statistics(); ECAN_ERR_BUFFER.
#[export(call, bus bus)]
pub fn ecan_igh_get_cycle_statistics_text(
    context: *mut ecan_igh_context_t,
    text: *mut c_char,
    size: usize,
    needed: *mut usize,
) {
    pointers!(call, out_text(text, size, needed));
    let measured = need_statistics(call, bus.need_adapter(call)?)?;
    text.put(call, &measured.to_string())
}
