#include "axis_pins.h"

#include <errno.h>
#include <math.h>
#include <stdint.h>

#include "rtapi.h"

/**
 * Consecutive rejected commands after which the axis is halted: the drive continues with the command
 * before, which in a velocity mode is a motion.
 */
#define MAX_REJECTED 3

/* Bits of the statusword, CiA 402. */
#define FAULT 0x0008U
#define WARNING 0x0080U
#define TARGET_REACHED 0x0400U

static int is_velocity_mode(int mode)
{
    return mode == IGH_CIA402_MODE_CSV || mode == IGH_CIA402_MODE_PV || mode == IGH_CIA402_MODE_VL;
}

static int is_position_mode(int mode)
{
    return mode == IGH_CIA402_MODE_CSP || mode == IGH_CIA402_MODE_PP || mode == IGH_CIA402_MODE_IP;
}

static int export_inputs(axis_pins_t *pins, int component, int axis)
{
#define NAME(pin) component, "ecan-lite.%d." pin, axis
    return hal_pin_bit_newf(HAL_IN, &pins->enable, NAME("enable")) ||
           hal_pin_bit_newf(HAL_IN, &pins->fault_reset, NAME("fault-reset")) ||
           hal_pin_float_newf(HAL_IN, &pins->pos_cmd, NAME("pos-cmd")) ||
           hal_pin_float_newf(HAL_IN, &pins->velocity_cmd, NAME("velocity-cmd")) ||
           hal_param_float_newf(HAL_RW, &pins->pos_scale, NAME("pos-scale")) ||
           hal_param_float_newf(HAL_RW, &pins->velo_scale, NAME("velo-scale")) ||
           hal_param_bit_newf(HAL_RW, &pins->auto_fault_reset, NAME("auto-fault-reset"));
}

static int export_outputs(axis_pins_t *pins, int component, int axis)
{
    return hal_pin_float_newf(HAL_OUT, &pins->pos_fb, NAME("pos-fb")) ||
           hal_pin_float_newf(HAL_OUT, &pins->velocity_fb, NAME("velocity-fb")) ||
           hal_pin_bit_newf(HAL_OUT, &pins->enabled, NAME("enabled")) ||
           hal_pin_bit_newf(HAL_OUT, &pins->busy, NAME("busy")) ||
           hal_pin_bit_newf(HAL_OUT, &pins->drv_fault, NAME("drv-fault")) ||
           hal_pin_bit_newf(HAL_OUT, &pins->hold, NAME("hold")) ||
           hal_pin_u32_newf(HAL_OUT, &pins->hold_reason, NAME("hold-reason")) ||
           hal_pin_bit_newf(HAL_OUT, &pins->rejected, NAME("rejected")) ||
           hal_pin_u32_newf(HAL_OUT, &pins->axis_error, NAME("axis-error")) ||
           hal_pin_bit_newf(HAL_OUT, &pins->stat_fault, NAME("stat-fault")) ||
           hal_pin_bit_newf(HAL_OUT, &pins->stat_op_enabled, NAME("stat-op-enabled")) ||
           hal_pin_bit_newf(HAL_OUT, &pins->stat_warning, NAME("stat-warning")) ||
           hal_pin_bit_newf(HAL_OUT, &pins->stat_target_reached, NAME("stat-target-reached")) ||
           hal_pin_u32_newf(HAL_OUT, &pins->statusword, NAME("srv-cia-statusword")) ||
           hal_pin_s32_newf(HAL_OUT, &pins->opmode_display, NAME("srv-opmode-display")) ||
           hal_pin_s32_newf(HAL_OUT, &pins->actual_position, NAME("srv-actual-position")) ||
           hal_pin_s32_newf(HAL_OUT, &pins->target_position, NAME("srv-target-position")) ||
           hal_pin_s32_newf(HAL_OUT, &pins->actual_velocity, NAME("srv-actual-velocity")) ||
           hal_pin_s32_newf(HAL_OUT, &pins->actual_torque, NAME("srv-actual-torque")) ||
           hal_pin_s32_newf(HAL_OUT, &pins->following_error, NAME("srv-actual-following-error")) ||
           hal_pin_u32_newf(HAL_OUT, &pins->error_code, NAME("srv-error-code")) ||
           hal_pin_u32_newf(HAL_OUT, &pins->actual_age, NAME("actual-age"));
#undef NAME
}

int axis_pins_export(axis_pins_t *pins, igh_cia402_context_t *motors, int component, size_t axis)
{
    const int n = (int)axis;

    if (igh_cia402_get_axis_state(motors, axis, &pins->state) != ECAN_OK) {
        rtapi_print_msg(RTAPI_MSG_ERR, "ecan_lite: axis %d: %s\n", n, ecan_last_error());
        return -EIO;
    }
    if (!is_position_mode(pins->state.mode) && !is_velocity_mode(pins->state.mode)) {
        rtapi_print_msg(RTAPI_MSG_ERR,
                        "ecan_lite: axis %d: mode %d is not supported; allowed: csp, pp, ip, csv, pv, vl\n",
                        n, pins->state.mode);
        return -EINVAL;
    }
    if (export_inputs(pins, component, n) || export_outputs(pins, component, n)) {
        return -ENOMEM;
    }
    pins->pos_scale = 1.0;
    pins->velo_scale = 1.0;
    pins->auto_fault_reset = 1;
    return 0;
}

static double scaled(double value, double scale)
{
    return scale == 0.0 ? 0.0 : value / scale;
}

void axis_pins_read(axis_pins_t *pins, igh_cia402_context_t *motors, size_t axis)
{
    igh_cia402_axis_state_t *state = &pins->state;

    if (igh_cia402_get_axis_state(motors, axis, state) != ECAN_OK) {
        return;
    }
    *pins->pos_fb = scaled(state->actual, pins->pos_scale);
    *pins->velocity_fb = scaled(state->velocity, pins->velo_scale);
    *pins->enabled = state->is_running;
    *pins->busy = (hal_bit_t)(pins->is_start_pending || state->is_recovering);
    *pins->hold = state->hold_reason != 0;
    *pins->hold_reason = state->hold_reason;
    *pins->axis_error = state->axis_error;
    pins->rejected_cycles =
        state->decision == IGH_CIA402_DECISION_REJECTED ? pins->rejected_cycles + 1 : 0;
    *pins->drv_fault = *pins->enable && pins->was_enable && !*pins->enabled && !*pins->busy;

    *pins->stat_fault = (state->statusword & FAULT) != 0;
    *pins->stat_op_enabled = state->drive_state == IGH_CIA402_DRIVE_OPERATION_ENABLED;
    *pins->stat_warning = (state->statusword & WARNING) != 0;
    *pins->stat_target_reached = (state->statusword & TARGET_REACHED) != 0;
    *pins->statusword = state->statusword;
    *pins->opmode_display = state->mode_display != 0 ? state->mode_display : state->mode;
    *pins->actual_position = state->actual;
    *pins->target_position = state->has_target ? state->target : state->actual;
    *pins->actual_velocity = state->velocity;
    *pins->actual_torque = state->torque;
    *pins->following_error = (hal_s32_t)state->following_error;
    *pins->error_code = state->error_code;
    *pins->actual_age = state->actual_age;
}

/** Takes a command; one beyond the number range becomes its limit, and the guard of the axis holds it. */
static int32_t target_of(double value)
{
    if (!(value > INT32_MIN)) {
        return INT32_MIN;
    }
    return value < INT32_MAX ? (int32_t)lrint(value) : INT32_MAX;
}

static void start(axis_pins_t *pins, igh_cia402_context_t *motors, size_t axis)
{
    /* rejected while a stop or shutdown is in progress: repeated in the next cycle */
    if (igh_cia402_recover(motors, axis) == ECAN_OK) {
        pins->is_start_pending = 0;
    }
}

void axis_pins_write(axis_pins_t *pins, igh_cia402_context_t *motors, size_t axis, int is_bus_ready)
{
    const int enable = *pins->enable;
    const int fault_reset = *pins->fault_reset;
    const int is_in_fault = pins->state.drive_state == IGH_CIA402_DRIVE_FAULT;

    if (fault_reset && !pins->was_fault_reset && is_in_fault) {
        (void)igh_cia402_reset_fault(motors, axis);
    }
    pins->was_fault_reset = fault_reset;
    if (enable && !pins->was_enable) {
        pins->is_start_pending = pins->auto_fault_reset || !is_in_fault;
        *pins->rejected = 0;
    }
    if (!enable) {
        pins->is_start_pending = 0;
        if (pins->was_enable) {
            (void)igh_cia402_disable(motors, axis);
        }
    }
    pins->was_enable = enable;
    if (pins->is_start_pending && is_bus_ready) {
        start(pins, motors, axis);
    }
    if (pins->state.is_running && pins->rejected_cycles >= MAX_REJECTED) {
        *pins->rejected = 1;
        (void)igh_cia402_halt(motors, axis);
    } else if (pins->state.is_running) {
        const double value = is_velocity_mode(pins->state.mode) ? *pins->velocity_cmd * pins->velo_scale
                                                                : *pins->pos_cmd * pins->pos_scale;
        (void)igh_cia402_set_target(motors, axis, target_of(value));
    }
}
