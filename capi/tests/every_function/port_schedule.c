/* igh_mcan_port.h: frames at a phase of Sync0. */
#include "check.h"

static const uint8_t DATA[8] = {1, 2, 3, 4, 5, 6, 7, 8};

void test_port_schedule(void)
{
    static ecan_igh_config_t igh_config;
    static igh_mcan_port_config_t config;
    ecan_igh_context_t igh;
    igh_mcan_port_t port;
    igh_mcan_rx_frame_t rx[16];
    igh_mcan_tx_frame_t tx;
    size_t count;
    int echoes = 0;
    int sent = 0;

    simulate(&igh_config, "sim:echo");
    GOOD(ecan_igh_config_set_dc_sync0(&igh_config, 1000, 700));
    GOOD(ecan_igh_config_set_dc_assign_activate(&igh_config, 0x0300));
    GOOD(igh_mcan_port_default_config(&config));
    GOOD(igh_mcan_port_set_channel_mask(&config, 0, 0x03, 0x02));
    SAME(0, start_port(&igh, &port, &igh_config, &config));
    for (int cycle = 0; cycle < 200; cycle++) {
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
    BAD(ECAN_ERR_ORDER, igh_mcan_port_schedule_can(&port, 0, 0, 0x321, 0, DATA, 8, 1, 1));
    BAD(ECAN_ERR_ORDER, igh_mcan_port_schedule_canfd(&port, 0, 1, 0x321, 0, DATA, 8, 1, 1));
    GOOD(igh_mcan_port_deinit(&port));
    GOOD(ecan_igh_deinit(&igh));
}
