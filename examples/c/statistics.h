/* Minimum, maximum and percentiles of times. */
#ifndef STATISTICS_H
#define STATISTICS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct {
    uint64_t *values;
    size_t count;
    size_t capacity;
} samples_t;

typedef struct {
    uint64_t min, max, p95, p99;
} distribution_t;

/* Allocates the memory before the cycle. Returns false, with a message on standard error, if
 * there is not enough. */
bool samples_init(samples_t *samples, size_t capacity);

void samples_free(samples_t *samples);

/* Adds a value; values beyond the capacity are dropped. */
void samples_add(samples_t *samples, uint64_t value);

/* Sorts the samples. All 0 without samples. */
distribution_t samples_distribution(samples_t *samples);

#endif /* STATISTICS_H */
