/* Compares returned frames with sent ones: every frame on its channel, unchanged and in order.
 * Channels are numbered over all gateways. */
#ifndef ECHO_CHECK_H
#define ECHO_CHECK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "igh_mcan_pdo.h"

/* Frames of one channel that have not returned, as a ring. */
typedef struct {
    igh_mcan_tx_frame_t *frames;
    size_t first;
    size_t count;
} pending_t;

typedef struct {
    pending_t *channels;
    size_t channel_count;
    size_t pending; /* on all channels */
    uint64_t sent;
    uint64_t returned;
    char first_difference[256]; /* first difference; "" for none */
} echo_check_t;

/* Allocates the memory before the cycle. Returns false, with a message on standard error, if
 * there is not enough. */
bool echo_check_init(echo_check_t *check, size_t slaves);

void echo_check_free(echo_check_t *check);

void echo_check_sent(echo_check_t *check, const igh_mcan_tx_frame_t *frame);

void echo_check_received(echo_check_t *check, const igh_mcan_rx_frame_t *frame);

#endif /* ECHO_CHECK_H */
