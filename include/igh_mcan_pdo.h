/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/**
 * ECAN-Lite host SDK: the process data protocol (manual 5 to 12).
 *
 * Writes frames into images and reads them, without an EtherCAT master. libecan_mcan_host contains
 * this layer, libecan_igh_host the layers above it. For applications that exchange raw process data
 * (manual 15.5.3); not necessary with igh_mcan_port.h.
 *
 * igh_ecan_common.h has the rules for all functions.
 *
 * Change log
 *
 *   0.2.0  The functions of this header are in libecan_mcan_host, which libecan_igh_host needs.
 *          Added: `needed` of igh_mcan_pdo_diag_text(); ECAN_ERR_LAYOUT and IGH_MCAN_PDO_LAYOUT of
 *          igh_mcan_pdo_parse_frames_ex().
 *          Removed: igh_mcan_pdo_parse_frames(); use igh_mcan_pdo_parse_frames_ex() with NULL.
 *          Structs that the library fills end with reserved fields, which are 0; reserved fields of
 *          structs that the application fills must be 0.
 *   0.1.0  First version.
 */
#ifndef IGH_MCAN_PDO_H
#define IGH_MCAN_PDO_H

#include "igh_ecan_common.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---------------------------------------------------------------------------
 * CAN frames
 * --------------------------------------------------------------------------- */

/** Flag: 29-bit identifier. */
#define IGH_MCAN_FLAG_EXT 1

/** Flag: remote frame, classic CAN only. Its length is the requested DLC; it has no data. */
#define IGH_MCAN_FLAG_RTR 2

/** Flag: CAN FD frame with bit rate switch. */
#define IGH_MCAN_FLAG_BRS 4

/** Flag: CAN FD frame with the error state indicator. */
#define IGH_MCAN_FLAG_ESI 8

/** Flag: CAN FD frame. Set by the _canfd functions and in received frames. */
#define IGH_MCAN_FLAG_FD 16

/** Hint for the gateway's transmit path (manual 8.1), in igh_mcan_tx_frame_t.hint. */
typedef enum {
    /** No preference. */
    IGH_MCAN_HINT_NORMAL = 0,
    /** High priority. */
    IGH_MCAN_HINT_HIGH_PRIORITY = 1,
    /** A dedicated TX buffer. */
    IGH_MCAN_HINT_BUFFER = 2,
    /** The TX queue, sorted by identifier. */
    IGH_MCAN_HINT_QUEUE = 3
} igh_mcan_hint_t;

/**
 * Buffer of the gateway's CAN controller that held a received frame (manual 8.1), in
 * igh_mcan_rx_frame_t.source.
 */
typedef enum {
    /** RX FIFO 0. */
    IGH_MCAN_SOURCE_FIFO0 = 0,
    /** RX FIFO 1. */
    IGH_MCAN_SOURCE_FIFO1 = 1,
    /** A dedicated RX buffer. */
    IGH_MCAN_SOURCE_BUFFER = 2,
    /** Marked as a high priority message. */
    IGH_MCAN_SOURCE_HIGH_PRIORITY = 3
} igh_mcan_source_t;

/** Kind of a received item, in igh_mcan_rx_frame_t.kind. */
typedef enum {
    /** A CAN frame from the bus. */
    IGH_MCAN_RX_FRAME = 0,
    /** The result of a transmission (manual 10). */
    IGH_MCAN_RX_TX_RESULT = 1
} igh_mcan_rx_kind_t;

/** Format of igh_mcan_rx_frame_t.timestamp (manual 8.4). The manual gives no unit. */
typedef enum {
    /** None: other profiles than 1 and 5. */
    IGH_MCAN_TIMESTAMP_NONE = 0,
    /** Low 16 bits of the difference to the image's time base. */
    IGH_MCAN_TIMESTAMP_DELTA16 = 1,
    /** Low 32 bits of the difference to the image's time base. */
    IGH_MCAN_TIMESTAMP_DELTA32 = 2,
    /** The whole time. */
    IGH_MCAN_TIMESTAMP_FULL64 = 3
} igh_mcan_timestamp_t;

/**
 * Result of a transmission (manual 10), in igh_mcan_rx_frame_t.result. It covers the path into the
 * CAN controller, not the reception by a node. The device may report other values.
 */
typedef enum {
    /** Passed to the CAN controller. */
    IGH_MCAN_TX_RESULT_OK = 0,
    /** Waits in the gateway's transmit queue. */
    IGH_MCAN_TX_RESULT_QUEUED = 1,
    /** The bus is busy. */
    IGH_MCAN_TX_RESULT_BUS_BUSY = 2,
    /** The frame's channel does not exist or is not enabled. */
    IGH_MCAN_TX_RESULT_INVALID_CHANNEL = 3,
    /** The transmit FIFO is full. */
    IGH_MCAN_TX_RESULT_FIFO_FULL = 4,
    /** The channel is bus-off. */
    IGH_MCAN_TX_RESULT_BUS_OFF = 5
} igh_mcan_tx_result_t;

/**
 * A frame to send, with its destination. Filled by the igh_mcan_tx_frame_set functions, or by the
 * application, which sets it to zero first.
 */
typedef struct {
    /** Slave index. */
    uint16_t slave;
    /** Channel of the gateway, 0 to 3. */
    uint8_t channel;
    /** IGH_MCAN_FLAG_ values. */
    uint8_t flags;
    /** CAN ID, 11 or 29 bits. */
    uint32_t can_id;
    /** Data bytes; the DLC of a remote frame. */
    uint8_t len;
    /** An igh_mcan_hint_t. */
    uint8_t hint;
    /** Not 0: sent offset_ns into the next Sync0 period (manual 8.4). */
    uint8_t scheduled;
    /** Must be 0; for fields of later versions. */
    uint8_t reserved;
    /** Phase of Sync0, in nanoseconds. */
    uint32_t offset_ns;
    /** Tag of the application for a scheduled frame. */
    uint16_t tag;
    /** Must be 0; for fields of later versions. */
    uint16_t reserved2;
    /** Data. */
    uint8_t data[64];
    /** Must be 0; for fields of later versions. */
    uint32_t reserved3[3];
} igh_mcan_tx_frame_t;

/** A received frame, or the result of a transmission. */
typedef struct {
    /** Slave index. */
    uint16_t slave;
    /** Channel of the gateway, 0 to 3. */
    uint8_t channel;
    /** IGH_MCAN_FLAG_ values. */
    uint8_t flags;
    /** CAN ID, 11 or 29 bits. */
    uint32_t can_id;
    /** Data bytes; the DLC of a remote frame. */
    uint8_t len;
    /** An igh_mcan_rx_kind_t: frame or TX_RESULT. */
    uint8_t kind;
    /** An igh_mcan_source_t. */
    uint8_t source;
    /** Format of the timestamp, an igh_mcan_timestamp_t. */
    uint8_t timestamp_format;
    /** TX_RESULT: an igh_mcan_tx_result_t. */
    uint8_t result;
    /** TX_RESULT: index of the frame in its image, from 0. */
    uint8_t frame_index;
    /** TX_RESULT: sequence of the image in which the frame was sent. */
    uint16_t sequence;
    /** TX_RESULT: 1 if this SDK sent such a frame, else 0. */
    uint8_t is_known;
    /** Zero; for fields of later versions. */
    uint8_t reserved[7];
    /** Time at which the gateway received the frame. */
    uint64_t timestamp;
    /** Data; bytes after len are 0. */
    uint8_t data[64];
} igh_mcan_rx_frame_t;

/* ---------------------------------------------------------------------------
 * Frames to send
 * --------------------------------------------------------------------------- */

/**
 * Fills a classic CAN frame that is sent at once.
 *
 * @param frame    Is overwritten.
 * @param slave    Slave index.
 * @param channel  Channel of the gateway, 0 to 3.
 * @param can_id   11 bits; 29 bits with IGH_MCAN_FLAG_EXT.
 * @param flags    0, IGH_MCAN_FLAG_EXT, IGH_MCAN_FLAG_RTR.
 * @param data     Data; may be NULL if len is 0 and for a remote frame.
 * @param len      Bytes, 0 to 8; of a remote frame the requested DLC.
 *
 * @usage   rt, any thread, any time
 * @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL or ECAN_ERR_FRAME; the frame is written only
 *          with ECAN_OK.
 */
int igh_mcan_tx_frame_set_can(igh_mcan_tx_frame_t *frame,
                              size_t slave,
                              uint8_t channel,
                              uint32_t can_id,
                              uint8_t flags,
                              const uint8_t *data,
                              size_t len);

/**
 * Fills a CAN FD frame that is sent at once.
 *
 * @param flags  0, IGH_MCAN_FLAG_EXT, IGH_MCAN_FLAG_BRS, IGH_MCAN_FLAG_ESI; IGH_MCAN_FLAG_FD is
 *               accepted.
 * @param len    Bytes: 0 to 8, 12, 16, 20, 24, 32, 48 or 64 (manual 8.2).
 *
 * @usage   rt, any thread, any time
 * @return  As igh_mcan_tx_frame_set_can().
 */
int igh_mcan_tx_frame_set_canfd(igh_mcan_tx_frame_t *frame,
                                size_t slave,
                                uint8_t channel,
                                uint32_t can_id,
                                uint8_t flags,
                                const uint8_t *data,
                                size_t len);

/**
 * Fills a frame to send from a received one, as an echo or a bridge does, for the slave and
 * channel that received it.
 *
 * @param frame     Is overwritten.
 * @param received  A frame, not a TX_RESULT.
 *
 * @usage   rt, any thread, any time
 * @return  ECAN_OK, ECAN_ERR_CHANNEL, or ECAN_ERR_FRAME if it is not a frame.
 */
int igh_mcan_tx_frame_set_received(igh_mcan_tx_frame_t *frame, const igh_mcan_rx_frame_t *received);

/**
 * Schedules a frame for a phase of the next Sync0 period instead of at once (manual 8.4).
 *
 * @param offset_ns  Phase, in nanoseconds, below the Sync0 period.
 * @param tag        Tag of the application.
 *
 * @usage   rt, any thread, any time
 */
int igh_mcan_tx_frame_set_schedule(igh_mcan_tx_frame_t *frame, uint32_t offset_ns, uint16_t tag);

/**
 * Sets the hint for the gateway's transmit path (manual 8.1).
 *
 * @param hint  An igh_mcan_hint_t.
 *
 * @usage   rt, any thread, any time
 * @return  ECAN_OK, ECAN_ERR_ARGUMENT.
 */
int igh_mcan_tx_frame_set_hint(igh_mcan_tx_frame_t *frame, int hint);

/* ---------------------------------------------------------------------------
 * PDO profiles
 * --------------------------------------------------------------------------- */

/** Option: the gateway reports the result of each transmission (manual 9.1, 10). TxPDO only. */
#define IGH_MCAN_OPTION_TX_RESULT 1

/** Option: packets are padded to 4 bytes. */
#define IGH_MCAN_OPTION_ALIGN4 2

/** Option: no CRC. For performance tests. */
#define IGH_MCAN_OPTION_NO_CRC16 4

/** Option: the CAN side is disconnected. For tests. */
#define IGH_MCAN_OPTION_APP_BYPASS 8

/** Option: bytes after the payload keep their old content. */
#define IGH_MCAN_OPTION_PAYLOAD_ONLY 16

/** Direction of an image, as the slave sees it. */
typedef enum {
    /** Master to slave. */
    IGH_MCAN_RXPDO = 0,
    /** Slave to master. */
    IGH_MCAN_TXPDO = 1
} igh_mcan_direction_t;

/** Encapsulation profile: the format of the packets (manual 9). */
typedef enum {
    /** Data length by DLC, no timestamp. The device default. */
    IGH_MCAN_ENCAPSULATION_COMPACT = 0,
    /** Data length by DLC, timestamps allowed. */
    IGH_MCAN_ENCAPSULATION_COMPACT_TIMESTAMPED = 1,
    /** 64-byte data windows allowed, no timestamp. */
    IGH_MCAN_ENCAPSULATION_WINDOW64 = 4,
    /** 64-byte data windows and timestamps allowed. */
    IGH_MCAN_ENCAPSULATION_WINDOW64_TIMESTAMPED = 5
} igh_mcan_encapsulation_t;

/** Budget policy: how channels share an image (manual 12). */
typedef enum {
    /** A small reserve for each channel, the rest shared. The device default. */
    IGH_MCAN_BUDGET_BALANCED = 0,
    /** No reserve, everything shared. */
    IGH_MCAN_BUDGET_SHARED_ONLY = 1,
    /** Equal parts for each enabled channel, without borrowing. */
    IGH_MCAN_BUDGET_DETERMINISTIC = 2
} igh_mcan_budget_t;

/** The PDO profile of one direction, 0x8010:03..07 or 0x8011:03..07 (manual 13.2). */
typedef struct {
    /** An igh_mcan_direction_t. */
    uint8_t direction;
    /** PDO size multiplier N, 1 to 24: the image has 128 times as many bytes. */
    uint8_t multiplier;
    /** Enabled channels, bit 0 for channel 0. */
    uint8_t channel_mask;
    /** An igh_mcan_encapsulation_t. */
    uint8_t encapsulation;
    /** An igh_mcan_budget_t. */
    uint8_t budget;
    /** IGH_MCAN_OPTION_ values. */
    uint8_t options;
    /** Must be 0; for fields of later versions. */
    uint8_t reserved[10];
} igh_mcan_pdo_profile_t;

/**
 * Fills a profile: N chunks of 128 bytes for these channels, all other fields at their defaults.
 *
 * @param profile       Is overwritten.
 * @param direction     An igh_mcan_direction_t.
 * @param multiplier    N, 1 to 24.
 * @param channel_mask  Channels, bit 0 for channel 0.
 *
 * @usage   rt, any thread, any time
 * @return  ECAN_OK, ECAN_ERR_ARGUMENT or ECAN_ERR_CONFIG.
 */
int igh_mcan_pdo_profile_default(igh_mcan_pdo_profile_t *profile,
                                 int direction,
                                 uint8_t multiplier,
                                 uint8_t channel_mask);

/**
 * Checks a profile.
 *
 * @usage   rt, any thread, any time
 * @return  ECAN_OK, ECAN_ERR_ARGUMENT or ECAN_ERR_CONFIG.
 */
ECAN_MUST_CHECK int igh_mcan_pdo_profile_check(const igh_mcan_pdo_profile_t *profile);

/**
 * Returns the profile word, as in 0x8010:12 and 0x8011:12 when the profile is active (manual
 * 13.2).
 *
 * @usage   rt, any thread, any time
 * @return  The word; 0, which no valid profile has, for a faulty profile or NULL.
 */
uint32_t igh_mcan_pdo_profile_word(const igh_mcan_pdo_profile_t *profile);

/**
 * Returns the layout_id of the image header: the profile word folded to 16 bits (manual 5.4.4.1).
 *
 * @usage   rt, any thread, any time
 * @return  The ID; 0 for a faulty profile or NULL.
 */
uint16_t igh_mcan_pdo_layout_id(const igh_mcan_pdo_profile_t *profile);

/**
 * Returns the bytes of an image with a profile: 128 * N.
 *
 * @usage   rt, any thread, any time
 * @return  The bytes; 0 for a faulty profile or NULL.
 */
size_t igh_mcan_pdo_bytes(const igh_mcan_pdo_profile_t *profile);

/* ---------------------------------------------------------------------------
 * Writing images
 *
 * igh_mcan_pdo_writer_init(&writer, &profile);
 * for each cycle:
 *     igh_mcan_pdo_writer_begin(&writer, rxpdo, rxpdo_size);
 *     igh_mcan_pdo_writer_add_can(&writer, 0, 0x123, 0, data, 8);
 *     igh_mcan_pdo_writer_finish(&writer, NULL);
 * --------------------------------------------------------------------------- */

/**
 * Writes the images of one direction into a buffer of the application. Plain data without
 * resources: it may be copied and needs no deinit. One writer serves one buffer; it stores the
 * sequence number and the length of earlier images.
 */
typedef struct {
    /** Not for the application. */
    uint64_t opaque[16];
} igh_mcan_pdo_writer_t;

/**
 * Prepares a writer. Its first image gets sequence number 1.
 *
 * @param writer   Is overwritten.
 * @param profile  The profile that is active on the device.
 *
 * @usage   rt, any thread, any time
 * @return  ECAN_OK, ECAN_ERR_ARGUMENT or ECAN_ERR_CONFIG.
 */
int igh_mcan_pdo_writer_init(igh_mcan_pdo_writer_t *writer, const igh_mcan_pdo_profile_t *profile);

/**
 * Starts an image in a buffer. Frames added since the last finish are dropped.
 *
 * @param rxpdo       Buffer of the image, in the process data for example. Must stay valid until
 *                    igh_mcan_pdo_writer_finish().
 * @param rxpdo_size  Its bytes, at least those of the profile.
 *
 * @usage   rt, one thread at a time, after init
 * @return  ECAN_OK, ECAN_ERR_BUFFER.
 */
int igh_mcan_pdo_writer_begin(igh_mcan_pdo_writer_t *writer, uint8_t *rxpdo, size_t rxpdo_size);

/**
 * Adds a frame to the image; its slave index is ignored.
 *
 * @usage   rt, one thread at a time, after begin
 * @return  ECAN_OK; ECAN_ERR_NO_ROOM if the image is full; ECAN_ERR_CHANNEL if the profile does
 *          not have the channel; ECAN_ERR_FRAME, ECAN_ERR_ARGUMENT, ECAN_ERR_ORDER. The image
 *          changes only with ECAN_OK.
 */
int igh_mcan_pdo_writer_add(igh_mcan_pdo_writer_t *writer, const igh_mcan_tx_frame_t *frame);

/**
 * Adds a classic CAN frame to the image. Arguments as of igh_mcan_tx_frame_set_can().
 *
 * @usage   rt, one thread at a time, after begin
 * @return  As igh_mcan_pdo_writer_add().
 */
int igh_mcan_pdo_writer_add_can(igh_mcan_pdo_writer_t *writer,
                                uint8_t channel,
                                uint32_t can_id,
                                uint8_t flags,
                                const uint8_t *data,
                                size_t len);

/**
 * Adds a CAN FD frame to the image. Arguments as of igh_mcan_tx_frame_set_canfd().
 *
 * @usage   rt, one thread at a time, after begin
 * @return  As igh_mcan_pdo_writer_add().
 */
int igh_mcan_pdo_writer_add_canfd(igh_mcan_pdo_writer_t *writer,
                                  uint8_t channel,
                                  uint32_t can_id,
                                  uint8_t flags,
                                  const uint8_t *data,
                                  size_t len);

/**
 * Finishes the image: clears the rest of earlier images, computes the CRC, writes the header, and
 * the second sequence number last. Call it in every cycle with frames to send: the device ignores
 * an image whose sequence number it has received before.
 *
 * @param sequence  Gets the image's sequence number, to which a TX_RESULT refers; may be NULL.
 *
 * @usage   rt, one thread at a time, after begin
 * @return  ECAN_OK, ECAN_ERR_ORDER.
 */
int igh_mcan_pdo_writer_finish(igh_mcan_pdo_writer_t *writer, uint16_t *sequence);

/**
 * Sets the sequence number of the next image, as after a reset of the device's session
 * (0x8011:08, manual 13.2).
 *
 * @usage   rt, one thread at a time, after init
 */
int igh_mcan_pdo_writer_set_next_sequence(igh_mcan_pdo_writer_t *writer, uint16_t sequence);

/**
 * Returns the free bytes of the image; a packet needs 4 to 78 of them (manual 8.3).
 *
 * @usage   rt, one thread at a time, after init
 * @return  The bytes; 0 if there is no writer.
 */
size_t igh_mcan_pdo_writer_room(igh_mcan_pdo_writer_t *writer);

/**
 * Returns the number of frames in the image, at most 255.
 *
 * @usage   rt, one thread at a time, after init
 * @return  The number; 0 if there is no writer.
 */
size_t igh_mcan_pdo_writer_frames(igh_mcan_pdo_writer_t *writer);

/* ---------------------------------------------------------------------------
 * Faults of an image
 * --------------------------------------------------------------------------- */

/**
 * Errors of the encapsulation layer, as 0x8010:14 and 0x8011:14 report them (manual 13.2), and two
 * for an image that was read while it was written.
 */
typedef enum {
    /** No error. */
    IGH_MCAN_PDO_OK = 0,
    /** A frame exceeds what the profile can carry. */
    IGH_MCAN_PDO_FRAME_OVERRUN = 2,
    /** A packet exceeds the frame area. */
    IGH_MCAN_PDO_PACKET_OVERRUN = 3,
    /** A packet of unknown kind. */
    IGH_MCAN_PDO_UNKNOWN_KIND = 4,
    /** The DLC breaks the rules. */
    IGH_MCAN_PDO_INVALID_DLC = 5,
    /** The channel does not exist or is not in the mask. */
    IGH_MCAN_PDO_INVALID_CHANNEL = 6,
    /** The timestamp format does not belong to profile or direction. */
    IGH_MCAN_PDO_INVALID_TSF = 7,
    /** The payload ends inside a packet. */
    IGH_MCAN_PDO_TRUNCATED = 8,
    /** The encapsulation profile is not supported. */
    IGH_MCAN_PDO_UNSUPPORTED_PROFILE = 9,
    /** The image is the one before, received again. */
    IGH_MCAN_PDO_DUPLICATE_SEQUENCE = 10,
    /** An option is not supported. */
    IGH_MCAN_PDO_UNSUPPORTED_OPTION = 11,
    /** Frame area and mapping disagree, or the buffer is too small. */
    IGH_MCAN_PDO_ACTIVE_AREA = 12,
    /** A reserved bit is set. */
    IGH_MCAN_PDO_RESERVED_BIT = 13,
    /** Version, length or another field of the header is illegal. */
    IGH_MCAN_PDO_BAD_HEADER = 14,
    /** The CRC does not match. */
    IGH_MCAN_PDO_BAD_CRC = 15,
    /** The schedule record is illegal. */
    IGH_MCAN_PDO_BAD_SCHEDULE = 16,
    /** The image was being written: its sequence numbers differ. Skip it in this cycle. */
    IGH_MCAN_PDO_UPDATING = 256,
    /** The header changed while the image was read. Skip it in this cycle. */
    IGH_MCAN_PDO_TORN = 257,
    /** layout_id is not that of the profile; the frames are valid. */
    IGH_MCAN_PDO_LAYOUT = 258
} igh_mcan_pdo_error_t;

/**
 * Fault of an image and its location, with the fields that the manual demands (16.2). Fields
 * that do not apply are 0.
 */
typedef struct {
    /** An igh_mcan_pdo_error_t; 0 for no fault. */
    uint16_t error;
    /** Offset in the image where the faulty packet starts, in bytes; 0 for the header. */
    uint16_t offset;
    /** Offset after that packet, padding included, if it is known. */
    uint16_t packet_end;
    /** Control word of the packet. */
    uint16_t ctrl;
    /** Sequence number of the image. */
    uint16_t seq;
    /** payload_len of the header. */
    uint16_t payload_len;
    /** payload_crc16 of the header. */
    uint16_t payload_crc16;
    /** CRC of the payload as received. */
    uint16_t computed_crc16;
    /** layout_id of the header. */
    uint16_t layout_id;
    /** Channel of the packet. */
    uint8_t ch;
    /** DLC of the packet. */
    uint8_t dlc;
    /** Timestamp format of the packet. */
    uint8_t tsf;
    /** Kind of the packet. */
    uint8_t kind;
    /** Zero; for fields of later versions. */
    uint8_t reserved[10];
} igh_mcan_pdo_parse_diag_t;

/**
 * Gets a diagnosis as text.
 *
 * @param text  See the rules for texts in igh_ecan_common.h; 256 bytes are enough.
 *
 * @usage   not rt, any thread, any time
 * @return  ECAN_OK, ECAN_ERR_BUFFER; ECAN_ERR_ARGUMENT for an unknown error.
 */
int igh_mcan_pdo_diag_text(const igh_mcan_pdo_parse_diag_t *diag,
                           char *text,
                           size_t size,
                           size_t *needed);

/* ---------------------------------------------------------------------------
 * Reading images
 * --------------------------------------------------------------------------- */

/** Relation of an image's sequence number to the one before (manual 6.1). */
typedef enum {
    /** The first image, or one with a lower number, as after a restart of the sender. */
    IGH_MCAN_PDO_FIRST = 0,
    /** The expected number. */
    IGH_MCAN_PDO_NEXT = 1,
    /** The same image again; its packets were read already. */
    IGH_MCAN_PDO_REPEATED = 2,
    /** A new image after lost ones. */
    IGH_MCAN_PDO_GAP = 3
} igh_mcan_pdo_arrival_t;

/** The header of an image, as transmitted (manual 6), without any check. */
typedef struct {
    /** Header version and length, 0x16. */
    uint8_t ver_ihl;
    /** Flags (manual 6.1). */
    uint8_t flags;
    /** Sequence number of the image. */
    uint16_t seq_begin;
    /** The same, written last: an image is complete if both agree. */
    uint16_t seq_end;
    /** Valid bytes of the frame area. */
    uint16_t payload_len;
    /** CRC over them; 0 without CRC. */
    uint16_t payload_crc16;
    /** Short ID of the layout. */
    uint16_t layout_id;
    /** Enabled channels. */
    uint8_t channel_mask;
    /** Packets in the frame area. */
    uint8_t frame_count;
    /** Overflows and truncations of this image, at most 255. */
    uint8_t overflow_sat;
    /** 1 = CRC-16/CCITT-FALSE, 0 = none. */
    uint8_t crc_alg;
    /** Status words of the channels; see igh_mcan_channel_status_decode(). */
    uint16_t channel_status[4];
} igh_mcan_pdo_header_t;

/** Tracks the sequence numbers of one direction. Plain data without resources. */
typedef struct {
    /** Not for the application. */
    uint64_t opaque[2];
} igh_mcan_pdo_sequence_t;

/**
 * Reads the header of an image.
 *
 * @param image   The image.
 * @param size    Its bytes, at least 24.
 * @param header  Is overwritten.
 *
 * @usage   rt, any thread, any time
 * @return  ECAN_OK, ECAN_ERR_BUFFER.
 */
int igh_mcan_pdo_parse_header(const uint8_t *image, size_t size, igh_mcan_pdo_header_t *header);

/**
 * Checks an image as manual 6.1 demands and reads its frames and transmit results, with a
 * diagnosis of a fault (manual 16.2).
 *
 * Stateless: igh_mcan_pdo_sequence_observe() detects an image that was read before.
 *
 * @param profile   The profile that is active on the device.
 * @param txpdo     The image.
 * @param size      Its bytes, at least those of the profile.
 * @param frames    Gets the frames; their slave index is 0.
 * @param capacity  Frames that fit; an image holds at most ECAN_PDO_MAX_PACKETS.
 * @param count     Gets the number of frames stored. Frames before a fault are stored and valid.
 * @param diag      Gets the fault, error 0 for none; may be NULL.
 *
 * @usage   rt, any thread, any time
 * @return  ECAN_OK; ECAN_ERR_PARSE for a fault of the image; ECAN_ERR_IMAGE_BUSY for one that was
 *          being written; ECAN_ERR_LAYOUT for an image of another layout than the profile's, whose
 *          frames are stored; ECAN_ERR_BUFFER if size is too small or not all frames fit;
 *          ECAN_ERR_ARGUMENT, ECAN_ERR_CONFIG.
 */
int igh_mcan_pdo_parse_frames_ex(const igh_mcan_pdo_profile_t *profile,
                                 const uint8_t *txpdo,
                                 size_t size,
                                 igh_mcan_rx_frame_t *frames,
                                 size_t capacity,
                                 size_t *count,
                                 igh_mcan_pdo_parse_diag_t *diag);

/**
 * Starts tracking sequence numbers.
 *
 * @param sequence  Is overwritten.
 *
 * @usage   rt, any thread, any time
 */
int igh_mcan_pdo_sequence_init(igh_mcan_pdo_sequence_t *sequence);

/**
 * Compares the number of an image that was received intact with the last one, and stores it.
 *
 * @param number  seq_begin of the image.
 * @param lost    Gets the number of images lost before this one; may be NULL.
 *
 * @usage   rt, one thread at a time, after init
 * @return  An igh_mcan_pdo_arrival_t, or a negative ecan_result_t.
 */
int igh_mcan_pdo_sequence_observe(igh_mcan_pdo_sequence_t *sequence,
                                  uint16_t number,
                                  uint16_t *lost);

/* ---------------------------------------------------------------------------
 * Channel status
 * --------------------------------------------------------------------------- */

/** State of a CAN channel (manual 7). The device may report other values. */
typedef enum {
    /** The channel is not enabled. */
    IGH_MCAN_STATE_DISABLED = 0,
    /** Being initialised. */
    IGH_MCAN_STATE_INIT = 1,
    /** Takes part in the bus. */
    IGH_MCAN_STATE_RUN = 2,
    /** Off the bus after too many errors. */
    IGH_MCAN_STATE_BUS_OFF = 3,
    /** In error. */
    IGH_MCAN_STATE_ERROR = 4,
    /** Listens without sending or acknowledging. */
    IGH_MCAN_STATE_LISTEN = 5
} igh_mcan_state_t;

/** Status of a channel, as the TxPDO header carries it (manual 7). Flags are 0 or 1. */
typedef struct {
    /** The word as transmitted. */
    uint16_t raw;
    /** An igh_mcan_state_t. */
    uint8_t state;
    /** CAN FD is enabled. */
    uint8_t fd_enabled;
    /** Error warning, error passive or degraded bus. */
    uint8_t warn;
    /** Off the bus. */
    uint8_t bus_off;
    /** The receive cache is filling up. */
    uint8_t rx_pressure;
    /** The transmit queue is filling up. */
    uint8_t tx_pressure;
    /** The channel's diagnostic object has new content. */
    uint8_t detail_pending;
    /** A counter has reached its maximum. */
    uint8_t counter_saturated;
    /** Received frames that wait, as a coarse figure: 0 to 7. */
    uint8_t rx_pending;
    /** Frames that wait to be sent, as a coarse figure: 0 to 7. */
    uint8_t tx_pending;
    /** Zero; for fields of later versions. */
    uint8_t reserved[4];
} igh_mcan_channel_status_t;

/**
 * Decodes a channel status word.
 *
 * @param raw     The word of the image header.
 * @param status  Is overwritten.
 *
 * @usage   rt, any thread, any time
 */
int igh_mcan_channel_status_decode(uint16_t raw, igh_mcan_channel_status_t *status);

/* ---------------------------------------------------------------------------
 * Checksum and data lengths
 * --------------------------------------------------------------------------- */

/**
 * Computes CRC-16/CCITT-FALSE, the checksum of an image's payload (manual 6).
 *
 * @usage   rt, any thread, any time
 * @return  The CRC; 0xFFFF, that of no bytes, for NULL.
 */
uint16_t igh_mcan_pdo_crc16(const uint8_t *data, size_t len);

/**
 * Returns the DLC of a number of data bytes (manual 8.2).
 *
 * @param is_fd  0 for classic CAN, else CAN FD.
 *
 * @usage   rt, any thread, any time
 * @return  0 to 15; ECAN_ERR_FRAME if no DLC stands for this length.
 */
int igh_mcan_dlc_from_len(size_t len, int is_fd);

/**
 * Returns the number of data bytes of a DLC (manual 8.2).
 *
 * @param is_fd  0 for classic CAN, where 8 to 15 all stand for 8 bytes; else CAN FD.
 *
 * @usage   rt, any thread, any time
 * @return  0 to 64; ECAN_ERR_ARGUMENT above 15.
 */
int igh_mcan_len_from_dlc(uint8_t dlc, int is_fd);

#ifdef __cplusplus
}
#endif

#endif /* IGH_MCAN_PDO_H */
