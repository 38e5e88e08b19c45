/* The manual's minimal CAN loop (15.4): sends frames through ECAN-Lite gateways every cycle and
 * receives frames; or replays a recording and checks that every frame returns unchanged.
 *
 *     igh_simple_loop --ecrt sim
 *     igh_simple_loop --ecrt sim --replay drive.log --dump back.log
 *     igh_simple_loop --ecrt sim --config cell.toml
 */
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "bring_up.h"
#include "candump_log.h"
#include "cycle_result.h"
#include "echo_check.h"
#include "frame_plan.h"
#include "frame_source.h"
#include "gateway_report.h"
#include "interrupt.h"
#include "options.h"
#include "real_time.h"
#include "report.h"

enum { RX_CAPACITY = 32 };

/* Time without a frame after which none is pending, at the end: the longer of the two. */
#define IDLE_TIMEOUT_NS UINT64_C(200000000)
#define QUIET_CYCLES 20
/* Time without an accepted or returned frame after which a replay ends. */
#define STALL_TIMEOUT_NS UINT64_C(10000000000)

typedef struct {
    bus_settings_t bus;
    real_time_t thread;
    const char *channel;
    bool is_channel_given;
    uint8_t channel_mask;
    uint64_t cycles;
    const char *replay;
    const char *dump;
} arguments_t;

static void parse_arguments(arguments_t *arguments, int argc, char **argv)
{
    option_list_t list = {
        .about = "Sends CAN frames through ECAN-Lite gateways every cycle and receives "
                 "frames."};
    *arguments = (arguments_t){.channel = "0", .cycles = 1000};
    bus_settings_default(&arguments->bus, "echo");
    bus_settings_add_options(&arguments->bus, &list);
    bus_settings_add_fd_option(&arguments->bus, &list);
    bus_settings_add_config_option(&arguments->bus, &list);
    bus_settings_add_plan_option(&arguments->bus, &list);
    real_time_add_options(&arguments->thread, &list);
    options_add(&list, (option_t){
        .name = "slaves", .value_name = "N", .number = &arguments->bus.slaves,
        .minimum = 1, .maximum = ECAN_IGH_MAX_SLAVES, .excluded_by = "config",
        .help = "Number of gateways, from position 0"});
    options_add(&list, (option_t){
        .name = "cycles", .value_name = "N", .number = &arguments->cycles, .maximum = UINT64_MAX,
        .excluded_by = "replay",
        .help = "Number of cycles with frames; a recording is sent to its end"});
    options_add(&list, (option_t){
        .name = "channel", .value_name = "CHANNEL", .text = &arguments->channel,
        .is_given = &arguments->is_channel_given,
        .help = "CAN channel of every gateway, 0 to 3, or `all`; with --config those that the file "
                "has, all unless one is given. With `all` a recorded frame goes to the channel "
                "that its interface names, counted over all gateways"});
    options_add(&list, (option_t){
        .name = "replay", .value_name = "FILE", .text = &arguments->replay,
        .help = "Send the frames of a candump log and check that each returns; `-` is standard input"});
    options_add(&list, (option_t){
        .name = "dump", .value_name = "FILE", .text = &arguments->dump,
        .help = "Write received frames as a candump log"});
    options_parse(&list, argc, argv);
    real_time_check(&arguments->thread);

    uint64_t channel = 0;
    bool is_file_alone = arguments->bus.config != NULL && !arguments->is_channel_given;
    if (strcmp(arguments->channel, "all") == 0 || is_file_alone) {
        arguments->channel_mask = 0x0F;
    } else if (parse_number(arguments->channel, &channel) && channel < ECAN_MCAN_CHANNELS) {
        arguments->channel_mask = (uint8_t)(1u << channel);
    } else {
        options_wrong_use("--channel %s: expected 0 to 3 or `all`", arguments->channel);
    }
    if (arguments->bus.plan && arguments->replay != NULL) {
        options_wrong_use("--plan and --replay exclude each other");
    }
}

/* Selects the channels by the options and the configuration file. */
static bool choose_channels(arguments_t *arguments)
{
    bus_settings_t *bus = &arguments->bus;
    uint8_t used = 0;
    if (bus->config == NULL) {
        memset(bus->channel_masks, arguments->channel_mask, (size_t)bus->slaves);
        memset(bus->fd_masks, bus->fd_bitrate != 0 ? arguments->channel_mask : 0,
               (size_t)bus->slaves);
        return true;
    }
    if (!bus_settings_read_config(bus)) {
        return false;
    }
    for (size_t slave = 0; slave < bus->slaves; slave++) {
        bus->channel_masks[slave] &= arguments->channel_mask;
        used |= bus->channel_masks[slave];
    }
    if (used == 0) {
        report("%s has no channel %s", bus->config, arguments->channel);
    }
    return used != 0;
}

static bool is_same_file(const char *one, const char *other)
{
    struct stat a, b;
    return stat(one, &a) == 0 && stat(other, &b) == 0 && a.st_dev == b.st_dev &&
           a.st_ino == b.st_ino;
}

static bool read_recording(const arguments_t *arguments, candump_log_t *recording)
{
    if (!candump_log_read(recording, arguments->replay)) {
        return false;
    }
    bool is_classic = arguments->bus.fd_bitrate == 0 && arguments->bus.config == NULL;
    for (size_t i = 0; i < recording->count && is_classic; i++) {
        if ((recording->frames[i].record.frame.flags & IGH_MCAN_FLAG_FD) != 0) {
            report("%s, line %zu is a CAN FD frame: set --fd DATA_BITRATE", arguments->replay,
                   recording->frames[i].line);
            candump_log_free(recording);
            return false;
        }
    }
    if (arguments->dump != NULL && is_same_file(arguments->replay, arguments->dump)) {
        report("--dump would overwrite the recording %s", arguments->replay);
        candump_log_free(recording);
        return false;
    }
    return true;
}

/* Receives the frames of this cycle. Returns false, with a message, if it cannot continue. */
static bool receive(bus_t *bus, echo_check_t *check, FILE *dump, uint64_t log_time_ns)
{
    igh_mcan_rx_frame_t rx[RX_CAPACITY];
    size_t rx_count = 0;
    do {
        if (igh_mcan_port_receive(&bus->mcan, rx, RX_CAPACITY, &rx_count) != ECAN_OK) {
            report_sdk_error();
            return false;
        }
        for (size_t i = 0; i < rx_count; i++) {
            if (rx[i].kind != IGH_MCAN_RX_FRAME) {
                continue;
            }
            size_t interface = (size_t)rx[i].slave * ECAN_MCAN_CHANNELS + rx[i].channel;
            echo_check_received(check, &rx[i]);
            if (dump != NULL && !candump_line_write(dump, log_time_ns, interface, &rx[i])) {
                report_errno("cannot write", "received frames");
                return false;
            }
        }
    } while (rx_count == RX_CAPACITY);
    return true;
}

/* Sends to the end of the source and receives until every frame has returned or none arrives any
 * more. Returns false, with a message, if it cannot continue. */
static bool run_loop(bus_t *bus, const bus_settings_t *settings, frame_source_t *source,
                     echo_check_t *check, FILE *dump)
{
    uint64_t cycle_ns = settings->cycle_us * 1000;
    uint64_t quiet_ns =
        QUIET_CYCLES * cycle_ns > IDLE_TIMEOUT_NS ? QUIET_CYCLES * cycle_ns : IDLE_TIMEOUT_NS;
    uint64_t start = ecan_igh_now_ns(&bus->igh), last_activity = 0;
    cycle_health_t health = {0};
    while (!interrupt_is_set()) {
        if (igh_mcan_port_wait_next_cycle(&bus->mcan) != ECAN_OK) {
            report_sdk_error();
            return false;
        }
        cycle_begun(&health, igh_mcan_port_cycle_begin(&bus->mcan));
        uint64_t elapsed = ecan_igh_now_ns(&bus->igh) - start;
        uint64_t frames_before = check->sent + check->returned, due = 0;
        bool is_fine = receive(bus, check, dump, frame_source_log_time(source, elapsed));
        if (is_fine && source->done < source->total) {
            is_fine = frame_source_send(source, &bus->mcan, elapsed, check);
        }
        bool may_go_on = cycle_ended(&health, igh_mcan_port_cycle_end(&bus->mcan));
        if (!is_fine || !may_go_on) {
            return false;
        }
        gateway_report_print_changes(bus);

        if (check->sent + check->returned != frames_before) {
            last_activity = elapsed;
        }
        if (source->done == source->total) {
            bool is_done = check->pending == 0 && !gateway_report_has_pending(bus, settings);
            if (is_done || elapsed - last_activity > quiet_ns) {
                break;
            }
        } else if (frame_source_next_due(source, &due)) {
            /* A gap of the recording is not a stall. */
            uint64_t expected = due > last_activity ? due : last_activity;
            if (elapsed > expected && elapsed - expected > STALL_TIMEOUT_NS) {
                break;
            }
        }
    }
    printf("%s\nran %.3f s, cycle %" PRIu64 " us\n",
           interrupt_is_set() ? "stopped by the user\n" : "",
           (double)(ecan_igh_now_ns(&bus->igh) - start) / 1e9, settings->cycle_us);
    return true;
}

/* Prints the result of the replay. Returns true if every frame returned unchanged and in order. */
static bool report_replay(bus_t *bus, const frame_source_t *source, const echo_check_t *check)
{
    bool is_good = true;
    printf("\nreplay: %" PRIu64 " frames sent, %" PRIu64 " returned\n", check->sent,
           check->returned);
    if (check->first_difference[0] != '\0') {
        report("%s", check->first_difference);
        is_good = false;
    }
    if (source->done < source->total) {
        report("%" PRIu64 " frames were not sent", source->total - source->done);
        is_good = false;
    }
    if (check->pending > 0) {
        report("%zu frames did not return", check->pending);
        is_good = false;
    }
    for (size_t slave = 0; slave < source->slaves; slave++) {
        is_good &= gateway_report_is_flawless(bus, slave);
    }
    if (is_good) {
        printf("replay: all frames unchanged and in order\n");
    }
    return is_good;
}

/* Opens a file for writing; a link is followed to a pipe or a device only, such as /dev/stdout. */
static FILE *open_dump(const char *path)
{
    struct stat found;
    bool is_stream = stat(path, &found) == 0 && !S_ISREG(found.st_mode);
    int flags = is_stream ? O_WRONLY : O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW;
    int file = open(path, flags | O_CLOEXEC, 0666);
    return file < 0 ? NULL : fdopen(file, "w");
}

/* Loop with the ready gateways, and the report at its end. */
static bool work(bus_t *bus, const arguments_t *arguments, const candump_log_t *recording)
{
    bool is_replay = arguments->replay != NULL;
    frame_source_t source = {
        .recording = is_replay ? recording : NULL,
        .slaves = (size_t)arguments->bus.slaves,
        .channel_masks = arguments->bus.channel_masks,
        .fd_masks = arguments->bus.fd_masks,
        .is_by_interface = arguments->channel_mask == 0x0F,
        .total = is_replay ? recording->count : arguments->cycles};
    echo_check_t check;
    FILE *dump = NULL;
    if (arguments->dump != NULL && (dump = open_dump(arguments->dump)) == NULL) {
        report_errno("cannot write", arguments->dump);
        report_is_of_file();
        return false;
    }
    bool is_good = echo_check_init(&check, source.slaves);
    if (is_good) {
        is_good = run_loop(bus, &arguments->bus, &source, &check, dump);
        is_good &= gateway_report_print(bus, &arguments->bus);
        real_time_print_statistics(&arguments->thread, bus);
        if (is_good && is_replay) {
            is_good = report_replay(bus, &source, &check);
        } else if (is_good && !interrupt_is_set() &&
                   igh_mcan_port_check_delivery(&bus->mcan) != ECAN_OK) {
            report_sdk_error();
            is_good = false;
        }
        echo_check_free(&check);
    }
    if (dump != NULL && fclose(dump) != 0 && is_good) {
        report_errno("cannot write", arguments->dump);
        report_is_of_file();
        is_good = false;
    }
    return is_good;
}

/* Plan of the counter's frames. */
static bool print_plan(const arguments_t *arguments)
{
    igh_mcan_tx_frame_t frame;
    if (frame_source_counter(&frame, 0, 0, arguments->bus.fd_bitrate != 0, 0) != ECAN_OK) {
        report_sdk_error();
        return false;
    }
    return frame_plan_print(&arguments->bus, &frame);
}

int main(int argc, char **argv)
{
    arguments_t arguments;
    candump_log_t recording = {0};
    bus_t bus = {0};
    parse_arguments(&arguments, argc, argv);
    if (!choose_channels(&arguments)) {
        return report_exit_status(false);
    }
    if (arguments.bus.plan) {
        return report_exit_status(print_plan(&arguments));
    }
    if (arguments.replay != NULL && !read_recording(&arguments, &recording)) {
        return report_exit_status(false);
    }
    bool is_good = bring_up(&bus, &arguments.bus);
    if (is_good) {
        is_good = real_time_enter(&arguments.thread, &bus) &&
                  work(&bus, &arguments, &recording);
        is_good &= shut_down(&bus);
    }
    candump_log_free(&recording);
    return report_exit_status(is_good);
}
