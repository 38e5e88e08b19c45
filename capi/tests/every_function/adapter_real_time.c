/* igh_adapter.h: distributed clocks in the cycle, and the real-time thread. */
#include "check.h"

static void privileges(void)
{
    ecan_igh_real_time_t settings;
    char report[1024];
    int applied;

    GOOD(ecan_igh_default_real_time(&settings));

    /* No request, no report. */
    fill_garbage(1, report, sizeof(report));
    GOOD(ecan_igh_apply_real_time(&settings, report, sizeof(report), NULL));
    SAME(0, report[0]);
    GOOD(ecan_igh_apply_real_time(&settings, NULL, 0, NULL));

    settings.priority = 100;
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_apply_real_time(&settings, report, sizeof(report), NULL));
    ERROR_HAS("100");
    settings.priority = -1;
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_apply_real_time(&settings, report, sizeof(report), NULL));
    settings.priority = 0;
    settings.lock_memory = 1;
    settings.stack_bytes = UINT32_MAX;
    BAD(ECAN_ERR_ARGUMENT, ecan_igh_apply_real_time(&settings, report, sizeof(report), NULL));
    ERROR_HAS("stack");
    settings.lock_memory = 0;

    /* A CPU that most machines do not have: reported if it is optional, an error if it is
     * required. */
    settings.cpu_mask = UINT64_C(1) << 63;
    GOOD(ecan_igh_apply_real_time(&settings, report, sizeof(report), NULL));
    TEXT_HAS("CPU 63: not granted", report);
    BAD(ECAN_ERR_BUFFER, ecan_igh_apply_real_time(&settings, report, 8, NULL));
    SAME(7, strlen(report));
    settings.is_required = 1;
    BAD(ECAN_ERR_PRIVILEGE, ecan_igh_apply_real_time(&settings, report, sizeof(report), NULL));
    ERROR_HAS("CPU 63");
    TEXT_HAS("CPU 63", report);

    /* Text, granted or denied. */
    settings.is_required = 0;
    settings.cpu_mask = 0;
    settings.priority = 1;
    applied = ecan_igh_apply_real_time(&settings, report, sizeof(report), NULL);
    SAME(ECAN_OK, applied);
    TEXT_HAS("SCHED_FIFO priority 1: ", report);
}

static void cycles(ecan_igh_context_t *context, int count)
{
    for (int cycle = 0; cycle < count; cycle++) {
        GOOD(ecan_igh_wait_next_cycle(context));
        GOOD(ecan_igh_receive(context));
        GOOD(ecan_igh_send(context));
    }
}

static void statistics(ecan_igh_context_t *context)
{
    ecan_igh_cycle_statistics_t measured;
    ecan_igh_cycle_start_t start;
    char text[512];

    BAD(ECAN_ERR_ARGUMENT, ecan_igh_set_cycle_timing(context, 1001, 0));
    GOOD(ecan_igh_set_cycle_timing(context, 1000, 3));
    GOOD(ecan_igh_set_cycle_timing(context, 0, 0));
    BAD(ECAN_ERR_ORDER, ecan_igh_get_cycle_statistics(context, &measured));
    ERROR_HAS("ecan_igh_measure_cycles");
    BAD(ECAN_ERR_ORDER, ecan_igh_get_cycle_statistics_text(context, text, sizeof(text), NULL));
    GOOD(ecan_igh_measure_cycles(context));
    GOOD(ecan_igh_get_cycle_statistics(context, &measured));
    SAME(0, measured.cycles);
    SAME(0, measured.period.count);
    cycles(context, 101);
    GOOD(ecan_igh_get_cycle_start(context, &start));
    SAME(ecan_igh_cycle_time_ns(context), start.deadline_ns);
    SAME(0, start.skipped);
    SAME(0, start.has_overrun);
    GOOD(ecan_igh_get_cycle_statistics(context, &measured));
    SAME(101, measured.cycles);
    SAME(100, measured.period.count);
    SAME(1000000, measured.period.min_ns);
    SAME(1000000, measured.period.max_ns);
    SAME(101, measured.run_time.count);
    SAME(0, measured.skipped);
    SAME(0, measured.max_period_error_ns);
    GOOD(ecan_igh_get_cycle_statistics_text(context, text, sizeof(text), NULL));
    TEXT_HAS("master_period: min/max 1000.000/1000.000 us", text);
    TEXT_HAS("cycles 101, overruns 0, skipped 0", text);
}

static void bring_up(ecan_igh_context_t *context, int sync0, int source)
{
    static ecan_igh_config_t config;
    static igh_mcan_port_config_t port_config;

    simulate(&config, "sim:echo");
    if (sync0) {
        GOOD(ecan_igh_config_set_dc_sync0(&config, 1000, 300));
        GOOD(ecan_igh_config_set_dc_source(&config, source));
        GOOD(ecan_igh_config_set_dc_monitor(&config, 1));
    }
    GOOD(igh_mcan_port_default_config(&port_config));
    GOOD(igh_mcan_port_set_classic_channel(&port_config, 0, 0, 1000000));
    GOOD(igh_mcan_port_apply_config(&config, &port_config));
    GOOD(ecan_igh_init(context, &config));
    GOOD(ecan_igh_wait_op_timeout(context, 20000));
}

void test_adapter_real_time(void)
{
    ecan_igh_context_t context;
    ecan_igh_clock_status_t clocks;

    privileges();

    bring_up(&context, 0, 0);
    BAD(ECAN_ERR_ORDER, ecan_igh_get_clock_status(&context, &clocks));
    SAME(0, ecan_igh_clock_correction_ns(&context));
    statistics(&context);
    GOOD(ecan_igh_deinit(&context));

    for (int source = ECAN_IGH_CLOCK_HOST; source <= ECAN_IGH_CLOCK_REFERENCE; source++) {
        bring_up(&context, 1, source);
        cycles(&context, 1000);
        GOOD(ecan_igh_get_clock_status(&context, &clocks));
        SAME(1, clocks.has_phase_error);
        SAME(1, clocks.has_synchrony);
        SAME(1, clocks.is_locked);
        TRUE(clocks.phase_error_ns > -1000 && clocks.phase_error_ns < 1000);
        TRUE(clocks.synchrony_ns < 1000);
        SAME(0, clocks.missed_readings);
        TRUE(ecan_igh_clock_correction_ns(&context) <= 10);
        GOOD(ecan_igh_deinit(&context));
    }
}
