/* The table of the axes at the end of a motion demo. */
#ifndef MOTION_TABLE_H
#define MOTION_TABLE_H

#include <stdbool.h>

#include "igh_cia402_protocol.h"
#include "motion.h"

/* State of an axis at one time. */
typedef struct {
    igh_cia402_axis_state_t state;
    igh_cia402_axis_statistics_t statistics;
    char text[256];
} motion_row_t;

typedef struct {
    motion_row_t rows[MOTION_MAX_AXES];
    size_t count;
} motion_table_t;

/* Reads the rows; call it before the shutdown, which disables the axes. Returns false, with a
 * message on standard error and the rows so far, on failure. */
bool motion_table_read(motion_table_t *table, igh_cia402_context_t *cia402);

/* One line per axis: state, target, actual position, following error, gaps, emergencies. */
void motion_table_print(const motion_table_t *table);

#endif /* MOTION_TABLE_H */
