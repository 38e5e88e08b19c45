/*
 * HAL component of LinuxCNC for the axes of ECAN-Lite gateways. README.md describes pins and safety.
 *
 *     loadrt ecan_lite config=/etc/linuxcnc/cell.toml
 *     addf ecan-lite.read-all servo-thread
 *     ...                                               motion, pid
 *     addf ecan-lite.write-all servo-thread
 */
#include "axis_pins.h"

#include <errno.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <unistd.h>

#include "igh_adapter.h"
#include "igh_cia402_protocol.h"
#include "igh_mcan_port.h"
#include "rtapi.h"
#include "rtapi_app.h"

MODULE_AUTHOR("The ECAN-Lite host SDK authors");
MODULE_DESCRIPTION("CiA 402 axes on ECAN-Lite EtherCAT to CAN gateways");
MODULE_LICENSE("MIT or Apache-2.0");

static char *config;
RTAPI_MP_STRING(config, "configuration file");
static char *ecrt;
RTAPI_MP_STRING(ecrt, "EtherCAT master library: a path, or sim:SCENARIO; default: that of the library");

#define STOP_MS 15000U
/** Largest deviation of the thread's period from the cycle of the configuration. */
#define PERIOD_TOLERANCE_PERCENT 1

/** Pins of a gateway. */
typedef struct {
    hal_bit_t *oper;
    hal_u32_t *working_counter;
    hal_u32_t *incomplete_cycles;
    hal_u32_t *images_lost;
    hal_u32_t *parse_errors;
    hal_u32_t *sessions_lost;
} gateway_pins_t;

/** Pins of the component. */
typedef struct {
    hal_bit_t *all_op;
    hal_bit_t *period_fault;
    hal_u32_t *late_cycles;
    hal_u32_t *skipped_cycles;
    hal_s32_t *cycle_time_max;
} bus_pins_t;

static ecan_igh_config_t igh_config;
static igh_mcan_port_config_t mcan_config;
static ecan_igh_context_t igh;
static igh_mcan_port_t mcan;
static igh_cia402_context_t motors;

static int component = -1;
static bus_pins_t *bus;
static gateway_pins_t *gateways;
static axis_pins_t *axes;
static size_t gateway_count;
static size_t axis_count;
static uint32_t cycle_ns;
static long long last_start;
static int is_open;

/** 1 while a function runs; `is_ending` keeps further ones from starting. */
static atomic_int is_busy;
static atomic_int is_ending;

static void report(const char *what)
{
    rtapi_print_msg(RTAPI_MSG_ERR, "ecan_lite: %s: %s\n", what, ecan_last_error());
}

static int enter(void)
{
    atomic_store(&is_busy, 1);
    if (atomic_load(&is_ending)) {
        atomic_store(&is_busy, 0);
        return 0;
    }
    return 1;
}

static void leave(void)
{
    atomic_store(&is_busy, 0);
}

/** The configuration writes the period to the drives, so that another one would move them wrongly. */
static int period_is_wrong(long period)
{
    const long long tolerance = (long long)cycle_ns * PERIOD_TOLERANCE_PERCENT / 100;
    const int is_wrong = llabs((long long)period - (long long)cycle_ns) > tolerance;
    if (is_wrong && !*bus->period_fault) {
        rtapi_print_msg(RTAPI_MSG_ERR,
                        "ecan_lite: thread period %ld ns differs from the cycle %u ns of %s; allowed: "
                        "the same; set cycle_us or the period of the thread\n",
                        period, (unsigned)cycle_ns, config);
    }
    *bus->period_fault = (hal_bit_t)is_wrong;
    return is_wrong;
}

/**
 * Measures the time since the last cycle. Returns 1 for a run that a thread makes up for after a late
 * one: the frame of the last cycle may not have returned, so that the bus is left out.
 */
static int is_too_early(long period)
{
    const long long now = rtapi_get_time();
    const long long time = now - last_start;
    if (last_start != 0 && 2 * time < period) {
        *bus->skipped_cycles += 1;
        return 1;
    }
    if (last_start != 0) {
        if (time > *bus->cycle_time_max) {
            *bus->cycle_time_max = time > 0x7FFFFFFF ? 0x7FFFFFFF : (hal_s32_t)time;
        }
        if (2 * time > 3LL * period) {
            *bus->late_cycles += 1;
        }
    }
    last_start = now;
    return 0;
}

static void read_gateway(size_t slave, gateway_pins_t *pins)
{
    igh_mcan_cycle_report_t cycle;
    igh_mcan_statistics_t counters;

    *pins->oper = igh_mcan_port_get_session(&mcan, slave) == IGH_MCAN_SESSION_READY;
    if (igh_mcan_port_get_cycle_report(&mcan, slave, &cycle) == ECAN_OK) {
        *pins->working_counter = cycle.domain.working_counter;
    }
    if (igh_mcan_port_get_statistics(&mcan, slave, &counters) == ECAN_OK) {
        *pins->incomplete_cycles = (hal_u32_t)counters.incomplete_cycles;
        *pins->images_lost = (hal_u32_t)counters.txpdo_lost;
        *pins->parse_errors = (hal_u32_t)counters.parse_errors;
        *pins->sessions_lost = (hal_u32_t)counters.sessions_lost;
    }
}

/** First in the thread: receives, and updates all outputs of the component. */
static void read_all(void *arg, long period)
{
    size_t n;

    (void)arg;
    if (!enter()) {
        return;
    }
    if (!period_is_wrong(period) && !is_too_early(period)) {
        /* an error of the master shows in the working counter, and the next cycle repeats the call */
        (void)igh_mcan_port_cycle_begin(&mcan);
        (void)igh_cia402_process_rx(&motors);
        is_open = 1;
    }
    *bus->all_op = (hal_bit_t)(igh_mcan_port_is_ready(&mcan) == 1);
    for (n = 0; n < gateway_count; n++) {
        read_gateway(n, &gateways[n]);
    }
    for (n = 0; n < axis_count; n++) {
        axis_pins_read(&axes[n], &motors, n);
        if (*bus->period_fault) {
            *axes[n].drv_fault = *axes[n].enable;
        }
    }
    leave();
}

/** Last in the thread: takes the commands and sends. */
static void write_all(void *arg, long period)
{
    size_t n;

    (void)arg;
    (void)period;
    if (!enter()) {
        return;
    }
    if (is_open) {
        for (n = 0; n < axis_count; n++) {
            axis_pins_write(&axes[n], &motors, n, *bus->all_op);
        }
        (void)igh_cia402_send_targets_all(&motors);
        (void)igh_mcan_port_cycle_end(&mcan);
        is_open = 0;
    }
    leave();
}

static int export_bus(void)
{
    return hal_pin_bit_newf(HAL_OUT, &bus->all_op, component, "ecan-lite.all-op") ||
           hal_pin_bit_newf(HAL_OUT, &bus->period_fault, component, "ecan-lite.period-fault") ||
           hal_pin_u32_newf(HAL_OUT, &bus->late_cycles, component, "ecan-lite.late-cycles") ||
           hal_pin_u32_newf(HAL_OUT, &bus->skipped_cycles, component, "ecan-lite.skipped-cycles") ||
           hal_pin_s32_newf(HAL_IO, &bus->cycle_time_max, component, "ecan-lite.cycle-time-max");
}

static int export_gateway(int slave, gateway_pins_t *pins)
{
#define NAME(pin) "ecan-lite.gateway-%d." pin, slave
    return hal_pin_bit_newf(HAL_OUT, &pins->oper, component, NAME("slave-oper")) ||
           hal_pin_u32_newf(HAL_OUT, &pins->working_counter, component, NAME("working-counter")) ||
           hal_pin_u32_newf(HAL_OUT, &pins->incomplete_cycles, component, NAME("incomplete-cycles")) ||
           hal_pin_u32_newf(HAL_OUT, &pins->images_lost, component, NAME("images-lost")) ||
           hal_pin_u32_newf(HAL_OUT, &pins->parse_errors, component, NAME("parse-errors")) ||
           hal_pin_u32_newf(HAL_OUT, &pins->sessions_lost, component, NAME("sessions-lost"));
#undef NAME
}

static int export_all(void)
{
    size_t n;

    gateway_count = ecan_igh_slave_count(&igh);
    axis_count = igh_cia402_axis_count(&motors);
    bus = hal_malloc(sizeof *bus);
    gateways = hal_malloc((long)(gateway_count * sizeof *gateways));
    axes = axis_count == 0 ? NULL : hal_malloc((long)(axis_count * sizeof *axes));
    if (axis_count == 0) {
        rtapi_print_msg(RTAPI_MSG_ERR, "ecan_lite: %s has no [[axis]]; add one\n", config);
        return -EINVAL;
    }
    if (bus == NULL || gateways == NULL || axes == NULL || export_bus()) {
        return -ENOMEM;
    }
    for (n = 0; n < gateway_count; n++) {
        if (export_gateway((int)n, &gateways[n])) {
            return -ENOMEM;
        }
    }
    for (n = 0; n < axis_count; n++) {
        int result = axis_pins_export(&axes[n], &motors, component, n);
        if (result != 0) {
            return result;
        }
    }
    return hal_export_funct("ecan-lite.read-all", read_all, NULL, 1, 0, component) ||
           hal_export_funct("ecan-lite.write-all", write_all, NULL, 1, 0, component);
}

static int open_bus(void)
{
    if (ecan_igh_default_config(&igh_config) != ECAN_OK ||
        (ecrt != NULL && ecan_igh_config_set_ecrt(&igh_config, ecrt) != ECAN_OK) ||
        igh_mcan_port_load_config(&igh_config, &mcan_config, config, NULL, 0, NULL) != ECAN_OK ||
        ecan_igh_config_get_cycle_ns(&igh_config, &cycle_ns) != ECAN_OK ||
        ecan_igh_init(&igh, &igh_config) != ECAN_OK ||
        igh_mcan_port_init(&mcan, &igh, &mcan_config) != ECAN_OK ||
        igh_cia402_context_init_file(&motors, &mcan, config, NULL) != ECAN_OK) {
        report(config);
        return -EIO;
    }
    return 0;
}

static void close_bus(void)
{
    igh_cia402_context_deinit(&motors);
    igh_mcan_port_deinit(&mcan);
    ecan_igh_deinit(&igh);
}

int rtapi_app_main(void)
{
    int result;

    if (config == NULL) {
        rtapi_print_msg(RTAPI_MSG_ERR, "ecan_lite: no configuration file; set config=FILE\n");
        return -EINVAL;
    }
    component = hal_init("ecan_lite");
    if (component < 0) {
        return component;
    }
    result = open_bus();
    if (result == 0) {
        result = export_all();
    }
    /* from here on, the functions run the cycle; the gateways reach OP in it */
    if (result == 0 && ecan_igh_activate(&igh) != ECAN_OK) {
        report("activation of the master");
        result = -EIO;
    }
    if (result != 0) {
        close_bus();
        hal_exit(component);
        return result;
    }
    hal_ready(component);
    return 0;
}

/** Runs the cycle until all axes are disabled. */
static void stop_axes(void)
{
    int result = igh_cia402_shutdown_timeout(&motors, STOP_MS);

    if (result != ECAN_OK) {
        /* the thread had ended too long ago: gateways left OP, or drives have lost the host */
        result = ecan_igh_wait_op_timeout(&igh, ecan_igh_startup_timeout_ms(&igh));
        if (result == ECAN_OK) {
            result = igh_cia402_stop_all_timeout(&motors, STOP_MS);
        }
    }
    if (result == ECAN_OK) {
        rtapi_print("ecan_lite: all axes at rest and disabled\n");
    } else {
        report("stop of the axes");
    }
}

void rtapi_app_exit(void)
{
    atomic_store(&is_ending, 1);
    while (atomic_load(&is_busy)) {
        usleep(100);
    }
    if (is_open) {
        (void)igh_mcan_port_cycle_end(&mcan);
    }
    stop_axes();
    close_bus();
    hal_exit(component);
}
