#include "motion.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "cycle_result.h"
#include "frame_plan.h"
#include "gateway_report.h"
#include "igh_cia402_protocol.h"
#include "igh_plan.h"
#include "interrupt.h"
#include "motion_table.h"
#include "report.h"

/* Timeouts for configuration, position and enabling, each, and for the shutdown. */
enum { START_UP_MS = 30000, SHUTDOWN_MS = 20000 };

void motion_default(motion_t *motion, uint64_t cycles)
{
    memset(motion, 0, sizeof(*motion));
    bus_settings_default(&motion->bus, "drives");
    motion->motion_div = 1;
    motion->cycles = cycles;
}

void motion_add_options(motion_t *motion, option_list_t *list)
{
    bus_settings_t *bus = &motion->bus;
    bus_settings_add_options(bus, list);
    bus_settings_add_dc_options(bus, list);
    /* A gateway that leaves OP stops its axes. */
    bus->rejects_dc_shift = true;
    options_add(list, (option_t){
        .name = "dc-shift-measured", .flag = &bus->is_dc_shift_measured,
        .help = "Accept a shift among the arrivals of the plan: it was measured on this machine"});
    bus_settings_add_plan_option(bus, list);
    real_time_add_options(&motion->thread, list);
    options_add(list, (option_t){
        .name = "slaves", .value_name = "N", .number = &bus->slaves,
        .minimum = 1, .maximum = MOTION_MAX_AXES,
        .help = "Number of gateways"});
    options_add(list, (option_t){
        .name = "cycles", .value_name = "N", .number = &motion->cycles, .maximum = UINT64_MAX,
        .help = "Number of cycles with motion"});
    options_add(list, (option_t){
        .name = "step", .value_name = "STEP", .integer = &motion->step,
        .help = "Step of every axis per target, in increments; 0 enables without motion"});
    options_add(list, (option_t){
        .name = "motion-div", .value_name = "N", .number = &motion->motion_div,
        .minimum = 1, .maximum = UINT32_MAX,
        .help = "Cycles per target"});
    options_add(list, (option_t){
        .name = "profile", .value_name = "N", .number = &bus->profile, .maximum = UINT8_MAX,
        .help = "PDO packet profile: 0, 1, 4 or 5"});
    options_add(list, (option_t){
        .name = "align4", .flag = &bus->align4,
        .help = "Align packets to 4 bytes"});
    options_add(list, (option_t){
        .name = "skip-sdo-config", .flag = &bus->skip_sdo_config,
        .help = "Skip the startup SDOs of the gateways, for repeated debugging; they must be "
                "configured already"});
}

void motion_add_drive(motion_t *motion, drive_place_t index)
{
    motion->drives[motion->drive_count++] = index;
    motion->bus.channel_masks[index.slave] |= (uint8_t)(1u << index.channel);
}

static bool fill_axes(igh_cia402_axis_t *axes, const motion_t *motion)
{
    for (size_t i = 0; i < motion->drive_count; i++) {
        const drive_place_t *index = &motion->drives[i];
        if (igh_cia402_axis_init(&axes[i], index->slave, index->channel, index->node_id,
                                 motion->step) != ECAN_OK) {
            report_sdk_error();
            return false;
        }
    }
    return true;
}

/* Checks the plan of the axes; prints it for --plan. */
static bool check_plan(const motion_t *motion)
{
    static char text[PLAN_TEXT];
    igh_cia402_axis_t axes[MOTION_MAX_AXES];
    ecan_igh_config_t igh_config;
    igh_mcan_port_config_t mcan_config;
    if (!fill_axes(axes, motion) ||
        !bus_settings_configure(&motion->bus, &igh_config, &mcan_config)) {
        return false;
    }
    int code = igh_cia402_plan(&igh_config, &mcan_config, axes, motion->drive_count,
                               (uint32_t)motion->motion_div, text, sizeof(text), NULL);
    if (motion->bus.plan) {
        fputs(text, stdout);
    }
    if (code != ECAN_OK) {
        report_sdk_error();
    }
    return code == ECAN_OK;
}

/* Opens the axes on the Port. */
static bool init_axes(igh_cia402_context_t *cia402, bus_t *bus, const motion_t *motion)
{
    igh_cia402_axis_t axes[MOTION_MAX_AXES];
    igh_cia402_settings_t settings;
    if (!fill_axes(axes, motion)) {
        return false;
    }
    if (igh_cia402_default_settings(&settings) != ECAN_OK) {
        report_sdk_error();
        return false;
    }
    settings.motion_div = (uint32_t)motion->motion_div;
    if (igh_cia402_context_init_ex(cia402, &bus->mcan, axes, motion->drive_count, &settings) !=
        ECAN_OK) {
        report_sdk_error();
        return false;
    }
    return true;
}

/* Prints the expected load of the buses. */
static bool print_loads(igh_cia402_context_t *cia402)
{
    igh_cia402_bus_load_t loads[MOTION_MAX_AXES];
    size_t count = 0;
    if (igh_cia402_get_bus_load(cia402, loads, MOTION_MAX_AXES, &count) != ECAN_OK) {
        report_sdk_error();
        return false;
    }
    for (size_t i = 0; i < count; i++) {
        const igh_cia402_bus_load_t *load = &loads[i];
        const char *warning = "";
        switch (load->warning) {
        case IGH_CIA402_LOAD_TOO_MUCH: warning = "; too high: use a longer cycle"; break;
        case IGH_CIA402_LOAD_BUDGET:
            warning = "; more frames than the gateway serves per cycle";
            break;
        case IGH_CIA402_LOAD_TIGHT: warning = "; too high in the worst case of stuff bits"; break;
        case IGH_CIA402_LOAD_NO_RESERVE:
            warning = "; little reserve for SDO and heartbeats";
            break;
        default: break;
        }
        printf("slave %u can%u: %" PRIu32 " axes, %" PRIu32 " + %" PRIu32
               " frames per cycle, bus load %.0f to %.0f %%%s\n",
               load->slave, load->channel, load->axes, load->frames_out, load->frames_in,
               load->least * 100.0, load->most * 100.0, warning);
    }
    return true;
}

enum { PHASES = 24, PHASE_BYTES = 96 };

/* Phases, and the axes that have entered each. */
typedef struct {
    size_t axis_count;
    size_t count;
    struct {
        char text[PHASE_BYTES];
        uint32_t axes;
    } phases[PHASES];
} progress_t;

/* Copies the phase from "axis 2, node 5 (slave 0, channel 1): configured, for 10 ms". */
static void copy_phase(char *phase, size_t size, const char *text)
{
    const char *start = strstr(text, "): ");
    const char *end;
    start = start != NULL ? start + 3 : text;
    end = strstr(start, ", for ");
    snprintf(phase, size, "%.*s", (int)(end != NULL ? (size_t)(end - start) : strlen(start)),
             start);
}

/* Returns true if the other axes need not enter this phase. */
static bool concerns_one(const char *phase)
{
    static const char *const phases[] = {"holding", "fault", "uncontrolled", "configuration failed",
                                         "being stopped: hold", "stopped: hold"};
    for (size_t i = 0; i < sizeof(phases) / sizeof(phases[0]); i++) {
        if (strncmp(phase, phases[i], strlen(phases[i])) == 0) {
            return true;
        }
    }
    return false;
}

/* Prints each phase of one axis; of several axes what concerns one of them, and each phase that all
 * of them have entered. */
static void print_progress(void *user, size_t axis, const char *text)
{
    progress_t *progress = (progress_t *)user;
    char phase[PHASE_BYTES];
    size_t i = 0;
    copy_phase(phase, sizeof(phase), text);
    if (progress->axis_count == 1 || concerns_one(phase)) {
        printf("  %s\n", text);
        return;
    }
    while (i < progress->count && strcmp(progress->phases[i].text, phase) != 0) {
        i++;
    }
    if (i == PHASES) {
        printf("  %s\n", text);
        return;
    }
    if (i == progress->count) {
        progress->count++;
        memcpy(progress->phases[i].text, phase, sizeof(phase));
        progress->phases[i].axes = 0;
    }
    progress->phases[i].axes |= UINT32_C(1) << axis;
    if (progress->phases[i].axes == (UINT32_C(1) << progress->axis_count) - 1) {
        progress->phases[i].axes = 0;
        printf("  all %zu axes: %s\n", progress->axis_count, phase);
    }
}

/* Prints the drives that would not stop if the host were lost. */
static bool print_host_loss_risks(igh_cia402_context_t *cia402, size_t axis_count)
{
    igh_cia402_host_loss_info_t loss;
    char text[256];
    bool all_stop = true;
    for (size_t axis = 0; axis < axis_count; axis++) {
        if (igh_cia402_get_host_loss(cia402, axis, &loss) != ECAN_OK) {
            report_sdk_error();
            return false;
        }
        if (!loss.is_controlled_stop) {
            igh_cia402_get_host_loss_text(cia402, axis, text, sizeof(text), NULL);
            printf("warning: %s\n", text);
            all_stop = false;
        }
    }
    if (all_stop) {
        printf("all drives stop if the host is lost\n");
    }
    return true;
}

/* Configures and enables all axes (manual 15.5.4, step 4). */
static bool start_up(igh_cia402_context_t *cia402, bus_t *bus, uint64_t cycles)
{
    uint64_t start = ecan_igh_now_ns(&bus->igh);
    if (igh_cia402_configure_csp_all_timeout(cia402, START_UP_MS) != ECAN_OK ||
        igh_cia402_request_actual_position_all_timeout(cia402, START_UP_MS) != ECAN_OK ||
        igh_cia402_enable_all_timeout(cia402, START_UP_MS) != ECAN_OK) {
        report_sdk_error();
        return false;
    }
    printf("all axes enabled after %.2f s, %" PRIu64 " cycles of motion\n",
           (double)(ecan_igh_now_ns(&bus->igh) - start) / 1e9, cycles);
    return true;
}

/* Runs one cycle with a step of every axis. With an incomplete working counter the SDK moves no
 * axis (manual 15.5.2, step 8). */
static bool run_cycle(igh_cia402_context_t *cia402, bus_t *bus, cycle_health_t *health)
{
    if (igh_mcan_port_wait_next_cycle(&bus->mcan) != ECAN_OK) {
        report_sdk_error();
        return false;
    }
    cycle_begun(health, igh_mcan_port_cycle_begin(&bus->mcan));
    bool is_fine = igh_cia402_process_rx(cia402) == ECAN_OK &&
                   igh_cia402_send_target_step(cia402) == ECAN_OK;
    if (!is_fine) {
        report_sdk_error();
    }
    bool may_go_on = cycle_ended(health, igh_mcan_port_cycle_end(&bus->mcan));
    return is_fine && may_go_on;
}

/* Prints the state of an axis when it changes. */
static bool print_changes(igh_cia402_context_t *cia402, uint8_t *phases, size_t axis_count)
{
    igh_cia402_axis_state_t state;
    char text[256];
    for (size_t axis = 0; axis < axis_count; axis++) {
        if (igh_cia402_get_axis_state(cia402, axis, &state) != ECAN_OK) {
            report_sdk_error();
            return false;
        }
        if (state.phase != phases[axis]) {
            igh_cia402_get_axis_text(cia402, axis, text, sizeof(text), NULL);
            phases[axis] = state.phase;
            printf("  %s\n", text);
        }
    }
    return true;
}

static bool move(igh_cia402_context_t *cia402, bus_t *bus, const motion_t *motion)
{
    igh_cia402_send_summary_t summary;
    cycle_health_t health = {0};
    uint8_t phases[MOTION_MAX_AXES];
    memset(phases, IGH_CIA402_PHASE_RUNNING, sizeof(phases));
    for (uint64_t cycle = 0; cycle < motion->cycles && !interrupt_is_set(); cycle++) {
        bool may_go_on = run_cycle(cia402, bus, &health);
        gateway_report_print_changes(bus);
        if (!may_go_on) {
            return false;
        }
        if (igh_cia402_get_send_summary(cia402, &summary) != ECAN_OK) {
            report_sdk_error();
            return false;
        }
        if (summary.closed > 0 && !print_changes(cia402, phases, motion->drive_count)) {
            return false;
        }
    }
    return true;
}

/* Runs the axes from standstill to standstill. */
static bool run_axes(igh_cia402_context_t *cia402, bus_t *bus, const motion_t *motion)
{
    motion_table_t table;
    /* Outlives this function, like the callback. */
    static progress_t progress;
    progress.axis_count = motion->drive_count;
    if (igh_cia402_set_progress_callback(cia402, print_progress, &progress) != ECAN_OK) {
        report_sdk_error();
        return false;
    }
    bool is_good = print_loads(cia402) && start_up(cia402, bus, motion->cycles) &&
                   print_host_loss_risks(cia402, motion->drive_count) &&
                   move(cia402, bus, motion);
    is_good &= igh_cia402_all_running(cia402);
    is_good &= motion_table_read(&table, cia402);

    printf("%sstopping the axes\n", interrupt_is_set() ? "stopped by the user\n" : "");
    if (igh_cia402_shutdown_timeout(cia402, SHUTDOWN_MS) != ECAN_OK) {
        report_sdk_error();
        is_good = false;
    }
    gateway_report_print_changes(bus);
    motion_table_print(&table);
    real_time_print_statistics(&motion->thread, bus);
    return is_good;
}

bool motion_run(motion_t *motion)
{
    bus_t bus = {0};
    igh_cia402_context_t cia402 = {0};
    /* A gateway without a drive takes part with its first channel. */
    for (size_t slave = 0; slave < motion->bus.slaves; slave++) {
        if (motion->bus.channel_masks[slave] == 0) {
            motion->bus.channel_masks[slave] = 1;
        }
    }
    /* What --plan calls a fault keeps the axes from moving as they should. */
    bool is_planned = check_plan(motion);
    if (!is_planned || motion->bus.plan) {
        return is_planned;
    }
    if (!bring_up(&bus, &motion->bus)) {
        return false;
    }
    bool is_good = real_time_enter(&motion->thread, &bus) && init_axes(&cia402, &bus, motion) &&
                   run_axes(&cia402, &bus, motion);
    /* The axes end with their master. */
    is_good &= shut_down(&bus);
    return is_good;
}
