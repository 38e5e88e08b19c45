#include "statistics.h"

#include <stdlib.h>
#include <string.h>

#include "report.h"

bool samples_init(samples_t *samples, size_t capacity)
{
    *samples = (samples_t){.values = (uint64_t *)malloc(capacity * sizeof(uint64_t)),
                           .capacity = capacity};
    if (samples->values == NULL) {
        report("not enough memory for %zu samples", capacity);
        return false;
    }
    /* Writes to the memory, to avoid page faults in the cycle. */
    memset(samples->values, 0, capacity * sizeof(uint64_t));
    return true;
}

void samples_free(samples_t *samples)
{
    free(samples->values);
    *samples = (samples_t){0};
}

void samples_add(samples_t *samples, uint64_t value)
{
    if (samples->count < samples->capacity) {
        samples->values[samples->count++] = value;
    }
}

static int compare(const void *left, const void *right)
{
    uint64_t a = *(const uint64_t *)left, b = *(const uint64_t *)right;
    return (a > b) - (a < b);
}

/* Percentile of the samples. */
static uint64_t percentile(const samples_t *samples, size_t percent)
{
    return samples->values[(samples->count * percent + 99) / 100 - 1];
}

distribution_t samples_distribution(samples_t *samples)
{
    if (samples->count == 0) {
        return (distribution_t){0};
    }
    qsort(samples->values, samples->count, sizeof(uint64_t), compare);
    return (distribution_t){
        .min = samples->values[0],
        .max = samples->values[samples->count - 1],
        .p95 = percentile(samples, 95),
        .p99 = percentile(samples, 99)};
}
