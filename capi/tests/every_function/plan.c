/* igh_mcan_port.h, igh_cia402_protocol.h: the preflight plan. */
#include "check.h"

static ecan_igh_config_t igh_config;
static igh_mcan_port_config_t config;
static char text[8192];

static void frames(void)
{
    static const uint8_t DATA[8] = {0};
    igh_mcan_frame_stream_t stream[2];

    memset(stream, 0, sizeof(stream));
    GOOD(igh_mcan_tx_frame_set_can(&stream[0].frame, 0, 0, 0x123, 0, DATA, 8));
    stream[0].frames = 4;
    stream[0].cycles = 1;
    stream[0].route = IGH_MCAN_ROUTE_TO_BUS;
    GOOD(igh_mcan_tx_frame_set_can(&stream[1].frame, 0, 0, 0x7FF, IGH_MCAN_FLAG_EXT, DATA, 8));
    stream[1].frames = 1;
    stream[1].cycles = 10;
    stream[1].route = IGH_MCAN_ROUTE_FROM_BUS;
    GOOD(igh_mcan_port_plan(&igh_config, &config, stream, 2, text, sizeof(text), NULL));
    TEXT_HAS("plan for 1 gateway(s), cycle 1000.0 us", text);
    TEXT_HAS("slave 0 LRW 768", text);
    TEXT_HAS("classic, 29 bit, 8 bytes", text);
    TEXT_HAS("no problems found", text);
    GOOD(igh_mcan_port_plan(&igh_config, &config, NULL, 0, NULL, 0, NULL));
    BAD(ECAN_ERR_BUFFER, igh_mcan_port_plan(&igh_config, &config, stream, 2, text, 10, NULL));
    SAME(9, strlen(text));

    /* Eight frames of 135 bits do not fit a millisecond; every fault is reported. */
    stream[0].frames = 8;
    GOOD(ecan_igh_config_set_pdo_multiplier(&igh_config, 12));
    BAD(ECAN_ERR_CONFIG,
        igh_mcan_port_plan(&igh_config, &config, stream, 1, text, sizeof(text), NULL));
    ERROR_HAS("% of the bus");
    ERROR_HAS("1486");
    TEXT_HAS("plan for 1 gateway(s)", text);
    GOOD(ecan_igh_config_set_pdo_multiplier(&igh_config, 3));

    /* A schedule without Sync0. */
    stream[0].frames = 1;
    GOOD(igh_mcan_tx_frame_set_schedule(&stream[0].frame, 100000, 1));
    BAD(ECAN_ERR_CONFIG,
        igh_mcan_port_plan(&igh_config, &config, stream, 1, text, sizeof(text), NULL));
    GOOD(ecan_igh_config_set_dc_sync0(&igh_config, 1000, 700));
    GOOD(igh_mcan_port_plan(&igh_config, &config, stream, 1, text, sizeof(text), NULL));
    TEXT_HAS("leaves at", text);
    GOOD(ecan_igh_config_set_dc_sync0(&igh_config, 0, 0));

    stream[0].route = 3;
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_port_plan(&igh_config, &config, stream, 1, NULL, 0, NULL));
    stream[0].route = 0;
    stream[0].frames = 2;
    stream[0].cycles = 3;
    BAD(ECAN_ERR_ARGUMENT, igh_mcan_port_plan(&igh_config, &config, stream, 1, NULL, 0, NULL));
    stream[0].cycles = 0;
    stream[0].frame.len = 9;
    BAD(ECAN_ERR_FRAME, igh_mcan_port_plan(&igh_config, &config, stream, 1, NULL, 0, NULL));
}

static void axes(void)
{
    igh_cia402_axis_t axis[2];
    static char each_cycle[sizeof(text)];

    memset(axis, 0, sizeof(axis));
    GOOD(igh_cia402_axis_init(&axis[0], 0, 0, 1, 0));
    BAD(ECAN_ERR_NOT_INITIALISED,
        igh_cia402_plan(&igh_config, &config, axis, 2, 1, text, sizeof(text), NULL));
    GOOD(igh_cia402_axis_init(&axis[1], 0, 0, 2, 0));
    GOOD(igh_cia402_plan(&igh_config, &config, axis, 2, 0, text, sizeof(text), NULL));
    TEXT_HAS("slave 0 can0", text);
    memcpy(each_cycle, text, sizeof(text));
    GOOD(igh_cia402_plan(&igh_config, &config, axis, 2, 4, text, sizeof(text), NULL));
    TRUE(strcmp(each_cycle, text) != 0);
    GOOD(igh_cia402_axis_init(&axis[1], 0, 1, 2, 0));
    BAD(ECAN_ERR_CONFIG,
        igh_cia402_plan(&igh_config, &config, axis, 2, 1, text, sizeof(text), NULL));
    ERROR_HAS("channel 1");
}

void test_plan(void)
{
    GOOD(ecan_igh_default_config(&igh_config));
    GOOD(ecan_igh_config_set_cycle_us(&igh_config, 1000));
    GOOD(igh_mcan_port_default_config(&config));
    GOOD(igh_mcan_port_set_classic_channel(&config, 0, 0, 1000000));
    frames();
    axes();
}
