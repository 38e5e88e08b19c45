/* igh_mcan_port.h: gateways that run with a configuration file. */
#define _POSIX_C_SOURCE 200809L
#include "check.h"

#include <stdlib.h>

static const uint8_t DATA[64] = {1, 2, 3, 4, 5, 6, 7, 8};

/* The other nodes keep their bit rates, independently of the gateways. */
static const char SCENARIO[] = "[[gateway]]\n"
                               "[[gateway]]\n"
                               "[[gateway]]\n"
                               "[[node]]\n"
                               "kind = \"echo\"\n"
                               "bus = \"0.0\"\n"
                               "bitrate = 250000\n"
                               "[[node]]\n"
                               "kind = \"echo\"\n"
                               "bus = \"0.1\"\n"
                               "[[node]]\n"
                               "kind = \"echo\"\n"
                               "bus = \"2.3\"\n"
                               "bitrate = 125000\n";

/* Gateway 1 of the file is at position 2. */
static const char CELL[] = "cycle_us = 1000\n"
                           "dc = { shift_us = 700 }\n"
                           "[[gateway]]\n"
                           "n = 3\n"
                           "tx_pdo = { n = 4, profile = 1 }\n"
                           "data_path = { max_service_budget_us = 700 }\n"
                           "[gateway.can0]\n"
                           "bitrate = 250_000\n"
                           "non_match_standard = \"reject\"\n"
                           "data_path = { rx_drain_max = 5 }\n"
                           "[[gateway.can0.standard_filter]]\n"
                           "match = \"range\"\n"
                           "action = \"fifo0\"\n"
                           "id1 = 0x100\n"
                           "id2 = 0x1FF\n"
                           "[gateway.can1]\n"
                           "bitrate = 500_000\n"
                           "data_bitrate = 2_000_000\n"
                           "[[gateway]]\n"
                           "position = 2\n"
                           "n = 2\n"
                           "can3 = { bitrate = 125_000 }\n";

/* The same gateways, with nothing that accepts 0x100 to 0x1FF and another bit rate. */
static const char OTHER_CELL[] = "cycle_us = 1000\n"
                                 "[[gateway]]\n"
                                 "n = 3\n"
                                 "[gateway.can0]\n"
                                 "bitrate = 250_000\n"
                                 "[[gateway.can0.standard_filter]]\n"
                                 "match = \"range\"\n"
                                 "action = \"reject\"\n"
                                 "id1 = 0x100\n"
                                 "id2 = 0x1FF\n"
                                 "[[gateway]]\n"
                                 "position = 2\n"
                                 "n = 2\n"
                                 "can3 = { bitrate = 500_000 }\n";

static ecan_igh_config_t igh_config;
static igh_mcan_port_config_t config;

/* Expected echoes of the sent frames. */
struct echoes {
    unsigned inside, outside, fd, second, others, with_time;
};

/* Accepted and filtered frames on channel 0 of the first gateway, CAN FD on its channel 1, and
 * one frame on the second gateway; 10 each. */
static struct echoes exchange(igh_mcan_port_t *port, int has_fd)
{
    struct echoes echoes = {0};
    for (int cycle = 0; cycle < 100; cycle++) {
        igh_mcan_rx_frame_t rx[32];
        size_t count;
        GOOD(igh_mcan_port_wait_next_cycle(port));
        GOOD(igh_mcan_port_cycle_begin(port));
        GOOD(igh_mcan_port_receive(port, rx, ITEMS(rx), &count));
        for (size_t i = 0; i < count; i++) {
            unsigned index = rx[i].slave * 4u + rx[i].channel;
            echoes.inside += index == 0 && rx[i].can_id == 0x123;
            echoes.outside += index == 0 && rx[i].can_id == 0x323;
            echoes.fd += index == 1 && rx[i].can_id == 0x123 && rx[i].len == 64;
            echoes.second += index == 7 && rx[i].can_id == 0x123;
            echoes.others += index != 0 && index != 1 && index != 7;
            echoes.with_time += rx[i].timestamp_format != IGH_MCAN_TIMESTAMP_NONE;
        }
        if (cycle < 10) {
            GOOD(igh_mcan_port_send_can(port, 0, 0, 0x123, 0, DATA, 8));
            GOOD(igh_mcan_port_send_can(port, 0, 0, 0x323, 0, DATA, 8));
            GOOD(igh_mcan_port_send_can(port, 1, 3, 0x123, 0, DATA, 1));
            if (has_fd) {
                GOOD(igh_mcan_port_send_canfd(port, 0, 1, 0x123, IGH_MCAN_FLAG_BRS, DATA, 64));
            }
        }
        GOOD(igh_mcan_port_cycle_end(port));
    }
    return echoes;
}

static void object_is(ecan_igh_context_t *igh, size_t slave, uint16_t index, uint8_t subindex,
                      uint32_t expected)
{
    uint8_t data[4] = {0};
    size_t length;
    uint32_t value = 0;
    GOOD(ecan_igh_sdo_upload(igh, slave, index, subindex, data, sizeof(data), &length));
    for (size_t i = 0; i < length; i++) {
        value |= (uint32_t)data[i] << (8 * i);
    }
    SAME(expected, value);
}

static void content_of_the_file(void)
{
    uint8_t enabled, fd;
    uint16_t alias, position;
    uint32_t rx_n, tx_n, rate;
    size_t count;
    GOOD(ecan_igh_config_get_slave_count(&igh_config, &count));
    SAME(2, count);
    GOOD(ecan_igh_config_get_slave_position(&igh_config, 1, &alias, &position));
    SAME(2, position);
    GOOD(ecan_igh_config_get_slave_pdo_multipliers(&igh_config, 0, &rx_n, &tx_n));
    SAME(3, rx_n);
    SAME(4, tx_n);
    GOOD(igh_mcan_port_get_channel_mask(&config, 0, &enabled, &fd));
    SAME(0x03, enabled);
    SAME(0x02, fd);
    GOOD(igh_mcan_port_get_channel_mask(&config, 1, &enabled, &fd));
    SAME(0x08, enabled);
    SAME(0x00, fd);
    GOOD(igh_mcan_port_get_channel_object(&config, 0, 1, 20, &rate));
    SAME(2000000, rate);
}

/* Settings that only a file has reached the gateways. */
static void written_configuration(ecan_igh_context_t *igh)
{
    object_is(igh, 0, 0x8010, 3, 4);
    object_is(igh, 0, 0x8011, 3, 3);
    object_is(igh, 0, 0x8001, 19, 250000);
    object_is(igh, 0, 0x8001, 36, 2);
    object_is(igh, 0, 0x8002, 20, 2000000);
    object_is(igh, 0, 0x8020, 7, 700);
    object_is(igh, 0, 0x8021, 5, 5);
    object_is(igh, 1, 0x8004, 19, 125000);
    object_is(igh, 1, 0x8011, 3, 2);
}

/* A single call, with the library that the environment selects. */
static void opened_by_one_call(void)
{
    static const char SMALL[] = "[[gateway]]\ncan0 = { bitrate = 1_000_000 }\n";
    static const char TOGETHER[] = "clock = \"stepped\"\n"
                                   "[[gateway]]\n"
                                   "[[node]]\n"
                                   "kind = \"echo\"\n"
                                   "bus = \"0.0\"\n"
                                   "[[fault]]\n"
                                   "at_ms = 20000\n"
                                   "kind = \"link_loss\"\n"
                                   "gateway = 0\n"
                                   "for_ms = 300\n";
    ecan_igh_context_t igh;
    igh_mcan_port_t port;
    char setting[300];
    char path[300];
    char text[200];
    char lines[2][200] = {"", ""};
    size_t needed = 0;
    unsigned found = 0;
    int code;
    const char *former = getenv("ECAN_ECRT");
    char *kept = former == NULL ? NULL : strdup(former);

    SAME(0, write_scenario(TOGETHER, setting, sizeof(setting)));
    SAME(0, write_file(SMALL, path, sizeof(path)));
    SAME(0, setenv("ECAN_ECRT", setting, 1));
    BAD(ECAN_ERR_FILE, ecan_open(&igh, &port, "no_such.toml"));
    GOOD(ecan_open(&igh, &port, path));
    BAD(ECAN_ERR_ORDER, ecan_open(&igh, &port, path));
    SAME(1, igh_mcan_port_is_ready(&port));
    BAD(ECAN_ERR_NOT_READY, igh_mcan_port_check_delivery(&port));
    ERROR_HAS("no frame was delivered");
    while (found < 2 && ecan_igh_now_ns(&igh) < 60000000000ull) {
        GOOD(igh_mcan_port_wait_next_cycle(&port));
        GOOD(igh_mcan_port_cycle_begin(&port));
        if (found == 0) {
            code = igh_mcan_port_send_can(&port, 0, 0, 0x123, 0, DATA, 8);
            TRUE(code == ECAN_OK || ecan_result_is_temporary(code));
        }
        GOOD(igh_mcan_port_cycle_end(&port));
        GOOD(igh_mcan_port_next_change(&port, NULL, 0, &needed));
        GOOD(igh_mcan_port_next_change(&port, text, sizeof(text), NULL));
        SAME(strlen(text) + 1, needed);
        if (text[0] != '\0') {
            memcpy(lines[found++], text, sizeof(text));
        }
    }
    TEXT_HAS("slave 0: lost, waits for the network link", lines[0]);
    TEXT_HAS("slave 0: ready after ", lines[1]);
    GOOD(igh_mcan_port_check_delivery(&port));
    GOOD(ecan_igh_deinit(&igh));
    SAME(0, kept == NULL ? unsetenv("ECAN_ECRT") : setenv("ECAN_ECRT", kept, 1));
    free(kept);
    remove_file(path);
    remove_scenario(setting);
}

void test_config_file_run(void)
{
    ecan_igh_context_t igh;
    igh_mcan_port_t port;
    char setting[300];
    char path[300];
    struct echoes echoes;

    SAME(0, write_scenario(SCENARIO, setting, sizeof(setting)));
    SAME(0, write_file(CELL, path, sizeof(path)));
    simulate(&igh_config, setting);
    GOOD(igh_mcan_port_load_config(&igh_config, &config, path, NULL, 0, NULL));
    remove_file(path);
    content_of_the_file();

    GOOD(ecan_igh_init(&igh, &igh_config));
    GOOD(igh_mcan_port_init(&port, &igh, &config));
    GOOD(ecan_igh_wait_op_timeout(&igh, ecan_igh_startup_timeout_ms(&igh)));
    written_configuration(&igh);
    SAME(1, igh_mcan_port_is_ready(&port));
    echoes = exchange(&port, 1);
    SAME(10, echoes.inside);
    SAME(0, echoes.outside);
    SAME(10, echoes.fd);
    SAME(10, echoes.second);
    SAME(0, echoes.others);
    /* Profile 1 of the first gateway's TxPDO. */
    SAME(20, echoes.with_time);
    /* With Sync0, which the next file does not have. */
    GOOD(igh_mcan_port_wait_next_cycle(&port));
    GOOD(igh_mcan_port_cycle_begin(&port));
    GOOD(igh_mcan_port_schedule_can(&port, 0, 0, 0x123, 0, DATA, 8, 500000, 7));
    GOOD(igh_mcan_port_cycle_end(&port));

    /* Another file at run time: its filter rejects frames that the first accepted, and the node
     * of the second gateway has another bit rate. */
    SAME(0, write_file(OTHER_CELL, path, sizeof(path)));
    GOOD(igh_mcan_port_load_config(&igh_config, &config, path, NULL, 0, NULL));
    remove_file(path);
    GOOD(igh_mcan_port_reconfigure(&port, &igh_config, &config));
    GOOD(ecan_igh_wait_op_timeout(&igh, ecan_igh_startup_timeout_ms(&igh)));
    echoes = exchange(&port, 0);
    SAME(0, echoes.inside);
    SAME(10, echoes.outside);
    SAME(0, echoes.second);
    SAME(0, echoes.with_time);
    GOOD(igh_mcan_port_wait_next_cycle(&port));
    GOOD(igh_mcan_port_cycle_begin(&port));
    BAD(ECAN_ERR_SCHEDULE, igh_mcan_port_schedule_can(&port, 0, 0, 0x123, 0, DATA, 8, 500000, 7));
    GOOD(igh_mcan_port_cycle_end(&port));

    /* Changes after the load must be applied. */
    GOOD(ecan_igh_deinit(&igh));
    GOOD(igh_mcan_port_set_paced(&config, 0, 0));
    GOOD(ecan_igh_init(&igh, &igh_config));
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_init(&port, &igh, &config));
    ERROR_HAS("igh_mcan_port_apply_config");
    GOOD(ecan_igh_deinit(&igh));
    GOOD(igh_mcan_port_apply_config(&igh_config, &config));
    GOOD(ecan_igh_init(&igh, &igh_config));
    GOOD(igh_mcan_port_init(&port, &igh, &config));
    GOOD(ecan_igh_deinit(&igh));
    remove_scenario(setting);

    opened_by_one_call();
}
