#include "echo_check.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "report.h"

/* More than the size of a gateway's queues. */
enum { MAX_PENDING = 1024 };

bool echo_check_init(echo_check_t *check, size_t slaves)
{
    memset(check, 0, sizeof(*check));
    check->channels =
        (pending_t *)calloc(slaves * ECAN_MCAN_CHANNELS, sizeof(*check->channels));
    if (check->channels == NULL) {
        report("not enough memory");
        return false;
    }
    check->channel_count = slaves * ECAN_MCAN_CHANNELS;
    for (size_t i = 0; i < check->channel_count; i++) {
        check->channels[i].frames =
            (igh_mcan_tx_frame_t *)calloc(MAX_PENDING, sizeof(igh_mcan_tx_frame_t));
        if (check->channels[i].frames == NULL) {
            report("not enough memory");
            echo_check_free(check);
            return false;
        }
    }
    return true;
}

void echo_check_free(echo_check_t *check)
{
    for (size_t i = 0; i < check->channel_count; i++) {
        free(check->channels[i].frames);
    }
    free(check->channels);
    memset(check, 0, sizeof(*check));
}

static void note(echo_check_t *check, const char *format, ...)
{
    va_list arguments;
    if (check->first_difference[0] == '\0') {
        va_start(arguments, format);
        vsnprintf(check->first_difference, sizeof(check->first_difference), format, arguments);
        va_end(arguments);
    }
}

/* Removes the oldest frame of a ring that is not empty. */
static const igh_mcan_tx_frame_t *take_first(echo_check_t *check, pending_t *channel)
{
    const igh_mcan_tx_frame_t *frame = &channel->frames[channel->first];
    channel->first = (channel->first + 1) % MAX_PENDING;
    channel->count--;
    check->pending--;
    return frame;
}

void echo_check_sent(echo_check_t *check, const igh_mcan_tx_frame_t *frame)
{
    size_t index = (size_t)frame->slave * ECAN_MCAN_CHANNELS + frame->channel;
    pending_t *channel = &check->channels[index];
    check->sent++;
    if (channel->count == MAX_PENDING) {
        note(check, "%d frames on can%zu did not return", MAX_PENDING, index);
        take_first(check, channel);
    }
    channel->frames[(channel->first + channel->count) % MAX_PENDING] = *frame;
    channel->count++;
    check->pending++;
}

static bool is_same(const igh_mcan_tx_frame_t *sent, const igh_mcan_rx_frame_t *received)
{
    /* A remote frame has a length, but no data. */
    size_t bytes = (sent->flags & IGH_MCAN_FLAG_RTR) != 0 ? 0 : sent->len;
    return sent->can_id == received->can_id && sent->flags == received->flags &&
           sent->len == received->len && memcmp(sent->data, received->data, bytes) == 0;
}

/* Text of a frame: CAN ID, flags, length and the first bytes. */
static const char *frame_text(char *text, size_t size, uint32_t can_id, uint8_t flags, uint8_t len,
                         const uint8_t *data)
{
    int used = snprintf(text, size, "0x%" PRIX32 " (flags 0x%02X) [%u]", can_id, flags, len);
    for (size_t i = 0; i < len && i < 8 && (size_t)used < size; i++) {
        used += snprintf(text + used, size - (size_t)used, " %02X", data[i]);
    }
    return text;
}

void echo_check_received(echo_check_t *check, const igh_mcan_rx_frame_t *frame)
{
    size_t index = (size_t)frame->slave * ECAN_MCAN_CHANNELS + frame->channel;
    pending_t *channel = &check->channels[index];
    char received[64], expected[64] = "nothing";
    bool is_right = false;
    check->returned++;
    if (channel->count > 0) {
        const igh_mcan_tx_frame_t *sent = take_first(check, channel);
        is_right = is_same(sent, frame);
        if (!is_right) {
            frame_text(expected, sizeof(expected), sent->can_id, sent->flags, sent->len,
                       sent->data);
        }
    }
    if (!is_right) {
        note(check, "frame %" PRIu64 " on can%zu: received %s, expected %s", check->returned, index,
             frame_text(received, sizeof(received), frame->can_id, frame->flags, frame->len,
                        frame->data),
             expected);
    }
}
