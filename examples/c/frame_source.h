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
    const uint8_t *channel_masks; /* channels in use of each gateway, one at least */
    const uint8_t *fd_masks;      /* those of them where the counter is sent in CAN FD frames */
    bool is_by_interface;         /* a recorded frame goes where its interface says */
    uint64_t total;       /* cycles of the counter, or frames of the recording */
    uint64_t done;
} frame_source_t;

/* A frame as the counter sends it. A code of the SDK. */
int frame_source_counter(igh_mcan_tx_frame_t *frame, size_t slave, uint8_t channel, bool is_fd,
                         uint64_t number);

/* When the next frame of a recording is due, after the start. False where none is. */
bool frame_source_next_due(const frame_source_t *source, uint64_t *due_ns);

/* The time of a log line: that of the recording goes on. */
uint64_t frame_source_log_time(const frame_source_t *source, uint64_t elapsed_ns);

/* Sends what is due `elapsed_ns` after the start and tells the check of every frame that was taken.
 * False, with a message on standard error, when a frame is refused for good. */
bool frame_source_send(frame_source_t *source, igh_mcan_port_t *mcan, uint64_t elapsed_ns,
                       echo_check_t *check);

#endif /* FRAME_SOURCE_H */
