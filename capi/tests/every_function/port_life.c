/* igh_mcan_port.h: life of Ports, and invalid calls. */
#include "check.h"

static const uint8_t DATA[64] = {1, 2, 3, 4, 5, 6, 7, 8};

static ecan_igh_config_t igh_config;
static igh_mcan_port_config_t config;

/* Every function of a Port rejects an invalid one. */
static void no_port(int code, igh_mcan_port_t *port)
{
    igh_mcan_rx_frame_t rx;
    igh_mcan_tx_frame_t tx;
    igh_mcan_ticket_t ticket;
    igh_mcan_cycle_report_t report;
    igh_mcan_pdo_parse_diag_t diag;
    igh_mcan_channel_status_t status;
    igh_mcan_statistics_t statistics;
    igh_mcan_schedule_margin_t margin;
    igh_mcan_schedule_account_t account;
    igh_mcan_schedule_diagnostics_t schedule;
    igh_mcan_channel_statistics_t channel_statistics;
    igh_mcan_capabilities_t capabilities;
    size_t count;

    GOOD(igh_mcan_tx_frame_set_can(&tx, 0, 0, 0x123, 0, DATA, 8));
    BAD(code, igh_mcan_port_reconfigure(port, &igh_config, &config));
    NONE(code, 0, igh_mcan_port_is_ready(port));
    BAD(code, igh_mcan_port_wait_next_cycle(port));
    BAD(code, igh_mcan_port_cycle_begin(port));
    BAD(code, igh_mcan_port_cycle_end(port));
    BAD(code, igh_mcan_port_receive(port, &rx, 1, &count));
    BAD(code, igh_mcan_port_send_can(port, 0, 0, 0x123, 0, DATA, 8));
    BAD(code, igh_mcan_port_send_canfd(port, 0, 0, 0x123, 0, DATA, 8));
    BAD(code, igh_mcan_port_schedule_can(port, 0, 0, 0x123, 0, DATA, 8, 0, 0));
    BAD(code, igh_mcan_port_schedule_canfd(port, 0, 0, 0x123, 0, DATA, 8, 0, 0));
    BAD(code, igh_mcan_port_send(port, &tx));
    BAD(code, igh_mcan_port_send_batch(port, &tx, 1, &count));
    BAD(code, igh_mcan_port_exchange(port, &tx, 1, &rx, 1, &count));
    BAD(code, igh_mcan_port_get_last_ticket(port, &ticket));
    NONE(code, 0, igh_mcan_port_image_room(port, 0));
    BAD(code, igh_mcan_port_discard_pending(port, 0));
    BAD(code, igh_mcan_port_serve(port, "every_function.sock", 0));
    BAD(code, igh_mcan_port_end_service(port));
    BAD(code, igh_mcan_port_get_session(port, 0));
    BAD(code, igh_mcan_port_get_session_text(port, 0, NULL, 0, NULL));
    BAD(code, igh_mcan_port_next_change(port, NULL, 0, NULL));
    BAD(code, igh_mcan_port_check_delivery(port));
    BAD(code, igh_mcan_port_get_cycle_report(port, 0, &report));
    BAD(code, igh_mcan_port_get_parse_diag(port, 0, &diag));
    BAD(code, igh_mcan_port_get_channel_status(port, 0, 0, &status));
    BAD(code, igh_mcan_port_get_statistics(port, 0, &statistics));
    BAD(code, igh_mcan_port_get_channel_statistics(port, 0, 0, &channel_statistics));
    BAD(code, igh_mcan_port_get_schedule_margin(port, 0, 0, &margin));
    BAD(code, igh_mcan_port_get_schedule_account(port, 0, 0, &account));
    BAD(code, igh_mcan_port_get_schedule_diagnostics(port, 0, &schedule));
    BAD(code, igh_mcan_port_get_schedule_fault(port, 0));
    BAD(code, igh_mcan_port_get_schedule_fault_text(port, 0, NULL, 0, NULL));
    BAD(code, igh_mcan_port_clear_schedule_flags(port, 0));
    BAD(code, igh_mcan_port_get_capabilities(port, 0, &capabilities));
    if (port == NULL) {
        BAD(code, igh_mcan_port_deinit(port));
    } else {
        GOOD(igh_mcan_port_deinit(port));
    }
}

/* Data without a length of their own: null_pointers.c has all other pointers. */
static void null_data(igh_mcan_port_t *port)
{
    BAD(ECAN_ERR_NULL, igh_mcan_port_send_can(port, 0, 0, 0x123, 0, NULL, 8));
    BAD(ECAN_ERR_NULL, igh_mcan_port_schedule_can(port, 0, 0, 0x123, 0, NULL, 8, 0, 0));
}

static void wrong_indices(igh_mcan_port_t *port, size_t slave)
{
    char text[64];
    igh_mcan_cycle_report_t report;
    igh_mcan_pdo_parse_diag_t diag;
    igh_mcan_channel_status_t status;
    igh_mcan_statistics_t statistics;
    igh_mcan_channel_statistics_t channel_statistics;
    igh_mcan_capabilities_t capabilities;

    BAD(ECAN_ERR_SLAVE, igh_mcan_port_get_session(port, slave));
    memset(text, 'x', sizeof(text));
    BAD(ECAN_ERR_SLAVE, igh_mcan_port_get_session_text(port, slave, text, sizeof(text), NULL));
    SAME(0, text[0]);
    BAD(ECAN_ERR_SLAVE, igh_mcan_port_get_cycle_report(port, slave, &report));
    BAD(ECAN_ERR_SLAVE, igh_mcan_port_get_parse_diag(port, slave, &diag));
    BAD(ECAN_ERR_SLAVE, igh_mcan_port_get_channel_status(port, slave, 0, &status));
    BAD(ECAN_ERR_SLAVE, igh_mcan_port_get_statistics(port, slave, &statistics));
    BAD(ECAN_ERR_SLAVE,
        igh_mcan_port_get_channel_statistics(port, slave, 0, &channel_statistics));
    BAD(ECAN_ERR_SLAVE, igh_mcan_port_get_capabilities(port, slave, &capabilities));
    SAME(0, igh_mcan_port_image_room(port, slave));
    BAD(ECAN_ERR_SLAVE, igh_mcan_port_discard_pending(port, slave));
    BAD(ECAN_ERR_CHANNEL, igh_mcan_port_get_channel_status(port, 0, 4, &status));
    BAD(ECAN_ERR_CHANNEL, igh_mcan_port_get_channel_statistics(port, 0, 4, &channel_statistics));
    BAD(ECAN_ERR_CHANNEL,
        igh_mcan_port_get_channel_statistics(port, 0, 255, &channel_statistics));
}

static void before_it_is_active(igh_mcan_port_t *port)
{
    char text[64];
    igh_mcan_capabilities_t capabilities;
    igh_mcan_channel_status_t status;
    igh_mcan_rx_frame_t rx;
    igh_mcan_tx_frame_t tx;
    igh_mcan_ticket_t ticket;
    size_t count = 99;

    SAME(0, igh_mcan_port_is_ready(port));
    SAME(IGH_MCAN_SESSION_WAITING, igh_mcan_port_get_session(port, 0));
    GOOD(igh_mcan_port_get_session_text(port, 0, text, sizeof(text), NULL));
    GOOD(igh_mcan_port_get_session_text(port, 0, NULL, 0, &count));
    SAME(strlen(text) + 1, count);
    TRUE(count > 1);
    BAD(ECAN_ERR_BUFFER, igh_mcan_port_get_session_text(port, 0, text, count - 1, NULL));
    SAME(count - 2, strlen(text));
    GOOD(igh_mcan_port_get_capabilities(port, 0, &capabilities));
    SAME(4, capabilities.channel_count);
    SAME(1, capabilities.multiplier_min);
    SAME(24, capabilities.multiplier_max);
    SAME(3072, capabilities.max_pdo_bytes);
    GOOD(igh_mcan_port_get_channel_status(port, 0, 3, &status));
    SAME(0, status.raw);
    GOOD(igh_mcan_tx_frame_set_can(&tx, 0, 0, 0x123, 0, DATA, 8));
    BAD(ECAN_ERR_ORDER, igh_mcan_port_cycle_begin(port));
    BAD(ECAN_ERR_ORDER, igh_mcan_port_cycle_end(port));
    BAD(ECAN_ERR_ORDER, igh_mcan_port_send(port, &tx));
    BAD(ECAN_ERR_ORDER, igh_mcan_port_send_can(port, 0, 0, 0x123, 0, DATA, 8));
    BAD(ECAN_ERR_ORDER, igh_mcan_port_exchange(port, &tx, 1, &rx, 1, &count));
    SAME(0, count);
    tx.channel = 9;
    BAD(ECAN_ERR_ORDER, igh_mcan_port_exchange(port, &tx, 1, &rx, 1, &count));
    BAD(ECAN_ERR_ORDER, igh_mcan_port_get_last_ticket(port, &ticket));
}

static void rejected_starts(void)
{
    static igh_mcan_port_config_t other;
    static ecan_igh_config_t plain;
    ecan_igh_context_t igh;
    igh_mcan_port_t port;
    igh_mcan_port_t second;

    memset(&igh, 0, sizeof(igh));
    BAD(ECAN_ERR_NOT_INITIALISED, igh_mcan_port_init(&port, &igh, &config));
    GOOD(ecan_igh_init(&igh, &igh_config));
    memset(&other, 0xA5, sizeof(other));
    BAD(ECAN_ERR_NOT_INITIALISED, igh_mcan_port_init(&port, &igh, &other));
    GOOD(igh_mcan_port_default_config(&other));
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_init(&port, &igh, &other));
    GOOD(igh_mcan_port_set_classic_channel(&other, 0, 0, 250000));
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_init(&port, &igh, &other));
    ERROR_HAS("igh_mcan_port_apply_config");
    GOOD(igh_mcan_port_init(&port, &igh, &config));
    BAD(ECAN_ERR_ORDER, igh_mcan_port_init(&port, &igh, &config));
    BAD(ECAN_ERR_ORDER, igh_mcan_port_init(&second, &igh, &config));
    BAD(ECAN_ERR_ORDER, ecan_igh_reconfigure(&igh, &igh_config));

    /* A closed Port may be opened again, at the same address or another. */
    GOOD(igh_mcan_port_deinit(&port));
    GOOD(igh_mcan_port_deinit(&port));
    no_port(ECAN_ERR_NOT_INITIALISED, &port);
    GOOD(igh_mcan_port_init(&port, &igh, &config));
    GOOD(igh_mcan_port_deinit(&port));
    GOOD(igh_mcan_port_init(&second, &igh, &config));
    no_port(ECAN_ERR_NOT_INITIALISED, &port);
    GOOD(igh_mcan_port_deinit(&second));

    /* Not on an active bus. */
    GOOD(ecan_igh_activate(&igh));
    BAD(ECAN_ERR_ORDER, igh_mcan_port_init(&second, &igh, &config));
    GOOD(ecan_igh_deinit(&igh));
    BAD(ECAN_ERR_NOT_INITIALISED, igh_mcan_port_init(&second, &igh, &config));

    /* Without apply the gateway keeps its last configuration, here none. */
    simulate(&plain, "sim:echo");
    GOOD(ecan_igh_init(&igh, &plain));
    if (igh_mcan_port_init(&port, &igh, &config) == ECAN_OK) {
        BAD(ECAN_ERR_NOT_OPERATIONAL, ecan_igh_wait_op_timeout(&igh, 3000));
    }
    GOOD(ecan_igh_deinit(&igh));
}

static void invalid_ports(void)
{
    ecan_igh_context_t igh;
    igh_mcan_port_t port;
    igh_mcan_port_t copy;

    for (int kind = 0; kind < GARBAGE_KINDS; kind++) {
        check_about(fill_garbage(kind, &port, sizeof(port)));
        no_port(ECAN_ERR_NOT_INITIALISED, &port);
        GOOD(ecan_igh_init(&igh, &igh_config));
        GOOD(igh_mcan_port_init(&port, &igh, &config));
        check_about("a copy");
        copy = port;
        no_port(ECAN_ERR_NOT_INITIALISED, &copy);
        SAME(0, igh_mcan_port_is_ready(&port));
        check_about("a context");
        no_port(ECAN_ERR_NOT_INITIALISED, (igh_mcan_port_t *)(void *)&igh);
        check_about("a Port whose master has ended");
        GOOD(ecan_igh_deinit(&igh));
        no_port(ECAN_ERR_NOT_INITIALISED, &port);
    }
    check_about(NULL);
}

static void at_run_time(void)
{
    static ecan_igh_config_t larger;
    static ecan_igh_config_t faulty;
    static igh_mcan_port_config_t fd;
    ecan_igh_context_t igh;
    igh_mcan_port_t port;
    igh_cia402_axis_t axis;
    igh_cia402_context_t axes;
    igh_mcan_statistics_t statistics;
    igh_mcan_rx_frame_t rx[8];
    uint8_t *rxpdo;
    size_t count = 0;
    size_t size = 0;
    int echoes = 0;

    GOOD(ecan_igh_init(&igh, &igh_config));
    GOOD(igh_mcan_port_init(&port, &igh, &config));
    before_it_is_active(&port);
    null_data(&port);
    wrong_indices(&port, 1);
    wrong_indices(&port, SIZE_MAX);
    GOOD(ecan_igh_wait_op_timeout(&igh, 20000));
    GOOD(ecan_igh_wait_op_timeout(&igh, 20000));
    SAME(1, igh_mcan_port_is_ready(&port));
    SAME(IGH_MCAN_SESSION_READY, igh_mcan_port_get_session(&port, 0));
    BAD(ECAN_ERR_ORDER, ecan_igh_receive(&igh));
    BAD(ECAN_ERR_ORDER, ecan_igh_send(&igh));
    null_data(&port);
    wrong_indices(&port, 1);

    /* N of 3 to 8 and classic CAN to CAN FD; a fault changes nothing. */
    simulate(&larger, "sim:echo");
    GOOD(ecan_igh_config_set_pdo_multiplier(&larger, 8));
    faulty = larger;
    GOOD(ecan_igh_config_set_pdo_multiplier(&faulty, 12));
    GOOD(igh_mcan_port_default_config(&fd));
    GOOD(igh_cia402_axis_init(&axis, 0, 0, 1, 0));
    GOOD(igh_cia402_context_init(&axes, &port, &axis, 1));
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_reconfigure(&port, &larger, &fd));
    SAME(1, igh_cia402_axis_count(&axes));
    GOOD(igh_mcan_port_set_canfd_channel(&fd, 0, 0, 1000000, 5000000));
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_reconfigure(&port, &faulty, &fd));
    SAME(1, igh_cia402_axis_count(&axes));
    SAME(1, igh_mcan_port_is_ready(&port));
    GOOD(igh_mcan_port_reconfigure(&port, &larger, &fd));
    NONE(ECAN_ERR_NOT_INITIALISED, 0, igh_cia402_axis_count(&axes));
    SAME(0, igh_mcan_port_is_ready(&port));
    GOOD(ecan_igh_wait_op_timeout(&igh, 20000));
    SAME(1, igh_mcan_port_is_ready(&port));
    GOOD(ecan_igh_get_rxpdo_buffer(&igh, 0, &rxpdo, &size));
    SAME(1024, size);
    for (int cycle = 0; cycle < 60; cycle++) {
        GOOD(igh_mcan_port_wait_next_cycle(&port));
        GOOD(igh_mcan_port_cycle_begin(&port));
        GOOD(igh_mcan_port_receive(&port, rx, ITEMS(rx), &count));
        for (size_t i = 0; i < count; i++) {
            echoes += rx[i].len == 64 && (rx[i].flags & IGH_MCAN_FLAG_FD) != 0 &&
                      memcmp(rx[i].data, DATA, 64) == 0;
        }
        if (cycle < 20) {
            GOOD(igh_mcan_port_send_canfd(&port, 0, 0, 0x123, IGH_MCAN_FLAG_BRS, DATA, 64));
        }
        GOOD(igh_mcan_port_cycle_end(&port));
    }
    SAME(20, echoes);
    GOOD(igh_mcan_port_get_statistics(&port, 0, &statistics));
    SAME(1, statistics.sessions);

    /* The master ends before the Port. */
    GOOD(ecan_igh_deinit(&igh));
    no_port(ECAN_ERR_NOT_INITIALISED, &port);
}

void test_port_life(void)
{
    simulate_channel(&igh_config, &config, "sim:echo", 500000);
    GOOD(igh_mcan_port_apply_config(&igh_config, &config));
    rejected_starts();
    invalid_ports();
    at_run_time();
}
