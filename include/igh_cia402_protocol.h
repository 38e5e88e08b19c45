/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/**
 * ECAN-Lite host SDK: CANopen and CiA 402 (manual 15.1, 15.4, 15.5.4).
 *
 * Motors on the gateways: startup, targets, states, SDO.
 *
 * igh_ecan_common.h has the rules for all functions.
 *
 * Change log
 *
 *   0.2.0  Renamed: igh_cia402_trouble_t to igh_cia402_axis_error_t, igh_cia402_refusal_t to
 *          igh_cia402_rejection_t, with their values; IGH_CIA402_DECISION_REFUSED to _REJECTED,
 *          IGH_CIA402_WAIT_IMAGE_HELD to _IMAGE_UNCONFIRMED, _WAIT_FRAME_REFUSED to _FRAME_REJECTED,
 *          IGH_CIA402_TROUBLE_RESET_REFUSED to IGH_CIA402_AXIS_ERROR_RESET_FAILED,
 *          IGH_CANOPEN_HEARTBEAT_UNWATCHED to _UNCONFIGURED, IGH_CIA402_PHASE_QUICK_STOP and
 *          _PHASE_DISABLING to _PHASE_STOPPING and _PHASE_STOPPED. Fields: refused* to rejected*,
 *          targets_refused to targets_rejected, trouble to axis_error, auto_take_up to auto_resume,
 *          take_ups to activations.
 *          Added: IGH_CIA402_MODE_VL; the modes IP, PT and VL are driven, with their objects in igh_cia402_axis_t.
 *          Added: several axes of a node, COB-IDs and node guarding: node_axis, rpdo_cob_ids, tpdo_cob_ids,
 *          guard_time_ms and life_time_factor of igh_cia402_axis_t; IGH_CIA402_HOST_WATCH_GUARDED. pdo_number is a
 *          uint16_t.
 *          Added: identity (device type, revision and serial number), outputs, inputs, feed-forward, limits
 *          and scale_source of igh_cia402_axis_t; igh_cia402_output_t and igh_cia402_input_t, the values of
 *          the inputs and offsets in igh_cia402_axis_state_t, feed_forwards_limited;
 *          igh_cia402_set_target_with(), igh_cia402_set_digital_outputs(), igh_cia402_arm_probe(),
 *          igh_cia402_disarm_probe(), igh_cia402_get_probe(), igh_cia402_get_drive_limits(),
 *          igh_cia402_get_drive_units(), igh_cia402_get_scale_text().
 *          Added: igh_cia402_context_init_file(). igh_canopen_sdo_upload() and igh_canopen_sdo_download()
 *          also work with axes on the Port, for nodes of their network.
 *          Added: IGH_CIA402_HOLD_NOT_AT_TARGET, IGH_CIA402_WAIT_NOT_DUE, _WAIT_NOT_RECEIVED, _WAIT_BACKLOG, _WAIT_TOGETHER,
 *          igh_cia402_get_host_loss(), igh_cia402_get_host_loss_text(), igh_cia402_stop_all(),
 *          igh_cia402_stop_all_timeout(), igh_cia402_all_stopped(), igh_cia402_recover(),
 *          igh_cia402_recover_all_timeout(), igh_cia402_stop_together(),
 *          igh_cia402_stop_cause_t, the phases UNCONTROLLED and INSPECTING, `takeover` of the settings,
 *          the fields stop_cause, is_stopped, is_recovering and uncontrolled; the fields shutdown,
 *          disable_operation, halt, fault_reaction and the limits in rad/s of igh_cia402_axis_t.
 *          Added: igh_cia402_set_stop_time_ms(); igh_cia402_context_deinit() stops axes that may move.
 *          Removed: IGH_CIA402_HOLD_MOVING.
 *          igh_cia402_set_motion_div() is rejected while an axis is configured.
 *          igh_cia402_all_running() and is_running are 0 for halted axes.
 *          igh_cia402_all_running(), igh_cia402_all_stopped() and igh_cia402_shutdown_is_done() return
 *          0 after an error, no longer its code.
 *          Added: `needed` of igh_cia402_get_axis_text() and
 *          igh_cia402_get_host_loss_text().
 *          Moved: igh_cia402_plan() to igh_plan.h.
 *          Removed: igh_cia402_set_target_degrees() and actual_degrees, use radians; igh_cia402_configure_all(),
 *          igh_cia402_request_actual_position_all(), igh_cia402_disable_all(), igh_cia402_quick_stop_all(),
 *          igh_cia402_recover_all(), use the function without _all with IGH_CIA402_ALL_AXES.
 *          Structs that the library fills end with reserved fields, which are 0; reserved fields of
 *          structs that the application fills must be 0.
 *          origin follows steps_per_turn in igh_cia402_axis_t.
 *   0.1.0  First version.
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
    IGH_CANOPEN_NMT_RESET_COMMUNICATION = 130
} igh_canopen_nmt_t;

/** NMT state of a node. */
typedef enum {
    /** Initialising, after boot-up. */
    IGH_CANOPEN_NMT_STATE_INITIALISING = 0,
    /** Stopped. */
    IGH_CANOPEN_NMT_STATE_STOPPED = 4,
    /** Operational. */
    IGH_CANOPEN_NMT_STATE_OPERATIONAL = 5,
    /** Pre-operational. */
    IGH_CANOPEN_NMT_STATE_PRE_OPERATIONAL = 127,
    /** Unknown: no heartbeat so far, or none since its reset. */
    IGH_CANOPEN_NMT_STATE_UNKNOWN = 255
} igh_canopen_nmt_state_t;

/** A mode of operation, as 0x6060 takes it. */
typedef enum {
    /** Profile position. Targets are steps; the drive generates the trajectory. */
    IGH_CIA402_MODE_PP = 1,
    /** Velocity (vl). Targets are those of 0x6042, by default revolutions per minute. */
    IGH_CIA402_MODE_VL = 2,
    /** Profile velocity. Targets are velocities in the drive's unit. */
    IGH_CIA402_MODE_PV = 3,
    /** Profile torque. Targets are torques in the drive's unit. */
    IGH_CIA402_MODE_PT = 4,
    /** Homing; igh_cia402_home() enters and leaves it. */
    IGH_CIA402_MODE_HM = 6,
    /** Interpolated position. Targets are steps, one per target period, into the drive's buffer. */
    IGH_CIA402_MODE_IP = 7,
    /** Cyclic synchronous position. Targets are steps, one per target period. */
    IGH_CIA402_MODE_CSP = 8,
    /** Cyclic synchronous velocity. */
    IGH_CIA402_MODE_CSV = 9,
    /** Cyclic synchronous torque. */
    IGH_CIA402_MODE_CST = 10
} igh_cia402_mode_t;

/** State of a drive, by its statusword. */
typedef enum {
    /** No statusword was received, or its state is not defined in CiA 402. */
    IGH_CIA402_DRIVE_UNKNOWN = 0,
    /** Starting up. */
    IGH_CIA402_DRIVE_NOT_READY = 1,
    /** Power may not be switched on. */
    IGH_CIA402_DRIVE_SWITCH_ON_DISABLED = 2,
    /** Power may be switched on. */
    IGH_CIA402_DRIVE_READY_TO_SWITCH_ON = 3,
    /** Power is on, the motor is without torque. */
    IGH_CIA402_DRIVE_SWITCHED_ON = 4,
    /** The motor follows targets. */
    IGH_CIA402_DRIVE_OPERATION_ENABLED = 5,
    /** A quick stop is in progress, or has ended with power on. */
    IGH_CIA402_DRIVE_QUICK_STOP_ACTIVE = 6,
    /** A fault occurred; its reaction is in progress. */
    IGH_CIA402_DRIVE_FAULT_REACTION = 7,
    /** In fault, the motor is without torque. */
    IGH_CIA402_DRIVE_FAULT = 8
} igh_cia402_drive_state_t;

/** Start of a node's configuration, in igh_cia402_axis_t.reset. */
typedef enum {
    /** NMT command Enter Pre-operational. */
    IGH_CIA402_RESET_NONE = 0,
    /** NMT command Reset communication: parameters of 0x1000.. as at power-on. */
    IGH_CIA402_RESET_COMMUNICATION = 1,
    /** NMT command Reset node. */
    IGH_CIA402_RESET_NODE = 2
} igh_cia402_reset_t;

/** Range of a position counter, in igh_cia402_axis_t.range. */
typedef enum {
    /** It ends at the limits of an int32_t; nothing is commanded outside of them. */
    IGH_CIA402_RANGE_LINEAR = 0,
    /** It wraps over the whole int32_t. */
    IGH_CIA402_RANGE_WRAPPING = 1,
    /** It wraps within 0x607B: one step beyond range_max is range_min. */
    IGH_CIA402_RANGE_MODULO = 2
} igh_cia402_range_t;

/**
 * Check of the revision number, in igh_cia402_axis_t.revision_check. The major revision is in the upper
 * half of the number.
 */
typedef enum {
    /** Every one. */
    IGH_CIA402_REVISION_ANY = 0,
    /** Exactly revision_number. */
    IGH_CIA402_REVISION_EXACTLY = 1,
    /** The same major revision, and at least the minor one: a compatible drive. */
    IGH_CIA402_REVISION_COMPATIBLE = 2
} igh_cia402_revision_t;

/** Origin of the scale of an axis, in igh_cia402_axis_t.scale_source. */
typedef enum {
    /** steps_per_turn and velocity_units; the units of the drive are not read. */
    IGH_CIA402_SCALE_CONFIGURED = 0,
    /** These, compared with the units of the drive: igh_cia402_get_drive_units(). */
    IGH_CIA402_SCALE_CHECKED = 1,
    /**
     * The units of the drive, which must have 0x608F; origin is that of the axis. Not with limits
     * in rad/s.
     */
    IGH_CIA402_SCALE_DRIVE = 2
} igh_cia402_scale_source_t;

/**
 * Reaction of a drive to a lost heartbeat of the host (0x6007), in
 * igh_cia402_axis_t.host_loss. A manufacturer may define further, negative ones.
 */
typedef enum {
    /** Nothing. */
    IGH_CIA402_HOST_LOSS_NONE = 0,
    /** Fault. */
    IGH_CIA402_HOST_LOSS_FAULT = 1,
    /** Disables voltage. */
    IGH_CIA402_HOST_LOSS_DISABLE_VOLTAGE = 2,
    /** Quick stop. */
    IGH_CIA402_HOST_LOSS_QUICK_STOP = 3
} igh_cia402_host_loss_t;

/**
 * Kind of a drive's quick stop (0x605A), in igh_cia402_axis_t.quick_stop. A manufacturer may
 * define further, negative ones.
 */
typedef enum {
    /** Disables voltage at once. */
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
    IGH_CIA402_QUICK_STOP_VOLTAGE_LIMIT_AND_STAY = 8
} igh_cia402_quick_stop_t;

/**
 * Stop of a drive by shutdown (0x605B) and disable operation (0x605C), in
 * igh_cia402_axis_t.shutdown and disable_operation. A manufacturer may define further, negative
 * ones.
 */
typedef enum {
    /** Disables voltage at once; the motor coasts. */
    IGH_CIA402_STOP_OPTION_DISABLE = 0,
    /** Slows down by its ramp, then switches off. */
    IGH_CIA402_STOP_OPTION_SLOW_DOWN = 1
} igh_cia402_stop_option_t;

/**
 * Kind of a drive's halt (0x605D), in igh_cia402_axis_t.halt. It stays enabled. A manufacturer
 * may define further, negative ones.
 */
typedef enum {
    /** Slows down by its ramp. */
    IGH_CIA402_HALT_SLOW_DOWN = 1,
    /** Slows down by its quick stop ramp. */
    IGH_CIA402_HALT_QUICK_STOP_RAMP = 2,
    /** Slows down at the current limit. */
    IGH_CIA402_HALT_CURRENT_LIMIT = 3,
    /** Slows down at the voltage limit. */
    IGH_CIA402_HALT_VOLTAGE_LIMIT = 4
} igh_cia402_halt_option_t;

/**
 * Reaction of a drive to a fault (0x605E), in igh_cia402_axis_t.fault_reaction; then it
 * switches off. A manufacturer may define further, negative ones.
 */
typedef enum {
    /** Disables voltage at once; the motor coasts. */
    IGH_CIA402_FAULT_REACTION_DISABLE = 0,
    /** Slows down by its ramp. */
    IGH_CIA402_FAULT_REACTION_SLOW_DOWN = 1,
    /** Slows down by its quick stop ramp. */
    IGH_CIA402_FAULT_REACTION_QUICK_STOP_RAMP = 2,
    /** Slows down at the current limit. */
    IGH_CIA402_FAULT_REACTION_CURRENT_LIMIT = 3,
    /** Slows down at the voltage limit. */
    IGH_CIA402_FAULT_REACTION_VOLTAGE_LIMIT = 4
} igh_cia402_fault_reaction_t;

/* ---------------------------------------------------------------------------
 * The axis table
 *
 * Plain data: a table may be copied and needs no deinit. igh_cia402_axis_init() fills every field
 * with values for most drives; change fields after it, before igh_cia402_context_init(), which
 * checks the table as a whole.
 *
 * igh_cia402_axis_t axes[2];
 * igh_cia402_axis_init(&axes[0], 0, 0, 1, 10);     slave 0, CAN0, node 1, 10 steps per target
 * igh_cia402_axis_init(&axes[1], 0, 0, 2, 10);
 * axes[1].steps_per_turn = 131072.0;
 * --------------------------------------------------------------------------- */

/** Keeps an option code of the drive. */
#define IGH_CIA402_UNCHANGED 2147483647

/** Most additional objects of an axis. */
#define IGH_CIA402_MAX_FURTHER 16

/** Most PDOs of an axis with own COB-IDs in one direction. */
#define IGH_CIA402_MAX_PDOS 8

/** An object that the configuration of a drive writes. */
typedef struct {
    /** Value; signed for a signed object. */
    int64_t value;
    /** Index. */
    uint16_t index;
    /** Subindex. */
    uint8_t subindex;
    /** Bytes of the object: 1, 2, 4 or 8. */
    uint8_t size;
    /** 1 if the drive may lack the object. */
    uint8_t is_optional;
    /** Must be 0. */
    uint8_t reserved[3];
} igh_cia402_object_t;

/**
 * Configuration of an axis: its drive and the limits of its targets. Steps are those of the
 * drive's position counter; a cycle is a cycle in which targets are sent.
 */
typedef struct {
    /** Not for the application: marks a filled axis. */
    uint64_t seal;
    /** Slave index of the gateway. */
    uint16_t slave;
    /** Channel of the gateway, 0 to 3. */
    uint8_t channel;
    /** Node-ID of the drive, 1 to 127. */
    uint8_t node_id;
    /** An igh_cia402_mode_t; it determines the process data. Default IGH_CIA402_MODE_CSP. */
    int8_t mode;
    /**
     * Axis of the node, 0 to 7, for a drive with several: its objects are 0x800 further for each. The axes
     * of a node are rows of the table with the same address, each with PDOs of its own. reset,
     * boot_timeout_ms, the identity, expect_profile_402, the heartbeats, guarding and silence_other_tpdos
     * must be equal in all of them. Default 0.
     */
    uint8_t node_axis;
    /**
     * 1: in CSP, the axis becomes active again automatically after a hold in which its drive
     * stayed enabled. Default 0: only igh_cia402_enable() does that. A drive that left Operation
     * enabled is never enabled automatically.
     */
    uint8_t auto_resume;
    /** An igh_cia402_range_t: range of the position counter. Default IGH_CIA402_RANGE_LINEAR. */
    uint8_t range;
    /** Smallest position of IGH_CIA402_RANGE_MODULO, 0x607B:01. */
    int32_t range_min;
    /** Largest position of IGH_CIA402_RANGE_MODULO, 0x607B:02. */
    int32_t range_max;
    /**
     * Steps per turn of the axis, gear included; negative inverts the direction. For angles only.
     * Default 360, one step per degree.
     */
    double steps_per_turn;
    /** Step at which the angle is 0. Default 0. */
    int32_t origin;
    /** Step per target that igh_cia402_send_target_step() makes. */
    int32_t target_step;
    /**
     * Largest distance between consecutive targets, which take effect with a SYNC each: steps, or units of velocity or torque. Not
     * used in PP, PV and PT. Default 1000, or the target step if it is larger.
     */
    uint32_t step_limit;
    /**
     * Largest distance between a position target and the actual position, in steps; at least eight
     * step limits, because a moving axis lags by the transport times. Default 0: a value for the
     * step limit, at least 10000.
     */
    uint32_t following_window;
    /**
     * Largest distance between two actual positions of an axis at rest, in steps: noise. A faster
     * axis does not become active. The step limit if it is smaller. Default 20.
     */
    uint32_t standstill;
    /**
     * Largest change of the step per target for motion that the host generates: target step, halt,
     * shutdown. Default 20.
     */
    uint32_t ramp;
    /**
     * Largest velocity of the axis in rad/s, by steps_per_turn and the time from target to target: it
     * replaces step_limit, in CSV and PV it bounds the targets. Limits that cannot be kept in the mode
     * of the axis are rejected. Default 0: none.
     */
    double max_velocity_rad_s;
    /**
     * Largest acceleration in rad/s^2 of motion that the host generates: it replaces ramp. In CSV it
     * replaces step_limit. Default 0: none.
     */
    double max_acceleration_rad_s2;
    /** Largest jerk in rad/s^3 of motion that the host generates. Default 0: none. */
    double max_jerk_rad_s3;
    /**
     * Value of 0x60FF for one turn of the axis per second; the limits in CSV and PV need it.
     * Default 0: unknown.
     */
    double velocity_units;
    /** Smallest target, if has_bounds is 1; steps, or units of velocity or torque. */
    int32_t bound_min;
    /** Largest target, if has_bounds is 1. */
    int32_t bound_max;
    /** 1: targets outside bound_min and bound_max are rejected. Default 0. */
    uint8_t has_bounds;
    /**
     * 1: the bounds are also written to 0x607D, in position modes and if the drive has the object.
     * Default 0.
     */
    uint8_t write_position_limits;
    /** Tolerated consecutive SYNC periods without a usable TPDO. Default 5. */
    uint16_t tpdo_timeout;
    /**
     * Tolerated consecutive cycles with an incomplete working counter; no targets are sent in
     * them. Default 3.
     */
    uint16_t wc_misses;
    /** Images after which earlier targets count as executed or lost. Default 3. */
    uint16_t drain_images;
    /** Timeout for enabling, in milliseconds. Default 5000. */
    uint32_t enable_timeout_ms;
    /** Timeout for the boot-up message after a reset, in milliseconds. Default 5000. */
    uint32_t boot_timeout_ms;
    /** An igh_cia402_reset_t. Default IGH_CIA402_RESET_NONE. */
    uint8_t reset;
    /** 1: the low half of 0x1000 must be 402. Default 1. */
    uint8_t expect_profile_402;
    /** 1: 0x1018 must have this vendor and product. Default 0. */
    uint8_t check_identity;
    /** 1: TPDO 2 to 4 are disabled if the drive has them, to save bus time. Default 1. */
    uint8_t silence_other_tpdos;
    /** 0x1018:01, if check_identity is 1. */
    uint32_t vendor_id;
    /** 0x1018:02, if check_identity is 1. */
    uint32_t product_code;
    /**
     * Heartbeat of the drive, 0x1017, in milliseconds; the host counts it as lost after three and
     * a half periods. 0 disables it. Not used with guard_time_ms. Default 100.
     */
    uint16_t heartbeat_ms;
    /**
     * Time after which the drive counts the host as lost, 0x1016:01, in milliseconds; 0 does not
     * write the object. Default 250.
     */
    uint16_t host_heartbeat_ms;
    /**
     * Reaction of the drive to a lost host, 0x6007: an igh_cia402_host_loss_t, or
     * IGH_CIA402_UNCHANGED. Default IGH_CIA402_HOST_LOSS_QUICK_STOP.
     */
    int32_t host_loss;
    /**
     * Kind of the quick stop, 0x605A: an igh_cia402_quick_stop_t, or IGH_CIA402_UNCHANGED. Default
     * IGH_CIA402_UNCHANGED.
     */
    int32_t quick_stop;
    /**
     * Following error window of the drive, 0x6065, in steps, if write_following_error is 1. Should
     * not be less than following_window.
     */
    uint32_t following_error_window;
    /** Time of the following error window, 0x6066, in milliseconds. */
    uint16_t following_error_ms;
    /** 1: both are written if the drive has them. Default 0. */
    uint8_t write_following_error;
    /** Number of objects in `further`. Default 0. */
    uint8_t further_count;
    /** Additional objects that are written after the mapping, in Pre-operational. */
    igh_cia402_object_t further[IGH_CIA402_MAX_FURTHER];
    /**
     * Kind of the shutdown, 0x605B: an igh_cia402_stop_option_t, or IGH_CIA402_UNCHANGED. Default
     * IGH_CIA402_UNCHANGED.
     */
    int32_t shutdown;
    /**
     * Stop of a disabled axis, 0x605C: an igh_cia402_stop_option_t, or IGH_CIA402_UNCHANGED.
     * Default IGH_CIA402_UNCHANGED.
     */
    int32_t disable_operation;
    /**
     * Kind of a halt in PP, PV and PT, 0x605D: an igh_cia402_halt_option_t, or
     * IGH_CIA402_UNCHANGED. Default IGH_CIA402_UNCHANGED.
     */
    int32_t halt;
    /**
     * Fault reaction, 0x605E: an igh_cia402_fault_reaction_t, or IGH_CIA402_UNCHANGED. Default
     * IGH_CIA402_UNCHANGED.
     */
    int32_t fault_reaction;
    /** Device type 0x1000, if check_device_type is 1. */
    uint32_t device_type;
    /** Revision number 0x1018:03, if revision_check is not IGH_CIA402_REVISION_ANY. */
    uint32_t revision_number;
    /** Serial number 0x1018:04, if check_serial_number is 1. */
    uint32_t serial_number;
    /**
     * Objects that the RPDOs carry beyond controlword and target: sum of igh_cia402_output_t, in the
     * order of their numbers. Default 0.
     */
    uint32_t outputs;
    /**
     * Objects that the TPDOs carry beyond statusword and actual position: sum of igh_cia402_input_t,
     * in the order of their numbers. igh_cia402_get_axis_state() has their values. Default 0.
     */
    uint32_t inputs;
    /**
     * Mask of the digital outputs 0x60FE:02, if has_output_mask is 1: a bit that is set lets the host
     * set this output.
     */
    uint32_t output_mask;
    /**
     * Largest velocity offset 0x60B1 of igh_cia402_set_target_with(), in units of the drive's
     * velocity; IGH_CIA402_OUTPUT_VELOCITY_OFFSET needs it. Default 0.
     */
    uint32_t feed_forward_velocity;
    /** Largest change of the velocity offset per target. Default 0. */
    uint32_t feed_forward_velocity_change;
    /** Torque slope 0x6087 of PT, in thousandths of the rated torque per second; 0 does not write it. */
    uint32_t torque_slope;
    /** Smallest amount of the velocity in VL, 0x6046:01, if vl_velocity_max is not 0. */
    uint32_t vl_velocity_min;
    /** Largest amount of the velocity in VL, 0x6046:02; 0 does not write 0x6046. */
    uint32_t vl_velocity_max;
    /** Change of the velocity in VL while it accelerates, 0x6048:01; 0 does not write 0x6048. */
    uint32_t vl_acceleration;
    /** Change of the velocity in VL while it decelerates, 0x6049:01; 0 does not write 0x6049. */
    uint32_t vl_deceleration;
    /** Largest speed of the motor 0x6080, in revolutions per minute; 0 does not write it. */
    uint32_t max_motor_speed;
    /** Time of vl_acceleration in seconds, 0x6048:02. */
    uint16_t vl_acceleration_s;
    /** Time of vl_deceleration in seconds, 0x6049:02. */
    uint16_t vl_deceleration_s;
    /**
     * Set-points that wait in the drive in IP, 0x60C4:02; 0 leaves it unchanged. When targets end,
     * the drive still goes through those that wait.
     */
    uint16_t interpolation_buffer;
    /** Largest torque 0x6072, in thousandths of the rated torque; 0 does not write it. */
    uint16_t max_torque;
    /**
     * Largest torque offset 0x60B2 of igh_cia402_set_target_with(), in thousandths of the rated
     * torque; IGH_CIA402_OUTPUT_TORQUE_OFFSET needs it. Default 0.
     */
    uint16_t feed_forward_torque;
    /** Largest change of the torque offset per target. Default 0. */
    uint16_t feed_forward_torque_change;
    /** 1: 0x1000 must have this device type. Default 0. */
    uint8_t check_device_type;
    /** An igh_cia402_revision_t. Default IGH_CIA402_REVISION_ANY. */
    uint8_t revision_check;
    /** 1: 0x1018:04 must have this serial number. Default 0. */
    uint8_t check_serial_number;
    /** 1: the mask of the digital outputs is written. Default 0. */
    uint8_t has_output_mask;
    /**
     * 1: the limits 0x6072, 0x607D and 0x6080 of the drive are read and narrow those of the axis;
     * also done if max_torque or max_motor_speed is set. igh_cia402_get_drive_limits() returns them.
     * Default 0.
     */
    uint8_t use_drive_limits;
    /** An igh_cia402_scale_source_t. Default IGH_CIA402_SCALE_CONFIGURED. */
    uint8_t scale_source;
    /**
     * Multiple of guard_time_ms without response or request after which the host and the drive react,
     * 1 to 255 (0x100D), if guard_time_ms is not 0. Default 0.
     */
    uint8_t life_time_factor;
    /** Must be 0. */
    uint8_t padding;
    /**
     * Time between two requests of node guarding, 1 to 65535 ms (0x100C): in place of heartbeat_ms, for a
     * drive without heartbeat. The drive detects by the requests that the host has stopped. Default 0:
     * none.
     */
    uint16_t guard_time_ms;
    /**
     * Number of the first RPDO and of the first TPDO, 1 to 512; further ones have the next numbers. Numbers
     * above 4 need COB-IDs. Default 1.
     */
    uint16_t pdo_number;
    /**
     * COB-IDs of the RPDOs in the order of their numbers, 0x181 to 0x57F, one for each; the others are 0.
     * Default all 0: those of the predefined connection set.
     */
    uint16_t rpdo_cob_ids[IGH_CIA402_MAX_PDOS];
    /** COB-IDs of the TPDOs, as rpdo_cob_ids. */
    uint16_t tpdo_cob_ids[IGH_CIA402_MAX_PDOS];
    /** Must be 0; for fields of later versions. */
    uint64_t reserved[8];
} igh_cia402_axis_t;

/**
 * Fills an axis: CSP, with limits that allow its target step.
 *
 * @param axis         Is overwritten.
 * @param slave        Slave index of the gateway.
 * @param channel      Channel of the gateway, 0 to 3.
 * @param node_id      Node-ID of the drive, 1 to 127.
 * @param target_step  Steps per target that igh_cia402_send_target_step() makes; 0 for none.
 *
 * @usage   not rt, any thread, any time
 * @return  ECAN_OK; ECAN_ERR_ARGUMENT, with nothing filled, for a node-ID, channel or slave out
 *          of range.
 */
int igh_cia402_axis_init(igh_cia402_axis_t *axis,
                         size_t slave,
                         uint8_t channel,
                         uint8_t node_id,
                         int32_t target_step);

/* ---------------------------------------------------------------------------
 * Settings of all axes together
 * --------------------------------------------------------------------------- */

/** Treatment of a drive that is enabled at the first contact. */
typedef enum {
    /** The drive is quick-stopped, and disabled at rest. */
    IGH_CIA402_TAKEOVER_STOP = 0,
    /**
     * The drive remains enabled if it is at rest, has mode and process data of the configuration, and
     * takes a target that keeps it at standstill; otherwise the drive is stopped.
     */
    IGH_CIA402_TAKEOVER_ADOPT = 1
} igh_cia402_takeover_t;

/**
 * Common settings of the axes of a context. igh_cia402_default_settings() fills it; change
 * fields after it. Plain data: it may be copied and needs no deinit.
 */
typedef struct {
    /** Not for the application: marks filled settings. */
    uint64_t seal;
    /**
     * Fewest cycles from target to target (--motion-div); 0 counts as 1. The target period is the
     * least multiple of sync_every_cycles that is not below it. Default 1.
     */
    uint32_t motion_div;
    /** Cycles from SYNC to SYNC; 0 counts as 1. Default 1. */
    uint32_t sync_every_cycles;
    /**
     * Heartbeat of the host, in milliseconds; 0 sends none, and no drive detects a lost host.
     * Default 50.
     */
    uint32_t host_heartbeat_ms;
    /** Node-ID of the host's heartbeat, which no drive may have. Default 127. */
    uint8_t host_node_id;
    /**
     * SYNC with a counter from 1 to this value, 2 to 240, as in the drives' 0x1019; 0 sends
     * SYNC without data. Default 0.
     */
    uint8_t sync_counter_overflow;
    /** Most SDO frames and NMT commands per cycle and channel. Default 2. */
    uint8_t service_frames_per_cycle;
    /**
     * Number of pending frames of the channel in the gateway at which SDO frames wait, at most
     * 7. Default 7.
     */
    uint8_t sdo_pending_limit;
    /**
     * Bytes of each RxPDO image that SDO frames leave free for frames that the application
     * sends after the targets. Default 0.
     */
    uint32_t reserved_image_bytes;
    /** Size of the NMT command queue of a channel. Default 32. */
    uint32_t nmt_queue;
    /** Timeout for the response to an SDO request, in milliseconds. Default 500. */
    uint32_t sdo_timeout_ms;
    /** Longest value of an SDO transfer, in bytes. Default 1024. */
    uint32_t sdo_buffer_bytes;
    /**
     * Downloads with at least this number of bytes try block transfer; 0 never does. Default
     * 64.
     */
    uint32_t sdo_block_from;
    /** Number of retries of an SDO transfer without a response. Default 2. */
    uint8_t sdo_retries;
    /** 1: uploads request block transfer. Default 0. */
    uint8_t sdo_block_upload;
    /** Segments per block of a block upload, 1 to 127. Default 16. */
    uint8_t sdo_block_segments;
    /**
     * An igh_cia402_takeover_t: treatment of a drive that is enabled at the first contact.
     * Default IGH_CIA402_TAKEOVER_STOP.
     */
    uint8_t takeover;
    /** Must be 0; for fields of later versions. */
    uint64_t reserved[8];
} igh_cia402_settings_t;

/**
 * Fills settings: targets and SYNC in every cycle, a heartbeat of the host every 50 ms.
 *
 * @param settings  Is overwritten.
 *
 * @usage   not rt, any thread, any time
 */
int igh_cia402_default_settings(igh_cia402_settings_t *settings);

/* ---------------------------------------------------------------------------
 * Life of the axes
 *
 * igh_cia402_context_init(&motors, &mcan, axes, 2);
 * igh_cia402_send_nmt_all(&motors, IGH_CANOPEN_NMT_START);
 * igh_cia402_configure_csp_all_timeout(&motors, 10000);
 * igh_cia402_request_actual_position_all_timeout(&motors, 2000);
 * igh_cia402_enable_all_timeout(&motors, 5000);
 * ...                                              the cycle
 * if (igh_cia402_shutdown_timeout(&motors, 5000) != ECAN_OK) puts(ecan_last_error());
 * igh_cia402_context_deinit(&motors);
 * --------------------------------------------------------------------------- */

/**
 * CiA 402 axes on the gateways of a Port. Belongs to the thread of the cycle; do not move or copy
 * it. Ends with its igh_mcan_port_t at the latest.
 */
typedef struct {
    /** Not for the application. */
    uint64_t opaque[4];
} igh_cia402_context_t;

/**
 * Opens axes on a Port, with default settings. Nothing is sent; SYNC and the host's heartbeat
 * start with the first cycle.
 *
 * @param context     Any content; the manual's fragments leave it uninitialised.
 * @param port        The Port. Must not move while the axes are used.
 * @param axes        The axis table. Is copied.
 * @param axis_count  Its length.
 *
 * @usage   not rt, the cycle's thread, after igh_mcan_port_init
 * @return  ECAN_OK; ECAN_ERR_CONFIG with every fault of the table; ECAN_ERR_SLAVE,
 *          ECAN_ERR_CHANNEL for a slave or channel that the Port does not have;
 *          ECAN_ERR_NOT_INITIALISED for a Port, or an axis that is not filled; ECAN_ERR_ORDER for
 *          a context that is initialised already, or a Port that has axes.
 */
int igh_cia402_context_init(igh_cia402_context_t *context,
                            igh_mcan_port_t *port,
                            const igh_cia402_axis_t *axes,
                            size_t axis_count);

/**
 * As igh_cia402_context_init(), with settings of the application.
 *
 * @param settings  Is copied.
 *
 * @usage   not rt, the cycle's thread, after igh_mcan_port_init
 * @return  As igh_cia402_context_init().
 */
ECAN_MUST_CHECK
int igh_cia402_context_init_ex(igh_cia402_context_t *context,
                               igh_mcan_port_t *port,
                               const igh_cia402_axis_t *axes,
                               size_t axis_count,
                               const igh_cia402_settings_t *settings);

/**
 * Opens the axes and the CANopen nodes of a configuration file, `[[axis]]`, `[[node]]` and `[[bus]]`,
 * on a Port: that of igh_mcan_port_load_config(), or another one with the same gateways and channels.
 * Each node without an axis boots from the first cycle on, as igh_canopen.h describes; axes are
 * configured by igh_cia402_configure_csp_all_timeout().
 *
 * @param context   Any content.
 * @param port      The Port. Must not move while the axes are used.
 * @param path      Path of the file, relative to the working directory. Its device files are relative to
 *                  the file.
 * @param settings  Is copied; NULL for those of the table `[network]`. TIME is always that of the file.
 *
 * @usage   not rt, the cycle's thread, after igh_mcan_port_init
 * @return  As igh_cia402_context_init(); ECAN_ERR_FILE if the file cannot be read; ECAN_ERR_CONFIG
 *          with every fault of the file by line and column, or if a node has the node-ID of the
 *          host's heartbeat.
 */
ECAN_MUST_CHECK
int igh_cia402_context_init_file(igh_cia402_context_t *context,
                                 igh_mcan_port_t *port,
                                 const char *path,
                                 const igh_cia402_settings_t *settings);

/**
 * Closes the axes; the Port continues. Axes that may move are stopped before, as by
 * igh_cia402_stop_all_timeout() with the time of igh_cia402_set_stop_time_ms(). Drives that are off are not
 * released from their watch over the host: that is part of igh_cia402_shutdown_timeout().
 *
 * @usage   not rt, the cycle's thread, any time
 * @return  ECAN_OK, also for axes that are closed already or were never opened.
 *          Also for a copy of it, which ends nothing. ECAN_ERR_AXES names the axes that may still
 *          move, as a line on standard error does; they are closed nevertheless.
 */
int igh_cia402_context_deinit(igh_cia402_context_t *context);

/**
 * Sets the time for which igh_cia402_context_deinit(), igh_mcan_port_deinit() and ecan_igh_deinit() wait
 * until axes that may move have stopped.
 *
 * @param stop_time_ms  Milliseconds; the default is 10000. 0 leaves the axes as they are, for a program
 *                      whose successor adopts them.
 *
 * @usage   not rt, the cycle's thread, after init
 */
int igh_cia402_set_stop_time_ms(igh_cia402_context_t *context,
                                uint32_t stop_time_ms);

/**
 * Returns the number of axes.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  The number; 0 if there is no context.
 */
size_t igh_cia402_axis_count(igh_cia402_context_t *context);

/* ---------------------------------------------------------------------------
 * Progress of the calls that wait
 * --------------------------------------------------------------------------- */

/**
 * Sets a function to which the waiting calls report the progress of the axes: at their start, and
 * on every change. It runs inside these calls, between two cycles, so it should be quick; a call
 * to the library with this context returns ECAN_ERR_BUSY there.
 *
 * @param callback  Gets `user`, the axis, and a text, "axis 0, node 1 (slave 0, channel 0): being
 *                  enabled, switched on, for 120 ms" for example, which is valid until it returns;
 *                  NULL for none. It must return, as that of ecan_igh_stop_waiting_when().
 * @param user      Is passed to it, in the thread that waits.
 *
 * @usage   not rt, the cycle's thread, after init
 */
int igh_cia402_set_progress_callback(igh_cia402_context_t *context,
                                     void (*callback)(void *user, size_t axis, const char *text),
                                     void *user);

/* ---------------------------------------------------------------------------
 * Startup and shutdown that wait
 *
 * These calls run the cycle, with all axes at their last targets, until every axis has reached the
 * requested state or cannot reach it: not on a master of another owner, and not in a loop with
 * other work. There use the calls of the next section and igh_cia402_get_axis_state().
 * --------------------------------------------------------------------------- */

/**
 * Configures every drive in the mode of its axis, CSP by default, and waits: NMT, identity,
 * heartbeats, PDO mapping, limits, Operational, mode with confirmation. Drives that are configured
 * already stay unchanged. An enabled drive is disabled first.
 *
 * @param timeout_ms  Milliseconds.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  ECAN_OK; ECAN_ERR_AXES, where ecan_last_error() names each axis that is not
 *          configured, the step at which it stands and what its drive answered; ECAN_ERR_ATTACHED
 *          on a master of another owner; ECAN_ERR_ORDER if the bus is not active;
 *          ECAN_ERR_AXIS_STATE, ECAN_ERR_MASTER.
 */
int igh_cia402_configure_csp_all_timeout(igh_cia402_context_t *context, uint32_t timeout_ms);

/**
 * Determines the actual position of all axes from fresh TPDOs at rest, and waits. Rejects an axis
 * that is not configured.
 *
 * @param timeout_ms  Milliseconds.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes whose position
 *          is unknown, and the reason.
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
 *          enabled, with the state of each drive and the reason. Enabled axes stay enabled.
 */
int igh_cia402_enable_all_timeout(igh_cia402_context_t *context, uint32_t timeout_ms);

/**
 * Runs the three calls above: from drives in any state to axes that follow targets.
 *
 * @param timeout_ms  Milliseconds, for each of the three.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  As those calls.
 */
ECAN_MUST_CHECK int igh_cia402_start_up_timeout(igh_cia402_context_t *context, uint32_t timeout_ms);

/**
 * Waits until the changes of mode and the homings of all axes are done.
 *
 * @param timeout_ms  Milliseconds.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes whose last
 *          command failed, and the reason.
 */
ECAN_MUST_CHECK
int igh_cia402_finish_all_timeout(igh_cia402_context_t *context,
                                  uint32_t timeout_ms);

/**
 * Brings all axes back to their targets, as igh_cia402_recover() with IGH_CIA402_ALL_AXES, and waits.
 *
 * @param timeout_ms  Milliseconds.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes that do not
 *          follow targets, and the reason.
 */
ECAN_MUST_CHECK
int igh_cia402_recover_all_timeout(igh_cia402_context_t *context,
                                   uint32_t timeout_ms);

/**
 * Stops all axes, as igh_cia402_stop_all(), and waits until every one has reported that it has stopped, also
 * while the gateway or the path is away.
 *
 * @param timeout_ms  Milliseconds.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes that did not
 *          report that they have stopped, and may still move. Their stop continues in later cycles.
 */
ECAN_MUST_CHECK
int igh_cia402_stop_all_timeout(igh_cia402_context_t *context,
                                uint32_t timeout_ms);

/**
 * Shuts down in order, as igh_cia402_begin_shutdown(), and waits until every axis has reported that it is off.
 * While the gateway or the path is away, the whole time is used: at most half of it, and five seconds, for
 * the ramps.
 *
 * @param timeout_ms  Milliseconds.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes that could not
 *          be disabled, and may still move. The shutdown of the other axes is complete.
 */
ECAN_MUST_CHECK
int igh_cia402_shutdown_timeout(igh_cia402_context_t *context,
                                uint32_t timeout_ms);

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
 * An axis gets a target only if nothing prevents it: an incomplete working counter, a repeated
 * image, a step beyond the limit, a drive that is not enabled. If the reason is not temporary, the
 * axis holds; igh_cia402_enable() activates it again.
 * --------------------------------------------------------------------------- */

/** Offset of igh_cia402_set_scheduled_tx() for sending at once. */
#define IGH_CIA402_AT_ONCE 4294967295

/** Targets and SYNC messages of one cycle. */
typedef struct {
    /** Axes that got a target of the application, or their step. */
    uint32_t targets;
    /** Axes that got their actual position as target, while they are enabled or activated. */
    uint32_t positions;
    /** Active axes that got nothing in this cycle: their motion must not continue. */
    uint32_t waiting;
    /** Axes whose target was rejected. */
    uint32_t rejected;
    /** Axes that are not active, hold, or have no target due in this cycle. */
    uint32_t closed;
    /** SYNC messages. */
    uint32_t syncs;
    /** 1 if every axis got a target of the application. */
    uint8_t all_moved;
    /** Zero; for fields of later versions. */
    uint8_t reserved[23];
} igh_cia402_send_summary_t;

/**
 * Processes TPDOs, SDO responses, heartbeats and emergencies, and runs the next step of every
 * axis. First in the open cycle, in place of igh_mcan_port_receive(). Frames that do not belong to
 * the axes are dropped; igh_cia402_process_rx_ex() returns them. A further call in the same cycle does nothing.
 *
 * @usage   rt, the cycle's thread, in an open cycle
 * @return  ECAN_OK; ECAN_ERR_ORDER if no cycle is open.
 */
int igh_cia402_process_rx(igh_cia402_context_t *context);

/**
 * As igh_cia402_process_rx(); returns everything that belongs neither to the axes nor to their
 * network: frames of other nodes, other PDOs, transmit results (kind).
 *
 * @param rx        Gets the items.
 * @param capacity  Items that fit.
 * @param rx_count  Gets the number of items.
 *
 * @usage   rt, the cycle's thread, in an open cycle
 * @return  As igh_cia402_process_rx(); ECAN_ERR_BUFFER if not all items fit: the others are lost,
 *          everything else is done.
 */
int igh_cia402_process_rx_ex(igh_cia402_context_t *context,
                             igh_mcan_rx_frame_t *rx,
                             size_t capacity,
                             size_t *rx_count);

/**
 * Sends targets and commands of all axes, then SYNC, then pending NMT, SDO and heartbeat frames.
 * Last in the open cycle. A further call in the same cycle, of this function or of
 * igh_cia402_send_target_step(), sends nothing, and its summary counts every axis as closed: targets and
 * commands since the first call are those of the next cycle.
 *
 * @usage   rt, the cycle's thread, in an open cycle after igh_cia402_process_rx
 * @return  ECAN_OK; ECAN_ERR_ORDER if no cycle is open. igh_cia402_get_send_summary() reports the
 *          targets.
 */
int igh_cia402_send_targets_all(igh_cia402_context_t *context);

/**
 * As igh_cia402_send_targets_all(); moves every CSP axis by its own target step, which it reaches
 * by its ramp. An axis does not move in a cycle in which its target is not sent.
 *
 * @usage   rt, the cycle's thread, in an open cycle after igh_cia402_process_rx
 * @return  As igh_cia402_send_targets_all().
 */
int igh_cia402_send_target_step(igh_cia402_context_t *context);

/**
 * Gets the summary of the last igh_cia402_send_targets_all() or igh_cia402_send_target_step().
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_cia402_get_send_summary(igh_cia402_context_t *context, igh_cia402_send_summary_t *summary);

/**
 * Sends targets only in every n-th cycle (--motion-div); more if SYNC is sent less often, since a
 * target takes effect with a SYNC. Step limit, ramp and target step apply per target. Only while no
 * axis is configured: the configuration writes the target period to the drives (0x60C2).
 *
 * @param motion_div  Fewest cycles from target to target; 0 counts as 1.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_AXIS_STATE if an axis is configured or being configured;
 *          ECAN_ERR_CONFIG for a period that 0x60C2 cannot have (CSP).
 */
int igh_cia402_set_motion_div(igh_cia402_context_t *context, uint32_t motion_div);

/**
 * Sends targets and SYNC at phases of the Sync0 period instead of at once (manual 8.4, 13.8),
 * independently. Needs distributed clocks with Sync0. Only while no axis is active.
 *
 * A gateway drops a scheduled frame that arrives after its phase, and the drive keeps the previous
 * target: leave a margin.
 *
 * @param enable          0 sends both at once, for any offsets; else they are scheduled.
 * @param rpdo_offset_ns  Nanoseconds after Sync0 at which targets are sent, or IGH_CIA402_AT_ONCE.
 * @param sync_offset_ns  The same for SYNC. Before the targets, it applies those of the SYNC period
 *                        before, which take effect one SYNC period later.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_SCHEDULE without Sync0, beyond its period, or on a gateway that
 *          cannot; ECAN_ERR_AXIS_STATE while an axis is active. After an error everything is as it
 *          was.
 */
int igh_cia402_set_scheduled_tx(igh_cia402_context_t *context,
                                int enable,
                                uint32_t rpdo_offset_ns,
                                uint32_t sync_offset_ns);

/* ---------------------------------------------------------------------------
 * Targets
 *
 * A target stays until the next one. A hold drops it; after activation the axis stays at its
 * position until it gets a new target.
 * --------------------------------------------------------------------------- */

/**
 * Sets the target of an axis. igh_cia402_get_axis_state() reports the decision on it after the
 * targets were sent.
 *
 * @param target  Raw units of the mode: steps, velocity or torque.
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_cia402_set_target(igh_cia402_context_t *context, size_t axis, int32_t target);

/**
 * As igh_cia402_set_target(), with an angle by the axis' steps_per_turn and origin.
 *
 * @param radians  Radians of the axis.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  As igh_cia402_set_target(); ECAN_ERR_ARGUMENT for an angle without a position.
 */
int igh_cia402_set_target_radians(igh_cia402_context_t *context, size_t axis, double radians);

/**
 * Sets the step of igh_cia402_send_target_step(); the axis reaches it by its ramp.
 *
 * @param step  Steps per target. A step beyond the step limit is rejected when the ramp reaches it.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  As igh_cia402_set_target().
 */
int igh_cia402_set_target_step(igh_cia402_context_t *context, size_t axis, int32_t step);

/* ---------------------------------------------------------------------------
 * Further process data
 *
 * The RPDOs of an axis carry controlword and target, its TPDOs statusword and actual position.
 * igh_cia402_axis_t.outputs and inputs add objects, also in further PDOs, which the configuration maps.
 *
 * axes[0].outputs = IGH_CIA402_OUTPUT_VELOCITY_OFFSET | IGH_CIA402_OUTPUT_DIGITAL_OUTPUTS;
 * axes[0].inputs = IGH_CIA402_INPUT_VELOCITY | IGH_CIA402_INPUT_DIGITAL_INPUTS;
 * axes[0].feed_forward_velocity = 100000;
 * axes[0].feed_forward_velocity_change = 1000;
 * --------------------------------------------------------------------------- */

/** Object of the RPDOs of an axis beyond controlword and target. */
typedef enum {
    /** Velocity offset 0x60B1: feed-forward in CSP. */
    IGH_CIA402_OUTPUT_VELOCITY_OFFSET = 1,
    /** Torque offset 0x60B2: feed-forward in CSP and CSV. */
    IGH_CIA402_OUTPUT_TORQUE_OFFSET = 2,
    /** Touch probe function 0x60B8; needs IGH_CIA402_INPUT_PROBE_STATUS. */
    IGH_CIA402_OUTPUT_PROBE_FUNCTION = 4,
    /** Digital outputs 0x60FE:01. */
    IGH_CIA402_OUTPUT_DIGITAL_OUTPUTS = 8,
    /** Mode of operation 0x6060: the mode of the axis. */
    IGH_CIA402_OUTPUT_MODE = 16
} igh_cia402_output_t;

/** Object of the TPDOs of an axis beyond statusword and actual position. */
typedef enum {
    /** Actual velocity 0x606C, in units of the drive's velocity. */
    IGH_CIA402_INPUT_VELOCITY = 1,
    /** Actual torque 0x6077, in thousandths of the rated torque. */
    IGH_CIA402_INPUT_TORQUE = 2,
    /** Error code 0x603F. */
    IGH_CIA402_INPUT_ERROR_CODE = 4,
    /** Digital inputs 0x60FD. */
    IGH_CIA402_INPUT_DIGITAL_INPUTS = 8,
    /** Mode display 0x6061. */
    IGH_CIA402_INPUT_MODE_DISPLAY = 16,
    /** Following error 0x60F4 by the drive, in steps. */
    IGH_CIA402_INPUT_FOLLOWING_ERROR = 32,
    /** Touch probe status 0x60B9. */
    IGH_CIA402_INPUT_PROBE_STATUS = 64,
    /** Position at the positive edge of touch probe 1, 0x60BA. */
    IGH_CIA402_INPUT_PROBE_1_POSITIVE = 128,
    /** Position at the negative edge of touch probe 1, 0x60BB. */
    IGH_CIA402_INPUT_PROBE_1_NEGATIVE = 256,
    /** Position at the positive edge of touch probe 2, 0x60BC. */
    IGH_CIA402_INPUT_PROBE_2_POSITIVE = 512,
    /** Position at the negative edge of touch probe 2, 0x60BD. */
    IGH_CIA402_INPUT_PROBE_2_NEGATIVE = 1024,
    /** Actual velocity 0x6044 of VL. */
    IGH_CIA402_INPUT_VL_VELOCITY = 2048
} igh_cia402_input_t;

/**
 * As igh_cia402_set_target(), with a feed-forward for this target, which the drive adds to the demand of
 * its controllers. An offset whose object is not in `outputs` of the axis has no effect.
 *
 * The offsets are limited by the feed_forward fields of igh_cia402_axis_t and change by at most their
 * limit per target; igh_cia402_get_axis_state() has those that were sent. They belong to this target:
 * give them in every cycle. For a target without them they return to 0 by their changes; when the axis
 * holds or is stopped they end at once.
 *
 * @param target           Raw units of the mode.
 * @param velocity_offset  0x60B1, in units of the drive's velocity.
 * @param torque_offset    0x60B2, in thousandths of the rated torque.
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_cia402_set_target_with(igh_cia402_context_t *context,
                               size_t axis,
                               int32_t target,
                               int32_t velocity_offset,
                               int16_t torque_offset);

/**
 * Sets the digital outputs 0x60FE:01 of a drive, in every state of the axis. They are sent in every
 * target period, so that they also arrive after a fault of the communication path.
 *
 * @param outputs  The outputs; output_mask of igh_cia402_axis_t lets the host set them.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_AXIS_STATE without IGH_CIA402_OUTPUT_DIGITAL_OUTPUTS in `outputs` of the
 *          axis; ECAN_ERR_AXIS.
 */
int igh_cia402_set_digital_outputs(igh_cia402_context_t *context,
                                   size_t axis,
                                   uint32_t outputs);

/* ---------------------------------------------------------------------------
 * Touch probes
 *
 * A touch probe samples the actual position at edges of a signal. The axis needs
 * IGH_CIA402_OUTPUT_PROBE_FUNCTION, IGH_CIA402_INPUT_PROBE_STATUS, and the positions in its inputs.
 * --------------------------------------------------------------------------- */

/** Trigger of a touch probe; a sum. */
typedef enum {
    /** Samples positive edges. */
    IGH_CIA402_PROBE_POSITIVE = 1,
    /** Samples negative edges. */
    IGH_CIA402_PROBE_NEGATIVE = 2,
    /** Samples every edge; otherwise the first one only. */
    IGH_CIA402_PROBE_CONTINUOUS = 4,
    /** The index pulse of the encoder, in place of the input of the probe. */
    IGH_CIA402_PROBE_INDEX_PULSE = 8
} igh_cia402_probe_trigger_t;

/** State of a touch probe. */
typedef struct {
    /** Position at a positive edge since the probe was armed, in steps, if has_positive is 1. */
    int32_t positive;
    /** Position at a negative edge, likewise. */
    int32_t negative;
    /** 1 if the drive reports the probe as enabled, after the last command. */
    uint8_t is_armed;
    /** 1 if a position at a positive edge is stored. */
    uint8_t has_positive;
    /** 1 if a position at a negative edge is stored. */
    uint8_t has_negative;
    /** Zero; for fields of later versions. */
    uint8_t reserved[21];
} igh_cia402_probe_t;

/**
 * Arms a touch probe. One that is armed already is disabled first, so that a position of the last time is
 * never taken for a new one. igh_cia402_get_probe() returns the positions.
 *
 * @param probe    1 or 2.
 * @param trigger  Sum of igh_cia402_probe_trigger_t.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_AXIS_STATE without IGH_CIA402_OUTPUT_PROBE_FUNCTION in `outputs` of the
 *          axis; ECAN_ERR_ARGUMENT, ECAN_ERR_AXIS.
 */
int igh_cia402_arm_probe(igh_cia402_context_t *context,
                         size_t axis,
                         uint8_t probe,
                         uint8_t trigger);

/**
 * Disables a touch probe.
 *
 * @param probe  1 or 2.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  As igh_cia402_arm_probe().
 */
int igh_cia402_disarm_probe(igh_cia402_context_t *context, size_t axis, uint8_t probe);

/**
 * Gets the state of a touch probe.
 *
 * @param probe        1 or 2.
 * @param probe_state  Gets the state.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_ARGUMENT, ECAN_ERR_AXIS.
 */
int igh_cia402_get_probe(igh_cia402_context_t *context,
                         size_t axis,
                         uint8_t probe,
                         igh_cia402_probe_t *probe_state);

/* ---------------------------------------------------------------------------
 * Commands to axes
 *
 * Each call starts an operation and returns; the cycle continues it, and
 * igh_cia402_get_axis_state() reports the progress. With IGH_CIA402_ALL_AXES a command goes to every
 * axis, even after one that rejects it; the code is that of the first rejection.
 * --------------------------------------------------------------------------- */

/**
 * In place of the index of an axis in igh_cia402_configure(), _request_actual_position(), _enable(),
 * _disable(), _quick_stop(), _recover(), _reset_fault(), _halt() and _resume(): all axes.
 */
#define IGH_CIA402_ALL_AXES 4294967295

/**
 * Homing of an axis. igh_cia402_homing_init() fills it. Objects that a drive does not have are
 * skipped, except the method.
 */
typedef struct {
    /**
     * Speed during search for the switch, 0x6099:01, in the drive's units; 0 does not write
     * it.
     */
    uint32_t switch_speed;
    /** Speed during search for zero, 0x6099:02; 0 does not write it. */
    uint32_t zero_speed;
    /** Acceleration, 0x609A; 0 does not write it. */
    uint32_t acceleration;
    /** Home offset, 0x607C, in steps, if has_offset is 1. */
    int32_t offset;
    /** Timeout in milliseconds. Default 60000. */
    uint32_t timeout_ms;
    /**
     * Homing method, 0x6098: 35 and 37 use the present position as home, 1 to 34 search for
     * switches and index pulses, negative ones are the manufacturer's.
     */
    int8_t method;
    /** 1: the offset is written. Default 0. */
    uint8_t has_offset;
    /** Must be 0; for fields of later versions. */
    uint8_t reserved[26];
} igh_cia402_homing_t;

/**
 * Sends an NMT command to all nodes of the channels with axes, with the next targets. After any
 * command except IGH_CANOPEN_NMT_START the axes hold. The configuration of a drive sends the
 * commands that it needs.
 *
 * @param command  An igh_canopen_nmt_t.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_CANOPEN if the command queue is full; ECAN_ERR_ARGUMENT.
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
 * Starts configuring a drive, even if it is configured: after a restart, for example. An enabled
 * drive is disabled first. With IGH_CIA402_ALL_AXES only drives that are not configured.
 * igh_cia402_configure_csp_all_timeout() also waits.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_AXIS_STATE, ECAN_ERR_AXIS.
 */
int igh_cia402_configure(igh_cia402_context_t *context, size_t axis);

/**
 * Starts determining the actual position of an axis: waits for pending frames, then for fresh TPDOs
 * at rest. igh_cia402_request_actual_position_all_timeout() also waits.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_AXIS_STATE for an axis that is not configured, changes its mode or
 *          is homing; ECAN_ERR_AXIS.
 */
int igh_cia402_request_actual_position(igh_cia402_context_t *context, size_t axis);

/**
 * Starts enabling all drives and activating axes that hold; active axes continue. The same as
 * igh_cia402_enable() with IGH_CIA402_ALL_AXES, under the manual's name (15.5.4).
 * igh_cia402_enable_all_timeout() also waits.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  As igh_cia402_request_actual_position().
 */
int igh_cia402_enable_all(igh_cia402_context_t *context);

/**
 * Starts enabling a drive, or activating an axis that holds: its actual position is determined and
 * is its first target. A drive in fault is not enabled: call igh_cia402_reset_fault() first. After
 * enable_timeout_ms the drive is disabled again.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  As igh_cia402_request_actual_position().
 */
int igh_cia402_enable(igh_cia402_context_t *context, size_t axis);

/**
 * Stops targets at once and disables a drive; 0x605C determines how it stops. igh_cia402_halt()
 * brings it to rest before.
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_cia402_disable(igh_cia402_context_t *context, size_t axis);

/**
 * Brings all axes to rest and keeps them enabled, the CSP axes together on their path; targets are
 * ignored until igh_cia402_resume().
 *
 * The active CSP axes continue straight in the direction of their last targets and decelerate by
 * one profile that keeps the acceleration and jerk limits of every axis. If one of them holds, leaves
 * Operation enabled, is resumed or cannot move on, the others stop by their own ramps. All other
 * axes stop as by igh_cia402_halt().
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_cia402_stop_together(igh_cia402_context_t *context);

/**
 * Stops targets at once and commands a quick stop, as 0x605A of the drive determines; the drive of
 * an axis that is not configured is switched off at rest. igh_cia402_enable() activates the axis
 * again.
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_cia402_quick_stop(igh_cia402_context_t *context, size_t axis);

/**
 * Stops all axes as fast as their drives can, by quick stop, and disables the drives when they are
 * at rest. Acts on axes in every state. igh_cia402_all_stopped() reports the result.
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_cia402_stop_all(igh_cia402_context_t *context);

/**
 * Starts bringing an axis back to its targets, from a hold, a stop, a fault or a lost configuration,
 * and from the very beginning: waits for a pending stop, configures, resets a fault, enables, and
 * resumes a halted axis. Any other command to the axis ends it. It ends without success, with
 * axis_error, if a fault persists after one reset or another one follows, if the configuration
 * fails twice, if the drive does not answer and may be moving, or if enabling fails three times.
 * igh_cia402_recover_all_timeout() also waits.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_AXIS_STATE during a change of mode, homing or shutdown; ECAN_ERR_AXIS.
 */
int igh_cia402_recover(igh_cia402_context_t *context,
                       size_t axis);

/**
 * Resets the fault of a drive. Does not enable it, and does nothing if the drive has no fault.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  As igh_cia402_request_actual_position().
 */
int igh_cia402_reset_fault(igh_cia402_context_t *context, size_t axis);

/**
 * Brings an active axis to rest and keeps it enabled: in CSP by its ramp, in CSV and CST by
 * reducing the target to 0 in steps of the limit, in PP, PV and PT by the halt bit. Targets are
 * ignored until igh_cia402_resume().
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_cia402_halt(igh_cia402_context_t *context, size_t axis);

/**
 * Lets a halted axis follow targets again.
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_cia402_resume(igh_cia402_context_t *context, size_t axis);

/**
 * Starts changing the mode of a drive, confirmed by its mode display. An active axis is brought to
 * rest and disabled before, and enabled again after the change. A hold while it comes to
 * rest ends the change, and the drive stays disabled.
 *
 * @param mode  An igh_cia402_mode_t whose target is in the mapped process data of the axis; not
 *              homing, which igh_cia402_home() does.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  As igh_cia402_request_actual_position(), ECAN_ERR_AXIS_STATE also for a mode that
 *          is not mapped; ECAN_ERR_ARGUMENT.
 */
int igh_cia402_change_mode(igh_cia402_context_t *context, size_t axis, int mode);

/**
 * Fills a homing: a method with the drive's own speeds, and a timeout of one minute.
 *
 * @param homing  Is overwritten.
 * @param method  Homing method, 0x6098.
 *
 * @usage   rt, any thread, any time
 */
int igh_cia402_homing_init(igh_cia402_homing_t *homing, int8_t method);

/**
 * Starts homing: rest, disable, parameters and mode, enable, homing, disable, the previous mode,
 * and enable again if it was enabled. The axis then becomes active at the position of its counter.
 * A hold before the drive is disabled ends the homing.
 *
 * @param homing  Is copied.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  As igh_cia402_request_actual_position().
 */
int igh_cia402_home(igh_cia402_context_t *context, size_t axis, const igh_cia402_homing_t *homing);

/**
 * Starts an orderly shutdown: every axis comes to rest by its ramp and is disabled and released,
 * so that no drive reports a fault when the host exits. Continue the cycle until
 * igh_cia402_shutdown_is_done(). A stage that an axis cannot finish ends after five seconds.
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_cia402_begin_shutdown(igh_cia402_context_t *context);

/* ---------------------------------------------------------------------------
 * Values of an axis' state
 * --------------------------------------------------------------------------- */

/** Phase of an axis. */
typedef enum {
    /** Not configured yet, or not any more after a restart of the drive. */
    IGH_CIA402_PHASE_NOT_CONFIGURED = 0,
    /** Its configuration is in progress. */
    IGH_CIA402_PHASE_CONFIGURING = 1,
    /** Its mode is written; the confirmation is pending. */
    IGH_CIA402_PHASE_SETTING_MODE = 2,
    /** Its configuration failed. */
    IGH_CIA402_PHASE_SETUP_FAILED = 3,
    /** Configured, without a command. */
    IGH_CIA402_PHASE_STANDBY = 4,
    /** Its actual position is being determined. */
    IGH_CIA402_PHASE_READING = 5,
    /** Its actual position is known; the drive is not enabled. */
    IGH_CIA402_PHASE_READY = 6,
    /** The drive is being enabled. */
    IGH_CIA402_PHASE_ENABLING = 7,
    /** Active: follows targets. */
    IGH_CIA402_PHASE_RUNNING = 8,
    /** At rest, or being brought to rest, by igh_cia402_halt(). */
    IGH_CIA402_PHASE_HALTED = 9,
    /** Holds: gets no targets until it is activated again; see hold_reason. */
    IGH_CIA402_PHASE_HOLDING = 10,
    /** The drive is being stopped; see stop_cause. */
    IGH_CIA402_PHASE_STOPPING = 11,
    /** The drive has stopped: it is off, or at rest after a quick stop; see stop_cause. */
    IGH_CIA402_PHASE_STOPPED = 12,
    /** A fault is being reset. */
    IGH_CIA402_PHASE_RESETTING_FAULT = 13,
    /** The drive has a fault. */
    IGH_CIA402_PHASE_FAULT = 14,
    /** The mode is being changed. */
    IGH_CIA402_PHASE_CHANGING_MODE = 15,
    /** Homing is being prepared or completed. */
    IGH_CIA402_PHASE_PREPARING_HOMING = 16,
    /** Homing. */
    IGH_CIA402_PHASE_HOMING = 17,
    /** The drive is to be stopped, may be moving, and reports nothing; the stop is repeated. */
    IGH_CIA402_PHASE_UNCONTROLLED = 18,
    /** First contact: the state of the drive is read before anything else is sent. */
    IGH_CIA402_PHASE_INSPECTING = 19,
    /** Another one. */
    IGH_CIA402_PHASE_OTHER = 255
} igh_cia402_phase_t;

/** Decision on an axis' target. */
typedef enum {
    /** The axis is not active, or holds: no target. */
    IGH_CIA402_DECISION_CLOSED = 0,
    /** The drive is not enabled: it got its own actual position. */
    IGH_CIA402_DECISION_TRACK = 1,
    /** The first target of an enabled drive: its actual position. */
    IGH_CIA402_DECISION_FIRST = 2,
    /** The application's target was sent, or the last one again if there is no new one. */
    IGH_CIA402_DECISION_TARGET = 3,
    /** No target in this cycle; decision_reason is an igh_cia402_wait_t. */
    IGH_CIA402_DECISION_WAIT = 4,
    /** The target was rejected; decision_reason is an igh_cia402_rejection_t. */
    IGH_CIA402_DECISION_REJECTED = 5
} igh_cia402_decision_t;

/** Reason why an active axis got nothing in a cycle. Its motion must not continue. */
typedef enum {
    /** The working counter of this cycle is incomplete. */
    IGH_CIA402_WAIT_WORKING_COUNTER = 1,
    /** The last image is unconfirmed and is repeated. */
    IGH_CIA402_WAIT_IMAGE_UNCONFIRMED = 2,
    /** The first target must be an actual position of this cycle, and there is none. */
    IGH_CIA402_WAIT_NO_FRESH_POSITION = 3,
    /** The drive has an old target, far from the axis: it must be disabled first. */
    IGH_CIA402_WAIT_HOLDS_OLD_TARGET = 4,
    /** The image of the last cycle had no room for a frame of the channel. */
    IGH_CIA402_WAIT_IMAGE_FULL = 5,
    /** The target of this cycle was sent already. */
    IGH_CIA402_WAIT_SPENT = 6,
    /** A frame was rejected in this cycle; the axis will hold. */
    IGH_CIA402_WAIT_FRAME_REJECTED = 7,
    /**
     * No target is due: the target period has not ended, or the cycle has no SYNC. Not a
     * disturbance: the motion continues.
     */
    IGH_CIA402_WAIT_NOT_DUE = 8,
    /** Frames that were sent before still wait in the gateway: the bus is occupied. */
    IGH_CIA402_WAIT_BACKLOG = 11,
    /** igh_cia402_process_rx() was not called in this cycle. */
    IGH_CIA402_WAIT_NOT_RECEIVED = 9,
    /** Another axis of igh_cia402_stop_together() cannot get a target in this cycle. */
    IGH_CIA402_WAIT_TOGETHER = 10
} igh_cia402_wait_t;

/** Reason why a target was rejected. The previous target stays. */
typedef enum {
    /** Too far from the target before. */
    IGH_CIA402_REJECTION_STEP = 1,
    /** Too far from the actual position. */
    IGH_CIA402_REJECTION_WINDOW = 2,
    /** Outside the bounds of the axis. */
    IGH_CIA402_REJECTION_BOUNDS = 3,
    /** The position counter does not have this position. */
    IGH_CIA402_REJECTION_COUNTER = 4,
    /** The mode has no targets. */
    IGH_CIA402_REJECTION_NO_TARGETS = 5,
    /** Another reason. */
    IGH_CIA402_REJECTION_OTHER = 255
} igh_cia402_rejection_t;

/** Reason of a hold: the axis gets no targets until igh_cia402_enable(). */
typedef enum {
    /** It does not hold. */
    IGH_CIA402_HOLD_NONE = 0,
    /** The gateway is not ready any more. */
    IGH_CIA402_HOLD_GATEWAY_LOST = 1,
    /** Pending frames were discarded, possibly with a target. */
    IGH_CIA402_HOLD_FRAMES_DISCARDED = 2,
    /** The working counter stayed incomplete for longer than wc_misses. */
    IGH_CIA402_HOLD_WORKING_COUNTER = 3,
    /** The channel went bus-off. */
    IGH_CIA402_HOLD_BUS_OFF = 4,
    /** The channel stopped without being bus-off. */
    IGH_CIA402_HOLD_CHANNEL_STOPPED = 5,
    /** The gateway's transmit queue was full. */
    IGH_CIA402_HOLD_QUEUE_FULL = 6,
    /** The gateway reported a target as not sent. */
    IGH_CIA402_HOLD_TARGET_LOST = 7,
    /** The drive's heartbeat was lost. */
    IGH_CIA402_HOLD_HEARTBEAT_LOST = 8,
    /** The drive is not Operational, or restarted. */
    IGH_CIA402_HOLD_NOT_OPERATIONAL = 9,
    /** The drive was unreachable, and its configuration is being verified. */
    IGH_CIA402_HOLD_UNVERIFIED = 10,
    /** No usable TPDO for longer than tpdo_timeout. */
    IGH_CIA402_HOLD_TPDO_LOST = 11,
    /** The drive left Operation Enabled. */
    IGH_CIA402_HOLD_LEFT_OPERATION_ENABLED = 12,
    /** The drive stopped following its target. */
    IGH_CIA402_HOLD_NOT_FOLLOWING = 13,
    /** The drive reports a following error. */
    IGH_CIA402_HOLD_FOLLOWING_ERROR = 14,
    /** The application commanded it. */
    IGH_CIA402_HOLD_COMMANDED = 16,
    /** TPDOs were missing, and the drive is not at its last target. */
    IGH_CIA402_HOLD_NOT_AT_TARGET = 17,
    /** Another reason. */
    IGH_CIA402_HOLD_OTHER = 255
} igh_cia402_hold_t;

/** Cause of a stop. */
typedef enum {
    /** No stop is pending or complete. */
    IGH_CIA402_STOP_CAUSE_NONE = 0,
    /** igh_cia402_quick_stop(). */
    IGH_CIA402_STOP_CAUSE_QUICK_STOP = 1,
    /** igh_cia402_disable(). */
    IGH_CIA402_STOP_CAUSE_DISABLE = 2,
    /** igh_cia402_stop_all(). */
    IGH_CIA402_STOP_CAUSE_ALL = 3,
    /** igh_cia402_begin_shutdown(). */
    IGH_CIA402_STOP_CAUSE_SHUTDOWN = 4,
    /** The axis held in a mode in which its drive would continue to move; see hold_reason. */
    IGH_CIA402_STOP_CAUSE_HELD = 5,
    /** A change of mode, or homing. */
    IGH_CIA402_STOP_CAUSE_PROCEDURE = 6,
    /** The drive was not enabled in time. */
    IGH_CIA402_STOP_CAUSE_ENABLE_TIMED_OUT = 7,
    /** igh_cia402_configure() of an enabled drive. */
    IGH_CIA402_STOP_CAUSE_CONFIGURE = 8,
    /** The drive was enabled at the first contact, or has another configuration. */
    IGH_CIA402_STOP_CAUSE_TAKEOVER = 9,
    /** Another cause. */
    IGH_CIA402_STOP_CAUSE_OTHER = 255
} igh_cia402_stop_cause_t;

/** Error of the last command to an axis; igh_cia402_get_axis_text() gives details. */
typedef enum {
    /** No error. */
    IGH_CIA402_AXIS_ERROR_NONE = 0,
    /** The configuration failed. */
    IGH_CIA402_AXIS_ERROR_SETUP = 1,
    /** The drive restarted and lost its configuration. */
    IGH_CIA402_AXIS_ERROR_RESTARTED = 2,
    /** The drive did not reach Operation Enabled in time. */
    IGH_CIA402_AXIS_ERROR_ENABLE_TIMED_OUT = 3,
    /** The drive has a fault; error_code. */
    IGH_CIA402_AXIS_ERROR_FAULT = 4,
    /** The drive stays in fault after a reset; error_code. */
    IGH_CIA402_AXIS_ERROR_RESET_FAILED = 5,
    /** The axis held; hold_reason. */
    IGH_CIA402_AXIS_ERROR_HELD = 6,
    /** Homing ended without a home position. */
    IGH_CIA402_AXIS_ERROR_HOMING = 7,
    /** Homing timed out. */
    IGH_CIA402_AXIS_ERROR_HOMING_TIMED_OUT = 8,
    /** The drive rejected a mode. */
    IGH_CIA402_AXIS_ERROR_MODE = 9,
    /** The drive was not disabled in time. */
    IGH_CIA402_AXIS_ERROR_NOT_DISABLED = 10,
    /** The drive was enabled when it reported last, and does not answer. */
    IGH_CIA402_AXIS_ERROR_NOT_STOPPED = 11,
    /** Another one. */
    IGH_CIA402_AXIS_ERROR_OTHER = 255
} igh_cia402_axis_error_t;

/** State of a node's heartbeat. */
typedef enum {
    /** Not monitored. */
    IGH_CANOPEN_HEARTBEAT_UNCONFIGURED = 0,
    /** None since monitoring started or the node booted. */
    IGH_CANOPEN_HEARTBEAT_UNKNOWN = 1,
    /** Received in time. */
    IGH_CANOPEN_HEARTBEAT_ACTIVE = 2,
    /** Lost. */
    IGH_CANOPEN_HEARTBEAT_TIMED_OUT = 3
} igh_canopen_heartbeat_t;

/* ---------------------------------------------------------------------------
 * State of the axes
 * --------------------------------------------------------------------------- */

/** State of an axis. */
typedef struct {
    /** Time in this phase, in milliseconds. */
    uint64_t for_ms;
    /**
     * Target minus actual position, in steps, if has_target and has_actual are 1. It contains the
     * transport times, two cycles or more; the drive's own following error is in 0x60F4.
     */
    int64_t following_error;
    /** Actual position in radians, if has_actual is 1. */
    double actual_radians;
    /** Last usable actual position, in steps, if has_actual is 1. */
    int32_t actual;
    /** Last sent target, if has_target is 1; the reference of the next one. */
    int32_t target;
    /** Actual velocity 0x606C; this and the next fields by `inputs`. */
    int32_t velocity;
    /** Following error 0x60F4 by the drive, in steps. */
    int32_t drive_following_error;
    /** Digital inputs 0x60FD. */
    uint32_t digital_inputs;
    /** Velocity offset 0x60B1 that was sent last. */
    int32_t velocity_offset;
    /**
     * Inputs with a value: sum of igh_cia402_input_t. A value is that of the last TPDO with the
     * object since the configuration.
     */
    uint32_t inputs;
    /** Age of the actual position in cycles: 0 for this cycle, 65535 for more or never. */
    uint16_t actual_age;
    /** Last statusword of any age, if has_statusword is 1. */
    uint16_t statusword;
    /**
     * Error code of the last emergency message, 0x8611 for example; 0 for none, or after the node
     * reset it.
     */
    uint16_t error_code;
    /** Slave index of the gateway. */
    uint16_t slave;
    /** Actual torque 0x6077, in thousandths of the rated torque. */
    int16_t torque;
    /** Torque offset 0x60B2 that was sent last. */
    int16_t torque_offset;
    /** Error code 0x603F in the TPDO. */
    uint16_t drive_error_code;
    /** Touch probe status 0x60B9; igh_cia402_get_probe() has the positions. */
    uint16_t probe_status;
    /** Actual velocity 0x6044 of VL. */
    int16_t vl_velocity;
    /** Channel of the gateway. */
    uint8_t channel;
    /** Node-ID of the drive. */
    uint8_t node_id;
    /** An igh_cia402_mode_t: the confirmed mode; before that, the mode of the axis table. */
    int8_t mode;
    /** An igh_cia402_phase_t. */
    uint8_t phase;
    /** An igh_cia402_drive_state_t, by the last statusword. */
    uint8_t drive_state;
    /** An igh_canopen_nmt_state_t. */
    uint8_t nmt_state;
    /** An igh_canopen_heartbeat_t. */
    uint8_t heartbeat;
    /** An igh_cia402_decision_t: decision on the last target. */
    uint8_t decision;
    /** Reason of the decision: an igh_cia402_wait_t or igh_cia402_rejection_t; else 0. */
    uint8_t decision_reason;
    /** An igh_cia402_hold_t: reason of the hold. */
    uint8_t hold_reason;
    /** An igh_cia402_axis_error_t: error of the last command. */
    uint8_t axis_error;
    /** 1 if the drive is configured. */
    uint8_t is_configured;
    /** 1 if the axis follows the application's targets; 0 while it is halted. */
    uint8_t is_running;
    /** 1 if a halted axis is at rest, and if it is not active. */
    uint8_t is_at_rest;
    /** 1 if a drive with its own trajectory (PP, PV, PT) has reached the target; 0 in cyclic modes. */
    uint8_t is_target_reached;
    /** 1 if there is an actual position. */
    uint8_t has_actual;
    /** 1 if the axis follows targets and has one. */
    uint8_t has_target;
    /** 1 if a statusword was received. */
    uint8_t has_statusword;
    /** An igh_cia402_stop_cause_t: cause of the stop that is pending or complete. */
    uint8_t stop_cause;
    /** 1 if the drive has stopped; see igh_cia402_all_stopped(). */
    uint8_t is_stopped;
    /** 1 while igh_cia402_recover() continues. */
    uint8_t is_recovering;
    /** Mode display 0x6061, as the drive reports it in the TPDO. */
    int8_t mode_display;
    /** Zero; for fields of later versions. */
    uint8_t reserved[28];
} igh_cia402_axis_state_t;

/**
 * Gets the state of an axis.
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_cia402_get_axis_state(igh_cia402_context_t *context,
                              size_t axis,
                              igh_cia402_axis_state_t *axis_state);

/**
 * Gets the state of an axis as text, with its time and the reason if it does not continue: "axis
 * 2, node 5 (slave 0, channel 1): being enabled, switched on, for 120 ms" for example.
 *
 * @param text  See the rules for texts in igh_ecan_common.h.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_BUFFER.
 */
int igh_cia402_get_axis_text(igh_cia402_context_t *context,
                             size_t axis,
                             char *text,
                             size_t size,
                             size_t *needed);

/**
 * Returns 1 if all axes follow the application's targets; 0 while one is halted.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  1 or 0, also 0 without any axis; 0 after an error, which ecan_last_error_code() gives.
 */
int igh_cia402_all_running(igh_cia402_context_t *context);

/**
 * Returns 1 if all axes have stopped: every drive reported that it is off or at rest after a quick
 * stop, or never reported anything and is not being configured.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  1 or 0; 0 after an error, which ecan_last_error_code() gives.
 */
int igh_cia402_all_stopped(igh_cia402_context_t *context);

/**
 * Returns 1 if the shutdown of igh_cia402_begin_shutdown() is complete, and the host may exit.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  1 or 0; 0 after an error, which ecan_last_error_code() gives.
 */
int igh_cia402_shutdown_is_done(igh_cia402_context_t *context);

/* ---------------------------------------------------------------------------
 * Reaction of the drives to the loss of the host
 * --------------------------------------------------------------------------- */

/** Detection of the loss of the host by a drive. */
typedef enum {
    /** None: the stop options of the drive were not read yet. */
    IGH_CIA402_HOST_WATCH_UNREAD = 0,
    /** None: the host sends no heartbeat. */
    IGH_CIA402_HOST_WATCH_NO_HEARTBEAT = 1,
    /** None: 0x1016 has no entry for the node-ID of the host. */
    IGH_CIA402_HOST_WATCH_NO_ENTRY = 2,
    /** By 0x1016, after watch_ms without a heartbeat. */
    IGH_CIA402_HOST_WATCH_ACTIVE = 3,
    /** By life guarding, after watch_ms without a request of the host. */
    IGH_CIA402_HOST_WATCH_GUARDED = 4,
    /** Another one. */
    IGH_CIA402_HOST_WATCH_OTHER = 255
} igh_cia402_host_watch_t;

/** Reaction of an enabled drive to the loss of the host. */
typedef enum {
    /** Unknown: not read yet, or an object is missing or manufacturer-specific. */
    IGH_CIA402_HOST_LOSS_REACTION_UNKNOWN = 0,
    /** Quick stop, with `ramp`. */
    IGH_CIA402_HOST_LOSS_REACTION_QUICK_STOP = 1,
    /** Stops with `ramp`, then Fault. */
    IGH_CIA402_HOST_LOSS_REACTION_FAULT = 2,
    /** Switches power off; the motor coasts. */
    IGH_CIA402_HOST_LOSS_REACTION_COASTS = 3,
    /** Keeps its last target position. */
    IGH_CIA402_HOST_LOSS_REACTION_HOLDS_POSITION = 4,
    /** Continues with the last velocity or torque; in PP it moves to the end of its set-points. */
    IGH_CIA402_HOST_LOSS_REACTION_RUNS_ON = 5,
    /** Another one. */
    IGH_CIA402_HOST_LOSS_REACTION_OTHER = 255
} igh_cia402_host_loss_reaction_t;

/** Deceleration of a drive. */
typedef enum {
    /** Nothing: it does not stop by a ramp. */
    IGH_CIA402_STOP_RAMP_NONE = 0,
    /** Profile deceleration, 0x6084. */
    IGH_CIA402_STOP_RAMP_PROFILE = 1,
    /** Quick stop deceleration, 0x6085. */
    IGH_CIA402_STOP_RAMP_QUICK_STOP = 2,
    /** Current limit of the drive. */
    IGH_CIA402_STOP_RAMP_CURRENT_LIMIT = 3,
    /** Voltage limit of the drive. */
    IGH_CIA402_STOP_RAMP_VOLTAGE_LIMIT = 4,
    /** Another one. */
    IGH_CIA402_STOP_RAMP_OTHER = 255
} igh_cia402_stop_ramp_t;

/**
 * Reaction of a drive to the loss of the host, by the options that it reported at the end of its
 * configuration, in the present mode.
 */
typedef struct {
    /**
     * Time without a heartbeat or a guarding request of the host after which the drive reacts, in
     * milliseconds, if `watch` is IGH_CIA402_HOST_WATCH_ACTIVE or IGH_CIA402_HOST_WATCH_GUARDED; else 0.
     */
    uint32_t watch_ms;
    /** Deceleration in units of the drive, if has_deceleration is 1. */
    uint32_t deceleration;
    /** An igh_cia402_host_watch_t. */
    uint8_t watch;
    /** An igh_cia402_host_loss_reaction_t. */
    uint8_t reaction;
    /** An igh_cia402_stop_ramp_t. */
    uint8_t ramp;
    /** 1 if 0x6084 or 0x6085 determines the deceleration, and the drive has the object. */
    uint8_t has_deceleration;
    /**
     * 1 if the drive brings the motor to rest and controls it until then; 0 if it runs on or coasts,
     * and if the reaction is unknown.
     */
    uint8_t is_controlled_stop;
    /** Zero; for fields of later versions. */
    uint8_t reserved[19];
} igh_cia402_host_loss_info_t;

/**
 * Gets the reaction of a drive to the loss of the host: its end, its crash, or the loss of the
 * link.
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_cia402_get_host_loss(igh_cia402_context_t *context,
                             size_t axis,
                             igh_cia402_host_loss_info_t *host_loss);

/**
 * Gets the reaction of a drive to the loss of the host as text: "axis 2, node 5 (slave 0, channel
 * 1), CSV: runs on if the host is lost (the host sends no heartbeat)" for example.
 *
 * @param text  See the rules for texts in igh_ecan_common.h.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_BUFFER.
 */
int igh_cia402_get_host_loss_text(igh_cia402_context_t *context,
                                  size_t axis,
                                  char *text,
                                  size_t size,
                                  size_t *needed);

/* ---------------------------------------------------------------------------
 * Limits and units of drives
 *
 * Read from a drive at the end of its configuration, if use_drive_limits or scale_source of
 * igh_cia402_axis_t ask for it.
 * --------------------------------------------------------------------------- */

/** Difference between the scale of an axis and the units of its drive. */
typedef enum {
    /** None, or not compared. */
    IGH_CIA402_SCALE_FINDING_NONE = 0,
    /** The drive has no units by which the scale can be compared. */
    IGH_CIA402_SCALE_FINDING_UNAVAILABLE = 1,
    /** The steps per turn differ. */
    IGH_CIA402_SCALE_FINDING_STEPS_PER_TURN = 2,
    /** The velocity units differ. */
    IGH_CIA402_SCALE_FINDING_VELOCITY_UNITS = 3,
    /** Another one. */
    IGH_CIA402_SCALE_FINDING_OTHER = 255
} igh_cia402_scale_finding_t;

/** Limits of a drive, and those in force for the targets of its axis. */
typedef struct {
    /** Software position limit 0x607D:01 of the drive, in steps, if has_position is 1. */
    int32_t position_min;
    /** Software position limit 0x607D:02. Both without effect if the first is not below the second. */
    int32_t position_max;
    /** Largest speed of the motor 0x6080, in revolutions per minute, if has_max_motor_speed is 1. */
    uint32_t max_motor_speed;
    /** In force: largest distance between consecutive targets; 0xFFFFFFFF for none. */
    uint32_t step_limit;
    /** In force: smallest target, if has_bounds is 1. */
    int32_t bound_min;
    /** In force: largest target, if has_bounds is 1. */
    int32_t bound_max;
    /** Largest torque 0x6072, in thousandths of the rated torque, if has_max_torque is 1. */
    uint16_t max_torque;
    /** 1 if the limits of the drive were read. */
    uint8_t is_read;
    /** 1 if the drive has 0x607D. */
    uint8_t has_position;
    /** 1 if the drive has 0x6080. */
    uint8_t has_max_motor_speed;
    /** 1 if the drive has 0x6072. */
    uint8_t has_max_torque;
    /** 1 if bounds are in force. */
    uint8_t has_bounds;
    /** Zero; for fields of later versions. */
    uint8_t reserved[17];
} igh_cia402_drive_limits_t;

/** Units of a drive. Values of an object that the drive does not have are 0. */
typedef struct {
    /** Steps per turn of the shaft by 0x608F, 0x6091 and 0x6092; 0 if they are unknown. */
    double steps_per_turn;
    /** Units of velocity for one turn of the shaft per second, by 0x60A9; 0 if they are unknown. */
    double velocity_units;
    /** Encoder resolution 0x608F: increments ... */
    uint32_t encoder_increments;
    /** ... per motor revolutions. */
    uint32_t encoder_revolutions;
    /** Gear ratio 0x6091: motor revolutions ... */
    uint32_t gear_motor;
    /** ... per revolutions of the shaft. */
    uint32_t gear_shaft;
    /** Feed constant 0x6092: position units ... */
    uint32_t feed_units;
    /** ... per revolutions of the shaft. */
    uint32_t feed_revolutions;
    /** SI unit of positions 0x60A8. */
    uint32_t position_unit;
    /** SI unit of velocities 0x60A9. */
    uint32_t velocity_unit;
    /** 1 if the units were read. */
    uint8_t is_read;
    /** An igh_cia402_scale_finding_t; igh_cia402_get_scale_text() describes it. */
    uint8_t finding;
    /** Zero; for fields of later versions. */
    uint8_t reserved[30];
} igh_cia402_drive_units_t;

/**
 * Gets the limits of a drive, and those in force for the targets of its axis.
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_cia402_get_drive_limits(igh_cia402_context_t *context,
                                size_t axis,
                                igh_cia402_drive_limits_t *limits);

/**
 * Gets the units of a drive.
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_cia402_get_drive_units(igh_cia402_context_t *context,
                               size_t axis,
                               igh_cia402_drive_units_t *units);

/**
 * Gets the difference between the scale of an axis and the units of its drive as text: "steps_per_turn
 * is 360, the drive has 65536" for example. Empty without a difference.
 *
 * @param text  See the rules for texts in igh_ecan_common.h.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK, ECAN_ERR_BUFFER.
 */
int igh_cia402_get_scale_text(igh_cia402_context_t *context,
                              size_t axis,
                              char *text,
                              size_t size,
                              size_t *needed);

/* ---------------------------------------------------------------------------
 * Counters and bus load
 *
 * Counters only grow.
 * --------------------------------------------------------------------------- */

/** Overload of a channel. */
typedef enum {
    /** No overload. */
    IGH_CIA402_LOAD_OK = 0,
    /** Less than 10 % is left for SDO, heartbeats and emergencies. */
    IGH_CIA402_LOAD_NO_RESERVE = 1,
    /** In the worst case of stuff bits the bus is too slow for a cycle. */
    IGH_CIA402_LOAD_TIGHT = 2,
    /** More frames in a cycle than the gateway serves in one direction. */
    IGH_CIA402_LOAD_BUDGET = 3,
    /** The bus is too slow for the cycle: targets accumulate, and the axes will hold. */
    IGH_CIA402_LOAD_TOO_MUCH = 4
} igh_cia402_load_warning_t;

/** Counters of an axis. */
typedef struct {
    /** Targets passed to the gateway, the first ones included. */
    uint64_t targets_sent;
    /** Times that the axis became active while enabled. */
    uint64_t activations;
    /** Rejected targets of the application, for any reason. */
    uint64_t targets_rejected;
    /** Targets rejected because of the step limit. */
    uint64_t rejected_step;
    /** Targets rejected because of the following window. */
    uint64_t rejected_window;
    /**
     * Cycles in which an active axis got no target: an incomplete working counter, a repeated
     * image, a full image.
     */
    uint64_t waits;
    /** Times that the axis held. */
    uint64_t holds;
    /** Times that the axis became uncontrolled: to be stopped, possibly moving, and silent. */
    uint64_t uncontrolled;
    /** TPDOs received. */
    uint64_t tpdos;
    /** TPDOs too short for the mapping. */
    uint64_t malformed_tpdos;
    /** Lost TPDOs, by the number of sent SYNCs. */
    uint64_t lost_tpdos;
    /**
     * Cycles with an actual position that cannot be used: in an incomplete image, after a
     * backlog.
     */
    uint64_t unusable_positions;
    /** Largest distance between target and actual position while targets were sent, in steps. */
    uint64_t max_following_error;
    /** Targets that the gateway reported as not sent. */
    uint64_t targets_lost;
    /** Feed-forwards that a limit changed. */
    uint64_t feed_forwards_limited;
    /** Faults of the drive. */
    uint64_t faults;
    /** Emergency messages. */
    uint32_t emergencies;
    /** Most consecutive cycles without a usable TPDO while the axis was enabled. */
    uint16_t longest_gap;
    /** An igh_cia402_hold_t: reason of the last hold. */
    uint8_t last_hold;
    /** Zero. */
    uint8_t padding;
    /** Zero; for fields of later versions. */
    uint64_t reserved[8];
} igh_cia402_axis_statistics_t;

/**
 * Load of one channel by the process data of its axes and SYNC. SDO, heartbeats and NMT use
 * the rest.
 */
typedef struct {
    /** Share of the bus without stuff bits; 1.0 is 100 %. */
    double least;
    /** Share of the bus with the most possible stuff bits. */
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
    /** Zero; for fields of later versions. */
    uint64_t reserved[4];
} igh_cia402_bus_load_t;

/**
 * Counters of an axis.
 *
 * @usage   rt, the cycle's thread, after init
 */
int igh_cia402_get_axis_statistics(igh_cia402_context_t *context,
                                   size_t axis,
                                   igh_cia402_axis_statistics_t *statistics);

/**
 * Gets the load of each CAN bus with axes by process data, by the bit rates of the Port.
 *
 * @param loads     Gets the loads of the channels.
 * @param capacity  Channels that fit.
 * @param count     Gets the number of channels with axes, even if they do not all fit.
 *
 * @usage   not rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_BUFFER if not all fit.
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

/** State of the last SDO transfer with a drive. */
typedef enum {
    /** There was none. */
    IGH_CIA402_SDO_IDLE = 0,
    /** In progress. */
    IGH_CIA402_SDO_RUNNING = 1,
    /** Done. */
    IGH_CIA402_SDO_DONE = 2,
    /** Failed. */
    IGH_CIA402_SDO_FAILED = 3
} igh_cia402_sdo_state_t;

/**
 * Reads an object of a drive and waits. Runs the cycle, with the axes at their last targets.
 *
 * @param data        Gets the value, little endian.
 * @param size        Bytes of the buffer.
 * @param length      Gets the bytes of the value, even if it does not fit.
 * @param timeout_ms  Total time in milliseconds.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  ECAN_OK; ECAN_ERR_SDO with ecan_last_abort_code(); ECAN_ERR_TIMEOUT, ECAN_ERR_BUFFER,
 *          ECAN_ERR_CANOPEN, ECAN_ERR_AXIS, ECAN_ERR_MASTER; ECAN_ERR_ORDER if the bus is not
 *          active; ECAN_ERR_ATTACHED on a master of another owner, use
 *          igh_cia402_sdo_start_upload() there.
 */
ECAN_MUST_CHECK
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
 * @param timeout_ms  Total time in milliseconds.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  As igh_cia402_sdo_upload(); on a master of another owner use
 *          igh_cia402_sdo_start_download().
 */
ECAN_MUST_CHECK
int igh_cia402_sdo_download(igh_cia402_context_t *context,
                            size_t axis,
                            uint16_t index,
                            uint8_t subindex,
                            const void *data,
                            size_t size,
                            uint32_t timeout_ms);

/**
 * Starts reading an object of a drive; igh_cia402_sdo_poll() gets the result in later cycles.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK; ECAN_ERR_AXIS_STATE while another transfer with the drive is in progress;
 *          ECAN_ERR_AXIS.
 */
ECAN_MUST_CHECK
int igh_cia402_sdo_start_upload(igh_cia402_context_t *context,
                                size_t axis,
                                uint16_t index,
                                uint8_t subindex);

/**
 * Starts writing an object of a drive, as igh_cia402_sdo_start_upload().
 *
 * @param data  The value, little endian, with as many bytes as the object has. Is copied.
 * @param size  Its bytes.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  As igh_cia402_sdo_start_upload(); ECAN_ERR_CANOPEN for a value that is longer than
 *          igh_cia402_settings_t.sdo_buffer_bytes.
 */
ECAN_MUST_CHECK
int igh_cia402_sdo_start_download(igh_cia402_context_t *context,
                                  size_t axis,
                                  uint16_t index,
                                  uint8_t subindex,
                                  const void *data,
                                  size_t size);

/**
 * Gets the state of the last started transfer with a drive. Call it in every cycle: the axis' own
 * transfers start when necessary and replace the value.
 *
 * @param state   Gets an igh_cia402_sdo_state_t.
 * @param data    Gets the value of a finished upload, little endian; may be NULL with size 0.
 * @param size    Bytes of the buffer.
 * @param length  Gets the bytes of the value, even if it does not fit; 0 while there is none.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  ECAN_OK, also for a failed transfer, whose reason is in ecan_last_error() and
 *          ecan_last_abort_code(); ECAN_ERR_BUFFER, ECAN_ERR_AXIS.
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
 * For tools, and for the startup of devices. Each call runs the cycle, with axes on the Port at their last
 * targets; it drops other received frames. With axes, the node must be in their network, as drive, as
 * node of its file, or by igh_canopen_add_node().
 * --------------------------------------------------------------------------- */

/**
 * Reads an object of a CANopen node and waits.
 *
 * @param slave       Slave index of the gateway.
 * @param channel     Channel of the gateway, 0 to 3, enabled for classic CAN or CAN FD.
 * @param node_id     Node-ID, 1 to 127.
 * @param data        Gets the value, little endian.
 * @param size        Bytes of the buffer.
 * @param length      Gets the bytes of the value, even if it does not fit.
 * @param timeout_ms  Total time in milliseconds. A node that does not respond ends it after 1500.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  ECAN_OK; ECAN_ERR_SDO, with ecan_last_abort_code() if the node aborted;
 *          ECAN_ERR_TIMEOUT, ECAN_ERR_BUFFER, ECAN_ERR_CANOPEN, ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL,
 *          ECAN_ERR_ARGUMENT, ECAN_ERR_MASTER; ECAN_ERR_ORDER if the bus is not active;
 *          ECAN_ERR_NODE if there are axes on the Port and the node is not in their network;
 *          ECAN_ERR_ATTACHED on a master of another owner.
 */
ECAN_MUST_CHECK
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
 * @param timeout_ms  Total time in milliseconds.
 *
 * @usage   not rt, the cycle's thread, active bus
 * @return  As igh_canopen_sdo_upload().
 */
ECAN_MUST_CHECK
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
