/* The preflight plan of frames, for --plan. */
#ifndef FRAME_PLAN_H
#define FRAME_PLAN_H

#include <stdbool.h>

#include "bring_up.h"

/* Bytes of a plan in words. */
enum { PLAN_TEXT = 32768 };

/* Prints what the settings cost when every channel in use sends such a frame in each cycle and gets
 * one back; its slave and channel do not count. False, with every reason on standard error, where it
 * would not work. */
bool frame_plan_print(const bus_settings_t *settings, const igh_mcan_tx_frame_t *frame);

#endif /* FRAME_PLAN_H */
