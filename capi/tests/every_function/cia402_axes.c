/* igh_cia402_protocol.h: axis table, settings, contexts, and invalid calls. */
#include "check.h"

static const uint8_t VALUE[4] = {1};

/* Every function of a context rejects an invalid one. */
static void no_context(int code, igh_cia402_context_t *context)
{
    igh_mcan_rx_frame_t rx;
    igh_cia402_send_summary_t summary;
    igh_cia402_homing_t homing;
    igh_cia402_axis_state_t state;
    igh_cia402_axis_statistics_t statistics;
    igh_cia402_host_loss_info_t loss;
    igh_cia402_bus_load_t load;
    igh_cia402_probe_t probe;
    igh_cia402_drive_limits_t limits;
    igh_cia402_drive_units_t units;
    char text[64];
    uint8_t data[8];
    uint8_t sdo_state;
    size_t count;

    GOOD(igh_cia402_homing_init(&homing, 35));
    NONE(code, 0, igh_cia402_axis_count(context));
    BAD(code, igh_cia402_set_progress_callback(context, NULL, NULL));
    BAD(code, igh_cia402_configure_csp_all_timeout(context, 100));
    BAD(code, igh_cia402_request_actual_position_all_timeout(context, 100));
    BAD(code, igh_cia402_enable_all_timeout(context, 100));
    BAD(code, igh_cia402_start_up_timeout(context, 100));
    BAD(code, igh_cia402_finish_all_timeout(context, 100));
    BAD(code, igh_cia402_stop_all_timeout(context, 100));
    BAD(code, igh_cia402_set_stop_time_ms(context, 100));
    BAD(code, igh_cia402_recover_all_timeout(context, 100));
    BAD(code, igh_cia402_shutdown_timeout(context, 100));
    BAD(code, igh_cia402_process_rx(context));
    BAD(code, igh_cia402_process_rx_ex(context, &rx, 1, &count));
    BAD(code, igh_cia402_send_targets_all(context));
    BAD(code, igh_cia402_send_target_step(context));
    BAD(code, igh_cia402_get_send_summary(context, &summary));
    BAD(code, igh_cia402_set_motion_div(context, 1));
    BAD(code, igh_cia402_set_scheduled_tx(context, 0, 0, 0));
    BAD(code, igh_cia402_set_target(context, 0, 0));
    BAD(code, igh_cia402_set_target_with(context, 0, 0, 0, 0));
    BAD(code, igh_cia402_set_digital_outputs(context, 0, 0));
    BAD(code, igh_cia402_arm_probe(context, 0, 1, IGH_CIA402_PROBE_POSITIVE));
    BAD(code, igh_cia402_disarm_probe(context, 0, 1));
    BAD(code, igh_cia402_get_probe(context, 0, 1, &probe));
    BAD(code, igh_cia402_get_drive_limits(context, 0, &limits));
    BAD(code, igh_cia402_get_drive_units(context, 0, &units));
    BAD(code, igh_cia402_get_scale_text(context, 0, text, sizeof(text), NULL));
    BAD(code, igh_cia402_set_target_radians(context, 0, 0.0));
    BAD(code, igh_cia402_set_target_step(context, 0, 0));
    BAD(code, igh_cia402_send_nmt_all(context, IGH_CANOPEN_NMT_START));
    BAD(code, igh_cia402_send_nmt(context, 0, IGH_CANOPEN_NMT_START));
    BAD(code, igh_cia402_configure(context, IGH_CIA402_ALL_AXES));
    BAD(code, igh_cia402_configure(context, 0));
    BAD(code, igh_cia402_request_actual_position(context, IGH_CIA402_ALL_AXES));
    BAD(code, igh_cia402_request_actual_position(context, 0));
    BAD(code, igh_cia402_enable_all(context));
    BAD(code, igh_cia402_enable(context, 0));
    BAD(code, igh_cia402_disable(context, IGH_CIA402_ALL_AXES));
    BAD(code, igh_cia402_disable(context, 0));
    BAD(code, igh_cia402_quick_stop(context, IGH_CIA402_ALL_AXES));
    BAD(code, igh_cia402_stop_together(context));
    BAD(code, igh_cia402_quick_stop(context, 0));
    BAD(code, igh_cia402_stop_all(context));
    BAD(code, igh_cia402_recover(context, 0));
    BAD(code, igh_cia402_recover(context, IGH_CIA402_ALL_AXES));
    NONE(code, 0, igh_cia402_all_stopped(context));
    BAD(code, igh_cia402_reset_fault(context, 0));
    BAD(code, igh_cia402_halt(context, 0));
    BAD(code, igh_cia402_resume(context, 0));
    BAD(code, igh_cia402_change_mode(context, 0, IGH_CIA402_MODE_CSP));
    BAD(code, igh_cia402_home(context, 0, &homing));
    BAD(code, igh_cia402_begin_shutdown(context));
    BAD(code, igh_cia402_get_axis_state(context, 0, &state));
    BAD(code, igh_cia402_get_axis_text(context, 0, text, sizeof(text), NULL));
    NONE(code, 0, igh_cia402_all_running(context));
    NONE(code, 0, igh_cia402_shutdown_is_done(context));
    BAD(code, igh_cia402_get_host_loss(context, 0, &loss));
    BAD(code, igh_cia402_get_host_loss_text(context, 0, text, sizeof(text), NULL));
    BAD(code, igh_cia402_get_axis_statistics(context, 0, &statistics));
    BAD(code, igh_cia402_get_bus_load(context, &load, 1, &count));
    BAD(code, igh_cia402_sdo_upload(context, 0, 0x1000, 0, data, 8, &count, 100));
    BAD(code, igh_cia402_sdo_download(context, 0, 0x1017, 0, VALUE, 2, 100));
    BAD(code, igh_cia402_sdo_start_upload(context, 0, 0x1000, 0));
    BAD(code, igh_cia402_sdo_start_download(context, 0, 0x1017, 0, VALUE, 2));
    BAD(code, igh_cia402_sdo_poll(context, 0, &sdo_state, data, 8, &count));
    if (context == NULL) {
        BAD(code, igh_cia402_context_deinit(context));
    } else {
        GOOD(igh_cia402_context_deinit(context));
    }
}

static void wrong_axis(igh_cia402_context_t *context, size_t axis)
{
    const int code = ECAN_ERR_AXIS;
    igh_cia402_homing_t homing;
    igh_cia402_axis_state_t state;
    igh_cia402_axis_statistics_t statistics;
    igh_cia402_host_loss_info_t loss;
    char text[64];
    uint8_t data[8];
    uint8_t sdo_state;
    size_t count;

    GOOD(igh_cia402_homing_init(&homing, 35));
    BAD(code, igh_cia402_set_target(context, axis, 0));
    BAD(code, igh_cia402_set_target_radians(context, axis, 0.0));
    BAD(code, igh_cia402_set_target_step(context, axis, 0));
    BAD(code, igh_cia402_send_nmt(context, axis, IGH_CANOPEN_NMT_START));
    BAD(code, igh_cia402_configure(context, axis));
    BAD(code, igh_cia402_request_actual_position(context, axis));
    BAD(code, igh_cia402_enable(context, axis));
    BAD(code, igh_cia402_disable(context, axis));
    BAD(code, igh_cia402_quick_stop(context, axis));
    BAD(code, igh_cia402_reset_fault(context, axis));
    BAD(code, igh_cia402_halt(context, axis));
    BAD(code, igh_cia402_resume(context, axis));
    BAD(code, igh_cia402_change_mode(context, axis, IGH_CIA402_MODE_CSP));
    BAD(code, igh_cia402_home(context, axis, &homing));
    BAD(code, igh_cia402_get_axis_state(context, axis, &state));
    BAD(code, igh_cia402_get_axis_text(context, axis, text, sizeof(text), NULL));
    BAD(code, igh_cia402_get_host_loss(context, axis, &loss));
    BAD(code, igh_cia402_get_host_loss_text(context, axis, text, sizeof(text), NULL));
    BAD(code, igh_cia402_get_axis_statistics(context, axis, &statistics));
    BAD(code, igh_cia402_sdo_start_upload(context, axis, 0x1000, 0));
    BAD(code, igh_cia402_sdo_start_download(context, axis, 0x1017, 0, VALUE, 2));
    BAD(code, igh_cia402_sdo_poll(context, axis, &sdo_state, data, 8, &count));
    BAD(code, igh_cia402_sdo_upload(context, axis, 0x1000, 0, data, 8, &count, 100));
    BAD(code, igh_cia402_sdo_download(context, axis, 0x1017, 0, VALUE, 2, 100));
}

/* A command to all axes reaches every one, and returns the first rejection. */
static void all_axes(igh_cia402_context_t *context)
{
    BAD(ECAN_ERR_AXIS_STATE, igh_cia402_enable(context, IGH_CIA402_ALL_AXES));
    BAD(ECAN_ERR_AXIS_STATE, igh_cia402_request_actual_position(context, IGH_CIA402_ALL_AXES));
    GOOD(igh_cia402_configure(context, IGH_CIA402_ALL_AXES));
    GOOD(igh_cia402_halt(context, IGH_CIA402_ALL_AXES));
    GOOD(igh_cia402_resume(context, IGH_CIA402_ALL_AXES));
    GOOD(igh_cia402_quick_stop(context, IGH_CIA402_ALL_AXES));
    GOOD(igh_cia402_disable(context, IGH_CIA402_ALL_AXES));
    /* Not the index of an axis elsewhere. */
    BAD(ECAN_ERR_AXIS, igh_cia402_set_target(context, IGH_CIA402_ALL_AXES, 0));
}

static void tables(igh_mcan_port_t *port)
{
    igh_cia402_context_t context;
    igh_cia402_settings_t settings;
    igh_cia402_axis_t axes[2];
    igh_cia402_axis_t kept;

    memset(&context, 0xA5, sizeof(context));
    GOOD(igh_cia402_axis_init(&axes[0], 0, 0, 1, 10));
    SAME(IGH_CIA402_MODE_CSP, axes[0].mode);
    SAME(10, axes[0].target_step);
    SAME(1000, axes[0].step_limit);
    SAME(IGH_CIA402_UNCHANGED, axes[0].quick_stop);
    GOOD(igh_cia402_axis_init(&axes[0], 65535, 3, 127, INT32_MIN));
    BAD(ECAN_ERR_ARGUMENT, igh_cia402_axis_init(&axes[0], 65536, 0, 1, 0));
    BAD(ECAN_ERR_ARGUMENT, igh_cia402_axis_init(&axes[0], 0, 4, 1, 0));
    BAD(ECAN_ERR_ARGUMENT, igh_cia402_axis_init(&axes[0], 0, 0, 0, 0));
    BAD(ECAN_ERR_ARGUMENT, igh_cia402_axis_init(&axes[0], 0, 0, 128, 0));
    SAME(65535, axes[0].slave);
    SAME(3, axes[0].channel);
    SAME(127, axes[0].node_id);
    SAME(INT32_MIN, axes[0].target_step);

    BAD(ECAN_ERR_CONFIG, igh_cia402_context_init(&context, port, axes, 1));
    ERROR_HAS("axis 0: slave 65535 does not exist");
    ERROR_HAS("axis 0: node 127 (slave 65535, channel 3) has the node-ID of the host's heartbeat");
    GOOD(igh_cia402_axis_init(&axes[0], 1, 0, 1, 0));
    BAD(ECAN_ERR_SLAVE, igh_cia402_context_init(&context, port, axes, 1));
    GOOD(igh_cia402_axis_init(&axes[0], 0, 3, 1, 0));
    BAD(ECAN_ERR_CHANNEL, igh_cia402_context_init(&context, port, axes, 1));
    GOOD(igh_cia402_axis_init(&axes[0], 0, 0, 1, 0));
    axes[1] = axes[0];
    BAD(ECAN_ERR_CONFIG, igh_cia402_context_init(&context, port, axes, 2));
    for (int kind = 0; kind < GARBAGE_KINDS; kind++) {
        check_about(fill_garbage(kind, &axes[1], sizeof(axes[1])));
        BAD(ECAN_ERR_NOT_INITIALISED, igh_cia402_context_init(&context, port, axes, 2));
        check_about(fill_garbage(kind, &settings, sizeof(settings)));
        BAD(ECAN_ERR_NOT_INITIALISED,
            igh_cia402_context_init_ex(&context, port, axes, 1, &settings));
    }
    check_about(NULL);
    kept = axes[0];
#define FAULTY(field, value)                                                                       \
    do {                                                                                           \
        check_about(#field);                                                                       \
        axes[0] = kept;                                                                            \
        axes[0].field = (value);                                                                   \
        BAD(ECAN_ERR_CONFIG, igh_cia402_context_init(&context, port, axes, 1));                    \
        igh_cia402_context_deinit(&context);                                                       \
    } while (0)
    FAULTY(node_id, 0);
    FAULTY(node_id, 128);
    FAULTY(mode, 5);
    FAULTY(pdo_number, 0);
    FAULTY(pdo_number, 5);
    FAULTY(node_axis, 8);
    FAULTY(range, 3);
    FAULTY(range, IGH_CIA402_RANGE_MODULO);
    FAULTY(steps_per_turn, 0.0);
    FAULTY(reset, 3);
    FAULTY(host_loss, 40000);
    FAULTY(quick_stop, -40000);
    FAULTY(shutdown, 40000);
    FAULTY(disable_operation, 40000);
    FAULTY(halt, 40000);
    FAULTY(fault_reaction, 40000);
    FAULTY(further_count, IGH_CIA402_MAX_FURTHER + 1);
    FAULTY(further_count, 1);
    FAULTY(target_step, 5000);
    FAULTY(following_window, 1);
    axes[0] = kept;
    axes[0].has_bounds = 1;
    axes[0].bound_min = 5;
    axes[0].bound_max = -5;
    BAD(ECAN_ERR_CONFIG, igh_cia402_context_init(&context, port, axes, 1));
    axes[0] = kept;
#undef FAULTY
#define FAULTY(field, value)                                                                       \
    do {                                                                                           \
        check_about(#field);                                                                       \
        GOOD(igh_cia402_default_settings(&settings));                                              \
        settings.field = (value);                                                                  \
        BAD(ECAN_ERR_CONFIG, igh_cia402_context_init_ex(&context, port, axes, 1, &settings));      \
        igh_cia402_context_deinit(&context);                                                       \
    } while (0)
    FAULTY(host_node_id, 0);
    FAULTY(host_node_id, 1);
    FAULTY(host_node_id, 200);
    FAULTY(sync_counter_overflow, 1);
    FAULTY(sync_counter_overflow, 241);
    FAULTY(sdo_buffer_bytes, UINT32_MAX);
    FAULTY(nmt_queue, UINT32_MAX);
    FAULTY(sdo_block_segments, 0);
    FAULTY(sdo_block_segments, 128);
#undef FAULTY
    check_about(NULL);
    NONE(ECAN_ERR_NOT_INITIALISED, 0, igh_cia402_axis_count(&context));
    GOOD(igh_cia402_default_settings(&settings));
    GOOD(igh_cia402_context_init_ex(&context, port, axes, 1, &settings));
    GOOD(igh_cia402_context_deinit(&context));
    /* A table may be empty. */
    GOOD(igh_cia402_context_init(&context, port, NULL, 0));
    SAME(0, igh_cia402_axis_count(&context));
    SAME(0, igh_cia402_all_running(&context));
    GOOD(igh_cia402_context_deinit(&context));
}

void test_cia402_axes(void)
{
    static ecan_igh_config_t igh_config;
    static igh_mcan_port_config_t config;
    ecan_igh_context_t igh;
    igh_mcan_port_t port;
    igh_mcan_port_t second_port;
    igh_cia402_context_t context;
    igh_cia402_context_t copy;
    igh_cia402_context_t second;
    igh_cia402_axis_t axes[2];

    check_about(NULL);
    GOOD(igh_cia402_axis_init(&axes[0], 0, 0, 1, 0));
    GOOD(igh_cia402_axis_init(&axes[1], 0, 0, 2, 0));
    simulate_channel(&igh_config, &config, "sim:drives", 1000000);
    GOOD(igh_mcan_port_apply_config(&igh_config, &config));
    memset(&port, 0, sizeof(port));
    BAD(ECAN_ERR_NOT_INITIALISED, igh_cia402_context_init(&context, &port, axes, 2));
    GOOD(ecan_igh_init(&igh, &igh_config));
    GOOD(igh_mcan_port_init(&port, &igh, &config));
    for (int kind = 0; kind < GARBAGE_KINDS; kind++) {
        check_about(fill_garbage(kind, &context, sizeof(context)));
        no_context(ECAN_ERR_NOT_INITIALISED, &context);
        GOOD(igh_cia402_context_init(&context, &port, axes, 2));
        BAD(ECAN_ERR_ORDER, igh_cia402_context_init(&context, &port, axes, 2));
        BAD(ECAN_ERR_ORDER, igh_cia402_context_init(&second, &port, axes, 2));
        check_about("a copy");
        copy = context;
        no_context(ECAN_ERR_NOT_INITIALISED, &copy);
        SAME(2, igh_cia402_axis_count(&context));
        check_about("a Port");
        no_context(ECAN_ERR_NOT_INITIALISED, (igh_cia402_context_t *)(void *)&port);
        GOOD(igh_cia402_context_deinit(&context));
        GOOD(igh_cia402_context_deinit(&context));
        check_about("axes that have ended");
        no_context(ECAN_ERR_NOT_INITIALISED, &context);
    }
    check_about(NULL);
    tables(&port);
    GOOD(igh_cia402_context_init(&context, &port, axes, 2));
    /* Calls that wait need an active bus. */
    BAD(ECAN_ERR_ORDER, igh_cia402_configure_csp_all_timeout(&context, 100));
    BAD(ECAN_ERR_ORDER, igh_cia402_shutdown_timeout(&context, 100));
    BAD(ECAN_ERR_ORDER, igh_cia402_start_up_timeout(&context, 100));
    wrong_axis(&context, 2);
    wrong_axis(&context, SIZE_MAX);
    all_axes(&context);

    check_about("axes whose Port has ended");
    GOOD(igh_mcan_port_deinit(&port));
    no_context(ECAN_ERR_NOT_INITIALISED, &context);
    check_about("axes whose master has ended");
    GOOD(igh_mcan_port_init(&second_port, &igh, &config));
    GOOD(igh_cia402_context_init(&context, &second_port, axes, 2));
    GOOD(ecan_igh_deinit(&igh));
    no_context(ECAN_ERR_NOT_INITIALISED, &context);
    check_about(NULL);
}
