/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/**
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
 *   0.2.0  Renamed: ecan_result_words to ecan_result_text.
 *          A call of another thread succeeds while the cycle sleeps; the cycle's thread never gets
 *          ECAN_ERR_BUSY because of it. An open cycle belongs to the thread that began it. The init
 *          functions end an object whose context was overwritten.
 *          Predicates return 0 after an error, no longer its code.
 *          The functions of this header are in libecan_mcan_host, which libecan_igh_host needs.
 *          Functions with a text have the argument `needed`, and return ECAN_ERR_BUFFER for a text that
 *          was cut. Added: ECAN_ERR_LAYOUT.
 *          Added: ECAN_MUST_CHECK, ECAN_ERR_NODE, ECAN_ERR_BOOT.
 *   0.1.0  First version.
 */
#ifndef IGH_ECAN_COMMON_H
#define IGH_ECAN_COMMON_H

#include <stddef.h>
#include <stdint.h>

/** Version of this header; ecan_version() is that of the library. */
#define ECAN_VERSION_MAJOR 0
#define ECAN_VERSION_MINOR 2
#define ECAN_VERSION_PATCH 0
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

/* ---------------------------------------------------------------------------
 * Return values
 * --------------------------------------------------------------------------- */

/**
 * Return value of the functions: 0, or one of these negative codes.
 *
 * ecan_last_error() gives the details: the slave, the object, the expected value.
 */
typedef enum {
    /** Done. */
    ECAN_OK = 0,
    /** A pointer that must not be NULL is NULL. */
    ECAN_ERR_NULL = -1,
    /** A value is out of range. */
    ECAN_ERR_ARGUMENT = -2,
    /** The object is not initialised, is deinitialised, or was moved or copied. */
    ECAN_ERR_NOT_INITIALISED = -3,
    /** The call does not fit the calls before it: wrong order. */
    ECAN_ERR_ORDER = -4,
    /** Another thread, or the caller of a callback, uses this object. */
    ECAN_ERR_BUSY = -5,
    /**
     * The buffer is too small; the necessary size is returned if the function has a parameter
     * for it. A text is cut, and is valid.
     */
    ECAN_ERR_BUFFER = -6,
    /** A list of the configuration is full. */
    ECAN_ERR_FULL = -7,
    /** The configuration has faults; ecan_last_error() names every one. */
    ECAN_ERR_CONFIG = -8,
    /** The slave is not configured. */
    ECAN_ERR_SLAVE = -9,
    /** The channel does not exist or is not enabled. */
    ECAN_ERR_CHANNEL = -10,
    /** Not a CAN frame: CAN ID, length or flags. */
    ECAN_ERR_FRAME = -11,
    /** A CAN FD frame for a channel that is configured for classic CAN. */
    ECAN_ERR_NOT_FD = -12,
    /** The frame cannot be scheduled: no Sync0, no such capability, or beyond the period. */
    ECAN_ERR_SCHEDULE = -13,
    /** The image of this cycle is full; send again in a later cycle. */
    ECAN_ERR_NO_ROOM = -14,
    /** The gateway's transmit queue is full; send again in a later cycle. */
    ECAN_ERR_QUEUE_FULL = -15,
    /** The channel is bus-off. */
    ECAN_ERR_BUS_OFF = -16,
    /** The gateway is not ready: not in OP, or not verified yet. */
    ECAN_ERR_NOT_READY = -17,
    /** The image was being written while it was read; skip it in this cycle. */
    ECAN_ERR_IMAGE_BUSY = -18,
    /** The image, or the rest of it, cannot be parsed. */
    ECAN_ERR_PARSE = -19,
    /** The EtherCAT master library cannot be loaded, or its setting is wrong. */
    ECAN_ERR_ECRT = -20,
    /** The EtherCAT master cannot be opened, or a call of its library failed. */
    ECAN_ERR_MASTER = -21,
    /** A configured slave is not on the bus. */
    ECAN_ERR_NOT_FOUND = -22,
    /** The slave is not the configured one, or not an ECAN-Lite. */
    ECAN_ERR_IDENTITY = -23,
    /** An SDO transfer failed; ecan_last_abort_code() is the slave's reason. */
    ECAN_ERR_SDO = -24,
    /** The readback of an object differs from its configuration. */
    ECAN_ERR_READBACK = -25,
    /** A timeout expired. */
    ECAN_ERR_TIMEOUT = -26,
    /** A slave did not reach PREOP or OP. */
    ECAN_ERR_NOT_OPERATIONAL = -27,
    /** The verification of a gateway in OP failed: its readback differs from the configuration. */
    ECAN_ERR_VERIFICATION = -28,
    /** The context is attached: only the owner of the master may do this. */
    ECAN_ERR_ATTACHED = -29,
    /** The axis does not exist. */
    ECAN_ERR_AXIS = -30,
    /** The state or the mode of the axis does not allow this. */
    ECAN_ERR_AXIS_STATE = -31,
    /** One or more axes did not reach the requested state; ecan_last_error() names each. */
    ECAN_ERR_AXES = -32,
    /** A CANopen transfer or command failed. */
    ECAN_ERR_CANOPEN = -33,
    /** The application cancelled the wait (ecan_igh_stop_waiting_when()). */
    ECAN_ERR_STOPPED = -34,
    /**
     * The system denied a real-time request; ecan_last_error() gives the reason and what to
     * do.
     */
    ECAN_ERR_PRIVILEGE = -35,
    /**
     * A file or a scenario of the simulator cannot be used; ecan_last_error() names it, with the
     * reason.
     */
    ECAN_ERR_FILE = -36,
    /**
     * The image has another layout_id than the profile: the device's active profile differs. Its
     * frames are stored.
     */
    ECAN_ERR_LAYOUT = -37,
    /** The CANopen node is not in the network of the context. */
    ECAN_ERR_NODE = -38,
    /** One or more mandatory nodes are not booted; ecan_last_error() names each. */
    ECAN_ERR_BOOT = -39,
    /** An internal fault of the library. Please report it with the text of ecan_last_error(). */
    ECAN_ERR_INTERNAL = -99
} ecan_result_t;

/**
 * Returns the name of a code, as it is written in this header.
 *
 * @usage   rt, any thread, any time
 * @return  "ECAN_ERR_SDO" for example; "unknown result" for a value that is not a code. Static.
 */
const char *ecan_result_name(int code);

/**
 * Returns a short description of a code.
 *
 * @usage   rt, any thread, any time
 * @return  "an SDO transfer failed" for example. Static.
 */
const char *ecan_result_text(int code);

/**
 * Returns 1 for a code after which a frame may be sent again in a later cycle: the image or the
 * queue is full, the channel is bus-off, or the gateway is not ready.
 *
 * @usage   rt, any thread, any time
 * @return  1 or 0.
 */
int ecan_result_is_temporary(int code);

/* ---------------------------------------------------------------------------
 * The last error
 * --------------------------------------------------------------------------- */

/**
 * Returns the text of this thread's last error: the function, the slave, the object and the
 * reason.
 *
 * A successful call does not change it, like errno.
 *
 * @usage   rt, any thread, any time
 * @return  The text, in UTF-8; "" before the first error. Valid until the thread's next error, and
 *          not in another thread.
 */
const char *ecan_last_error(void);

/**
 * Returns the code of ecan_last_error().
 *
 * @usage   rt, any thread, any time
 * @return  A negative ecan_result_t; 0 before the first error.
 */
int ecan_last_error_code(void);

/**
 * Returns the abort code with which a slave or a CANopen node aborted the SDO transfer of the last
 * error.
 *
 * @usage   rt, any thread, any time
 * @return  0x06090030 for example; 0 if the last error was not an aborted transfer.
 */
uint32_t ecan_last_abort_code(void);

/**
 * Clears the last error of this thread.
 *
 * @usage   rt, any thread, any time
 */
void ecan_clear_last_error(void);

/* ---------------------------------------------------------------------------
 * Constants
 * --------------------------------------------------------------------------- */

/** Cycle for the first startup, in microseconds (manual 15.5.2). */
#define ECAN_DEFAULT_CYCLE_US 10000

/** PDO size for classic CAN and CANopen, in chunks of 128 bytes (manual 15.5.2). */
#define ECAN_DEFAULT_PDO_MULTIPLIER 3

/** PDO size for CAN FD, in chunks of 128 bytes (manual 15.5.2). */
#define ECAN_DEFAULT_FD_PDO_MULTIPLIER 8

/** Bytes of a PDO chunk (manual 5.1). */
#define ECAN_PDO_CHUNK_BYTES 128

/** Bytes of an image's header (manual 6). */
#define ECAN_PDO_HEADER_BYTES 24

/** Most chunks of a PDO (manual 5.2). */
#define ECAN_PDO_MAX_MULTIPLIER 24

/**
 * Most chunks that IgH 1.6.2 carries per direction: a sync manager never spans two datagrams of
 * at most 1486 bytes.
 */
#define ECAN_PDO_MAX_PLAIN_MULTIPLIER 11

/** Most packets of an image: its header counts them in a byte. */
#define ECAN_PDO_MAX_PACKETS 255

/** CAN channels of a gateway. */
#define ECAN_MCAN_CHANNELS 4

/** Most data bytes of a CAN FD frame. */
#define ECAN_CANFD_MAX_BYTES 64

/** The CAN channels of a gateway, by number. */
typedef enum {
    /** CAN0. */
    ECAN_MCAN0 = 0,
    /** CAN1. */
    ECAN_MCAN1 = 1,
    /** CAN2. */
    ECAN_MCAN2 = 2,
    /** CAN3. */
    ECAN_MCAN3 = 3
} ecan_mcan_channel_t;

/* ---------------------------------------------------------------------------
 * Version of the library
 * --------------------------------------------------------------------------- */

/**
 * Returns the version of the linked library: major * 10000 + minor * 100 + patch.
 *
 * Compare it with ECAN_VERSION, the version of the header.
 *
 * @usage   rt, any thread, any time
 * @return  200 for 0.2.0.
 */
int ecan_version(void);

/**
 * Returns the version of the linked library as text.
 *
 * @usage   rt, any thread, any time
 * @return  "0.2.0" for example. Static.
 */
const char *ecan_version_text(void);

#ifdef __cplusplus
}
#endif

#endif /* IGH_ECAN_COMMON_H */
