/* Process data codec in plain C: what the codec of ecan-protocol is measured against. */
#ifndef ECAN_CODEC_BASELINE_H
#define ECAN_CODEC_BASELINE_H

#include <stddef.h>
#include <stdint.h>

/* Bits of the control word that belong to the CAN frame. */
#define PLAIN_EXTENDED 0x0080u
#define PLAIN_FD 0x0100u
#define PLAIN_BRS 0x0200u
/* Remote frame in classic CAN, error state indicator in CAN FD. */
#define PLAIN_X 0x0400u
#define PLAIN_WINDOW 0x8000u

enum plain_error {
    PLAIN_OK = 0,
    PLAIN_NO_ROOM = -1,
    PLAIN_TOO_MANY = -2,
    PLAIN_CHANNEL = -3,
    PLAIN_ID_AUX = -4,
    PLAIN_TIMESTAMP = -5,
    PLAIN_BAD_IMAGE = -6,
    PLAIN_BAD_PACKET = -7
};

enum plain_kind { PLAIN_FRAME = 0, PLAIN_TX_RESULT = 1 };

/* What both sides know about a direction. */
struct plain_profile {
    uint16_t bytes;
    uint16_t layout_id;
    uint8_t channel_mask;
    /* One bit for each timestamp format that may occur. */
    uint8_t formats;
    uint8_t windows;
    uint8_t align4;
    uint8_t to_gateway;
    uint8_t crc;
};

/* A frame to send; `data` has as many bytes as the DLC means, none in a remote frame. */
struct plain_frame {
    const uint8_t *data;
    uint64_t timestamp;
    uint32_t id;
    uint16_t flags;
    uint8_t channel;
    uint8_t id_aux;
    uint8_t dlc;
    uint8_t timestamp_format;
};

/* A packet received; the data of a frame stays in the image. */
struct plain_packet {
    struct plain_frame frame;
    uint16_t sequence;
    uint8_t kind;
    uint8_t length;
    uint8_t index;
    uint8_t code;
};

struct plain_writer {
    struct plain_profile profile;
    size_t position;
    uint16_t sequence;
    uint8_t count;
    uint8_t frames;
    uint8_t results;
    uint8_t wrapped;
};

struct plain_reader {
    struct plain_profile profile;
    const uint8_t *position;
    const uint8_t *end;
    uint8_t left;
    uint8_t frames;
};

uint16_t plain_crc16(const uint8_t *data, size_t length);

void plain_writer_init(struct plain_writer *writer, const struct plain_profile *profile);
/* Starts an image: clears all of it. */
void plain_begin(struct plain_writer *writer, uint8_t *image);
int plain_push(struct plain_writer *writer, uint8_t *image, const struct plain_frame *frame);
int plain_push_tx_result(struct plain_writer *writer, uint8_t *image,
                         const struct plain_packet *result);
uint16_t plain_commit(struct plain_writer *writer, uint8_t *image);

void plain_reader_init(struct plain_reader *reader, const struct plain_profile *profile);
/* Judges an image; its packets follow by plain_next(). */
int plain_open(struct plain_reader *reader, const uint8_t *image);
/* 1: a packet; 0: the end; negative: what is wrong, and the end. */
int plain_next(struct plain_reader *reader, struct plain_packet *packet);

/* A whole image at a time, so that the compiler sees the loops as it does in Rust. Returns the
 * frames that went in. */
size_t plain_encode(struct plain_writer *writer, uint8_t *image, const struct plain_frame *frames,
                    size_t count);
/* Looks at channel, identifier, length and first data byte of each frame; 0 where the image is
 * rejected. */
uint64_t plain_decode(struct plain_reader *reader, const uint8_t *image);

#endif
