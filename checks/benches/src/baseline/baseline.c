/* Process data codec in plain C (manual 5.4.4.1, 6, 8, 10). */
#include "baseline.h"

#include <stdatomic.h>
#include <string.h>

#define HEADER_BYTES 24u
#define MAX_PACKETS 255u
#define WINDOW_BYTES 64u
#define RESULT_BYTES 6u
#define VER_IHL 0x16u
#define CRC_ALG_CCITT_FALSE 1u
#define FLAG_TX_RESULT_PRESENT 0x04u
#define FLAG_SEQ_WRAP 0x10u
#define FRAME_BITS (PLAIN_EXTENDED | PLAIN_FD | PLAIN_BRS | PLAIN_X)

static const uint8_t fd_lengths[16] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
static const uint8_t timestamp_sizes[4] = {0, 2, 4, 8};

static const uint16_t crc_table[256] = {
    0x0000, 0x1021, 0x2042, 0x3063, 0x4084, 0x50A5, 0x60C6, 0x70E7,
    0x8108, 0x9129, 0xA14A, 0xB16B, 0xC18C, 0xD1AD, 0xE1CE, 0xF1EF,
    0x1231, 0x0210, 0x3273, 0x2252, 0x52B5, 0x4294, 0x72F7, 0x62D6,
    0x9339, 0x8318, 0xB37B, 0xA35A, 0xD3BD, 0xC39C, 0xF3FF, 0xE3DE,
    0x2462, 0x3443, 0x0420, 0x1401, 0x64E6, 0x74C7, 0x44A4, 0x5485,
    0xA56A, 0xB54B, 0x8528, 0x9509, 0xE5EE, 0xF5CF, 0xC5AC, 0xD58D,
    0x3653, 0x2672, 0x1611, 0x0630, 0x76D7, 0x66F6, 0x5695, 0x46B4,
    0xB75B, 0xA77A, 0x9719, 0x8738, 0xF7DF, 0xE7FE, 0xD79D, 0xC7BC,
    0x48C4, 0x58E5, 0x6886, 0x78A7, 0x0840, 0x1861, 0x2802, 0x3823,
    0xC9CC, 0xD9ED, 0xE98E, 0xF9AF, 0x8948, 0x9969, 0xA90A, 0xB92B,
    0x5AF5, 0x4AD4, 0x7AB7, 0x6A96, 0x1A71, 0x0A50, 0x3A33, 0x2A12,
    0xDBFD, 0xCBDC, 0xFBBF, 0xEB9E, 0x9B79, 0x8B58, 0xBB3B, 0xAB1A,
    0x6CA6, 0x7C87, 0x4CE4, 0x5CC5, 0x2C22, 0x3C03, 0x0C60, 0x1C41,
    0xEDAE, 0xFD8F, 0xCDEC, 0xDDCD, 0xAD2A, 0xBD0B, 0x8D68, 0x9D49,
    0x7E97, 0x6EB6, 0x5ED5, 0x4EF4, 0x3E13, 0x2E32, 0x1E51, 0x0E70,
    0xFF9F, 0xEFBE, 0xDFDD, 0xCFFC, 0xBF1B, 0xAF3A, 0x9F59, 0x8F78,
    0x9188, 0x81A9, 0xB1CA, 0xA1EB, 0xD10C, 0xC12D, 0xF14E, 0xE16F,
    0x1080, 0x00A1, 0x30C2, 0x20E3, 0x5004, 0x4025, 0x7046, 0x6067,
    0x83B9, 0x9398, 0xA3FB, 0xB3DA, 0xC33D, 0xD31C, 0xE37F, 0xF35E,
    0x02B1, 0x1290, 0x22F3, 0x32D2, 0x4235, 0x5214, 0x6277, 0x7256,
    0xB5EA, 0xA5CB, 0x95A8, 0x8589, 0xF56E, 0xE54F, 0xD52C, 0xC50D,
    0x34E2, 0x24C3, 0x14A0, 0x0481, 0x7466, 0x6447, 0x5424, 0x4405,
    0xA7DB, 0xB7FA, 0x8799, 0x97B8, 0xE75F, 0xF77E, 0xC71D, 0xD73C,
    0x26D3, 0x36F2, 0x0691, 0x16B0, 0x6657, 0x7676, 0x4615, 0x5634,
    0xD94C, 0xC96D, 0xF90E, 0xE92F, 0x99C8, 0x89E9, 0xB98A, 0xA9AB,
    0x5844, 0x4865, 0x7806, 0x6827, 0x18C0, 0x08E1, 0x3882, 0x28A3,
    0xCB7D, 0xDB5C, 0xEB3F, 0xFB1E, 0x8BF9, 0x9BD8, 0xABBB, 0xBB9A,
    0x4A75, 0x5A54, 0x6A37, 0x7A16, 0x0AF1, 0x1AD0, 0x2AB3, 0x3A92,
    0xFD2E, 0xED0F, 0xDD6C, 0xCD4D, 0xBDAA, 0xAD8B, 0x9DE8, 0x8DC9,
    0x7C26, 0x6C07, 0x5C64, 0x4C45, 0x3CA2, 0x2C83, 0x1CE0, 0x0CC1,
    0xEF1F, 0xFF3E, 0xCF5D, 0xDF7C, 0xAF9B, 0xBFBA, 0x8FD9, 0x9FF8,
    0x6E17, 0x7E36, 0x4E55, 0x5E74, 0x2E93, 0x3EB2, 0x0ED1, 0x1EF0,
};

uint16_t plain_crc16(const uint8_t *data, size_t length)
{
    uint16_t crc = 0xFFFF;
    for (size_t i = 0; i < length; i++) {
        crc = (uint16_t)(crc << 8) ^ crc_table[(crc >> 8) ^ data[i]];
    }
    return crc;
}

static void put16(uint8_t *to, uint16_t value)
{
    to[0] = (uint8_t)value;
    to[1] = (uint8_t)(value >> 8);
}

static void put32(uint8_t *to, uint32_t value)
{
    put16(to, (uint16_t)value);
    put16(to + 2, (uint16_t)(value >> 16));
}

static void put64(uint8_t *to, uint64_t value)
{
    put32(to, (uint32_t)value);
    put32(to + 4, (uint32_t)(value >> 32));
}

static uint16_t get16(const uint8_t *from)
{
    return (uint16_t)(from[0] | from[1] << 8);
}

static uint32_t get32(const uint8_t *from)
{
    return get16(from) | (uint32_t)get16(from + 2) << 16;
}

static uint64_t get64(const uint8_t *from)
{
    return get32(from) | (uint64_t)get32(from + 4) << 32;
}

static size_t padded(const struct plain_profile *profile, size_t size)
{
    return profile->align4 ? (size + 3) & ~(size_t)3 : size;
}

static int is_remote(uint16_t flags)
{
    return (flags & (PLAIN_FD | PLAIN_X)) == PLAIN_X;
}

void plain_writer_init(struct plain_writer *writer, const struct plain_profile *profile)
{
    memset(writer, 0, sizeof(*writer));
    writer->profile = *profile;
    writer->position = HEADER_BYTES;
    writer->sequence = 1;
}

void plain_begin(struct plain_writer *writer, uint8_t *image)
{
    memset(image, 0, writer->profile.bytes);
    writer->position = HEADER_BYTES;
    writer->count = 0;
    writer->frames = 0;
    writer->results = 0;
}

/* The image is cleared already, so padding and the rest of a window need no bytes. */
int plain_push(struct plain_writer *writer, uint8_t *image, const struct plain_frame *frame)
{
    const struct plain_profile *profile = &writer->profile;
    uint8_t format = frame->timestamp_format;
    size_t length = is_remote(frame->flags) ? 0 : fd_lengths[frame->dlc & 15];
    size_t space = frame->flags & PLAIN_WINDOW ? WINDOW_BYTES : length;
    size_t size;
    uint8_t *to = image + writer->position;

    if (frame->channel > 3 || !(profile->channel_mask >> frame->channel & 1)) {
        return PLAIN_CHANNEL;
    }
    if (frame->id_aux > 7) {
        return PLAIN_ID_AUX;
    }
    if (!(profile->formats >> format & 1)) {
        return PLAIN_TIMESTAMP;
    }
    /* To the gateway only a schedule record of format 1, without flags. */
    if (format == 3 && profile->to_gateway && (frame->timestamp & 0xFFFF) != 1) {
        return PLAIN_TIMESTAMP;
    }
    size = padded(profile, 2 + (frame->flags & PLAIN_EXTENDED ? 4 : 2) + timestamp_sizes[format] +
                               space);
    if (writer->position + size > profile->bytes) {
        return PLAIN_NO_ROOM;
    }
    if (writer->count >= MAX_PACKETS) {
        return PLAIN_TOO_MANY;
    }

    put16(to, (uint16_t)(frame->channel | frame->dlc << 3 | frame->flags | format << 11));
    if (frame->flags & PLAIN_EXTENDED) {
        put32(to + 2, frame->id | (uint32_t)frame->id_aux << 29);
        to += 6;
    } else {
        put16(to + 2, (uint16_t)(frame->id | (uint32_t)frame->id_aux << 11));
        to += 4;
    }
    switch (format) {
    case 1:
        put16(to, (uint16_t)frame->timestamp);
        break;
    case 2:
        put32(to, (uint32_t)frame->timestamp);
        break;
    case 3:
        put64(to, frame->timestamp);
        break;
    default:
        break;
    }
    memcpy(to + timestamp_sizes[format], frame->data, length);

    writer->position += size;
    writer->count++;
    return writer->frames++;
}

int plain_push_tx_result(struct plain_writer *writer, uint8_t *image,
                         const struct plain_packet *result)
{
    size_t size = padded(&writer->profile, RESULT_BYTES);
    uint8_t *to = image + writer->position;

    if (result->frame.channel > 7) {
        return PLAIN_CHANNEL;
    }
    if (writer->position + size > writer->profile.bytes) {
        return PLAIN_NO_ROOM;
    }
    if (writer->count >= MAX_PACKETS) {
        return PLAIN_TOO_MANY;
    }
    put16(to, (uint16_t)(result->frame.channel | PLAIN_TX_RESULT << 13));
    put16(to + 2, result->sequence);
    to[4] = result->index;
    to[5] = result->code;
    writer->position += size;
    writer->count++;
    writer->results = 1;
    return PLAIN_OK;
}

uint16_t plain_commit(struct plain_writer *writer, uint8_t *image)
{
    const struct plain_profile *profile = &writer->profile;
    uint16_t sequence = writer->sequence;
    size_t length = writer->position - HEADER_BYTES;

    image[0] = VER_IHL;
    image[1] = (uint8_t)((writer->results ? FLAG_TX_RESULT_PRESENT : 0) |
                         (writer->wrapped ? FLAG_SEQ_WRAP : 0));
    put16(image + 2, sequence);
    put16(image + 6, (uint16_t)length);
    put16(image + 8, profile->crc ? plain_crc16(image + HEADER_BYTES, length) : 0);
    put16(image + 10, profile->layout_id);
    image[12] = profile->channel_mask;
    image[13] = writer->count;
    image[15] = profile->crc ? CRC_ALG_CCITT_FALSE : 0;
    atomic_thread_fence(memory_order_release);
    put16(image + 4, sequence);

    writer->sequence++;
    writer->wrapped = writer->sequence == 0;
    return sequence;
}

void plain_reader_init(struct plain_reader *reader, const struct plain_profile *profile)
{
    memset(reader, 0, sizeof(*reader));
    reader->profile = *profile;
}

int plain_open(struct plain_reader *reader, const uint8_t *image)
{
    const struct plain_profile *profile = &reader->profile;
    uint8_t header[HEADER_BYTES];
    size_t length;

    reader->left = 0;
    reader->frames = 0;
    reader->position = reader->end = image;
    memcpy(header, image, HEADER_BYTES);
    atomic_signal_fence(memory_order_seq_cst);
    if (get16(header + 2) != get16(header + 4) || header[0] != VER_IHL) {
        return PLAIN_BAD_IMAGE;
    }
    length = get16(header + 6);
    if (length > profile->bytes - HEADER_BYTES) {
        return PLAIN_BAD_IMAGE;
    }
    if (header[15] == CRC_ALG_CCITT_FALSE) {
        if (plain_crc16(image + HEADER_BYTES, length) != get16(header + 8)) {
            return PLAIN_BAD_IMAGE;
        }
    } else if (header[15] != 0 || profile->crc || get16(header + 8) != 0) {
        return PLAIN_BAD_IMAGE;
    }
    /* The image may have changed meanwhile. */
    atomic_thread_fence(memory_order_acquire);
    if (memcmp(header, image, HEADER_BYTES) != 0) {
        return PLAIN_BAD_IMAGE;
    }
    reader->position = image + HEADER_BYTES;
    reader->end = reader->position + length;
    reader->left = header[13];
    return PLAIN_OK;
}

static int bad_packet(struct plain_reader *reader)
{
    reader->position = reader->end;
    reader->left = 0;
    return PLAIN_BAD_PACKET;
}

static int next_frame(struct plain_reader *reader, uint16_t control, struct plain_packet *packet)
{
    const struct plain_profile *profile = &reader->profile;
    struct plain_frame *frame = &packet->frame;
    const uint8_t *from = reader->position;
    uint8_t channel = control & 7;
    uint8_t dlc = control >> 3 & 15;
    uint8_t format = control >> 11 & 3;
    size_t length = is_remote(control) ? 0 : fd_lengths[dlc];
    size_t space = control & PLAIN_WINDOW ? WINDOW_BYTES : length;
    size_t size = padded(profile, 2 + (control & PLAIN_EXTENDED ? 4 : 2) +
                                      timestamp_sizes[format] + space);

    if (channel > 3 || !(profile->channel_mask >> channel & 1) ||
        !(profile->formats >> format & 1)) {
        return bad_packet(reader);
    }
    if (!(control & PLAIN_FD) && (dlc > 8 || control & (PLAIN_BRS | PLAIN_WINDOW))) {
        return bad_packet(reader);
    }
    if (control & PLAIN_WINDOW && !profile->windows) {
        return bad_packet(reader);
    }
    if (size > (size_t)(reader->end - from)) {
        return bad_packet(reader);
    }
    if (control & PLAIN_EXTENDED) {
        uint32_t field = get32(from + 2);
        frame->id = field & 0x1FFFFFFF;
        frame->id_aux = (uint8_t)(field >> 29);
        from += 6;
    } else {
        uint16_t field = get16(from + 2);
        if (field >> 14) {
            return bad_packet(reader);
        }
        frame->id = field & 0x7FF;
        frame->id_aux = (uint8_t)(field >> 11);
        from += 4;
    }
    switch (format) {
    case 1:
        frame->timestamp = get16(from);
        break;
    case 2:
        frame->timestamp = get32(from);
        break;
    case 3:
        frame->timestamp = get64(from);
        break;
    default:
        frame->timestamp = 0;
        break;
    }
    frame->data = from + timestamp_sizes[format];
    frame->flags = control & FRAME_BITS;
    frame->channel = channel;
    frame->dlc = dlc;
    frame->timestamp_format = format;
    packet->kind = PLAIN_FRAME;
    packet->length = (uint8_t)length;
    packet->index = reader->frames++;
    reader->position += size;
    reader->left--;
    return 1;
}

static int next_result(struct plain_reader *reader, uint16_t control, struct plain_packet *packet)
{
    const uint8_t *from = reader->position;
    size_t size = padded(&reader->profile, RESULT_BYTES);

    if (reader->profile.to_gateway || size > (size_t)(reader->end - from)) {
        return bad_packet(reader);
    }
    packet->kind = PLAIN_TX_RESULT;
    packet->frame.channel = control & 7;
    packet->sequence = get16(from + 2);
    packet->index = from[4];
    packet->code = from[5];
    reader->position += size;
    reader->left--;
    return 1;
}

int plain_next(struct plain_reader *reader, struct plain_packet *packet)
{
    size_t bytes = (size_t)(reader->end - reader->position);
    uint16_t control;

    if (bytes == 0 && reader->left == 0) {
        return 0;
    }
    if (bytes < 2 || reader->left == 0) {
        return bad_packet(reader);
    }
    control = get16(reader->position);
    switch (control >> 13 & 3) {
    case PLAIN_FRAME:
        return next_frame(reader, control, packet);
    case PLAIN_TX_RESULT:
        return next_result(reader, control, packet);
    default:
        return bad_packet(reader);
    }
}

size_t plain_encode(struct plain_writer *writer, uint8_t *image, const struct plain_frame *frames,
                    size_t count)
{
    size_t i;

    plain_begin(writer, image);
    for (i = 0; i < count && plain_push(writer, image, &frames[i]) >= 0; i++) {
    }
    plain_commit(writer, image);
    return i;
}

uint64_t plain_decode(struct plain_reader *reader, const uint8_t *image)
{
    struct plain_packet packet;
    uint64_t sum = 0;

    if (plain_open(reader, image) != PLAIN_OK) {
        return 0;
    }
    while (plain_next(reader, &packet) > 0) {
        if (packet.kind == PLAIN_FRAME) {
            sum += packet.frame.channel + packet.frame.id + packet.length;
            if (packet.length > 0) {
                sum += packet.frame.data[0];
            }
        }
    }
    return sum;
}
