/* igh_mcan_port.h: the configuration. */
#include "check.h"

static ecan_igh_config_t igh_config;

/* Every function of a configuration rejects an invalid one. */
static void no_config(int code, igh_mcan_port_config_t *config)
{
    igh_mcan_schedule_settings_t schedule = {0};
    uint32_t value;
    uint8_t mask;
    BAD(code, igh_mcan_port_get_channel_mask(config, 0, &mask, &mask));
    BAD(code, igh_mcan_port_apply_config(&igh_config, config));
    BAD(code, igh_mcan_port_check_config(&igh_config, config));
    BAD(code, igh_mcan_port_set_channel_mask(config, 0, 1, 0));
    BAD(code, igh_mcan_port_set_direction_masks(config, 0, 1, 1));
    BAD(code, igh_mcan_port_get_direction_masks(config, 0, &mask, &mask));
    BAD(code, igh_mcan_port_set_classic_channel(config, 0, 0, 500000));
    BAD(code, igh_mcan_port_set_canfd_channel(config, 0, 0, 500000, 5000000));
    BAD(code, igh_mcan_port_set_sample_points(config, 0, 0, 750, 875, 750, 875));
    BAD(code, igh_mcan_port_set_traffic(config, 0, 0, 8, 8));
    BAD(code, igh_mcan_port_set_channel_object(config, 0, 0, 8, 0));
    BAD(code, igh_mcan_port_get_channel_object(config, 0, 0, 8, &value));
    BAD(code, igh_mcan_port_set_data_path_object(config, 0, 0, 4, 1));
    BAD(code, igh_mcan_port_get_data_path_object(config, 0, 0, 4, &value));
    BAD(code, igh_mcan_port_set_gateway_object(config, 0, 0x8000, 12, 1));
    BAD(code, igh_mcan_port_get_gateway_object(config, 0, 0x8000, 12, &value));
    BAD(code, igh_mcan_port_add_standard_filter(config, 0, 0, 0, 1, 1, 2));
    BAD(code, igh_mcan_port_add_extended_filter(config, 0, 0, 0, 1, 1, 2));
    BAD(code, igh_mcan_port_clear_filters(config, 0, 0));
    BAD(code, igh_mcan_port_set_encapsulation(config, 0, 0, 0));
    BAD(code, igh_mcan_port_set_budget(config, 0, 0, 0));
    BAD(code, igh_mcan_port_set_options(config, 0, 0, 0));
    BAD(code, igh_mcan_port_set_paced(config, 0, 1));
    BAD(code, igh_mcan_port_set_schedule(config, 0, &schedule));
    BAD(code, igh_mcan_port_set_limits(config, 0, 10, 100));
    BAD(code, igh_mcan_port_allow_diagnostic_tests(config, 0, 0));
}

static void wrong_slave(igh_mcan_port_config_t *config, size_t slave)
{
    igh_mcan_schedule_settings_t schedule = {0};
    uint32_t value;
    uint8_t mask;
    const int code = ECAN_ERR_SLAVE;
    BAD(code, igh_mcan_port_get_channel_mask(config, slave, &mask, &mask));
    BAD(code, igh_mcan_port_set_channel_mask(config, slave, 1, 0));
    BAD(code, igh_mcan_port_set_direction_masks(config, slave, 1, 1));
    BAD(code, igh_mcan_port_get_direction_masks(config, slave, &mask, &mask));
    BAD(code, igh_mcan_port_set_classic_channel(config, slave, 0, 500000));
    BAD(code, igh_mcan_port_set_canfd_channel(config, slave, 0, 500000, 5000000));
    BAD(code, igh_mcan_port_set_sample_points(config, slave, 0, 750, 875, 750, 875));
    BAD(code, igh_mcan_port_set_traffic(config, slave, 0, 8, 8));
    BAD(code, igh_mcan_port_set_channel_object(config, slave, 0, 8, 0));
    BAD(code, igh_mcan_port_get_channel_object(config, slave, 0, 8, &value));
    BAD(code, igh_mcan_port_set_data_path_object(config, slave, 0, 4, 1));
    BAD(code, igh_mcan_port_get_data_path_object(config, slave, 0, 4, &value));
    BAD(code, igh_mcan_port_set_gateway_object(config, slave, 0x8000, 12, 1));
    BAD(code, igh_mcan_port_get_gateway_object(config, slave, 0x8000, 12, &value));
    BAD(code, igh_mcan_port_add_standard_filter(config, slave, 0, 0, 1, 1, 2));
    BAD(code, igh_mcan_port_add_extended_filter(config, slave, 0, 0, 1, 1, 2));
    BAD(code, igh_mcan_port_clear_filters(config, slave, 0));
    BAD(code, igh_mcan_port_set_encapsulation(config, slave, 0, 0));
    BAD(code, igh_mcan_port_set_budget(config, slave, 0, 0));
    BAD(code, igh_mcan_port_set_options(config, slave, 0, 0));
    BAD(code, igh_mcan_port_set_paced(config, slave, 1));
    BAD(code, igh_mcan_port_set_schedule(config, slave, &schedule));
    BAD(code, igh_mcan_port_set_limits(config, slave, 10, 100));
    BAD(code, igh_mcan_port_allow_diagnostic_tests(config, slave, 0));
}

/* Channel 1 is not enabled. */
static void wrong_channel(igh_mcan_port_config_t *config, uint8_t channel)
{
    uint32_t value;
    const int code = ECAN_ERR_CHANNEL;
    if (channel > 3) {
        BAD(code, igh_mcan_port_set_classic_channel(config, 0, channel, 500000));
        BAD(code, igh_mcan_port_set_canfd_channel(config, 0, channel, 500000, 5000000));
        BAD(code, igh_mcan_port_clear_filters(config, 0, channel));
    } else {
        GOOD(igh_mcan_port_clear_filters(config, 0, channel));
    }
    BAD(code, igh_mcan_port_set_sample_points(config, 0, channel, 750, 875, 750, 875));
    BAD(code, igh_mcan_port_set_traffic(config, 0, channel, 8, 8));
    BAD(code, igh_mcan_port_set_channel_object(config, 0, channel, 8, 0));
    BAD(code, igh_mcan_port_get_channel_object(config, 0, channel, 8, &value));
    BAD(code, igh_mcan_port_set_data_path_object(config, 0, channel, 4, 1));
    BAD(code, igh_mcan_port_get_data_path_object(config, 0, channel, 4, &value));
    BAD(code, igh_mcan_port_add_standard_filter(config, 0, channel, 0, 1, 1, 2));
    BAD(code, igh_mcan_port_add_extended_filter(config, 0, channel, 0, 1, 1, 2));
}

static void objects(igh_mcan_port_config_t *config)
{
    uint32_t value = 99;
    uint32_t kept = 99;
    unsigned readable = 0;

    for (int subindex = 0; subindex < 256; subindex++) {
        int code = igh_mcan_port_get_channel_object(config, 0, 0, (uint8_t)subindex, &value);
        TRUE(code == ECAN_OK || code == ECAN_ERR_ARGUMENT);
        if (code == ECAN_OK) {
            readable++;
            GOOD(igh_mcan_port_set_channel_object(config, 0, 0, (uint8_t)subindex, value));
        } else {
            BAD(ECAN_ERR_ARGUMENT,
                igh_mcan_port_set_channel_object(config, 0, 0, (uint8_t)subindex, 0));
        }
        code = igh_mcan_port_get_data_path_object(config, 0, 0, (uint8_t)subindex, &value);
        SAME(subindex == 1 || (subindex >= 4 && subindex <= 19) ? ECAN_OK : ECAN_ERR_ARGUMENT,
             code);
        if (code == ECAN_OK) {
            GOOD(igh_mcan_port_set_data_path_object(config, 0, 0, (uint8_t)subindex, value));
        } else {
            BAD(ECAN_ERR_ARGUMENT,
                igh_mcan_port_set_data_path_object(config, 0, 0, (uint8_t)subindex, 0));
        }
    }
    TRUE(readable > 20);
    GOOD(igh_mcan_port_get_channel_object(config, 0, 0, 8, &kept));
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_port_set_channel_object(config, 0, 0, 8, 0xFFFFFFFF));
    GOOD(igh_mcan_port_get_channel_object(config, 0, 0, 8, &value));
    SAME(kept, value);
    GOOD(igh_mcan_port_get_data_path_object(config, 0, 0, 4, &kept));
    GOOD(igh_mcan_port_set_data_path_object(config, 0, 0, 4, kept + 1));
    GOOD(igh_mcan_port_get_data_path_object(config, 0, 0, 4, &value));
    SAME(kept + 1, value);
    GOOD(igh_mcan_port_set_data_path_object(config, 0, 0, 4, kept));
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_port_set_data_path_object(config, 0, 0, 4, 0xFFFFFFFF));
}

/* Entries of the gateway: index, subindex, value. The last three cannot be set. */
static const struct {
    uint16_t index;
    uint8_t subindex;
    uint32_t value;
} GATEWAY_OBJECTS[] = {
    {0x8000, 3, 1275},  {0x8000, 10, 7},   {0x8000, 12, 0},  {0x8001, 8, 0},
    {0x8010, 4, 1},     {0x8010, 5, 1},    {0x8011, 4, 1},   {0x8011, 6, 2},
    {0x8020, 4, 3},     {0x8020, 7, 500},  {0x8021, 10, 0},  {0x8030, 1, 0},
    {0x8030, 6, 0},     {0xB000, 3, 60},   {0x8000, 4, 1},   {0x8002, 8, 0},
    {0x8010, 3, 8},
};

static void gateway_objects(void)
{
    static igh_mcan_port_config_t config;
    const size_t count = sizeof(GATEWAY_OBJECTS) / sizeof(GATEWAY_OBJECTS[0]);
    uint32_t value = 99;

    GOOD(igh_mcan_port_default_config(&config));
    GOOD(igh_mcan_port_set_classic_channel(&config, 0, 0, 500000));
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_port_get_gateway_object(&config, 0, 0x8000, 12, &value));
    for (size_t i = 0; i < count; i++) {
        const int code = i + 3 < count ? ECAN_OK : ECAN_ERR_ARGUMENT;
        SAME(code, igh_mcan_port_set_gateway_object(&config, 0, GATEWAY_OBJECTS[i].index,
                                                    GATEWAY_OBJECTS[i].subindex,
                                                    GATEWAY_OBJECTS[i].value));
        SAME(code, igh_mcan_port_get_gateway_object(&config, 0, GATEWAY_OBJECTS[i].index,
                                                    GATEWAY_OBJECTS[i].subindex, &value));
        if (code == ECAN_OK) {
            SAME(GATEWAY_OBJECTS[i].value, value);
        }
    }
    GOOD(igh_mcan_port_check_config(&igh_config, &config));
    GOOD(igh_mcan_port_set_gateway_object(&config, 0, 0x8000, 12, 4));
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_check_config(&igh_config, &config));
}

static void filters(igh_mcan_port_config_t *config)
{
    for (int matching = 0; matching <= 3; matching++) {
        GOOD(igh_mcan_port_add_standard_filter(config, 0, 0, matching, IGH_MCAN_FILTER_FIFO0, 1,
                                               2));
        GOOD(igh_mcan_port_add_extended_filter(config, 0, 0, matching, IGH_MCAN_FILTER_FIFO1, 1,
                                               2));
    }
    for (int action = 0; action <= 7; action++) {
        GOOD(igh_mcan_port_add_standard_filter(config, 0, 0, IGH_MCAN_MATCH_TWO, action, 1, 2));
        GOOD(igh_mcan_port_add_extended_filter(config, 0, 0, IGH_MCAN_MATCH_TWO, action, 1, 2));
    }
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_port_add_standard_filter(config, 0, 0, -1, 1, 1, 2));
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_port_add_standard_filter(config, 0, 0, 4, 1, 1, 2));
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_port_add_standard_filter(config, 0, 0, 256, 1, 1, 2));
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_port_add_standard_filter(config, 0, 0, 0, -1, 1, 2));
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_port_add_standard_filter(config, 0, 0, 0, 8, 1, 2));
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_port_add_extended_filter(config, 0, 0, 4, 1, 1, 2));
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_port_add_extended_filter(config, 0, 0, 0, 8, 1, 2));
    GOOD(igh_mcan_port_clear_filters(config, 0, 0));

    /* CAN IDs are checked with the whole configuration. */
    GOOD(igh_mcan_port_add_standard_filter(config, 0, 0, 0, 1, 0x800, 0x900));
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_check_config(&igh_config, config));
    GOOD(igh_mcan_port_clear_filters(config, 0, 0));
    GOOD(igh_mcan_port_add_extended_filter(config, 0, 0, 0, 1, 0x20000000, 0x20000001));
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_check_config(&igh_config, config));
    GOOD(igh_mcan_port_clear_filters(config, 0, 0));
    for (int i = 0; i < 65; i++) {
        GOOD(igh_mcan_port_add_standard_filter(config, 0, 0, 1, 1, 1, 2));
    }
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_check_config(&igh_config, config));
    ERROR_HAS("65");
    for (int i = 65; i < IGH_MCAN_MAX_FILTERS; i++) {
        GOOD(igh_mcan_port_add_extended_filter(config, 0, 0, 1, 1, 1, 2));
    }
    BAD(ECAN_ERR_FULL, igh_mcan_port_add_standard_filter(config, 0, 0, 1, 1, 1, 2));
    BAD(ECAN_ERR_FULL, igh_mcan_port_add_extended_filter(config, 0, 0, 1, 1, 1, 2));
    GOOD(igh_mcan_port_clear_filters(config, 0, 0));
    GOOD(igh_mcan_port_add_standard_filter(config, 0, 0, 1, 1, 1, 2));
    GOOD(igh_mcan_port_check_config(&igh_config, config));
    GOOD(igh_mcan_port_clear_filters(config, 0, 0));
}

static void gateway(igh_mcan_port_config_t *config)
{
    igh_mcan_schedule_settings_t schedule = {0};
    static const int NO_ENCAPSULATIONS[] = {-1, 2, 3, 6, 256};
    for (size_t i = 0; i < ITEMS(NO_ENCAPSULATIONS); i++) {
        BAD(ECAN_ERR_ARGUMENT,
            igh_mcan_port_set_encapsulation(config, 0, NO_ENCAPSULATIONS[i], 0));
        BAD(ECAN_ERR_ARGUMENT,
            igh_mcan_port_set_encapsulation(config, 0, 0, NO_ENCAPSULATIONS[i]));
    }
    GOOD(igh_mcan_port_set_encapsulation(config, 0, IGH_MCAN_ENCAPSULATION_WINDOW64_TIMESTAMPED,
                                         IGH_MCAN_ENCAPSULATION_WINDOW64));
    GOOD(igh_mcan_port_check_config(&igh_config, config));
    GOOD(igh_mcan_port_set_encapsulation(config, 0, 0, 0));
    for (int budget = 0; budget <= 2; budget++) {
        GOOD(igh_mcan_port_set_budget(config, 0, budget, budget));
    }
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_port_set_budget(config, 0, -1, 0));
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_port_set_budget(config, 0, 3, 0));
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_port_set_budget(config, 0, 0, 3));
    GOOD(igh_mcan_port_set_budget(config, 0, 0, 0));
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_port_set_options(config, 0, 0x80, 0));
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_port_set_options(config, 0, 0, 0xE0));
    GOOD(igh_mcan_port_set_options(config, 0, IGH_MCAN_OPTION_TX_RESULT, 0));
    GOOD(igh_mcan_port_check_config(&igh_config, config));
    GOOD(igh_mcan_port_set_options(config, 0, 0, 0));
    GOOD(igh_mcan_port_default_schedule(&schedule));
    SAME(100, schedule.watch_ms);
    SAME(0, schedule.reject_without_margin);
    GOOD(igh_mcan_port_set_schedule(config, 0, &schedule));
    GOOD(igh_mcan_port_set_paced(config, 0, 0));
    GOOD(igh_mcan_port_set_paced(config, 0, -1));
    GOOD(igh_mcan_port_set_limits(config, 0, 1, 0));
    GOOD(igh_mcan_port_set_limits(config, 0, 10, 100));
    GOOD(igh_mcan_port_allow_diagnostic_tests(config, 0, 1));
    GOOD(igh_mcan_port_allow_diagnostic_tests(config, 0, 0));
}

/* Of a configuration with all channels. */
static void direction_masks(const ecan_igh_config_t *igh_config, igh_mcan_port_config_t config)
{
    uint8_t tx;
    uint8_t rx;

    GOOD(igh_mcan_port_get_direction_masks(&config, 0, &tx, &rx));
    SAME(0x0F, tx);
    SAME(0x0F, rx);
    BAD(ECAN_ERR_CHANNEL, igh_mcan_port_set_direction_masks(&config, 0, 0x10, 0x01));
    BAD(ECAN_ERR_CHANNEL, igh_mcan_port_set_direction_masks(&config, 0, 0x01, 0x10));
    BAD(ECAN_ERR_CHANNEL, igh_mcan_port_set_direction_masks(&config, 0, 0x00, 0x0F));
    BAD(ECAN_ERR_CHANNEL, igh_mcan_port_set_direction_masks(&config, 0, 0x0F, 0x00));
    ERROR_HAS("0x8011:04");
    GOOD(igh_mcan_port_set_direction_masks(&config, 0, 0x0D, 0x0A));
    GOOD(igh_mcan_port_check_config(igh_config, &config));
    GOOD(igh_mcan_port_get_direction_masks(&config, 0, &tx, &rx));
    SAME(0x0D, tx);
    SAME(0x0A, rx);
    /* An enabled channel in no mask, then a mask with a channel that is not enabled. */
    GOOD(igh_mcan_port_set_direction_masks(&config, 0, 0x0B, 0x03));
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_check_config(igh_config, &config));
    ERROR_HAS("channel 2");
    GOOD(igh_mcan_port_set_channel_mask(&config, 0, 0x01, 0x00));
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_check_config(igh_config, &config));
    ERROR_HAS("0x0B");
}

/* Manual 5.2: 3 with classic channels only, 8 with a CAN FD channel, unless the application sets N. */
static void default_sizes(void)
{
    static ecan_igh_config_t igh_config;
    static igh_mcan_port_config_t config;
    uint32_t rx_n = 0, tx_n = 0;

    GOOD(ecan_igh_default_config(&igh_config));
    GOOD(igh_mcan_port_default_config(&config));
    GOOD(igh_mcan_port_set_classic_channel(&config, 0, 0, 500000));
    GOOD(igh_mcan_port_apply_config(&igh_config, &config));
    GOOD(ecan_igh_config_get_slave_pdo_multipliers(&igh_config, 0, &rx_n, &tx_n));
    SAME(ECAN_DEFAULT_PDO_MULTIPLIER, rx_n);
    GOOD(igh_mcan_port_set_canfd_channel(&config, 0, 1, 500000, 2000000));
    GOOD(igh_mcan_port_apply_config(&igh_config, &config));
    GOOD(ecan_igh_config_get_slave_pdo_multipliers(&igh_config, 0, &rx_n, &tx_n));
    SAME(ECAN_DEFAULT_FD_PDO_MULTIPLIER, rx_n);
    SAME(ECAN_DEFAULT_FD_PDO_MULTIPLIER, tx_n);
    GOOD(ecan_igh_config_set_slave_pdo_multiplier(&igh_config, 0, 4));
    GOOD(igh_mcan_port_apply_config(&igh_config, &config));
    GOOD(ecan_igh_config_get_slave_pdo_multipliers(&igh_config, 0, &rx_n, &tx_n));
    SAME(4, rx_n);
}

void test_port_config(void)
{
    static igh_mcan_port_config_t config;
    static igh_mcan_port_config_t copy;
    static ecan_igh_config_t no_igh;
    uint32_t value;
    uint8_t enabled, fd;

    simulate(&igh_config, "sim:echo");
    for (int kind = 0; kind < GARBAGE_KINDS; kind++) {
        check_about(fill_garbage(kind, &config, sizeof(config)));
        no_config(ECAN_ERR_NOT_INITIALISED, &config);
    }
    check_about("the Adapter's configuration");
    memcpy(&config, &igh_config, sizeof(config));
    no_config(ECAN_ERR_NOT_INITIALISED, &config);
    check_about(NULL);
    GOOD(igh_mcan_port_default_config(&config));
    for (int kind = 0; kind < GARBAGE_KINDS; kind++) {
        check_about(fill_garbage(kind, &no_igh, sizeof(no_igh)));
        BAD(ECAN_ERR_NOT_INITIALISED, igh_mcan_port_apply_config(&no_igh, &config));
        BAD(ECAN_ERR_NOT_INITIALISED, igh_mcan_port_check_config(&no_igh, &config));
    }
    check_about(NULL);

    /* No channel enabled. */
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_check_config(&igh_config, &config));
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_apply_config(&igh_config, &config));

    BAD(ECAN_ERR_CHANNEL, igh_mcan_port_set_channel_mask(&config, 0, 0x10, 0));
    BAD(ECAN_ERR_CHANNEL, igh_mcan_port_set_channel_mask(&config, 0, 0xFF, 0));
    BAD(ECAN_ERR_CHANNEL, igh_mcan_port_set_channel_mask(&config, 0, 0x01, 0x02));
    BAD(ECAN_ERR_CHANNEL, igh_mcan_port_set_channel_mask(&config, 0, 0x01, 0x11));
    BAD(ECAN_ERR_CHANNEL, igh_mcan_port_set_channel_mask(&config, 0, 0x00, 0x01));
    GOOD(igh_mcan_port_set_channel_mask(&config, 0, 0x0F, 0x0A));
    GOOD(igh_mcan_port_check_config(&igh_config, &config));
    GOOD(igh_mcan_port_get_channel_mask(&config, 0, &enabled, &fd));
    SAME(0x0F, enabled);
    SAME(0x0A, fd);
    direction_masks(&igh_config, config);
    GOOD(igh_mcan_port_set_channel_mask(&config, 0, 0x01, 0x00));
    GOOD(igh_mcan_port_set_classic_channel(&config, 0, 0, 250000));
    GOOD(igh_mcan_port_set_channel_mask(&config, 0, 0x0D, 0x08));
    GOOD(igh_mcan_port_check_config(&igh_config, &config));
    wrong_channel(&config, 1);
    wrong_channel(&config, 4);
    wrong_channel(&config, 255);
    wrong_slave(&config, ECAN_IGH_MAX_SLAVES);
    wrong_slave(&config, SIZE_MAX);

    /* Impossible bit rates and sample points. */
    GOOD(igh_mcan_port_set_classic_channel(&config, 0, 0, 777777));
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_check_config(&igh_config, &config));
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_apply_config(&igh_config, &config));
    ERROR_HAS("777777");
    GOOD(igh_mcan_port_set_classic_channel(&config, 0, 0, 0));
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_check_config(&igh_config, &config));
    GOOD(igh_mcan_port_set_classic_channel(&config, 0, 0, 20000000));
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_check_config(&igh_config, &config));
    GOOD(igh_mcan_port_set_canfd_channel(&config, 0, 0, 1000000, 500000));
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_check_config(&igh_config, &config));
    GOOD(igh_mcan_port_set_canfd_channel(&config, 0, 0, 500000, 2000000));
    GOOD(igh_mcan_port_check_config(&igh_config, &config));
    GOOD(igh_mcan_port_set_sample_points(&config, 0, 0, 990, 800, 990, 800));
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_check_config(&igh_config, &config));
    GOOD(igh_mcan_port_set_sample_points(&config, 0, 0, 750, 875, 750, 875));
    GOOD(igh_mcan_port_set_traffic(&config, 0, 0, 200, 8));
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_check_config(&igh_config, &config));
    GOOD(igh_mcan_port_set_traffic(&config, 0, 0, 4, 4));
    GOOD(igh_mcan_port_check_config(&igh_config, &config));
    GOOD(igh_mcan_port_get_channel_object(&config, 0, 0, 8, &value));

    default_sizes();
    objects(&config);
    gateway_objects();
    filters(&config);
    gateway(&config);
    copy = config;
    GOOD(igh_mcan_port_check_config(&igh_config, &copy));
    GOOD(igh_mcan_port_apply_config(&igh_config, &copy));
    GOOD(igh_mcan_port_apply_config(&igh_config, &config));

    /* TX_RESULT belongs to the TxPDO. */
    igh_mcan_port_set_options(&config, 0, 0, IGH_MCAN_OPTION_TX_RESULT);
    TRUE(ecan_last_error_code() == ECAN_ERR_ARGUMENT ||
         igh_mcan_port_check_config(&igh_config, &config) == ECAN_ERR_CONFIG);
}
