/* What the return values of the cycle mean for a program: go on, send again later, give up. */
#ifndef CYCLE_RESULT_H
#define CYCLE_RESULT_H

#include <stdbool.h>

/* How the cycles went; all 0 at the start. */
typedef struct {
    int result;               /* of the cycle that is open */
    unsigned failed_in_a_row; /* cycles */
    char words[256];          /* why the last one failed; later calls have other errors */
} cycle_health_t;

/* Takes what igh_mcan_port_cycle_begin() returned. */
void cycle_begun(cycle_health_t *health, int result);

/* Takes what igh_mcan_port_cycle_end() returned. Single cycles may fail; false, with a message on
 * standard error, when too many did in a row. */
bool cycle_ended(cycle_health_t *health, int result);

/* Whether a frame was refused only for now: no room, or a gateway or bus out of service. */
bool is_refused_for_now(int send_result);

#endif /* CYCLE_RESULT_H */
