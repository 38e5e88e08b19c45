/* igh_cia402_protocol.h: identity, further process data, feed-forward, touch probes, limits, units, modes. */
#include "check.h"

#define DRIVES 4
#define CYCLES 4000

static ecan_igh_context_t igh;
static igh_mcan_port_t port;
static igh_cia402_context_t motors;
static igh_cia402_axis_t axes[DRIVES];

static igh_cia402_axis_state_t state_of(size_t axis)
{
    igh_cia402_axis_state_t state;
    fill_garbage(2, &state, sizeof(state));
    GOOD(igh_cia402_get_axis_state(&motors, axis, &state));
    return state;
}

static void end(void)
{
    GOOD(igh_cia402_send_targets_all(&motors));
    GOOD(igh_mcan_port_cycle_end(&port));
}

static void init_axes(void)
{
    for (size_t axis = 0; axis < DRIVES; axis++) {
        GOOD(igh_cia402_axis_init(&axes[axis], 0, 0, (uint8_t)(axis + 1), 100));
    }
}

static void open_axes(size_t count)
{
    GOOD(igh_cia402_context_init(&motors, &port, axes, count));
}

static void close_axes(void)
{
    SAME(ECAN_OK, igh_cia402_shutdown_timeout(&motors, 20000));
    GOOD(igh_cia402_context_deinit(&motors));
}

static void identity(void)
{
    init_axes();
    for (size_t axis = 0; axis < DRIVES; axis++) {
        axes[axis].check_device_type = 1;
        axes[axis].device_type = 0x00020192;
        axes[axis].check_identity = 1;
        axes[axis].vendor_id = 0x53494D00;
        axes[axis].product_code = 402;
        axes[axis].revision_check = IGH_CIA402_REVISION_COMPATIBLE;
        axes[axis].revision_number = 0x00010000;
        axes[axis].check_serial_number = 1;
        axes[axis].serial_number = (uint32_t)(100 + axis);
    }
    axes[1].revision_check = IGH_CIA402_REVISION_EXACTLY;
    axes[1].revision_number = 0x00010001;
    axes[2].serial_number = 7;
    axes[3].device_type = 0x00010192;
    open_axes(DRIVES);
    BAD(ECAN_ERR_AXES, igh_cia402_configure_csp_all_timeout(&motors, 20000));
    ERROR_HAS("3 axes not configured");
    ERROR_HAS("axis 1, node 2");
    ERROR_HAS("revision number");
    ERROR_HAS("serial number");
    ERROR_HAS("device type");
    SAME(1, state_of(0).is_configured);
    GOOD(igh_cia402_context_deinit(&motors));
#define FAULTY(field, value)                                                                       \
    do {                                                                                           \
        check_about(#field);                                                                       \
        init_axes();                                                                               \
        axes[0].field = (value);                                                                   \
        BAD(ECAN_ERR_CONFIG, igh_cia402_context_init(&motors, &port, axes, 1));                    \
        check_about(NULL);                                                                         \
    } while (0)
    FAULTY(revision_check, 3);
    FAULTY(scale_source, 3);
    FAULTY(outputs, 0x20);
    FAULTY(inputs, 0x1000);
    FAULTY(padding, 1);
    /* A feed-forward needs its limits, a touch probe its status. */
    FAULTY(outputs, IGH_CIA402_OUTPUT_VELOCITY_OFFSET);
    FAULTY(outputs, IGH_CIA402_OUTPUT_PROBE_FUNCTION);
#undef FAULTY
}

static void process_data(void)
{
    const uint32_t inputs = IGH_CIA402_INPUT_VELOCITY | IGH_CIA402_INPUT_TORQUE |
                            IGH_CIA402_INPUT_ERROR_CODE | IGH_CIA402_INPUT_DIGITAL_INPUTS |
                            IGH_CIA402_INPUT_MODE_DISPLAY | IGH_CIA402_INPUT_FOLLOWING_ERROR;
    igh_cia402_axis_statistics_t statistics;
    int32_t target;

    init_axes();
    axes[0].outputs = IGH_CIA402_OUTPUT_VELOCITY_OFFSET | IGH_CIA402_OUTPUT_TORQUE_OFFSET |
                      IGH_CIA402_OUTPUT_DIGITAL_OUTPUTS;
    axes[0].inputs = inputs;
    axes[0].has_output_mask = 1;
    axes[0].output_mask = 0x00FF0000;
    axes[0].feed_forward_velocity = 20000;
    axes[0].feed_forward_velocity_change = 1000;
    axes[0].feed_forward_torque = 30;
    axes[0].feed_forward_torque_change = 10;
    open_axes(2);
    SAME(0, state_of(0).inputs);
    GOOD(igh_cia402_start_up_timeout(&motors, 30000));
    SAME(inputs, state_of(0).inputs);
    SAME(0, state_of(1).inputs);
    SAME(8, state_of(0).mode_display);
    SAME(0, state_of(0).drive_error_code);
    SAME(0x00FF0000, axis_object(&motors, 0, 0x60FE, 2));

    target = state_of(0).target;
    for (int i = 1; i <= 100; i++) {
        begin_axes(&port, &motors);
        target += 50;
        GOOD(igh_cia402_set_target_with(&motors, 0, target, 50000, 25));
        end();
        TRUE(state_of(0).velocity_offset <= (i < 20 ? 1000 * i : 20000));
    }
    SAME(20000, state_of(0).velocity_offset);
    SAME(25, state_of(0).torque_offset);
    SAME(target, state_of(0).target);
    TRUE(state_of(0).velocity > 40000 && state_of(0).velocity < 60000);
    TRUE(state_of(0).torque != 0);
    GOOD(igh_cia402_get_axis_statistics(&motors, 0, &statistics));
    TRUE(statistics.feed_forwards_limited >= 100);
    /* Targets without a feed-forward: it returns to 0 by its changes. */
    for (int i = 0; i < 40; i++) {
        begin_axes(&port, &motors);
        target += 50;
        GOOD(igh_cia402_set_target(&motors, 0, target));
        end();
    }
    SAME(0, state_of(0).velocity_offset);
    SAME(0, state_of(0).torque_offset);
    SAME(1, igh_cia402_all_running(&motors));

    GOOD(igh_cia402_set_digital_outputs(&motors, 0, 0x00A50000));
    run_axes(&port, &motors, 10);
    SAME(0x00A50000, axis_object(&motors, 0, 0x60FE, 1));
    BAD(ECAN_ERR_AXIS_STATE, igh_cia402_set_digital_outputs(&motors, 1, 1));
    BAD(ECAN_ERR_AXIS, igh_cia402_set_digital_outputs(&motors, 2, 1));
    BAD(ECAN_ERR_AXIS, igh_cia402_set_target_with(&motors, 2, 0, 0, 0));
    GOOD(igh_cia402_set_target_with(&motors, 1, state_of(1).target, 1, 1));
    run_axes(&port, &motors, 2);
    SAME(0, state_of(1).velocity_offset);
    close_axes();
}

static igh_cia402_probe_t probe_of(uint8_t probe)
{
    igh_cia402_probe_t state;
    fill_garbage(2, &state, sizeof(state));
    GOOD(igh_cia402_get_probe(&motors, 0, probe, &state));
    SAME(0, state.reserved[0] | state.reserved[sizeof(state.reserved) - 1]);
    return state;
}

static void touch_probes(void)
{
    igh_cia402_probe_t state;
    int32_t target;

    init_axes();
    axes[0].outputs = IGH_CIA402_OUTPUT_PROBE_FUNCTION;
    axes[0].inputs = IGH_CIA402_INPUT_PROBE_STATUS | IGH_CIA402_INPUT_PROBE_1_POSITIVE |
                     IGH_CIA402_INPUT_PROBE_1_NEGATIVE;
    open_axes(2);
    GOOD(igh_cia402_start_up_timeout(&motors, 30000));
    SAME(0, probe_of(1).is_armed);
    BAD(ECAN_ERR_ARGUMENT, igh_cia402_arm_probe(&motors, 0, 0, IGH_CIA402_PROBE_POSITIVE));
    BAD(ECAN_ERR_ARGUMENT, igh_cia402_arm_probe(&motors, 0, 3, IGH_CIA402_PROBE_POSITIVE));
    BAD(ECAN_ERR_ARGUMENT, igh_cia402_arm_probe(&motors, 0, 1, 0));
    BAD(ECAN_ERR_ARGUMENT, igh_cia402_arm_probe(&motors, 0, 1, 17));
    BAD(ECAN_ERR_ARGUMENT, igh_cia402_arm_probe(&motors, 0, 1, IGH_CIA402_PROBE_INDEX_PULSE));
    BAD(ECAN_ERR_ARGUMENT, igh_cia402_disarm_probe(&motors, 0, 0));
    BAD(ECAN_ERR_ARGUMENT, igh_cia402_get_probe(&motors, 0, 3, &state));
    BAD(ECAN_ERR_AXIS_STATE, igh_cia402_arm_probe(&motors, 1, 1, IGH_CIA402_PROBE_POSITIVE));
    BAD(ECAN_ERR_AXIS, igh_cia402_arm_probe(&motors, 2, 1, IGH_CIA402_PROBE_POSITIVE));
    BAD(ECAN_ERR_AXIS, igh_cia402_disarm_probe(&motors, 2, 1));
    BAD(ECAN_ERR_AXIS, igh_cia402_get_probe(&motors, 2, 1, &state));

    GOOD(igh_cia402_arm_probe(&motors, 0, 1, IGH_CIA402_PROBE_POSITIVE));
    run_axes(&port, &motors, 20);
    SAME(1, probe_of(1).is_armed);
    SAME(0, probe_of(1).has_positive);
    /* The input is active from 50000 on. */
    target = state_of(0).target;
    for (int i = 0; i < CYCLES && !probe_of(1).has_positive; i++) {
        begin_axes(&port, &motors);
        target += 100;
        GOOD(igh_cia402_set_target(&motors, 0, target));
        end();
    }
    state = probe_of(1);
    SAME(1, state.has_positive);
    SAME(50000, state.positive);
    SAME(0, state.has_negative);
    TRUE(state_of(0).probe_status != 0);
    SAME(0, probe_of(2).is_armed);
    GOOD(igh_cia402_disarm_probe(&motors, 0, 1));
    run_axes(&port, &motors, 20);
    SAME(0, probe_of(1).is_armed);
    close_axes();
}

static void limits_and_units(void)
{
    igh_cia402_drive_limits_t limits;
    igh_cia402_drive_units_t units;
    char text[128];
    char cut[8];
    size_t needed;

    init_axes();
    axes[0].max_torque = 1500;
    axes[0].max_motor_speed = 120;
    axes[0].scale_source = IGH_CIA402_SCALE_CHECKED;
    axes[0].steps_per_turn = -65536.0;
    axes[1].use_drive_limits = 1;
    axes[1].has_bounds = 1;
    axes[1].write_position_limits = 1;
    axes[1].bound_min = -30000;
    axes[1].bound_max = 40000;
    axes[1].scale_source = IGH_CIA402_SCALE_CHECKED;
    axes[1].steps_per_turn = 360.0;
    axes[2].scale_source = IGH_CIA402_SCALE_DRIVE;
    open_axes(3);
    GOOD(igh_cia402_get_drive_limits(&motors, 0, &limits));
    SAME(0, limits.is_read);
    GOOD(igh_cia402_start_up_timeout(&motors, 30000));
    SAME(1500, axis_object(&motors, 0, 0x6072, 0));
    SAME(120, axis_object(&motors, 0, 0x6080, 0));
    memset(&limits, 0xA5, sizeof(limits));
    GOOD(igh_cia402_get_drive_limits(&motors, 0, &limits));
    SAME(1, limits.is_read);
    SAME(1, limits.has_max_torque);
    SAME(1500, limits.max_torque);
    SAME(120, limits.max_motor_speed);
    /* Two revolutions per second in 1 ms. */
    SAME(131, limits.step_limit);
    SAME(0, limits.reserved[0] | limits.reserved[sizeof(limits.reserved) - 1]);
    GOOD(igh_cia402_get_drive_limits(&motors, 1, &limits));
    SAME(1, limits.has_position);
    SAME(-30000, limits.position_min);
    SAME(40000, limits.position_max);
    SAME(1, limits.has_bounds);
    SAME(-30000, limits.bound_min);
    SAME(40000, limits.bound_max);

    memset(&units, 0xA5, sizeof(units));
    GOOD(igh_cia402_get_drive_units(&motors, 0, &units));
    SAME(1, units.is_read);
    SAME(65536, units.steps_per_turn);
    SAME(65536, units.encoder_increments / units.encoder_revolutions);
    SAME(IGH_CIA402_SCALE_FINDING_NONE, units.finding);
    SAME(0, units.reserved[0] | units.reserved[sizeof(units.reserved) - 1]);
    GOOD(igh_cia402_get_scale_text(&motors, 0, text, sizeof(text), &needed));
    SAME(1, needed);
    GOOD(igh_cia402_get_drive_units(&motors, 1, &units));
    SAME(IGH_CIA402_SCALE_FINDING_STEPS_PER_TURN, units.finding);
    GOOD(igh_cia402_get_scale_text(&motors, 1, text, sizeof(text), &needed));
    TEXT_HAS("steps_per_turn is 360, the drive has 65536", text);
    BAD(ECAN_ERR_BUFFER, igh_cia402_get_scale_text(&motors, 1, cut, sizeof(cut), &needed));
    SAME(strlen(text) + 1, needed);
    BAD(ECAN_ERR_AXIS, igh_cia402_get_drive_limits(&motors, 3, &limits));
    BAD(ECAN_ERR_AXIS, igh_cia402_get_drive_units(&motors, 3, &units));
    BAD(ECAN_ERR_AXIS, igh_cia402_get_scale_text(&motors, 3, text, sizeof(text), NULL));
    close_axes();
}

/* Interpolated position, profile torque, velocity, each with its objects in the drive. */
static void modes(void)
{
    int32_t from;
    int32_t target;

    init_axes();
    axes[0].mode = IGH_CIA402_MODE_IP;
    axes[0].interpolation_buffer = 3;
    axes[1].mode = IGH_CIA402_MODE_PT;
    axes[1].torque_slope = 20000;
    axes[1].inputs = IGH_CIA402_INPUT_TORQUE;
    axes[2].mode = IGH_CIA402_MODE_VL;
    axes[2].vl_velocity_min = 1;
    axes[2].vl_velocity_max = 2000;
    axes[2].vl_acceleration = 1000;
    axes[2].vl_acceleration_s = 1;
    axes[2].vl_deceleration = 2000;
    axes[2].vl_deceleration_s = 1;
    axes[2].inputs = IGH_CIA402_INPUT_VL_VELOCITY;
    for (size_t axis = 1; axis < 3; axis++) {
        axes[axis].target_step = 0;
        axes[axis].has_bounds = 1;
        axes[axis].bound_min = -500;
        axes[axis].bound_max = 500;
    }
    open_axes(3);
    GOOD(igh_cia402_start_up_timeout(&motors, 30000));
    SAME(IGH_CIA402_MODE_IP, state_of(0).mode);
    SAME(IGH_CIA402_MODE_PT, state_of(1).mode);
    SAME(IGH_CIA402_MODE_VL, state_of(2).mode);
    SAME(3, axis_object(&motors, 0, 0x60C4, 2));
    from = state_of(0).actual;
    target = state_of(0).target;
    for (int i = 0; i < 300; i++) {
        begin_axes(&port, &motors);
        target += 20;
        GOOD(igh_cia402_set_target(&motors, 0, target));
        GOOD(igh_cia402_set_target(&motors, 1, 100));
        GOOD(igh_cia402_set_target(&motors, 2, 100));
        end();
    }
    TRUE(state_of(0).actual > from + 5000);
    TRUE(state_of(1).torque > 50);
    TRUE(state_of(2).vl_velocity > 80 && state_of(2).vl_velocity < 120);
    SAME(1, igh_cia402_all_running(&motors));
    GOOD(igh_cia402_set_target(&motors, 2, 501));
    run_axes(&port, &motors, 1);
    SAME(IGH_CIA402_DECISION_REJECTED, state_of(2).decision);
    SAME(IGH_CIA402_REJECTION_BOUNDS, state_of(2).decision_reason);
    close_axes();
}

void test_cia402_further(void)
{
    static ecan_igh_config_t igh_config;
    static igh_mcan_port_config_t config;
    char setting[512];

    SAME(0, write_scenario("[[gateway]]\nbuses = [\"a\", \"b\", \"c\", \"d\"]\n"
                           "[[node]]\nkind = \"drive\"\nbus = \"a\"\nname = \"1\"\nnode_id = 1\n"
                           "serial = 100\n"
                           "[[node]]\nkind = \"drive\"\nbus = \"a\"\nname = \"2\"\nnode_id = 2\n"
                           "serial = 101\n"
                           "[[node]]\nkind = \"drive\"\nbus = \"a\"\nname = \"3\"\nnode_id = 3\n"
                           "serial = 102\n"
                           "[[node]]\nkind = \"drive\"\nbus = \"a\"\nname = \"4\"\nnode_id = 4\n"
                           "serial = 103\n",
                           setting, sizeof(setting)));
    simulate_channel(&igh_config, &config, setting, 1000000);
    SAME(0, start_port(&igh, &port, &igh_config, &config));
    identity();
    process_data();
    touch_probes();
    limits_and_units();
    modes();
    GOOD(ecan_igh_deinit(&igh));
    remove_scenario(setting);
}
