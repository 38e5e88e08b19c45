/* Real-time options of the programs with a cycle (manual 13.9). */
#ifndef REAL_TIME_H
#define REAL_TIME_H

#include <stdbool.h>
#include <stdint.h>

#include "bring_up.h"
#include "options.h"

typedef struct {
    uint64_t priority; /* 0: as it is */
    const char *cpus;  /* NULL: as they are */
    uint64_t cpu_mask;
    bool lock_memory;
    bool is_required;
    uint64_t latency_us;
    bool is_latency_given;
    uint64_t spin_us;
} real_time_t;

/* Adds the options. */
void real_time_add_options(real_time_t *settings, option_list_t *list);

/* Reads the list of CPUs after options_parse(). Does not return if it is faulty. */
void real_time_check(real_time_t *settings);

/* Applies the options to this thread and its cycle, and measures the cycles if one is given. Returns
 * false, with a message, if --rt-required is given and the system denies one. */
bool real_time_enter(const real_time_t *settings, bus_t *bus);

/* Prints the timing of the cycles if real_time_enter() measures them. */
void real_time_print_statistics(const real_time_t *settings, bus_t *bus);

#endif /* REAL_TIME_H */
