/* Comparing what comes back with what was sent: every frame on its channel, unchanged and in order.
 * Channels are counted over all gateways. */
#ifndef ECHO_CHECK_H
#define ECHO_CHECK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "igh_mcan_pdo.h"

/* Frames of one channel that did not come back yet, as a ring. */
typedef struct {
    igh_mcan_tx_frame_t *frames;
    size_t first;
    size_t count;
} under_way_t;

typedef struct {
    under_way_t *channels;
    size_t channel_count;
    size_t under_way; /* on all channels */
    uint64_t sent;
    uint64_t returned;
    char first_difference[256]; /* "" as long as everything comes back as it should */
} echo_check_t;

/* Takes the memory, so that the cycle need not. False, with a message on standard error, where
 * there is too little. */
bool echo_check_init(echo_check_t *check, size_t slaves);

void echo_check_free(echo_check_t *check);

void echo_check_sent(echo_check_t *check, const igh_mcan_tx_frame_t *frame);

void echo_check_received(echo_check_t *check, const igh_mcan_rx_frame_t *frame);

#endif /* ECHO_CHECK_H */
