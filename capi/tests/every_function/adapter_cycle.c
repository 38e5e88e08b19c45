/* igh_adapter.h: the cycle with raw process data. */
#include "check.h"

#define CYCLES 20000

static void count_echoes(ecan_igh_context_t *context, const igh_mcan_pdo_profile_t *rx_profile,
                         const igh_mcan_pdo_profile_t *tx_profile)
{
    static igh_mcan_rx_frame_t frames[ECAN_PDO_MAX_PACKETS];
    static const uint8_t DATA[8] = {1, 2, 3, 4, 5, 6, 7, 8};
    igh_mcan_pdo_writer_t writer;
    igh_mcan_pdo_sequence_t sequence;
    igh_mcan_pdo_header_t header;
    igh_mcan_channel_status_t status;
    unsigned echoes = 0;
    unsigned next = 0;
    int runs = 0;

    GOOD(igh_mcan_pdo_writer_init(&writer, rx_profile));
    GOOD(igh_mcan_pdo_sequence_init(&sequence));
    for (int cycle = 0; cycle < 100; cycle++) {
        uint8_t *rxpdo = NULL;
        const uint8_t *txpdo = NULL;
        size_t rx_bytes = 0;
        size_t tx_bytes = 0;
        size_t count = 0;
        GOOD(ecan_igh_wait_next_cycle(context));
        GOOD(ecan_igh_receive(context));
        SAME(1, ecan_igh_domain_is_complete(context));
        GOOD(ecan_igh_get_rxpdo_buffer(context, 0, &rxpdo, &rx_bytes));
        GOOD(ecan_igh_get_txpdo_buffer(context, 0, &txpdo, &tx_bytes));
        SAME(256, rx_bytes);
        SAME(512, tx_bytes);
        GOOD(igh_mcan_pdo_parse_header(txpdo, tx_bytes, &header));
        if (igh_mcan_pdo_sequence_observe(&sequence, header.seq_begin, NULL) ==
            IGH_MCAN_PDO_NEXT) {
            next++;
            GOOD(igh_mcan_pdo_parse_frames_ex(tx_profile, txpdo, tx_bytes, frames,
                                              ECAN_PDO_MAX_PACKETS, &count, NULL));
            for (size_t i = 0; i < count; i++) {
                echoes += frames[i].can_id == 0x321 && memcmp(frames[i].data, DATA, 8) == 0;
            }
        }
        GOOD(igh_mcan_channel_status_decode(header.channel_status[0], &status));
        runs = status.state == IGH_MCAN_STATE_RUN;
        GOOD(igh_mcan_pdo_writer_begin(&writer, rxpdo, rx_bytes));
        if (cycle < 80) {
            GOOD(igh_mcan_pdo_writer_add_can(&writer, 0, 0x321, 0, DATA, 8));
        }
        GOOD(igh_mcan_pdo_writer_finish(&writer, NULL));
        GOOD(ecan_igh_send(context));
    }
    TRUE(echoes >= 70 && echoes <= 80);
    TRUE(next >= 90);
    SAME(1, runs);
}

void test_adapter_cycle(void)
{
    static ecan_igh_config_t config;
    static igh_mcan_port_config_t port_config;
    igh_mcan_pdo_profile_t rx_profile;
    igh_mcan_pdo_profile_t tx_profile;
    ecan_igh_context_t context;
    ecan_igh_domain_report_t report;
    ecan_igh_slave_state_t state;
    uint64_t before;
    int cycle;

    simulate_channel(&config, &port_config, "sim:echo", 1000000);
    GOOD(ecan_igh_config_set_slave_pdo_multipliers(&config, 0, 2, 4));
    GOOD(igh_mcan_port_apply_config(&config, &port_config));
    GOOD(ecan_igh_init(&context, &config));
    GOOD(ecan_igh_activate(&context));
    BAD(ECAN_ERR_ORDER, ecan_igh_activate(&context));
    for (cycle = 0; cycle < CYCLES && !ecan_igh_is_operational(&context); cycle++) {
        if (ecan_igh_wait_next_cycle(&context) != ECAN_OK ||
            ecan_igh_receive(&context) != ECAN_OK || ecan_igh_send(&context) != ECAN_OK) {
            break;
        }
    }
    SAME(1, ecan_igh_is_operational(&context));
    before = ecan_igh_now_ns(&context);
    GOOD(ecan_igh_wait_next_cycle(&context));
    GOOD(ecan_igh_receive(&context));
    GOOD(ecan_igh_send(&context));
    GOOD(ecan_igh_wait_next_cycle(&context));
    TRUE(ecan_igh_now_ns(&context) - before >= 1000000);
    TRUE(ecan_igh_cycle_time_ns(&context) > before);
    TRUE(ecan_igh_response_ns(&context) > 60000 && ecan_igh_response_ns(&context) < 1000000);
    TRUE(ecan_igh_cycle_time_ns(&context) <= ecan_igh_now_ns(&context));
    GOOD(ecan_igh_receive(&context));
    GOOD(ecan_igh_get_domain_report(&context, 0, &report));
    SAME(1, report.is_complete);
    SAME(2, report.wc_state);
    SAME(report.expected_working_counter, report.working_counter);
    SAME(ECAN_IGH_DELIVERY_CONFIRMED, report.outputs);
    SAME(ECAN_IGH_DELIVERY_CONFIRMED, report.inputs);
    GOOD(ecan_igh_send(&context));
    GOOD(ecan_igh_get_slave_state(&context, 0, &state));
    SAME(1, state.operational);
    SAME(ECAN_IGH_AL_OP, state.al_state);

    GOOD(igh_mcan_pdo_profile_default(&rx_profile, IGH_MCAN_RXPDO, 2, 0x01));
    GOOD(igh_mcan_pdo_profile_default(&tx_profile, IGH_MCAN_TXPDO, 4, 0x01));
    count_echoes(&context, &rx_profile, &tx_profile);
    GOOD(ecan_igh_deinit(&context));
}
