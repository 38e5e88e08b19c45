/* ecan_igh_stop_waiting_when(): the waiting calls of every layer end, and can be called again. */
#include "check.h"

static ecan_igh_context_t igh;
static igh_mcan_port_t port;
static igh_cia402_context_t motors;

/* Number of cycles until the stop. */
static int cycles_left;

static int stop(void *user)
{
    TRUE(user == &cycles_left);
    BAD(ECAN_ERR_BUSY, ecan_igh_deinit(&igh));
    return cycles_left-- <= 0;
}

static void stop_after(int cycles)
{
    cycles_left = cycles;
    GOOD(ecan_igh_stop_waiting_when(&igh, stop, &cycles_left));
}

static void stop_startup(void)
{
    stop_after(5);
    BAD(ECAN_ERR_STOPPED, ecan_igh_wait_op_timeout(&igh, 20000));
    SAME(-1, cycles_left);
    GOOD(ecan_igh_stop_waiting_when(&igh, NULL, NULL));
    GOOD(ecan_igh_wait_op_timeout(&igh, 20000));
}

static void stop_axes(void)
{
    igh_cia402_axis_t axis;
    GOOD(igh_cia402_axis_init(&axis, 0, 0, 1, 0));
    GOOD(igh_cia402_context_init(&motors, &port, &axis, 1));
    stop_after(3);
    BAD(ECAN_ERR_STOPPED, igh_cia402_start_up_timeout(&motors, 20000));
    stop_after(0);
    BAD(ECAN_ERR_STOPPED, igh_cia402_configure_csp_all_timeout(&motors, 20000));
    GOOD(ecan_igh_stop_waiting_when(&igh, NULL, NULL));
    GOOD(igh_cia402_start_up_timeout(&motors, 20000));
    /* An orderly shutdown is not stopped. */
    stop_after(0);
    GOOD(igh_cia402_shutdown_timeout(&motors, 20000));
    SAME(0, cycles_left);
}

/* Calls until the stop, of the function in the configuration. */
static int calls_left;

static int stop_init(void *user)
{
    TRUE(user == &calls_left);
    return --calls_left <= 0;
}

/* The master waits for a slave that is not on the bus; the function in the configuration ends that, and
 * stays in force. */
static void stop_opening(void)
{
    static ecan_igh_config_t config;
    static igh_mcan_port_config_t gateways;
    ecan_igh_config_t copy;
    char setting[256];

    SAME(0, write_scenario("name = \"one\"\n[[gateway]]\n", setting, sizeof(setting)));
    simulate(&config, setting);
    GOOD(ecan_igh_config_set_slave_count(&config, 2));
    GOOD(ecan_igh_config_set_preop_timeout_ms(&config, 60000));
    GOOD(ecan_igh_config_stop_waiting_when(&config, stop_init, &calls_left));
    copy = config;
    calls_left = 10;
    BAD(ECAN_ERR_STOPPED, ecan_igh_init(&igh, &copy));
    SAME(0, calls_left);
    BAD(ECAN_ERR_NOT_INITIALISED, ecan_igh_receive(&igh));
    GOOD(ecan_igh_config_set_slave_count(&config, 1));
    GOOD(igh_mcan_port_default_config(&gateways));
    GOOD(igh_mcan_port_set_classic_channel(&gateways, 0, 0, 1000000));
    GOOD(igh_mcan_port_apply_config(&config, &gateways));
    calls_left = 1000;
    GOOD(ecan_igh_init(&igh, &config));
    calls_left = 3;
    BAD(ECAN_ERR_STOPPED, ecan_igh_wait_op_timeout(&igh, 20000));
    GOOD(ecan_igh_deinit(&igh));
    calls_left = 0;
    GOOD(ecan_igh_config_stop_waiting_when(&config, NULL, NULL));
    GOOD(ecan_igh_init(&igh, &config));
    GOOD(ecan_igh_wait_op_timeout(&igh, 20000));
    GOOD(ecan_igh_deinit(&igh));
    remove_scenario(setting);
}

void test_stop(void)
{
    ecan_igh_config_t config;
    igh_mcan_port_config_t gateways;

    memset(&igh, 0, sizeof(igh));
    BAD(ECAN_ERR_NOT_INITIALISED, ecan_igh_stop_waiting_when(&igh, stop, NULL));

    simulate_channel(&config, &gateways, "sim:drives", 1000000);
    GOOD(igh_mcan_port_apply_config(&config, &gateways));
    GOOD(ecan_igh_init(&igh, &config));
    GOOD(igh_mcan_port_init(&port, &igh, &gateways));
    stop_startup();
    stop_axes();
    GOOD(ecan_igh_deinit(&igh));
    stop_opening();
}
