/* igh_mcan_pdo.h: reading valid and damaged images. */
#include "check.h"

/* The manual's example of 5.4.4.1. */
static const uint8_t EXAMPLE[36] = {
    0x16, 0x00, 0x01, 0x00, 0x01, 0x00, 0x0c, 0x00, 0xd3, 0x56, 0xe7, 0x01,
    0x0f, 0x01, 0x00, 0x01, 0,    0,    0,    0,    0,    0,    0,    0,
    0x40, 0x00, 0x23, 0x01, 0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88};

static const uint8_t DATA[8] = {0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88};

static uint8_t image[1024];
static igh_mcan_pdo_profile_t profile;

static void make_example(void)
{
    igh_mcan_pdo_writer_t writer;
    uint16_t sequence = 0;
    fill_garbage(2, image, sizeof(image));
    GOOD(igh_mcan_pdo_profile_default(&profile, IGH_MCAN_RXPDO, 8, 0x0f));
    GOOD(igh_mcan_pdo_writer_init(&writer, &profile));
    GOOD(igh_mcan_pdo_writer_begin(&writer, image, sizeof(image)));
    GOOD(igh_mcan_pdo_writer_add_can(&writer, 0, 0x123, 0, DATA, 8));
    GOOD(igh_mcan_pdo_writer_finish(&writer, &sequence));
    SAME(1, sequence);
    SAME(0, memcmp(image, EXAMPLE, sizeof(EXAMPLE)));
    for (size_t i = sizeof(EXAMPLE); i < sizeof(image); i++) {
        if (image[i] != 0) {
            SAME(0, image[i]);
            break;
        }
    }
}

/* Sets the bytes of the payload and its CRC, as the device does. */
static void seal_payload(uint16_t length)
{
    uint16_t crc = igh_mcan_pdo_crc16(image + ECAN_PDO_HEADER_BYTES, length);
    image[6] = (uint8_t)length;
    image[7] = (uint8_t)(length >> 8);
    image[8] = (uint8_t)crc;
    image[9] = (uint8_t)(crc >> 8);
}

static void sound(void)
{
    igh_mcan_pdo_header_t header;
    igh_mcan_pdo_parse_diag_t diag;
    igh_mcan_rx_frame_t frames[4];
    size_t count = 99;

    make_example();
    GOOD(igh_mcan_pdo_parse_header(image, ECAN_PDO_HEADER_BYTES, &header));
    SAME(0x16, header.ver_ihl);
    SAME(1, header.seq_begin);
    SAME(1, header.seq_end);
    SAME(12, header.payload_len);
    SAME(0x56d3, header.payload_crc16);
    SAME(0x01e7, header.layout_id);
    SAME(0x0f, header.channel_mask);
    SAME(1, header.frame_count);
    SAME(1, header.crc_alg);
    SAME(igh_mcan_pdo_layout_id(&profile), header.layout_id);
    BAD(ECAN_ERR_BUFFER, igh_mcan_pdo_parse_header(image, 0, &header));
    BAD(ECAN_ERR_BUFFER, igh_mcan_pdo_parse_header(image, 1, &header));
    BAD(ECAN_ERR_BUFFER,
        igh_mcan_pdo_parse_header(image, ECAN_PDO_HEADER_BYTES - 1, &header));

    fill_garbage(2, &diag, sizeof(diag));
    fill_garbage(2, frames, sizeof(frames));
    GOOD(igh_mcan_pdo_parse_frames_ex(&profile, image, sizeof(image), frames, 4, &count, &diag));
    SAME(1, count);
    SAME(0, diag.error);
    SAME(0, frames[0].slave);
    SAME(0, frames[0].channel);
    SAME(0x123, frames[0].can_id);
    SAME(0, frames[0].flags);
    SAME(8, frames[0].len);
    SAME(IGH_MCAN_RX_FRAME, frames[0].kind);
    SAME(IGH_MCAN_TIMESTAMP_NONE, frames[0].timestamp_format);
    SAME(0, memcmp(frames[0].data, DATA, 8));
    SAME(0, frames[0].data[8]);
    count = 99;
    GOOD(igh_mcan_pdo_parse_frames_ex(&profile, image, sizeof(image), frames, 1, &count, NULL));
    SAME(1, count);

    BAD(ECAN_ERR_BUFFER, igh_mcan_pdo_parse_frames_ex(&profile, image, 0, frames, 4, &count, NULL));
    BAD(ECAN_ERR_BUFFER, igh_mcan_pdo_parse_frames_ex(&profile, image, 1, frames, 4, &count, NULL));
    BAD(ECAN_ERR_BUFFER,
        igh_mcan_pdo_parse_frames_ex(&profile, image, 1023, frames, 4, &count, NULL));
    count = 99;
    BAD(ECAN_ERR_BUFFER,
        igh_mcan_pdo_parse_frames_ex(&profile, image, 1024, NULL, 0, &count, &diag));
    SAME(0, count);
}

static void broken(void)
{
    igh_mcan_pdo_parse_diag_t diag;
    igh_mcan_rx_frame_t frames[4];
    size_t count = 99;

    check_about("the CRC");
    make_example();
    image[30] ^= 0x01;
    BAD(ECAN_ERR_PARSE,
        igh_mcan_pdo_parse_frames_ex(&profile, image, 1024, frames, 4, &count, &diag));
    SAME(0, count);
    SAME(IGH_MCAN_PDO_BAD_CRC, diag.error);
    SAME(0, diag.offset);
    SAME(1, diag.seq);
    SAME(12, diag.payload_len);
    SAME(0x56d3, diag.payload_crc16);
    SAME(igh_mcan_pdo_crc16(image + 24, 12), diag.computed_crc16);
    SAME(0x01e7, diag.layout_id);
    BAD(ECAN_ERR_PARSE,
        igh_mcan_pdo_parse_frames_ex(&profile, image, 1024, frames, 4, &count, NULL));

    check_about("an image that is being written");
    make_example();
    image[4] = 2;
    BAD(ECAN_ERR_IMAGE_BUSY,
        igh_mcan_pdo_parse_frames_ex(&profile, image, 1024, frames, 4, &count, &diag));
    SAME(0, count);
    SAME(IGH_MCAN_PDO_UPDATING, diag.error);

    check_about("a packet that is cut off");
    make_example();
    seal_payload(10);
    BAD(ECAN_ERR_PARSE,
        igh_mcan_pdo_parse_frames_ex(&profile, image, 1024, frames, 4, &count, &diag));
    SAME(0, count);
    SAME(IGH_MCAN_PDO_TRUNCATED, diag.error);
    SAME(24, diag.offset);
    SAME(36, diag.packet_end);
    SAME(0x0040, diag.ctrl);
    SAME(0, diag.ch);
    SAME(8, diag.dlc);
    SAME(0, diag.tsf);
    SAME(0, diag.kind);
    SAME(10, diag.payload_len);

    check_about("a second packet of a channel that there is not");
    make_example();
    memcpy(image + 36, image + 24, 12);
    image[36] |= 0x05;
    image[13] = 2;
    seal_payload(24);
    fill_garbage(2, frames, sizeof(frames));
    BAD(ECAN_ERR_PARSE,
        igh_mcan_pdo_parse_frames_ex(&profile, image, 1024, frames, 4, &count, &diag));
    SAME(1, count);
    SAME(0x123, frames[0].can_id);
    SAME(IGH_MCAN_PDO_INVALID_CHANNEL, diag.error);
    SAME(36, diag.offset);
    SAME(5, diag.ch);

    check_about("two packets, room for one");
    image[36] &= 0xF8;
    seal_payload(24);
    BAD(ECAN_ERR_BUFFER,
        igh_mcan_pdo_parse_frames_ex(&profile, image, 1024, frames, 1, &count, NULL));
    SAME(1, count);

    check_about("a kind that there is not");
    make_example();
    image[25] |= 0x60;
    seal_payload(12);
    BAD(ECAN_ERR_PARSE,
        igh_mcan_pdo_parse_frames_ex(&profile, image, 1024, frames, 4, &count, &diag));
    SAME(IGH_MCAN_PDO_UNKNOWN_KIND, diag.error);
    SAME(3, diag.kind);

    check_about("a timestamp without a profile for it");
    make_example();
    image[25] |= 0x08;
    seal_payload(12);
    BAD(ECAN_ERR_PARSE,
        igh_mcan_pdo_parse_frames_ex(&profile, image, 1024, frames, 4, &count, &diag));
    SAME(IGH_MCAN_PDO_INVALID_TSF, diag.error);
    SAME(1, diag.tsf);

    check_about("the header");
    make_example();
    image[0] = 0x26;
    BAD(ECAN_ERR_PARSE,
        igh_mcan_pdo_parse_frames_ex(&profile, image, 1024, frames, 4, &count, &diag));
    SAME(IGH_MCAN_PDO_BAD_HEADER, diag.error);
    SAME(0, diag.offset);
    make_example();
    image[7] = 0x04;
    BAD(ECAN_ERR_PARSE,
        igh_mcan_pdo_parse_frames_ex(&profile, image, 1024, frames, 4, &count, &diag));
    TRUE(diag.error == IGH_MCAN_PDO_BAD_HEADER || diag.error == IGH_MCAN_PDO_ACTIVE_AREA);
    check_about(NULL);
}

/* Any bytes can be parsed without harm. */
static void any_bytes(void)
{
    static igh_mcan_rx_frame_t frames[ECAN_PDO_MAX_PACKETS];
    igh_mcan_pdo_parse_diag_t diag;
    char text[256];
    for (int round = 0; round < 400; round++) {
        size_t count = 0;
        uint8_t kept[ECAN_PDO_HEADER_BYTES];
        int code;
        make_example();
        memcpy(kept, image, sizeof(kept));
        fill_garbage(3, image, sizeof(image));
        if (round % 2 == 0) {
            memcpy(image, kept, sizeof(kept));
            seal_payload((uint16_t)(round * 5 / 2));
        }
        code = igh_mcan_pdo_parse_frames_ex(&profile, image, sizeof(image), frames,
                                            ECAN_PDO_MAX_PACKETS, &count, &diag);
        TRUE(code == ECAN_OK || code == ECAN_ERR_PARSE || code == ECAN_ERR_IMAGE_BUSY);
        TRUE(count <= ECAN_PDO_MAX_PACKETS);
        TRUE((code == ECAN_OK) == (diag.error == 0));
        GOOD(igh_mcan_pdo_diag_text(&diag, text, sizeof(text), NULL));
    }
}

static void diagnosis_text(void)
{
    igh_mcan_pdo_parse_diag_t diag;
    igh_mcan_rx_frame_t frames[4];
    char whole[256];
    char text[256];
    size_t count = 0;
    size_t length;
    size_t needed = 0;

    make_example();
    image[30] ^= 0x01;
    igh_mcan_pdo_parse_frames_ex(&profile, image, 1024, frames, 4, &count, &diag);
    GOOD(igh_mcan_pdo_diag_text(&diag, whole, sizeof(whole), NULL));
    length = strlen(whole);
    TRUE(length > 0);
    GOOD(igh_mcan_pdo_diag_text(&diag, text, length + 1, NULL));
    TRUE(strcmp(text, whole) == 0);
    BAD(ECAN_ERR_BUFFER, igh_mcan_pdo_diag_text(&diag, text, length, NULL));
    SAME(length - 1, strlen(text));
    GOOD(igh_mcan_pdo_diag_text(&diag, NULL, 0, &needed));
    SAME(length + 1, needed);
    needed = 0;
    BAD(ECAN_ERR_BUFFER, igh_mcan_pdo_diag_text(&diag, text, 2, &needed));
    SAME(length + 1, needed);
    BAD(ECAN_ERR_BUFFER, igh_mcan_pdo_diag_text(&diag, text, 1, NULL));
    SAME(0, text[0]);
    BAD(ECAN_ERR_BUFFER, igh_mcan_pdo_diag_text(&diag, text, 0, NULL));
    memset(&diag, 0, sizeof(diag));
    GOOD(igh_mcan_pdo_diag_text(&diag, text, sizeof(text), NULL));
    diag.error = 999;
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_pdo_diag_text(&diag, text, sizeof(text), NULL));
    diag.error = 1;
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_pdo_diag_text(&diag, text, sizeof(text), NULL));
}

/* The device has N = 8, the profile N = 7: the frames are read, and the difference is reported. */
static void other_layout(void)
{
    igh_mcan_pdo_profile_t device;
    igh_mcan_pdo_parse_diag_t diag;
    igh_mcan_rx_frame_t frames[1];
    char text[256];
    size_t count = 0;

    make_example();
    device = profile;
    GOOD(igh_mcan_pdo_profile_default(&profile, IGH_MCAN_RXPDO, 7, 0x0f));
    BAD(ECAN_ERR_LAYOUT,
        igh_mcan_pdo_parse_frames_ex(&profile, image, 896, frames, 1, &count, &diag));
    ERROR_HAS("layout_id 0x01E7, the profile 0x01E6");
    SAME(1, count);
    SAME(0x123, frames[0].can_id);
    SAME(IGH_MCAN_PDO_LAYOUT, diag.error);
    SAME(0x01E7, diag.layout_id);
    SAME(1, diag.seq);
    GOOD(igh_mcan_pdo_diag_text(&diag, text, sizeof(text), NULL));
    TEXT_HAS("layout_id 0x01E7", text);
    /* A fault of the image comes first. */
    image[30] ^= 0x01;
    BAD(ECAN_ERR_PARSE,
        igh_mcan_pdo_parse_frames_ex(&profile, image, 896, frames, 1, &count, &diag));
    SAME(IGH_MCAN_PDO_BAD_CRC, diag.error);
    profile = device;
}

static void sequences(void)
{
    igh_mcan_pdo_sequence_t sequence;
    uint16_t lost = 99;

    for (int kind = 0; kind < GARBAGE_KINDS; kind++) {
        check_about(fill_garbage(kind, &sequence, sizeof(sequence)));
        BAD(ECAN_ERR_NOT_INITIALISED, igh_mcan_pdo_sequence_observe(&sequence, 1, &lost));
    }
    check_about(NULL);
    GOOD(igh_mcan_pdo_sequence_init(&sequence));
    SAME(IGH_MCAN_PDO_FIRST, igh_mcan_pdo_sequence_observe(&sequence, 0xFFFE, &lost));
    SAME(0, lost);
    SAME(IGH_MCAN_PDO_NEXT, igh_mcan_pdo_sequence_observe(&sequence, 0xFFFF, &lost));
    SAME(IGH_MCAN_PDO_REPEATED, igh_mcan_pdo_sequence_observe(&sequence, 0xFFFF, NULL));
    SAME(IGH_MCAN_PDO_GAP, igh_mcan_pdo_sequence_observe(&sequence, 10, &lost));
    TRUE(lost == 9 || lost == 10);
    SAME(IGH_MCAN_PDO_NEXT, igh_mcan_pdo_sequence_observe(&sequence, 11, &lost));
    SAME(0, lost);
    SAME(IGH_MCAN_PDO_FIRST, igh_mcan_pdo_sequence_observe(&sequence, 1, &lost));
}

void test_pdo_parse(void)
{
    sound();
    broken();
    any_bytes();
    diagnosis_text();
    other_layout();
    sequences();
}
