/* Boots the CANopen nodes of a configuration file (CiA 302-2), enables its axes, and moves them by their
 * target steps.
 *
 *     igh_canopen_network --config examples/network/machine.toml \
 *         --ecrt sim:examples/network/simulated.toml
 */
#include <inttypes.h>
#include <stdio.h>

#include "bring_up.h"
#include "cycle_result.h"
#include "igh_canopen.h"
#include "interrupt.h"
#include "options.h"
#include "report.h"

/* Timeouts of the boot-up, of each step of the startup of the axes, and of the shutdown. */
enum { BOOT_MS = 30000, START_UP_MS = 30000, SHUTDOWN_MS = 20000 };
enum { TEXT_BYTES = 512 };

typedef struct {
    bus_settings_t bus;
    uint64_t cycles;
} arguments_t;

static void parse_arguments(arguments_t *arguments, int argc, char **argv)
{
    option_list_t list = {
        .about = "Boots the CANopen nodes and moves the axes of a configuration file."};
    *arguments = (arguments_t){.cycles = 1000};
    bus_settings_default(&arguments->bus, "drives");
    bus_settings_add_options(&arguments->bus, &list);
    bus_settings_add_config_option(&arguments->bus, &list);
    options_add(&list, (option_t){
        .name = "cycles", .value_name = "N", .number = &arguments->cycles, .maximum = UINT64_MAX,
        .help = "Number of cycles with motion"});
    options_parse(&list, argc, argv);
    if (arguments->bus.config == NULL) {
        options_wrong_use("--config FILE is missing: a configuration file with [[node]] tables");
    }
}

static void print_progress(void *user, size_t index, const char *text)
{
    (void)user;
    (void)index;
    printf("%s\n", text);
}

/* Waits until all mandatory nodes are booted; prints each change. */
static bool boot_nodes(igh_cia402_context_t *network)
{
    printf("%zu nodes, %zu axes\n", igh_canopen_node_count(network),
           igh_cia402_axis_count(network));
    if (igh_canopen_set_boot_callback(network, print_progress, NULL) != ECAN_OK ||
        igh_canopen_wait_booted_timeout(network, BOOT_MS) != ECAN_OK) {
        report_sdk_error();
        return false;
    }
    return true;
}

/* Prints the nodes that do not run as configured; optional ones may fail. */
static bool print_nodes(igh_cia402_context_t *network)
{
    size_t count = igh_canopen_node_count(network);
    for (size_t node = 0; node < count; node++) {
        igh_canopen_boot_progress_t progress;
        char text[TEXT_BYTES];
        if (igh_canopen_get_boot_progress(network, node, &progress) != ECAN_OK ||
            igh_canopen_get_boot_text(network, node, text, sizeof(text), NULL) != ECAN_OK) {
            report_sdk_error();
            return false;
        }
        if (progress.phase != IGH_CANOPEN_BOOT_PHASE_NONE &&
            progress.phase != IGH_CANOPEN_BOOT_PHASE_BOOTED) {
            printf("%s\n", text);
        }
    }
    return true;
}

/* Moves the axes by their target steps. */
static bool move(bus_t *bus, igh_cia402_context_t *network, uint64_t cycles)
{
    if (igh_cia402_set_progress_callback(network, print_progress, NULL) != ECAN_OK ||
        igh_cia402_start_up_timeout(network, START_UP_MS) != ECAN_OK) {
        report_sdk_error();
        return false;
    }
    cycle_health_t health = {0};
    for (uint64_t cycle = 0; cycle < cycles && !interrupt_is_set(); cycle++) {
        igh_mcan_port_wait_next_cycle(&bus->mcan);
        cycle_begun(&health, igh_mcan_port_cycle_begin(&bus->mcan));
        igh_cia402_process_rx(network);
        igh_cia402_send_target_step(network);
        if (!cycle_ended(&health, igh_mcan_port_cycle_end(&bus->mcan))) {
            return false;
        }
    }
    for (size_t axis = 0; axis < igh_cia402_axis_count(network); axis++) {
        igh_cia402_axis_state_t state;
        if (igh_cia402_get_axis_state(network, axis, &state) == ECAN_OK && state.has_actual) {
            printf("axis %zu: actual position %" PRId32 "\n", axis, state.actual);
        }
    }
    return igh_cia402_axis_count(network) == 0 || igh_cia402_all_running(network) == 1 ||
           interrupt_is_set();
}

int main(int argc, char **argv)
{
    arguments_t arguments;
    bus_t bus = {0};
    igh_cia402_context_t network;
    parse_arguments(&arguments, argc, argv);
    if (!bus_settings_read_config(&arguments.bus) || !interrupt_install() ||
        !bring_up(&bus, &arguments.bus)) {
        return report_exit_status(false);
    }
    bool is_good = true;
    if (igh_cia402_context_init_file(&network, &bus.mcan, arguments.bus.config, NULL) != ECAN_OK) {
        report_sdk_error();
        is_good = false;
    } else {
        is_good = boot_nodes(&network) && print_nodes(&network) &&
                  move(&bus, &network, arguments.cycles);
        /* Stops and disables the drives, also after an error. */
        if (igh_cia402_shutdown_timeout(&network, SHUTDOWN_MS) != ECAN_OK) {
            report_sdk_error();
            is_good = false;
        } else {
            printf("stopped\n");
        }
    }
    is_good &= shut_down(&bus);
    return report_exit_status(is_good);
}
