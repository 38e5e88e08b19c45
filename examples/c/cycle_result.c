#include "cycle_result.h"

#include "igh_ecan_common.h"
#include "report.h"

enum { MAX_FAILED_CYCLES = 100 };

bool is_refused_for_now(int send_result)
{
    return send_result == ECAN_ERR_NO_ROOM || send_result == ECAN_ERR_QUEUE_FULL ||
           send_result == ECAN_ERR_BUS_OFF || send_result == ECAN_ERR_NOT_READY;
}

bool cycle_may_go_on(unsigned *failed_in_a_row, int begun, int ended)
{
    int result = ended != ECAN_OK ? ended : begun;
    if (result == ECAN_OK) {
        *failed_in_a_row = 0;
        return true;
    }
    /* Anything else than trouble with the master is a mistake of the program. */
    if (result != ECAN_ERR_MASTER) {
        report_sdk_error();
        return false;
    }
    ++*failed_in_a_row;
    if (*failed_in_a_row > MAX_FAILED_CYCLES) {
        report("more than %d cycles in a row failed: %s", MAX_FAILED_CYCLES, ecan_last_error());
        return false;
    }
    return true;
}
