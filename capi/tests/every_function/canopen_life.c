/* igh_canopen.h: invalid contexts, nodes and pointers. */
#include "check.h"

#define NO_NODE 7

static const uint8_t VALUE[2] = {100, 0};

/* Every function of a context rejects an invalid one. */
static void no_context(int code, igh_cia402_context_t *context)
{
    igh_canopen_node_state_t state;
    igh_canopen_boot_progress_t progress;
    igh_canopen_lss_command_t lss;
    igh_canopen_emergency_t emergency;
    igh_canopen_history_entry_t entry;
    char text[64];
    uint8_t data[8];
    uint8_t byte;
    size_t count;

    GOOD(igh_canopen_lss_init(&lss, IGH_CANOPEN_LSS_STORE));
    NONE(code, 0, igh_canopen_node_count(context));
    BAD(code, igh_canopen_find_node(context, 0, 0, 1, &count));
    BAD(code, igh_canopen_add_node(context, 0, 0, 1, &count));
    BAD(code, igh_canopen_add_channel(context, 0, 0));
    BAD(code, igh_canopen_get_node_state(context, 0, &state));
    BAD(code, igh_canopen_send_nmt(context, 0, IGH_CANOPEN_NMT_START));
    BAD(code, igh_canopen_get_boot_state(context, &byte));
    BAD(code, igh_canopen_get_boot_progress(context, 0, &progress));
    BAD(code, igh_canopen_get_boot_text(context, 0, text, sizeof(text), NULL));
    BAD(code, igh_canopen_set_boot_callback(context, NULL, NULL));
    BAD(code, igh_canopen_wait_booted_timeout(context, 100));
    BAD(code, igh_canopen_boot_again(context, IGH_CANOPEN_ALL_NODES));
    BAD(code, igh_canopen_sdo_start_upload(context, 0, 0x1000, 0));
    BAD(code, igh_canopen_sdo_start_download(context, 0, 0x1017, 0, VALUE, 2));
    BAD(code, igh_canopen_sdo_poll(context, 0, &byte, data, 8, &count));
    BAD(code, igh_canopen_set_time(context, 100, 0));
    BAD(code, igh_canopen_set_guarding(context, 0, 100, 3, 100));
    BAD(code, igh_canopen_store_parameters(context, 0, IGH_CANOPEN_PARAMETERS_ALL, 100));
    BAD(code, igh_canopen_restore_parameters(context, 0, IGH_CANOPEN_PARAMETERS_ALL, 100));
    BAD(code, igh_canopen_get_emergencies(context, 0, &emergency, 1, &count));
    BAD(code, igh_canopen_read_error_history(context, 0, &entry, 1, &count, 100));
    BAD(code, igh_canopen_clear_error_history(context, 0, 100));
    BAD(code, igh_canopen_lss_start(context, 0, 0, &lss));
    BAD(code, igh_canopen_lss_poll(context, 0, 0, &byte, NULL));
    BAD(code, igh_canopen_lss_cancel(context, 0, 0));
    BAD(code, igh_canopen_lss_set_times(context, 0, 0, 100, 100, 10));
}

static void wrong_node(igh_cia402_context_t *context, size_t node)
{
    const int code = ECAN_ERR_NODE;
    igh_canopen_node_state_t state;
    igh_canopen_boot_progress_t progress;
    igh_canopen_emergency_t emergency;
    igh_canopen_history_entry_t entry;
    char text[64];
    uint8_t data[8];
    uint8_t byte;
    size_t count;

    BAD(code, igh_canopen_get_node_state(context, node, &state));
    BAD(code, igh_canopen_send_nmt(context, node, IGH_CANOPEN_NMT_START));
    BAD(code, igh_canopen_get_boot_progress(context, node, &progress));
    BAD(code, igh_canopen_get_boot_text(context, node, text, sizeof(text), NULL));
    BAD(code, igh_canopen_boot_again(context, node));
    BAD(code, igh_canopen_sdo_start_upload(context, node, 0x1000, 0));
    BAD(code, igh_canopen_sdo_start_download(context, node, 0x1017, 0, VALUE, 2));
    BAD(code, igh_canopen_sdo_poll(context, node, &byte, data, 8, &count));
    BAD(code, igh_canopen_set_guarding(context, node, 100, 3, 100));
    BAD(code, igh_canopen_set_guarding(context, node, 0, 0, 100));
    BAD(code, igh_canopen_store_parameters(context, node, IGH_CANOPEN_PARAMETERS_ALL, 100));
    BAD(code, igh_canopen_restore_parameters(context, node, IGH_CANOPEN_PARAMETERS_ALL, 100));
    BAD(code, igh_canopen_get_emergencies(context, node, &emergency, 1, &count));
    BAD(code, igh_canopen_read_error_history(context, node, &entry, 1, &count, 100));
    BAD(code, igh_canopen_clear_error_history(context, node, 100));
}

static void arguments(igh_mcan_port_t *port, igh_cia402_context_t *context)
{
    igh_canopen_lss_command_t lss;
    size_t node;

    BAD(ECAN_ERR_ARGUMENT, igh_canopen_find_node(context, 0, 0, 0, &node));
    BAD(ECAN_ERR_ARGUMENT, igh_canopen_find_node(context, 0, 0, 128, &node));
    BAD(ECAN_ERR_NODE, igh_canopen_find_node(context, 0, 0, 2, &node));
    BAD(ECAN_ERR_NODE, igh_canopen_find_node(context, SIZE_MAX, 0, 1, &node));
    BAD(ECAN_ERR_NODE, igh_canopen_find_node(context, 0, 9, 1, &node));
    GOOD(igh_canopen_find_node(context, 0, 0, 1, &node));
    SAME(0, node);
    BAD(ECAN_ERR_ARGUMENT, igh_canopen_add_node(context, 0, 0, 0, NULL));
    BAD(ECAN_ERR_CONFIG, igh_canopen_add_node(context, 0, 0, 1, NULL));
    BAD(ECAN_ERR_CONFIG, igh_canopen_add_node(context, 0, 0, 127, NULL));
    BAD(ECAN_ERR_CHANNEL, igh_canopen_add_node(context, 0, 3, 1, NULL));
    BAD(ECAN_ERR_CHANNEL, igh_canopen_add_node(context, 0, 4, 1, NULL));
    BAD(ECAN_ERR_SLAVE, igh_canopen_add_node(context, 1, 0, 1, NULL));
    BAD(ECAN_ERR_CHANNEL, igh_canopen_add_channel(context, 0, 3));
    BAD(ECAN_ERR_SLAVE, igh_canopen_add_channel(context, SIZE_MAX, 0));
    GOOD(igh_canopen_add_channel(context, 0, 0));
    BAD(ECAN_ERR_ARGUMENT, igh_canopen_send_nmt(context, 0, 3));
    BAD(ECAN_ERR_ORDER, igh_canopen_boot_again(context, 0));
    GOOD(igh_canopen_boot_again(context, IGH_CANOPEN_ALL_NODES));
    BAD(ECAN_ERR_ARGUMENT, igh_canopen_set_time(context, 100, 1));
    GOOD(igh_canopen_set_time(context, 0, 0));
    BAD(ECAN_ERR_ARGUMENT, igh_canopen_set_guarding(context, 0, 0, 3, 100));
    BAD(ECAN_ERR_ARGUMENT, igh_canopen_set_guarding(context, 0, 100, 0, 100));
    BAD(ECAN_ERR_ARGUMENT, igh_canopen_store_parameters(context, 0, 0, 100));
    BAD(ECAN_ERR_ARGUMENT, igh_canopen_restore_parameters(context, 0, 128, 100));

    BAD(ECAN_ERR_ARGUMENT, igh_canopen_lss_init(&lss, 0));
    BAD(ECAN_ERR_ARGUMENT, igh_canopen_lss_init(&lss, 12));
    GOOD(igh_canopen_lss_init(&lss, IGH_CANOPEN_LSS_CONFIGURE_NODE_ID));
    SAME(255, lss.node_id);
    lss.node_id = 128;
    BAD(ECAN_ERR_ARGUMENT, igh_canopen_lss(port, 0, 0, &lss, NULL, 100));
    BAD(ECAN_ERR_ARGUMENT, igh_canopen_lss_start(context, 0, 0, &lss));
    lss.node_id = 5;
    BAD(ECAN_ERR_CHANNEL, igh_canopen_lss(port, 0, 3, &lss, NULL, 100));
    BAD(ECAN_ERR_SLAVE, igh_canopen_lss(port, 1, 0, &lss, NULL, 100));
    BAD(ECAN_ERR_CHANNEL, igh_canopen_lss_start(context, 0, 1, &lss));
    BAD(ECAN_ERR_CHANNEL, igh_canopen_lss_set_times(context, 0, 1, 100, 100, 10));
    BAD(ECAN_ERR_ARGUMENT, igh_canopen_lss_set_times(context, 0, 0, 0, 100, 10));
    BAD(ECAN_ERR_ARGUMENT, igh_canopen_lss_set_times(context, 0, 0, 100, 0, 10));
    BAD(ECAN_ERR_ARGUMENT, igh_canopen_lss_set_times(context, 0, 0, 100, 100, 0));
    GOOD(igh_canopen_lss_set_times(context, 0, 0, 500, 5000, 25));
    /* Calls that wait need an active bus. */
    BAD(ECAN_ERR_ORDER, igh_canopen_lss(port, 0, 0, &lss, NULL, 100));
    BAD(ECAN_ERR_ORDER, igh_canopen_store_parameters(context, 0, 1, 100));
    /* No node boots. */
    GOOD(igh_canopen_wait_booted_timeout(context, 100));
}

static void mpdo(void)
{
    static const uint8_t BYTES[IGH_CANOPEN_MPDO_BYTES] = {0x85, 0x01, 0x20, 3, 1, 2, 0, 0};
    igh_canopen_mpdo_t mpdo;
    uint8_t data[IGH_CANOPEN_MPDO_BYTES];

    memset(&mpdo, 0xA5, sizeof(mpdo));
    GOOD(igh_canopen_mpdo_decode(&mpdo, BYTES, sizeof(BYTES)));
    SAME(0x2001, mpdo.index);
    SAME(3, mpdo.subindex);
    SAME(5, mpdo.node_id);
    SAME(0, mpdo.is_source);
    SAME(2, mpdo.data[1]);
    GOOD(igh_canopen_mpdo_encode(&mpdo, data));
    SAME(0, memcmp(BYTES, data, sizeof(data)));
    mpdo.node_id = 0;
    GOOD(igh_canopen_mpdo_encode(&mpdo, data));
    SAME(0x80, data[0]);
    mpdo.is_source = 1;
    BAD(ECAN_ERR_ARGUMENT, igh_canopen_mpdo_encode(&mpdo, data));
    mpdo.node_id = 7;
    GOOD(igh_canopen_mpdo_encode(&mpdo, data));
    SAME(7, data[0]);
    mpdo.is_source = 2;
    BAD(ECAN_ERR_ARGUMENT, igh_canopen_mpdo_encode(&mpdo, data));
    mpdo.is_source = 0;
    mpdo.node_id = 128;
    BAD(ECAN_ERR_ARGUMENT, igh_canopen_mpdo_encode(&mpdo, data));
    BAD(ECAN_ERR_FRAME, igh_canopen_mpdo_decode(&mpdo, BYTES, 7));
    BAD(ECAN_ERR_FRAME, igh_canopen_mpdo_decode(&mpdo, NULL, 0));
}

void test_canopen_life(void)
{
    static ecan_igh_config_t igh_config;
    static igh_mcan_port_config_t config;
    ecan_igh_context_t igh;
    igh_mcan_port_t port;
    igh_cia402_context_t context;
    igh_cia402_axis_t axis;

    mpdo();
    check_about(NULL);
    simulate_channel(&igh_config, &config, "sim:drives", 1000000);
    GOOD(igh_mcan_port_set_classic_channel(&config, 0, 1, 1000000));
    GOOD(igh_mcan_port_apply_config(&igh_config, &config));
    GOOD(ecan_igh_init(&igh, &igh_config));
    GOOD(igh_mcan_port_init(&port, &igh, &config));
    for (int kind = 0; kind < GARBAGE_KINDS; kind++) {
        check_about(fill_garbage(kind, &context, sizeof(context)));
        no_context(ECAN_ERR_NOT_INITIALISED, &context);
    }
    check_about(NULL);
    GOOD(igh_cia402_axis_init(&axis, 0, 0, 1, 0));
    GOOD(igh_cia402_context_init(&context, &port, &axis, 1));
    SAME(1, igh_canopen_node_count(&context));
    wrong_node(&context, NO_NODE);
    wrong_node(&context, SIZE_MAX);
    arguments(&port, &context);
    BAD(ECAN_ERR_ORDER, igh_cia402_context_init_file(&context, &port, "x", NULL));
    GOOD(igh_cia402_context_deinit(&context));
    check_about("axes that have ended");
    no_context(ECAN_ERR_NOT_INITIALISED, &context);
    check_about(NULL);
    BAD(ECAN_ERR_FILE, igh_cia402_context_init_file(&context, &port, "/no/such/file", NULL));
    ERROR_HAS("/no/such/file");
    GOOD(ecan_igh_deinit(&igh));
}
