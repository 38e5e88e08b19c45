/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/**
 * ECAN-Lite host SDK: observation and commands from other threads.
 *
 * Snapshots of the last cycle, requests to stop and quick stops, without locks.
 *
 * igh_ecan_common.h has the rules for all functions.
 *
 * Change log
 *
 *   0.2.0  First version.
 */
#ifndef IGH_OBSERVER_H
#define IGH_OBSERVER_H

#include "igh_cia402_protocol.h"
#include "igh_mcan_port.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---------------------------------------------------------------------------
 * Life of an observer
 *
 * A handle for other threads than the cycle's: it reads a snapshot of the last cycle, and gives
 * commands that the next cycle executes. The cycle never waits for it. Only ecan_igh_observer_init()
 * uses the context: from another thread it returns ECAN_ERR_BUSY while a cycle runs. All other
 * functions work also then.
 *
 * static ecan_igh_observer_t observer;             for the monitor and the signal handler
 * ecan_igh_observer_init(&observer, &igh);         in the thread of the cycle
 * ...
 * if (ecan_igh_observer_update(&observer) == 0) {  in the monitor's thread
 *     igh_cia402_observer_get_axis_state(&observer, 0, &state);
 * }
 * ...
 * ecan_igh_observer_request_stop(&observer, NULL); in a signal handler
 * --------------------------------------------------------------------------- */

/**
 * A handle of other threads to the cycle. Any number of them per ecan_igh_context_t, one for each
 * thread that reads. Do not move or copy it.
 */
typedef struct {
    /** Not for the application. */
    uint64_t opaque[4];
} ecan_igh_observer_t;

/**
 * Creates an observer. It outlives its context: ecan_igh_observer_update() reports the end. While a
 * context has observers its cycle publishes a snapshot at its end.
 *
 * @param observer  Any content.
 * @param igh       The context, with or without Port and axes, which may be opened later.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_ORDER for an observer that is initialised already.
 */
int ecan_igh_observer_init(ecan_igh_observer_t *observer, ecan_igh_context_t *igh);

/**
 * Ends an observer, after calls of other threads with it that are in progress. Later calls return
 * ECAN_ERR_NOT_INITIALISED. Calling it again is harmless.
 *
 * @usage   not rt, any thread but no signal handler, any time
 */
int ecan_igh_observer_deinit(ecan_igh_observer_t *observer);

/* ---------------------------------------------------------------------------
 * Snapshot of the last cycle
 *
 * ecan_igh_observer_update() copies it into the observer; the other functions read it there, so all
 * that they return belongs to one cycle. One thread at a time reads through an observer: another one
 * gets ECAN_ERR_BUSY. Functions return ECAN_ERR_NOT_READY for parts that the cycle did not run: before
 * the first update, of a Port or of axes that were not served in this cycle.
 * --------------------------------------------------------------------------- */

/** Cycle of a snapshot. */
typedef struct {
    /** Number of the cycle, from 1. */
    uint64_t cycle;
    /** Its time on the clock of ecan_igh_now_ns(): its deadline, or its start without a wait for it. */
    uint64_t time_ns;
    /** Delay of its start after the deadline, in nanoseconds, if has_deadline is 1. */
    uint64_t late_ns;
    /** Time from its start to the end of its send, in nanoseconds. */
    uint64_t run_time_ns;
    /** Cycles that missed a deadline, since ecan_igh_init(). */
    uint64_t overruns;
    /** Deadlines that were skipped, since ecan_igh_init(). */
    uint64_t skipped;
    /** Number of slaves. */
    uint32_t slave_count;
    /** Number of axes; 0 if the cycle did not send targets. */
    uint32_t axis_count;
    /** 1 if the cycle began with a wait for its deadline. */
    uint8_t has_deadline;
    /** 1 if an observer requested the application to stop. */
    uint8_t is_stop_requested;
    /** 1 if a Port ran the cycle. */
    uint8_t has_port;
    /** Zero; for fields of later versions. */
    uint8_t reserved[29];
} ecan_igh_observed_cycle_t;

/**
 * Copies the snapshot of the last cycle into the observer. Wait-free for the cycle; repeats its copy
 * while the cycle overtakes it.
 *
 * @usage   rt, any thread but one at a time, after init; takes memory after a Port or axes were opened or
 *          the bus was reconfigured
 * @return  ECAN_OK; ECAN_ERR_NOT_READY before the first cycle with an observer; ECAN_ERR_ORDER if the
 *          context has ended: the snapshot is that of its last cycle.
 */
int ecan_igh_observer_update(ecan_igh_observer_t *observer);

/**
 * Gets number and times of the cycle of the snapshot.
 *
 * @usage   rt, any thread but one at a time, after update
 */
int ecan_igh_observer_get_cycle(ecan_igh_observer_t *observer, ecan_igh_observed_cycle_t *cycle);

/**
 * Returns 1 if the cycle of the snapshot or an earlier one has executed a command: a quick stop was
 * given to the axis, whose state reports its effect. A quick stop that was dropped, because its axes
 * ended or others were opened before a cycle executed it, is never executed. An executed one is
 * forgotten after 63 such changes.
 *
 * @param ticket  Number that the command gave; 0, of a command that was rejected, is never executed.
 *
 * @usage   rt, any thread but one at a time, after update
 * @return  1 or 0; 0 after an error, which ecan_last_error_code() gives.
 */
int ecan_igh_observer_has_executed(ecan_igh_observer_t *observer,
                                   uint64_t ticket);

/**
 * Gets the result of the exchange with one slave, as ecan_igh_get_domain_report() does.
 *
 * @usage   rt, any thread but one at a time, after update
 */
int ecan_igh_observer_get_domain_report(ecan_igh_observer_t *observer,
                                        size_t slave,
                                        ecan_igh_domain_report_t *report);

/**
 * Returns the state of a gateway's session, as igh_mcan_port_get_session() does.
 *
 * @usage   rt, any thread but one at a time, after update
 * @return  An igh_mcan_session_t; ECAN_ERR_SLAVE, ECAN_ERR_NOT_READY.
 */
int igh_mcan_observer_get_session(ecan_igh_observer_t *observer, size_t slave);

/**
 * Gets the counters of a gateway, as igh_mcan_port_get_statistics() does.
 *
 * @usage   rt, any thread but one at a time, after update
 */
int igh_mcan_observer_get_statistics(ecan_igh_observer_t *observer,
                                     size_t slave,
                                     igh_mcan_statistics_t *statistics);

/**
 * Gets the status word of a channel, as igh_mcan_port_get_channel_status() does; zeros for a channel
 * that is not enabled.
 *
 * @usage   rt, any thread but one at a time, after update
 */
int igh_mcan_observer_get_channel_status(ecan_igh_observer_t *observer,
                                         size_t slave,
                                         uint8_t channel,
                                         igh_mcan_channel_status_t *status);

/**
 * Gets the counters of a channel, as igh_mcan_port_get_channel_statistics() does; zeros for a channel
 * that is not enabled.
 *
 * @usage   rt, any thread but one at a time, after update
 */
int igh_mcan_observer_get_channel_statistics(ecan_igh_observer_t *observer,
                                             size_t slave,
                                             uint8_t channel,
                                             igh_mcan_channel_statistics_t *statistics);

/**
 * Gets the state of an axis at the end of the cycle, as igh_cia402_get_axis_state() does.
 *
 * @usage   rt, any thread but one at a time, after update
 */
int igh_cia402_observer_get_axis_state(ecan_igh_observer_t *observer,
                                       size_t axis,
                                       igh_cia402_axis_state_t *axis_state);

/* ---------------------------------------------------------------------------
 * Commands
 *
 * Any thread and any signal handler may give them, also while another thread reads through the same
 * observer: they use atomic operations only, and store no error text. A request to stop takes effect at
 * once. The cycle gives quick stops to the axes when it next sends targets: before the targets of this
 * cycle, or of the next one. The quick stop is then in the image of that cycle if the gateway is ready
 * and the image has room for its frame, and on the bus if the working counter of the image is complete:
 * an image that was not confirmed is repeated first.
 *
 * Each command gives a ticket, which is not 0; ecan_igh_observer_has_executed() returns 1 for it once a
 * cycle has given the command to the axis. Its effect is in the state of the axis: stop_cause and
 * phase.
 * --------------------------------------------------------------------------- */

/**
 * Requests the application to stop: calls that wait end with ECAN_ERR_STOPPED, except
 * igh_cia402_shutdown_timeout() and igh_cia402_stop_all_timeout(), and ecan_igh_is_stop_requested()
 * returns 1 until ecan_igh_clear_stop_request().
 *
 * @param ticket  Gets the number of the command, 0 if it is rejected; may be NULL.
 *
 * @usage   rt, any thread and signal handlers, after init
 * @return  ECAN_OK; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_ORDER if the context has
 *          ended; without a text in ecan_last_error().
 */
int ecan_igh_observer_request_stop(ecan_igh_observer_t *observer, uint64_t *ticket);

/**
 * Commands a quick stop, as igh_cia402_quick_stop() does: to one axis, or with IGH_CIA402_ALL_AXES
 * to all of all axis tables.
 *
 * @param axis    Index in the axis table that was opened last, of those that are open.
 * @param ticket  Gets the number of the command, 0 if it is rejected; may be NULL.
 *
 * @usage   rt, any thread and signal handlers, after init
 * @return  ECAN_OK; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_ORDER if the context has
 *          ended, ECAN_ERR_AXIS; without a text in ecan_last_error().
 */
int igh_cia402_observer_quick_stop(ecan_igh_observer_t *observer, size_t axis, uint64_t *ticket);

#ifdef __cplusplus
}
#endif

#endif /* IGH_OBSERVER_H */
