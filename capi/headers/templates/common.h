/**
 * ECAN-Lite host SDK: what all headers share (manual 15.1).
 *
 * Layers, from the bottom to the top; each header includes those that it builds on:
 *
 *     igh_ecan_common.h         return values, the last error, constants
 *     igh_mcan_pdo.h            process data protocol, without an EtherCAT master
 *     igh_adapter.h             EtherCAT master: slaves, PDOs, startup SDOs, Sync0, raw process data
 *     igh_mcan_port.h           CAN and CAN FD frames through the gateways
 *     igh_cia402_protocol.h     CANopen and CiA 402 axes
 *
 * Rules for all functions
 *
 *   - Return: ECAN_OK (0) or a negative ecan_result_t, but for functions that say otherwise.
 *     ecan_last_error() tells the particulars in words.
 *   - Pointers: NULL is refused with ECAN_ERR_NULL where it is not expressly allowed. Any other
 *     pointer must be valid for what the function does with it.
 *   - Contexts (ecan_igh_context_t, igh_mcan_port_t, igh_cia402_context_t, ecan_igh_diagnostics_t)
 *     need no preparation before their init function and stay where they are; ending one twice
 *     does no harm. Configurations, frames and the like are plain data.
 *   - @usage says three things about every function:
 *       "rt" or "not rt": whether it may be called in the real-time cycle. A function that is rt
 *           allocates nothing, takes no lock of the SDK's and calls the system only as far as the
 *           master does. Errors are put into words without allocation, too.
 *       which thread: "any thread"; or the one that the object belongs to, which may change as long
 *           as there is only one at a time. A call during another one gets ECAN_ERR_BUSY.
 *       when: before or after which other function.
 *
 * Change log of all headers
 *
 *   0.1.0  First version.
 */
#ifndef @GUARD@
#define @GUARD@

#include <stddef.h>
#include <stdint.h>

/** Version of this header; ecan_version() is that of the library. */
#define ECAN_VERSION_MAJOR @MAJOR@
#define ECAN_VERSION_MINOR @MINOR@
#define ECAN_VERSION_PATCH @PATCH@
#define ECAN_VERSION (ECAN_VERSION_MAJOR * 10000 + ECAN_VERSION_MINOR * 100 + ECAN_VERSION_PATCH)

/** What this version has; to be tested with #ifdef. */
#define ECAN_HAVE_ATTACH 1          /* ecan_igh_attach() */
#define ECAN_HAVE_SDO_REQUESTS 1    /* ecan_igh_create_sdo_request() */
#define ECAN_HAVE_SCHEDULED_TX 1    /* igh_mcan_port_schedule_can() */
#define ECAN_HAVE_TX_RESULT 1       /* igh_mcan_port_get_last_ticket() */
#define ECAN_HAVE_CONFIG_FILE 1     /* igh_mcan_port_load_config() */
#define ECAN_HAVE_SIMULATOR 1       /* the setting "sim" of ecan_igh_config_set_ecrt() */

#ifdef __cplusplus
extern "C" {
#endif

@SECTIONS@
#ifdef __cplusplus
}
#endif

#endif /* @GUARD@ */
