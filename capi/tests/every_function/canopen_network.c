/* igh_canopen.h: a network from a file, its boot-up, and the services of its nodes. */
#include "check.h"

#define CYCLES 6000
#define AXIS 0
#define NODE 1
#define WRONG 2
#define ABSENT 3
#define NODES 4

static ecan_igh_context_t igh;
static igh_mcan_port_t port;
static igh_cia402_context_t motors;

/* An axis, a node, one of another maker, and one that is not there. */
static const char NETWORK[] = "cycle_us = 1000\n"
                              "[[gateway]]\n"
                              "n = 3\n"
                              "can0 = { bitrate = 1_000_000 }\n"
                              "[[node]]\n"
                              "name = \"arm\"\n"
                              "gateway = 0\n"
                              "channel = 0\n"
                              "node = 1\n"
                              "[node.axis]\n"
                              "target_step = 5\n"
                              "[[node]]\n"
                              "name = \"pump\"\n"
                              "gateway = 0\n"
                              "channel = 0\n"
                              "node = 2\n"
                              "[[node]]\n"
                              "name = \"valve\"\n"
                              "gateway = 0\n"
                              "channel = 0\n"
                              "node = 3\n"
                              "vendor_id = 0x99\n"
                              "mandatory = false\n"
                              "[[node]]\n"
                              "name = \"lamp\"\n"
                              "gateway = 0\n"
                              "channel = 0\n"
                              "node = 99\n"
                              "boot_timeout_ms = 200\n"
                              "mandatory = false\n";

static struct {
    unsigned calls;
    unsigned busy;
} seen;

static void on_boot(void *user, size_t node, const char *text)
{
    static const char *const NAMES[NODES] = {"", "pump, node 2", "valve, node 3", "lamp, node 99"};
    uint8_t state;
    TRUE(user == &seen);
    TRUE(node > AXIS && node < NODES);
    TEXT_HAS(NAMES[node], text);
    if (seen.calls++ == 0) {
        BAD(ECAN_ERR_BUSY, igh_canopen_get_boot_state(&motors, &state));
        seen.busy++;
    }
}

static igh_canopen_node_state_t state_of(size_t node)
{
    igh_canopen_node_state_t state;
    fill_garbage(2, &state, sizeof(state));
    GOOD(igh_canopen_get_node_state(&motors, node, &state));
    return state;
}

static igh_canopen_boot_progress_t progress_of(size_t node)
{
    igh_canopen_boot_progress_t progress;
    fill_garbage(2, &progress, sizeof(progress));
    GOOD(igh_canopen_get_boot_progress(&motors, node, &progress));
    return progress;
}

static int boot_state(void)
{
    uint8_t state = 99;
    GOOD(igh_canopen_get_boot_state(&motors, &state));
    return state;
}

static void boot(void)
{
    igh_canopen_boot_progress_t progress;
    char text[256];
    char cut[8];
    size_t node = 99;
    size_t needed;

    SAME(NODES, igh_canopen_node_count(&motors));
    SAME(1, igh_cia402_axis_count(&motors));
    GOOD(igh_canopen_find_node(&motors, 0, 0, 3, &node));
    SAME(WRONG, node);
    SAME(IGH_CANOPEN_BOOT_RUNNING, boot_state());
    SAME(IGH_CANOPEN_BOOT_PHASE_WAITING, progress_of(NODE).phase);
    GOOD(igh_canopen_set_boot_callback(&motors, on_boot, &seen));
    SAME(ECAN_OK, igh_canopen_wait_booted_timeout(&motors, 20000));
    TRUE(seen.calls > 3);
    SAME(1, seen.busy);
    GOOD(igh_canopen_set_boot_callback(&motors, NULL, NULL));
    SAME(IGH_CANOPEN_BOOT_DONE, boot_state());
    progress = progress_of(NODE);
    SAME(IGH_CANOPEN_BOOT_PHASE_BOOTED, progress.phase);
    SAME(1, progress.is_mandatory);
    SAME(0, progress.status);
    SAME(IGH_CANOPEN_BOOT_PHASE_NONE, progress_of(AXIS).phase);
    /* The optional nodes end without the call. */
    run_axes(&port, &motors, 2000);
    progress = progress_of(WRONG);
    SAME(IGH_CANOPEN_BOOT_PHASE_FAILED, progress.phase);
    SAME('D', progress.status);
    SAME(0, progress.is_mandatory);
    SAME('B', progress_of(ABSENT).status);
    SAME(IGH_CANOPEN_BOOT_DONE, boot_state());
    GOOD(igh_canopen_get_boot_text(&motors, WRONG, text, sizeof(text), &needed));
    TEXT_HAS("valve, node 3 (slave 0, channel 0): boot-up failed (status D)", text);
    SAME(strlen(text) + 1, needed);
    BAD(ECAN_ERR_BUFFER, igh_canopen_get_boot_text(&motors, WRONG, cut, sizeof(cut), &needed));
    SAME(strlen(text) + 1, needed);
    GOOD(igh_canopen_get_boot_text(&motors, AXIS, text, sizeof(text), &needed));
    SAME(1, needed);
    SAME(IGH_CANOPEN_NMT_STATE_OPERATIONAL, state_of(NODE).nmt_state);
    SAME(IGH_CANOPEN_HEARTBEAT_ACTIVE, state_of(NODE).heartbeat);
    SAME(2, state_of(NODE).node_id);
    SAME(IGH_CANOPEN_BOOT_PHASE_BOOTED, state_of(NODE).boot_phase);

    GOOD(igh_canopen_boot_again(&motors, NODE));
    SAME(IGH_CANOPEN_BOOT_RUNNING, boot_state());
    for (int i = 0; i < CYCLES && boot_state() == IGH_CANOPEN_BOOT_RUNNING; i++) {
        run_axes(&port, &motors, 1);
    }
    SAME(IGH_CANOPEN_BOOT_DONE, boot_state());
    /* A restart that the application commands. */
    GOOD(igh_canopen_send_nmt(&motors, NODE, IGH_CANOPEN_NMT_RESET_NODE));
    run_axes(&port, &motors, 3000);
    SAME(IGH_CANOPEN_BOOT_DONE, boot_state());
    SAME(1, progress_of(NODE).restarts);
}

/* Runs the cycle until the transfer has ended. */
static int finish(size_t node, uint8_t *data, size_t size, size_t *length)
{
    uint8_t state = IGH_CIA402_SDO_RUNNING;
    for (int i = 0; i < CYCLES && state == IGH_CIA402_SDO_RUNNING; i++) {
        run_axes(&port, &motors, 1);
        (void)igh_canopen_sdo_poll(&motors, node, &state, data, size, length);
    }
    return state;
}

static void sdo(void)
{
    static const uint8_t TIME[2] = {123, 0};
    uint8_t data[8];
    size_t length = 99;

    GOOD(igh_canopen_sdo_start_upload(&motors, NODE, 0x1000, 0));
    BAD(ECAN_ERR_AXIS_STATE, igh_canopen_sdo_start_upload(&motors, NODE, 0x1000, 0));
    SAME(IGH_CIA402_SDO_DONE, finish(NODE, data, sizeof(data), &length));
    SAME(4, length);
    SAME(402, data[0] + 256 * data[1]);
    GOOD(igh_canopen_sdo_start_download(&motors, NODE, 0x1017, 0, TIME, sizeof(TIME)));
    SAME(IGH_CIA402_SDO_DONE, finish(NODE, data, sizeof(data), &length));
    GOOD(igh_canopen_sdo_start_upload(&motors, NODE, 0x5FFF, 0));
    SAME(IGH_CIA402_SDO_FAILED, finish(NODE, data, sizeof(data), &length));
    SAME(ECAN_ERR_SDO, ecan_last_error_code());
    ERROR_HAS("igh_canopen_sdo_poll");
    /* With axes on the Port, nodes of their network. */
    GOOD(igh_canopen_sdo_upload(&port, 0, 0, 2, 0x1017, 0, data, sizeof(data), &length, 2000));
    SAME(2, length);
    SAME(123, data[0]);
    GOOD(igh_canopen_sdo_upload(&port, 0, 0, 1, 0x1000, 0, data, sizeof(data), &length, 2000));
    SAME(402, data[0] + 256 * data[1]);
    BAD(ECAN_ERR_NODE,
        igh_canopen_sdo_upload(&port, 0, 0, 50, 0x1000, 0, data, sizeof(data), &length, 2000));
}

static void parameters(void)
{
    static const uint8_t SPEED[4] = {0x10, 0x27, 0, 0};
    uint8_t kept[4];
    uint8_t data[4];
    size_t length;

    GOOD(igh_canopen_sdo_upload(&port, 0, 0, 2, 0x6081, 0, kept, 4, &length, 2000));
    GOOD(igh_canopen_sdo_download(&port, 0, 0, 2, 0x6081, 0, SPEED, 4, 2000));
    GOOD(igh_canopen_store_parameters(&motors, NODE, IGH_CANOPEN_PARAMETERS_ALL, 10000));
    GOOD(igh_canopen_send_nmt(&motors, NODE, IGH_CANOPEN_NMT_RESET_NODE));
    run_axes(&port, &motors, 3000);
    GOOD(igh_canopen_sdo_upload(&port, 0, 0, 2, 0x6081, 0, data, 4, &length, 2000));
    SAME(0, memcmp(SPEED, data, 4));
    GOOD(igh_canopen_restore_parameters(&motors, NODE, IGH_CANOPEN_PARAMETERS_ALL, 10000));
    GOOD(igh_canopen_boot_again(&motors, NODE));
    GOOD(igh_canopen_wait_booted_timeout(&motors, 20000));
    GOOD(igh_canopen_send_nmt(&motors, NODE, IGH_CANOPEN_NMT_RESET_NODE));
    run_axes(&port, &motors, 3000);
    GOOD(igh_canopen_sdo_upload(&port, 0, 0, 2, 0x6081, 0, data, 4, &length, 2000));
    SAME(0, memcmp(kept, data, 4));
    /* The manufacturer has no such group. */
    BAD(ECAN_ERR_CANOPEN, igh_canopen_store_parameters(&motors, NODE, 100, 2000));
    ERROR_HAS("0x1010:64");
}

static void guarding_and_time(void)
{
    uint8_t data[2];
    size_t length;

    GOOD(igh_canopen_set_guarding(&motors, NODE, 100, 3, 2000));
    GOOD(igh_canopen_sdo_upload(&port, 0, 0, 2, 0x100C, 0, data, 2, &length, 2000));
    SAME(100, data[0]);
    run_axes(&port, &motors, 1000);
    SAME(IGH_CANOPEN_HEARTBEAT_ACTIVE, state_of(NODE).heartbeat);
    SAME(0, state_of(NODE).guard_toggle_errors + state_of(NODE).guard_state_errors);
    GOOD(igh_canopen_set_guarding(&motors, NODE, 0, 0, 2000));
    SAME(IGH_CANOPEN_HEARTBEAT_UNCONFIGURED, state_of(NODE).heartbeat);
    GOOD(igh_canopen_set_time(&motors, 100, 0));
    run_axes(&port, &motors, 300);
    GOOD(igh_canopen_set_time(&motors, 100, 1795527900000000000u));
    run_axes(&port, &motors, 300);
    GOOD(igh_canopen_set_time(&motors, 0, 0));
}

/* The scenario makes two errors of the node at the end of the boot-up. */
static void errors(void)
{
    igh_canopen_emergency_t emergencies[IGH_CANOPEN_MAX_EMERGENCIES];
    igh_canopen_history_entry_t entries[4];
    size_t count = 99;

    for (int i = 0; i < 60000 && state_of(NODE).emergencies < 2; i++) {
        run_axes(&port, &motors, 1);
    }
    SAME(0x2310, state_of(NODE).error_code);
    GOOD(igh_canopen_get_emergencies(&motors, NODE, emergencies, ITEMS(emergencies), &count));
    SAME(2, count);
    SAME(0x2310, emergencies[0].code);
    SAME(0x3210, emergencies[1].code);
    SAME(3, emergencies[0].error_register);
    TRUE(emergencies[0].reserved[0] == 0 && emergencies[0].reserved[1] == 0);
    TRUE(emergencies[0].at_ns > emergencies[1].at_ns);
    GOOD(igh_canopen_get_emergencies(&motors, NODE, emergencies, 1, &count));
    SAME(1, count);
    GOOD(igh_canopen_get_emergencies(&motors, NODE, NULL, 0, &count));
    SAME(0, count);

    GOOD(igh_canopen_read_error_history(&motors, NODE, entries, ITEMS(entries), &count, 2000));
    SAME(2, count);
    SAME(0x2310, entries[0].code);
    SAME(0x3210, entries[1].code);
    SAME(0, entries[1].reserved);
    entries[0].code = 0;
    BAD(ECAN_ERR_BUFFER,
        igh_canopen_read_error_history(&motors, NODE, entries, 1, &count, 2000));
    SAME(2, count);
    SAME(0x2310, entries[0].code);
    GOOD(igh_canopen_clear_error_history(&motors, NODE, 2000));
    GOOD(igh_canopen_read_error_history(&motors, NODE, entries, ITEMS(entries), &count, 2000));
    SAME(0, count);
}

void test_canopen_network(void)
{
    static ecan_igh_config_t igh_config;
    static igh_mcan_port_config_t config;
    igh_cia402_settings_t settings;
    char setting[512];
    char path[512];

    SAME(0, write_scenario("[[gateway]]\nbuses = [\"a\", \"b\", \"c\", \"d\"]\n"
                           "[[node]]\nkind = \"drive\"\nbus = \"a\"\nname = \"1\"\nnode_id = 1\n"
                           "[[node]]\nkind = \"drive\"\nbus = \"a\"\nname = \"2\"\nnode_id = 2\n"
                           "[[node]]\nkind = \"drive\"\nbus = \"a\"\nname = \"3\"\nnode_id = 3\n"
                           "[[fault]]\nat_ms = 60000\nkind = \"drive_emcy\"\nnode = \"2\"\n"
                           "code = 0x3210\nregister = 5\n"
                           "[[fault]]\nat_ms = 60100\nkind = \"drive_emcy\"\nnode = \"2\"\n"
                           "code = 0x2310\nregister = 3\n",
                           setting, sizeof(setting)));
    SAME(0, write_file(NETWORK, path, sizeof(path)));
    simulate(&igh_config, setting);
    GOOD(igh_mcan_port_load_config(&igh_config, &config, path, NULL, 0, NULL));
    GOOD(ecan_igh_init(&igh, &igh_config));
    GOOD(igh_mcan_port_init(&port, &igh, &config));
    GOOD(ecan_igh_wait_op_timeout(&igh, 20000));
    GOOD(igh_cia402_default_settings(&settings));
    settings.host_node_id = 3;
    BAD(ECAN_ERR_CONFIG, igh_cia402_context_init_file(&motors, &port, path, &settings));
    ERROR_HAS("node 3 (slave 0, channel 0) has the node-ID of the host's heartbeat");
    settings.host_node_id = 127;
    settings.reserved[7] = 1;
    BAD(ECAN_ERR_ARGUMENT, igh_cia402_context_init_file(&motors, &port, path, &settings));
    settings.reserved[7] = 0;
    GOOD(igh_cia402_context_init_file(&motors, &port, path, &settings));
    GOOD(igh_cia402_context_deinit(&motors));
    GOOD(igh_cia402_context_init_file(&motors, &port, path, NULL));
    boot();
    sdo();
    parameters();
    guarding_and_time();
    errors();
    GOOD(igh_cia402_start_up_timeout(&motors, 20000));
    SAME(1, igh_cia402_all_running(&motors));
    GOOD(igh_cia402_shutdown_timeout(&motors, 20000));
    GOOD(ecan_igh_deinit(&igh));
    remove_file(path);
    remove_scenario(setting);
}
