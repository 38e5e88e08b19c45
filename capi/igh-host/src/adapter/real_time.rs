//! The real-time thread
//!
//! What makes the application's thread keep its cycle (manual 13.9 and 15.5.2, step 7).

use std::ffi::{c_char, c_int};

use ecan_host::{
    Adapter, CycleStart, CycleStatistics, CycleTiming, Distribution, MAX_SPIN_NS, Need,
    OverrunPolicy, RealTimeConfig, RealTimeError,
};
use ecan_mcan_host::boundary::{Call, call, put_text};
use ecan_mcan_host::common::result::ecan_result_t;

use super::context::ecan_igh_context_t;
use crate::bus;

/// What the thread of the cycle asks of the system. Fill with ecan_igh_default_real_time(), then
/// change fields.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct ecan_igh_real_time_t {
    /// SCHED_FIFO with this priority, 1 (lowest) to 99; 0 leaves the scheduling as it is.
    pub priority: i32,
    /// 1 keeps all memory of the process in RAM.
    pub lock_memory: u8,
    /// 1 makes ecan_igh_apply_real_time() fail where something is not granted.
    pub is_required: u8,
    /// Not used.
    pub reserved: [u8; 2],
    /// With lock_memory so many bytes of the thread's stack are touched in advance, up to 1 MiB.
    pub stack_bytes: u32,
    /// Keeps the processors of the machine out of sleep states that take longer than so many
    /// microseconds to leave, for as long as the process lives; -1 leaves them as they are.
    pub wake_up_latency_us: i32,
    /// CPUs that the thread may run on, bit 0 for CPU 0; 0 leaves the affinity as it is.
    pub cpu_mask: u64,
}

/// A cycle as ecan_igh_wait_next_cycle() met it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ecan_igh_cycle_start_t {
    /// Its point on the grid, in nanoseconds of ecan_igh_now_ns().
    pub deadline_ns: u64,
    /// How long after that point the wait ended, in nanoseconds.
    pub late_ns: u64,
    /// Points of the grid that were left out before this one.
    pub skipped: u64,
    /// 1 where the cycle before, with the answer of the bus, took past a point of the grid.
    pub has_overrun: u8,
    /// Not used.
    pub reserved: [u8; 7],
}

/// A row of times, in nanoseconds; all 0 where nothing was recorded.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ecan_igh_distribution_t {
    /// Number of times.
    pub count: u64,
    /// Shortest.
    pub min_ns: u64,
    /// Longest.
    pub max_ns: u64,
    /// Mean.
    pub mean_ns: f64,
    /// Half of the times are at most this long.
    pub p50_ns: u64,
    /// 95 of 100 are at most this long.
    pub p95_ns: u64,
    /// 99 of 100 are at most this long.
    pub p99_ns: u64,
    /// 999 of 1000 are at most this long.
    pub p99_9_ns: u64,
}

/// How well the cycle was kept (manual 13.9).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ecan_igh_cycle_statistics_t {
    /// From the start of a cycle to the next: the manual's master_period.
    pub period: ecan_igh_distribution_t,
    /// From the point on the grid to the start of its cycle.
    pub wake_up: ecan_igh_distribution_t,
    /// From the start of a cycle to its ecan_igh_send().
    pub run_time: ecan_igh_distribution_t,
    /// Largest difference of a period from the cycle, in nanoseconds.
    pub max_period_error_ns: u64,
    /// Cycles started.
    pub cycles: u64,
    /// Cycles that took past a point of the grid, with the answer of the bus.
    pub overruns: u64,
    /// Points of the grid that were left out.
    pub skipped: u64,
}

impl From<CycleStart> for ecan_igh_cycle_start_t {
    fn from(start: CycleStart) -> Self {
        Self {
            deadline_ns: start.deadline_ns,
            late_ns: start.late_ns,
            skipped: start.skipped,
            has_overrun: start.has_overrun.into(),
            reserved: [0; 7],
        }
    }
}

impl From<Distribution> for ecan_igh_distribution_t {
    fn from(times: Distribution) -> Self {
        Self {
            count: times.count,
            min_ns: times.min_ns,
            max_ns: times.max_ns,
            mean_ns: times.mean_ns,
            p50_ns: times.p50_ns,
            p95_ns: times.p95_ns,
            p99_ns: times.p99_ns,
            p99_9_ns: times.p99_9_ns,
        }
    }
}

fn settings(call: Call, wanted: &ecan_igh_real_time_t) -> Result<RealTimeConfig, ecan_result_t> {
    let need = if wanted.is_required != 0 { Need::Required } else { Need::Optional };
    let priority = u8::try_from(wanted.priority).map_err(|_| {
        call.argument("priority", format_args!("{} is not 0 to 99", wanted.priority))
    })?;
    let cpus: Vec<usize> = (0..64).filter(|cpu| wanted.cpu_mask >> cpu & 1 == 1).collect();
    let stack_bytes = usize::try_from(wanted.stack_bytes).unwrap_or(usize::MAX);
    Ok(RealTimeConfig {
        priority: Some(priority).filter(|priority| *priority > 0),
        priority_need: need,
        cpus: Some(cpus).filter(|cpus| !cpus.is_empty()),
        cpus_need: need,
        lock_memory: (wanted.lock_memory != 0).then_some(stack_bytes),
        lock_memory_need: need,
        wake_up_latency_us: u32::try_from(wanted.wake_up_latency_us).ok(),
        wake_up_latency_need: need,
        timing: CycleTiming::default(),
    })
}

/// Asks for nothing.
///
/// @usage   rt, any thread, any time
/// @return  ECAN_OK, ECAN_ERR_NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_default_real_time(settings: *mut ecan_igh_real_time_t) -> c_int {
    call("ecan_igh_default_real_time", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        unsafe { call.out("settings", settings)? }.set(ecan_igh_real_time_t {
            priority: 0,
            lock_memory: 0,
            is_required: 0,
            reserved: [0; 2],
            stack_bytes: 0,
            wake_up_latency_us: -1,
            cpu_mask: 0,
        });
        Ok(())
    })
}

/// Applies the settings to the calling thread, locked memory to its whole process.
///
/// To be called once by the thread of the cycle, before the cycle and after threads were started
/// that shall not inherit priority and affinity.
///
/// @param report  A line for each thing asked for: granted, or why not and what to do. Cut where it
///                does not fit.
/// @param size    Bytes of the report, NUL included; 0 asks for none.
///
/// @usage   not rt, the cycle's thread, any time
/// @return  ECAN_OK, also where something that is not required was not granted;
///          ECAN_ERR_PRIVILEGE where something required was not; what was granted stays in force.
///          ECAN_ERR_ARGUMENT for a value out of range, with nothing applied; ECAN_ERR_NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_apply_real_time(
    settings: *const ecan_igh_real_time_t,
    report: *mut c_char,
    size: usize,
) -> c_int {
    call("ecan_igh_apply_real_time", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (wanted, mut room) =
            unsafe { (call.read("settings", settings)?, call.room("report", report, size)?) };
        let applied = self::settings(call, wanted)?.apply();
        let told = match &applied {
            Ok(report) | Err(RealTimeError::Missing(report)) => report.to_string(),
            Err(_) => String::new(),
        };
        if size > 0 {
            put_text(&mut room, &told);
        }
        applied.map(drop).map_err(|error| {
            let code = match error {
                RealTimeError::Settings(_) => ecan_result_t::ECAN_ERR_ARGUMENT,
                _ => ecan_result_t::ECAN_ERR_PRIVILEGE,
            };
            call.fail(code, format_args!("{error}"))
        })
    })
}

/// Sets how ecan_igh_wait_next_cycle() waits, from the next wait on; at first it neither spins nor
/// makes up for cycles.
///
/// @param spin_us   Microseconds before each point in which the clock is looked at instead of slept
///                  on, 0 to 1000 (manual 13.9: 100). A stepped simulation plays it.
/// @param catch_up  Most missed cycles that are made up for, one behind the other with the bus'
///                  time to answer between; 0 leaves missed points out.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_ARGUMENT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_set_cycle_timing(
    context: *mut ecan_igh_context_t,
    spin_us: u32,
    catch_up: u32,
) -> c_int {
    call("ecan_igh_set_cycle_timing", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let mut bus = unsafe { bus::enter(call, context.cast())? };
        let spin_ns = u64::from(spin_us) * 1000;
        if spin_ns > MAX_SPIN_NS {
            let most = MAX_SPIN_NS / 1000;
            return Err(call.argument("spin_us", format_args!("{spin_us} is above {most}")));
        }
        let overrun = match catch_up {
            0 => OverrunPolicy::Skip,
            max_cycles => OverrunPolicy::CatchUp { max_cycles },
        };
        bus.need_adapter(call)?.set_cycle_timing(CycleTiming { spin_ns, overrun });
        Ok(())
    })
}

/// What the last ecan_igh_wait_next_cycle() met; all 0 before the first.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_get_cycle_start(
    context: *mut ecan_igh_context_t,
    start: *mut ecan_igh_cycle_start_t,
) -> c_int {
    call("ecan_igh_get_cycle_start", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (mut bus, out) =
            unsafe { (bus::enter(call, context.cast())?, call.out("start", start)?) };
        out.set(bus.need_adapter(call)?.cycle_start().into());
        Ok(())
    })
}

/// Begins to measure how well the cycle is kept, or anew. Takes about 3 megabytes.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_measure_cycles(context: *mut ecan_igh_context_t) -> c_int {
    call("ecan_igh_measure_cycles", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let mut bus = unsafe { bus::enter(call, context.cast())? };
        bus.need_adapter(call)?.measure_cycles();
        Ok(())
    })
}

fn need_statistics(call: Call, adapter: &Adapter) -> Result<&CycleStatistics, ecan_result_t> {
    adapter.cycle_statistics().ok_or_else(|| {
        let words = format_args!("nothing is measured: call ecan_igh_measure_cycles first");
        call.fail(ecan_result_t::ECAN_ERR_ORDER, words)
    })
}

/// What was measured since ecan_igh_measure_cycles().
///
/// @usage   not rt, the cycle's thread, after ecan_igh_measure_cycles
/// @return  ECAN_OK; ECAN_ERR_ORDER where nothing is measured; ECAN_ERR_NULL,
///          ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_get_cycle_statistics(
    context: *mut ecan_igh_context_t,
    statistics: *mut ecan_igh_cycle_statistics_t,
) -> c_int {
    call("ecan_igh_get_cycle_statistics", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (mut bus, out) =
            unsafe { (bus::enter(call, context.cast())?, call.out("statistics", statistics)?) };
        let measured = need_statistics(call, bus.need_adapter(call)?)?;
        out.set(ecan_igh_cycle_statistics_t {
            period: measured.period().into(),
            wake_up: measured.wake_up().into(),
            run_time: measured.run_time().into(),
            max_period_error_ns: measured.max_period_error_ns(),
            cycles: measured.cycles(),
            overruns: measured.overruns(),
            skipped: measured.skipped(),
        });
        Ok(())
    })
}

/// The same in words, as in manual 13.9: four lines, the first of them master_period.
///
/// @param text  Cut where it does not fit; 512 bytes are enough.
///
/// @usage   not rt, the cycle's thread, after ecan_igh_measure_cycles
/// @return  As ecan_igh_get_cycle_statistics().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecan_igh_get_cycle_statistics_text(
    context: *mut ecan_igh_context_t,
    text: *mut c_char,
    size: usize,
) -> c_int {
    call("ecan_igh_get_cycle_statistics_text", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (mut bus, mut room) =
            unsafe { (bus::enter(call, context.cast())?, call.room("text", text, size)?) };
        let measured = need_statistics(call, bus.need_adapter(call)?)?;
        put_text(&mut room, &measured.to_string());
        Ok(())
    })
}
