/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/**
 * ECAN-Lite host SDK: the Adapter (manual 15.1, 15.5).
 *
 * Master, slaves, one domain for each, startup SDOs, distributed clocks, the cycle and raw process
 * data.
 *
 * igh_ecan_common.h has the rules for all functions.
 *
 * Change log
 *
 *   0.2.0  Renamed: ecan_igh_answer_ns to ecan_igh_response_ns.
 *          Added: ecan_igh_config_set_dc_sync0_planned(), ecan_igh_config_get_dc_margin(),
 *          ecan_igh_retry_startup().
 *          Cycle, receive and send functions return ECAN_ERR_ORDER if no cycle is open.
 *          ecan_igh_init() writes nothing to the slaves; a startup SDO that is aborted is reported by
 *          ecan_igh_wait_op_timeout(), with ecan_last_abort_code().
 *          ecan_igh_domain_is_complete(), ecan_igh_is_operational(), ecan_igh_is_simulated() and
 *          ecan_igh_clock_is_stepped() return 0 after an error, no longer its code.
 *          Added: `needed` of ecan_igh_config_get_ecrt().
 *          Moved: the real-time thread and the cycle statistics to igh_real_time.h; scenario, clock and seed
 *          of a simulation, ecan_igh_is_simulated() and ecan_igh_clock_is_stepped() to igh_sim.h.
 *          Structs that the library fills end with reserved fields, which are 0; reserved fields of
 *          structs that the application fills must be 0.
 *          Added: ecan_igh_config_add_startup_readback().
 *          Added: ecan_igh_is_stop_requested(), ecan_igh_clear_stop_request().
 *          ecan_igh_init() returns ECAN_ERR_FILE, not ECAN_ERR_ECRT, for a scenario.
 *          Added: ecan_igh_config_stop_waiting_when(). An overwritten configuration is
 *          ECAN_ERR_NOT_INITIALISED.
 *   0.1.0  First version.
 */
#ifndef IGH_ADAPTER_H
#define IGH_ADAPTER_H

#include "igh_ecan_common.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---------------------------------------------------------------------------
 * Configuration
 *
 * Plain data: it may be copied and needs no deinit. Nothing touches the bus before
 * ecan_igh_init(). Bytes that something else than this library has overwritten are
 * ECAN_ERR_NOT_INITIALISED in every function.
 * --------------------------------------------------------------------------- */

/** Most slaves of a configuration. */
#define ECAN_IGH_MAX_SLAVES 32

/** Most startup SDOs that an application may add, of all slaves together. */
#define ECAN_IGH_MAX_STARTUP_SDOS 256

/** Most bytes of the setting `ecrt`, NUL included. */
#define ECAN_IGH_MAX_SETTING 512

/** Configuration of the Adapter. About 50 kilobytes. */
typedef struct {
    /** Not for the application. */
    uint64_t opaque[6144];
} ecan_igh_config_t;

/**
 * Fills a configuration: one slave at position 0, N = 3 (384 bytes), a cycle of 10 ms, no
 * distributed clocks, master 0, the setting `ecrt` of the environment (manual 15.5.2).
 *
 * @param config  Is overwritten.
 *
 * @usage   not rt, any thread, any time
 */
int ecan_igh_default_config(ecan_igh_config_t *config);

/**
 * Checks a configuration as a whole, without touching the bus. ecan_igh_init() does it, too.
 *
 * @usage   not rt, any thread, any time
 * @return  ECAN_OK; ECAN_ERR_CONFIG with every fault in ecan_last_error().
 */
ECAN_MUST_CHECK int ecan_igh_check_config(const ecan_igh_config_t *config);

/**
 * Gets the setting `ecrt` of a configuration, which selects the EtherCAT master library.
 *
 * @param setting  "" if nothing is set and the environment decides. See the rules for texts in
 *                 igh_ecan_common.h; ECAN_IGH_MAX_SETTING bytes are enough.
 *
 * @usage   not rt, any thread, any time
 * @return  ECAN_OK, ECAN_ERR_BUFFER.
 */
int ecan_igh_config_get_ecrt(const ecan_igh_config_t *config,
                             char *setting,
                             size_t size,
                             size_t *needed);

/* ---------------------------------------------------------------------------
 * Configuration of the master
 * --------------------------------------------------------------------------- */

/**
 * Selects the EtherCAT master library.
 *
 * Without this call the environment variable ECAN_ECRT selects it, and without that variable it is
 * the installed libethercat.so.1. The SDK never falls back to the simulator automatically.
 *
 * @param setting  "" for libethercat.so.1; the path of a library; "sim" for the built-in
 *                 simulator with the scenario that was suggested; "sim:echo", "sim:drives" or
 *                 "sim:FILE.toml" for a scenario. NULL removes the choice. Is copied.
 *
 * @usage   not rt, any thread, before init
 * @return  ECAN_OK, ECAN_ERR_ARGUMENT, ECAN_ERR_BUFFER. ecan_igh_init() reports a library that
 *          cannot be loaded.
 */
int ecan_igh_config_set_ecrt(ecan_igh_config_t *config, const char *setting);

/**
 * Selects the EtherCAT master.
 *
 * @param index  0 for /dev/EtherCAT0, the default.
 *
 * @usage   not rt, any thread, before init
 */
int ecan_igh_config_set_master_index(ecan_igh_config_t *config, uint32_t index);

/**
 * Sets the number of ECAN-Lite slaves; slave i is at position i unless that is changed.
 *
 * @param count  1 to ECAN_IGH_MAX_SLAVES.
 *
 * @usage   not rt, any thread, before init
 * @return  ECAN_OK, ECAN_ERR_ARGUMENT.
 */
int ecan_igh_config_set_slave_count(ecan_igh_config_t *config, size_t count);

/**
 * Gets the number of slaves, after igh_mcan_port_load_config() for example.
 *
 * @usage   not rt, any thread, any time
 */
int ecan_igh_config_get_slave_count(const ecan_igh_config_t *config, size_t *count);

/**
 * Sets the period of the application's cycle.
 *
 * @param cycle_us  Microseconds, 1 to 4294967. Typical are 100 to 100000; must be shorter than the
 *                  watchdog: ecan_igh_config_set_watchdog_us().
 *
 * @usage   not rt, any thread, before init
 * @return  ECAN_OK, ECAN_ERR_ARGUMENT.
 */
int ecan_igh_config_set_cycle_us(ecan_igh_config_t *config, uint32_t cycle_us);

/**
 * Gets the period of the application's cycle.
 *
 * @param cycle_ns  Nanoseconds: a file may have fractions of a microsecond.
 *
 * @usage   not rt, any thread, any time
 */
int ecan_igh_config_get_cycle_ns(const ecan_igh_config_t *config, uint32_t *cycle_ns);

/**
 * States that the installed master carries more than 1486 bytes of process data per sync manager.
 * Without it N is at most 11 (ECAN_PDO_MAX_PLAIN_MULTIPLIER).
 *
 * @usage   not rt, any thread, before init
 */
int ecan_igh_config_allow_large_pdos(ecan_igh_config_t *config, int allow);

/**
 * Sets the time in which the slaves must respond in PREOP, in milliseconds; 10000 by default.
 *
 * @usage   not rt, any thread, before init
 */
int ecan_igh_config_set_preop_timeout_ms(ecan_igh_config_t *config, uint32_t timeout_ms);

/**
 * Sets the process data watchdog of the gateways: a gateway that receives no outputs for this time
 * changes from OP to SAFEOP (AL status code 0x001B) and sends no more frames of the application.
 *
 * @param watchdog_us  A multiple of 100 from 100 to 6553500, 100000 by default. Must be longer
 *                     than two cycles, or a single lost frame ends operation.
 *
 * @usage   not rt, any thread, before init
 * @return  ECAN_OK. The value is checked with the others by ecan_igh_check_config() and
 *          ecan_igh_init().
 */
int ecan_igh_config_set_watchdog_us(ecan_igh_config_t *config, uint32_t watchdog_us);

/**
 * Sets a function that ecan_igh_init() and ecan_igh_attach() call many times per second while they
 * wait, for a master that is still scanning the bus for example: if it returns other than 0, they end
 * with ECAN_ERR_STOPPED. After them the waiting calls of all layers call it, as after
 * ecan_igh_stop_waiting_when().
 *
 * @param stop  Gets `user`; NULL for none. As that of ecan_igh_stop_waiting_when(); must be valid
 *              as long as a context of this configuration exists.
 * @param user  Is passed to it, in the thread that waits.
 *
 * @usage   not rt, any thread, before init
 */
int ecan_igh_config_stop_waiting_when(ecan_igh_config_t *config,
                                      int (*stop)(void *user),
                                      void *user);

/* ---------------------------------------------------------------------------
 * Configuration of the distributed clocks
 * --------------------------------------------------------------------------- */

/** The clock that the others follow. */
typedef enum {
    /** The host's: the reference clock is corrected to the application's time in each cycle. */
    ECAN_IGH_CLOCK_HOST = 0,
    /** The reference clock: a phase-locked loop shifts the deadlines of the host's cycle. */
    ECAN_IGH_CLOCK_REFERENCE = 1
} ecan_igh_clock_source_t;

/**
 * Enables distributed clocks with Sync0 (manual 8.4, 15.6). 15.6.1 lists proven phases.
 *
 * @param cycle_us  Period of Sync0 in microseconds, a whole multiple of the cycle; 0 disables
 *                  distributed clocks.
 * @param shift_us  Phase of Sync0 against the start of the period, in microseconds, below it.
 *
 * @usage   not rt, any thread, before init
 * @return  ECAN_OK, ECAN_ERR_ARGUMENT. ecan_igh_check_config() checks the period against the
 *          cycle.
 */
int ecan_igh_config_set_dc_sync0(ecan_igh_config_t *config, uint32_t cycle_us, uint32_t shift_us);

/**
 * Enables distributed clocks with Sync0, with the shift that the plan recommends: the middle between
 * the latest arrival of the outputs in a cycle and the earliest one in the next (manual 16.1).
 *
 * Uses the slaves, their PDO sizes and the cycle that the configuration has now: call it after they
 * are set, and again when one of them changes. The times of the application, the host and the
 * firmware are those of igh_mcan_port_apply_config() if it was called, otherwise 100, 30 and 50 us. A
 * product measures its shift (manual 15.6.1) and sets it with ecan_igh_config_set_dc_sync0().
 *
 * @param cycle_us  Period of Sync0 in microseconds, a whole multiple of the cycle; 0 disables
 *                  distributed clocks.
 *
 * @usage   not rt, any thread, before init
 * @return  ECAN_OK, ECAN_ERR_ARGUMENT.
 */
int ecan_igh_config_set_dc_sync0_planned(ecan_igh_config_t *config,
                                         uint32_t cycle_us);

/**
 * Gets the Sync0 shift and its margin by the plan: the distance of the pulses from the arrivals of
 * the outputs. If it is negative, outputs may be missed (manual 16.1).
 *
 * @param shift_ns   Gets the shift in nanoseconds.
 * @param margin_ns  Gets the margin in nanoseconds; 0 without slaves.
 *
 * @usage   not rt, any thread, after ecan_igh_config_set_dc_sync0 or _planned
 * @return  ECAN_OK; ECAN_ERR_ORDER if distributed clocks are off.
 */
int ecan_igh_config_get_dc_margin(const ecan_igh_config_t *config,
                                  uint32_t *shift_ns,
                                  int64_t *margin_ns);

/**
 * Sets the AssignActivate word of the slaves' distributed clocks; 0x0300 by default.
 *
 * @usage   not rt, any thread, after ecan_igh_config_set_dc_sync0 and before init
 * @return  ECAN_OK; ECAN_ERR_ORDER if distributed clocks are off.
 */
int ecan_igh_config_set_dc_assign_activate(ecan_igh_config_t *config, uint16_t word);

/**
 * Selects the clock that the others follow; the host's by default.
 *
 * @param source  An ecan_igh_clock_source_t.
 *
 * @usage   not rt, any thread, after ecan_igh_config_set_dc_sync0 and before init
 * @return  ECAN_OK, ECAN_ERR_ARGUMENT; ECAN_ERR_ORDER if distributed clocks are off.
 */
int ecan_igh_config_set_dc_source(ecan_igh_config_t *config, int source);

/**
 * Selects the slave whose clock is the reference; by default the first on the bus with a clock.
 *
 * @param slave  Slave index; ecan_igh_check_config() checks it.
 *
 * @usage   not rt, any thread, after ecan_igh_config_set_dc_sync0 and before init
 * @return  ECAN_OK; ECAN_ERR_ORDER if distributed clocks are off.
 */
int ecan_igh_config_set_dc_reference(ecan_igh_config_t *config, size_t slave);

/**
 * Sets the interval at which the differences between the slaves' clocks are measured; 100 cycles
 * by default.
 *
 * @param every  Cycles from measurement to measurement; 0 for never.
 *
 * @usage   not rt, any thread, after ecan_igh_config_set_dc_sync0 and before init
 * @return  ECAN_OK; ECAN_ERR_ORDER if distributed clocks are off.
 */
int ecan_igh_config_set_dc_monitor(ecan_igh_config_t *config, uint32_t every);

/* ---------------------------------------------------------------------------
 * Configuration of a slave
 * --------------------------------------------------------------------------- */

/**
 * Sets N of both directions on every slave: the PDOs have 128 * N bytes (manual 5.2). Without it
 * igh_mcan_port_apply_config() takes 3, and 8 for a gateway with a CAN FD channel.
 *
 * @param n  1 to 24; above 11 see ecan_igh_config_allow_large_pdos().
 *
 * @usage   not rt, any thread, before init
 * @return  ECAN_OK, ECAN_ERR_ARGUMENT.
 */
int ecan_igh_config_set_pdo_multiplier(ecan_igh_config_t *config, uint32_t n);

/**
 * Sets N of both directions on one slave.
 *
 * @usage   not rt, any thread, before init
 * @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_ARGUMENT.
 */
int ecan_igh_config_set_slave_pdo_multiplier(ecan_igh_config_t *config, size_t slave, uint32_t n);

/**
 * Sets N of each direction on one slave.
 *
 * @param rx_n  Of the RxPDO, master to slave.
 * @param tx_n  Of the TxPDO, slave to master.
 *
 * @usage   not rt, any thread, before init
 * @return  As ecan_igh_config_set_slave_pdo_multiplier().
 */
int ecan_igh_config_set_slave_pdo_multipliers(ecan_igh_config_t *config,
                                              size_t slave,
                                              uint32_t rx_n,
                                              uint32_t tx_n);

/**
 * Gets N of each direction of one slave.
 *
 * @param rx_n  Of the RxPDO, master to slave.
 * @param tx_n  Of the TxPDO, slave to master.
 *
 * @usage   not rt, any thread, any time
 */
int ecan_igh_config_get_slave_pdo_multipliers(const ecan_igh_config_t *config,
                                              size_t slave,
                                              uint32_t *rx_n,
                                              uint32_t *tx_n);

/**
 * Sets the position of a slave.
 *
 * @param alias     Station alias that the position counts from; 0 counts from the start of the
 *                  bus.
 * @param position  Position, from 0.
 *
 * @usage   not rt, any thread, before init
 */
int ecan_igh_config_set_slave_position(ecan_igh_config_t *config,
                                       size_t slave,
                                       uint16_t alias,
                                       uint16_t position);

/**
 * Gets the position of a slave, as ecan_igh_config_set_slave_position() sets it.
 *
 * @usage   not rt, any thread, any time
 */
int ecan_igh_config_get_slave_position(const ecan_igh_config_t *config,
                                       size_t slave,
                                       uint16_t *alias,
                                       uint16_t *position);

/**
 * Sets the required vendor ID and product code (object 0x1018). Without it the SDK accepts every
 * slave whose objects identify it as an ECAN-Lite.
 *
 * @usage   not rt, any thread, before init
 */
int ecan_igh_config_set_slave_identity(ecan_igh_config_t *config,
                                       size_t slave,
                                       uint32_t vendor_id,
                                       uint32_t product_code);

/**
 * Adds a startup SDO of the application: written after the Port's own, in the order of the calls,
 * at every (re)configuration of the slave.
 *
 * @param index     Object.
 * @param subindex  Subindex.
 * @param data      Value, little endian, as on the bus. Is copied.
 * @param size      Its bytes: 1, 2 or 4.
 *
 * @usage   not rt, any thread, before init
 * @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_ARGUMENT; ECAN_ERR_FULL beyond
 *          ECAN_IGH_MAX_STARTUP_SDOS.
 */
ECAN_MUST_CHECK
int ecan_igh_config_add_startup_sdo(ecan_igh_config_t *config,
                                    size_t slave,
                                    uint16_t index,
                                    uint8_t subindex,
                                    const void *data,
                                    size_t size);

/**
 * Adds a readback to the startup of a slave, in the order of the calls: an object that must have this
 * value, or ecan_igh_init() fails. The startup is then executed once before the bus is active.
 *
 * @usage   not rt, any thread, before init
 * @return  ECAN_OK, ECAN_ERR_SLAVE; ECAN_ERR_FULL beyond ECAN_IGH_MAX_STARTUP_SDOS.
 */
ECAN_MUST_CHECK
int ecan_igh_config_add_startup_readback(ecan_igh_config_t *config,
                                         size_t slave,
                                         uint16_t index,
                                         uint8_t subindex,
                                         uint32_t value);

/* ---------------------------------------------------------------------------
 * Life of a master
 *
 * ecan_igh_context_t igh;
 * ecan_igh_init(&igh, &config);              slaves found, everything registered
 * ecan_igh_wait_op_timeout(&igh, 10000);     OP, the cycle runs
 * ...
 * ecan_igh_deinit(&igh);
 * --------------------------------------------------------------------------- */

/**
 * A master with its slaves. Belongs to one thread at a time; do not move or copy it. What builds
 * on it (igh_mcan_port_t, igh_cia402_context_t) ends with it.
 */
typedef struct {
    /** Not for the application. */
    uint64_t opaque[4];
} ecan_igh_context_t;

/**
 * Opens the master: checks the configuration as a whole, loads the EtherCAT master library,
 * reserves the master, finds and identifies the slaves, registers their startup SDOs (also those of
 * igh_mcan_port_apply_config()) and maps their PDOs. Writes nothing to the slaves: the master executes
 * the startup SDOs when the bus is active. A rejected one is reported by ecan_igh_wait_op_timeout() or
 * igh_mcan_port_wait_ready().
 *
 * Blocks, for seconds if the master is still scanning the bus;
 * ecan_igh_config_stop_waiting_when() can end that early. A simulated library identifies itself on
 * standard error.
 *
 * @param context  Any content; the manual's fragments leave it uninitialised.
 * @param config   Is copied.
 *
 * @usage   not rt, any thread, any time
 * @return  ECAN_OK; ECAN_ERR_CONFIG, ECAN_ERR_ECRT, ECAN_ERR_FILE, ECAN_ERR_MASTER, ECAN_ERR_NOT_FOUND,
 *          ECAN_ERR_IDENTITY, ECAN_ERR_SDO, ECAN_ERR_READBACK, ECAN_ERR_NOT_OPERATIONAL,
 *          ECAN_ERR_STOPPED;
 *          ECAN_ERR_ORDER for a context that is initialised already. After an error there is
 *          nothing to deinit.
 */
int ecan_igh_init(ecan_igh_context_t *context,
                  const ecan_igh_config_t *config);

/**
 * Adds slaves to a master that the application runs itself, for other slaves on the same bus.
 *
 * Requesting, activating, sending, receiving and releasing stay with the owner: call this before
 * ecrt_master_activate(), ecan_igh_owner_activated() after it, in each cycle ecan_igh_receive()
 * (or igh_mcan_port_cycle_begin()) after ecrt_master_receive() and ecan_igh_send() (or
 * igh_mcan_port_cycle_end()) before ecrt_master_send(). Functions that wait by running the cycle
 * return ECAN_ERR_ATTACHED; poll ecan_igh_is_operational() or igh_mcan_port_is_ready() instead.
 * Deinit the context before ecrt_master_deactivate() and ecrt_release_master().
 *
 * The library is the libethercat that this process has loaded; it is not loaded again. Under the
 * simulated libethercat (LD_LIBRARY_PATH=build/sim) the setting `sim...` means this library. A path
 * as the setting must be that of the loaded library.
 *
 * @param master  The owner's ec_master_t, reserved, of the library that this process has loaded.
 *
 * @usage   not rt, the owner's thread, before ecrt_master_activate
 * @return  As ecan_igh_init(); ECAN_ERR_ECRT also if the process has loaded no libethercat, or another
 *          one than the setting `ecrt` selects.
 */
ECAN_MUST_CHECK
int ecan_igh_attach(ecan_igh_context_t *context,
                    const ecan_igh_config_t *config,
                    void *master);

/**
 * Reports that the owner has activated the master.
 *
 * @usage   not rt, the owner's thread, after ecrt_master_activate
 * @return  ECAN_OK; ECAN_ERR_ORDER for a context that is not attached or active already;
 *          ECAN_ERR_MASTER.
 */
ECAN_MUST_CHECK int ecan_igh_owner_activated(ecan_igh_context_t *context);

/**
 * Starts cyclic operation without waiting for OP: from now on the application runs the cycle and
 * polls ecan_igh_is_operational() or igh_mcan_port_is_ready().
 *
 * @usage   not rt, the cycle's thread, after init and igh_mcan_port_init
 * @return  ECAN_OK; ECAN_ERR_ORDER if it is active already; ECAN_ERR_ATTACHED, ECAN_ERR_MASTER.
 */
ECAN_MUST_CHECK int ecan_igh_activate(ecan_igh_context_t *context);

/**
 * Starts cyclic operation if necessary and runs the cycle until every slave is in OP; with a Port
 * also until every gateway is verified, so that frames can be sent. Blocks and drops received
 * frames. Call igh_mcan_port_init() before, since a Port needs a bus that is not active yet.
 *
 * @param timeout_ms  Milliseconds; ecan_igh_startup_timeout_ms() returns a sufficient time.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_NOT_OPERATIONAL with the state of every slave that is not in OP, the
 *          reason, and ecan_last_abort_code() of a startup SDO that was aborted;
 *          ECAN_ERR_VERIFICATION for a gateway in OP whose readback differs from the configuration;
 *          ECAN_ERR_STOPPED, ECAN_ERR_ATTACHED, ECAN_ERR_MASTER.
 */
int ecan_igh_wait_op_timeout(ecan_igh_context_t *context, uint32_t timeout_ms);

/**
 * Sets a function that the waiting calls of all layers call once per cycle; if it returns other
 * than 0, they end with ECAN_ERR_STOPPED: after a signal or a pressed button, for example. Started
 * operations continue as long as the cycle runs. igh_cia402_shutdown_timeout() does not call it.
 *
 * @param stop  Gets `user`; NULL for none. It should be quick; a call to the library with this
 *              context returns ECAN_ERR_BUSY there. It must return: a C++ exception that leaves it
 *              ends the process, with a message on standard error.
 * @param user  Is passed to it, in the thread that waits.
 *
 * @usage   not rt, the cycle's thread, after init
 */
int ecan_igh_stop_waiting_when(ecan_igh_context_t *context, int (*stop)(void *user), void *user);

/**
 * Returns 1 if an observer requested the application to stop (ecan_igh_observer_request_stop()). All
 * calls that wait end with ECAN_ERR_STOPPED then, except igh_cia402_shutdown_timeout() and
 * igh_cia402_stop_all_timeout().
 *
 * @usage   rt, the cycle's thread, after init
 * @return  1 or 0; 0 after an error, which ecan_last_error_code() gives.
 */
int ecan_igh_is_stop_requested(ecan_igh_context_t *context);

/**
 * Ends a request to stop: calls wait again.
 *
 * @usage   rt, the cycle's thread, after init
 */
int ecan_igh_clear_stop_request(ecan_igh_context_t *context);

/**
 * Leaves cyclic operation and configures the slaves again, to change N at run time for example
 * (manual 14.2). Then wait for OP again. With a Port use igh_mcan_port_reconfigure().
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  As ecan_igh_init(); ECAN_ERR_ORDER with a Port, ECAN_ERR_ATTACHED. A faulty
 *          configuration changes nothing; after any other error reconfigure again.
 */
ECAN_MUST_CHECK
int ecan_igh_reconfigure(ecan_igh_context_t *context,
                         const ecan_igh_config_t *config);

/**
 * Requests another startup of the slaves whose startup failed; igh_mcan_port_get_session() shows that
 * a gateway waits for it. The waiting calls and, at increasing intervals, the cycle of a Port request
 * it as well. With a library before version 1.6 it takes the master's semaphore, usually for
 * microseconds but without a bound: a Port does not request it there while a gateway is ready, and
 * the application calls it between two cycles, not while axes of other gateways move.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  ECAN_OK; ECAN_ERR_ORDER if the bus is not active; ECAN_ERR_ATTACHED, since the owner
 *          calls ecrt_master_reset(); ECAN_ERR_MASTER.
 */
ECAN_MUST_CHECK
int ecan_igh_retry_startup(ecan_igh_context_t *context);

/**
 * Leaves cyclic operation and releases the master, or detaches from the owner's. A Port and axes
 * on it end, too: axes that may move are stopped before, as by igh_cia402_context_deinit().
 *
 * @usage   not rt, the cycle's thread, any time
 * @return  ECAN_OK, also for a context that is deinitialised already or never was initialised.
 *          Also for a copy of it, which ends nothing. ECAN_ERR_AXES names the axes that may still
 *          move; everything is closed nevertheless.
 */
int ecan_igh_deinit(ecan_igh_context_t *context);

/**
 * Returns a sufficient timeout for ecan_igh_wait_op_timeout(), by the startup SDOs, the cycle and
 * the number of slaves.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  Milliseconds; 0 if there is no context.
 */
uint32_t ecan_igh_startup_timeout_ms(ecan_igh_context_t *context);

/* ---------------------------------------------------------------------------
 * The cycle
 *
 * With a Port on the context use igh_mcan_port_cycle_begin() and igh_mcan_port_cycle_end(), which
 * call these.
 * --------------------------------------------------------------------------- */

/** Delivery of one direction in the last exchange, by the working counter. */
typedef enum {
    /** There was no exchange yet. */
    ECAN_IGH_DELIVERY_NONE = 0,
    /** The image was delivered. */
    ECAN_IGH_DELIVERY_CONFIRMED = 1,
    /** The image was not delivered. */
    ECAN_IGH_DELIVERY_MISSED = 2,
    /** Unknown: one of two datagrams counted. */
    ECAN_IGH_DELIVERY_UNKNOWN = 3
} ecan_igh_delivery_t;

/** Result of the last exchange with one slave. */
typedef struct {
    /** Working counter of the slave's domain. */
    uint32_t working_counter;
    /** Working counter of a complete exchange. */
    uint32_t expected_working_counter;
    /** Evaluation by the master, which is decisive: 0 nothing, 1 incomplete, 2 complete. */
    uint8_t wc_state;
    /** Delivery of the RxPDO: an ecan_igh_delivery_t. */
    uint8_t outputs;
    /** Delivery of the TxPDO: an ecan_igh_delivery_t. */
    uint8_t inputs;
    /** 1 if both directions were exchanged, else 0. */
    uint8_t is_complete;
    /** Zero; for fields of later versions. */
    uint32_t reserved[5];
} ecan_igh_domain_report_t;

/**
 * Receives the process data and evaluates the working counters. First in the cycle.
 *
 * @usage   rt, the cycle's thread, active bus
 * @return  ECAN_OK; ECAN_ERR_MASTER if a call of the library failed: the cycle may continue;
 *          ECAN_ERR_ORDER if the bus is not active or there is a Port on it.
 */
int ecan_igh_receive(ecan_igh_context_t *context);

/**
 * Sends the process data. Last in the cycle.
 *
 * @usage   rt, the cycle's thread, active bus
 * @return  As ecan_igh_receive().
 */
int ecan_igh_send(ecan_igh_context_t *context);

/**
 * Sleeps until the next deadline of the cycle, on a grid of the configured period that never
 * drifts. In a stepped simulation time passes here.
 *
 * A cycle lasts until the response of the bus is back, ecan_igh_response_ns() after the last send;
 * after a late cycle the next deadline may be missed by this time. A datagram that is sent again
 * before it is back loses its response and the received frames in it. An application with its own
 * timer must leave that time, too.
 *
 * @usage   rt, the cycle's thread, active bus
 */
int ecan_igh_wait_next_cycle(ecan_igh_context_t *context);

/**
 * Returns the time of the master's clock: CLOCK_MONOTONIC, or the simulation's.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  Nanoseconds; 0 if there is no context.
 */
uint64_t ecan_igh_now_ns(ecan_igh_context_t *context);

/**
 * Returns the deadline of the running cycle on the clock of ecan_igh_now_ns(). Sync0 refers to it,
 * however late the wake-up was.
 *
 * @usage   rt, the cycle's thread, active bus
 * @return  Nanoseconds; 0 before the first cycle and if there is no context.
 */
uint64_t ecan_igh_cycle_time_ns(ecan_igh_context_t *context);

/**
 * Returns how long the cycle waits for the response of the bus: its time on the wire, through the
 * slaves and through the host.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  Nanoseconds; 0 if there is no context.
 */
uint64_t ecan_igh_response_ns(ecan_igh_context_t *context);

/**
 * Returns 1 if every slave exchanged both directions in the last cycle. Do not advance motion
 * otherwise (manual 15.5.2, step 8).
 *
 * @usage   rt, the cycle's thread, after init
 * @return  1 or 0; 0 after an error, which ecan_last_error_code() gives.
 */
int ecan_igh_domain_is_complete(ecan_igh_context_t *context);

/**
 * Gets the result of the last exchange with one slave.
 *
 * @usage   rt, the cycle's thread, after init
 */
int ecan_igh_get_domain_report(ecan_igh_context_t *context,
                               size_t slave,
                               ecan_igh_domain_report_t *report);

/* ---------------------------------------------------------------------------
 * Distributed clocks in the cycle
 * --------------------------------------------------------------------------- */

/** Differences between the clocks. */
typedef struct {
    /**
     * Delay of the host against the reference clock in the last cycle with a reading, in
     * nanoseconds, without the time that it is known to have waited and worked since the
     * deadline.
     */
    int32_t phase_error_ns;
    /**
     * Rate of the host's clock minus that of the reference clock, in parts per billion; 0 if
     * the host's clock leads.
     */
    int32_t rate_ppb;
    /** Upper estimate of the differences between the slaves' clocks, in nanoseconds. */
    uint32_t synchrony_ns;
    /** 1 if phase_error_ns is known. */
    uint8_t has_phase_error;
    /** 1 if synchrony_ns is known. */
    uint8_t has_synchrony;
    /** 1 if the mean phase error is below 0.2 % of the cycle. */
    uint8_t is_locked;
    /** Zero. */
    uint8_t padding;
    /**
     * Cycles since the first reading whose frame was lost, so that the reference clock could
     * not be read.
     */
    uint64_t missed_readings;
    /** Zero; for fields of later versions. */
    uint64_t reserved[3];
} ecan_igh_clock_status_t;

/**
 * Gets the differences between the distributed clocks.
 *
 * @usage   rt, the cycle's thread, active bus
 * @return  ECAN_OK; ECAN_ERR_ORDER without distributed clocks, before activation, and on an
 *          attached context, whose owner serves the clocks.
 */
int ecan_igh_get_clock_status(ecan_igh_context_t *context, ecan_igh_clock_status_t *status);

/**
 * Returns the correction that an application with its own cycle timer adds to its next deadline,
 * to follow the reference clock. ecan_igh_wait_next_cycle() includes it.
 *
 * @usage   rt, the cycle's thread, after receive
 * @return  Nanoseconds; 0 while the host's clock leads and if there is no context.
 */
int64_t ecan_igh_clock_correction_ns(ecan_igh_context_t *context);

/* ---------------------------------------------------------------------------
 * Raw process data (manual 15.5.3)
 *
 * With a Port on the context the RxPDO belongs to the Port: read it, but do not write to it.
 * --------------------------------------------------------------------------- */

/**
 * Gets the RxPDO of a slave, which the master sends to it: 128 * N continuous bytes to write the
 * next image into, with igh_mcan_pdo_writer_begin() for example.
 *
 * @param rxpdo       Gets the address. Valid until the context is reconfigured or ends.
 * @param rxpdo_size  Gets the bytes.
 *
 * @usage   rt, the cycle's thread, active bus
 * @return  ECAN_OK; ECAN_ERR_ORDER before the bus is active; ECAN_ERR_SLAVE.
 */
int ecan_igh_get_rxpdo_buffer(ecan_igh_context_t *context,
                              size_t slave,
                              uint8_t **rxpdo,
                              size_t *rxpdo_size);

/**
 * Gets the TxPDO of a slave as of the last receive: 128 * N continuous bytes, for
 * igh_mcan_pdo_parse_frames_ex() for example.
 *
 * @param txpdo       Gets the address. Valid until the context is reconfigured or ends; the
 *                    content changes with every receive.
 * @param txpdo_size  Gets the bytes.
 *
 * @usage   rt, the cycle's thread, active bus
 * @return  As ecan_igh_get_rxpdo_buffer().
 */
int ecan_igh_get_txpdo_buffer(ecan_igh_context_t *context,
                              size_t slave,
                              const uint8_t **txpdo,
                              size_t *txpdo_size);

/* ---------------------------------------------------------------------------
 * State of the bus and its slaves
 * --------------------------------------------------------------------------- */

/** AL state of a slave. */
typedef enum {
    /** INIT. */
    ECAN_IGH_AL_INIT = 1,
    /** PREOP. */
    ECAN_IGH_AL_PREOP = 2,
    /** SAFEOP. */
    ECAN_IGH_AL_SAFEOP = 4,
    /** OP. */
    ECAN_IGH_AL_OP = 8
} ecan_igh_al_state_t;

/** State of a slave as the master reports it. It lags the working counter by seconds. */
typedef struct {
    /** 1 if the slave was found. */
    uint8_t online;
    /** 1 if the slave reached OP with this configuration. */
    uint8_t operational;
    /** An ecan_igh_al_state_t. */
    uint8_t al_state;
    /** Zero; for fields of later versions. */
    uint8_t reserved[13];
} ecan_igh_slave_state_t;

/** State of the bus as the master reports it. */
typedef struct {
    /** Slaves that respond. */
    uint32_t slaves_responding;
    /** AL states that occur: bit 0 INIT, 1 PREOP, 2 SAFEOP, 3 OP. */
    uint8_t al_states;
    /** 1 if a link is up. */
    uint8_t link_up;
    /** Zero; for fields of later versions. */
    uint8_t reserved[26];
} ecan_igh_master_state_t;

/** Identity and state of a slave. */
typedef struct {
    /** Serial number of the gateway (0xF000:07 and :08). */
    uint64_t serial_number;
    /** Vendor ID as found on the bus. */
    uint32_t vendor_id;
    /** Product code as found on the bus. */
    uint32_t product_code;
    /** Revision as found on the bus. */
    uint32_t revision;
    /** Position on the bus. */
    uint16_t position;
    /** Station alias; 0 for none. */
    uint16_t alias;
    /** An ecan_igh_al_state_t, with bit 4 (0x10) for an error. */
    uint8_t al_state;
    /** 1 if the master found an error with the slave and keeps it in its state. */
    uint8_t error_flag;
    /** Zero. */
    uint8_t padding[6];
    /** Name; cut if it is too long. */
    char name[64];
    /** Zero; for fields of later versions. */
    uint64_t reserved[4];
} ecan_igh_slave_info_t;

/**
 * Returns the number of configured slaves.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  The number; 0 if there is no context.
 */
size_t ecan_igh_slave_count(ecan_igh_context_t *context);

/**
 * Returns 1 if all slaves are in OP and the last exchange was complete.
 *
 * @usage   rt, the cycle's thread, active bus
 * @return  1 or 0; 0 after an error, ECAN_ERR_MASTER for example, which ecan_last_error_code() gives.
 */
int ecan_igh_is_operational(ecan_igh_context_t *context);

/**
 * Gets the state of a slave.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_MASTER.
 */
int ecan_igh_get_slave_state(ecan_igh_context_t *context,
                             size_t slave,
                             ecan_igh_slave_state_t *state);

/**
 * Gets the state of the bus.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_MASTER.
 */
int ecan_igh_get_master_state(ecan_igh_context_t *context, ecan_igh_master_state_t *state);

/**
 * Gets identity and state of a slave.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_MASTER.
 */
int ecan_igh_get_slave_info(ecan_igh_context_t *context, size_t slave, ecan_igh_slave_info_t *info);

/* ---------------------------------------------------------------------------
 * SDO transfers that wait
 * --------------------------------------------------------------------------- */

/**
 * Reads an object of a slave and waits for it. On an active bus the call runs the cycle and drops
 * received frames. In the cycle use ecan_igh_sdo_request_read().
 *
 * @param data    Gets the value, little endian.
 * @param size    Bytes of the buffer.
 * @param length  Gets the bytes of the value.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_SDO, with ecan_last_abort_code() if the slave aborted;
 *          ECAN_ERR_BUFFER for a value that does not fit; ECAN_ERR_SLAVE, ECAN_ERR_MASTER;
 *          ECAN_ERR_ATTACHED on an active bus of another owner: use
 *          ecan_igh_diagnostics_sdo_upload() in another thread.
 */
ECAN_MUST_CHECK
int ecan_igh_sdo_upload(ecan_igh_context_t *context,
                        size_t slave,
                        uint16_t index,
                        uint8_t subindex,
                        void *data,
                        size_t size,
                        size_t *length);

/**
 * Writes an object of a slave and waits for it; as ecan_igh_sdo_upload().
 *
 * @param data  The value, little endian.
 * @param size  Its bytes.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  As ecan_igh_sdo_upload().
 */
ECAN_MUST_CHECK
int ecan_igh_sdo_download(ecan_igh_context_t *context,
                          size_t slave,
                          uint16_t index,
                          uint8_t subindex,
                          const void *data,
                          size_t size);

/* ---------------------------------------------------------------------------
 * SDO requests in the cycle
 *
 * Created before the bus is active, used in the cycle: start a transfer, read its state in later
 * cycles, take the value. A transfer takes some tens of cycles.
 * --------------------------------------------------------------------------- */

/** State of an SDO request. */
typedef enum {
    /** The request was not used yet. */
    ECAN_IGH_REQUEST_UNUSED = 0,
    /** In progress. */
    ECAN_IGH_REQUEST_RUNNING = 1,
    /** Done. */
    ECAN_IGH_REQUEST_SUCCESS = 2,
    /** Aborted by the slave, or timed out; the kernel log says which. */
    ECAN_IGH_REQUEST_ERROR = 3
} ecan_igh_request_state_t;

/**
 * Creates an SDO request. A reconfiguration ends all requests.
 *
 * @param size     Bytes of the values to write, or most bytes of the values to read.
 * @param request  Gets the number of the request.
 *
 * @usage   not rt, the cycle's thread, after init and before the bus is active
 * @return  ECAN_OK; ECAN_ERR_ORDER on an active bus; ECAN_ERR_SLAVE, ECAN_ERR_ARGUMENT,
 *          ECAN_ERR_MASTER.
 */
ECAN_MUST_CHECK
int ecan_igh_create_sdo_request(ecan_igh_context_t *context,
                                size_t slave,
                                size_t size,
                                size_t *request);

/**
 * Sets the timeout for transfers of the request.
 *
 * @param timeout_ms  Milliseconds; 0 for the master's own.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_ARGUMENT, ECAN_ERR_MASTER.
 */
int ecan_igh_sdo_request_timeout(ecan_igh_context_t *context, size_t request, uint32_t timeout_ms);

/**
 * Starts reading an object.
 *
 * @usage   rt, the cycle's thread, active bus
 * @return  ECAN_OK; ECAN_ERR_ORDER while a transfer of the request is in progress;
 *          ECAN_ERR_ARGUMENT, ECAN_ERR_MASTER.
 */
ECAN_MUST_CHECK
int ecan_igh_sdo_request_read(ecan_igh_context_t *context,
                              size_t request,
                              uint16_t index,
                              uint8_t subindex);

/**
 * Starts writing an object. The EtherCAT library takes the length of a value from what the request
 * holds, so use one request for each size, and another one for reading.
 *
 * @param data  The value, little endian. Is copied.
 * @param size  Its bytes: the size with which the request was created, or the size of the value
 *              that it read last.
 *
 * @usage   rt, the cycle's thread, active bus
 * @return  As ecan_igh_sdo_request_read(); ECAN_ERR_BUFFER for another number of bytes.
 */
ECAN_MUST_CHECK
int ecan_igh_sdo_request_write(ecan_igh_context_t *context,
                               size_t request,
                               uint16_t index,
                               uint8_t subindex,
                               const void *data,
                               size_t size);

/**
 * Returns the state of a request.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  An ecan_igh_request_state_t; ECAN_ERR_ARGUMENT, ECAN_ERR_MASTER.
 */
int ecan_igh_sdo_request_state(ecan_igh_context_t *context, size_t request);

/**
 * Takes the value of a finished read.
 *
 * @param data    Gets the value, little endian.
 * @param size    Bytes of the buffer.
 * @param length  Gets the bytes of the value.
 *
 * @usage   rt, the cycle's thread, active bus
 * @return  ECAN_OK; ECAN_ERR_BUFFER with what fits stored; ECAN_ERR_ORDER if the state is not
 *          success; ECAN_ERR_ARGUMENT, ECAN_ERR_MASTER.
 */
ECAN_MUST_CHECK
int ecan_igh_sdo_request_data(ecan_igh_context_t *context,
                              size_t request,
                              void *data,
                              size_t size,
                              size_t *length);

/* ---------------------------------------------------------------------------
 * Diagnosis from another thread
 *
 * A second, unreserved handle on the master: a thread of lower priority reads states and objects
 * while the cycle runs. Each handle belongs to one thread at a time.
 * --------------------------------------------------------------------------- */

/** A handle for diagnosis. Do not move or copy it. It may outlive the context. */
typedef struct {
    /** Not for the application. */
    uint64_t opaque[4];
} ecan_igh_diagnostics_t;

/**
 * Opens a handle for diagnosis.
 *
 * @param diagnostics  Any content.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_ORDER for a handle that is open; ECAN_ERR_MASTER.
 */
ECAN_MUST_CHECK
int ecan_igh_diagnostics_open(ecan_igh_diagnostics_t *diagnostics,
                              ecan_igh_context_t *context);

/**
 * Reads an object of a slave and waits for it; arguments as of ecan_igh_sdo_upload().
 *
 * @usage   not rt, the handle's thread, after open
 * @return  ECAN_OK; ECAN_ERR_SDO, with ecan_last_abort_code() if the slave aborted;
 *          ECAN_ERR_BUFFER for a value that does not fit; ECAN_ERR_SLAVE, ECAN_ERR_MASTER.
 */
ECAN_MUST_CHECK
int ecan_igh_diagnostics_sdo_upload(ecan_igh_diagnostics_t *diagnostics,
                                    size_t slave,
                                    uint16_t index,
                                    uint8_t subindex,
                                    void *data,
                                    size_t size,
                                    size_t *length);

/**
 * Writes an object of a slave and waits for it; arguments as of ecan_igh_sdo_download().
 *
 * @usage   not rt, the handle's thread, after open
 * @return  As ecan_igh_diagnostics_sdo_upload().
 */
ECAN_MUST_CHECK
int ecan_igh_diagnostics_sdo_download(ecan_igh_diagnostics_t *diagnostics,
                                      size_t slave,
                                      uint16_t index,
                                      uint8_t subindex,
                                      const void *data,
                                      size_t size);

/**
 * Gets the state of the bus.
 *
 * @usage   not rt, the handle's thread, after open
 * @return  ECAN_OK, ECAN_ERR_MASTER.
 */
int ecan_igh_diagnostics_master_state(ecan_igh_diagnostics_t *diagnostics,
                                      ecan_igh_master_state_t *state);

/**
 * Closes a handle.
 *
 * @usage   not rt, the handle's thread, any time
 * @return  ECAN_OK, also for a handle that is closed already.
 *          Also for a copy of it, which ends nothing.
 */
int ecan_igh_diagnostics_deinit(ecan_igh_diagnostics_t *diagnostics);

#ifdef __cplusplus
}
#endif

#endif /* IGH_ADAPTER_H */
