/* Reserved fields: 0 in every struct that the library fills, checked in every one that the
 * application fills. */
#include "check.h"

/* Calls a getter on a struct of other content; its reserved field gets 0. */
#define CLEARED(value, call)                                                                       \
    do {                                                                                           \
        memset(&(value), 0xA5, sizeof(value));                                                     \
        check_about(#value);                                                                       \
        GOOD(call);                                                                                \
        SAME(0, first_set((value).reserved, sizeof((value).reserved)));                            \
        check_about(NULL);                                                                         \
    } while (0)

/* Position of the first byte that is not 0, from 1; 0 for none. */
static size_t first_set(const void *bytes, size_t size)
{
    const uint8_t *byte = bytes;
    for (size_t i = 0; i < size; i++) {
        if (byte[i] != 0) {
            return i + 1;
        }
    }
    return 0;
}

static void filled_by_the_adapter(ecan_igh_context_t *igh)
{
    ecan_igh_diagnostics_t diagnostics;
    ecan_igh_domain_report_t domain;
    ecan_igh_slave_state_t slave;
    ecan_igh_master_state_t master;
    ecan_igh_slave_info_t info;
    ecan_igh_clock_status_t clocks;
    ecan_igh_cycle_start_t start;
    ecan_igh_cycle_statistics_t cycles;

    CLEARED(domain, ecan_igh_get_domain_report(igh, 0, &domain));
    CLEARED(slave, ecan_igh_get_slave_state(igh, 0, &slave));
    CLEARED(master, ecan_igh_get_master_state(igh, &master));
    CLEARED(info, ecan_igh_get_slave_info(igh, 0, &info));
    SAME(0, first_set(info.padding, sizeof(info.padding)));
    CLEARED(clocks, ecan_igh_get_clock_status(igh, &clocks));
    SAME(0, clocks.padding);
    CLEARED(start, ecan_igh_get_cycle_start(igh, &start));
    GOOD(ecan_igh_measure_cycles(igh));
    CLEARED(cycles, ecan_igh_get_cycle_statistics(igh, &cycles));
    SAME(0, first_set(cycles.period.reserved, sizeof(cycles.period.reserved)));
    GOOD(ecan_igh_diagnostics_open(&diagnostics, igh));
    CLEARED(master, ecan_igh_diagnostics_master_state(&diagnostics, &master));
    GOOD(ecan_igh_diagnostics_deinit(&diagnostics));
}

static void filled_by_the_port(igh_mcan_port_t *port)
{
    const uint8_t data[1] = {0};
    igh_mcan_statistics_t statistics;
    igh_mcan_channel_statistics_t channel;
    igh_mcan_capabilities_t capabilities;
    igh_mcan_channel_status_t status;
    igh_mcan_cycle_report_t report;
    igh_mcan_pdo_parse_diag_t diag;
    igh_mcan_ticket_t ticket;
    igh_mcan_schedule_margin_t margin;
    igh_mcan_schedule_account_t account;
    igh_mcan_schedule_diagnostics_t diagnostics;

    for (int cycle = 0; cycle < 200; cycle++) {
        GOOD(igh_mcan_port_wait_next_cycle(port));
        GOOD(igh_mcan_port_cycle_begin(port));
        GOOD(igh_mcan_port_schedule_can(port, 0, 0, 0x7F0, 0, data, 1, 500000, 1));
        GOOD(igh_mcan_port_cycle_end(port));
    }
    CLEARED(statistics, igh_mcan_port_get_statistics(port, 0, &statistics));
    CLEARED(channel, igh_mcan_port_get_channel_statistics(port, 0, 0, &channel));
    CLEARED(capabilities, igh_mcan_port_get_capabilities(port, 0, &capabilities));
    CLEARED(status, igh_mcan_port_get_channel_status(port, 0, 0, &status));
    CLEARED(report, igh_mcan_port_get_cycle_report(port, 0, &report));
    CLEARED(diag, igh_mcan_port_get_parse_diag(port, 0, &diag));
    CLEARED(ticket, igh_mcan_port_get_last_ticket(port, &ticket));
    CLEARED(margin, igh_mcan_port_get_schedule_margin(port, 0, 500000, &margin));
    CLEARED(account, igh_mcan_port_get_schedule_account(port, 0, 0, &account));
    CLEARED(diagnostics, igh_mcan_port_get_schedule_diagnostics(port, 0, &diagnostics));
    SAME(0, first_set(diagnostics.channels[0].reserved, sizeof(diagnostics.channels[0].reserved)));
}

static void filled_by_the_axes(igh_cia402_context_t *motors)
{
    igh_cia402_axis_state_t state;
    igh_cia402_axis_statistics_t statistics;
    igh_cia402_host_loss_info_t loss;
    igh_cia402_send_summary_t summary;
    igh_cia402_bus_load_t load;
    igh_canopen_node_state_t node;
    igh_canopen_boot_progress_t boot;
    size_t count;

    CLEARED(node, igh_canopen_get_node_state(motors, 0, &node));
    CLEARED(boot, igh_canopen_get_boot_progress(motors, 0, &boot));
    CLEARED(state, igh_cia402_get_axis_state(motors, 0, &state));
    CLEARED(statistics, igh_cia402_get_axis_statistics(motors, 0, &statistics));
    SAME(0, statistics.padding);
    CLEARED(loss, igh_cia402_get_host_loss(motors, 0, &loss));
    CLEARED(summary, igh_cia402_get_send_summary(motors, &summary));
    CLEARED(load, igh_cia402_get_bus_load(motors, &load, 1, &count));
    SAME(1, count);
}

static void filled_without_a_bus(void)
{
    static ecan_igh_config_t igh_config;
    static igh_mcan_port_config_t config;
    static uint8_t image[128] = {0x80};
    igh_mcan_pdo_profile_t profile;
    igh_mcan_channel_status_t status;
    igh_mcan_pdo_parse_diag_t diag;
    igh_mcan_file_fault_t fault;
    igh_mcan_rx_frame_t rx;
    igh_canopen_lss_command_t lss;
    igh_canopen_mpdo_t mpdo;
    size_t count;

    CLEARED(lss, igh_canopen_lss_init(&lss, IGH_CANOPEN_LSS_STORE));
    CLEARED(mpdo, igh_canopen_mpdo_decode(&mpdo, image, IGH_CANOPEN_MPDO_BYTES));
    CLEARED(status, igh_mcan_channel_status_decode(0xFFFF, &status));
    GOOD(ecan_igh_default_config(&igh_config));
    GOOD(igh_mcan_port_default_config(&config));
    memset(&fault, 0xA5, sizeof(fault));
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_parse_config(&igh_config, &config, "[", &fault, 1, &count));
    SAME(0, first_set(fault.reserved, sizeof(fault.reserved)));
    GOOD(igh_mcan_pdo_profile_default(&profile, IGH_MCAN_TXPDO, 1, 1));
    memset(&diag, 0xA5, sizeof(diag));
    BAD(ECAN_ERR_PARSE,
        igh_mcan_pdo_parse_frames_ex(&profile, image, sizeof(image), &rx, 1, &count, &diag));
    SAME(0, first_set(diag.reserved, sizeof(diag.reserved)));
}

/* Sets the last byte of a reserved field and calls a function, which rejects it. */
#define REJECTED(code, value, field, call)                                                         \
    do {                                                                                           \
        uint8_t *last_byte = (uint8_t *)&(value).field + sizeof((value).field) - 1;                \
        check_about(#value "." #field);                                                            \
        *last_byte = 1;                                                                            \
        BAD(code, call);                                                                           \
        *last_byte = 0;                                                                            \
        check_about(NULL);                                                                         \
    } while (0)

static void filled_by_the_application(void)
{
    static ecan_igh_config_t igh_config;
    static igh_mcan_port_config_t config;
    const uint8_t data[1] = {0};
    char text[256];
    igh_mcan_pdo_profile_t profile;
    igh_mcan_pdo_parse_diag_t diag;
    igh_mcan_frame_stream_t stream;
    igh_mcan_schedule_settings_t schedule;
    ecan_igh_real_time_t real_time;
    igh_canopen_mpdo_t mpdo;
    uint8_t mpdo_bytes[IGH_CANOPEN_MPDO_BYTES];

    GOOD(igh_mcan_pdo_profile_default(&profile, IGH_MCAN_TXPDO, 1, 1));
    REJECTED(ECAN_ERR_ARGUMENT, profile, reserved, igh_mcan_pdo_profile_check(&profile));
    GOOD(igh_mcan_pdo_profile_check(&profile));
    memset(&diag, 0, sizeof(diag));
    diag.error = IGH_MCAN_PDO_BAD_CRC;
    REJECTED(ECAN_ERR_ARGUMENT, diag, reserved,
             igh_mcan_pdo_diag_text(&diag, text, sizeof(text), NULL));
    GOOD(igh_mcan_pdo_diag_text(&diag, text, sizeof(text), NULL));

    GOOD(ecan_igh_default_config(&igh_config));
    GOOD(igh_mcan_port_default_config(&config));
    GOOD(igh_mcan_port_set_classic_channel(&config, 0, 0, 500000));
    GOOD(igh_mcan_port_default_schedule(&schedule));
    REJECTED(ECAN_ERR_ARGUMENT, schedule, reserved,
             igh_mcan_port_set_schedule(&config, 0, &schedule));
    GOOD(igh_mcan_port_set_schedule(&config, 0, &schedule));
    memset(&stream, 0, sizeof(stream));
    GOOD(igh_mcan_tx_frame_set_can(&stream.frame, 0, 0, 0x123, 0, data, 1));
#define STREAM igh_mcan_port_plan(&igh_config, &config, &stream, 1, NULL, 0, NULL)
    REJECTED(ECAN_ERR_ARGUMENT, stream, reserved, STREAM);
    REJECTED(ECAN_ERR_ARGUMENT, stream, frame.reserved, STREAM);
    REJECTED(ECAN_ERR_ARGUMENT, stream, frame.reserved2, STREAM);
    REJECTED(ECAN_ERR_ARGUMENT, stream, frame.reserved3, STREAM);
    GOOD(STREAM);
    memset(&mpdo, 0, sizeof(mpdo));
    REJECTED(ECAN_ERR_ARGUMENT, mpdo, reserved, igh_canopen_mpdo_encode(&mpdo, mpdo_bytes));
    GOOD(igh_canopen_mpdo_encode(&mpdo, mpdo_bytes));
    GOOD(ecan_igh_default_real_time(&real_time));
    REJECTED(ECAN_ERR_ARGUMENT, real_time, padding,
             ecan_igh_apply_real_time(&real_time, NULL, 0, NULL));
    REJECTED(ECAN_ERR_ARGUMENT, real_time, reserved,
             ecan_igh_apply_real_time(&real_time, NULL, 0, NULL));
}

static void filled_for_the_axes(igh_mcan_port_t *port, igh_cia402_context_t *motors)
{
    igh_cia402_context_t other;
    igh_cia402_axis_t axis;
    igh_cia402_settings_t settings;
    igh_cia402_homing_t homing;
    igh_canopen_lss_command_t lss;

    GOOD(igh_canopen_lss_init(&lss, IGH_CANOPEN_LSS_STORE));
    REJECTED(ECAN_ERR_ARGUMENT, lss, reserved, igh_canopen_lss(port, 0, 0, &lss, NULL, 100));
    REJECTED(ECAN_ERR_ARGUMENT, lss, reserved, igh_canopen_lss_start(motors, 0, 0, &lss));
    GOOD(igh_cia402_homing_init(&homing, 35));
    REJECTED(ECAN_ERR_ARGUMENT, homing, reserved, igh_cia402_home(motors, 0, &homing));
    GOOD(igh_cia402_context_deinit(motors));
    memset(&other, 0, sizeof(other));
    GOOD(igh_cia402_axis_init(&axis, 0, 0, 1, 0));
    GOOD(igh_cia402_default_settings(&settings));
#define CONTEXT igh_cia402_context_init_ex(&other, port, &axis, 1, &settings)
    REJECTED(ECAN_ERR_ARGUMENT, settings, reserved, CONTEXT);
    REJECTED(ECAN_ERR_CONFIG, axis, reserved, CONTEXT);
    REJECTED(ECAN_ERR_CONFIG, axis, padding, CONTEXT);
    ERROR_HAS("axis 0: has a reserved field that is not 0");
    axis.further_count = 1;
    axis.further[0].index = 0x2000;
    axis.further[0].size = 1;
    REJECTED(ECAN_ERR_CONFIG, axis, further[0].reserved, CONTEXT);
    ERROR_HAS("axis 0: has a reserved field that is not 0");
    GOOD(CONTEXT);
    GOOD(igh_cia402_context_deinit(&other));
}

void test_reserved(void)
{
    static ecan_igh_config_t igh_config;
    static igh_mcan_port_config_t config;
    ecan_igh_context_t igh;
    igh_mcan_port_t port;
    igh_mcan_schedule_settings_t schedule;
    igh_cia402_context_t motors;
    igh_cia402_axis_t axis;

    filled_without_a_bus();
    filled_by_the_application();
    simulate(&igh_config, "sim:drives");
    GOOD(ecan_igh_config_set_dc_sync0(&igh_config, 1000, 700));
    GOOD(igh_mcan_port_default_config(&config));
    GOOD(igh_mcan_port_set_channel_mask(&config, 0, 0x01, 0x00));
    GOOD(igh_mcan_port_default_schedule(&schedule));
    schedule.watch_ms = 10;
    GOOD(igh_mcan_port_set_schedule(&config, 0, &schedule));
    SAME(0, start_port(&igh, &port, &igh_config, &config));
    filled_by_the_adapter(&igh);
    filled_by_the_port(&port);
    GOOD(igh_cia402_axis_init(&axis, 0, 0, 1, 0));
    GOOD(igh_cia402_context_init(&motors, &port, &axis, 1));
    filled_by_the_axes(&motors);
    filled_for_the_axes(&port, &motors);
    GOOD(ecan_igh_deinit(&igh));
}
