/* igh_mcan_port.h: the cycle, sending and receiving, faults of bus and gateway. */
#include "check.h"

static const uint8_t DATA[64] = {1, 2, 3, 4, 5, 6, 7, 8};

static void begin(igh_mcan_port_t *port)
{
    GOOD(igh_mcan_port_wait_next_cycle(port));
    GOOD(igh_mcan_port_cycle_begin(port));
}

static void rejected_sends(igh_mcan_port_t *port)
{
    static const struct {
        uint32_t can_id;
        uint8_t flags;
        size_t len;
    } NO_CLASSIC[] = {{0x800, 0, 8},
                      {0x20000000, IGH_MCAN_FLAG_EXT, 8},
                      {0x123, 0, 9},
                      {0x123, IGH_MCAN_FLAG_RTR, 9},
                      {0x123, IGH_MCAN_FLAG_BRS, 8},
                      {0x123, IGH_MCAN_FLAG_FD, 8},
                      {0x123, 0x40, 8}},
      NO_FD[] = {{0x800, 0, 8},
                 {0x20000000, IGH_MCAN_FLAG_EXT, 8},
                 {0x123, 0, 9},
                 {0x123, IGH_MCAN_FLAG_RTR, 8},
                 {0x123, 0x40, 8}};
    igh_mcan_tx_frame_t tx;
    size_t room;

    begin(port);
    room = igh_mcan_port_image_room(port, 0);
    TRUE(room > 0);
    for (size_t i = 0; i < ITEMS(NO_CLASSIC); i++) {
        BAD(ECAN_ERR_FRAME,
            igh_mcan_port_send_can(port, 0, 0, NO_CLASSIC[i].can_id, NO_CLASSIC[i].flags, DATA,
                                   NO_CLASSIC[i].len));
        BAD(ECAN_ERR_FRAME,
            igh_mcan_port_schedule_can(port, 0, 0, NO_CLASSIC[i].can_id, NO_CLASSIC[i].flags,
                                       DATA, NO_CLASSIC[i].len, 0, 0));
    }
    for (size_t i = 0; i < ITEMS(NO_FD); i++) {
        BAD(ECAN_ERR_FRAME, igh_mcan_port_send_canfd(port, 0, 1, NO_FD[i].can_id, NO_FD[i].flags,
                                                     DATA, NO_FD[i].len));
        BAD(ECAN_ERR_FRAME,
            igh_mcan_port_schedule_canfd(port, 0, 1, NO_FD[i].can_id, NO_FD[i].flags, DATA,
                                         NO_FD[i].len, 0, 0));
    }
    BAD(ECAN_ERR_SLAVE, igh_mcan_port_send_can(port, 1, 0, 0x123, 0, DATA, 8));
    BAD(ECAN_ERR_SLAVE, igh_mcan_port_send_can(port, SIZE_MAX, 0, 0x123, 0, DATA, 8));
    BAD(ECAN_ERR_SLAVE, igh_mcan_port_send_canfd(port, 65536, 1, 0x123, 0, DATA, 8));
    BAD(ECAN_ERR_CHANNEL, igh_mcan_port_send_can(port, 0, 2, 0x123, 0, DATA, 8));
    BAD(ECAN_ERR_CHANNEL, igh_mcan_port_send_can(port, 0, 4, 0x123, 0, DATA, 8));
    BAD(ECAN_ERR_CHANNEL, igh_mcan_port_send_canfd(port, 0, 255, 0x123, 0, DATA, 8));
    BAD(ECAN_ERR_NOT_FD, igh_mcan_port_send_canfd(port, 0, 0, 0x123, 0, DATA, 8));
    BAD(ECAN_ERR_SCHEDULE, igh_mcan_port_schedule_can(port, 0, 0, 0x123, 0, DATA, 8, 0, 0));
    BAD(ECAN_ERR_SCHEDULE, igh_mcan_port_schedule_canfd(port, 0, 1, 0x123, 0, DATA, 8, 0, 0));
    GOOD(igh_mcan_tx_frame_set_can(&tx, 0, 0, 0x123, 0, DATA, 8));
    tx.hint = 4;
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_port_send(port, &tx));
    tx.hint = 0;
    tx.len = 9;
    BAD(ECAN_ERR_FRAME, igh_mcan_port_send(port, &tx));
    tx.len = 8;
    tx.slave = 1;
    BAD(ECAN_ERR_SLAVE, igh_mcan_port_send(port, &tx));
    tx.slave = 0;
    tx.channel = 3;
    BAD(ECAN_ERR_CHANNEL, igh_mcan_port_send(port, &tx));
    tx.channel = 0;
    tx.scheduled = 1;
    BAD(ECAN_ERR_SCHEDULE, igh_mcan_port_send(port, &tx));
    SAME(room, igh_mcan_port_image_room(port, 0));
    GOOD(igh_mcan_port_cycle_end(port));

    /* Outside a cycle. */
    BAD(ECAN_ERR_ORDER, igh_mcan_port_send_can(port, 0, 0, 0x123, 0, DATA, 8));
    BAD(ECAN_ERR_ORDER, igh_mcan_port_send_canfd(port, 0, 1, 0x123, 0, DATA, 8));
    tx.scheduled = 0;
    BAD(ECAN_ERR_ORDER, igh_mcan_port_send(port, &tx));
}

/* Every frame returns from the echo node, and its TX_RESULT has the ticket of its send. */
static void results(igh_mcan_port_t *port)
{
    igh_mcan_ticket_t tickets[40];
    igh_mcan_rx_frame_t rx[64];
    int reported[40] = {0};
    int echoes = 0;
    int results = 0;
    size_t sent = 0;
    size_t count = 0;

    for (int cycle = 0; cycle < 80; cycle++) {
        begin(port);
        GOOD(igh_mcan_port_cycle_begin(port));
        GOOD(igh_mcan_port_receive(port, rx, 0, &count));
        SAME(0, count);
        GOOD(igh_mcan_port_receive(port, NULL, 0, &count));
        GOOD(igh_mcan_port_receive(port, rx, 1, &count));
        if (count == 1) {
            size_t more = 0;
            GOOD(igh_mcan_port_receive(port, rx + 1, ITEMS(rx) - 1, &more));
            count += more;
        }
        for (size_t i = 0; i < count; i++) {
            if (rx[i].kind == IGH_MCAN_RX_FRAME) {
                echoes += rx[i].can_id == 0x100 && rx[i].slave == 0;
                TRUE(rx[i].timestamp_format != IGH_MCAN_TIMESTAMP_NONE);
                continue;
            }
            SAME(IGH_MCAN_RX_TX_RESULT, rx[i].kind);
            SAME(1, rx[i].is_known);
            TRUE(rx[i].result == IGH_MCAN_TX_RESULT_OK ||
                 rx[i].result == IGH_MCAN_TX_RESULT_QUEUED);
            for (size_t ticket = 0; ticket < sent; ticket++) {
                if (tickets[ticket].sequence == rx[i].sequence &&
                    tickets[ticket].frame_index == rx[i].frame_index) {
                    SAME(ticket % 2, rx[i].channel);
                    reported[ticket]++;
                    results++;
                }
            }
        }
        for (int i = 0; i < 2 && sent < ITEMS(tickets); i++, sent++) {
            if (i == 0) {
                GOOD(igh_mcan_port_send_can(port, 0, 0, 0x100, 0, DATA, 8));
            } else {
                GOOD(igh_mcan_port_send_canfd(port, 0, 1, 0x100, IGH_MCAN_FLAG_BRS, DATA, 12));
            }
            fill_garbage(2, &tickets[sent], sizeof(tickets[sent]));
            GOOD(igh_mcan_port_get_last_ticket(port, &tickets[sent]));
            SAME(0, tickets[sent].slave);
            SAME(i, tickets[sent].frame_index);
        }
        GOOD(igh_mcan_port_cycle_end(port));
    }
    SAME(40, echoes);
    SAME(40, results);
    for (size_t i = 0; i < ITEMS(reported); i++) {
        SAME(1, reported[i]);
    }
}

static void remote_and_batch(igh_mcan_port_t *port)
{
    static igh_mcan_tx_frame_t frames[300];
    igh_mcan_rx_frame_t rx[255];
    igh_mcan_channel_statistics_t statistics;
    size_t sent = 99;
    size_t count = 0;
    size_t taken = 0;
    int code;

    begin(port);
    GOOD(igh_mcan_port_send_can(port, 0, 0, 0x55, IGH_MCAN_FLAG_RTR, NULL, 3));
    GOOD(igh_mcan_port_send_can(port, 0, 0, 0x55, 0, NULL, 0));
    GOOD(igh_mcan_port_send_batch(port, NULL, 0, &sent));
    SAME(0, sent);
    GOOD(igh_mcan_port_cycle_end(port));

    for (size_t i = 0; i < ITEMS(frames); i++) {
        GOOD(igh_mcan_tx_frame_set_can(&frames[i], 0, 0, 0x200, 0, DATA, 8));
        GOOD(igh_mcan_tx_frame_set_hint(&frames[i], (int)(i % 4)));
    }
    /* More than fits: it stops at the first rejected frame, and continues later. */
    begin(port);
    code = igh_mcan_port_send_batch(port, frames, ITEMS(frames), &sent);
    TRUE(code == ECAN_ERR_NO_ROOM || code == ECAN_ERR_QUEUE_FULL);
    SAME(code, ecan_last_error_code());
    TRUE(sent > 0 && sent < ITEMS(frames));
    taken = sent;
    GOOD(igh_mcan_port_cycle_end(port));
    for (int cycle = 0; cycle < 500 && taken < ITEMS(frames); cycle++) {
        begin(port);
        igh_mcan_port_send_batch(port, frames + taken, ITEMS(frames) - taken, &sent);
        taken += sent;
        GOOD(igh_mcan_port_cycle_end(port));
    }
    SAME(ITEMS(frames), taken);
    frames[1].channel = 3;
    for (int cycle = 0; cycle < 50; cycle++) {
        begin(port);
        GOOD(igh_mcan_port_cycle_end(port));
    }
    begin(port);
    BAD(ECAN_ERR_CHANNEL, igh_mcan_port_send_batch(port, frames, 3, &sent));
    SAME(1, sent);
    GOOD(igh_mcan_port_cycle_end(port));
    for (int cycle = 0; cycle < 20; cycle++) {
        GOOD(igh_mcan_port_wait_next_cycle(port));
        GOOD(igh_mcan_port_exchange(port, NULL, 0, rx, ITEMS(rx), &count));
    }
    GOOD(igh_mcan_port_wait_next_cycle(port));
    BAD(ECAN_ERR_CHANNEL, igh_mcan_port_exchange(port, frames, 2, rx, ITEMS(rx), &count));
    GOOD(igh_mcan_port_wait_next_cycle(port));
    GOOD(igh_mcan_port_exchange(port, frames, 1, NULL, 0, &count));
    for (int cycle = 0; cycle < 20; cycle++) {
        GOOD(igh_mcan_port_wait_next_cycle(port));
        GOOD(igh_mcan_port_exchange(port, NULL, 0, rx, ITEMS(rx), &count));
    }
    GOOD(igh_mcan_port_get_channel_statistics(port, 0, 0, &statistics));
    TRUE(statistics.frames_sent >= 300);
    SAME(statistics.frames_sent, statistics.frames_delivered);
    SAME(statistics.frames_sent, statistics.frames_accepted);
    SAME(0, statistics.frames_lost + statistics.frames_discarded + statistics.frames_unknown +
                statistics.frames_pending);
    TRUE(statistics.rejected_image_full + statistics.rejected_queue_full > 0);
    SAME(0, statistics.results_failed);
}

static void state(igh_mcan_port_t *port)
{
    igh_mcan_cycle_report_t report;
    igh_mcan_channel_status_t status;
    igh_mcan_statistics_t statistics;
    igh_mcan_pdo_parse_diag_t diag;

    begin(port);
    GOOD(igh_mcan_port_get_cycle_report(port, 0, &report));
    SAME(1, report.domain.is_complete);
    SAME(IGH_MCAN_IMAGE_NEW, report.image);
    SAME(0, report.is_unconfirmed);
    SAME(0, report.lost_images);
    GOOD(igh_mcan_port_get_channel_status(port, 0, 0, &status));
    SAME(IGH_MCAN_STATE_RUN, status.state);
    SAME(0, status.fd_enabled);
    GOOD(igh_mcan_port_get_channel_status(port, 0, 1, &status));
    SAME(1, status.fd_enabled);
    GOOD(igh_mcan_port_get_channel_status(port, 0, 3, &status));
    SAME(IGH_MCAN_STATE_DISABLED, status.state);
    GOOD(igh_mcan_port_get_parse_diag(port, 0, &diag));
    SAME(0, diag.error);
    GOOD(igh_mcan_port_send_can(port, 0, 0, 0x1, 0, DATA, 1));
    TRUE(igh_mcan_port_discard_pending(port, 0) >= 1);
    SAME(0, igh_mcan_port_discard_pending(port, 0));
    GOOD(igh_mcan_port_cycle_end(port));
    GOOD(igh_mcan_port_get_statistics(port, 0, &statistics));
    SAME(1, statistics.sessions);
    SAME(0, statistics.sessions_lost);
    SAME(0, statistics.parse_errors);
    SAME(0, statistics.unmatched_results);
    TRUE(statistics.cycles > 0 && statistics.txpdo_received > 0);
}

/* A scenario with faults: images with a wrong CRC, a bus-off channel, a failing library. The
 * code of a cycle is that of its text. */
static void faults(void)
{
    static ecan_igh_config_t igh_config;
    static igh_mcan_port_config_t config;
    ecan_igh_context_t igh;
    igh_mcan_port_t port;
    igh_mcan_pdo_parse_diag_t diag;
    igh_mcan_rx_frame_t rx[16];
    igh_mcan_tx_frame_t tx;
    char setting[512];
    char text[256];
    size_t count;
    int bus_off = 0;
    int failed_calls = 0;
    int same_words = 0;

    SAME(0, write_scenario("[[gateway]]\nbuses = [\"a\", \"b\", \"c\", \"d\"]\n"
                           "[[node]]\nkind = \"echo\"\nbus = \"a\"\n"
                           "[[fault]]\nat_ms = 4000\nkind = \"crc_error\"\n"
                           "gateway = 0\ntimes = 1\n"
                           "[[fault]]\nat_ms = 4200\nkind = \"bus_off\"\n"
                           "gateway = 0\nchannel = 0\n"
                           "[[fault]]\nat_ms = 4900\nkind = \"library_error\"\n"
                           "call = \"receive\"\nerrno = \"EIO\"\ntimes = 2\n",
                           setting, sizeof(setting)));
    simulate_channel(&igh_config, &config, setting, 500000);
    SAME(0, start_port(&igh, &port, &igh_config, &config));
    GOOD(igh_mcan_tx_frame_set_can(&tx, 0, 0, 0x123, 0, DATA, 8));
    for (int cycle = 0; cycle < 6000; cycle++) {
        int code;
        if (igh_mcan_port_wait_next_cycle(&port) != ECAN_OK) {
            break;
        }
        tx.channel = failed_calls == 0 ? 0 : 3;
        code = igh_mcan_port_exchange(&port, &tx, 1, rx, ITEMS(rx), &count);
        bus_off += code == ECAN_ERR_BUS_OFF;
        failed_calls += code == ECAN_ERR_MASTER;
        if (code == ECAN_ERR_MASTER) {
            same_words += ecan_last_error_code() == code;
        }
    }
    TRUE(bus_off > 0);
    SAME(2, failed_calls);
    SAME(2, same_words);
    GOOD(igh_mcan_port_get_parse_diag(&port, 0, &diag));
    SAME(IGH_MCAN_PDO_BAD_CRC, diag.error);
    TRUE(diag.payload_crc16 != diag.computed_crc16);
    GOOD(igh_mcan_pdo_diag_text(&diag, text, sizeof(text), NULL));
    TEXT_HAS("CRC", text);
    GOOD(igh_mcan_port_deinit(&port));
    GOOD(ecan_igh_deinit(&igh));
    remove_scenario(setting);
}

void test_port_cycle(void)
{
    static ecan_igh_config_t igh_config;
    static igh_mcan_port_config_t config;
    ecan_igh_context_t igh;
    igh_mcan_port_t port;

    simulate(&igh_config, "sim:echo");
    GOOD(ecan_igh_config_set_pdo_multiplier(&igh_config, 4));
    GOOD(igh_mcan_port_default_config(&config));
    GOOD(igh_mcan_port_set_channel_mask(&config, 0, 0x03, 0x02));
    GOOD(igh_mcan_port_set_classic_channel(&config, 0, 0, 1000000));
    GOOD(igh_mcan_port_set_options(&config, 0, IGH_MCAN_OPTION_TX_RESULT, 0));
    GOOD(igh_mcan_port_set_encapsulation(&config, 0, IGH_MCAN_ENCAPSULATION_COMPACT_TIMESTAMPED,
                                         0));
    SAME(0, start_port(&igh, &port, &igh_config, &config));
    rejected_sends(&port);
    results(&port);
    remote_and_batch(&port);
    state(&port);
    GOOD(igh_mcan_port_deinit(&port));
    GOOD(ecan_igh_deinit(&igh));
    faults();
}
