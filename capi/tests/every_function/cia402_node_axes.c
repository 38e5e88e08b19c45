/* igh_cia402_protocol.h and igh_canopen.h: several axes of a node, COB-IDs, node guarding. */
#include "check.h"

/* A drive with two axes, and one without heartbeat. */
#define FIRST 0
#define SECOND 1
#define GUARDED 2
#define AXES 3
#define NODES 2

static ecan_igh_context_t igh;
static igh_mcan_port_t port;
static igh_cia402_context_t motors;
static igh_cia402_axis_t axes[AXES];

static const char SCENARIO[] = "[[gateway]]\n"
                               "buses = [\"a\", \"b\", \"c\", \"d\"]\n"
                               "[[node]]\n"
                               "kind = \"drive\"\n"
                               "bus = \"a\"\n"
                               "name = \"both\"\n"
                               "node_id = 1\n"
                               "axes = 2\n"
                               "[[node]]\n"
                               "kind = \"drive\"\n"
                               "bus = \"a\"\n"
                               "name = \"guarded\"\n"
                               "node_id = 2\n"
                               "quirks = { missing = [0x1016, 0x1017] }\n";

static void init_axes(void)
{
    GOOD(igh_cia402_axis_init(&axes[FIRST], 0, 0, 1, 40));
    GOOD(igh_cia402_axis_init(&axes[SECOND], 0, 0, 1, -20));
    axes[SECOND].node_axis = 1;
    axes[SECOND].pdo_number = 65;
    axes[SECOND].rpdo_cob_ids[0] = 0x301;
    axes[SECOND].tpdo_cob_ids[0] = 0x281;
    GOOD(igh_cia402_axis_init(&axes[GUARDED], 0, 0, 2, 10));
    axes[GUARDED].guard_time_ms = 20;
    axes[GUARDED].life_time_factor = 5;
}

static void cycles(int count)
{
    for (int i = 0; i < count; i++) {
        begin_axes(&port, &motors);
        GOOD(igh_cia402_send_target_step(&motors));
        GOOD(igh_mcan_port_cycle_end(&port));
    }
}

static int32_t actual_of(size_t axis)
{
    igh_cia402_axis_state_t state;
    GOOD(igh_cia402_get_axis_state(&motors, axis, &state));
    return state.actual;
}

/* The network has each node once, however many axes it has. */
static void nodes(void)
{
    igh_canopen_node_state_t state;
    size_t node = 99;

    SAME(AXES, igh_cia402_axis_count(&motors));
    SAME(NODES, igh_canopen_node_count(&motors));
    GOOD(igh_canopen_find_node(&motors, 0, 0, 1, &node));
    SAME(0, node);
    GOOD(igh_canopen_find_node(&motors, 0, 0, 2, &node));
    SAME(1, node);
    GOOD(igh_canopen_get_node_state(&motors, 1, &state));
    SAME(2, state.node_id);
    BAD(ECAN_ERR_NODE, igh_canopen_get_node_state(&motors, NODES, &state));
    BAD(ECAN_ERR_CONFIG, igh_canopen_add_node(&motors, 0, 0, 1, NULL));
    GOOD(igh_canopen_add_node(&motors, 0, 0, 9, &node));
    SAME(NODES, node);
}

static void motion(void)
{
    int32_t from[AXES];

    for (size_t axis = 0; axis < AXES; axis++) {
        from[axis] = actual_of(axis);
    }
    cycles(300);
    TRUE(actual_of(FIRST) > from[FIRST] + 5000);
    TRUE(actual_of(SECOND) < from[SECOND] - 2500);
    TRUE(actual_of(GUARDED) > from[GUARDED] + 1200);
    SAME(1, igh_cia402_all_running(&motors));
    SAME(0x201, axis_object(&motors, FIRST, 0x1400, 1) & 0x7FF);
    SAME(0x301, axis_object(&motors, SECOND, 0x1440, 1) & 0x7FF);
    SAME(0x281, axis_object(&motors, SECOND, 0x1840, 1) & 0x7FF);
}

static void guarding(void)
{
    igh_cia402_host_loss_info_t loss;
    igh_canopen_node_state_t state;
    char text[256];

    GOOD(igh_cia402_get_host_loss(&motors, GUARDED, &loss));
    SAME(IGH_CIA402_HOST_WATCH_GUARDED, loss.watch);
    SAME(100, loss.watch_ms);
    GOOD(igh_cia402_get_host_loss_text(&motors, GUARDED, text, sizeof(text), NULL));
    TEXT_HAS("detected after 100 ms without a guarding request", text);
    GOOD(igh_cia402_get_host_loss(&motors, FIRST, &loss));
    SAME(IGH_CIA402_HOST_WATCH_ACTIVE, loss.watch);
    GOOD(igh_canopen_get_node_state(&motors, 1, &state));
    SAME(IGH_CANOPEN_HEARTBEAT_ACTIVE, state.heartbeat);
    SAME(0, state.heartbeat_timeouts);
    SAME(20, axis_object(&motors, GUARDED, 0x100C, 0));
    SAME(5, axis_object(&motors, GUARDED, 0x100D, 0));
}

static void faults(void)
{
#define FAULTY(part, field, value)                                                                 \
    do {                                                                                           \
        check_about(#field " = " #value);                                                          \
        init_axes();                                                                               \
        axes[SECOND].field = (value);                                                              \
        BAD(ECAN_ERR_CONFIG, igh_cia402_context_init(&motors, &port, axes, AXES));                 \
        ERROR_HAS(part);                                                                           \
        check_about(NULL);                                                                         \
    } while (0)
    FAULTY("axis 8 of the node is out of range", node_axis, 8);
    FAULTY("axis 1", node_axis, 0);
    FAULTY("PDO number 513 is out of range", pdo_number, 513);
    FAULTY("invalid value 2048 for `rpdo_cob_ids`", rpdo_cob_ids[0], 0x800);
    FAULTY("invalid value 0 for `tpdo_cob_ids`", tpdo_cob_ids[2], 0x282);
    FAULTY("COB-ID 0x201 is that of a PDO of axis 0", rpdo_cob_ids[0], 0x201);
    FAULTY("COB-ID", tpdo_cob_ids[0], 0x581);
    FAULTY("COB-ID", tpdo_cob_ids[1], 0x282);
    FAULTY("guard", guard_time_ms, 20);
    FAULTY("guard", life_time_factor, 5);
    FAULTY("heartbeats", heartbeat_ms, 50);
#undef FAULTY
}

void test_cia402_node_axes(void)
{
    static ecan_igh_config_t igh_config;
    static igh_mcan_port_config_t config;
    char setting[512];

    SAME(0, write_scenario(SCENARIO, setting, sizeof(setting)));
    simulate_channel(&igh_config, &config, setting, 1000000);
    SAME(0, start_port(&igh, &port, &igh_config, &config));
    faults();
    init_axes();
    GOOD(igh_cia402_context_init(&motors, &port, axes, AXES));
    GOOD(igh_cia402_start_up_timeout(&motors, 30000));
    motion();
    guarding();
    nodes();
    SAME(ECAN_OK, igh_cia402_shutdown_timeout(&motors, 20000));
    GOOD(ecan_igh_deinit(&igh));
    remove_scenario(setting);
}
