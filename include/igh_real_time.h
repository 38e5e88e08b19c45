/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/**
 * ECAN-Lite host SDK: the real-time thread and the timing of its cycles (manual 13.9).
 *
 * Priority, CPUs and locked memory of the cycle's thread; its waits and their statistics.
 *
 * igh_ecan_common.h has the rules for all functions.
 *
 * Change log
 *
 *   0.2.0  First version, from igh_adapter.h. Added: `needed` of ecan_igh_apply_real_time() and
 *          ecan_igh_get_cycle_statistics_text().
 *          Structs that the library fills end with reserved fields, which are 0; reserved fields of
 *          structs that the application fills must be 0.
 */
#ifndef IGH_REAL_TIME_H
#define IGH_REAL_TIME_H

#include "igh_adapter.h"
#include "igh_ecan_common.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---------------------------------------------------------------------------
 * Real-time thread
 *
 * Functions that make the application's thread keep its cycle (manual 13.9 and 15.5.2, step 7).
 * --------------------------------------------------------------------------- */

/**
 * Requests of the cycle's thread to the system. Fill with ecan_igh_default_real_time(), then
 * change fields.
 */
typedef struct {
    /** SCHED_FIFO with this priority, 1 (lowest) to 99; 0 leaves the scheduling as it is. */
    int32_t priority;
    /** 1 keeps all memory of the process in RAM. */
    uint8_t lock_memory;
    /** 1 makes ecan_igh_apply_real_time() fail if a request is denied. */
    uint8_t is_required;
    /** Must be 0. */
    uint8_t padding[2];
    /** With lock_memory: bytes of the thread's stack that are touched in advance, up to 1 MiB. */
    uint32_t stack_bytes;
    /**
     * Keeps the processors out of sleep states that take longer than this time to leave, in
     * microseconds, for as long as the process lives; -1 leaves them as they are.
     */
    int32_t wake_up_latency_us;
    /** CPUs that the thread may run on, bit 0 for CPU 0; 0 leaves the affinity as it is. */
    uint64_t cpu_mask;
    /** Must be 0; for fields of later versions. */
    uint64_t reserved[4];
} ecan_igh_real_time_t;

/** Start of a cycle as ecan_igh_wait_next_cycle() measured it. */
typedef struct {
    /** Deadline, in nanoseconds of ecan_igh_now_ns(). */
    uint64_t deadline_ns;
    /** Time from the deadline to the end of the wait, in nanoseconds. */
    uint64_t late_ns;
    /** Deadlines that were skipped before this one. */
    uint64_t skipped;
    /** 1 if the cycle before, with the response of the bus, took past a deadline. */
    uint8_t has_overrun;
    /** Zero; for fields of later versions. */
    uint8_t reserved[23];
} ecan_igh_cycle_start_t;

/** Distribution of times, in nanoseconds; all 0 if nothing was recorded. */
typedef struct {
    /** Number of times. */
    uint64_t count;
    /** Shortest. */
    uint64_t min_ns;
    /** Longest. */
    uint64_t max_ns;
    /** Mean. */
    double mean_ns;
    /** Half of the times are at most this long. */
    uint64_t p50_ns;
    /** 95 of 100 are at most this long. */
    uint64_t p95_ns;
    /** 99 of 100 are at most this long. */
    uint64_t p99_ns;
    /** 999 of 1000 are at most this long. */
    uint64_t p99_9_ns;
    /** Zero; for fields of later versions. */
    uint64_t reserved[2];
} ecan_igh_distribution_t;

/** Timing of the cycles (manual 13.9). */
typedef struct {
    /** From the start of a cycle to the next: the manual's master_period. */
    ecan_igh_distribution_t period;
    /** From the deadline to the start of its cycle. */
    ecan_igh_distribution_t wake_up;
    /** From the start of a cycle to its ecan_igh_send(). */
    ecan_igh_distribution_t run_time;
    /** Largest difference between a period and the configured cycle, in nanoseconds. */
    uint64_t max_period_error_ns;
    /** Cycles started. */
    uint64_t cycles;
    /** Cycles that took past a deadline, with the response of the bus. */
    uint64_t overruns;
    /** Deadlines that were skipped. */
    uint64_t skipped;
    /** Zero; for fields of later versions. */
    uint64_t reserved[8];
} ecan_igh_cycle_statistics_t;

/**
 * Fills the requests: nothing is requested.
 *
 * @usage   rt, any thread, any time
 */
int ecan_igh_default_real_time(ecan_igh_real_time_t *settings);

/**
 * Applies the requests to the calling thread; locked memory applies to its whole process.
 *
 * Call it once in the thread of the cycle, before the cycle and after starting threads that must
 * not inherit priority and affinity.
 *
 * @param report  A line for each request: granted, or the reason and what to do. See the rules for
 *                texts in igh_ecan_common.h; 1024 bytes are enough.
 *
 * @usage   not rt, the cycle's thread, any time
 * @return  ECAN_OK, also if a request that is not required was denied; ECAN_ERR_PRIVILEGE if a
 *          required one was denied: granted requests stay in force. ECAN_ERR_ARGUMENT for a value
 *          out of range, with nothing applied. ECAN_ERR_BUFFER if only the report was cut.
 */
ECAN_MUST_CHECK
int ecan_igh_apply_real_time(const ecan_igh_real_time_t *settings,
                             char *report,
                             size_t size,
                             size_t *needed);

/**
 * Sets how ecan_igh_wait_next_cycle() waits, from the next wait on. By default it neither spins
 * nor catches up.
 *
 * @param spin_us   Microseconds before each deadline in which the thread polls the clock instead
 *                  of sleeping, 0 to 1000 (manual 13.9: 100). A stepped simulation emulates it.
 * @param catch_up  Most missed cycles that are run late, one after the other with the response
 *                  time of the bus between them; 0 skips missed deadlines.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_ARGUMENT.
 */
int ecan_igh_set_cycle_timing(ecan_igh_context_t *context, uint32_t spin_us, uint32_t catch_up);

/**
 * Gets the start of the cycle as the last ecan_igh_wait_next_cycle() measured it; all 0 before the
 * first.
 *
 * @usage   rt, the cycle's thread, after init
 */
int ecan_igh_get_cycle_start(ecan_igh_context_t *context, ecan_igh_cycle_start_t *start);

/**
 * Starts or restarts measuring the timing of the cycles. Takes about 3 megabytes.
 *
 * @usage   not rt, the cycle's thread, after init
 */
int ecan_igh_measure_cycles(ecan_igh_context_t *context);

/**
 * Gets the timing of the cycles since ecan_igh_measure_cycles().
 *
 * @usage   not rt, the cycle's thread, after ecan_igh_measure_cycles
 * @return  ECAN_OK; ECAN_ERR_ORDER if nothing is measured.
 */
int ecan_igh_get_cycle_statistics(ecan_igh_context_t *context,
                                  ecan_igh_cycle_statistics_t *statistics);

/**
 * Gets the timing of the cycles as text, as in manual 13.9: four lines, the first of them
 * master_period.
 *
 * @param text  See the rules for texts in igh_ecan_common.h; 512 bytes are enough.
 *
 * @usage   not rt, the cycle's thread, after ecan_igh_measure_cycles
 * @return  As ecan_igh_get_cycle_statistics(); ECAN_ERR_BUFFER.
 */
int ecan_igh_get_cycle_statistics_text(ecan_igh_context_t *context,
                                       char *text,
                                       size_t size,
                                       size_t *needed);

#ifdef __cplusplus
}
#endif

#endif /* IGH_REAL_TIME_H */
