/* igh_cia402_protocol.h: SDO transfers with drives and other CANopen nodes. */
#include "check.h"

#define ABORT_NO_OBJECT 0x06020000
#define ABORT_READ_ONLY 0x06010002
#define CYCLES 3000

static const uint8_t VALUE[8] = {100, 0};

static ecan_igh_context_t igh;
static igh_mcan_port_t port;
static igh_cia402_context_t motors;

static void canopen(void)
{
    uint8_t data[16];
    size_t length = 99;

    GOOD(igh_canopen_sdo_upload(&port, 0, 0, 1, 0x1000, 0, data, sizeof(data), &length, 2000));
    SAME(4, length);
    SAME(402, data[0] + 256 * data[1]);
    fill_garbage(2, data, sizeof(data));
    BAD(ECAN_ERR_BUFFER,
        igh_canopen_sdo_upload(&port, 0, 0, 1, 0x1000, 0, data, 3, &length, 2000));
    SAME(4, length);
    BAD(ECAN_ERR_BUFFER,
        igh_canopen_sdo_upload(&port, 0, 0, 1, 0x1000, 0, NULL, 0, &length, 2000));
    SAME(4, length);
    GOOD(igh_canopen_sdo_download(&port, 0, 0, 1, 0x1017, 0, VALUE, 2, 2000));
    GOOD(igh_canopen_sdo_upload(&port, 0, 0, 1, 0x1017, 0, data, 2, &length, 2000));
    SAME(2, length);
    SAME(100, data[0]);
    BAD(ECAN_ERR_SDO,
        igh_canopen_sdo_upload(&port, 0, 0, 1, 0x5FFF, 0, data, 16, &length, 2000));
    SAME(ABORT_NO_OBJECT, ecan_last_abort_code());
    BAD(ECAN_ERR_SDO, igh_canopen_sdo_download(&port, 0, 0, 1, 0x1000, 0, VALUE, 4, 2000));
    SAME(ABORT_READ_ONLY, ecan_last_abort_code());
    BAD(ECAN_ERR_SDO, igh_canopen_sdo_download(&port, 0, 0, 1, 0x5FFF, 0, VALUE, 4, 2000));
    SAME(ABORT_NO_OBJECT, ecan_last_abort_code());

    /* No node has this node-ID. */
    BAD(ECAN_ERR_TIMEOUT,
        igh_canopen_sdo_upload(&port, 0, 0, 99, 0x1000, 0, data, 16, &length, 5000));
    SAME(0, ecan_last_abort_code());
    BAD(ECAN_ERR_TIMEOUT, igh_canopen_sdo_download(&port, 0, 0, 99, 0x1017, 0, VALUE, 2, 100));

    BAD(ECAN_ERR_SLAVE,
        igh_canopen_sdo_upload(&port, 1, 0, 1, 0x1000, 0, data, 16, &length, 100));
    BAD(ECAN_ERR_SLAVE, igh_canopen_sdo_download(&port, SIZE_MAX, 0, 1, 0x1017, 0, VALUE, 2, 9));
    BAD(ECAN_ERR_CHANNEL,
        igh_canopen_sdo_upload(&port, 0, 4, 1, 0x1000, 0, data, 16, &length, 100));
    BAD(ECAN_ERR_CHANNEL, igh_canopen_sdo_download(&port, 0, 255, 1, 0x1017, 0, VALUE, 2, 100));
    BAD(ECAN_ERR_ARGUMENT,
        igh_canopen_sdo_upload(&port, 0, 0, 0, 0x1000, 0, data, 16, &length, 100));
    BAD(ECAN_ERR_ARGUMENT,
        igh_canopen_sdo_upload(&port, 0, 0, 128, 0x1000, 0, data, 16, &length, 100));
    BAD(ECAN_ERR_ARGUMENT, igh_canopen_sdo_download(&port, 0, 0, 0, 0x1017, 0, VALUE, 2, 100));
    /* The channel is not enabled. */
    BAD(ECAN_ERR_CHANNEL,
        igh_canopen_sdo_upload(&port, 0, 3, 1, 0x1000, 0, data, 16, &length, 100));
    BAD(ECAN_ERR_CHANNEL, igh_canopen_sdo_download(&port, 0, 3, 1, 0x1017, 0, VALUE, 2, 100));
}

static void of_an_axis(void)
{
    uint8_t data[16];
    size_t length = 99;

    GOOD(igh_cia402_sdo_upload(&motors, 0, 0x1000, 0, data, sizeof(data), &length, 2000));
    SAME(4, length);
    SAME(402, data[0] + 256 * data[1]);
    BAD(ECAN_ERR_BUFFER, igh_cia402_sdo_upload(&motors, 0, 0x1000, 0, data, 3, &length, 2000));
    SAME(4, length);
    GOOD(igh_cia402_sdo_download(&motors, 0, 0x1017, 0, VALUE, 2, 2000));
    BAD(ECAN_ERR_SDO, igh_cia402_sdo_upload(&motors, 0, 0x5FFF, 0, data, 16, &length, 2000));
    SAME(ABORT_NO_OBJECT, ecan_last_abort_code());
    BAD(ECAN_ERR_SDO, igh_cia402_sdo_download(&motors, 0, 0x1000, 0, VALUE, 4, 2000));
    SAME(ABORT_READ_ONLY, ecan_last_abort_code());
    BAD(ECAN_ERR_TIMEOUT, igh_cia402_sdo_upload(&motors, 1, 0x1000, 0, data, 16, &length, 100));
    SAME(0, ecan_last_abort_code());
    GOOD(igh_canopen_sdo_upload(&port, 0, 0, 1, 0x1000, 0, data, 16, &length, 2000));
    SAME(402, data[0] + 256 * data[1]);
    GOOD(igh_canopen_sdo_download(&port, 0, 0, 1, 0x1017, 0, VALUE, 2, 2000));
    BAD(ECAN_ERR_NODE,
        igh_canopen_sdo_upload(&port, 0, 0, 2, 0x1000, 0, data, 16, &length, 100));
    BAD(ECAN_ERR_NODE, igh_canopen_sdo_download(&port, 0, 0, 2, 0x1017, 0, VALUE, 2, 100));
}

/* Runs the cycle until the transfer is done. */
static int finish(uint8_t *data, size_t size, size_t *length, int *code)
{
    uint8_t state = IGH_CIA402_SDO_RUNNING;
    for (int i = 0; i < CYCLES && state == IGH_CIA402_SDO_RUNNING; i++) {
        run_axes(&port, &motors, 1);
        *code = igh_cia402_sdo_poll(&motors, 0, &state, data, size, length);
    }
    return state;
}

static void in_the_cycle(void)
{
    static const uint8_t LONG[2048];
    uint8_t data[16];
    uint8_t state = 99;
    size_t length = 99;
    int code = -1;

    GOOD(igh_cia402_sdo_start_upload(&motors, 0, 0x1000, 0));
    BAD(ECAN_ERR_AXIS_STATE, igh_cia402_sdo_start_upload(&motors, 0, 0x1000, 0));
    BAD(ECAN_ERR_AXIS_STATE, igh_cia402_sdo_start_download(&motors, 0, 0x1017, 0, VALUE, 2));
    GOOD(igh_cia402_sdo_poll(&motors, 0, &state, NULL, 0, &length));
    SAME(IGH_CIA402_SDO_RUNNING, state);
    SAME(0, length);
    SAME(IGH_CIA402_SDO_DONE, finish(data, sizeof(data), &length, &code));
    SAME(ECAN_OK, code);
    SAME(4, length);
    SAME(402, data[0] + 256 * data[1]);
    BAD(ECAN_ERR_BUFFER, igh_cia402_sdo_poll(&motors, 0, &state, data, 3, &length));
    SAME(4, length);
    BAD(ECAN_ERR_BUFFER, igh_cia402_sdo_poll(&motors, 0, &state, NULL, 0, &length));
    SAME(4, length);

    GOOD(igh_cia402_sdo_start_download(&motors, 0, 0x1017, 0, VALUE, 2));
    SAME(IGH_CIA402_SDO_DONE, finish(data, sizeof(data), &length, &code));
    SAME(ECAN_OK, code);
    BAD(ECAN_ERR_CANOPEN, igh_cia402_sdo_start_download(&motors, 0, 0x1017, 0, LONG, 2048));
    GOOD(igh_cia402_sdo_start_upload(&motors, 0, 0x5FFF, 0));
    SAME(IGH_CIA402_SDO_FAILED, finish(data, sizeof(data), &length, &code));
    SAME(ECAN_OK, code);
    SAME(ECAN_ERR_SDO, ecan_last_error_code());
    SAME(ABORT_NO_OBJECT, ecan_last_abort_code());
    ERROR_HAS("igh_cia402_sdo_poll");
    SAME(0, length);
}

void test_cia402_sdo(void)
{
    static ecan_igh_config_t igh_config;
    static igh_mcan_port_config_t config;
    igh_cia402_axis_t axes[2];
    uint8_t data[4];
    uint8_t state = 99;
    size_t length = 99;

    simulate_channel(&igh_config, &config, "sim", 1000000);
    GOOD(ecan_igh_config_suggest_scenario(&igh_config, "drives"));
    GOOD(igh_mcan_port_apply_config(&igh_config, &config));
    GOOD(ecan_igh_init(&igh, &igh_config));
    GOOD(igh_mcan_port_init(&port, &igh, &config));
    BAD(ECAN_ERR_ORDER,
        igh_canopen_sdo_upload(&port, 0, 0, 1, 0x1000, 0, data, 4, &length, 100));
    BAD(ECAN_ERR_ORDER, igh_canopen_sdo_download(&port, 0, 0, 1, 0x1017, 0, VALUE, 2, 100));
    GOOD(ecan_igh_wait_op_timeout(&igh, 20000));
    canopen();

    GOOD(igh_cia402_axis_init(&axes[0], 0, 0, 1, 0));
    GOOD(igh_cia402_axis_init(&axes[1], 0, 0, 99, 0));
    GOOD(igh_cia402_context_init(&motors, &port, axes, 2));
    GOOD(igh_cia402_sdo_poll(&motors, 0, &state, NULL, 0, &length));
    SAME(IGH_CIA402_SDO_IDLE, state);
    SAME(0, length);
    of_an_axis();
    in_the_cycle();
    /* The message names the absent node. */
    BAD(ECAN_ERR_AXES, igh_cia402_configure_csp_all_timeout(&motors, 10000));
    ERROR_HAS("node 99");
    GOOD(igh_cia402_context_deinit(&motors));
    GOOD(ecan_igh_deinit(&igh));
    BAD(ECAN_ERR_NOT_INITIALISED,
        igh_canopen_sdo_upload(&port, 0, 0, 1, 0x1000, 0, data, 4, &length, 100));
    BAD(ECAN_ERR_NOT_INITIALISED,
        igh_canopen_sdo_download(&port, 0, 0, 1, 0x1017, 0, VALUE, 2, 100));
}
