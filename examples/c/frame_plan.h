/* The preflight plan of frames, for --plan. */
#ifndef FRAME_PLAN_H
#define FRAME_PLAN_H

#include <stdbool.h>

#include "bring_up.h"

/* Bytes of the text of a plan. */
enum { PLAN_TEXT = 32768 };

/* Prints the load of the settings if every enabled channel sends and receives such a frame in
 * each cycle; slave and channel of the frame are ignored. Returns false, with every fault on
 * standard error, for a faulty plan. */
bool frame_plan_print(const bus_settings_t *settings, const igh_mcan_tx_frame_t *frame);

#endif /* FRAME_PLAN_H */
