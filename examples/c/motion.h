/* Common part of the CiA 402 demos: options, startup, motion and shutdown (manual 15.5.4, 15.6). */
#ifndef MOTION_H
#define MOTION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "bring_up.h"
#include "options.h"
#include "real_time.h"

enum { MOTION_MAX_AXES = 10 };

/* Address of a drive. */
typedef struct {
    size_t slave;
    uint8_t channel;
    uint8_t node_id;
} drive_place_t;

typedef struct {
    bus_settings_t bus;
    real_time_t thread;
    drive_place_t drives[MOTION_MAX_AXES];
    size_t drive_count;
    int32_t step;
    uint64_t motion_div;
    uint64_t cycles;
} motion_t;

/* No drives, and no motion. */
void motion_default(motion_t *motion, uint64_t cycles);

/* The options of the manual's table. The number of gateways has its default already. */
void motion_add_options(motion_t *motion, option_list_t *list);

/* Adds a drive and enables its channel. */
void motion_add_drive(motion_t *motion, drive_place_t index);

/* Runs the demo. Returns true if every axis followed its targets until the end; every other
 * result has a message on standard error or a line in the table. */
bool motion_run(motion_t *motion);

#endif /* MOTION_H */
