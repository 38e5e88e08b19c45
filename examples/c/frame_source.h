/* The frames that simple_loop sends: a counter, or a recording. */
#ifndef FRAME_SOURCE_H
#define FRAME_SOURCE_H

#include <stdbool.h>
#include <stdint.h>

#include "candump_log.h"
#include "echo_check.h"
#include "igh_mcan_port.h"

typedef struct {
    const candump_log_t *recording; /* NULL: a counter */
    size_t slaves;
    const uint8_t *channel_masks; /* enabled channels of each gateway, at least one */
    const uint8_t *fd_masks;      /* channels among them that send the counter in CAN FD frames */
    bool is_by_interface;         /* recorded frames are sent on the channel of their interface */
    uint64_t total;       /* cycles of the counter, or frames of the recording */
    uint64_t done;
} frame_source_t;

/* Makes a frame of the counter. Returns a code of the SDK. */
int frame_source_counter(igh_mcan_tx_frame_t *frame, size_t slave, uint8_t channel, bool is_fd,
                         uint64_t number);

/* Due time of the next frame of a recording, after the start. Returns false if there is none. */
bool frame_source_next_due(const frame_source_t *source, uint64_t *due_ns);

/* Time of a log line; continues the time of the recording. */
uint64_t frame_source_log_time(const frame_source_t *source, uint64_t elapsed_ns);

/* Sends the frames that are due `elapsed_ns` after the start, and adds every accepted frame to
 * the check. Returns false, with a message on standard error, if a frame is rejected and the
 * rejection is not temporary. */
bool frame_source_send(frame_source_t *source, igh_mcan_port_t *mcan, uint64_t elapsed_ns,
                       echo_check_t *check);

#endif /* FRAME_SOURCE_H */
