/* igh_adapter.h: the configuration. */
#include "check.h"

static const uint8_t VALUE[8] = {1};

/* Every function of a configuration rejects an invalid one. */
static void no_config(int code, ecan_igh_config_t *config)
{
    char text[ECAN_IGH_MAX_SETTING];
    uint16_t position;
    uint32_t number, shift_ns;
    int64_t margin_ns;
    size_t count;
    BAD(code, ecan_igh_check_config(config));
    BAD(code, ecan_igh_config_get_slave_count(config, &count));
    BAD(code, ecan_igh_config_get_cycle_ns(config, &number));
    BAD(code, ecan_igh_config_get_slave_position(config, 0, &position, &position));
    BAD(code, ecan_igh_config_get_slave_pdo_multipliers(config, 0, &number, &number));
    BAD(code, ecan_igh_config_get_ecrt(config, text, sizeof(text), NULL));
    BAD(code, ecan_igh_config_set_ecrt(config, "sim"));
    BAD(code, ecan_igh_config_suggest_scenario(config, "echo"));
    BAD(code, ecan_igh_config_set_stepped_clock(config, 1));
    BAD(code, ecan_igh_config_set_seed(config, 1));
    BAD(code, ecan_igh_config_stop_waiting_when(config, NULL, NULL));
    BAD(code, ecan_igh_config_set_master_index(config, 0));
    BAD(code, ecan_igh_config_set_slave_count(config, 1));
    BAD(code, ecan_igh_config_set_cycle_us(config, 1000));
    BAD(code, ecan_igh_config_set_dc_sync0(config, 1000, 0));
    BAD(code, ecan_igh_config_set_dc_sync0_planned(config, 1000));
    BAD(code, ecan_igh_config_get_dc_margin(config, &shift_ns, &margin_ns));
    BAD(code, ecan_igh_config_set_dc_assign_activate(config, 0x0300));
    BAD(code, ecan_igh_config_set_dc_source(config, ECAN_IGH_CLOCK_HOST));
    BAD(code, ecan_igh_config_set_dc_reference(config, 0));
    BAD(code, ecan_igh_config_set_dc_monitor(config, 100));
    BAD(code, ecan_igh_config_allow_large_pdos(config, 1));
    BAD(code, ecan_igh_config_set_preop_timeout_ms(config, 1000));
    BAD(code, ecan_igh_config_set_watchdog_us(config, 1000));
    BAD(code, ecan_igh_config_set_pdo_multiplier(config, 3));
    BAD(code, ecan_igh_config_set_slave_pdo_multiplier(config, 0, 3));
    BAD(code, ecan_igh_config_set_slave_pdo_multipliers(config, 0, 3, 3));
    BAD(code, ecan_igh_config_set_slave_position(config, 0, 0, 0));
    BAD(code, ecan_igh_config_set_slave_identity(config, 0, 1, 1));
    BAD(code, ecan_igh_config_add_startup_sdo(config, 0, 0x8001, 1, VALUE, 1));
    BAD(code, ecan_igh_config_add_startup_readback(config, 0, 0xF000, 2, 4));
}

static void settings(ecan_igh_config_t *config)
{
    char text[ECAN_IGH_MAX_SETTING];
    char long_text[ECAN_IGH_MAX_SETTING + 1];

    fill_garbage(2, text, sizeof(text));
    GOOD(ecan_igh_config_get_ecrt(config, text, sizeof(text), NULL));
    SAME(0, text[0]);
    GOOD(ecan_igh_config_set_ecrt(config, "sim:echo"));
    GOOD(ecan_igh_config_get_ecrt(config, text, 9, NULL));
    TRUE(strcmp(text, "sim:echo") == 0);
    BAD(ECAN_ERR_BUFFER, ecan_igh_config_get_ecrt(config, text, 8, NULL));
    TRUE(strcmp(text, "sim:ech") == 0);
    BAD(ECAN_ERR_BUFFER, ecan_igh_config_get_ecrt(config, text, 1, NULL));
    SAME(0, text[0]);
    BAD(ECAN_ERR_BUFFER, ecan_igh_config_get_ecrt(config, text, 0, NULL));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_set_ecrt(config, "\xFF\xFE"));
    GOOD(ecan_igh_config_get_ecrt(config, text, sizeof(text), NULL));
    TRUE(strcmp(text, "sim:echo") == 0);

    memset(long_text, 'x', sizeof(long_text));
    long_text[ECAN_IGH_MAX_SETTING] = '\0';
    BAD(ECAN_ERR_BUFFER, ecan_igh_config_set_ecrt(config, long_text));
    long_text[ECAN_IGH_MAX_SETTING - 1] = '\0';
    GOOD(ecan_igh_config_set_ecrt(config, long_text));
    GOOD(ecan_igh_config_get_ecrt(config, text, sizeof(text), NULL));
    TRUE(strcmp(text, long_text) == 0);
    GOOD(ecan_igh_config_set_ecrt(config, ""));
    GOOD(ecan_igh_config_set_ecrt(config, NULL));
    GOOD(ecan_igh_config_get_ecrt(config, text, sizeof(text), NULL));
    SAME(0, text[0]);

    GOOD(ecan_igh_config_suggest_scenario(config, "drives"));
    GOOD(ecan_igh_config_suggest_scenario(config, "echo"));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_suggest_scenario(config, "\xFF"));
    BAD(ECAN_ERR_BUFFER, ecan_igh_config_suggest_scenario(config, long_text));
}

static void numbers(ecan_igh_config_t *config)
{
    uint32_t shift_ns;
    int64_t margin_ns;

    GOOD(ecan_igh_config_set_stepped_clock(config, 0));
    GOOD(ecan_igh_config_set_stepped_clock(config, -1));
    GOOD(ecan_igh_config_set_seed(config, UINT64_MAX));
    GOOD(ecan_igh_config_set_master_index(config, UINT32_MAX));
    GOOD(ecan_igh_config_set_master_index(config, 0));
    GOOD(ecan_igh_config_set_preop_timeout_ms(config, 0));
    GOOD(ecan_igh_config_set_preop_timeout_ms(config, UINT32_MAX));
    GOOD(ecan_igh_config_set_preop_timeout_ms(config, 10000));
    GOOD(ecan_igh_config_set_watchdog_us(config, 150));
    BAD(ECAN_ERR_CONFIG, ecan_igh_check_config(config));
    GOOD(ecan_igh_config_set_watchdog_us(config, 0));
    BAD(ECAN_ERR_CONFIG, ecan_igh_check_config(config));
    GOOD(ecan_igh_config_set_watchdog_us(config, 50000));
    GOOD(ecan_igh_check_config(config));

    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_set_cycle_us(config, 0));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_set_cycle_us(config, 4294968));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_set_cycle_us(config, UINT32_MAX));
    GOOD(ecan_igh_config_set_cycle_us(config, 4294967));
    GOOD(ecan_igh_config_set_cycle_us(config, 1));
    GOOD(ecan_igh_config_set_cycle_us(config, 1000));

    BAD(ECAN_ERR_ORDER, ecan_igh_config_set_dc_assign_activate(config, 0x0300));
    BAD(ECAN_ERR_ORDER, ecan_igh_config_get_dc_margin(config, &shift_ns, &margin_ns));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_set_dc_sync0_planned(config, 4294968));
    GOOD(ecan_igh_config_set_dc_sync0_planned(config, 2000));
    GOOD(ecan_igh_config_get_dc_margin(config, &shift_ns, &margin_ns));
    TRUE(shift_ns > 0 && shift_ns < 1000000 && margin_ns > 0);
    GOOD(ecan_igh_config_set_dc_sync0(config, 2000, 60));
    GOOD(ecan_igh_config_get_dc_margin(config, &shift_ns, &margin_ns));
    SAME(60000, shift_ns);
    TRUE(margin_ns < 0);
    GOOD(ecan_igh_config_set_dc_sync0_planned(config, 1500));
    BAD(ECAN_ERR_CONFIG, ecan_igh_check_config(config));
    GOOD(ecan_igh_config_get_dc_margin(config, &shift_ns, &margin_ns));
    TRUE(shift_ns != 60000);
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_set_dc_sync0(config, 4294968, 0));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_set_dc_sync0(config, 1000, 4294968));
    GOOD(ecan_igh_config_set_dc_sync0(config, 1000, 1000));
    BAD(ECAN_ERR_CONFIG, ecan_igh_check_config(config));
    GOOD(ecan_igh_config_set_dc_sync0(config, 1500, 100));
    BAD(ECAN_ERR_CONFIG, ecan_igh_check_config(config));
    GOOD(ecan_igh_config_set_dc_sync0(config, 2000, 1999));
    GOOD(ecan_igh_config_set_dc_assign_activate(config, 0x0700));
    GOOD(ecan_igh_check_config(config));
    GOOD(ecan_igh_config_set_dc_source(config, ECAN_IGH_CLOCK_REFERENCE));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_set_dc_source(config, 2));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_set_dc_source(config, -1));
    GOOD(ecan_igh_config_set_dc_monitor(config, 0));
    GOOD(ecan_igh_config_set_dc_monitor(config, UINT32_MAX));
    GOOD(ecan_igh_config_set_dc_reference(config, SIZE_MAX));
    BAD(ECAN_ERR_CONFIG, ecan_igh_check_config(config));
    ERROR_HAS("reference clock");
    GOOD(ecan_igh_config_set_dc_reference(config, 0));
    GOOD(ecan_igh_check_config(config));
    GOOD(ecan_igh_config_set_dc_sync0(config, 0, 0));
    BAD(ECAN_ERR_ORDER, ecan_igh_config_set_dc_assign_activate(config, 0x0300));
    BAD(ECAN_ERR_ORDER, ecan_igh_config_set_dc_source(config, ECAN_IGH_CLOCK_HOST));
    BAD(ECAN_ERR_ORDER, ecan_igh_config_set_dc_reference(config, 0));
    BAD(ECAN_ERR_ORDER, ecan_igh_config_set_dc_monitor(config, 1));
    GOOD(ecan_igh_check_config(config));
}

static void slaves(ecan_igh_config_t *config)
{
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_set_slave_count(config, 0));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_set_slave_count(config, ECAN_IGH_MAX_SLAVES + 1));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_set_slave_count(config, SIZE_MAX));
    GOOD(ecan_igh_config_set_slave_count(config, ECAN_IGH_MAX_SLAVES));
    BAD(ECAN_ERR_CONFIG, ecan_igh_check_config(config));
    GOOD(ecan_igh_config_set_cycle_us(config, 10000));
    GOOD(ecan_igh_check_config(config));
    GOOD(ecan_igh_config_set_slave_count(config, 2));

    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_set_pdo_multiplier(config, 0));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_set_pdo_multiplier(config, 25));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_set_pdo_multiplier(config, 259));
    GOOD(ecan_igh_config_set_pdo_multiplier(config, ECAN_PDO_MAX_PLAIN_MULTIPLIER));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_set_slave_pdo_multiplier(config, 0, 0));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_set_slave_pdo_multiplier(config, 0, 25));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_set_slave_pdo_multipliers(config, 0, 3, 0));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_set_slave_pdo_multipliers(config, 0, 25, 3));
    BAD(ECAN_ERR_SLAVE, ecan_igh_config_set_slave_pdo_multiplier(config, 2, 3));
    BAD(ECAN_ERR_SLAVE, ecan_igh_config_set_slave_pdo_multipliers(config, 2, 3, 3));
    BAD(ECAN_ERR_SLAVE, ecan_igh_config_set_slave_pdo_multipliers(config, SIZE_MAX, 3, 3));
    GOOD(ecan_igh_config_set_slave_pdo_multipliers(config, 1, 2, 4));
    GOOD(ecan_igh_check_config(config));

    /* N of 12 needs permission. */
    GOOD(ecan_igh_config_set_slave_pdo_multiplier(config, 1, 12));
    BAD(ECAN_ERR_CONFIG, ecan_igh_check_config(config));
    GOOD(ecan_igh_config_allow_large_pdos(config, 1));
    GOOD(ecan_igh_check_config(config));
    GOOD(ecan_igh_config_set_pdo_multiplier(config, ECAN_PDO_MAX_MULTIPLIER));
    GOOD(ecan_igh_check_config(config));
    GOOD(ecan_igh_config_allow_large_pdos(config, 0));
    BAD(ECAN_ERR_CONFIG, ecan_igh_check_config(config));

    /* Every fault is reported. */
    GOOD(ecan_igh_config_set_slave_position(config, 1, 0, 0));
    GOOD(ecan_igh_config_set_dc_sync0(config, 1500, 0));
    BAD(ECAN_ERR_CONFIG, ecan_igh_check_config(config));
    ERROR_HAS("24");
    ERROR_HAS("1486");
    ERROR_HAS("1500");
    GOOD(ecan_igh_config_set_dc_sync0(config, 0, 0));
    GOOD(ecan_igh_config_set_pdo_multiplier(config, 3));
    BAD(ECAN_ERR_CONFIG, ecan_igh_check_config(config));
    GOOD(ecan_igh_config_set_slave_position(config, 1, 0, 1));
    GOOD(ecan_igh_check_config(config));
    GOOD(ecan_igh_config_set_slave_position(config, 1, 0xFFFF, 0xFFFF));
    BAD(ECAN_ERR_SLAVE, ecan_igh_config_set_slave_position(config, 2, 0, 0));

    GOOD(ecan_igh_config_set_slave_identity(config, 1, 1, 0));
    BAD(ECAN_ERR_CONFIG, ecan_igh_check_config(config));
    GOOD(ecan_igh_config_set_slave_identity(config, 1, 1, 1));
    BAD(ECAN_ERR_SLAVE, ecan_igh_config_set_slave_identity(config, 2, 0, 0));
}

static void getters(ecan_igh_config_t *config)
{
    uint16_t alias, position;
    uint32_t rx_n, tx_n, cycle_ns;
    size_t count;
    GOOD(ecan_igh_config_set_slave_count(config, 2));
    GOOD(ecan_igh_config_get_slave_count(config, &count));
    SAME(2, count);
    GOOD(ecan_igh_config_set_cycle_us(config, 4000));
    GOOD(ecan_igh_config_get_cycle_ns(config, &cycle_ns));
    SAME(4000000, cycle_ns);
    GOOD(ecan_igh_config_set_slave_pdo_multipliers(config, 1, 2, 4));
    GOOD(ecan_igh_config_get_slave_pdo_multipliers(config, 1, &rx_n, &tx_n));
    SAME(2, rx_n);
    SAME(4, tx_n);
    BAD(ECAN_ERR_SLAVE, ecan_igh_config_get_slave_pdo_multipliers(config, 2, &rx_n, &tx_n));
    BAD(ECAN_ERR_SLAVE, ecan_igh_config_get_slave_pdo_multipliers(config, SIZE_MAX, &rx_n, &tx_n));
    GOOD(ecan_igh_config_set_slave_position(config, 1, 0xFFFF, 0xFFFE));
    GOOD(ecan_igh_config_get_slave_position(config, 1, &alias, &position));
    SAME(0xFFFF, alias);
    SAME(0xFFFE, position);
    BAD(ECAN_ERR_SLAVE, ecan_igh_config_get_slave_position(config, 2, &alias, &position));
    BAD(ECAN_ERR_SLAVE, ecan_igh_config_get_slave_position(config, SIZE_MAX, &alias, &position));
}

static void startup_sdos(ecan_igh_config_t *config)
{
    GOOD(ecan_igh_default_config(config));
    BAD(ECAN_ERR_SLAVE, ecan_igh_config_add_startup_sdo(config, 1, 0x8001, 1, VALUE, 1));
    BAD(ECAN_ERR_SLAVE, ecan_igh_config_add_startup_readback(config, 1, 0xF000, 2, 4));
    GOOD(ecan_igh_config_add_startup_readback(config, 0, 0xF000, 2, 4));
    GOOD(ecan_igh_default_config(config));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_add_startup_sdo(config, 0, 0x8001, 1, VALUE, 0));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_add_startup_sdo(config, 0, 0x8001, 1, VALUE, 3));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_add_startup_sdo(config, 0, 0x8001, 1, VALUE, 5));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_add_startup_sdo(config, 0, 0x8001, 1, VALUE, 8));
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_config_add_startup_sdo(config, 0, 0x8001, 1, NULL, 0));
    for (size_t i = 0; i < ECAN_IGH_MAX_STARTUP_SDOS; i++) {
        static const size_t SIZES[3] = {1, 2, 4};
        GOOD(ecan_igh_config_add_startup_sdo(config, 0, 0x2000, (uint8_t)i, VALUE, SIZES[i % 3]));
    }
    BAD(ECAN_ERR_FULL, ecan_igh_config_add_startup_sdo(config, 0, 0x2000, 1, VALUE, 1));
    BAD(ECAN_ERR_FULL, ecan_igh_config_add_startup_readback(config, 0, 0xF000, 2, 4));
    GOOD(ecan_igh_check_config(config));
}

void test_adapter_config(void)
{
    static ecan_igh_config_t config;
    static ecan_igh_config_t copy;
    static igh_mcan_port_config_t other;

    for (int kind = 0; kind < GARBAGE_KINDS; kind++) {
        check_about(fill_garbage(kind, &config, sizeof(config)));
        no_config(ECAN_ERR_NOT_INITIALISED, &config);
    }
    check_about("a Port's configuration");
    GOOD(igh_mcan_port_default_config(&other));
    memcpy(&config, &other, sizeof(other));
    no_config(ECAN_ERR_NOT_INITIALISED, &config);
    check_about(NULL);

    GOOD(ecan_igh_default_config(&config));
    GOOD(ecan_igh_check_config(&config));
    settings(&config);
    numbers(&config);
    slaves(&config);
    copy = config;
    GOOD(ecan_igh_check_config(&copy));
    check_about("an overwritten configuration");
    for (size_t byte = 0; byte < 200; byte++) {
        ((uint8_t *)&copy)[byte] ^= 0x10;
        BAD(ECAN_ERR_NOT_INITIALISED, ecan_igh_check_config(&copy));
        ((uint8_t *)&copy)[byte] ^= 0x10;
    }
    ((uint8_t *)&copy)[100] ^= 0x10;
    no_config(ECAN_ERR_NOT_INITIALISED, &copy);
    ERROR_HAS("was overwritten");
    check_about(NULL);
    getters(&config);
    startup_sdos(&config);
}
