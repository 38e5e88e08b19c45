#include "motion_table.h"

#include <inttypes.h>
#include <stdio.h>

#include "report.h"

static const char *drive_state_text(uint8_t drive_state)
{
    switch (drive_state) {
    case IGH_CIA402_DRIVE_NOT_READY: return "not ready";
    case IGH_CIA402_DRIVE_SWITCH_ON_DISABLED: return "switch on disabled";
    case IGH_CIA402_DRIVE_READY_TO_SWITCH_ON: return "ready to switch on";
    case IGH_CIA402_DRIVE_SWITCHED_ON: return "switched on";
    case IGH_CIA402_DRIVE_OPERATION_ENABLED: return "operation enabled";
    case IGH_CIA402_DRIVE_QUICK_STOP_ACTIVE: return "quick stop active";
    case IGH_CIA402_DRIVE_FAULT_REACTION: return "fault reaction";
    case IGH_CIA402_DRIVE_FAULT: return "fault";
    default: return "unknown";
    }
}

bool motion_table_read(motion_table_t *table, igh_cia402_context_t *cia402)
{
    size_t axes = igh_cia402_axis_count(cia402);
    for (table->count = 0; table->count < axes && table->count < MOTION_MAX_AXES; table->count++) {
        motion_row_t *row = &table->rows[table->count];
        if (igh_cia402_get_axis_state(cia402, table->count, &row->state) != ECAN_OK ||
            igh_cia402_get_axis_statistics(cia402, table->count, &row->statistics) != ECAN_OK) {
            report_sdk_error();
            return false;
        }
        igh_cia402_get_axis_text(cia402, table->count, row->text, sizeof(row->text), NULL);
    }
    return true;
}

/* Prints a number in this width; "-" for none. */
static void print_number(int columns, bool is_there, int64_t number)
{
    if (is_there) {
        printf("%*" PRId64, columns, number);
    } else {
        printf("%*s", columns, "-");
    }
}

static void print_row(size_t axis, const motion_row_t *row)
{
    const igh_cia402_axis_state_t *state = &row->state;
    const igh_cia402_axis_statistics_t *statistics = &row->statistics;
    char name[64];
    bool has_error = state->has_target && state->has_actual;
    uint64_t error = (uint64_t)(state->following_error < 0 ? -state->following_error
                                                           : state->following_error);
    uint64_t max_error = statistics->max_following_error;
    /* The statistics measure the error before the target of the cycle, the column after it. */
    if (has_error && error > max_error) {
        max_error = error;
    }
    snprintf(name, sizeof(name), "%zu: node %u (slave %u, channel %u)", axis, state->node_id,
             state->slave, state->channel);
    printf("%-38s%-20s", name, drive_state_text(state->drive_state));
    print_number(11, state->has_target, state->target);
    print_number(11, state->has_actual, state->actual);
    print_number(8, has_error, state->following_error);
    printf("%8" PRIu64 "%8" PRIu64 "%7" PRIu64 "%6" PRIu32 "\n", max_error, statistics->tpdos,
           statistics->lost_tpdos, statistics->emergencies);
    if (statistics->holds > 0) {
        printf("   held %" PRIu64 " time(s)\n", statistics->holds);
    }
    if (statistics->holds > 0 || state->axis_error != IGH_CIA402_AXIS_ERROR_NONE) {
        printf("   %s\n", row->text);
    }
}

void motion_table_print(const motion_table_t *table)
{
    printf("\n%-38s%-20s%11s%11s%8s%8s%8s%7s%6s\n", "axis", "state", "target", "actual", "error",
           "max", "TPDOs", "lost", "EMCY");
    for (size_t axis = 0; axis < table->count; axis++) {
        print_row(axis, &table->rows[axis]);
    }
}
