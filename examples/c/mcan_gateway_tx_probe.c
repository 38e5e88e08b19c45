/* How steadily frames leave a gateway, sent directly or scheduled to a phase of Sync0 (manual
 * 13.9).
 *
 *     igh_mcan_gateway_tx_probe --ecrt sim --frames 1000
 *     igh_mcan_gateway_tx_probe --cycle-us 1000 --fd 2000000 --offset-ns 100000 \
 *         --rt-priority 80 --spin-us 100
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "bring_up.h"
#include "cycle_result.h"
#include "frame_plan.h"
#include "igh_real_time.h"
#include "interrupt.h"
#include "options.h"
#include "real_time.h"
#include "report.h"
#include "statistics.h"

enum {
    PROBE_ID = 0x123,
    CLASSIC_BYTES = 8,
    FD_BYTES = 16,
    RX_CAPACITY = 32
};

/* Time to wait for pending frames at the end. */
#define IDLE_TIMEOUT_NS UINT64_C(500000000)
/* Time without an accepted frame after which the program ends. */
#define STALL_TIMEOUT_NS UINT64_C(10000000000)

typedef struct {
    bus_settings_t bus;
    uint64_t channel;
    uint64_t frames;
    uint64_t offset_ns;
    bool is_scheduled;
    real_time_t thread;
} arguments_t;

/* Results of the run. */
typedef struct {
    uint64_t sent;
    uint64_t rejected;
    uint64_t received;
    uint64_t order_errors;
    uint64_t next_number;     /* number of the next expected frame */
    uint64_t last_receive_ns; /* 0 before the first */
    samples_t rx_periods;
} result_t;

static void parse_arguments(arguments_t *arguments, int argc, char **argv)
{
    option_list_t list = {
        .about = "Sends one CAN frame per cycle, directly or scheduled, and measures the periods."};
    *arguments = (arguments_t){.frames = 1000};
    bus_settings_default(&arguments->bus, "echo");
    bus_settings_add_options(&arguments->bus, &list);
    bus_settings_add_fd_option(&arguments->bus, &list);
    bus_settings_add_dc_options(&arguments->bus, &list);
    bus_settings_add_plan_option(&arguments->bus, &list);
    options_add(&list, (option_t){
        .name = "channel", .value_name = "CHANNEL", .number = &arguments->channel,
        .maximum = ECAN_MCAN_CHANNELS - 1,
        .help = "CAN channel"});
    options_add(&list, (option_t){
        .name = "frames", .value_name = "N", .number = &arguments->frames,
        .minimum = 1, .maximum = 10000000,
        .help = "Number of frames, one per cycle"});
    options_add(&list, (option_t){
        .name = "offset-ns", .value_name = "NS", .number = &arguments->offset_ns,
        .maximum = UINT32_MAX, .is_given = &arguments->is_scheduled,
        .help = "Schedule the frames at this time after Sync0 instead of sending them directly; "
                "implies --dc-sync0"});
    real_time_add_options(&arguments->thread, &list);
    options_parse(&list, argc, argv);
    real_time_check(&arguments->thread);
    arguments->bus.dc_sync0 |= arguments->is_scheduled;
    arguments->bus.channel_masks[0] = (uint8_t)(1u << arguments->channel);
}

/* Makes the frame with this number. */
static int make_frame(igh_mcan_tx_frame_t *frame, const arguments_t *arguments, uint64_t number)
{
    uint8_t data[FD_BYTES] = {0}, channel = (uint8_t)arguments->channel;
    for (size_t i = 0; i < sizeof(number); i++) {
        data[i] = (uint8_t)(number >> (8 * i));
    }
    int made = arguments->bus.fd_bitrate == 0
                   ? igh_mcan_tx_frame_set_can(frame, 0, channel, PROBE_ID, 0, data, CLASSIC_BYTES)
                   : igh_mcan_tx_frame_set_canfd(frame, 0, channel, PROBE_ID, IGH_MCAN_FLAG_BRS,
                                                 data, FD_BYTES);
    if (made == ECAN_OK && arguments->is_scheduled) {
        made = igh_mcan_tx_frame_set_schedule(frame, (uint32_t)arguments->offset_ns,
                                              (uint16_t)number);
    }
    return made;
}

/* Sends the next frame. */
static int send_frame(bus_t *bus, const arguments_t *arguments, uint64_t number)
{
    igh_mcan_tx_frame_t frame;
    int made = make_frame(&frame, arguments, number);
    return made == ECAN_OK ? igh_mcan_port_send(&bus->mcan, &frame) : made;
}

static bool receive(bus_t *bus, result_t *result, uint64_t now_ns)
{
    igh_mcan_rx_frame_t rx[RX_CAPACITY];
    size_t rx_count = 0;
    do {
        if (igh_mcan_port_receive(&bus->mcan, rx, RX_CAPACITY, &rx_count) != ECAN_OK) {
            report_sdk_error();
            return false;
        }
        for (size_t i = 0; i < rx_count; i++) {
            uint64_t number = 0;
            if (rx[i].can_id != PROBE_ID || rx[i].len < sizeof(number)) {
                continue;
            }
            for (size_t byte = sizeof(number); byte-- > 0;) {
                number = number << 8 | rx[i].data[byte];
            }
            result->order_errors += number != result->next_number;
            result->next_number = number + 1;
            result->received++;
            if (result->last_receive_ns != 0) {
                samples_add(&result->rx_periods, now_ns - result->last_receive_ns);
            }
            result->last_receive_ns = now_ns;
        }
    } while (rx_count == RX_CAPACITY);
    return true;
}

/* Sends all frames and waits for pending ones. Returns false, with a message, if it cannot
 * continue. */
static bool run_cycles(bus_t *bus, const arguments_t *arguments, result_t *result)
{
    cycle_health_t health = {0};
    uint64_t last_sent = ecan_igh_now_ns(&bus->igh);
    while (!interrupt_is_set()) {
        if (igh_mcan_port_wait_next_cycle(&bus->mcan) != ECAN_OK) {
            report_sdk_error();
            return false;
        }
        uint64_t now = ecan_igh_now_ns(&bus->igh);
        bool is_sending = result->sent < arguments->frames;
        cycle_begun(&health, igh_mcan_port_cycle_begin(&bus->mcan));
        bool is_fine = receive(bus, result, now);
        if (is_sending) {
            /* A temporarily rejected frame is sent again in the next cycle. */
            int sent = send_frame(bus, arguments, result->sent);
            if (sent == ECAN_OK) {
                result->sent++;
                last_sent = now;
            } else if (is_temporary(sent)) {
                result->rejected++;
            } else if (is_fine) {
                report_sdk_error();
                is_fine = false;
            }
        }
        bool may_go_on = cycle_ended(&health, igh_mcan_port_cycle_end(&bus->mcan));
        if (!is_fine || !may_go_on) {
            return false;
        }
        if (is_sending && now - last_sent > STALL_TIMEOUT_NS) {
            report("no frame was taken for 10 s: %s", ecan_last_error());
            return false;
        }
        if (!is_sending &&
            (result->received >= result->sent || now - last_sent > IDLE_TIMEOUT_NS)) {
            break;
        }
    }
    if (interrupt_is_set()) {
        printf("stopped by the user\n");
    }
    return true;
}

static void print_periods(const char *name, samples_t *samples, uint64_t cycle_ns)
{
    distribution_t d = samples_distribution(samples);
    uint64_t below = cycle_ns > d.min ? cycle_ns - d.min : 0;
    uint64_t above = d.max > cycle_ns ? d.max - cycle_ns : 0;
    if (samples->count == 0) {
        printf("%s: none\n", name);
        return;
    }
    printf("%s: min/max %.3f/%.3f us, p95 %.3f us, p99 %.3f us, max error %.3f us\n", name,
           (double)d.min / 1e3, (double)d.max / 1e3, (double)d.p95 / 1e3, (double)d.p99 / 1e3,
           (double)(above > below ? above : below) / 1e3);
}

static void print_result(bus_t *bus, result_t *result, const arguments_t *arguments)
{
    char master_period[512];
    uint64_t cycle_ns = arguments->bus.cycle_us * 1000;
    printf("%" PRIu64 " frames sent, %" PRIu64 " rejections; the frame was sent in a later cycle\n",
           result->sent, result->rejected);
    printf("%" PRIu64 " returned, %" PRIu64 " out of order\n", result->received,
           result->order_errors);
    if (ecan_igh_get_cycle_statistics_text(&bus->igh, master_period, sizeof(master_period), NULL) ==
        ECAN_OK) {
        printf("%s\n", master_period);
    }
    print_periods("rx_period", &result->rx_periods, cycle_ns);
    printf("rx_period is measured by the host, in whole cycles; times on the bus need an "
           "analyser\n");
}

/* Measurement with the ready gateway. */
static bool work(bus_t *bus, const arguments_t *arguments)
{
    result_t result = {0};
    bool is_good = samples_init(&result.rx_periods, (size_t)arguments->frames * 2) &&
                   real_time_enter(&arguments->thread, bus) &&
                   ecan_igh_measure_cycles(&bus->igh) == ECAN_OK;
    if (is_good) {
        is_good = run_cycles(bus, arguments, &result);
        print_result(bus, &result, arguments);
    }
    samples_free(&result.rx_periods);
    return is_good;
}

/* Plan of the probe's frames. */
static bool print_plan(const arguments_t *arguments)
{
    igh_mcan_tx_frame_t frame;
    if (make_frame(&frame, arguments, 0) != ECAN_OK) {
        report_sdk_error();
        return false;
    }
    return frame_plan_print(&arguments->bus, &frame);
}

int main(int argc, char **argv)
{
    arguments_t arguments;
    bus_t bus = {0};
    parse_arguments(&arguments, argc, argv);
    if (arguments.bus.plan) {
        return report_exit_status(print_plan(&arguments));
    }
    if (!bring_up(&bus, &arguments.bus)) {
        return report_exit_status(false);
    }
    bool is_good = work(&bus, &arguments);
    is_good &= shut_down(&bus);
    return report_exit_status(is_good);
}
