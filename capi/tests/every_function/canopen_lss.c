/* igh_canopen.h: LSS with slaves that have no node-ID. */
#include "check.h"

#define CYCLES 6000

static ecan_igh_context_t igh;
static igh_mcan_port_t port;
static igh_cia402_context_t motors;

static igh_canopen_lss_command_t command_of(uint8_t service)
{
    igh_canopen_lss_command_t command;
    fill_garbage(2, &command, sizeof(command));
    GOOD(igh_canopen_lss_init(&command, service));
    return command;
}

/* Executes a command of the channel on which the slaves are. */
static igh_canopen_lss_result_t lss(const igh_canopen_lss_command_t *command)
{
    igh_canopen_lss_result_t result;
    fill_garbage(2, &result, sizeof(result));
    GOOD(igh_canopen_lss(&port, 0, 0, command, &result, 20000));
    SAME(0, result.reserved[0] | result.reserved[sizeof(result.reserved) - 1]);
    return result;
}

static igh_canopen_lss_result_t simple(uint8_t service)
{
    igh_canopen_lss_command_t command = command_of(service);
    return lss(&command);
}

/* Gives the slave with the lowest address a node-ID. */
static igh_canopen_lss_address_t commission(uint8_t node_id)
{
    igh_canopen_lss_command_t command = command_of(IGH_CANOPEN_LSS_CONFIGURE_NODE_ID);
    igh_canopen_lss_result_t found = simple(IGH_CANOPEN_LSS_FASTSCAN);
    SAME(IGH_CANOPEN_LSS_OUTCOME_ADDRESS, found.outcome);
    SAME(IGH_CANOPEN_LSS_OUTCOME_NODE_ID, simple(IGH_CANOPEN_LSS_INQUIRE_NODE_ID).outcome);
    SAME(255, simple(IGH_CANOPEN_LSS_INQUIRE_NODE_ID).node_id);
    command.node_id = node_id;
    SAME(IGH_CANOPEN_LSS_OUTCOME_DONE, lss(&command).outcome);
    SAME(IGH_CANOPEN_LSS_OUTCOME_DONE, simple(IGH_CANOPEN_LSS_STORE).outcome);
    SAME(found.address.serial_number,
         simple(IGH_CANOPEN_LSS_INQUIRE_ADDRESS).address.serial_number);
    SAME(IGH_CANOPEN_LSS_OUTCOME_DONE, simple(IGH_CANOPEN_LSS_SWITCH_GLOBAL).outcome);
    return found.address;
}

static void without_axes(void)
{
    igh_canopen_lss_command_t command;
    igh_canopen_lss_address_t address;
    uint8_t data[4];
    size_t length;

    SAME(IGH_CANOPEN_LSS_OUTCOME_FOUND, simple(IGH_CANOPEN_LSS_IDENTIFY_NON_CONFIGURED).outcome);
    address = commission(5);
    SAME(11, address.serial_number);
    /* It boots. */
    for (int i = 0; i < 500; i++) {
        GOOD(igh_mcan_port_wait_next_cycle(&port));
        GOOD(igh_mcan_port_cycle_begin(&port));
        GOOD(igh_mcan_port_cycle_end(&port));
    }
    GOOD(igh_canopen_sdo_upload(&port, 0, 0, 5, 0x1018, 4, data, 4, &length, 5000));
    SAME(11, data[0]);

    /* Selected by its address: a bit rate that it does not have is rejected. */
    command = command_of(IGH_CANOPEN_LSS_SWITCH_SELECTIVE);
    command.address = address;
    SAME(IGH_CANOPEN_LSS_OUTCOME_DONE, lss(&command).outcome);
    SAME(5, simple(IGH_CANOPEN_LSS_INQUIRE_NODE_ID).node_id);
    command = command_of(IGH_CANOPEN_LSS_CONFIGURE_BIT_RATE);
    command.bit_rate = 100000;
    BAD(ECAN_ERR_ARGUMENT, igh_canopen_lss(&port, 0, 0, &command, NULL, 1000));
    command.bit_rate = 1000000;
    GOOD(igh_canopen_lss(&port, 0, 0, &command, NULL, 1000));
    command = command_of(IGH_CANOPEN_LSS_ACTIVATE_BIT_RATE);
    command.delay_ms = 20;
    GOOD(igh_canopen_lss(&port, 0, 0, &command, NULL, 1000));
    SAME(IGH_CANOPEN_LSS_OUTCOME_DONE, simple(IGH_CANOPEN_LSS_SWITCH_GLOBAL).outcome);

    command = command_of(IGH_CANOPEN_LSS_IDENTIFY);
    command.address = address;
    command.address.serial_number = 1;
    command.serial_max = 10;
    SAME(IGH_CANOPEN_LSS_OUTCOME_NOT_FOUND, lss(&command).outcome);
    command.serial_max = 11;
    SAME(IGH_CANOPEN_LSS_OUTCOME_FOUND, lss(&command).outcome);
    /* No slave has this address, and none is in the configuration state. */
    command = command_of(IGH_CANOPEN_LSS_SWITCH_SELECTIVE);
    BAD(ECAN_ERR_TIMEOUT, igh_canopen_lss(&port, 0, 0, &command, NULL, 5000));
    command = command_of(IGH_CANOPEN_LSS_STORE);
    BAD(ECAN_ERR_TIMEOUT, igh_canopen_lss(&port, 0, 0, &command, NULL, 10000));
}

/* Runs the cycle until the command has ended. */
static int finish(igh_canopen_lss_result_t *result)
{
    uint8_t state = IGH_CANOPEN_LSS_RUNNING;
    for (int i = 0; i < CYCLES && state == IGH_CANOPEN_LSS_RUNNING; i++) {
        run_axes(&port, &motors, 1);
        SAME(ECAN_OK, igh_canopen_lss_poll(&motors, 0, 0, &state, result));
    }
    return state;
}

static void in_the_cycle(void)
{
    igh_canopen_lss_command_t command = command_of(IGH_CANOPEN_LSS_FASTSCAN);
    igh_canopen_lss_result_t result;
    uint8_t state = 99;

    GOOD(igh_cia402_context_init(&motors, &port, NULL, 0));
    BAD(ECAN_ERR_CHANNEL, igh_canopen_lss_start(&motors, 0, 0, &command));
    GOOD(igh_canopen_add_channel(&motors, 0, 0));
    GOOD(igh_canopen_lss_poll(&motors, 0, 0, &state, &result));
    SAME(IGH_CANOPEN_LSS_IDLE, state);
    SAME(IGH_CANOPEN_LSS_OUTCOME_NONE, result.outcome);
    GOOD(igh_canopen_lss_set_times(&motors, 0, 0, 500, 5000, 10));
    command.known = IGH_CANOPEN_LSS_KNOWN_VENDOR_ID;
    command.address.vendor_id = 0x53494D00;
    GOOD(igh_canopen_lss_start(&motors, 0, 0, &command));
    BAD(ECAN_ERR_ORDER, igh_canopen_lss_start(&motors, 0, 0, &command));
    SAME(IGH_CANOPEN_LSS_DONE, finish(&result));
    SAME(IGH_CANOPEN_LSS_OUTCOME_ADDRESS, result.outcome);
    SAME(12, result.address.serial_number);
    SAME(0x53494D00, result.address.vendor_id);

    /* A rejected command, with its reason. */
    command = command_of(IGH_CANOPEN_LSS_CONFIGURE_BIT_RATE);
    command.bit_rate = 0;
    GOOD(igh_canopen_lss_start(&motors, 0, 0, &command));
    SAME(IGH_CANOPEN_LSS_FAILED, finish(&result));
    SAME(IGH_CANOPEN_LSS_OUTCOME_NONE, result.outcome);
    SAME(ECAN_ERR_CANOPEN, ecan_last_error_code());
    ERROR_HAS("igh_canopen_lss_poll: LSS on slave 0 channel 0");
    BAD(ECAN_ERR_CANOPEN, igh_canopen_lss(&port, 0, 0, &command, NULL, 1000));

    command = command_of(IGH_CANOPEN_LSS_INQUIRE_ADDRESS);
    GOOD(igh_canopen_lss_start(&motors, 0, 0, &command));
    GOOD(igh_canopen_lss_cancel(&motors, 0, 0));
    SAME(ECAN_OK, igh_canopen_lss_poll(&motors, 0, 0, &state, NULL));
    SAME(IGH_CANOPEN_LSS_FAILED, state);
    ERROR_HAS("cancelled");

    /* With axes on the Port, the waiting call serves them. */
    command = command_of(IGH_CANOPEN_LSS_CONFIGURE_NODE_ID);
    command.node_id = 6;
    GOOD(igh_canopen_lss(&port, 0, 0, &command, &result, 2000));
    SAME(IGH_CANOPEN_LSS_OUTCOME_DONE, simple(IGH_CANOPEN_LSS_SWITCH_GLOBAL).outcome);
    GOOD(igh_cia402_context_deinit(&motors));
}

void test_canopen_lss(void)
{
    static ecan_igh_config_t igh_config;
    static igh_mcan_port_config_t config;
    char setting[512];

    SAME(0, write_scenario("[[gateway]]\nbuses = [\"a\", \"b\", \"c\", \"d\"]\n"
                           "[[node]]\nkind = \"drive\"\nbus = \"a\"\nname = \"1\"\nnode_id = 1\n"
                           "serial = 11\n[node.quirks]\nwithout_node_id = true\n"
                           "[[node]]\nkind = \"drive\"\nbus = \"a\"\nname = \"2\"\nnode_id = 2\n"
                           "serial = 12\n[node.quirks]\nwithout_node_id = true\n",
                           setting, sizeof(setting)));
    simulate_channel(&igh_config, &config, setting, 1000000);
    SAME(0, start_port(&igh, &port, &igh_config, &config));
    without_axes();
    in_the_cycle();
    GOOD(ecan_igh_deinit(&igh));
    remove_scenario(setting);
}
