/* igh_mcan_port.h: frames at a phase of Sync0. */
#include "check.h"

static const uint8_t DATA[8] = {1, 2, 3, 4, 5, 6, 7, 8};

/* A gateway whose frames count from the pulse before their image and are late: assumption H24. */
static const char LATE[] = "[[gateway]]\n"
                           "[gateway.variant]\n"
                           "scheduled_pulse = \"previous\"\n"
                           "[[node]]\n"
                           "kind = \"echo\"\n"
                           "bus = \"0.0\"\n";

static void late_frames(void)
{
    static ecan_igh_config_t igh_config;
    static igh_mcan_port_config_t config;
    ecan_igh_context_t igh;
    igh_mcan_port_t port;
    igh_mcan_schedule_account_t account;
    char setting[256];
    char text[400];
    size_t needed = 0;

    SAME(0, write_scenario(LATE, setting, sizeof(setting)));
    simulate(&igh_config, setting);
    GOOD(ecan_igh_config_set_dc_sync0(&igh_config, 1000, 700));
    GOOD(igh_mcan_port_default_config(&config));
    GOOD(igh_mcan_port_set_channel_mask(&config, 0, 0x01, 0x00));
    GOOD(igh_mcan_port_set_options(&config, 0, IGH_MCAN_OPTION_TX_RESULT, 0));
    SAME(0, start_port(&igh, &port, &igh_config, &config));
    SAME(IGH_MCAN_SCHEDULE_FAULT_NONE, igh_mcan_port_get_schedule_fault(&port, 0));
    for (int cycle = 0; cycle < 500; cycle++) {
        GOOD(igh_mcan_port_wait_next_cycle(&port));
        GOOD(igh_mcan_port_cycle_begin(&port));
        if (cycle < 50) {
            GOOD(igh_mcan_port_schedule_can(&port, 0, 0, 0x321, 0, DATA, 8, 100000, 7));
        }
        GOOD(igh_mcan_port_cycle_end(&port));
    }
    SAME(IGH_MCAN_SCHEDULE_FAULT_FLAGGED, igh_mcan_port_get_schedule_fault(&port, 0));
    GOOD(igh_mcan_port_get_schedule_fault_text(&port, 0, text, sizeof(text), &needed));
    TEXT_HAS("SCHED_LATE_DROP", text);
    SAME(strlen(text) + 1, needed);
    BAD(ECAN_ERR_BUFFER, igh_mcan_port_get_schedule_fault_text(&port, 0, text, 10, NULL));
    SAME(9, strlen(text));
    GOOD(igh_mcan_port_get_schedule_account(&port, 0, 0, &account));
    SAME(50, account.unknown);
    GOOD(igh_mcan_port_deinit(&port));
    GOOD(ecan_igh_deinit(&igh));
    remove_scenario(setting);
}

void test_port_schedule(void)
{
    static ecan_igh_config_t igh_config;
    static igh_mcan_port_config_t config;
    ecan_igh_context_t igh;
    igh_mcan_port_t port;
    igh_mcan_rx_frame_t rx[16];
    igh_mcan_tx_frame_t tx;
    igh_mcan_schedule_settings_t schedule;
    igh_mcan_schedule_margin_t margin;
    igh_mcan_schedule_account_t account;
    igh_mcan_schedule_diagnostics_t diagnostics;
    char text[400];
    size_t count;
    int echoes = 0;
    int sent = 0;

    simulate(&igh_config, "sim:echo");
    GOOD(ecan_igh_config_set_dc_sync0(&igh_config, 1000, 700));
    GOOD(ecan_igh_config_set_dc_assign_activate(&igh_config, 0x0300));
    GOOD(igh_mcan_port_default_config(&config));
    GOOD(igh_mcan_port_set_channel_mask(&config, 0, 0x03, 0x02));
    GOOD(igh_mcan_port_default_schedule(&schedule));
    schedule.watch_ms = 10;
    GOOD(igh_mcan_port_set_schedule(&config, 0, &schedule));
    GOOD(igh_mcan_port_set_options(&config, 0, IGH_MCAN_OPTION_TX_RESULT, 0));
    SAME(0, start_port(&igh, &port, &igh_config, &config));
    for (int cycle = 0; cycle < 500; cycle++) {
        GOOD(igh_mcan_port_wait_next_cycle(&port));
        GOOD(igh_mcan_port_cycle_begin(&port));
        GOOD(igh_mcan_port_receive(&port, rx, ITEMS(rx), &count));
        for (size_t i = 0; i < count; i++) {
            echoes += rx[i].can_id == 0x321;
        }
        if (cycle >= 100 && cycle < 150) {
            GOOD(igh_mcan_port_schedule_can(&port, 0, 0, 0x321, 0, DATA, 8, 500000, 7));
            GOOD(igh_mcan_port_schedule_canfd(&port, 0, 1, 0x321, IGH_MCAN_FLAG_BRS, DATA, 8,
                                              400000, 8));
            GOOD(igh_mcan_tx_frame_set_can(&tx, 0, 0, 0x321, 0, DATA, 8));
            GOOD(igh_mcan_tx_frame_set_schedule(&tx, 600000, 9));
            GOOD(igh_mcan_port_send(&port, &tx));
            sent += 3;
            BAD(ECAN_ERR_SCHEDULE,
                igh_mcan_port_schedule_can(&port, 0, 0, 0x321, 0, DATA, 8, 1000000, 7));
            BAD(ECAN_ERR_SCHEDULE,
                igh_mcan_port_schedule_can(&port, 0, 0, 0x321, 0, DATA, 8, UINT32_MAX, 7));
            BAD(ECAN_ERR_SCHEDULE,
                igh_mcan_port_schedule_canfd(&port, 0, 1, 0x321, 0, DATA, 8, 1000000, 7));
            tx.offset_ns = 1000001;
            BAD(ECAN_ERR_SCHEDULE, igh_mcan_port_send(&port, &tx));
            BAD(ECAN_ERR_NOT_FD,
                igh_mcan_port_schedule_canfd(&port, 0, 0, 0x321, 0, DATA, 8, 1, 1));
            BAD(ECAN_ERR_CHANNEL,
                igh_mcan_port_schedule_can(&port, 0, 2, 0x321, 0, DATA, 8, 1, 1));
            BAD(ECAN_ERR_SLAVE, igh_mcan_port_schedule_can(&port, 1, 0, 0x321, 0, DATA, 8, 1, 1));
        }
        GOOD(igh_mcan_port_cycle_end(&port));
    }
    SAME(150, sent);
    SAME(sent, echoes);
    GOOD(igh_mcan_port_get_schedule_account(&port, 0, 0, &account));
    SAME(100, account.scheduled);
    SAME(100, account.sent);
    SAME(0, account.open);
    GOOD(igh_mcan_port_get_schedule_account(&port, 0, 1, &account));
    SAME(50, account.sent);
    BAD(ECAN_ERR_CHANNEL, igh_mcan_port_get_schedule_account(&port, 0, 4, &account));
    BAD(ECAN_ERR_SLAVE, igh_mcan_port_get_schedule_account(&port, 1, 0, &account));
    GOOD(igh_mcan_port_get_schedule_diagnostics(&port, 0, &diagnostics));
    SAME(0, diagnostics.flags & (IGH_MCAN_SCHEDULE_LATE_DROP | IGH_MCAN_SCHEDULE_QUEUE_FULL |
                                 IGH_MCAN_SCHEDULE_TX_FAIL | IGH_MCAN_SCHEDULE_TIMER_MISS));
    TRUE(diagnostics.read_at_ns > 0 && diagnostics.sync0_count > 100);
    BAD(ECAN_ERR_SLAVE, igh_mcan_port_get_schedule_diagnostics(&port, 1, &diagnostics));
    SAME(IGH_MCAN_SCHEDULE_FAULT_NONE, igh_mcan_port_get_schedule_fault(&port, 0));
    GOOD(igh_mcan_port_get_schedule_fault_text(&port, 0, text, sizeof(text), NULL));
    SAME(0, text[0]);
    BAD(ECAN_ERR_SLAVE, igh_mcan_port_get_schedule_fault(&port, 1));
    BAD(ECAN_ERR_SLAVE, igh_mcan_port_get_schedule_fault_text(&port, 1, text, sizeof(text), NULL));
    GOOD(igh_mcan_port_clear_schedule_flags(&port, 0));
    BAD(ECAN_ERR_SLAVE, igh_mcan_port_clear_schedule_flags(&port, 1));
    GOOD(igh_mcan_port_get_schedule_margin(&port, 0, 100000, &margin));
    SAME(700000, margin.pulse_ns);
    SAME(800000, margin.release_ns);
    TRUE(margin.least_ns > 0 && margin.latest_arrival_ns < margin.pulse_ns);
    BAD(ECAN_ERR_SCHEDULE, igh_mcan_port_get_schedule_margin(&port, 0, 1000000, &margin));
    BAD(ECAN_ERR_SLAVE, igh_mcan_port_get_schedule_margin(&port, 1, 100000, &margin));
    BAD(ECAN_ERR_ORDER, igh_mcan_port_schedule_can(&port, 0, 0, 0x321, 0, DATA, 8, 1, 1));
    BAD(ECAN_ERR_ORDER, igh_mcan_port_schedule_canfd(&port, 0, 1, 0x321, 0, DATA, 8, 1, 1));
    GOOD(igh_mcan_port_deinit(&port));
    GOOD(ecan_igh_deinit(&igh));
    late_frames();
}
