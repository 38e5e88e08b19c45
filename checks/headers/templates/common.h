@LICENSE@/**
 * ECAN-Lite host SDK: common part of all headers (manual 15.1).
 *
 * Layers, from the bottom to the top; each header includes the headers of the layers below:
 *
 *     igh_ecan_common.h         return values, the last error, constants
 *     igh_mcan_pdo.h            process data protocol, without an EtherCAT master
 *     igh_adapter.h             EtherCAT master: slaves, PDOs, startup SDOs, Sync0, raw process data
 *     igh_mcan_port.h           CAN and CAN FD frames through the gateways
 *     igh_cia402_protocol.h     CANopen and CiA 402 axes
 *     igh_canopen.h             CANopen networks: nodes from a file, boot-up, services of nodes
 *
 * Separate from the layers, included by none of them:
 *
 *     igh_real_time.h           real-time thread, timing of the cycles
 *     igh_plan.h                load of a configuration, before the first run
 *     igh_observer.h            snapshots of the cycle and commands for other threads
 *     igh_sim.h                 scenario, clock and seed of a simulated bus
 *
 * Rules for all functions
 *
 *   - Return: ECAN_OK (0) or a negative ecan_result_t, unless stated otherwise. ecan_last_error()
 *     describes an error. These codes are not repeated at each function:
 *       ECAN_ERR_NULL: a pointer that must not be NULL is NULL.
 *       ECAN_ERR_NOT_INITIALISED: a context, configuration or writer is not initialised.
 *       ECAN_ERR_BUSY: another call uses the context.
 *       ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL, ECAN_ERR_AXIS: an index is not configured. Functions
 *           without @return have no other errors.
 *   - Pointers: must not be NULL unless stated otherwise, and must be valid for the access of the
 *     function.
 *   - Contexts (ecan_igh_context_t, igh_mcan_port_t, igh_cia402_context_t, ecan_igh_diagnostics_t)
 *     need no preparation before their init function and must not be moved; a second deinit is
 *     harmless. Configurations, frames and similar structs are plain data.
 *   - Texts: functions with (char *text, size_t size, size_t *needed) store a text in UTF-8 that ends
 *     with NUL. One that does not fit is cut between characters, and the function returns
 *     ECAN_ERR_BUFFER. `needed` gets the bytes of the whole text, NUL included; it may be NULL. With
 *     text NULL and size 0 only `needed` is stored. After any other error the text is empty.
 *   - Predicates (is_, has_, _is_, all_) return 1 or 0. After an error they return 0 and set
 *     ecan_last_error_code(); call ecan_clear_last_error() first to see whether it is theirs.
 *   - Memory: if the system has none left, the library ends the process (abort). Only functions
 *     that are not rt allocate.
 *   - Callbacks of the application must return: a C++ exception that leaves one ends the process
 *     (abort) with a message on standard error, and longjmp() out of one is not allowed.
 *   - @usage gives three properties of every function:
 *       "rt" or "not rt": may be called in the real-time cycle, or not. An rt function allocates
 *           nothing, takes no lock of the SDK and makes no system calls except those of the
 *           master. Error texts need no allocation either.
 *       thread: "any thread"; or the cycle's thread, which may change between two cycles: a cycle
 *           lasts from ecan_igh_wait_next_cycle() or igh_mcan_port_wait_next_cycle() to
 *           ecan_igh_send() or igh_mcan_port_cycle_end(). This thread never gets ECAN_ERR_BUSY
 *           because of a call of another thread: it waits for that call, which inherits its
 *           priority. Other threads get ECAN_ERR_BUSY while a call is in progress or an image is
 *           open (igh_mcan_port_cycle_begin() to _end()), and during the whole cycle for functions
 *           that are not rt or run a cycle. Two threads must not run cycles at the same time.
 *       time: before or after which other function.
 *
 * Change log
 *
@CHANGES@ */
#ifndef @GUARD@
#define @GUARD@

#include <stddef.h>
#include <stdint.h>

/** Version of this header; ecan_version() is that of the library. */
#define ECAN_VERSION_MAJOR @MAJOR@
#define ECAN_VERSION_MINOR @MINOR@
#define ECAN_VERSION_PATCH @PATCH@
#define ECAN_VERSION (ECAN_VERSION_MAJOR * 10000 + ECAN_VERSION_MINOR * 100 + ECAN_VERSION_PATCH)

/** Features of this version, for #ifdef. */
#define ECAN_HAVE_ATTACH 1          /* ecan_igh_attach() */
#define ECAN_HAVE_SDO_REQUESTS 1    /* ecan_igh_create_sdo_request() */
#define ECAN_HAVE_SCHEDULED_TX 1    /* igh_mcan_port_schedule_can() */
#define ECAN_HAVE_TX_RESULT 1       /* igh_mcan_port_get_last_ticket() */
#define ECAN_HAVE_CONFIG_FILE 1     /* igh_mcan_port_load_config() */
#define ECAN_HAVE_SIMULATOR 1       /* the setting "sim" of ecan_igh_config_set_ecrt() */

/**
 * Marks functions whose result must be used: a program that continues after their error does
 * not do what its author expects. Define it empty before the first header to have no warnings.
 */
#ifndef ECAN_MUST_CHECK
#ifdef __GNUC__
#define ECAN_MUST_CHECK __attribute__((warn_unused_result))
#else
#define ECAN_MUST_CHECK
#endif
#endif

#ifdef __cplusplus
extern "C" {
#endif

@SECTIONS@
#ifdef __cplusplus
}
#endif

#endif /* @GUARD@ */
