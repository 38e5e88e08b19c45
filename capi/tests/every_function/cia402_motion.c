/* igh_cia402_protocol.h: startup, motion, commands, states, faults, shutdown. */
#include "check.h"

#define AXES 3
#define CYCLES 4000

static ecan_igh_context_t igh;
static igh_mcan_port_t port;
static igh_cia402_context_t motors;

static struct {
    unsigned calls;
    unsigned busy;
    int is_last_named;
} progress;

/* A call with the context from the callback is rejected. */
static void on_progress(void *user, size_t axis, const char *text)
{
    char name[16];
    TRUE(user == &progress);
    TRUE(axis < AXES);
    progress.calls++;
    snprintf(name, sizeof(name), "axis %u", (unsigned)axis);
    progress.is_last_named = strncmp(text, name, strlen(name)) == 0;
    if (progress.calls == 1) {
        BAD(ECAN_ERR_BUSY, igh_cia402_disable(&motors, IGH_CIA402_ALL_AXES));
        BAD(ECAN_ERR_BUSY, igh_mcan_port_cycle_begin(&port));
        BAD(ECAN_ERR_BUSY, ecan_igh_deinit(&igh));
        BAD(ECAN_ERR_BUSY, igh_mcan_port_deinit(&port));
        BAD(ECAN_ERR_BUSY, igh_cia402_context_deinit(&motors));
        NONE(ECAN_ERR_BUSY, 0, igh_cia402_axis_count(&motors));
        progress.busy++;
    }
}

static igh_cia402_axis_state_t state_of(size_t axis)
{
    igh_cia402_axis_state_t state;
    fill_garbage(2, &state, sizeof(state));
    GOOD(igh_cia402_get_axis_state(&motors, axis, &state));
    return state;
}

/* Runs the cycle until the axis is in this phase. */
static int reaches(size_t axis, int phase)
{
    for (int i = 0; i < CYCLES; i++) {
        run_axes(&port, &motors, 1);
        if (state_of(axis).phase == phase) {
            return 1;
        }
    }
    return 0;
}

static void too_early(void)
{
    igh_cia402_axis_state_t state = state_of(0);
    SAME(IGH_CIA402_PHASE_NOT_CONFIGURED, state.phase);
    SAME(0, state.is_configured);
    SAME(0, state.has_actual);
    SAME(0, state.has_statusword);
    SAME(1, state.node_id);
    GOOD(igh_cia402_set_motion_div(&motors, 2));
    GOOD(igh_cia402_set_motion_div(&motors, 0));
    SAME(0, igh_cia402_all_running(&motors));
    SAME(0, igh_cia402_shutdown_is_done(&motors));
    BAD(ECAN_ERR_AXIS_STATE, igh_cia402_enable(&motors, 0));
    BAD(ECAN_ERR_AXIS_STATE, igh_cia402_enable_all(&motors));
    BAD(ECAN_ERR_AXIS_STATE, igh_cia402_request_actual_position(&motors, 0));
    BAD(ECAN_ERR_AXIS_STATE, igh_cia402_request_actual_position(&motors, IGH_CIA402_ALL_AXES));
    BAD(ECAN_ERR_AXIS_STATE, igh_cia402_request_actual_position_all_timeout(&motors, 100));
    BAD(ECAN_ERR_AXIS_STATE, igh_cia402_enable_all_timeout(&motors, 100));
    BAD(ECAN_ERR_AXIS_STATE, igh_cia402_change_mode(&motors, 0, IGH_CIA402_MODE_CSP));
    BAD(ECAN_ERR_AXES, igh_cia402_configure_csp_all_timeout(&motors, 1));
    ERROR_HAS("axis 0");
    ERROR_HAS("axis 2");
}

static void unknown_numbers(void)
{
    static const int NO_COMMANDS[] = {-1, 0, 3, 0x7F, 0x83, 0x181, 257};
    static const int NO_MODES[] = {-1, 0, 5, 11, 264};
    for (size_t i = 0; i < ITEMS(NO_COMMANDS); i++) {
        BAD(ECAN_ERR_ARGUMENT, igh_cia402_send_nmt_all(&motors, NO_COMMANDS[i]));
        BAD(ECAN_ERR_ARGUMENT, igh_cia402_send_nmt(&motors, 0, NO_COMMANDS[i]));
    }
    for (size_t i = 0; i < ITEMS(NO_MODES); i++) {
        BAD(ECAN_ERR_ARGUMENT, igh_cia402_change_mode(&motors, 0, NO_MODES[i]));
    }
    BAD(ECAN_ERR_ARGUMENT, igh_cia402_set_target_radians(&motors, 0, 1e300));
    BAD(ECAN_ERR_ARGUMENT, igh_cia402_set_target_radians(&motors, 0, -1e300));
    BAD(ECAN_ERR_SCHEDULE, igh_cia402_set_scheduled_tx(&motors, 1, 100, 200));
    GOOD(igh_cia402_set_scheduled_tx(&motors, 0, 100, 200));
    GOOD(igh_cia402_set_scheduled_tx(&motors, 1, IGH_CIA402_AT_ONCE, IGH_CIA402_AT_ONCE));
}

static void start_up(void)
{
    GOOD(igh_cia402_set_progress_callback(&motors, on_progress, &progress));
    SAME(ECAN_OK, igh_cia402_configure_csp_all_timeout(&motors, 30000));
    TRUE(progress.calls > AXES);
    SAME(1, progress.busy);
    SAME(1, progress.is_last_named);
    GOOD(igh_cia402_set_progress_callback(&motors, NULL, NULL));
    SAME(IGH_CIA402_PHASE_STANDBY, state_of(0).phase);
    /* Until the next heartbeat reports it. */
    run_axes(&port, &motors, 250);
    SAME(IGH_CANOPEN_NMT_STATE_OPERATIONAL, state_of(0).nmt_state);
    SAME(IGH_CANOPEN_HEARTBEAT_ACTIVE, state_of(0).heartbeat);
    GOOD(igh_cia402_request_actual_position_all_timeout(&motors, 5000));
    SAME(1, state_of(1).has_actual);
    SAME(0, igh_cia402_all_running(&motors));
    GOOD(igh_cia402_enable_all_timeout(&motors, 10000));
    SAME(1, igh_cia402_all_running(&motors));
    for (size_t axis = 0; axis < AXES; axis++) {
        igh_cia402_axis_state_t state = state_of(axis);
        SAME(IGH_CIA402_PHASE_RUNNING, state.phase);
        SAME(IGH_CIA402_DRIVE_OPERATION_ENABLED, state.drive_state);
        SAME(IGH_CIA402_MODE_CSP, state.mode);
        SAME(1, state.is_running);
        SAME(1, state.has_target);
        SAME(0, state.axis_error);
    }
}

static void motion(void)
{
    igh_cia402_send_summary_t summary;
    igh_cia402_axis_statistics_t statistics;
    igh_mcan_rx_frame_t rx[4];
    int32_t start[AXES];
    size_t count = 99;

    for (size_t axis = 0; axis < AXES; axis++) {
        start[axis] = state_of(axis).actual;
    }
    for (int32_t i = 1; i <= 300; i++) {
        GOOD(igh_mcan_port_wait_next_cycle(&port));
        GOOD(igh_mcan_port_cycle_begin(&port));
        GOOD(igh_cia402_process_rx_ex(&motors, rx, ITEMS(rx), &count));
        SAME(0, count);
        for (size_t axis = 0; axis < AXES; axis++) {
            GOOD(igh_cia402_set_target(&motors, axis, start[axis] + i * 5));
        }
        GOOD(igh_cia402_send_targets_all(&motors));
        GOOD(igh_cia402_get_send_summary(&motors, &summary));
        SAME(AXES, summary.targets);
        SAME(1, summary.all_moved);
        SAME(0, summary.rejected);
        GOOD(igh_mcan_port_cycle_end(&port));
    }
    run_axes(&port, &motors, 50);
    for (size_t axis = 0; axis < AXES; axis++) {
        SAME(start[axis] + 1500, state_of(axis).actual);
        SAME(start[axis] + 1500, state_of(axis).target);
    }

    /* By the step of the axis. */
    for (int i = 0; i < 200; i++) {
        begin_axes(&port, &motors);
        GOOD(igh_cia402_send_target_step(&motors));
        GOOD(igh_mcan_port_cycle_end(&port));
        if (i == 100) {
            GOOD(igh_cia402_set_target_step(&motors, 0, 0));
        }
    }
    TRUE(state_of(0).actual > start[0] + 1500);
    TRUE(state_of(1).actual > state_of(0).actual - start[0] + start[1]);
    for (size_t axis = 1; axis < AXES; axis++) {
        GOOD(igh_cia402_set_target_step(&motors, axis, 0));
    }
    for (int i = 0; i < 100; i++) {
        begin_axes(&port, &motors);
        GOOD(igh_cia402_send_target_step(&motors));
        GOOD(igh_mcan_port_cycle_end(&port));
    }

    /* A target that is too far is rejected, and the previous one stays. */
    begin_axes(&port, &motors);
    GOOD(igh_cia402_set_target(&motors, 0, state_of(0).target + 1001));
    GOOD(igh_cia402_send_targets_all(&motors));
    GOOD(igh_cia402_get_send_summary(&motors, &summary));
    SAME(1, summary.rejected);
    SAME(IGH_CIA402_DECISION_REJECTED, state_of(0).decision);
    SAME(IGH_CIA402_REJECTION_STEP, state_of(0).decision_reason);
    GOOD(igh_mcan_port_cycle_end(&port));
    GOOD(igh_cia402_set_target(&motors, 0, state_of(0).target));
    begin_axes(&port, &motors);
    GOOD(igh_cia402_set_target_radians(&motors, 0, state_of(0).actual_radians));
    GOOD(igh_cia402_set_target_radians(&motors, 1, state_of(1).actual_radians));
    GOOD(igh_cia402_send_targets_all(&motors));
    GOOD(igh_mcan_port_cycle_end(&port));
    GOOD(igh_cia402_get_axis_statistics(&motors, 0, &statistics));
    SAME(1, statistics.targets_rejected);
    SAME(1, statistics.rejected_step);
    SAME(1, statistics.activations);
    SAME(0, statistics.holds);
    TRUE(statistics.targets_sent > 500 && statistics.tpdos > 500);
    BAD(ECAN_ERR_AXIS_STATE, igh_cia402_set_motion_div(&motors, 2));
    BAD(ECAN_ERR_AXIS_STATE, igh_cia402_set_scheduled_tx(&motors, 0, 0, 0));
}

static void commands(void)
{
    igh_cia402_homing_t homing;

    GOOD(igh_cia402_halt(&motors, 0));
    TRUE(reaches(0, IGH_CIA402_PHASE_HALTED));
    run_axes(&port, &motors, 1);
    GOOD(igh_cia402_resume(&motors, 0));
    TRUE(reaches(0, IGH_CIA402_PHASE_RUNNING));
    GOOD(igh_cia402_stop_together(&motors));
    TRUE(reaches(0, IGH_CIA402_PHASE_HALTED));
    for (size_t axis = 0; axis < igh_cia402_axis_count(&motors); axis++) {
        GOOD(igh_cia402_resume(&motors, axis));
    }
    TRUE(reaches(0, IGH_CIA402_PHASE_RUNNING));

    GOOD(igh_cia402_quick_stop(&motors, 0));
    TRUE(state_of(0).is_running == 0);
    run_axes(&port, &motors, 200);
    GOOD(igh_cia402_enable(&motors, 0));
    TRUE(reaches(0, IGH_CIA402_PHASE_RUNNING));
    GOOD(igh_cia402_quick_stop(&motors, IGH_CIA402_ALL_AXES));
    run_axes(&port, &motors, 200);
    SAME(0, igh_cia402_all_running(&motors));
    GOOD(igh_cia402_enable_all(&motors));
    GOOD(igh_cia402_enable_all_timeout(&motors, 10000));
    SAME(1, igh_cia402_all_running(&motors));

    GOOD(igh_cia402_stop_all(&motors));
    SAME(IGH_CIA402_STOP_CAUSE_ALL, state_of(0).stop_cause);
    SAME(0, igh_cia402_all_stopped(&motors));
    GOOD(igh_cia402_stop_all_timeout(&motors, 10000));
    SAME(1, igh_cia402_all_stopped(&motors));
    SAME(1, state_of(0).is_stopped);
    TRUE(state_of(0).drive_state == IGH_CIA402_DRIVE_SWITCH_ON_DISABLED);
    GOOD(igh_cia402_recover(&motors, 0));
    SAME(1, state_of(0).is_recovering);
    GOOD(igh_cia402_recover(&motors, IGH_CIA402_ALL_AXES));
    GOOD(igh_cia402_recover_all_timeout(&motors, 10000));
    SAME(0, state_of(0).is_recovering);
    SAME(0, igh_cia402_all_stopped(&motors));
    SAME(IGH_CIA402_STOP_CAUSE_NONE, state_of(0).stop_cause);

    GOOD(igh_cia402_disable(&motors, 1));
    run_axes(&port, &motors, 300);
    SAME(0, state_of(1).is_running);
    SAME(1, state_of(0).is_running);
    TRUE(state_of(1).drive_state != IGH_CIA402_DRIVE_OPERATION_ENABLED);
    GOOD(igh_cia402_request_actual_position(&motors, 1));
    TRUE(reaches(1, IGH_CIA402_PHASE_READY));
    GOOD(igh_cia402_enable(&motors, 1));
    TRUE(reaches(1, IGH_CIA402_PHASE_RUNNING));

    /* Modes: those that are mapped, and homing. */
    BAD(ECAN_ERR_AXIS_STATE, igh_cia402_change_mode(&motors, 2, IGH_CIA402_MODE_CST));
    BAD(ECAN_ERR_AXIS_STATE, igh_cia402_change_mode(&motors, 2, IGH_CIA402_MODE_HM));
    GOOD(igh_cia402_change_mode(&motors, 2, IGH_CIA402_MODE_PP));
    BAD(ECAN_ERR_AXIS_STATE, igh_cia402_home(&motors, 2, &(igh_cia402_homing_t){.method = 35}));
    GOOD(igh_cia402_finish_all_timeout(&motors, 10000));
    SAME(IGH_CIA402_MODE_PP, state_of(2).mode);
    GOOD(igh_cia402_change_mode(&motors, 2, IGH_CIA402_MODE_CSP));
    GOOD(igh_cia402_finish_all_timeout(&motors, 10000));
    SAME(IGH_CIA402_MODE_CSP, state_of(2).mode);
    fill_garbage(2, &homing, sizeof(homing));
    GOOD(igh_cia402_homing_init(&homing, 35));
    SAME(35, homing.method);
    SAME(60000, homing.timeout_ms);
    SAME(0, homing.has_offset);
    GOOD(igh_cia402_home(&motors, 2, &homing));
    GOOD(igh_cia402_finish_all_timeout(&motors, 20000));
    SAME(IGH_CIA402_MODE_CSP, state_of(2).mode);

    GOOD(igh_cia402_disable(&motors, IGH_CIA402_ALL_AXES));
    run_axes(&port, &motors, 500);
    SAME(0, igh_cia402_all_running(&motors));
    GOOD(igh_cia402_request_actual_position(&motors, IGH_CIA402_ALL_AXES));
    TRUE(reaches(2, IGH_CIA402_PHASE_READY));
    GOOD(igh_cia402_reset_fault(&motors, 0));
    run_axes(&port, &motors, 50);

    /* NMT: a stopped node does not become active; it is configured again. */
    GOOD(igh_cia402_send_nmt(&motors, 0, IGH_CANOPEN_NMT_STOP));
    run_axes(&port, &motors, 300);
    SAME(IGH_CANOPEN_NMT_STATE_STOPPED, state_of(0).nmt_state);
    GOOD(igh_cia402_send_nmt_all(&motors, IGH_CANOPEN_NMT_START));
    GOOD(igh_cia402_configure(&motors, 0));
    for (int i = 0; i < CYCLES && state_of(0).is_configured != 1; i++) {
        run_axes(&port, &motors, 1);
    }
    SAME(1, state_of(0).is_configured);
    GOOD(igh_cia402_configure(&motors, IGH_CIA402_ALL_AXES));
    GOOD(igh_cia402_configure_csp_all_timeout(&motors, 20000));
    GOOD(igh_cia402_enable_all_timeout(&motors, 20000));
    SAME(1, igh_cia402_all_running(&motors));
}

static void text_and_load(void)
{
    igh_cia402_bus_load_t loads[3];
    igh_cia402_host_loss_info_t loss;
    char text[256];
    char cut[8];
    size_t count = 99;

    GOOD(igh_cia402_get_axis_text(&motors, 2, text, sizeof(text), NULL));
    TEXT_HAS("axis 2, node 2", text);
    BAD(ECAN_ERR_BUFFER, igh_cia402_get_axis_text(&motors, 2, cut, sizeof(cut), &count));
    SAME(strlen(text) + 1, count);
    SAME(0, strncmp(cut, text, sizeof(cut) - 1));
    SAME(0, cut[sizeof(cut) - 1]);
    BAD(ECAN_ERR_BUFFER, igh_cia402_get_axis_text(&motors, 2, cut, 1, NULL));
    SAME(0, cut[0]);
    GOOD(igh_cia402_get_host_loss(&motors, 0, &loss));
    SAME(IGH_CIA402_HOST_LOSS_REACTION_QUICK_STOP, loss.reaction);
    SAME(IGH_CIA402_STOP_RAMP_QUICK_STOP, loss.ramp);
    SAME(IGH_CIA402_HOST_WATCH_ACTIVE, loss.watch);
    SAME(250, loss.watch_ms);
    SAME(1, loss.is_controlled_stop);
    SAME(1, loss.has_deceleration);
    TRUE(loss.deceleration > 0);
    GOOD(igh_cia402_get_host_loss_text(&motors, 2, text, sizeof(text), NULL));
    TEXT_HAS("axis 2, node 2", text);
    TEXT_HAS("quick stop", text);
    BAD(ECAN_ERR_BUFFER, igh_cia402_get_host_loss_text(&motors, 2, cut, 1, NULL));
    SAME(0, cut[0]);
    GOOD(igh_cia402_get_bus_load(&motors, loads, 3, &count));
    SAME(2, count);
    TRUE(loads[0].least > 0.0 && loads[0].least <= loads[0].most && loads[0].most < 1.0);
    SAME(1, loads[0].axes);
    SAME(2, loads[1].axes);
    count = 99;
    BAD(ECAN_ERR_BUFFER, igh_cia402_get_bus_load(&motors, loads, 1, &count));
    SAME(2, count);
    BAD(ECAN_ERR_BUFFER, igh_cia402_get_bus_load(&motors, NULL, 0, &count));
    SAME(2, count);
}

static void shutdown(void)
{
    igh_cia402_axis_statistics_t statistics;
    SAME(0, igh_cia402_shutdown_is_done(&motors));
    GOOD(igh_cia402_begin_shutdown(&motors));
    for (int i = 0; i < CYCLES && !igh_cia402_shutdown_is_done(&motors); i++) {
        run_axes(&port, &motors, 1);
    }
    SAME(1, igh_cia402_shutdown_is_done(&motors));
    SAME(0, igh_cia402_all_running(&motors));
    GOOD(igh_cia402_get_axis_statistics(&motors, 0, &statistics));
    SAME(0, statistics.faults);
    GOOD(igh_cia402_set_stop_time_ms(&motors, 5000));
    GOOD(igh_cia402_shutdown_timeout(&motors, 10000));
    SAME(1, igh_cia402_shutdown_is_done(&motors));
}

/* Scheduled targets, and a drive that fails. */
static void faults(void)
{
    static ecan_igh_config_t igh_config;
    static igh_mcan_port_config_t config;
    igh_cia402_axis_t axis;
    igh_cia402_axis_statistics_t statistics;
    char setting[512];
    int had_fault = 0;

    SAME(0, write_scenario("[[gateway]]\nbuses = [\"a\", \"b\", \"c\", \"d\"]\n"
                           "[[node]]\nkind = \"drive\"\nbus = \"a\"\nname = \"arm\"\n"
                           "node_id = 1\n"
                           "[[fault]]\nat_ms = 9000\nkind = \"drive_error\"\nnode = \"arm\"\n"
                           "code = 0x8611\n",
                           setting, sizeof(setting)));
    simulate_channel(&igh_config, &config, setting, 1000000);
    GOOD(ecan_igh_config_set_dc_sync0(&igh_config, 1000, 700));
    SAME(0, start_port(&igh, &port, &igh_config, &config));
    GOOD(igh_cia402_axis_init(&axis, 0, 0, 1, 0));
    GOOD(igh_cia402_context_init(&motors, &port, &axis, 1));
    BAD(ECAN_ERR_SCHEDULE, igh_cia402_set_scheduled_tx(&motors, 1, 100000, 1000000));
    BAD(ECAN_ERR_SCHEDULE, igh_cia402_set_scheduled_tx(&motors, 1, 1000001, UINT32_MAX));
    GOOD(igh_cia402_set_scheduled_tx(&motors, 1, 300000, 100000));
    GOOD(igh_cia402_set_scheduled_tx(&motors, 1, 400000, 600000));
    GOOD(igh_cia402_start_up_timeout(&motors, 30000));
    SAME(1, igh_cia402_all_running(&motors));
    for (int i = 0; i < 12000 && !had_fault; i++) {
        run_axes(&port, &motors, 1);
        had_fault = state_of(0).drive_state == IGH_CIA402_DRIVE_FAULT;
    }
    SAME(1, had_fault);
    run_axes(&port, &motors, 20);
    SAME(0, state_of(0).is_running);
    SAME(0x8611, state_of(0).error_code);
    SAME(IGH_CIA402_AXIS_ERROR_FAULT, state_of(0).axis_error);
    /* Not enabled before the reset of the fault. */
    igh_cia402_enable(&motors, 0);
    run_axes(&port, &motors, 300);
    SAME(0, state_of(0).is_running);
    SAME(IGH_CIA402_DRIVE_FAULT, state_of(0).drive_state);
    GOOD(igh_cia402_reset_fault(&motors, 0));
    run_axes(&port, &motors, 300);
    GOOD(igh_cia402_enable_all_timeout(&motors, 10000));
    SAME(1, igh_cia402_all_running(&motors));
    GOOD(igh_cia402_get_axis_statistics(&motors, 0, &statistics));
    SAME(1, statistics.faults);
    SAME(2, statistics.activations);
    TRUE(statistics.emergencies >= 1);
    GOOD(igh_cia402_shutdown_timeout(&motors, 10000));
    GOOD(igh_cia402_context_deinit(&motors));
    GOOD(ecan_igh_deinit(&igh));
    remove_scenario(setting);
}

void test_cia402_motion(void)
{
    static ecan_igh_config_t igh_config;
    static igh_mcan_port_config_t config;
    igh_cia402_axis_t axes[AXES];

    simulate_channel(&igh_config, &config, "sim:drives", 1000000);
    GOOD(igh_mcan_port_set_classic_channel(&config, 0, 1, 1000000));
    SAME(0, start_port(&igh, &port, &igh_config, &config));
    GOOD(igh_cia402_axis_init(&axes[0], 0, 0, 1, 5));
    GOOD(igh_cia402_axis_init(&axes[1], 0, 1, 1, 5));
    GOOD(igh_cia402_axis_init(&axes[2], 0, 1, 2, 5));
    GOOD(igh_cia402_context_init(&motors, &port, axes, AXES));
    SAME(AXES, igh_cia402_axis_count(&motors));
    too_early();
    unknown_numbers();
    start_up();
    motion();
    commands();
    text_and_load();
    shutdown();
    GOOD(igh_cia402_context_deinit(&motors));
    GOOD(igh_mcan_port_deinit(&port));
    GOOD(ecan_igh_deinit(&igh));
    faults();
}
