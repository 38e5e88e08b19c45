/* igh_observer.h: snapshots and commands, with good and bad arguments. */
#include <signal.h>

#include "check.h"

static ecan_igh_context_t igh;
static igh_mcan_port_t port;
static igh_cia402_context_t motors;
static ecan_igh_observer_t observer;

/* Commands store no text. */
#define CODE(code, call) SAME(code, call)

static void cycles(int count)
{
    for (int i = 0; i < count; ++i) {
        GOOD(igh_mcan_port_wait_next_cycle(&port));
        GOOD(igh_mcan_port_cycle_begin(&port));
        GOOD(igh_cia402_process_rx(&motors));
        SAME(1, igh_cia402_send_targets_all(&motors) >= 0);
        GOOD(igh_mcan_port_cycle_end(&port));
    }
}

static void reject_wrong_handles(void)
{
    ecan_igh_observed_cycle_t cycle;
    ecan_igh_domain_report_t report;
    igh_mcan_statistics_t statistics;
    igh_mcan_channel_status_t status;
    igh_mcan_channel_statistics_t channel;
    igh_cia402_axis_state_t axis;
    uint64_t ticket;

    for (int kind = -1; kind < GARBAGE_KINDS; ++kind) {
        ecan_igh_observer_t *wrong = kind < 0 ? NULL : &observer;
        const int code = kind < 0 ? ECAN_ERR_NULL : ECAN_ERR_NOT_INITIALISED;
        if (kind >= 0) {
            check_about(fill_garbage(kind, &observer, sizeof(observer)));
        }
        BAD(code, ecan_igh_observer_update(wrong));
        BAD(code, ecan_igh_observer_get_cycle(wrong, &cycle));
        BAD(code, ecan_igh_observer_get_domain_report(wrong, 0, &report));
        NONE(code, 0, ecan_igh_observer_has_executed(wrong, 1));
        BAD(code, igh_mcan_observer_get_session(wrong, 0));
        BAD(code, igh_mcan_observer_get_statistics(wrong, 0, &statistics));
        BAD(code, igh_mcan_observer_get_channel_status(wrong, 0, 0, &status));
        BAD(code, igh_mcan_observer_get_channel_statistics(wrong, 0, 0, &channel));
        BAD(code, igh_cia402_observer_get_axis_state(wrong, 0, &axis));
        CODE(code, ecan_igh_observer_request_stop(wrong, &ticket));
        CODE(code, igh_cia402_observer_quick_stop(wrong, 0, &ticket));
        if (kind >= 0) {
            GOOD(ecan_igh_observer_deinit(wrong));
        } else {
            BAD(code, ecan_igh_observer_deinit(wrong));
        }
    }
    check_about(NULL);
}

static void read_before_the_axes(void)
{
    ecan_igh_observed_cycle_t cycle;
    igh_mcan_statistics_t statistics;
    igh_cia402_axis_state_t axis;

    BAD(ECAN_ERR_NOT_READY, ecan_igh_observer_update(&observer));
    BAD(ECAN_ERR_NOT_READY, ecan_igh_observer_get_cycle(&observer, &cycle));
    BAD(ECAN_ERR_NOT_READY, igh_mcan_observer_get_statistics(&observer, 0, &statistics));
    GOOD(ecan_igh_wait_op_timeout(&igh, 20000));
    GOOD(ecan_igh_observer_update(&observer));
    GOOD(ecan_igh_observer_get_cycle(&observer, &cycle));
    TRUE(cycle.cycle > 0);
    SAME(1, cycle.slave_count);
    SAME(1, cycle.has_port);
    SAME(1, cycle.has_deadline);
    SAME(0, cycle.axis_count);
    for (size_t i = 0; i < ITEMS(cycle.reserved); ++i) {
        SAME(0, cycle.reserved[i]);
    }
    BAD(ECAN_ERR_NOT_READY, igh_cia402_observer_get_axis_state(&observer, 0, &axis));
    CODE(ECAN_ERR_AXIS, igh_cia402_observer_quick_stop(&observer, 0, NULL));
    CODE(ECAN_ERR_AXIS, igh_cia402_observer_quick_stop(&observer, IGH_CIA402_ALL_AXES, NULL));
}

/* The observer returns what the functions of the cycle's thread return after the same cycle. */
static void compare(void)
{
    ecan_igh_observed_cycle_t cycle;
    ecan_igh_domain_report_t reports[2];
    igh_mcan_statistics_t statistics[2];
    igh_mcan_channel_status_t status[2];
    igh_mcan_channel_statistics_t channels[2];
    igh_cia402_axis_state_t axes[2];

    GOOD(ecan_igh_observer_update(&observer));
    GOOD(ecan_igh_observer_get_cycle(&observer, &cycle));
    SAME(ecan_igh_cycle_time_ns(&igh), cycle.time_ns);
    SAME(2, cycle.axis_count);
    memset(reports, 0, sizeof(reports));
    memset(statistics, 0, sizeof(statistics));
    memset(status, 0, sizeof(status));
    memset(channels, 0, sizeof(channels));
    memset(axes, 0, sizeof(axes));
    GOOD(ecan_igh_get_domain_report(&igh, 0, &reports[0]));
    GOOD(ecan_igh_observer_get_domain_report(&observer, 0, &reports[1]));
    SAME(0, memcmp(&reports[0], &reports[1], sizeof(reports[0])));
    SAME(igh_mcan_port_get_session(&port, 0), igh_mcan_observer_get_session(&observer, 0));
    GOOD(igh_mcan_port_get_statistics(&port, 0, &statistics[0]));
    GOOD(igh_mcan_observer_get_statistics(&observer, 0, &statistics[1]));
    SAME(0, memcmp(&statistics[0], &statistics[1], sizeof(statistics[0])));
    for (uint8_t channel = 0; channel < 4; ++channel) {
        GOOD(igh_mcan_port_get_channel_status(&port, 0, channel, &status[0]));
        GOOD(igh_mcan_observer_get_channel_status(&observer, 0, channel, &status[1]));
        SAME(0, memcmp(&status[0], &status[1], sizeof(status[0])));
        GOOD(igh_mcan_port_get_channel_statistics(&port, 0, channel, &channels[0]));
        GOOD(igh_mcan_observer_get_channel_statistics(&observer, 0, channel, &channels[1]));
        SAME(0, memcmp(&channels[0], &channels[1], sizeof(channels[0])));
    }
    for (size_t axis = 0; axis < 2; ++axis) {
        GOOD(igh_cia402_get_axis_state(&motors, axis, &axes[0]));
        GOOD(igh_cia402_observer_get_axis_state(&observer, axis, &axes[1]));
        SAME(0, memcmp(&axes[0], &axes[1], sizeof(axes[0])));
    }
}

static void reject_wrong_indices(void)
{
    ecan_igh_domain_report_t report;
    igh_mcan_statistics_t statistics;
    igh_mcan_channel_status_t status;
    igh_mcan_channel_statistics_t channel;
    igh_cia402_axis_state_t axis;

    BAD(ECAN_ERR_SLAVE, ecan_igh_observer_get_domain_report(&observer, 1, &report));
    BAD(ECAN_ERR_SLAVE, igh_mcan_observer_get_session(&observer, 1));
    BAD(ECAN_ERR_SLAVE, igh_mcan_observer_get_statistics(&observer, 1, &statistics));
    BAD(ECAN_ERR_SLAVE, igh_mcan_observer_get_channel_status(&observer, 1, 0, &status));
    BAD(ECAN_ERR_SLAVE, igh_mcan_observer_get_channel_statistics(&observer, 1, 0, &channel));
    BAD(ECAN_ERR_CHANNEL, igh_mcan_observer_get_channel_status(&observer, 0, 4, &status));
    BAD(ECAN_ERR_CHANNEL, igh_mcan_observer_get_channel_statistics(&observer, 0, 4, &channel));
    BAD(ECAN_ERR_AXIS, igh_cia402_observer_get_axis_state(&observer, 2, &axis));
    CODE(ECAN_ERR_AXIS, igh_cia402_observer_quick_stop(&observer, 2, NULL));
}

static void on_signal(int number)
{
    (void)number;
    igh_cia402_observer_quick_stop(&observer, IGH_CIA402_ALL_AXES, NULL);
    ecan_igh_observer_request_stop(&observer, NULL);
}

static void give_commands(void)
{
    uint64_t first = 0;
    uint64_t second = 0;
    igh_cia402_axis_state_t axis;

    CODE(ECAN_OK, igh_cia402_observer_quick_stop(&observer, 1, &first));
    TRUE(first > 0);
    SAME(0, ecan_igh_observer_has_executed(&observer, first));
    cycles(1);
    GOOD(ecan_igh_observer_update(&observer));
    SAME(1, ecan_igh_observer_has_executed(&observer, first));
    GOOD(igh_cia402_observer_get_axis_state(&observer, 1, &axis));
    SAME(IGH_CIA402_STOP_CAUSE_QUICK_STOP, axis.stop_cause);
    GOOD(igh_cia402_observer_get_axis_state(&observer, 0, &axis));
    SAME(IGH_CIA402_STOP_CAUSE_NONE, axis.stop_cause);

    CODE(ECAN_OK, ecan_igh_observer_request_stop(&observer, &second));
    TRUE(second != 0 && second != first);
    SAME(1, ecan_igh_is_stop_requested(&igh));
    SAME(0, ecan_igh_observer_has_executed(&observer, second));
    /* Takes effect without targets. */
    GOOD(igh_mcan_port_wait_next_cycle(&port));
    GOOD(igh_mcan_port_cycle_begin(&port));
    GOOD(igh_mcan_port_cycle_end(&port));
    GOOD(ecan_igh_observer_update(&observer));
    SAME(1, ecan_igh_observer_has_executed(&observer, second));
    CODE(ECAN_ERR_AXIS, igh_cia402_observer_quick_stop(&observer, 2, &second));
    SAME(0, second);
    SAME(0, ecan_igh_observer_has_executed(&observer, second));
    BAD(ECAN_ERR_STOPPED, igh_cia402_enable_all_timeout(&motors, 20000));
    GOOD(ecan_igh_clear_stop_request(&igh));
    SAME(0, ecan_igh_is_stop_requested(&igh));
    GOOD(igh_cia402_enable_all_timeout(&motors, 20000));

    TRUE(signal(SIGUSR1, on_signal) != SIG_ERR);
    SAME(0, raise(SIGUSR1));
    SAME(1, ecan_igh_is_stop_requested(&igh));
    cycles(1);
    GOOD(igh_cia402_get_axis_state(&motors, 0, &axis));
    SAME(IGH_CIA402_STOP_CAUSE_QUICK_STOP, axis.stop_cause);
    TRUE(signal(SIGUSR1, SIG_DFL) != SIG_ERR);
    /* A shutdown is not stopped. */
    GOOD(igh_cia402_shutdown_timeout(&motors, 20000));
    GOOD(ecan_igh_clear_stop_request(&igh));
}

static void live_and_end(void)
{
    ecan_igh_observer_t copy = observer;
    ecan_igh_observer_t second;
    ecan_igh_observed_cycle_t cycle;

    BAD(ECAN_ERR_ORDER, ecan_igh_observer_init(&observer, &igh));
    BAD(ECAN_ERR_NOT_INITIALISED, ecan_igh_observer_update(&copy));
    GOOD(ecan_igh_observer_init(&second, &igh));
    /* Overwritten memory can be initialised again. */
    memset(&second, 0, sizeof(second));
    GOOD(ecan_igh_observer_init(&second, &igh));
    GOOD(ecan_igh_observer_deinit(&second));
    GOOD(ecan_igh_observer_deinit(&second));
    CODE(ECAN_ERR_NOT_INITIALISED, ecan_igh_observer_request_stop(&second, NULL));
    SAME(0, ecan_igh_is_stop_requested(&igh));

    GOOD(ecan_igh_deinit(&igh));
    BAD(ECAN_ERR_ORDER, ecan_igh_observer_update(&observer));
    GOOD(ecan_igh_observer_get_cycle(&observer, &cycle));
    TRUE(cycle.cycle > 0);
    CODE(ECAN_ERR_ORDER, ecan_igh_observer_request_stop(&observer, NULL));
    CODE(ECAN_ERR_ORDER, igh_cia402_observer_quick_stop(&observer, 0, NULL));
    GOOD(ecan_igh_observer_deinit(&observer));
}

void test_observer(void)
{
    ecan_igh_config_t config;
    igh_mcan_port_config_t gateways;
    igh_cia402_axis_t axes[2];

    reject_wrong_handles();
    memset(&igh, 0, sizeof(igh));
    BAD(ECAN_ERR_NOT_INITIALISED, ecan_igh_observer_init(&observer, &igh));
    NONE(ECAN_ERR_NOT_INITIALISED, 0, ecan_igh_is_stop_requested(&igh));
    BAD(ECAN_ERR_NOT_INITIALISED, ecan_igh_clear_stop_request(&igh));

    simulate_channel(&config, &gateways, "sim:drives", 1000000);
    GOOD(igh_mcan_port_apply_config(&config, &gateways));
    GOOD(ecan_igh_init(&igh, &config));
    GOOD(ecan_igh_observer_init(&observer, &igh));
    GOOD(igh_mcan_port_init(&port, &igh, &gateways));
    read_before_the_axes();
    GOOD(igh_cia402_axis_init(&axes[0], 0, 0, 1, 0));
    GOOD(igh_cia402_axis_init(&axes[1], 0, 0, 2, 0));
    GOOD(igh_cia402_context_init(&motors, &port, axes, 2));
    GOOD(igh_cia402_start_up_timeout(&motors, 20000));
    for (int i = 0; i < 20; ++i) {
        cycles(1);
        compare();
    }
    reject_wrong_indices();
    give_commands();
    live_and_end();
}
