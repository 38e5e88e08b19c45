/*
 * CiA 402 axes on a master that the application owns: the SDK is attached, so that no call may wait by
 * running the cycle. The application starts each operation and polls igh_cia402_get_axis_state() in its
 * cycle: configure, enable, move, stop, shut down. Its own digital I/O is served in the same cycle.
 *
 *     LD_LIBRARY_PATH=build/sim ECAN_ECRT=sim:capi/tests/attached_cell.toml ./attached_axes
 */
#include <stdio.h>

#include "igh_cia402_protocol.h"
#include "owned_io.h"

#define CYCLE_US 2000
#define AXES 2
#define CHANNEL 1
#define STEP 20
#define MOTION_CYCLES 500
/* Cycles that one operation may take. */
#define PATIENCE 20000

typedef struct {
    ec_master_t *master;
    igh_mcan_port_t port;
    igh_cia402_context_t axes;
    owned_io_t io;
    int has_axes;
} machine_t;

/* Condition that an operation ends with, by the state of an axis. */
typedef int (*condition_t)(const igh_cia402_axis_state_t *state);

static int failed(const char *what)
{
    fprintf(stderr, "attached_axes: %s: %s\n", what, ecan_last_error());
    return 1;
}

/* Runs one cycle of the owner; 0, or 1 after an error of the axes. */
static int cycle(machine_t *machine)
{
    int is_faulty = 0;
    igh_mcan_port_wait_next_cycle(&machine->port);
    ecrt_master_receive(machine->master);
    owned_io_receive(&machine->io);
    igh_mcan_port_cycle_begin(&machine->port);
    if (machine->has_axes) {
        is_faulty = igh_cia402_process_rx(&machine->axes) != ECAN_OK ||
                    igh_cia402_send_target_step(&machine->axes) != ECAN_OK;
    }
    igh_mcan_port_cycle_end(&machine->port);
    owned_io_send(&machine->io, 0x5A);
    ecrt_master_send(machine->master);
    return is_faulty;
}

static int is_configured(const igh_cia402_axis_state_t *state)
{
    return state->is_configured && state->phase == IGH_CIA402_PHASE_STANDBY;
}

static int is_active(const igh_cia402_axis_state_t *state)
{
    return state->phase == IGH_CIA402_PHASE_RUNNING && state->has_actual;
}

static int is_at_rest(const igh_cia402_axis_state_t *state)
{
    return state->phase == IGH_CIA402_PHASE_HALTED && state->is_at_rest;
}

/* Runs the cycle until all axes meet the condition. */
static int run_until(machine_t *machine, condition_t condition, const char *what)
{
    for (int n = 0; n < PATIENCE; n++) {
        size_t met = 0;
        if (cycle(machine) != 0) {
            return failed(what);
        }
        for (size_t axis = 0; axis < AXES; axis++) {
            igh_cia402_axis_state_t state;
            if (igh_cia402_get_axis_state(&machine->axes, axis, &state) != ECAN_OK) {
                return failed(what);
            }
            if (state.axis_error != 0) {
                fprintf(stderr, "attached_axes: %s: axis %u has error %u\n", what, (unsigned int)axis,
                        state.axis_error);
                return 1;
            }
            met += condition(&state) != 0;
        }
        if (met == AXES) {
            printf("%s after %d cycles\n", what, n + 1);
            return 0;
        }
    }
    return failed(what);
}

static int attach(machine_t *machine, ecan_igh_context_t *igh)
{
    igh_cia402_axis_t table[AXES];
    ecan_igh_config_t config;
    igh_mcan_port_config_t gateways;

    if (owned_io_configure(&machine->io, machine->master) != 0) {
        return failed("the I/O cannot be configured");
    }
    ecan_igh_default_config(&config);
    ecan_igh_config_set_cycle_us(&config, CYCLE_US);
    ecan_igh_config_set_slave_position(&config, 0, 0, 1);
    igh_mcan_port_default_config(&gateways);
    igh_mcan_port_set_classic_channel(&gateways, 0, CHANNEL, 1000000);
    for (size_t axis = 0; axis < AXES; axis++) {
        igh_cia402_axis_init(&table[axis], 0, CHANNEL, (uint8_t)(axis + 1), 0);
    }
    if (igh_mcan_port_apply_config(&config, &gateways) != ECAN_OK ||
        ecan_igh_attach(igh, &config, machine->master) != ECAN_OK ||
        igh_mcan_port_init(&machine->port, igh, &gateways) != ECAN_OK) {
        return failed("attach");
    }
    if (ecrt_master_activate(machine->master) != 0 || owned_io_begin(&machine->io) != 0) {
        return failed("activate");
    }
    if (ecan_igh_owner_activated(igh) != ECAN_OK) {
        return failed("owner_activated");
    }
    for (int n = 0; igh_mcan_port_is_ready(&machine->port) != 1; n++) {
        if (n > PATIENCE) {
            return failed("the gateway is not ready");
        }
        cycle(machine);
    }
    if (igh_cia402_context_init(&machine->axes, &machine->port, table, AXES) != ECAN_OK) {
        return failed("context_init");
    }
    machine->has_axes = 1;
    return 0;
}

/* Moves all axes and checks the distance. */
static int move(machine_t *machine)
{
    int32_t start[AXES];
    igh_cia402_axis_state_t state;
    for (size_t axis = 0; axis < AXES; axis++) {
        igh_cia402_get_axis_state(&machine->axes, axis, &state);
        start[axis] = state.actual;
        igh_cia402_set_target_step(&machine->axes, axis, axis == 0 ? STEP : -STEP);
    }
    for (int n = 0; n < MOTION_CYCLES; n++) {
        if (cycle(machine) != 0) {
            return failed("move");
        }
    }
    for (size_t axis = 0; axis < AXES; axis++) {
        const int32_t direction = axis == 0 ? 1 : -1;
        igh_cia402_get_axis_state(&machine->axes, axis, &state);
        const int32_t distance = direction * (state.actual - start[axis]);
        printf("axis %u moved by %ld steps\n", (unsigned int)axis, (long)(direction * distance));
        if (distance < MOTION_CYCLES * STEP / 2) {
            return failed("the axis did not move");
        }
    }
    return 0;
}

static int run(machine_t *machine, ecan_igh_context_t *igh)
{
    if (attach(machine, igh) != 0) {
        return 1;
    }
    if (igh_cia402_configure_csp_all_timeout(&machine->axes, 1000) != ECAN_ERR_ATTACHED ||
        igh_cia402_enable_all_timeout(&machine->axes, 1000) != ECAN_ERR_ATTACHED) {
        return failed("a call that runs the cycle was not rejected");
    }
    for (size_t axis = 0; axis < AXES; axis++) {
        if (igh_cia402_configure(&machine->axes, axis) != ECAN_OK) {
            return failed("configure");
        }
    }
    if (run_until(machine, is_configured, "configured") != 0) {
        return 1;
    }
    if (igh_cia402_enable_all(&machine->axes) != ECAN_OK) {
        return failed("enable");
    }
    if (run_until(machine, is_active, "enabled") != 0 || move(machine) != 0) {
        return 1;
    }
    for (size_t axis = 0; axis < AXES; axis++) {
        if (igh_cia402_halt(&machine->axes, axis) != ECAN_OK) {
            return failed("halt");
        }
    }
    if (run_until(machine, is_at_rest, "at rest") != 0) {
        return 1;
    }
    igh_cia402_begin_shutdown(&machine->axes);
    for (int n = 0; igh_cia402_shutdown_is_done(&machine->axes) != 1; n++) {
        if (n > PATIENCE || cycle(machine) != 0) {
            return failed("shutdown");
        }
    }
    printf("shut down, input 0x%02X\n", machine->io.data[machine->io.input]);
    return machine->io.data[machine->io.input] == 0x5A ? 0 : failed("the I/O does not work");
}

int main(void)
{
    static machine_t machine;
    ecan_igh_context_t igh;
    machine.master = ecrt_request_master(0);
    if (machine.master == NULL) {
        fputs("attached_axes: no master\n", stderr);
        return 1;
    }
    int code = run(&machine, &igh);
    /* Before the owner releases the master. */
    if (ecan_igh_deinit(&igh) != ECAN_OK) {
        code = failed("deinit");
    }
    ecrt_release_master(machine.master);
    return code;
}
