/**
 * ECAN-Lite host SDK: CANopen and CiA 402 (manual 15.1, 15.4, 15.5.4).
 *
 * Motors behind the gateways: start-up, targets, states, SDO.
 *
 * The rules for all functions, and the change log of all headers, stand at the head of
 * igh_ecan_common.h.
 */
#ifndef IGH_CIA402_PROTOCOL_H
#define IGH_CIA402_PROTOCOL_H

#include "igh_ecan_common.h"
#include "igh_mcan_port.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---------------------------------------------------------------------------
 * Numbers of CiA 301 and CiA 402
 * --------------------------------------------------------------------------- */

/** An NMT command. */
typedef enum {
    /** To Operational: process data run. */
    IGH_CANOPEN_NMT_START = 1,
    /** To Stopped: only NMT and heartbeat. */
    IGH_CANOPEN_NMT_STOP = 2,
    /** To Pre-operational: SDO, no process data. */
    IGH_CANOPEN_NMT_PRE_OPERATIONAL = 128,
    /** Restarts the node. */
    IGH_CANOPEN_NMT_RESET_NODE = 129,
    /** Restarts the node's communication, with parameters 0x1000.. as at power-on. */
    IGH_CANOPEN_NMT_RESET_COMMUNICATION = 130,
} igh_canopen_nmt_t;

/** The NMT state that a node reports. */
typedef enum {
    /** It has just booted. */
    IGH_CANOPEN_NMT_STATE_INITIALISING = 0,
    /** Stopped. */
    IGH_CANOPEN_NMT_STATE_STOPPED = 4,
    /** Operational. */
    IGH_CANOPEN_NMT_STATE_OPERATIONAL = 5,
    /** Pre-operational. */
    IGH_CANOPEN_NMT_STATE_PRE_OPERATIONAL = 127,
    /** Nothing was heard of it, or not since it was reset. */
    IGH_CANOPEN_NMT_STATE_UNKNOWN = 255,
} igh_canopen_nmt_state_t;

/** A mode of operation, as 0x6060 takes it. */
typedef enum {
    /** Profile position. Targets are steps; the drive makes its own way there. */
    IGH_CIA402_MODE_PP = 1,
    /** Profile velocity. Targets are velocities in the drive's unit. */
    IGH_CIA402_MODE_PV = 3,
    /** Profile torque. Targets are torques in the drive's unit. */
    IGH_CIA402_MODE_PT = 4,
    /** Homing; igh_cia402_home() enters and leaves it. */
    IGH_CIA402_MODE_HM = 6,
    /** Interpolated position; not driven by this library. */
    IGH_CIA402_MODE_IP = 7,
    /** Cyclic synchronous position. Targets are steps, one per cycle. */
    IGH_CIA402_MODE_CSP = 8,
    /** Cyclic synchronous velocity. */
    IGH_CIA402_MODE_CSV = 9,
    /** Cyclic synchronous torque. */
    IGH_CIA402_MODE_CST = 10,
} igh_cia402_mode_t;

/** State of a drive, by its statusword. */
typedef enum {
    /** No statusword came yet, or one that CiA 402 does not know. */
    IGH_CIA402_DRIVE_UNKNOWN = 0,
    /** Starting up. */
    IGH_CIA402_DRIVE_NOT_READY = 1,
    /** Power may not be switched on. */
    IGH_CIA402_DRIVE_SWITCH_ON_DISABLED = 2,
    /** Power may be switched on. */
    IGH_CIA402_DRIVE_READY_TO_SWITCH_ON = 3,
    /** Power is on, the motor is without torque. */
    IGH_CIA402_DRIVE_SWITCHED_ON = 4,
    /** The motor follows its targets. */
    IGH_CIA402_DRIVE_OPERATION_ENABLED = 5,
    /** A quick stop runs, or has ended with power on. */
    IGH_CIA402_DRIVE_QUICK_STOP_ACTIVE = 6,
    /** A fault was found, its reaction runs. */
    IGH_CIA402_DRIVE_FAULT_REACTION = 7,
    /** In fault, the motor is without torque. */
    IGH_CIA402_DRIVE_FAULT = 8,
} igh_cia402_drive_state_t;

/** How a node begins its configuration, in igh_cia402_axis_t.reset. */
typedef enum {
    /** It is told to go to Pre-operational. */
    IGH_CIA402_RESET_NONE = 0,
    /** Its communication is reset: parameters of 0x1000.. as at power-on. */
    IGH_CIA402_RESET_COMMUNICATION = 1,
    /** The whole node is reset. */
    IGH_CIA402_RESET_NODE = 2,
} igh_cia402_reset_t;

/** How a position counter runs, in igh_cia402_axis_t.range. */
typedef enum {
    /** It ends at the limits of an int32_t; nothing is commanded beyond them. */
    IGH_CIA402_RANGE_LINEAR = 0,
    /** It wraps over the whole int32_t. */
    IGH_CIA402_RANGE_WRAPPING = 1,
    /** It wraps within 0x607B: one step beyond range_max is range_min. */
    IGH_CIA402_RANGE_MODULO = 2,
} igh_cia402_range_t;

/**
 * What a drive does when the host's heartbeat stays away (0x6007), in
 * igh_cia402_axis_t.host_loss. A manufacturer may have further, negative ones.
 */
typedef enum {
    /** Nothing. */
    IGH_CIA402_HOST_LOSS_NONE = 0,
    /** It goes to fault. */
    IGH_CIA402_HOST_LOSS_FAULT = 1,
    /** It switches its power off. */
    IGH_CIA402_HOST_LOSS_DISABLE_VOLTAGE = 2,
    /** It makes a quick stop. */
    IGH_CIA402_HOST_LOSS_QUICK_STOP = 3,
} igh_cia402_host_loss_t;

/**
 * How a drive makes a quick stop (0x605A), in igh_cia402_axis_t.quick_stop. A manufacturer may
 * have further, negative ones.
 */
typedef enum {
    /** Switches its power off at once. */
    IGH_CIA402_QUICK_STOP_DISABLE = 0,
    /** Slows down by its ramp, then switches off. */
    IGH_CIA402_QUICK_STOP_SLOW_DOWN = 1,
    /** Slows down by its quick stop ramp, then switches off. */
    IGH_CIA402_QUICK_STOP_RAMP = 2,
    /** Slows down at the current limit, then switches off. */
    IGH_CIA402_QUICK_STOP_CURRENT_LIMIT = 3,
    /** Slows down at the voltage limit, then switches off. */
    IGH_CIA402_QUICK_STOP_VOLTAGE_LIMIT = 4,
    /** Slows down by its ramp and stays at rest with power on. */
    IGH_CIA402_QUICK_STOP_SLOW_DOWN_AND_STAY = 5,
    /** Slows down by its quick stop ramp and stays at rest with power on. */
    IGH_CIA402_QUICK_STOP_RAMP_AND_STAY = 6,
    /** Slows down at the current limit and stays at rest with power on. */
    IGH_CIA402_QUICK_STOP_CURRENT_LIMIT_AND_STAY = 7,
    /** Slows down at the voltage limit and stays at rest with power on. */
    IGH_CIA402_QUICK_STOP_VOLTAGE_LIMIT_AND_STAY = 8,
} igh_cia402_quick_stop_t;

/* ---------------------------------------------------------------------------
 * The axis table
 *
 * Plain data: a table may be copied and needs no end. igh_cia402_axis_init() fills every field
 * with what is right for most drives; change fields after it, before igh_cia402_context_init(),
 * which checks the table as a whole.
 *
 * igh_cia402_axis_t axes[2];
 * igh_cia402_axis_init(&axes[0], 0, 0, 1, 10);     slave 0, CAN0, node 1, 10 steps per cycle
 * igh_cia402_axis_init(&axes[1], 0, 0, 2, 10);
 * axes[1].steps_per_turn = 131072.0;
 * --------------------------------------------------------------------------- */

/** Leaves an option code of the drive as it is. */
#define IGH_CIA402_UNCHANGED 2147483647

/** Objects that can be written besides the drive's configuration. */
#define IGH_CIA402_MAX_FURTHER 16

/** An object that is written while a drive is configured. */
typedef struct {
    /** The value; of a signed object with its sign. */
    int64_t value;
    /** Index. */
    uint16_t index;
    /** Subindex. */
    uint8_t subindex;
    /** Bytes of the object: 1, 2, 4 or 8. */
    uint8_t size;
    /** 1 where the drive need not have it. */
    uint8_t is_optional;
    /** Not used. */
    uint8_t reserved[3];
} igh_cia402_object_t;

/**
 * One axis: a drive, how it is configured, and what its targets may be. Steps are those of the
 * drive's position counter; a cycle is one in which targets are sent.
 */
typedef struct {
    /** Not for the application: tells a filled axis from other bytes. */
    uint64_t seal;
    /** Slave index of the gateway. */
    uint16_t slave;
    /** Channel of the gateway, 0 to 3. */
    uint8_t channel;
    /** Node-ID of the drive, 1 to 127. */
    uint8_t node_id;
    /**
     * An igh_cia402_mode_t; it decides what the process data carry. Default
     * IGH_CIA402_MODE_CSP.
     */
    int8_t mode;
    /** Number of the RPDO and the TPDO that are used, 1 to 4. Default 1. */
    uint8_t pdo_number;
    /**
     * 1: the axis is taken up again by itself after it held while its drive stayed enabled, in CSP
     * only. Default 0: only igh_cia402_enable() does that. A drive that left Operation Enabled is
     * never enabled by itself.
     */
    uint8_t auto_take_up;
    /** An igh_cia402_range_t: how the position counter runs. Default IGH_CIA402_RANGE_LINEAR. */
    uint8_t range;
    /** Smallest position of IGH_CIA402_RANGE_MODULO, 0x607B:01. */
    int32_t range_min;
    /** Largest position of IGH_CIA402_RANGE_MODULO, 0x607B:02. */
    int32_t range_max;
    /** Step at which the angle is 0. Default 0. */
    int32_t origin;
    /**
     * Steps per turn of the axis, gear included; negative turns the direction around. For angles
     * only. Default 360, one step per degree.
     */
    double steps_per_turn;
    /** Step per cycle that igh_cia402_send_target_step() makes. */
    int32_t target_step;
    /**
     * Farthest that a target may be from the one before: steps, or units of velocity or torque.
     * Without meaning in PP, PV and PT. Default 1000, or the target step where that is larger.
     */
    uint32_t step_limit;
    /**
     * Farthest that a position target may be from the actual position, in steps; at least eight
     * step limits, since a moving axis lags by the way out and back. Default 0: what the step
     * limit needs, at least 10000.
     */
    uint32_t following_window;
    /**
     * How far apart two actual positions of an axis at rest may be, in steps: noise. An axis that
     * moves faster is not taken up. The step limit where that is smaller. Default 20.
     */
    uint32_t standstill;
    /**
     * How much the step may change per cycle while the host makes the way itself: target step,
     * halt, shutdown. Default 20.
     */
    uint32_t ramp;
    /** Smallest target, where has_bounds is 1; steps, or units of velocity or torque. */
    int32_t bound_min;
    /** Largest target, where has_bounds is 1. */
    int32_t bound_max;
    /** 1: targets beyond bound_min and bound_max are refused. Default 0. */
    uint8_t has_bounds;
    /**
     * 1: the bounds are written to 0x607D, too, in position modes and where the drive has it.
     * Default 0.
     */
    uint8_t write_position_limits;
    /** SYNC periods in a row without a usable TPDO that are put up with. Default 5. */
    uint16_t tpdo_timeout;
    /**
     * Cycles in a row with an incomplete working counter that are put up with; no target goes out
     * meanwhile. Default 3.
     */
    uint16_t wc_misses;
    /** Images that must be seen, at least, until targets of before count as gone. Default 3. */
    uint16_t drain_images;
    /** How long enabling may take, in milliseconds. Default 5000. */
    uint32_t enable_timeout_ms;
    /** How long the boot-up message may take after a reset, in milliseconds. Default 5000. */
    uint32_t boot_timeout_ms;
    /** An igh_cia402_reset_t. Default IGH_CIA402_RESET_NONE. */
    uint8_t reset;
    /** 1: the low half of 0x1000 must be 402. Default 1. */
    uint8_t expect_profile_402;
    /** 1: 0x1018 must name this vendor and product. Default 0. */
    uint8_t check_identity;
    /**
     * 1: TPDO 2 to 4 are switched off where the drive has them, so that nothing else takes bus
     * time. Default 1.
     */
    uint8_t silence_other_tpdos;
    /** 0x1018:01, where check_identity is 1. */
    uint32_t vendor_id;
    /** 0x1018:02, where check_identity is 1. */
    uint32_t product_code;
    /**
     * Heartbeat of the drive, 0x1017, in milliseconds; the host takes it for lost after three and
     * a half of them. 0 switches it off. Default 100.
     */
    uint16_t heartbeat_ms;
    /**
     * After which time the drive takes the host for lost, 0x1016:01, in milliseconds; 0 leaves the
     * object alone. Default 250.
     */
    uint16_t host_heartbeat_ms;
    /**
     * What the drive does then, 0x6007: an igh_cia402_host_loss_t, or IGH_CIA402_UNCHANGED.
     * Default IGH_CIA402_HOST_LOSS_QUICK_STOP.
     */
    int32_t host_loss;
    /**
     * How it makes a quick stop, 0x605A: an igh_cia402_quick_stop_t, or IGH_CIA402_UNCHANGED.
     * Default IGH_CIA402_UNCHANGED.
     */
    int32_t quick_stop;
    /**
     * Following error window of the drive, 0x6065, in steps, where write_following_error is 1.
     * Should not be below following_window.
     */
    uint32_t following_error_window;
    /** Its time, 0x6066, in milliseconds. */
    uint16_t following_error_ms;
    /** 1: both are written where the drive has them. Default 0. */
    uint8_t write_following_error;
    /** How many of `further` there are. Default 0. */
    uint8_t further_count;
    /** Objects that are written besides, after the mapping and while Pre-operational. */
    igh_cia402_object_t further[IGH_CIA402_MAX_FURTHER];
    /** Not used. */
    uint64_t reserved[4];
} igh_cia402_axis_t;

/**
 * Fills an axis: CSP, with limits that let its target step pass.
 *
 * @param axis         Is overwritten, whatever it holds.
 * @param slave        Slave index of the gateway.
 * @param channel      Channel of the gateway, 0 to 3.
 * @param node_id      Node-ID of the drive, 1 to 127.
 * @param target_step  Steps per cycle that igh_cia402_send_target_step() makes; 0 for none.
 *
 * @usage   not rt, any thread, any time
 * @return  ECAN_OK; ECAN_ERR_NULL; ECAN_ERR_ARGUMENT, with nothing filled, for a node-ID, channel
 *          or slave that cannot be.
 */
int igh_cia402_axis_init(igh_cia402_axis_t *axis,
                         size_t slave,
                         uint8_t channel,
                         uint8_t node_id,
                         int32_t target_step);

/* ---------------------------------------------------------------------------
 * Settings of all axes together
 * --------------------------------------------------------------------------- */

/**
 * What the axes of a context have in common. igh_cia402_default_settings() fills it; change fields
 * after it. Plain data: it may be copied and needs no end.
 */
typedef struct {
    /** Not for the application: tells filled settings from other bytes. */
    uint64_t seal;
    /** Cycles from target to target (--motion-div); 0 counts as 1. Default 1. */
    uint32_t motion_div;
    /** Cycles from SYNC to SYNC; 0 counts as 1. Default 1. */
    uint32_t sync_every_cycles;
    /**
     * Heartbeat of the host, in milliseconds; 0 sends none, and no drive notices then that the
     * host died. Default 50.
     */
    uint32_t host_heartbeat_ms;
    /** Node-ID of the host in it, which no drive may have. Default 127. */
    uint8_t host_node_id;
    /**
     * SYNC with a counter from 1 to this value, 2 to 240, as in the drives' 0x1019; 0 sends SYNC
     * without data. Default 0.
     */
    uint8_t sync_counter_overflow;
    /** SDO frames and NMT commands per cycle and channel, at most. Default 2. */
    uint8_t service_frames_per_cycle;
    /**
     * SDO frames wait while the gateway has so many frames of the channel to send, at most 7.
     * Default 7.
     */
    uint8_t sdo_pending_limit;
    /**
     * Bytes of each RxPDO image that SDO frames leave free for frames that the application sends
     * after the targets. Default 0.
     */
    uint32_t reserved_image_bytes;
    /** NMT commands that can wait for a channel. Default 32. */
    uint32_t nmt_queue;
    /** How long an answer to an SDO request may take, in milliseconds. Default 500. */
    uint32_t sdo_timeout_ms;
    /** Longest value of an SDO transfer, in bytes. Default 1024. */
    uint32_t sdo_buffer_bytes;
    /** Downloads of at least so many bytes try block transfer; 0 never does. Default 64. */
    uint32_t sdo_block_from;
    /** How often an SDO transfer starts over without an answer. Default 2. */
    uint8_t sdo_retries;
    /** 1: uploads ask for block transfer. Default 0. */
    uint8_t sdo_block_upload;
    /** Segments in a row of a block upload, 1 to 127. Default 16. */
    uint8_t sdo_block_segments;
    /** Not used. */
    uint8_t reserved_bytes[5];
    /** Not used. */
    uint64_t reserved[4];
} igh_cia402_settings_t;

/**
 * Fills settings: targets and SYNC in every cycle, a heartbeat of the host every 50 ms.
 *
 * @param settings  Is overwritten, whatever it holds.
 *
 * @usage   not rt, any thread, any time
 * @return  ECAN_OK or ECAN_ERR_NULL.
 */
int igh_cia402_default_settings(igh_cia402_settings_t *settings);

/* ---------------------------------------------------------------------------
 * Preflight plan of axes
 * --------------------------------------------------------------------------- */

/**
 * Plans configurations for the process data of axes: targets, TPDOs and SYNC. As
 * igh_mcan_port_plan().
 *
 * @param motion_div  Cycles from target to target; 0 counts as 1.
 *
 * @usage   not rt, any thread, any time
 * @return  As igh_mcan_port_plan(); ECAN_ERR_NOT_INITIALISED also for an axis that is not filled,
 *          ECAN_ERR_CONFIG also for one with a value that cannot be.
 */
int igh_cia402_plan(const ecan_igh_config_t *igh_config,
                    const igh_mcan_port_config_t *config,
                    const igh_cia402_axis_t *axes,
                    size_t axis_count,
                    uint32_t motion_div,
                    char *text,
                    size_t size);

/* ---------------------------------------------------------------------------
 * Life of the axes
 *
 * igh_cia402_context_init(&motors, &mcan, axes, 2);
 * igh_cia402_send_nmt_all(&motors, IGH_CANOPEN_NMT_START);
 * igh_cia402_configure_csp_all_timeout(&motors, 10000);
 * igh_cia402_request_actual_position_all_timeout(&motors, 2000);
 * igh_cia402_enable_all_timeout(&motors, 5000);
 * ...                                              the cycle
 * igh_cia402_shutdown_timeout(&motors, 5000);
 * igh_cia402_context_deinit(&motors);
 * --------------------------------------------------------------------------- */

/**
 * CiA 402 axes behind the gateways of a Port. Belongs to the thread of the cycle and stays where
 * it is: a copy names nothing. Ends with its igh_mcan_port_t at the latest.
 */
typedef struct {
    /** Not for the application. */
    uint64_t opaque[4];
} igh_cia402_context_t;

/**
 * Puts axes on a Port, with default settings. Nothing is sent; SYNC and the host's heartbeat begin
 * with the first cycle.
 *
 * @param context     Whatever it holds; the manual's fragments leave it uninitialised.
 * @param port        The Port. Must stay where it is as long as the axes are used.
 * @param axes        The axis table. Is copied.
 * @param axis_count  Its length.
 *
 * @usage   not rt, the cycle's thread, after igh_mcan_port_init
 * @return  ECAN_OK; ECAN_ERR_CONFIG with every fault of the table; ECAN_ERR_SLAVE,
 *          ECAN_ERR_CHANNEL for what the Port does not have; ECAN_ERR_NOT_INITIALISED for a Port,
 *          or an axis that is not filled; ECAN_ERR_ORDER for a context that lives, or a Port that
 *          has axes; ECAN_ERR_NULL, ECAN_ERR_BUSY.
 */
int igh_cia402_context_init(igh_cia402_context_t *context,
                            igh_mcan_port_t *port,
                            const igh_cia402_axis_t *axes,
                            size_t axis_count);

/**
 * As igh_cia402_context_init(), with settings of the application's own.
 *
 * @param settings  Is copied.
 *
 * @usage   not rt, the cycle's thread, after igh_mcan_port_init
 * @return  As igh_cia402_context_init().
 */
int igh_cia402_context_init_ex(igh_cia402_context_t *context,
                               igh_mcan_port_t *port,
                               const igh_cia402_axis_t *axes,
                               size_t axis_count,
                               const igh_cia402_settings_t *settings);

/**
 * Takes the axes off the Port, which goes on. The drives are not told anything, and notice that
 * the host's heartbeat has ended: igh_cia402_shutdown_timeout() first leaves them in order.
 *
 * @usage   not rt, the cycle's thread, any time
 * @return  ECAN_OK, also for axes that ended already or never were; ECAN_ERR_NULL, ECAN_ERR_BUSY.
 */
int igh_cia402_context_deinit(igh_cia402_context_t *context);

/**
 * Number of axes.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  The number; 0 where there is no context.
 */
size_t igh_cia402_axis_count(igh_cia402_context_t *context);

/* ---------------------------------------------------------------------------
 * Progress of the calls that wait
 * --------------------------------------------------------------------------- */

/**
 * Sets a function that the waiting calls tell what the axes are doing: at their start, and
 * whenever that changes. It runs inside these calls, between two cycles, so it should be quick; a
 * call to the library with this context gets ECAN_ERR_BUSY there.
 *
 * @param callback  Gets `user`, the axis, and the words, "axis 0, node 1 (slave 0, channel 0):
 *                  being enabled, switched on, for 120 ms" for example, which are valid until it
 *                  returns; NULL for none.
 * @param user      Is handed to it, in the thread that waits.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_cia402_set_progress_callback(igh_cia402_context_t *context,
                                     void (*callback)(void *user, size_t axis, const char *text),
                                     void *user);

/* ---------------------------------------------------------------------------
 * Start-up and shutdown that wait
 *
 * These calls run the cycle themselves, with all axes at their last targets, until every axis is
 * where it is to be or cannot get there: so not on a master of another owner, and not in a loop
 * that has other work. There the calls of the next section begin the same, and
 * igh_cia402_get_axis_state() tells how far it is.
 * --------------------------------------------------------------------------- */

/**
 * Configures every drive in the mode of its axis, which is CSP where the axis table does not say
 * otherwise, and waits: NMT, identity, heartbeats, PDO mapping, limits, Operational, mode with
 * confirmation. Drives that are configured already are left alone. An enabled drive is switched
 * off first.
 *
 * @param timeout_ms  Milliseconds.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  ECAN_OK; ECAN_ERR_AXES, where ecan_last_error() names each axis that is not configured,
 *          the step at which it stands and what its drive answered; ECAN_ERR_ATTACHED on a master
 *          of another owner; ECAN_ERR_ORDER where the bus is not active; ECAN_ERR_AXIS_STATE,
 *          ECAN_ERR_MASTER, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_cia402_configure_csp_all_timeout(igh_cia402_context_t *context, uint32_t timeout_ms);

/**
 * Establishes where all axes are, from fresh TPDOs that show them at rest, and waits. An axis that
 * is not configured is refused.
 *
 * @param timeout_ms  Milliseconds.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes whose position
 *          is not known, and what hinders it.
 */
int igh_cia402_request_actual_position_all_timeout(igh_cia402_context_t *context,
                                                   uint32_t timeout_ms);

/**
 * Enables all drives and waits until every axis follows targets. The first target of each is the
 * actual position just read.
 *
 * @param timeout_ms  Milliseconds.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes that are not
 *          enabled, with the state of each drive and what hinders it. Those that are enabled stay
 *          so.
 */
int igh_cia402_enable_all_timeout(igh_cia402_context_t *context, uint32_t timeout_ms);

/**
 * The three calls above in a row: from drives in whatever state to axes that follow targets.
 *
 * @param timeout_ms  Milliseconds, for each of the three.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  As those calls.
 */
int igh_cia402_start_up_timeout(igh_cia402_context_t *context, uint32_t timeout_ms);

/**
 * Waits until the changes of mode and the homings of all axes are done.
 *
 * @param timeout_ms  Milliseconds.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes whose last
 *          command failed, and why.
 */
int igh_cia402_finish_all_timeout(igh_cia402_context_t *context, uint32_t timeout_ms);

/**
 * Ends in order, as igh_cia402_begin_shutdown(), and waits.
 *
 * @param timeout_ms  Milliseconds.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes that could not
 *          be switched off. The end is complete all the same, as far as it goes.
 */
int igh_cia402_shutdown_timeout(igh_cia402_context_t *context, uint32_t timeout_ms);

/* ---------------------------------------------------------------------------
 * The cycle
 *
 * igh_mcan_port_wait_next_cycle(&mcan);
 * igh_mcan_port_cycle_begin(&mcan);
 * igh_cia402_process_rx(&motors);
 * igh_cia402_set_target(&motors, 0, target);
 * igh_cia402_send_targets_all(&motors);
 * igh_mcan_port_cycle_end(&mcan);
 *
 * An axis is given a target only where nothing speaks against it: an incomplete working counter,
 * a repeated image, a step beyond the limit, a drive that is not enabled. What is no passing
 * matter makes the axis hold; igh_cia402_enable() takes it up again.
 * --------------------------------------------------------------------------- */

/** Offset of igh_cia402_set_scheduled_tx() that sends at once. */
#define IGH_CIA402_AT_ONCE 4294967295

/** What went out to the axes in one cycle. */
typedef struct {
    /** Axes that got a target of the application, or their step. */
    uint32_t targets;
    /** Axes that got their actual position as target: being enabled, or taken up. */
    uint32_t positions;
    /** Axes that are taken up and got nothing in this cycle: their motion must not go on. */
    uint32_t waiting;
    /** Axes whose target was refused. */
    uint32_t refused;
    /** Axes that are not taken up, or hold. */
    uint32_t closed;
    /** SYNC messages. */
    uint32_t syncs;
    /** 1 where every axis got a target of the application. */
    uint8_t all_moved;
    /** Not used. */
    uint8_t reserved[7];
} igh_cia402_send_summary_t;

/**
 * First in the open cycle: takes in TPDOs, SDO answers, heartbeats and emergencies, and lets every
 * axis do what is next. Frames that are not the axes' are thrown away; igh_cia402_process_rx_ex()
 * hands them out. In place of igh_mcan_port_receive().
 *
 * @usage   rt, the cycle's thread, in an open cycle
 * @return  ECAN_OK; ECAN_ERR_ORDER if no cycle is open; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED,
 *          ECAN_ERR_BUSY.
 */
int igh_cia402_process_rx(igh_cia402_context_t *context);

/**
 * As igh_cia402_process_rx(), with everything that is neither the axes' nor their network's handed
 * out: frames of other nodes, other PDOs, transmit results (kind).
 *
 * @param rx        Room for frames.
 * @param capacity  Frames that fit.
 * @param rx_count  Gets the number of frames handed out.
 *
 * @usage   rt, the cycle's thread, in an open cycle
 * @return  As igh_cia402_process_rx(); ECAN_ERR_BUFFER where more came than fit: the rest is lost,
 *          everything else is done.
 */
int igh_cia402_process_rx_ex(igh_cia402_context_t *context,
                             igh_mcan_rx_frame_t *rx,
                             size_t capacity,
                             size_t *rx_count);

/**
 * Last in the open cycle, once: sends targets and commands of all axes, SYNC behind them, then
 * NMT, SDO and heartbeat frames that are due.
 *
 * @usage   rt, the cycle's thread, in an open cycle after igh_cia402_process_rx
 * @return  ECAN_OK; ECAN_ERR_ORDER if no cycle is open; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED,
 *          ECAN_ERR_BUSY. igh_cia402_get_send_summary() reports the targets.
 */
int igh_cia402_send_targets_all(igh_cia402_context_t *context);

/**
 * As igh_cia402_send_targets_all(), with every CSP axis moved by its own target step, which it
 * takes up by its ramp. An axis does not move in a cycle in which its target does not go out.
 *
 * @usage   rt, the cycle's thread, in an open cycle after igh_cia402_process_rx
 * @return  As igh_cia402_send_targets_all().
 */
int igh_cia402_send_target_step(igh_cia402_context_t *context);

/**
 * What went out with the last igh_cia402_send_targets_all() or igh_cia402_send_target_step().
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_cia402_get_send_summary(igh_cia402_context_t *context, igh_cia402_send_summary_t *summary);

/**
 * Sends targets only in every n-th cycle (--motion-div). The step limit is one per target.
 *
 * @param motion_div  Cycles from target to target; 0 counts as 1.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_cia402_set_motion_div(igh_cia402_context_t *context, uint32_t motion_div);

/**
 * Sends targets and SYNC at phases of the Sync0 period instead of at once (manual 8.4, 13.8), each
 * by itself. Needs distributed clocks with Sync0. Only while no axis is taken up.
 *
 * A gateway drops a scheduled frame that reaches it behind its phase, and the drive then keeps the
 * target before it: leave a margin.
 *
 * @param enable          0 sends both at once, whatever the offsets; else they are scheduled.
 * @param rpdo_offset_ns  Nanoseconds after Sync0 at which targets go out, or IGH_CIA402_AT_ONCE.
 * @param sync_offset_ns  The same of SYNC; not before the targets.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_SCHEDULE without Sync0, beyond its period, or on a gateway that
 *          cannot; ECAN_ERR_AXIS_STATE while an axis is taken up; ECAN_ERR_ARGUMENT for SYNC ahead
 *          of the targets; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY. After an error
 *          everything is as it was.
 */
int igh_cia402_set_scheduled_tx(igh_cia402_context_t *context,
                                int enable,
                                uint32_t rpdo_offset_ns,
                                uint32_t sync_offset_ns);

/* ---------------------------------------------------------------------------
 * Targets
 *
 * A target stands until the next. It is forgotten when the axis holds; taken up again, the axis
 * stays where it is until it gets a new one.
 * --------------------------------------------------------------------------- */

/**
 * Sets the target of an axis from now on. What became of it is told by
 * igh_cia402_get_axis_state() after the targets were sent.
 *
 * @param target  Raw units of the mode: steps, velocity or torque.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_AXIS, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_cia402_set_target(igh_cia402_context_t *context, size_t axis, int32_t target);

/**
 * As igh_cia402_set_target(), with an angle by the axis' steps_per_turn and origin.
 *
 * @param degrees  Degrees of the axis.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  As igh_cia402_set_target(); ECAN_ERR_ARGUMENT for an angle that is no position.
 */
int igh_cia402_set_target_degrees(igh_cia402_context_t *context, size_t axis, double degrees);

/**
 * As igh_cia402_set_target(), with an angle by the axis' steps_per_turn and origin.
 *
 * @param radians  Radians of the axis.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  As igh_cia402_set_target(); ECAN_ERR_ARGUMENT for an angle that is no position.
 */
int igh_cia402_set_target_radians(igh_cia402_context_t *context, size_t axis, double radians);

/**
 * Sets the step that igh_cia402_send_target_step() makes from now on; the axis takes it up by its
 * ramp.
 *
 * @param step  Steps per cycle. One beyond the step limit is refused when the ramp gets there.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  As igh_cia402_set_target().
 */
int igh_cia402_set_target_step(igh_cia402_context_t *context, size_t axis, int32_t step);

/* ---------------------------------------------------------------------------
 * Commands to axes
 *
 * Each begins something and returns; the cycle goes on with it, and igh_cia402_get_axis_state()
 * tells how far it is. A command to all axes goes to every one, also behind one that refuses; the
 * code is that of the first refusal.
 * --------------------------------------------------------------------------- */

/**
 * How an axis finds its home position. igh_cia402_homing_init() fills it. Objects that a drive
 * does not have are skipped, apart from the method.
 */
typedef struct {
    /** Speed on the way to the switch, 0x6099:01, in the drive's units; 0 leaves it alone. */
    uint32_t switch_speed;
    /** Speed on the way to the zero, 0x6099:02; 0 leaves it alone. */
    uint32_t zero_speed;
    /** Acceleration, 0x609A; 0 leaves it alone. */
    uint32_t acceleration;
    /** What the home position is called, 0x607C, in steps, where has_offset is 1. */
    int32_t offset;
    /** How long it may take, in milliseconds. Default 60000. */
    uint32_t timeout_ms;
    /**
     * Homing method, 0x6098: 35 and 37 take the present position as home, 1 to 34 look for
     * switches and index pulses, negative ones are the manufacturer's.
     */
    int8_t method;
    /** 1: the offset is written. Default 0. */
    uint8_t has_offset;
    /** Not used. */
    uint8_t reserved[2];
} igh_cia402_homing_t;

/**
 * Sends an NMT command to all nodes of the channels that have axes, with the next targets. After
 * anything but IGH_CANOPEN_NMT_START the axes hold. Configuring a drive sends what it needs by
 * itself.
 *
 * @param command  An igh_canopen_nmt_t.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_CANOPEN where so many commands wait that no more can;
 *          ECAN_ERR_ARGUMENT, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_cia402_send_nmt_all(igh_cia402_context_t *context, int command);

/**
 * Sends an NMT command to the drive of an axis, as igh_cia402_send_nmt_all().
 *
 * @param command  An igh_canopen_nmt_t.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  As igh_cia402_send_nmt_all(); ECAN_ERR_AXIS.
 */
int igh_cia402_send_nmt(igh_cia402_context_t *context, size_t axis, int command);

/**
 * Begins to configure every drive that is not configured: what
 * igh_cia402_configure_csp_all_timeout() waits for.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_AXIS_STATE, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_cia402_configure_all(igh_cia402_context_t *context);

/**
 * Begins to configure a drive, also one that is configured: after it restarted, for example. An
 * enabled drive is switched off first.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  As igh_cia402_configure_all(); ECAN_ERR_AXIS.
 */
int igh_cia402_configure(igh_cia402_context_t *context, size_t axis);

/**
 * Begins to establish where all axes are: what may still be under way is waited out, then fresh
 * TPDOs that show them at rest.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_AXIS_STATE for an axis that is not configured, changes its mode or is
 *          homing; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_cia402_request_actual_position_all(igh_cia402_context_t *context);

/**
 * Begins to establish where an axis is.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  As igh_cia402_request_actual_position_all(); ECAN_ERR_AXIS.
 */
int igh_cia402_request_actual_position(igh_cia402_context_t *context, size_t axis);

/**
 * Begins to enable all drives, and takes axes up again that hold; those that run go on.
 * igh_cia402_enable_all_timeout() waits for it.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  As igh_cia402_request_actual_position_all().
 */
int igh_cia402_enable_all(igh_cia402_context_t *context);

/**
 * Begins to enable a drive, or takes an axis up again that holds: its actual position is
 * established, and is its first target. A drive in fault is not enabled: igh_cia402_reset_fault()
 * comes first. What is not done within enable_timeout_ms ends with the drive switched off.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  As igh_cia402_request_actual_position_all(); ECAN_ERR_AXIS.
 */
int igh_cia402_enable(igh_cia402_context_t *context, size_t axis);

/**
 * Switches all drives off, as igh_cia402_disable().
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_cia402_disable_all(igh_cia402_context_t *context);

/**
 * Ends targets at once and switches a drive off; how it stops is its own affair (0x605C).
 * igh_cia402_halt() first brings it to rest.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_AXIS, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_cia402_disable(igh_cia402_context_t *context, size_t axis);

/**
 * Commands a quick stop to all drives, as igh_cia402_quick_stop().
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_cia402_quick_stop_all(igh_cia402_context_t *context);

/**
 * Ends targets at once and commands a quick stop; the drive stops as its 0x605A says.
 * igh_cia402_enable() takes the axis up again.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_AXIS, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_cia402_quick_stop(igh_cia402_context_t *context, size_t axis);

/**
 * Resets the fault of a drive. It is not enabled by that.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  As igh_cia402_request_actual_position_all(); ECAN_ERR_AXIS.
 */
int igh_cia402_reset_fault(igh_cia402_context_t *context, size_t axis);

/**
 * Brings a running axis to rest and keeps it enabled: in CSP by its ramp, in CSV and CST by taking
 * the target back to 0 in steps of the limit, in PP, PV and PT by the halt bit. Targets are
 * ignored until igh_cia402_resume().
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_AXIS, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_cia402_halt(igh_cia402_context_t *context, size_t axis);

/**
 * Lets a halted axis follow targets again.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_AXIS, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_cia402_resume(igh_cia402_context_t *context, size_t axis);

/**
 * Begins to change the mode of a drive, with its mode display as confirmation. A running axis is
 * brought to rest and disabled before, and enabled again after.
 *
 * @param mode  An igh_cia402_mode_t whose target is in the process data that the axis' own mode
 *              mapped; not homing, which igh_cia402_home() does.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  As igh_cia402_request_actual_position_all(), ECAN_ERR_AXIS_STATE also for a mode that
 *          is not mapped; ECAN_ERR_AXIS, ECAN_ERR_ARGUMENT.
 */
int igh_cia402_change_mode(igh_cia402_context_t *context, size_t axis, int mode);

/**
 * Fills a homing: a method with the drive's own speeds, and a minute for it.
 *
 * @param homing  Is overwritten, whatever it holds.
 * @param method  Homing method, 0x6098.
 *
 * @usage   rt, any thread, any time
 * @return  ECAN_OK or ECAN_ERR_NULL.
 */
int igh_cia402_homing_init(igh_cia402_homing_t *homing, int8_t method);

/**
 * Begins homing: to rest, power off, parameters and mode, power on, homing, power off, the mode
 * before, and power on again where it was. The axis is taken up from what its position counter
 * says then.
 *
 * @param homing  Is copied.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  As igh_cia402_request_actual_position_all(); ECAN_ERR_AXIS.
 */
int igh_cia402_home(igh_cia402_context_t *context, size_t axis, const igh_cia402_homing_t *homing);

/**
 * Begins an orderly end: every axis comes to rest by its ramp, is disabled and released, so that
 * no drive reports a fault when the host leaves. Go on with the cycle until
 * igh_cia402_shutdown_is_done(). A stage that an axis cannot finish ends after five seconds.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_cia402_begin_shutdown(igh_cia402_context_t *context);

/* ---------------------------------------------------------------------------
 * What the state of an axis is made of
 * --------------------------------------------------------------------------- */

/** What an axis is doing. */
typedef enum {
    /** Not configured yet, or not any more: the drive restarted. */
    IGH_CIA402_PHASE_NOT_CONFIGURED = 0,
    /** The steps of its configuration are being done. */
    IGH_CIA402_PHASE_CONFIGURING = 1,
    /** Its mode is written and waited for. */
    IGH_CIA402_PHASE_SETTING_MODE = 2,
    /** Its configuration failed. */
    IGH_CIA402_PHASE_SETUP_FAILED = 3,
    /** Configured; nothing is commanded. */
    IGH_CIA402_PHASE_STANDBY = 4,
    /** Its actual position is being established. */
    IGH_CIA402_PHASE_READING = 5,
    /** Its actual position is known; the drive is not enabled. */
    IGH_CIA402_PHASE_READY = 6,
    /** The drive is brought to Operation Enabled. */
    IGH_CIA402_PHASE_ENABLING = 7,
    /** Follows targets. */
    IGH_CIA402_PHASE_RUNNING = 8,
    /** Is being brought to rest, or was, by igh_cia402_halt(). */
    IGH_CIA402_PHASE_HALTED = 9,
    /** Gets no targets until it is taken up again; hold_reason says why. */
    IGH_CIA402_PHASE_HOLDING = 10,
    /** A quick stop was commanded. */
    IGH_CIA402_PHASE_QUICK_STOP = 11,
    /** The drive's power is being switched off. */
    IGH_CIA402_PHASE_DISABLING = 12,
    /** A fault is being reset. */
    IGH_CIA402_PHASE_RESETTING_FAULT = 13,
    /** The drive has a fault. */
    IGH_CIA402_PHASE_FAULT = 14,
    /** The mode is being changed. */
    IGH_CIA402_PHASE_CHANGING_MODE = 15,
    /** Homing is prepared or wound up. */
    IGH_CIA402_PHASE_PREPARING_HOMING = 16,
    /** Homing. */
    IGH_CIA402_PHASE_HOMING = 17,
    /** Another one. */
    IGH_CIA402_PHASE_OTHER = 255,
} igh_cia402_phase_t;

/** What became of an axis' target. */
typedef enum {
    /** The axis is not taken up, or holds: no target. */
    IGH_CIA402_DECISION_CLOSED = 0,
    /** The drive is not enabled: it got its own actual position. */
    IGH_CIA402_DECISION_TRACK = 1,
    /** The first target of an enabled drive: its actual position. */
    IGH_CIA402_DECISION_FIRST = 2,
    /** The application's target went out, or the last one again where it gave none. */
    IGH_CIA402_DECISION_TARGET = 3,
    /** Nothing now; decision_reason is an igh_cia402_wait_t. */
    IGH_CIA402_DECISION_WAIT = 4,
    /** Not this target; decision_reason is an igh_cia402_refusal_t. */
    IGH_CIA402_DECISION_REFUSED = 5,
} igh_cia402_decision_t;

/** Why an axis that is taken up got nothing in a cycle. Its motion must not go on meanwhile. */
typedef enum {
    /** The working counter of this cycle is incomplete. */
    IGH_CIA402_WAIT_WORKING_COUNTER = 1,
    /** The last image may not have arrived and is repeated. */
    IGH_CIA402_WAIT_IMAGE_HELD = 2,
    /** The first target must be an actual position of this very cycle, and there is none. */
    IGH_CIA402_WAIT_NO_FRESH_POSITION = 3,
    /** The drive still holds an old target, far from the axis: it must be switched off first. */
    IGH_CIA402_WAIT_HOLDS_OLD_TARGET = 4,
    /** The image of the last cycle had no room for a frame of the channel. */
    IGH_CIA402_WAIT_IMAGE_FULL = 5,
    /** This cycle has had its target. */
    IGH_CIA402_WAIT_SPENT = 6,
    /** A frame was refused in this cycle; the axis will hold. */
    IGH_CIA402_WAIT_FRAME_REFUSED = 7,
} igh_cia402_wait_t;

/** Why a target was not taken. The target before it stands. */
typedef enum {
    /** Too far from the target before. */
    IGH_CIA402_REFUSAL_STEP = 1,
    /** Too far from the actual position. */
    IGH_CIA402_REFUSAL_WINDOW = 2,
    /** Outside the bounds of the axis. */
    IGH_CIA402_REFUSAL_BOUNDS = 3,
    /** The position counter cannot stand there. */
    IGH_CIA402_REFUSAL_COUNTER = 4,
    /** The mode takes no targets. */
    IGH_CIA402_REFUSAL_NO_TARGETS = 5,
    /** Another reason. */
    IGH_CIA402_REFUSAL_OTHER = 255,
} igh_cia402_refusal_t;

/** Why an axis holds: it gets no targets until igh_cia402_enable(). */
typedef enum {
    /** It does not hold. */
    IGH_CIA402_HOLD_NONE = 0,
    /** The gateway went out of service. */
    IGH_CIA402_HOLD_GATEWAY_LOST = 1,
    /** Frames under way to the gateway were given up, a target may be among them. */
    IGH_CIA402_HOLD_FRAMES_DISCARDED = 2,
    /** The working counter stayed incomplete for longer than wc_misses. */
    IGH_CIA402_HOLD_WORKING_COUNTER = 3,
    /** The channel went bus-off. */
    IGH_CIA402_HOLD_BUS_OFF = 4,
    /** The channel left the bus without being bus-off. */
    IGH_CIA402_HOLD_CHANNEL_STOPPED = 5,
    /** The gateway's transmit queue was full. */
    IGH_CIA402_HOLD_QUEUE_FULL = 6,
    /** The gateway reported a target as not sent. */
    IGH_CIA402_HOLD_TARGET_LOST = 7,
    /** The drive's heartbeat stayed away. */
    IGH_CIA402_HOLD_HEARTBEAT_LOST = 8,
    /** The drive is not Operational, or restarted. */
    IGH_CIA402_HOLD_NOT_OPERATIONAL = 9,
    /** The drive was out of sight, and its configuration is being verified. */
    IGH_CIA402_HOLD_UNVERIFIED = 10,
    /** No usable TPDO came for longer than tpdo_timeout. */
    IGH_CIA402_HOLD_TPDO_LOST = 11,
    /** The drive left Operation Enabled. */
    IGH_CIA402_HOLD_LEFT_OPERATION_ENABLED = 12,
    /** The drive stopped following its target. */
    IGH_CIA402_HOLD_NOT_FOLLOWING = 13,
    /** The drive reports a following error. */
    IGH_CIA402_HOLD_FOLLOWING_ERROR = 14,
    /** The axis moved while it was to be taken up. */
    IGH_CIA402_HOLD_MOVING = 15,
    /** The application commanded it. */
    IGH_CIA402_HOLD_COMMANDED = 16,
    /** Another reason. */
    IGH_CIA402_HOLD_OTHER = 255,
} igh_cia402_hold_t;

/** What went wrong with the last command to an axis; igh_cia402_get_axis_text() tells more. */
typedef enum {
    /** Nothing. */
    IGH_CIA402_AXIS_ERROR_NONE = 0,
    /** The configuration failed. */
    IGH_CIA402_AXIS_ERROR_SETUP = 1,
    /** The drive restarted and has forgotten its configuration. */
    IGH_CIA402_AXIS_ERROR_RESTARTED = 2,
    /** The drive did not reach Operation Enabled in time. */
    IGH_CIA402_AXIS_ERROR_ENABLE_TIMED_OUT = 3,
    /** The drive has a fault; error_code. */
    IGH_CIA402_AXIS_ERROR_FAULT = 4,
    /** The drive stays in fault after a reset; error_code. */
    IGH_CIA402_AXIS_ERROR_RESET_REFUSED = 5,
    /** The axis held; hold_reason. */
    IGH_CIA402_AXIS_ERROR_HELD = 6,
    /** Homing ended without a home position. */
    IGH_CIA402_AXIS_ERROR_HOMING = 7,
    /** Homing took too long. */
    IGH_CIA402_AXIS_ERROR_HOMING_TIMED_OUT = 8,
    /** A mode was not taken. */
    IGH_CIA402_AXIS_ERROR_MODE = 9,
    /** The drive did not switch its power off in time. */
    IGH_CIA402_AXIS_ERROR_NOT_DISABLED = 10,
    /** Another one. */
    IGH_CIA402_AXIS_ERROR_OTHER = 255,
} igh_cia402_axis_error_t;

/** How a node's heartbeat stands. */
typedef enum {
    /** It is not watched. */
    IGH_CANOPEN_HEARTBEAT_UNWATCHED = 0,
    /** It has not been heard since watching began or the node booted. */
    IGH_CANOPEN_HEARTBEAT_UNKNOWN = 1,
    /** It comes in time. */
    IGH_CANOPEN_HEARTBEAT_ACTIVE = 2,
    /** It stayed away. */
    IGH_CANOPEN_HEARTBEAT_TIMED_OUT = 3,
} igh_canopen_heartbeat_t;

/* ---------------------------------------------------------------------------
 * State of the axes
 * --------------------------------------------------------------------------- */

/** Everything known of an axis, at a glance. */
typedef struct {
    /** For how long the axis has been in this phase, in milliseconds. */
    uint64_t for_ms;
    /**
     * How far it is behind its target, in steps, where has_target and has_actual are 1. It
     * contains the way out and back, two cycles or more; the drive's own is in 0x60F4.
     */
    int64_t following_error;
    /** Actual position in degrees, where has_actual is 1. */
    double actual_degrees;
    /** Actual position in radians, where has_actual is 1. */
    double actual_radians;
    /** Last usable actual position, in steps, where has_actual is 1. */
    int32_t actual;
    /** Last target that was sent, where has_target is 1; the next is judged against it. */
    int32_t target;
    /** Cycles since the actual position came: 0 for this cycle, 65535 for many or never. */
    uint16_t actual_age;
    /** Last statusword, however old, where has_statusword is 1. */
    uint16_t statusword;
    /**
     * Error code of the last emergency message, 0x8611 for example; 0 where none came, or the node
     * took it back.
     */
    uint16_t error_code;
    /** Slave index of the gateway. */
    uint16_t slave;
    /** Channel of the gateway. */
    uint8_t channel;
    /** Node-ID of the drive. */
    uint8_t node_id;
    /** An igh_cia402_mode_t: the one that the drive has confirmed, that of the axis table before. */
    int8_t mode;
    /** An igh_cia402_phase_t. */
    uint8_t phase;
    /** An igh_cia402_drive_state_t, by the last statusword. */
    uint8_t drive_state;
    /** An igh_canopen_nmt_state_t. */
    uint8_t nmt_state;
    /** An igh_canopen_heartbeat_t. */
    uint8_t heartbeat;
    /** An igh_cia402_decision_t: what became of the target that was sent last. */
    uint8_t decision;
    /** An igh_cia402_wait_t or igh_cia402_refusal_t, by the decision; else 0. */
    uint8_t decision_reason;
    /** An igh_cia402_hold_t: why the axis holds. */
    uint8_t hold_reason;
    /** An igh_cia402_axis_error_t: what went wrong with the last command. */
    uint8_t trouble;
    /** 1 where the drive is configured. */
    uint8_t is_configured;
    /** 1 where the axis follows targets. */
    uint8_t is_running;
    /** 1 where a halted axis has come to rest, and where it does not run. */
    uint8_t is_at_rest;
    /** 1 where a drive that makes its own way (PP, PV, PT) has arrived; 0 in cyclic modes. */
    uint8_t is_target_reached;
    /** 1 where there is an actual position. */
    uint8_t has_actual;
    /** 1 where the axis follows targets and has one. */
    uint8_t has_target;
    /** 1 where there was a statusword. */
    uint8_t has_statusword;
    /** Not used. */
    uint8_t reserved[6];
} igh_cia402_axis_state_t;

/**
 * Tells everything known of an axis.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_AXIS, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_cia402_get_axis_state(igh_cia402_context_t *context,
                              size_t axis,
                              igh_cia402_axis_state_t *axis_state);

/**
 * Tells in words what an axis is doing, for how long, and what hinders it: "axis 2, node 5 (slave
 * 0, channel 1): being enabled, switched on, for 120 ms" for example.
 *
 * @param text  Gets the words, with NUL at the end; what does not fit is cut.
 * @param size  Bytes of the buffer.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_AXIS, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_cia402_get_axis_text(igh_cia402_context_t *context, size_t axis, char *text, size_t size);

/**
 * Whether all axes follow targets.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  1 or 0, also 0 without any axis; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED,
 *          ECAN_ERR_BUSY. Compare with 1.
 */
int igh_cia402_all_running(igh_cia402_context_t *context);

/**
 * Whether the end that igh_cia402_begin_shutdown() began is complete, and the host may leave.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  1 or 0; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY. Compare with 1.
 */
int igh_cia402_shutdown_is_done(igh_cia402_context_t *context);

/* ---------------------------------------------------------------------------
 * Counters and bus load
 *
 * Counters only grow.
 * --------------------------------------------------------------------------- */

/** What does not fit any more on a channel. */
typedef enum {
    /** There is room for everything. */
    IGH_CIA402_LOAD_OK = 0,
    /** Less than a tenth is left for SDO, heartbeats and emergencies. */
    IGH_CIA402_LOAD_NO_RESERVE = 1,
    /** With unlucky data the bus is too slow for a cycle now and then. */
    IGH_CIA402_LOAD_TIGHT = 2,
    /** More frames in a cycle than the gateway serves in one direction. */
    IGH_CIA402_LOAD_BUDGET = 3,
    /** The bus is too slow for the cycle: targets pile up, and the axes will hold. */
    IGH_CIA402_LOAD_TOO_MUCH = 4,
} igh_cia402_load_warning_t;

/** Counters of an axis. */
typedef struct {
    /** Targets handed to the gateway, the first ones included. */
    uint64_t targets_sent;
    /** Times that the axis was taken up while enabled. */
    uint64_t take_ups;
    /** Targets of the application that were refused, for any reason. */
    uint64_t targets_refused;
    /** Those refused because of the step limit. */
    uint64_t refused_step;
    /** Those refused because of the following window. */
    uint64_t refused_window;
    /**
     * Cycles in which a running axis got no target: a missed working counter, a repeated
     * image, no room.
     */
    uint64_t waits;
    /** Times that the axis held. */
    uint64_t holds;
    /** TPDOs received. */
    uint64_t tpdos;
    /** TPDOs too short for the mapping. */
    uint64_t malformed_tpdos;
    /** TPDOs that never came, by the number of SYNCs sent. */
    uint64_t lost_tpdos;
    /**
     * Cycles with an actual position that is not worth the name: in an incomplete image,
     * behind a backlog.
     */
    uint64_t unusable_positions;
    /** Largest distance between target and actual position while targets went out, in steps. */
    uint64_t max_following_error;
    /** Targets that the gateway reported as not sent. */
    uint64_t targets_lost;
    /** Faults of the drive. */
    uint64_t faults;
    /** Emergency messages. */
    uint32_t emergencies;
    /** Most cycles in a row without a usable TPDO while the axis was enabled. */
    uint16_t longest_gap;
    /** An igh_cia402_hold_t: why the axis held last. */
    uint8_t last_hold;
    /** Not used. */
    uint8_t reserved;
} igh_cia402_axis_statistics_t;

/**
 * Load of one channel by the process data of its axes and SYNC. SDO, heartbeats and NMT need
 * what is left.
 */
typedef struct {
    /** Share of the bus without a stuff bit; 1.0 is all of it. */
    double least;
    /** Share of the bus with as many stuff bits as are possible. */
    double most;
    /** Axes on the channel. */
    uint32_t axes;
    /** Frames from the host per cycle. */
    uint32_t frames_out;
    /** Frames from the drives per cycle. */
    uint32_t frames_in;
    /** Slave index. */
    uint16_t slave;
    /** Channel, 0 to 3. */
    uint8_t channel;
    /** An igh_cia402_load_warning_t. */
    uint8_t warning;
} igh_cia402_bus_load_t;

/**
 * Counters of an axis.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_AXIS, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_cia402_get_axis_statistics(igh_cia402_context_t *context,
                                   size_t axis,
                                   igh_cia402_axis_statistics_t *statistics);

/**
 * How much of each CAN bus the process data take, by the bit rates of the Port: each channel that
 * has axes.
 *
 * @param loads     Room for channels.
 * @param capacity  Channels that fit.
 * @param count     Gets the number of channels that have axes, also where they do not all fit.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_BUFFER where not all fit; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED,
 *          ECAN_ERR_BUSY.
 */
int igh_cia402_get_bus_load(igh_cia402_context_t *context,
                            igh_cia402_bus_load_t *loads,
                            size_t capacity,
                            size_t *count);

/* ---------------------------------------------------------------------------
 * SDO transfers with the drives
 *
 * A drive has one SDO server: while its axis is configured, changes its mode or is homing, a
 * transfer of the application waits.
 * --------------------------------------------------------------------------- */

/** How the last SDO transfer with a drive stands. */
typedef enum {
    /** There was none. */
    IGH_CIA402_SDO_IDLE = 0,
    /** Under way. */
    IGH_CIA402_SDO_RUNNING = 1,
    /** Done. */
    IGH_CIA402_SDO_DONE = 2,
    /** Failed. */
    IGH_CIA402_SDO_FAILED = 3,
} igh_cia402_sdo_state_t;

/**
 * Reads an object of a drive and waits. Runs the cycle meanwhile, with the axes at their last
 * targets.
 *
 * @param data        Gets the value, little endian.
 * @param size        Bytes of the buffer.
 * @param length      Gets the bytes of the value, also where it does not fit.
 * @param timeout_ms  Milliseconds in all.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  ECAN_OK; ECAN_ERR_SDO with ecan_last_abort_code(); ECAN_ERR_TIMEOUT, ECAN_ERR_BUFFER,
 *          ECAN_ERR_CANOPEN, ECAN_ERR_AXIS, ECAN_ERR_MASTER, ECAN_ERR_NULL,
 *          ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY; ECAN_ERR_ORDER where the bus is not active;
 *          ECAN_ERR_ATTACHED on a master of another owner, where igh_cia402_sdo_start_upload()
 *          does it.
 */
int igh_cia402_sdo_upload(igh_cia402_context_t *context,
                          size_t axis,
                          uint16_t index,
                          uint8_t subindex,
                          void *data,
                          size_t size,
                          size_t *length,
                          uint32_t timeout_ms);

/**
 * Writes an object of a drive and waits; as igh_cia402_sdo_upload().
 *
 * @param data        The value, little endian, with as many bytes as the object has.
 * @param size        Its bytes.
 * @param timeout_ms  Milliseconds in all.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  As igh_cia402_sdo_upload(); on a master of another owner
 *          igh_cia402_sdo_start_download() does it.
 */
int igh_cia402_sdo_download(igh_cia402_context_t *context,
                            size_t axis,
                            uint16_t index,
                            uint8_t subindex,
                            const void *data,
                            size_t size,
                            uint32_t timeout_ms);

/**
 * Begins to read an object of a drive; igh_cia402_sdo_poll() tells the outcome in later cycles.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_AXIS_STATE while another transfer with the drive is under way;
 *          ECAN_ERR_AXIS, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_cia402_sdo_start_upload(igh_cia402_context_t *context,
                                size_t axis,
                                uint16_t index,
                                uint8_t subindex);

/**
 * Begins to write an object of a drive, as igh_cia402_sdo_start_upload().
 *
 * @param data  The value, little endian, with as many bytes as the object has. Is copied.
 * @param size  Its bytes.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  As igh_cia402_sdo_start_upload(); ECAN_ERR_CANOPEN for a value that is longer than
 *          igh_cia402_settings_t.sdo_buffer_bytes.
 */
int igh_cia402_sdo_start_download(igh_cia402_context_t *context,
                                  size_t axis,
                                  uint16_t index,
                                  uint8_t subindex,
                                  const void *data,
                                  size_t size);

/**
 * How the transfer with a drive stands that was begun last. Call it in every cycle: the axis' own
 * transfers begin the next one when it needs to, and the value of this one is gone.
 *
 * @param state   Gets an igh_cia402_sdo_state_t.
 * @param data    Gets the value of an upload that is done, little endian; may be NULL with size 0.
 * @param size    Bytes of the buffer.
 * @param length  Gets the bytes of the value, also where it does not fit; 0 while there is none.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, also for a transfer that failed, whose reason is in ecan_last_error() and
 *          ecan_last_abort_code(); ECAN_ERR_BUFFER, ECAN_ERR_AXIS, ECAN_ERR_NULL,
 *          ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
 */
int igh_cia402_sdo_poll(igh_cia402_context_t *context,
                        size_t axis,
                        uint8_t *state,
                        void *data,
                        size_t size,
                        size_t *length);

/* ---------------------------------------------------------------------------
 * SDO transfers with any CANopen node
 *
 * For programs without axes: tools, start-up of other devices. Each call runs the cycle itself
 * and throws away what else is received.
 * --------------------------------------------------------------------------- */

/**
 * Reads an object of a CANopen node and waits.
 *
 * @param slave       Slave index of the gateway.
 * @param channel     Channel of the gateway, 0 to 3, enabled for classic CAN or CAN FD.
 * @param node_id     Node-ID, 1 to 127.
 * @param data        Gets the value, little endian.
 * @param size        Bytes of the buffer.
 * @param length      Gets the bytes of the value, also where it does not fit.
 * @param timeout_ms  Milliseconds in all. A node that does not answer ends it after 1500 already.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  ECAN_OK; ECAN_ERR_SDO, with ecan_last_abort_code() where the node refused;
 *          ECAN_ERR_TIMEOUT, ECAN_ERR_BUFFER, ECAN_ERR_CANOPEN, ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL,
 *          ECAN_ERR_ARGUMENT, ECAN_ERR_MASTER, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED,
 *          ECAN_ERR_BUSY; ECAN_ERR_ORDER where the bus is not active, or there are axes on the
 *          Port: igh_cia402_sdo_upload() is the way then; ECAN_ERR_ATTACHED on a master of another
 *          owner.
 */
int igh_canopen_sdo_upload(igh_mcan_port_t *port,
                           size_t slave,
                           uint8_t channel,
                           uint8_t node_id,
                           uint16_t index,
                           uint8_t subindex,
                           void *data,
                           size_t size,
                           size_t *length,
                           uint32_t timeout_ms);

/**
 * Writes an object of a CANopen node and waits; as igh_canopen_sdo_upload().
 *
 * @param data        The value, little endian, with as many bytes as the object has.
 * @param size        Its bytes.
 * @param timeout_ms  Milliseconds in all.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  As igh_canopen_sdo_upload().
 */
int igh_canopen_sdo_download(igh_mcan_port_t *port,
                             size_t slave,
                             uint8_t channel,
                             uint8_t node_id,
                             uint16_t index,
                             uint8_t subindex,
                             const void *data,
                             size_t size,
                             uint32_t timeout_ms);

#ifdef __cplusplus
}
#endif

#endif /* IGH_CIA402_PROTOCOL_H */
