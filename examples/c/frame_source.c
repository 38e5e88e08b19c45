#include "frame_source.h"

#include "cycle_result.h"
#include "report.h"

enum { LOOP_ID = 0x123 };

static uint64_t due_after_start(const candump_log_t *recording, uint64_t frame)
{
    uint64_t start = recording->frames[0].record.time_ns;
    uint64_t time = recording->frames[frame].record.time_ns;
    return time > start ? time - start : 0;
}

bool frame_source_next_due(const frame_source_t *source, uint64_t *due_ns)
{
    if (source->recording == NULL || source->done == source->total) {
        return false;
    }
    *due_ns = due_after_start(source->recording, source->done);
    return true;
}

uint64_t frame_source_log_time(const frame_source_t *source, uint64_t elapsed_ns)
{
    return source->recording == NULL ? elapsed_ns
                                     : source->recording->frames[0].record.time_ns + elapsed_ns;
}

int frame_source_counter(igh_mcan_tx_frame_t *frame, size_t slave, uint8_t channel, bool is_fd,
                         uint64_t number)
{
    uint8_t data[ECAN_CANFD_MAX_BYTES] = {0};
    for (size_t i = 0; i < sizeof(number); i++) {
        data[i] = (uint8_t)(number >> (8 * i));
    }
    return is_fd ? igh_mcan_tx_frame_set_canfd(frame, slave, channel, LOOP_ID, IGH_MCAN_FLAG_BRS,
                                               data, sizeof(data))
                 : igh_mcan_tx_frame_set_can(frame, slave, channel, LOOP_ID, 0, data, 8);
}

/* Sends a frame with the cycle number on each channel. A temporarily rejected frame is skipped:
 * the next cycle has a newer one. */
static bool send_counter(frame_source_t *source, igh_mcan_port_t *mcan, echo_check_t *check)
{
    for (size_t slave = 0; slave < source->slaves; slave++) {
        for (uint8_t channel = 0; channel < ECAN_MCAN_CHANNELS; channel++) {
            igh_mcan_tx_frame_t frame;
            if ((source->channel_masks[slave] >> channel & 1) == 0) {
                continue;
            }
            bool is_fd = (source->fd_masks[slave] >> channel & 1) != 0;
            int result = frame_source_counter(&frame, slave, channel, is_fd, source->done);
            if (result == ECAN_OK) {
                result = igh_mcan_port_send(mcan, &frame);
            }
            if (result == ECAN_OK) {
                echo_check_sent(check, &frame);
            } else if (!is_temporary(result)) {
                report_sdk_error();
                return false;
            }
        }
    }
    source->done++;
    return true;
}

/* Target of a recorded frame: its interface, counted over all gateways, or the first enabled
 * channel. */
static void set_position(const frame_source_t *source, unsigned interface,
                         igh_mcan_tx_frame_t *frame)
{
    if (source->is_by_interface) {
        size_t index = interface % (source->slaves * ECAN_MCAN_CHANNELS);
        frame->slave = (uint16_t)(index / ECAN_MCAN_CHANNELS);
        frame->channel = (uint8_t)(index % ECAN_MCAN_CHANNELS);
    } else {
        size_t index = 0;
        while ((source->channel_masks[index / ECAN_MCAN_CHANNELS] >> index % ECAN_MCAN_CHANNELS &
                1) == 0) {
            index++;
        }
        frame->slave = (uint16_t)(index / ECAN_MCAN_CHANNELS);
        frame->channel = (uint8_t)(index % ECAN_MCAN_CHANNELS);
    }
}

/* Sends the frames that are due. A temporarily rejected frame and all frames after it wait for
 * the next cycle, so that the order is kept. */
static bool send_recording(frame_source_t *source, igh_mcan_port_t *mcan, uint64_t elapsed_ns,
                           echo_check_t *check)
{
    while (source->done < source->total &&
           due_after_start(source->recording, source->done) <= elapsed_ns) {
        const candump_record_t *record = &source->recording->frames[source->done].record;
        igh_mcan_tx_frame_t frame = record->frame;
        set_position(source, record->interface, &frame);
        int result = igh_mcan_port_send(mcan, &frame);
        if (is_temporary(result)) {
            break;
        }
        if (result != ECAN_OK) {
            report_sdk_error();
            return false;
        }
        echo_check_sent(check, &frame);
        source->done++;
    }
    return true;
}

bool frame_source_send(frame_source_t *source, igh_mcan_port_t *mcan, uint64_t elapsed_ns,
                       echo_check_t *check)
{
    return source->recording == NULL ? send_counter(source, mcan, check)
                                     : send_recording(source, mcan, elapsed_ns, check);
}
