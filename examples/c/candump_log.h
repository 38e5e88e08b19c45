/* A recording: a whole log file of candump (candump -L, candump -l). */
#ifndef CANDUMP_LOG_H
#define CANDUMP_LOG_H

#include <stdbool.h>
#include <stddef.h>

#include "candump_line.h"

/* One frame of a recording. */
typedef struct {
    size_t line; /* in the file, from 1 */
    candump_record_t record;
} logged_frame_t;

typedef struct {
    logged_frame_t *frames;
    size_t count;
} candump_log_t;

/* Reads a file. Returns false, with a message on standard error and nothing to free, if it
 * cannot be read, is not a candump log or contains no frame. */
bool candump_log_read(candump_log_t *log, const char *path);

void candump_log_free(candump_log_t *log);

#endif /* CANDUMP_LOG_H */
