/*
 * The manual's fragments of chapters 15.5.2 (steps 3 to 6), 15.4 and 15.5.3, unchanged, each in a
 * scope of its own: they compile, link and run, and the frames that they send return from the
 * echo node of the simulator.
 *
 *     ECAN_ECRT=sim ./manual_fragments
 */
#include <stdio.h>

#include "igh_mcan_port.h"

/* Cycles in which a frame must have returned. */
#define CYCLES 20

static int failed(const char *what)
{
    fprintf(stderr, "manual_fragments: %s: %s\n", what, ecan_last_error());
    return 1;
}

static int count_frames(const igh_mcan_rx_frame_t *rx, size_t rx_count, uint8_t last_byte)
{
    int count = 0;
    for (size_t i = 0; i < rx_count; i++) {
        if (rx[i].can_id == 0x123 && rx[i].len == 8 && rx[i].data[7] == last_byte) {
            count++;
        }
    }
    return count;
}

int main(void)
{
    int in_step_6 = 0;
    int in_exchange = 0;
    int in_raw_image = 0;

    /* 15.5.2, step 3 */
    ecan_igh_config_t igh_config;
    ecan_igh_default_config(&igh_config);
    ecan_igh_config_set_slave_count(&igh_config, 1);
    ecan_igh_config_set_cycle_us(&igh_config, 10000);
    ecan_igh_config_set_pdo_multiplier(&igh_config, 3); /* 3 * 128B */

    /* 15.5.2, step 4 */
    igh_mcan_port_config_t mcan_config;
    igh_mcan_port_default_config(&mcan_config);
    igh_mcan_port_set_channel_mask(&mcan_config, 0, 0x01, 0x00);
    igh_mcan_port_set_classic_channel(&mcan_config, 0, 0, 1000000);
    igh_mcan_port_apply_config(&igh_config, &mcan_config);

    /* 15.5.2, step 5 */
    ecan_igh_context_t igh;
    igh_mcan_port_t mcan;

    ecan_igh_init(&igh, &igh_config);
    igh_mcan_port_init(&mcan, &igh, &mcan_config);
    ecan_igh_wait_op_timeout(&igh, 10000);

    if (!igh_mcan_port_is_ready(&mcan)) {
        return failed("the gateway is not ready");
    }

    /* 15.5.2, step 6 */
    for (int cycle = 0; cycle < CYCLES; cycle++) {
        igh_mcan_port_wait_next_cycle(&mcan);
        {
            uint8_t data[8] = {0};
            igh_mcan_rx_frame_t rx[32];
            size_t rx_count = 0;

            igh_mcan_port_cycle_begin(&mcan);
            igh_mcan_port_receive(&mcan, rx, 32, &rx_count);
            igh_mcan_port_send_can(&mcan, 0, 0, 0x123, 0, data, sizeof(data));
            igh_mcan_port_cycle_end(&mcan);

            in_step_6 += count_frames(rx, rx_count, 0);
        }
    }

    /* 15.4 */
    for (int cycle = 0; cycle < CYCLES; cycle++) {
        igh_mcan_port_wait_next_cycle(&mcan);
        {
            igh_mcan_tx_frame_t tx;
            igh_mcan_rx_frame_t rx[32];
            size_t rx_count = 0;
            uint8_t data[8] = {0, 1, 2, 3, 4, 5, 6, 7};

            igh_mcan_tx_frame_set_can(&tx, 0, 0, 0x123, 0, data, sizeof(data));
            igh_mcan_port_exchange(&mcan, &tx, 1, rx, 32, &rx_count);

            in_exchange += count_frames(rx, rx_count, 7);
        }
    }

    /* 15.5.3, with the packaging that the manual recommends. The Port ends before: an image has
     * one writer. The writer continues its sequence numbers. */
    size_t slave_index = 0;
    igh_mcan_pdo_profile_t rx_profile;
    igh_mcan_pdo_profile_t tx_profile;
    igh_mcan_pdo_writer_t writer;
    igh_mcan_pdo_header_t header;
    igh_mcan_pdo_profile_default(&rx_profile, IGH_MCAN_RXPDO, 3, 0x01);
    igh_mcan_pdo_profile_default(&tx_profile, IGH_MCAN_TXPDO, 3, 0x01);
    igh_mcan_pdo_writer_init(&writer, &rx_profile);
    igh_mcan_port_deinit(&mcan);
    for (int cycle = 0; cycle < CYCLES; cycle++) {
        ecan_igh_wait_next_cycle(&igh);
        ecan_igh_receive(&igh);
        {
            uint8_t *rxpdo = NULL;
            const uint8_t *txpdo = NULL;
            size_t rxpdo_size = 0;
            size_t txpdo_size = 0;

            ecan_igh_get_rxpdo_buffer(&igh, slave_index, &rxpdo, &rxpdo_size);
            ecan_igh_get_txpdo_buffer(&igh, slave_index, &txpdo, &txpdo_size);

            igh_mcan_rx_frame_t rx[ECAN_PDO_MAX_PACKETS];
            size_t rx_count = 0;
            uint8_t data[8] = {0, 0, 0, 0, 0, 0, 0, 9};
            if (cycle == 0) {
                igh_mcan_pdo_parse_header(rxpdo, rxpdo_size, &header);
                igh_mcan_pdo_writer_set_next_sequence(&writer, (uint16_t)(header.seq_begin + 1));
            }
            igh_mcan_pdo_parse_frames_ex(&tx_profile, txpdo, txpdo_size, rx, ECAN_PDO_MAX_PACKETS,
                                         &rx_count, NULL);
            in_raw_image += count_frames(rx, rx_count, 9);
            igh_mcan_pdo_writer_begin(&writer, rxpdo, rxpdo_size);
            igh_mcan_pdo_writer_add_can(&writer, 0, 0x123, 0, data, sizeof(data));
            igh_mcan_pdo_writer_finish(&writer, NULL);
        }
        ecan_igh_send(&igh);
    }
    ecan_igh_deinit(&igh);

    printf("frames back: step 6 %d, exchange %d, raw image %d\n", in_step_6, in_exchange,
           in_raw_image);
    if (in_step_6 == 0 || in_exchange == 0 || in_raw_image == 0) {
        return failed("a fragment's frames did not come back");
    }
    return 0;
}
