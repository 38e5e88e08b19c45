/* A thread that keeps its period: SCHED_FIFO, memory that stays, absolute deadlines. */
#ifndef REAL_TIME_H
#define REAL_TIME_H

#include <stdbool.h>
#include <stdint.h>

/* Puts the calling thread under SCHED_FIFO with this priority and keeps all memory in RAM. False,
 * with a message on standard error, where that is not permitted. */
bool real_time_enter(int priority);

/* CLOCK_MONOTONIC in nanoseconds. */
uint64_t monotonic_ns(void);

/* Sleeps until `spin_ns` before the deadline of CLOCK_MONOTONIC and spins for the rest, which ends
 * closer to it than any sleep. */
void sleep_until(uint64_t deadline_ns, uint64_t spin_ns);

#endif /* REAL_TIME_H */
