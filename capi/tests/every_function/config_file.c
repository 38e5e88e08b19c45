/* igh_mcan_port.h: configurations from a file, and invalid files. */
#include "check.h"

#include <stdlib.h>

static const char SOUND[] = "cycle_us = 2000\n"
                            "[[gateway]]\n"
                            "n = 3\n"
                            "can0 = { bitrate = 500_000 }\n";

static const char FAULTY[] = "cycle_us = \"fast\"\n"
                             "dc = { cycle_us = 10_000, shift_us = 20_000 }\n"
                             "\n"
                             "[[gateway]]\n"
                             "n = 25\n"
                             "tx_pdo = { profile = 3 }\n"
                             "rx_pdo = { options = [\"tx_result\"] }\n"
                             "[gateway.can0]\n"
                             "bitrat = 500_000\n"
                             "sample_point = 101\n"
                             "[gateway.can1]\n"
                             "bitrate = 1_000_000\n"
                             "data_bitrate = 500_000\n"
                             "node_mode = \"quiet\"\n";
/* Locations of its faults, with a part of their texts. */
static const struct {
    uint32_t line, column;
    const char *text;
} FAULTS[] = {{1, 12, "`cycle_us` must be a number, not a string"},
              {2, 38, "Sync0 shift of 20000 us"},
              {5, 5, "`n` = 25 is out of range; allowed: 1 to 24"},
              {6, 22, "allowed: 0, 1, 4, 5"},
              {7, 22, "TX_RESULT"},
              {8, 1, "`bitrate` is missing"},
              {9, 1, "did you mean `bitrate`?"},
              {10, 16, "`sample_point` = 101"},
              {13, 16, "below the nominal"},
              {14, 13, "\"internal_loopback\""}};

static ecan_igh_config_t igh_config;
static igh_mcan_port_config_t config;
static igh_mcan_file_fault_t faults[32];

/* Both configurations are unchanged. */
static void untouched(void)
{
    uint32_t cycle_ns, bitrate;
    GOOD(ecan_igh_config_get_cycle_ns(&igh_config, &cycle_ns));
    SAME(2000000, cycle_ns);
    GOOD(igh_mcan_port_get_channel_object(&config, 0, 0, 19, &bitrate));
    SAME(500000, bitrate);
    GOOD(igh_mcan_port_check_config(&igh_config, &config));
}

static void wrong_pointers(const char *path)
{
    static ecan_igh_config_t none;
    size_t count = 99;
    BAD(ECAN_ERR_NULL, igh_mcan_port_load_config(NULL, &config, path, faults, 32, &count));
    SAME(0, count);
    BAD(ECAN_ERR_ARGUMENT,
        igh_mcan_port_load_config(&igh_config, &config, path, faults, SIZE_MAX, &count));
    for (int kind = 0; kind < GARBAGE_KINDS; kind++) {
        check_about(fill_garbage(kind, &none, sizeof(none)));
        BAD(ECAN_ERR_NOT_INITIALISED,
            igh_mcan_port_load_config(&none, &config, path, NULL, 0, NULL));
        BAD(ECAN_ERR_NOT_INITIALISED,
            igh_mcan_port_load_config(&none, &config, path, faults, 32, &count));
        BAD(ECAN_ERR_NOT_INITIALISED,
            igh_mcan_port_parse_config(&none, &config, SOUND, faults, 32, &count));
    }
    check_about(NULL);
    untouched();
}

static void unreadable(void)
{
    size_t count = 99;
    BAD(ECAN_ERR_FILE,
        igh_mcan_port_load_config(&igh_config, &config, "/no/such/cell.toml", NULL, 0, NULL));
    ERROR_HAS("cannot read /no/such/cell.toml: No such file");
    BAD(ECAN_ERR_FILE, igh_mcan_port_load_config(&igh_config, &config, "/", NULL, 0, NULL));
    ERROR_HAS("directory");
    BAD(ECAN_ERR_FILE, igh_mcan_port_load_config(&igh_config, &config, "", NULL, 0, NULL));
    /* A path need not be UTF-8. */
    BAD(ECAN_ERR_FILE, igh_mcan_port_load_config(&igh_config, &config, "/no/\xFF", NULL, 0, NULL));
    BAD(ECAN_ERR_FILE,
        igh_mcan_port_load_config(&igh_config, &config, "/no/such", faults, 32, &count));
    SAME(0, count);
    untouched();
}

static void reports_all_faults(void)
{
    char path[300];
    size_t count = 0;
    char location[64];

    SAME(0, write_file(FAULTY, path, sizeof(path)));
    fill_garbage(2, faults, sizeof(faults));
    BAD(ECAN_ERR_CONFIG,
        igh_mcan_port_load_config(&igh_config, &config, path, faults, ITEMS(faults), &count));
    SAME(ITEMS(FAULTS), count);
    for (size_t i = 0; i < ITEMS(FAULTS); i++) {
        SAME(FAULTS[i].line, faults[i].line);
        SAME(FAULTS[i].column, faults[i].column);
        TEXT_HAS(FAULTS[i].text, faults[i].reason);
        ERROR_HAS(FAULTS[i].text);
        snprintf(location, sizeof(location), "line %u, column %u: ", (unsigned)FAULTS[i].line,
                 (unsigned)FAULTS[i].column);
        ERROR_HAS(location);
    }
    ERROR_HAS(path);
    BAD(ECAN_ERR_CONFIG, igh_mcan_port_load_config(&igh_config, &config, path, NULL, 0, NULL));
    ERROR_HAS("10 faults");
    remove_file(path);

    /* Not more than the capacity, and all are counted. */
    fill_garbage(2, faults, sizeof(faults));
    BAD(ECAN_ERR_CONFIG,
        igh_mcan_port_parse_config(&igh_config, &config, FAULTY, faults, 2, &count));
    SAME(ITEMS(FAULTS), count);
    SAME(2, faults[1].line);
    SAME(0xA5A5A5A5, faults[2].line);
    BAD(ECAN_ERR_CONFIG,
        igh_mcan_port_parse_config(&igh_config, &config, FAULTY, NULL, 0, NULL));
    BAD(ECAN_ERR_CONFIG,
        igh_mcan_port_parse_config(&igh_config, &config, FAULTY, NULL, 0, &count));
    SAME(ITEMS(FAULTS), count);
    untouched();
}

/* A comment in Latin-1, as of an old editor. */
static void no_text(void)
{
    size_t count = 0;
    BAD(ECAN_ERR_CONFIG,
        igh_mcan_port_parse_config(&igh_config, &config, "master = 0\n# 10 \xB5s\n", faults,
                                   ITEMS(faults), &count));
    TRUE(count > 0);
    ERROR_HAS("line 2, column 6: byte 0xB5 is not UTF-8");
    BAD(ECAN_ERR_CONFIG,
        igh_mcan_port_parse_config(&igh_config, &config, "", faults, ITEMS(faults), &count));
    ERROR_HAS("no slave is configured");
    BAD(ECAN_ERR_CONFIG,
        igh_mcan_port_parse_config(&igh_config, &config, "[[[", faults, ITEMS(faults), &count));
    untouched();
}

/* More faults than the text of an error can hold. */
static void many_faults(void)
{
    enum { MANY = 2000 };
    size_t count = 0;
    char *text = malloc(32 * MANY + 64);
    igh_mcan_file_fault_t *all = malloc(MANY * sizeof(*all));
    char *end = text + sprintf(text, "gateway = [{ n = 3, can0 = { bitrate = 500_000 } }]\n");
    for (int i = 0; i < MANY; i++) {
        end += sprintf(end, "key_%d = 1\n", i);
    }
    BAD(ECAN_ERR_CONFIG,
        igh_mcan_port_parse_config(&igh_config, &config, text, all, MANY, &count));
    SAME(MANY, count);
    SAME(MANY + 1, all[MANY - 1].line);
    TEXT_HAS("`key_1999`", all[MANY - 1].reason);
    free(all);
    free(text);
    untouched();
}

/* Files with more gateways or filters than a configuration may have. */
static void too_much(void)
{
    enum { FILTERS = 64, GATEWAYS = 9 };
    size_t count = 0;
    char *text = malloc(GATEWAYS * FILTERS * 80 + 4096);
    char *end = text + sprintf(text, "cycle_us = 100_000\nwatchdog_us = 1_000_000\n");
    for (int i = 0; i < ECAN_IGH_MAX_SLAVES + 1; i++) {
        end += sprintf(end, "[[gateway]]\nn = 1\ncan0 = { bitrate = 500_000 }\n");
    }
    BAD(ECAN_ERR_CONFIG,
        igh_mcan_port_parse_config(&igh_config, &config, text, faults, 32, &count));
    ERROR_HAS("too many gateways");
    SAME(1, count);
    end = text + sprintf(text, "cycle_us = 100_000\nwatchdog_us = 1_000_000\n");
    for (int i = 0; i < GATEWAYS; i++) {
        end += sprintf(end, "[[gateway]]\nn = 1\n[gateway.can0]\nbitrate = 500_000\n"
                            "standard_filter = [");
        for (int filter = 0; filter < FILTERS; filter++) {
            end += sprintf(end, "{ match = \"two\", action = \"fifo0\", id1 = 1, id2 = 2 }, ");
        }
        end += sprintf(end, "]\n");
    }
    BAD(ECAN_ERR_CONFIG,
        igh_mcan_port_parse_config(&igh_config, &config, text, faults, 32, &count));
    ERROR_HAS("512 filters");
    SAME(1, count);
    free(text);
    untouched();
}

/* Previous content of the configurations does not mix with the file. */
static void replaced(const char *path)
{
    static const uint8_t VALUE[4] = {1};
    char setting[ECAN_IGH_MAX_SETTING];
    uint8_t enabled, fd;
    uint16_t alias, position;
    uint32_t rx_n, tx_n;
    size_t count;

    GOOD(ecan_igh_config_set_ecrt(&igh_config, "sim:echo"));
    GOOD(ecan_igh_config_set_slave_count(&igh_config, 3));
    GOOD(ecan_igh_config_set_slave_position(&igh_config, 0, 7, 7));
    GOOD(ecan_igh_config_set_pdo_multiplier(&igh_config, 5));
    GOOD(ecan_igh_config_set_dc_sync0(&igh_config, 7000, 0));
    GOOD(igh_mcan_port_set_channel_mask(&config, 0, 0x0F, 0x0F));
    GOOD(igh_mcan_port_add_standard_filter(&config, 0, 0, 1, 1, 1, 2));
    for (size_t i = 0; i < ECAN_IGH_MAX_STARTUP_SDOS; i++) {
        GOOD(ecan_igh_config_add_startup_sdo(&igh_config, 0, 0x2000, 1, VALUE, 1));
    }
    GOOD(igh_mcan_port_load_config(&igh_config, &config, path, NULL, 0, NULL));
    GOOD(ecan_igh_config_get_ecrt(&igh_config, setting, sizeof(setting), NULL));
    TRUE(strcmp(setting, "sim:echo") == 0);
    GOOD(ecan_igh_config_get_slave_count(&igh_config, &count));
    SAME(1, count);
    GOOD(ecan_igh_config_get_slave_position(&igh_config, 0, &alias, &position));
    SAME(0, alias);
    SAME(0, position);
    GOOD(ecan_igh_config_get_slave_pdo_multipliers(&igh_config, 0, &rx_n, &tx_n));
    SAME(3, rx_n);
    SAME(3, tx_n);
    BAD(ECAN_ERR_ORDER, ecan_igh_config_set_dc_source(&igh_config, ECAN_IGH_CLOCK_HOST));
    GOOD(igh_mcan_port_get_channel_mask(&config, 0, &enabled, &fd));
    SAME(0x01, enabled);
    SAME(0, fd);
    GOOD(ecan_igh_config_add_startup_sdo(&igh_config, 0, 0x2000, 1, VALUE, 1));
    untouched();
}

void test_config_file(void)
{
    char path[300];
    size_t count = 99;

    SAME(0, write_file(SOUND, path, sizeof(path)));
    for (int kind = 0; kind < GARBAGE_KINDS; kind++) {
        check_about(fill_garbage(kind, &config, sizeof(config)));
        GOOD(ecan_igh_default_config(&igh_config));
        GOOD(igh_mcan_port_load_config(&igh_config, &config, path, NULL, 0, NULL));
        untouched();
        fill_garbage(kind, &config, sizeof(config));
        GOOD(igh_mcan_port_load_config(&igh_config, &config, path, NULL, 0, &count));
        SAME(0, count);
        untouched();
        fill_garbage(kind, &config, sizeof(config));
        GOOD(igh_mcan_port_parse_config(&igh_config, &config, SOUND, faults, 32, &count));
        untouched();
    }
    check_about(NULL);
    wrong_pointers(path);
    unreadable();
    reports_all_faults();
    no_text();
    many_faults();
    too_much();
    replaced(path);
    remove_file(path);
}
