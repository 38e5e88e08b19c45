/* Reactions of a program to the return values of the cycle: continue, send again later, or exit. */
#ifndef CYCLE_RESULT_H
#define CYCLE_RESULT_H

#include <stdbool.h>

/* Results of the cycles; all 0 at the start. */
typedef struct {
    int result;               /* of the cycle that is open */
    unsigned failed_in_a_row; /* cycles */
    char text[256];          /* error of the last failed one; later calls have other errors */
} cycle_health_t;

/* Stores the return value of igh_mcan_port_cycle_begin(). */
void cycle_begun(cycle_health_t *health, int result);

/* Stores the return value of igh_mcan_port_cycle_end(). Single cycles may fail; returns false,
 * with a message on standard error, if too many fail in a row. */
bool cycle_ended(cycle_health_t *health, int result);

/* Returns true for a temporary rejection: the image is full, the gateway is not ready, or the
 * channel is bus-off. */
bool is_temporary(int send_result);

#endif /* CYCLE_RESULT_H */
