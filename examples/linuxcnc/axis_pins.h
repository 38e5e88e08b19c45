/* Pins of an axis. */
#ifndef AXIS_PINS_H
#define AXIS_PINS_H

#include <stddef.h>

#include "hal.h"
#include "igh_cia402_protocol.h"

/** Pins and parameters of an axis; README.md describes each. */
typedef struct {
    hal_bit_t *enable;
    hal_bit_t *fault_reset;
    hal_float_t *pos_cmd;
    hal_float_t *velocity_cmd;

    hal_float_t *pos_fb;
    hal_float_t *velocity_fb;
    hal_bit_t *enabled;
    hal_bit_t *busy;
    hal_bit_t *drv_fault;
    hal_bit_t *hold;
    hal_u32_t *hold_reason;
    hal_bit_t *rejected;
    hal_u32_t *axis_error;
    hal_bit_t *stat_fault;
    hal_bit_t *stat_op_enabled;
    hal_bit_t *stat_warning;
    hal_bit_t *stat_target_reached;

    hal_u32_t *statusword;
    hal_s32_t *opmode_display;
    hal_s32_t *actual_position;
    hal_s32_t *target_position;
    hal_s32_t *actual_velocity;
    hal_s32_t *actual_torque;
    hal_s32_t *following_error;
    hal_u32_t *error_code;
    hal_u32_t *actual_age;

    hal_float_t pos_scale;
    hal_float_t velo_scale;
    hal_bit_t auto_fault_reset;

    /** State of the last cycle. */
    igh_cia402_axis_state_t state;
    int was_enable;
    int was_fault_reset;
    /** The start was commanded, and the library has not taken it yet. */
    int is_start_pending;
    /** Consecutive cycles whose command was rejected. */
    int rejected_cycles;
} axis_pins_t;

/** Exports the pins. Returns 0, or a negative errno with a message. */
int axis_pins_export(axis_pins_t *pins, igh_cia402_context_t *motors, int component, size_t axis);

/** Writes the outputs from the state of the axis. */
void axis_pins_read(axis_pins_t *pins, igh_cia402_context_t *motors, size_t axis);

/** Executes the commands of the inputs. */
void axis_pins_write(axis_pins_t *pins, igh_cia402_context_t *motors, size_t axis, int is_bus_ready);

#endif
