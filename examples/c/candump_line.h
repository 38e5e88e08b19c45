/* One line of a candump log (candump -L): reading and writing it. */
#ifndef CANDUMP_LINE_H
#define CANDUMP_LINE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "igh_mcan_pdo.h"

/* Content of a line. */
typedef struct {
    uint64_t time_ns;
    unsigned interface;        /* N of "canN", "vcanN" and the like; 0 without a number */
    igh_mcan_tx_frame_t frame; /* slave and channel are left 0 */
} candump_record_t;

typedef enum {
    CANDUMP_LINE_RECORD,
    CANDUMP_LINE_EMPTY, /* blank, or a comment that starts with `#` */
    CANDUMP_LINE_FAULT,
} candump_line_t;

/* Fault of a line, with its column from 1. */
typedef struct {
    const char *text; /* valid until the next error of the SDK */
    size_t column;
} candump_fault_t;

/* Parses a line, with or without its line break. */
candump_line_t candump_line_read(const char *line, candump_record_t *record,
                                 candump_fault_t *fault);

/* Writes a received frame as a line of the interface `can<interface>`. Returns false, with the
 * reason in errno, if the file cannot be written. */
bool candump_line_write(FILE *file, uint64_t time_ns, size_t interface,
                        const igh_mcan_rx_frame_t *frame);

#endif /* CANDUMP_LINE_H */
