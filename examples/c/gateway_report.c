#include "gateway_report.h"

#include <inttypes.h>
#include <stdio.h>

#include "report.h"

void gateway_report_print_changes(bus_t *bus)
{
    char text[256];
    /* A text is valid also if it was cut. */
    while (igh_mcan_port_next_change(&bus->mcan, text, sizeof(text), NULL), text[0] != '\0') {
        printf("%s\n", text);
    }
}

static bool print_channels(bus_t *bus, size_t slave, uint8_t channel_mask)
{
    for (uint8_t channel = 0; channel < ECAN_MCAN_CHANNELS; channel++) {
        igh_mcan_channel_statistics_t count;
        if ((channel_mask >> channel & 1) == 0) {
            continue;
        }
        if (igh_mcan_port_get_channel_statistics(&bus->mcan, slave, channel, &count) != ECAN_OK) {
            report_sdk_error();
            return false;
        }
        uint64_t rejected =
            count.rejected_image_full + count.rejected_queue_full + count.rejected_bus_off;
        printf("slave %zu can%u %10" PRIu64 "%10" PRIu64 "%8" PRIu64 "%10" PRIu64 "%10" PRIu64
               "%10" PRIu64 "%10" PRIu64 "%10" PRIu64 "%10" PRIu64 "\n",
               slave, channel, count.frames_accepted, count.frames_delivered, count.frames_lost,
               count.frames_discarded, count.frames_unknown, count.frames_pending,
               count.frames_received, count.frames_not_taken, rejected);
    }
    return true;
}

static bool print_gateway(bus_t *bus, size_t slave)
{
    igh_mcan_statistics_t count;
    if (igh_mcan_port_get_statistics(&bus->mcan, slave, &count) != ECAN_OK) {
        report_sdk_error();
        return false;
    }
    printf("slave %-8zu%10" PRIu64 "%10" PRIu64 "%10" PRIu64 "%10" PRIu64 "%10" PRIu64 "%10" PRIu64
           "%10" PRIu64 "%10" PRIu64 "%10" PRIu64 "\n",
           slave, count.cycles, count.incomplete_cycles, count.rxpdo_published,
           count.rxpdo_repeated, count.txpdo_received, count.txpdo_lost, count.txpdo_discarded,
           count.txpdo_unknown, count.parse_errors + count.txpdo_torn);
    if (count.sessions_lost > 0 || count.txpdo_incomplete > 0) {
        printf("%-14ssession lost %" PRIu64 " time(s), incomplete images %" PRIu64 "\n", "",
               count.sessions_lost, count.txpdo_incomplete);
    }
    return true;
}

bool gateway_report_has_pending(bus_t *bus, const bus_settings_t *settings)
{
    for (size_t slave = 0; slave < settings->slaves; slave++) {
        for (uint8_t channel = 0; channel < ECAN_MCAN_CHANNELS; channel++) {
            igh_mcan_channel_statistics_t count;
            if (igh_mcan_port_get_channel_statistics(&bus->mcan, slave, channel, &count) ==
                    ECAN_OK &&
                count.frames_pending > 0) {
                return true;
            }
        }
    }
    return false;
}

bool gateway_report_print(bus_t *bus, const bus_settings_t *settings)
{
    bool is_complete = true;
    printf("\n%-13s %10s%10s%8s%10s%10s%10s%10s%10s%10s\n", "channel", "accepted", "delivered",
           "lost", "discarded", "unknown", "pending", "received", "not taken", "rejected");
    for (size_t slave = 0; slave < settings->slaves; slave++) {
        is_complete &= print_channels(bus, slave, settings->channel_masks[slave]);
    }
    printf("\n%-14s%10s%10s%10s%10s%10s%10s%10s%10s%10s\n", "gateway", "cycles", "wc miss",
           "images", "repeated", "rx images", "rx lost", "rx disc.", "rx unkn.", "errors");
    for (size_t slave = 0; slave < settings->slaves; slave++) {
        is_complete &= print_gateway(bus, slave);
    }
    return is_complete;
}

bool gateway_report_is_flawless(bus_t *bus, size_t slave)
{
    igh_mcan_statistics_t count;
    char text[256];
    int session = igh_mcan_port_get_session(&bus->mcan, slave);
    igh_mcan_port_get_session_text(&bus->mcan, slave, text, sizeof(text), NULL);
    if (session < 0 || igh_mcan_port_get_statistics(&bus->mcan, slave, &count) != ECAN_OK) {
        report_sdk_error();
        return false;
    }
    uint64_t errors = count.parse_errors + count.txpdo_torn;
    uint64_t lost = count.txpdo_lost + count.txpdo_unknown;
    if (errors + lost > 0) {
        report("slave %zu: %" PRIu64 " image errors, %" PRIu64 " images lost or unknown", slave,
               errors, lost);
    }
    if (session != IGH_MCAN_SESSION_READY) {
        report("slave %zu is %s", slave, text);
    }
    return errors + lost == 0 && session == IGH_MCAN_SESSION_READY;
}
