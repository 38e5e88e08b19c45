/* What the return values of the cycle mean for a program: go on, send again later, give up. */
#ifndef CYCLE_RESULT_H
#define CYCLE_RESULT_H

#include <stdbool.h>

/* Whether a frame was refused only for now: no room, or a gateway or bus out of service. */
bool is_refused_for_now(int send_result);

/* Judges a cycle by what cycle_begin and cycle_end returned and counts failures in a row. Single
 * cycles may fail; false, with a message on standard error, when too many did. */
bool cycle_may_go_on(unsigned *failed_in_a_row, int begun, int ended);

#endif /* CYCLE_RESULT_H */
