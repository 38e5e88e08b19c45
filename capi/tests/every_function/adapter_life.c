/* igh_adapter.h: life of contexts, and invalid calls. */
#include "check.h"

static const uint8_t VALUE[4] = {1};

/* Every function of a context rejects an invalid one. */
static void no_context(int code, ecan_igh_context_t *context)
{
    static ecan_igh_config_t config;
    ecan_igh_diagnostics_t diagnostics;
    ecan_igh_domain_report_t report;
    ecan_igh_clock_status_t clocks;
    ecan_igh_cycle_start_t start;
    ecan_igh_cycle_statistics_t statistics;
    char text[64];
    ecan_igh_slave_state_t slave_state;
    ecan_igh_master_state_t master_state;
    ecan_igh_slave_info_t info;
    uint8_t *rxpdo;
    const uint8_t *txpdo;
    uint8_t data[8];
    size_t size;

    GOOD(ecan_igh_default_config(&config));
    memset(&diagnostics, 0, sizeof(diagnostics));
    BAD(code, ecan_igh_owner_activated(context));
    BAD(code, ecan_igh_activate(context));
    BAD(code, ecan_igh_wait_op_timeout(context, 100));
    BAD(code, ecan_igh_reconfigure(context, &config));
    BAD(code, ecan_igh_retry_startup(context));
    NONE(code, 0, ecan_igh_is_simulated(context));
    NONE(code, 0, ecan_igh_clock_is_stepped(context));
    NONE(code, 0, ecan_igh_startup_timeout_ms(context));
    BAD(code, ecan_igh_receive(context));
    BAD(code, ecan_igh_send(context));
    BAD(code, ecan_igh_wait_next_cycle(context));
    NONE(code, 0, ecan_igh_now_ns(context));
    NONE(code, 0, ecan_igh_cycle_time_ns(context));
    NONE(code, 0, ecan_igh_response_ns(context));
    BAD(code, ecan_igh_get_clock_status(context, &clocks));
    NONE(code, 0, ecan_igh_clock_correction_ns(context));
    BAD(code, ecan_igh_set_cycle_timing(context, 100, 0));
    BAD(code, ecan_igh_get_cycle_start(context, &start));
    BAD(code, ecan_igh_measure_cycles(context));
    BAD(code, ecan_igh_get_cycle_statistics(context, &statistics));
    BAD(code, ecan_igh_get_cycle_statistics_text(context, text, sizeof(text), NULL));
    NONE(code, 0, ecan_igh_domain_is_complete(context));
    BAD(code, ecan_igh_get_domain_report(context, 0, &report));
    BAD(code, ecan_igh_get_rxpdo_buffer(context, 0, &rxpdo, &size));
    BAD(code, ecan_igh_get_txpdo_buffer(context, 0, &txpdo, &size));
    NONE(code, 0, ecan_igh_slave_count(context));
    NONE(code, 0, ecan_igh_is_operational(context));
    BAD(code, ecan_igh_get_slave_state(context, 0, &slave_state));
    BAD(code, ecan_igh_get_master_state(context, &master_state));
    BAD(code, ecan_igh_get_slave_info(context, 0, &info));
    BAD(code, ecan_igh_sdo_upload(context, 0, 0x1018, 1, data, sizeof(data), &size));
    BAD(code, ecan_igh_sdo_download(context, 0, 0x8001, 1, VALUE, 1));
    BAD(code, ecan_igh_create_sdo_request(context, 0, 4, &size));
    BAD(code, ecan_igh_sdo_request_timeout(context, 0, 100));
    BAD(code, ecan_igh_sdo_request_read(context, 0, 0x1018, 1));
    BAD(code, ecan_igh_sdo_request_write(context, 0, 0x1018, 1, VALUE, 1));
    BAD(code, ecan_igh_sdo_request_state(context, 0));
    BAD(code, ecan_igh_sdo_request_data(context, 0, data, sizeof(data), &size));
    BAD(code, ecan_igh_diagnostics_open(&diagnostics, context));
    if (context == NULL) {
        BAD(code, ecan_igh_deinit(context));
    } else {
        GOOD(ecan_igh_deinit(context));
    }
}

/* No such slave. */
static void wrong_slave(ecan_igh_context_t *context, size_t slave)
{
    ecan_igh_domain_report_t report;
    ecan_igh_slave_state_t slave_state;
    ecan_igh_slave_info_t info;
    uint8_t *rxpdo;
    const uint8_t *txpdo;
    uint8_t data[8];
    size_t size;

    BAD(ECAN_ERR_SLAVE, ecan_igh_get_domain_report(context, slave, &report));
    BAD(ECAN_ERR_SLAVE, ecan_igh_get_rxpdo_buffer(context, slave, &rxpdo, &size));
    BAD(ECAN_ERR_SLAVE, ecan_igh_get_txpdo_buffer(context, slave, &txpdo, &size));
    BAD(ECAN_ERR_SLAVE, ecan_igh_get_slave_state(context, slave, &slave_state));
    BAD(ECAN_ERR_SLAVE, ecan_igh_get_slave_info(context, slave, &info));
    BAD(ECAN_ERR_SLAVE, ecan_igh_sdo_upload(context, slave, 0x1018, 1, data, 8, &size));
    BAD(ECAN_ERR_SLAVE, ecan_igh_sdo_download(context, slave, 0x8001, 1, VALUE, 1));
    BAD(ECAN_ERR_SLAVE, ecan_igh_create_sdo_request(context, slave, 4, &size));
}

static void rejected_starts(void)
{
    static ecan_igh_config_t config;
    ecan_igh_context_t context;
    char setting[512];

    memset(&context, 0xA5, sizeof(context));
    for (int kind = 0; kind < GARBAGE_KINDS; kind++) {
        check_about(fill_garbage(kind, &config, sizeof(config)));
        BAD(ECAN_ERR_NOT_INITIALISED, ecan_igh_init(&context, &config));
        BAD(ECAN_ERR_NOT_INITIALISED, ecan_igh_attach(&context, &config, &config));
    }
    check_about(NULL);
    simulate(&config, "sim:nonsense");
    BAD(ECAN_ERR_FILE, ecan_igh_init(&context, &config));
    ERROR_HAS("nonsense");
    simulate(&config, "sim:/nowhere/at/all.toml");
    BAD(ECAN_ERR_FILE, ecan_igh_init(&context, &config));
    ERROR_HAS("/nowhere/at/all.toml");
    simulate(&config, "/nowhere/libethercat.so.1");
    BAD(ECAN_ERR_ECRT, ecan_igh_init(&context, &config));
    ERROR_HAS("/nowhere/libethercat.so.1");
    BAD(ECAN_ERR_ECRT, ecan_igh_attach(&context, &config, &context));
    simulate(&config, "sim");
    GOOD(ecan_igh_config_suggest_scenario(&config, "nonsense"));
    BAD(ECAN_ERR_FILE, ecan_igh_init(&context, &config));
    ERROR_HAS("nonsense");

    SAME(0, write_scenario("seed = 1\nno_such_key = 2\n", setting, sizeof(setting)));
    simulate(&config, setting);
    BAD(ECAN_ERR_FILE, ecan_igh_init(&context, &config));
    ERROR_HAS("no_such_key");
    remove_scenario(setting);

    simulate(&config, "sim:echo");
    GOOD(ecan_igh_config_set_pdo_multiplier(&config, 12));
    BAD(ECAN_ERR_CONFIG, ecan_igh_init(&context, &config));
    BAD(ECAN_ERR_CONFIG, ecan_igh_attach(&context, &config, &context));

    SAME(0, write_scenario("[[gateway]]\nbuses = [\"a\", \"b\", \"c\", \"d\"]\n", setting,
                           sizeof(setting)));
    simulate(&config, setting);
    GOOD(ecan_igh_config_set_slave_position(&config, 0, 0, 1));
    BAD(ECAN_ERR_NOT_FOUND, ecan_igh_init(&context, &config));
    remove_scenario(setting);

    simulate(&config, "sim:echo");
    GOOD(ecan_igh_config_set_slave_identity(&config, 0, 0xDEADBEEF, 1));
    BAD(ECAN_ERR_IDENTITY, ecan_igh_init(&context, &config));
    simulate(&config, "sim:echo");
    GOOD(ecan_igh_config_add_startup_sdo(&config, 0, 0x5555, 1, VALUE, 4));
    GOOD(ecan_igh_init(&context, &config));
    BAD(ECAN_ERR_NOT_OPERATIONAL, ecan_igh_wait_op_timeout(&context, 20000));
    SAME(0x06020000, ecan_last_abort_code());
    GOOD(ecan_igh_deinit(&context));
    simulate(&config, "sim:echo");
    GOOD(ecan_igh_config_add_startup_sdo(&config, 0, 0x1018, 1, VALUE, 4));
    GOOD(ecan_igh_init(&context, &config));
    BAD(ECAN_ERR_NOT_OPERATIONAL, ecan_igh_wait_op_timeout(&context, 20000));
    SAME(0x06010002, ecan_last_abort_code());
    GOOD(ecan_igh_deinit(&context));

    /* Nothing to deinit, and nothing that can be used. */
    BAD(ECAN_ERR_NOT_INITIALISED, ecan_igh_activate(&context));
    GOOD(ecan_igh_deinit(&context));
    simulate(&config, "sim:echo");
    GOOD(ecan_igh_init(&context, &config));
    GOOD(ecan_igh_deinit(&context));
}

static void invalid_contexts(void)
{
    static ecan_igh_config_t config;
    static igh_mcan_port_config_t port_config;
    ecan_igh_context_t context;
    ecan_igh_context_t copy;
    igh_mcan_port_t port;
    ecan_igh_diagnostics_t diagnostics;

    simulate_channel(&config, &port_config, "sim:echo", 500000);
    GOOD(igh_mcan_port_apply_config(&config, &port_config));
    for (int kind = 0; kind < GARBAGE_KINDS; kind++) {
        const char *about = fill_garbage(kind, &context, sizeof(context));
        check_about(about);
        no_context(ECAN_ERR_NOT_INITIALISED, &context);
        GOOD(ecan_igh_init(&context, &config));
        SAME(1, ecan_igh_slave_count(&context));
        BAD(ECAN_ERR_ORDER, ecan_igh_init(&context, &config));
        BAD(ECAN_ERR_ORDER, ecan_igh_attach(&context, &config, &config));
        SAME(1, ecan_igh_slave_count(&context));
        check_about("a copy");
        copy = context;
        no_context(ECAN_ERR_NOT_INITIALISED, &copy);
        SAME(1, ecan_igh_slave_count(&context));
        check_about(about);
        GOOD(ecan_igh_deinit(&context));
        check_about("a context that has ended");
        no_context(ECAN_ERR_NOT_INITIALISED, &context);
    }

    GOOD(ecan_igh_init(&context, &config));
    GOOD(igh_mcan_port_init(&port, &context, &port_config));
    GOOD(ecan_igh_diagnostics_open(&diagnostics, &context));
    check_about("a Port");
    no_context(ECAN_ERR_NOT_INITIALISED, (ecan_igh_context_t *)(void *)&port);
    check_about("a handle for diagnosis");
    no_context(ECAN_ERR_NOT_INITIALISED, (ecan_igh_context_t *)(void *)&diagnostics);
    check_about(NULL);
    GOOD(ecan_igh_diagnostics_deinit(&diagnostics));

    /* An old context does not refer to the next master. */
    copy = context;
    GOOD(ecan_igh_deinit(&context));
    GOOD(ecan_igh_init(&context, &config));
    context = copy;
    check_about("the text of an earlier context");
    no_context(ECAN_ERR_NOT_INITIALISED, &context);
    check_about(NULL);
}

static void before_it_is_active(ecan_igh_context_t *context)
{
    ecan_igh_domain_report_t report;
    ecan_igh_slave_state_t slave_state;
    ecan_igh_master_state_t master_state;
    ecan_igh_slave_info_t info;
    uint8_t *rxpdo;
    const uint8_t *txpdo;
    size_t size;

    SAME(1, ecan_igh_is_simulated(context));
    SAME(1, ecan_igh_clock_is_stepped(context));
    SAME(0, ecan_igh_cycle_time_ns(context));
    SAME(2, ecan_igh_slave_count(context));
    TRUE(ecan_igh_startup_timeout_ms(context) > 0);
    SAME(0, ecan_igh_domain_is_complete(context));
    GOOD(ecan_igh_get_domain_report(context, 1, &report));
    SAME(0, report.is_complete);
    SAME(ECAN_IGH_DELIVERY_NONE, report.inputs);
    GOOD(ecan_igh_get_slave_state(context, 1, &slave_state));
    SAME(1, slave_state.online);
    SAME(0, slave_state.operational);
    SAME(ECAN_IGH_AL_PREOP, slave_state.al_state);
    GOOD(ecan_igh_get_master_state(context, &master_state));
    SAME(2, master_state.slaves_responding);
    SAME(1, master_state.link_up);
    SAME(1 << 1, master_state.al_states);
    GOOD(ecan_igh_get_slave_info(context, 1, &info));
    SAME(1, info.position);
    SAME(ECAN_IGH_AL_PREOP, info.al_state);
    SAME(0, info.error_flag);
    TRUE(info.vendor_id != 0 && info.name[0] != '\0');

    BAD(ECAN_ERR_ORDER, ecan_igh_receive(context));
    BAD(ECAN_ERR_ORDER, ecan_igh_send(context));
    BAD(ECAN_ERR_ORDER, ecan_igh_get_rxpdo_buffer(context, 0, &rxpdo, &size));
    BAD(ECAN_ERR_ORDER, ecan_igh_get_txpdo_buffer(context, 0, &txpdo, &size));
    BAD(ECAN_ERR_ORDER, ecan_igh_owner_activated(context));
    SAME(0, ecan_igh_is_operational(context));
    wrong_slave(context, 2);
    wrong_slave(context, SIZE_MAX);
}

void test_adapter_life(void)
{
    static ecan_igh_config_t config;
    static ecan_igh_config_t larger;
    static ecan_igh_config_t faulty;
    static igh_mcan_port_config_t port_config;
    ecan_igh_context_t context;
    uint8_t *rxpdo;
    size_t size;
    size_t request;

    rejected_starts();
    invalid_contexts();

    simulate(&config, "sim:echo");
    GOOD(ecan_igh_config_set_slave_count(&config, 2));
    larger = config;
    GOOD(ecan_igh_config_set_pdo_multiplier(&larger, 8));
    GOOD(igh_mcan_port_default_config(&port_config));
    GOOD(igh_mcan_port_set_classic_channel(&port_config, 0, 0, 500000));
    GOOD(igh_mcan_port_set_classic_channel(&port_config, 1, 3, 500000));
    GOOD(igh_mcan_port_apply_config(&config, &port_config));
    GOOD(igh_mcan_port_apply_config(&larger, &port_config));
    GOOD(ecan_igh_init(&context, &config));
    before_it_is_active(&context);
    GOOD(ecan_igh_create_sdo_request(&context, 0, 4, &request));
    BAD(ECAN_ERR_ORDER, ecan_igh_retry_startup(&context));
    BAD(ECAN_ERR_NOT_OPERATIONAL, ecan_igh_wait_op_timeout(&context, 0));
    BAD(ECAN_ERR_ORDER, ecan_igh_activate(&context));
    GOOD(ecan_igh_wait_op_timeout(&context, 20000));
    GOOD(ecan_igh_retry_startup(&context));
    GOOD(ecan_igh_wait_op_timeout(&context, 20000));
    BAD(ECAN_ERR_ORDER, ecan_igh_owner_activated(&context));
    BAD(ECAN_ERR_ORDER, ecan_igh_create_sdo_request(&context, 0, 4, &request));
    SAME(1, ecan_igh_is_operational(&context));
    wrong_slave(&context, 2);
    wrong_slave(&context, SIZE_MAX);

    /* A faulty configuration changes nothing, not even the requests. */
    faulty = config;
    GOOD(ecan_igh_config_set_pdo_multiplier(&faulty, 12));
    BAD(ECAN_ERR_CONFIG, ecan_igh_reconfigure(&context, &faulty));
    SAME(1, ecan_igh_is_operational(&context));
    SAME(ECAN_IGH_REQUEST_UNUSED, ecan_igh_sdo_request_state(&context, request));
    GOOD(ecan_igh_get_rxpdo_buffer(&context, 1, &rxpdo, &size));
    SAME(384, size);

    GOOD(ecan_igh_reconfigure(&context, &larger));
    BAD(ECAN_ERR_ORDER, ecan_igh_get_rxpdo_buffer(&context, 1, &rxpdo, &size));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_sdo_request_state(&context, request));
    GOOD(ecan_igh_wait_op_timeout(&context, 20000));
    GOOD(ecan_igh_get_rxpdo_buffer(&context, 1, &rxpdo, &size));
    SAME(1024, size);
    GOOD(ecan_igh_deinit(&context));
    GOOD(ecan_igh_deinit(&context));
}
