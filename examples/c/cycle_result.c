#include "cycle_result.h"

#include <stdio.h>

#include "igh_ecan_common.h"
#include "report.h"

enum { MAX_FAILED_CYCLES = 100 };

static void take(cycle_health_t *health, int result)
{
    if (result != ECAN_OK) {
        health->result = result;
        snprintf(health->text, sizeof(health->text), "%s", ecan_last_error());
    }
}

void cycle_begun(cycle_health_t *health, int result)
{
    health->result = ECAN_OK;
    take(health, result);
}

bool cycle_ended(cycle_health_t *health, int result)
{
    take(health, result);
    if (health->result == ECAN_OK) {
        health->failed_in_a_row = 0;
        return true;
    }
    /* Any code except a failed call of the master is an error of the program. */
    if (health->result != ECAN_ERR_MASTER) {
        report("%s", health->text);
        return false;
    }
    health->failed_in_a_row++;
    if (health->failed_in_a_row > MAX_FAILED_CYCLES) {
        report("more than %d cycles in a row failed: %s", MAX_FAILED_CYCLES, health->text);
        return false;
    }
    return true;
}

bool is_temporary(int send_result)
{
    return send_result == ECAN_ERR_NO_ROOM || send_result == ECAN_ERR_QUEUE_FULL ||
           send_result == ECAN_ERR_BUS_OFF || send_result == ECAN_ERR_NOT_READY;
}
