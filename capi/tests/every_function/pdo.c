/* igh_mcan_pdo.h: frames, profiles, the writer, small functions. */
#include "check.h"

static const uint8_t DATA[65] = {0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88, 0x99};

/* Invalid CAN IDs, lengths and flags; the same for every function with a frame. */
static const struct {
    uint32_t can_id;
    uint8_t flags;
    size_t len;
} NO_CLASSIC[] = {
    {0x800, 0, 8},
    {0xFFFFFFFF, 0, 8},
    {0x20000000, IGH_MCAN_FLAG_EXT, 8},
    {0x123, 0, 9},
    {0x123, 0, 64},
    {0x123, 0, SIZE_MAX / 2},
    {0x123, IGH_MCAN_FLAG_RTR, 9},
    {0x123, IGH_MCAN_FLAG_RTR, 16},
    {0x123, IGH_MCAN_FLAG_BRS, 8},
    {0x123, IGH_MCAN_FLAG_ESI, 8},
    {0x123, IGH_MCAN_FLAG_FD, 8},
    {0x123, 32, 8},
    {0x123, 128, 8},
    {0x123, 0xFF, 8},
}, NO_FD[] = {
    {0x800, 0, 8},
    {0x20000000, IGH_MCAN_FLAG_EXT, 8},
    {0x123, 0, 9},
    {0x123, 0, 11},
    {0x123, 0, 63},
    {0x123, 0, 65},
    {0x123, IGH_MCAN_FLAG_RTR, 8},
    {0x123, 32, 8},
    {0x123, 0xFF, 8},
};

static void frames(void)
{
    static const size_t FD_LENGTHS[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
    igh_mcan_tx_frame_t frame;
    igh_mcan_tx_frame_t before;

    fill_garbage(2, &frame, sizeof(frame));
    GOOD(igh_mcan_tx_frame_set_can(&frame, 3, 2, 0x7FF, 0, DATA, 8));
    SAME(3, frame.slave);
    SAME(2, frame.channel);
    SAME(0x7FF, frame.can_id);
    SAME(0, frame.flags);
    SAME(8, frame.len);
    SAME(IGH_MCAN_HINT_NORMAL, frame.hint);
    SAME(0, frame.scheduled);
    SAME(0, memcmp(frame.data, DATA, 8));
    SAME(0, frame.data[8]);
    GOOD(igh_mcan_tx_frame_set_can(&frame, 0, 0, 0x1FFFFFFF, IGH_MCAN_FLAG_EXT, DATA, 1));
    GOOD(igh_mcan_tx_frame_set_can(&frame, 0, 0, 0, 0, NULL, 0));
    GOOD(igh_mcan_tx_frame_set_can(&frame, 0, 0, 0, IGH_MCAN_FLAG_RTR, NULL, 8));
    SAME(8, frame.len);
    for (size_t i = 0; i < ITEMS(FD_LENGTHS); i++) {
        GOOD(igh_mcan_tx_frame_set_canfd(&frame, 1, 3, 0x123, IGH_MCAN_FLAG_BRS, DATA,
                                         FD_LENGTHS[i]));
        SAME(FD_LENGTHS[i], frame.len);
    }
    TRUE((frame.flags & IGH_MCAN_FLAG_FD) != 0);
    TRUE((frame.flags & IGH_MCAN_FLAG_BRS) != 0);
    SAME(0, memcmp(frame.data, DATA, 64));
    GOOD(igh_mcan_tx_frame_set_canfd(&frame, 0, 0, 1, IGH_MCAN_FLAG_ESI, NULL, 0));

    /* The frame is written only on success. */
    fill_garbage(2, &frame, sizeof(frame));
    before = frame;
    BAD(ECAN_ERR_NULL, igh_mcan_tx_frame_set_can(&frame, 0, 0, 0x123, 0, NULL, 1));
    BAD(ECAN_ERR_CHANNEL, igh_mcan_tx_frame_set_can(&frame, 0, 4, 0x123, 0, DATA, 8));
    BAD(ECAN_ERR_CHANNEL, igh_mcan_tx_frame_set_can(&frame, 0, 255, 0x123, 0, DATA, 8));
    BAD(ECAN_ERR_SLAVE, igh_mcan_tx_frame_set_can(&frame, 65536, 0, 0x123, 0, DATA, 8));
    BAD(ECAN_ERR_SLAVE, igh_mcan_tx_frame_set_can(&frame, SIZE_MAX, 0, 0x123, 0, DATA, 8));
    for (size_t i = 0; i < ITEMS(NO_CLASSIC); i++) {
        BAD(ECAN_ERR_FRAME,
            igh_mcan_tx_frame_set_can(&frame, 0, 0, NO_CLASSIC[i].can_id, NO_CLASSIC[i].flags,
                                      DATA, NO_CLASSIC[i].len));
    }
    BAD(ECAN_ERR_CHANNEL, igh_mcan_tx_frame_set_canfd(&frame, 0, 4, 0x123, 0, DATA, 8));
    BAD(ECAN_ERR_SLAVE, igh_mcan_tx_frame_set_canfd(&frame, 65536, 0, 0x123, 0, DATA, 8));
    for (size_t i = 0; i < ITEMS(NO_FD); i++) {
        BAD(ECAN_ERR_FRAME, igh_mcan_tx_frame_set_canfd(&frame, 0, 0, NO_FD[i].can_id,
                                                        NO_FD[i].flags, DATA, NO_FD[i].len));
    }
    SAME(0, memcmp(&frame, &before, sizeof(frame)));

    GOOD(igh_mcan_tx_frame_set_can(&frame, 0, 0, 0x123, 0, DATA, 8));
    GOOD(igh_mcan_tx_frame_set_schedule(&frame, 700000, 0xBEEF));
    TRUE(frame.scheduled != 0);
    SAME(700000, frame.offset_ns);
    SAME(0xBEEF, frame.tag);
    for (int hint = IGH_MCAN_HINT_NORMAL; hint <= IGH_MCAN_HINT_QUEUE; hint++) {
        GOOD(igh_mcan_tx_frame_set_hint(&frame, hint));
        SAME(hint, frame.hint);
    }
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_tx_frame_set_hint(&frame, -1));
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_tx_frame_set_hint(&frame, 4));
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_tx_frame_set_hint(&frame, 256));
}

/* A profile with an invalid field must be rejected with this code. */
static void faulty_profile(int code, igh_mcan_pdo_profile_t profile)
{
    igh_mcan_pdo_writer_t writer;
    igh_mcan_rx_frame_t frame;
    static uint8_t image[3072];
    size_t count = 0;
    BAD(code, igh_mcan_pdo_profile_check(&profile));
    NONE(code, 0, igh_mcan_pdo_profile_word(&profile));
    NONE(code, 0, igh_mcan_pdo_layout_id(&profile));
    NONE(code, 0, igh_mcan_pdo_bytes(&profile));
    BAD(code, igh_mcan_pdo_writer_init(&writer, &profile));
    BAD(code,
        igh_mcan_pdo_parse_frames_ex(&profile, image, sizeof(image), &frame, 1, &count, NULL));
}

static void received_frames(void)
{
    igh_mcan_tx_frame_t frame;
    igh_mcan_tx_frame_t before;
    igh_mcan_rx_frame_t received;

    memset(&received, 0, sizeof(received));
    received.slave = 2;
    received.channel = 3;
    received.can_id = 0x1ABCDEF;
    received.flags = IGH_MCAN_FLAG_EXT | IGH_MCAN_FLAG_FD | IGH_MCAN_FLAG_BRS;
    received.len = 12;
    received.source = IGH_MCAN_SOURCE_FIFO1;
    memcpy(received.data, DATA, 12);
    fill_garbage(2, &frame, sizeof(frame));
    GOOD(igh_mcan_tx_frame_set_received(&frame, &received));
    SAME(2, frame.slave);
    SAME(3, frame.channel);
    SAME(0x1ABCDEF, frame.can_id);
    SAME(received.flags, frame.flags);
    SAME(12, frame.len);
    SAME(0, frame.hint);
    SAME(0, frame.scheduled);
    SAME(0, memcmp(frame.data, received.data, 64));
    before = frame;
    received.len = 13;
    BAD(ECAN_ERR_FRAME, igh_mcan_tx_frame_set_received(&frame, &received));
    received.len = 12;
    received.can_id = 0x20000000;
    BAD(ECAN_ERR_FRAME, igh_mcan_tx_frame_set_received(&frame, &received));
    received.can_id = 1;
    received.flags = 0x80;
    BAD(ECAN_ERR_FRAME, igh_mcan_tx_frame_set_received(&frame, &received));
    received.flags = 0;
    BAD(ECAN_ERR_FRAME, igh_mcan_tx_frame_set_received(&frame, &received));
    received.len = 8;
    received.kind = IGH_MCAN_RX_TX_RESULT;
    BAD(ECAN_ERR_FRAME, igh_mcan_tx_frame_set_received(&frame, &received));
    received.kind = 2;
    BAD(ECAN_ERR_FRAME, igh_mcan_tx_frame_set_received(&frame, &received));
    SAME(0, memcmp(&frame, &before, sizeof(frame)));
}

static void profiles(void)
{
    igh_mcan_pdo_profile_t profile;
    igh_mcan_pdo_profile_t good;

    GOOD(igh_mcan_pdo_profile_default(&profile, IGH_MCAN_RXPDO, 8, 0x0F));
    GOOD(igh_mcan_pdo_profile_check(&profile));
    SAME(1024, igh_mcan_pdo_bytes(&profile));
    SAME(0x01E7, igh_mcan_pdo_layout_id(&profile));
    TRUE(igh_mcan_pdo_profile_word(&profile) != 0);
    good = profile;
    GOOD(igh_mcan_pdo_profile_default(&profile, IGH_MCAN_TXPDO, 1, 0x08));
    GOOD(igh_mcan_pdo_profile_default(&profile, IGH_MCAN_TXPDO, 24, 0x01));
    SAME(3072, igh_mcan_pdo_bytes(&profile));
    TRUE(igh_mcan_pdo_profile_word(&profile) != igh_mcan_pdo_profile_word(&good));
    profile.options = IGH_MCAN_OPTION_TX_RESULT;
    GOOD(igh_mcan_pdo_profile_check(&profile));

    BAD(ECAN_ERR_ARGUMENT, igh_mcan_pdo_profile_default(&profile, 2, 8, 0x0F));
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_pdo_profile_default(&profile, -1, 8, 0x0F));
    BAD(ECAN_ERR_CONFIG, igh_mcan_pdo_profile_default(&profile, IGH_MCAN_RXPDO, 0, 0x0F));
    BAD(ECAN_ERR_CONFIG, igh_mcan_pdo_profile_default(&profile, IGH_MCAN_RXPDO, 25, 0x0F));
    BAD(ECAN_ERR_CONFIG, igh_mcan_pdo_profile_default(&profile, IGH_MCAN_RXPDO, 3, 0x10));

#define FAULTY(code, field, value)                                                                 \
    do {                                                                                           \
        check_about(#field);                                                                       \
        profile = good;                                                                            \
        profile.field = (value);                                                                   \
        faulty_profile((code), profile);                                                           \
        check_about(NULL);                                                                         \
    } while (0)
    FAULTY(ECAN_ERR_ARGUMENT, direction, 2);
    FAULTY(ECAN_ERR_ARGUMENT, encapsulation, 2);
    FAULTY(ECAN_ERR_ARGUMENT, budget, 3);
    FAULTY(ECAN_ERR_ARGUMENT, options, 0x80);
    FAULTY(ECAN_ERR_CONFIG, multiplier, 25);
    FAULTY(ECAN_ERR_CONFIG, channel_mask, 0x1F);
    FAULTY(ECAN_ERR_CONFIG, options, IGH_MCAN_OPTION_TX_RESULT);
#undef FAULTY
}

static void no_writer(int code, igh_mcan_pdo_writer_t *writer)
{
    static uint8_t image[384];
    igh_mcan_tx_frame_t frame;
    GOOD(igh_mcan_tx_frame_set_can(&frame, 0, 0, 0x123, 0, DATA, 8));
    BAD(code, igh_mcan_pdo_writer_begin(writer, image, sizeof(image)));
    BAD(code, igh_mcan_pdo_writer_add(writer, &frame));
    BAD(code, igh_mcan_pdo_writer_add_can(writer, 0, 0x123, 0, DATA, 8));
    BAD(code, igh_mcan_pdo_writer_add_canfd(writer, 0, 0x123, 0, DATA, 8));
    BAD(code, igh_mcan_pdo_writer_finish(writer, NULL));
    BAD(code, igh_mcan_pdo_writer_set_next_sequence(writer, 1));
    NONE(code, 0, igh_mcan_pdo_writer_room(writer));
    NONE(code, 0, igh_mcan_pdo_writer_frames(writer));
}

static void writer(void)
{
    static uint8_t image[384];
    igh_mcan_pdo_profile_t profile;
    igh_mcan_pdo_writer_t writer;
    igh_mcan_pdo_writer_t copy;
    igh_mcan_tx_frame_t frame;
    uint16_t sequence = 0;
    size_t room;
    size_t count;

    GOOD(igh_mcan_pdo_profile_default(&profile, IGH_MCAN_RXPDO, 3, 0x03));
    for (int kind = 0; kind < GARBAGE_KINDS; kind++) {
        check_about(fill_garbage(kind, &writer, sizeof(writer)));
        no_writer(ECAN_ERR_NOT_INITIALISED, &writer);
        GOOD(igh_mcan_pdo_writer_init(&writer, &profile));
    }
    check_about(NULL);

    GOOD(igh_mcan_tx_frame_set_can(&frame, 99, 0, 0x123, 0, DATA, 8));
    BAD(ECAN_ERR_ORDER, igh_mcan_pdo_writer_add(&writer, &frame));
    BAD(ECAN_ERR_ORDER, igh_mcan_pdo_writer_add_can(&writer, 0, 0x123, 0, DATA, 8));
    BAD(ECAN_ERR_ORDER, igh_mcan_pdo_writer_add_canfd(&writer, 0, 0x123, 0, DATA, 8));
    BAD(ECAN_ERR_ORDER, igh_mcan_pdo_writer_finish(&writer, NULL));
    BAD(ECAN_ERR_BUFFER, igh_mcan_pdo_writer_begin(&writer, image, 0));
    BAD(ECAN_ERR_BUFFER, igh_mcan_pdo_writer_begin(&writer, image, 1));
    BAD(ECAN_ERR_BUFFER, igh_mcan_pdo_writer_begin(&writer, image, sizeof(image) - 1));
    GOOD(igh_mcan_pdo_writer_begin(&writer, image, sizeof(image)));
    SAME(0, igh_mcan_pdo_writer_frames(&writer));
    room = igh_mcan_pdo_writer_room(&writer);
    SAME(sizeof(image) - ECAN_PDO_HEADER_BYTES, room);

    GOOD(igh_mcan_pdo_writer_add(&writer, &frame));
    GOOD(igh_mcan_pdo_writer_add_can(&writer, 1, 0x1FFFFFFF, IGH_MCAN_FLAG_EXT, DATA, 0));
    GOOD(igh_mcan_pdo_writer_add_can(&writer, 1, 0x7, IGH_MCAN_FLAG_RTR, NULL, 4));
    GOOD(igh_mcan_pdo_writer_add_canfd(&writer, 1, 0x7, IGH_MCAN_FLAG_BRS, DATA, 64));
    SAME(4, igh_mcan_pdo_writer_frames(&writer));
    TRUE(igh_mcan_pdo_writer_room(&writer) < room);
    room = igh_mcan_pdo_writer_room(&writer);

    /* None of these changes the image. */
    BAD(ECAN_ERR_CHANNEL, igh_mcan_pdo_writer_add_can(&writer, 2, 0x123, 0, DATA, 8));
    BAD(ECAN_ERR_CHANNEL, igh_mcan_pdo_writer_add_can(&writer, 4, 0x123, 0, DATA, 8));
    BAD(ECAN_ERR_CHANNEL, igh_mcan_pdo_writer_add_canfd(&writer, 3, 0x123, 0, DATA, 8));
    BAD(ECAN_ERR_NULL, igh_mcan_pdo_writer_add_can(&writer, 0, 0x123, 0, NULL, 8));
    for (size_t i = 0; i < ITEMS(NO_CLASSIC); i++) {
        BAD(ECAN_ERR_FRAME,
            igh_mcan_pdo_writer_add_can(&writer, 0, NO_CLASSIC[i].can_id, NO_CLASSIC[i].flags,
                                        DATA, NO_CLASSIC[i].len));
    }
    for (size_t i = 0; i < ITEMS(NO_FD); i++) {
        BAD(ECAN_ERR_FRAME, igh_mcan_pdo_writer_add_canfd(&writer, 0, NO_FD[i].can_id,
                                                          NO_FD[i].flags, DATA, NO_FD[i].len));
    }
    frame.channel = 2;
    BAD(ECAN_ERR_CHANNEL, igh_mcan_pdo_writer_add(&writer, &frame));
    frame.channel = 0;
    frame.hint = 4;
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_pdo_writer_add(&writer, &frame));
    frame.hint = 0;
    frame.len = 9;
    BAD(ECAN_ERR_FRAME, igh_mcan_pdo_writer_add(&writer, &frame));
    frame.len = 255;
    BAD(ECAN_ERR_FRAME, igh_mcan_pdo_writer_add(&writer, &frame));
    frame.flags = IGH_MCAN_FLAG_FD;
    BAD(ECAN_ERR_FRAME, igh_mcan_pdo_writer_add(&writer, &frame));
    SAME(room, igh_mcan_pdo_writer_room(&writer));
    SAME(4, igh_mcan_pdo_writer_frames(&writer));

    for (count = 0; count < 100; count++) {
        if (igh_mcan_pdo_writer_add_can(&writer, 0, 0x123, 0, DATA, 8) != ECAN_OK) {
            break;
        }
    }
    TRUE(count > 0 && count < 100);
    BAD(ECAN_ERR_NO_ROOM, igh_mcan_pdo_writer_add_can(&writer, 0, 0x123, 0, DATA, 8));
    BAD(ECAN_ERR_NO_ROOM, igh_mcan_pdo_writer_add_canfd(&writer, 0, 0x123, 0, DATA, 64));
    SAME(4 + count, igh_mcan_pdo_writer_frames(&writer));
    GOOD(igh_mcan_pdo_writer_finish(&writer, &sequence));
    SAME(1, sequence);
    BAD(ECAN_ERR_ORDER, igh_mcan_pdo_writer_finish(&writer, NULL));
    BAD(ECAN_ERR_ORDER, igh_mcan_pdo_writer_add_can(&writer, 0, 0x123, 0, DATA, 8));

    GOOD(igh_mcan_pdo_writer_set_next_sequence(&writer, 0xFFFF));
    copy = writer;
    GOOD(igh_mcan_pdo_writer_begin(&copy, image, sizeof(image)));
    GOOD(igh_mcan_pdo_writer_finish(&copy, &sequence));
    SAME(0xFFFF, sequence);
    GOOD(igh_mcan_pdo_writer_begin(&copy, image, sizeof(image)));
    GOOD(igh_mcan_pdo_writer_begin(&copy, image, sizeof(image)));
    GOOD(igh_mcan_pdo_writer_finish(&copy, &sequence));
    TRUE(sequence != 0xFFFF);
}

static void small_functions(void)
{
    static const uint8_t DIGITS[] = "123456789";
    static const int FD_BYTES[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
    igh_mcan_channel_status_t status;

    SAME(0x29B1, igh_mcan_pdo_crc16(DIGITS, 9));
    SAME(0xFFFF, igh_mcan_pdo_crc16(NULL, 0));
    SAME(0xFFFF, igh_mcan_pdo_crc16(DIGITS, 0));
    for (int dlc = 0; dlc < 16; dlc++) {
        SAME(FD_BYTES[dlc], igh_mcan_len_from_dlc((uint8_t)dlc, 1));
        SAME(dlc < 8 ? dlc : 8, igh_mcan_len_from_dlc((uint8_t)dlc, 0));
        SAME(dlc, igh_mcan_dlc_from_len((size_t)FD_BYTES[dlc], -1));
    }
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_len_from_dlc(16, 0));
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_len_from_dlc(255, 1));
    SAME(8, igh_mcan_dlc_from_len(8, 0));
    BAD(ECAN_ERR_FRAME, igh_mcan_dlc_from_len(9, 0));
    BAD(ECAN_ERR_FRAME, igh_mcan_dlc_from_len(9, 1));
    BAD(ECAN_ERR_FRAME, igh_mcan_dlc_from_len(65, 1));
    BAD(ECAN_ERR_FRAME, igh_mcan_dlc_from_len(SIZE_MAX, 1));

    for (uint32_t raw = 0; raw <= 0xFFFF; raw += 0x101) {
        fill_garbage(2, &status, sizeof(status));
        GOOD(igh_mcan_channel_status_decode((uint16_t)raw, &status));
        SAME(raw, status.raw);
        TRUE(status.rx_pending <= 7 && status.tx_pending <= 7);
        TRUE(status.fd_enabled <= 1 && status.warn <= 1 && status.bus_off <= 1);
        TRUE(status.rx_pressure <= 1 && status.tx_pressure <= 1);
        TRUE(status.detail_pending <= 1 && status.counter_saturated <= 1);
    }
    GOOD(igh_mcan_channel_status_decode(0, &status));
    SAME(IGH_MCAN_STATE_DISABLED, status.state);
    GOOD(igh_mcan_channel_status_decode(0x0002, &status));
    SAME(IGH_MCAN_STATE_RUN, status.state);
    SAME(0, status.fd_enabled);
    GOOD(igh_mcan_channel_status_decode(0xFFFF, &status));
    SAME(1, status.fd_enabled);
    SAME(1, status.bus_off);
    SAME(1, status.counter_saturated);
    SAME(7, status.rx_pending);
    SAME(7, status.tx_pending);
}

void test_pdo(void)
{
    frames();
    received_frames();
    profiles();
    writer();
    small_functions();
}
