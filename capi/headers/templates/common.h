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
 *       thread: "any thread"; or the cycle's thread, which may change between two cycles. It never
 *           gets ECAN_ERR_BUSY because of another thread: it waits for an rt function there, which
 *           inherits its priority. Another thread gets ECAN_ERR_BUSY while a call is in progress
 *           or a cycle is open, and for functions that are not rt also while the cycle's thread
 *           sleeps in ecan_igh_wait_next_cycle() or igh_mcan_port_wait_next_cycle().
 *       time: before or after which other function.
 *
 * Change log of all headers
 *
 *   0.2.0  Renamed: ecan_result_words to ecan_result_text, ecan_igh_answer_ns to
 *          ecan_igh_response_ns, igh_cia402_trouble_t to igh_cia402_axis_error_t,
 *          igh_mcan_frame_way_t to igh_mcan_frame_route_t, igh_cia402_refusal_t to
 *          igh_cia402_rejection_t, with their values; IGH_CIA402_DECISION_REFUSED to _REJECTED,
 *          IGH_CIA402_WAIT_IMAGE_HELD to _IMAGE_UNCONFIRMED, _WAIT_FRAME_REFUSED to
 *          _FRAME_REJECTED, IGH_CIA402_TROUBLE_RESET_REFUSED to IGH_CIA402_AXIS_ERROR_RESET_FAILED,
 *          IGH_CANOPEN_HEARTBEAT_UNWATCHED to _UNCONFIGURED. Fields: refused* to rejected*,
 *          targets_refused to targets_rejected, trouble to axis_error, auto_take_up to auto_resume,
 *          take_ups to activations, is_holding to is_unconfirmed, way to route,
 *          refuse_without_margin to reject_without_margin, give_up_missed to discard_missed.
 *          Added: IGH_CIA402_WAIT_NOT_DUE, _WAIT_NOT_RECEIVED, _WAIT_BACKLOG.
 *          igh_cia402_set_motion_div() is rejected while an axis is configured.
 *          Added: igh_cia402_get_host_loss(), igh_cia402_get_host_loss_text(), the fields shutdown,
 *          disable_operation, halt and fault_reaction of igh_cia402_axis_t.
 *          IGH_CIA402_PHASE_QUICK_STOP and _PHASE_DISABLING to _PHASE_STOPPING and _PHASE_STOPPED.
 *          New: igh_cia402_stop_all(), igh_cia402_stop_all_timeout(), igh_cia402_all_stopped(),
 *          igh_cia402_recover(), igh_cia402_recover_all(), igh_cia402_recover_all_timeout(), the
 *          phases UNCONTROLLED and INSPECTING, igh_cia402_stop_cause_t, `takeover` of the settings,
 *          the fields stop_cause, is_stopped, is_recovering and uncontrolled.
 *          igh_cia402_all_running() and is_running are 0 for halted axes.
 *          Removed: IGH_CIA402_HOLD_MOVING. Cycle, receive and send functions return ECAN_ERR_ORDER
 *          if no cycle is open. A configuration file with too many gateways or filters is
 *          ECAN_ERR_CONFIG.
 *          Added: ecan_igh_config_set_dc_sync0_planned(), ecan_igh_config_get_dc_margin().
 *          Added: igh_cia402_stop_together, IGH_CIA402_WAIT_TOGETHER, limits in rad/s in
 *          igh_cia402_axis_t.
 *          Added: ecan_igh_retry_startup().
 *          Added: igh_mcan_port_set_direction_masks(), igh_mcan_port_get_direction_masks(),
 *          igh_mcan_port_get_schedule_fault(), igh_mcan_schedule_fault_t, the field depth of
 *          igh_mcan_schedule_settings_t.
 *          Added at the end: txpdo_discarded, txpdo_unknown and startup_requests of
 *          igh_mcan_statistics_t; frames_accepted, frames_lost, frames_unknown, frames_pending,
 *          frames_confirmed and frames_not_taken of igh_mcan_channel_statistics_t. frames_delivered
 *          counts frames that a gateway in OP took; frames_discarded only those that were not
 *          published; sessions_lost no losses during a verification.
 *          ecan_igh_init() writes nothing to the slaves; a startup SDO that is aborted is reported by
 *          ecan_igh_wait_op_timeout(), with ecan_last_abort_code().
 *          A call of another thread succeeds while the cycle sleeps; the cycle's thread never gets
 *          ECAN_ERR_BUSY because of it. An open cycle belongs to the thread that began it. The init
 *          functions end an object whose context was overwritten.
 *          Predicates return 0 after an error, no longer its code: ecan_igh_domain_is_complete(),
 *          ecan_igh_is_operational(), ecan_igh_is_simulated(), ecan_igh_clock_is_stepped(),
 *          igh_mcan_port_is_ready(), igh_cia402_all_running(), igh_cia402_all_stopped(),
 *          igh_cia402_shutdown_is_done().
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

/** Features of this version, for #ifdef. */
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
