/* Observers in several threads in parallel with the cycle: every call returns one of its codes, every
 * snapshot is consistent, and the cycle never gets ECAN_ERR_BUSY.
 *
 *     observer_stress [CALLS]     default: 10000000 calls in total
 */
#define _POSIX_C_SOURCE 200809L

#include <inttypes.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "igh_observer.h"
#include "igh_sim.h"

#define AXES 4
#define THREADS 4
#define ENDS 200

static ecan_igh_context_t igh;
static igh_mcan_port_t port;
static igh_cia402_context_t motors;

/* One of a thread alone, one of two threads, and one that ends while commands are given. */
static ecan_igh_observer_t own;
static ecan_igh_observer_t shared;
static ecan_igh_observer_t short_lived;

/* Calls of each thread; only this thread counts. */
static uint64_t calls[THREADS];
static uint64_t calls_per_thread;
static pthread_barrier_t before_end;
/* Threads that have made all their calls. */
static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
static int finished;

static void fail(const char *call, int code)
{
    fprintf(stderr, "observer_stress: %s: %s (%s)\n", call, ecan_result_name(code),
            ecan_last_error());
    abort();
}

/* A call of a thread that returns ECAN_OK or `allowed`. Gives true for ECAN_OK. */
static int check(size_t thread, const char *call, int code, int allowed)
{
    calls[thread] += 1;
    if (code != ECAN_OK && code != allowed) {
        fail(call, code);
    }
    return code == ECAN_OK;
}

#define OR(thread, allowed, call) check(thread, #call, call, allowed)

static void check_channel(const igh_mcan_channel_statistics_t *it)
{
    const uint64_t sum = it->frames_delivered + it->frames_lost + it->frames_discarded
        + it->frames_unknown + it->frames_pending;
    if (it->frames_accepted != sum) {
        fprintf(stderr, "observer_stress: %" PRIu64 " frames accepted, %" PRIu64 " accounted\n",
                it->frames_accepted, sum);
        abort();
    }
}

/* Reads all parts of a snapshot. `allowed` is ECAN_ERR_BUSY for an observer of several threads. */
static void read_snapshot(size_t thread, ecan_igh_observer_t *observer, int allowed,
                          uint64_t *last_cycle)
{
    ecan_igh_observed_cycle_t cycle;
    ecan_igh_domain_report_t report;
    igh_mcan_statistics_t statistics;
    igh_mcan_channel_status_t status;
    igh_mcan_channel_statistics_t channel;
    igh_cia402_axis_state_t axis;

    OR(thread, allowed, ecan_igh_observer_update(observer));
    if (OR(thread, allowed, ecan_igh_observer_get_cycle(observer, &cycle))) {
        if (cycle.cycle < *last_cycle || cycle.slave_count != 1 || cycle.axis_count != AXES) {
            fprintf(stderr, "observer_stress: cycle %" PRIu64 " after %" PRIu64 "\n", cycle.cycle,
                    *last_cycle);
            abort();
        }
        *last_cycle = cycle.cycle;
    }
    if (OR(thread, allowed, ecan_igh_observer_get_domain_report(observer, 0, &report))
        && report.expected_working_counter == 0) {
        fail("ecan_igh_observer_get_domain_report", ECAN_ERR_INTERNAL);
    }
    OR(thread, allowed, igh_mcan_observer_get_statistics(observer, 0, &statistics));
    OR(thread, allowed, igh_mcan_observer_get_channel_status(observer, 0, 0, &status));
    if (OR(thread, allowed, igh_mcan_observer_get_channel_statistics(observer, 0, 0, &channel))) {
        check_channel(&channel);
    }
    for (size_t i = 0; i < AXES; ++i) {
        if (OR(thread, allowed, igh_cia402_observer_get_axis_state(observer, i, &axis))
            && (axis.node_id != i + 1 || axis.slave != 0)) {
            fail("igh_cia402_observer_get_axis_state", ECAN_ERR_INTERNAL);
        }
    }
    const int session = igh_mcan_observer_get_session(observer, 0);
    calls[thread] += 1;
    if (session < 0 && session != allowed) {
        fail("igh_mcan_observer_get_session", session);
    }
}

static void give_commands(size_t thread, ecan_igh_observer_t *observer, int allowed)
{
    uint64_t tickets[2] = { 0, 0 };
    int code;

    OR(thread, allowed, ecan_igh_observer_request_stop(observer, &tickets[0]));
    OR(thread, allowed, igh_cia402_observer_quick_stop(observer, calls[thread] % AXES, &tickets[1]));
    if (tickets[1] != 0 && tickets[1] <= tickets[0]) {
        fail("igh_cia402_observer_quick_stop", ECAN_ERR_INTERNAL);
    }
    OR(thread, allowed, igh_cia402_observer_quick_stop(observer, IGH_CIA402_ALL_AXES, NULL));
    code = igh_cia402_observer_quick_stop(observer, AXES, NULL);
    calls[thread] += 1;
    if (code != ECAN_ERR_AXIS && code != allowed) {
        fail("igh_cia402_observer_quick_stop of no axis", code);
    }
}

static void finish(void)
{
    pthread_mutex_lock(&mutex);
    finished += 1;
    pthread_mutex_unlock(&mutex);
}

static int is_finished(void)
{
    int is_last;

    pthread_mutex_lock(&mutex);
    is_last = finished == THREADS;
    pthread_mutex_unlock(&mutex);
    return is_last;
}

static void *read_alone(void *user)
{
    uint64_t last_cycle = 0;

    (void)user;
    while (calls[0] < calls_per_thread) {
        read_snapshot(0, &own, ECAN_OK, &last_cycle);
    }
    finish();
    return NULL;
}

static void *read_and_command(void *user)
{
    const size_t thread = *(const size_t *)user;
    uint64_t last_cycle = 0;

    while (calls[thread] < calls_per_thread) {
        read_snapshot(thread, &shared, ECAN_ERR_BUSY, &last_cycle);
        /* Commands never get it. */
        give_commands(thread, &shared, ECAN_OK);
    }
    finish();
    return NULL;
}

/* Commands to an observer that ends at the same time. */
static void *command_until_the_end(void *user)
{
    (void)user;
    for (int end = 0; end < ENDS; ++end) {
        pthread_barrier_wait(&before_end);
        while (ecan_igh_observer_request_stop(&short_lived, NULL) == ECAN_OK) {
            calls[3] += 1;
        }
        give_commands(3, &short_lived, ECAN_ERR_NOT_INITIALISED);
        pthread_barrier_wait(&before_end);
    }
    finish();
    return NULL;
}

static void cycle(void)
{
    if (igh_mcan_port_wait_next_cycle(&port) != ECAN_OK) {
        fail("igh_mcan_port_wait_next_cycle", ecan_last_error_code());
    }
    if (igh_mcan_port_cycle_begin(&port) != ECAN_OK) {
        fail("igh_mcan_port_cycle_begin", ecan_last_error_code());
    }
    if (igh_cia402_process_rx(&motors) != ECAN_OK) {
        fail("igh_cia402_process_rx", ecan_last_error_code());
    }
    if (igh_cia402_send_targets_all(&motors) < 0) {
        fail("igh_cia402_send_targets_all", ecan_last_error_code());
    }
    if (igh_mcan_port_cycle_end(&port) != ECAN_OK) {
        fail("igh_mcan_port_cycle_end", ecan_last_error_code());
    }
}

/* Returns an ecan_result_t. */
static int start(void)
{
    ecan_igh_config_t config;
    igh_mcan_port_config_t gateways;
    igh_cia402_axis_t axes[AXES];

    ecan_igh_default_config(&config);
    ecan_igh_config_set_ecrt(&config, "sim:drives");
    ecan_igh_config_set_stepped_clock(&config, 1);
    igh_mcan_port_default_config(&gateways);
    igh_mcan_port_set_classic_channel(&gateways, 0, 0, 1000000);
    igh_mcan_port_apply_config(&config, &gateways);
    for (size_t i = 0; i < AXES; ++i) {
        igh_cia402_axis_init(&axes[i], 0, 0, (uint8_t)(i + 1), 0);
    }
    if (ecan_igh_init(&igh, &config) != ECAN_OK
        || igh_mcan_port_init(&port, &igh, &gateways) != ECAN_OK
        || ecan_igh_wait_op_timeout(&igh, 20000) != ECAN_OK
        || igh_cia402_context_init(&motors, &port, axes, AXES) != ECAN_OK
        || igh_cia402_start_up_timeout(&motors, 20000) != ECAN_OK
        || ecan_igh_observer_init(&own, &igh) != ECAN_OK
        || ecan_igh_observer_init(&shared, &igh) != ECAN_OK) {
        return ecan_last_error_code();
    }
    cycle();
    return ECAN_OK;
}

int main(int argc, char **argv)
{
    const uint64_t total = argc > 1 ? strtoull(argv[1], NULL, 10) : 10000000;
    static const size_t numbers[] = { 1, 2 };
    pthread_t threads[THREADS];
    uint64_t cycles = 0;
    uint64_t ticket = 0;
    int code = start();

    if (code != ECAN_OK) {
        fail("start", code);
    }
    calls_per_thread = total / 3;
    pthread_barrier_init(&before_end, NULL, 2);
    pthread_create(&threads[0], NULL, read_alone, NULL);
    pthread_create(&threads[1], NULL, read_and_command, (void *)&numbers[0]);
    pthread_create(&threads[2], NULL, read_and_command, (void *)&numbers[1]);
    pthread_create(&threads[3], NULL, command_until_the_end, NULL);
    for (int end = 0; end < ENDS; ++end) {
        if (ecan_igh_observer_init(&short_lived, &igh) != ECAN_OK) {
            fail("ecan_igh_observer_init", ecan_last_error_code());
        }
        pthread_barrier_wait(&before_end);
        cycle();
        ecan_igh_observer_deinit(&short_lived);
        pthread_barrier_wait(&before_end);
        cycles += 1;
    }
    while (!is_finished()) {
        cycle();
        cycles += 1;
    }
    for (size_t i = 0; i < THREADS; ++i) {
        pthread_join(threads[i], NULL);
    }
    /* The last command is acknowledged by the next cycle. */
    if (ecan_igh_observer_request_stop(&shared, &ticket) != ECAN_OK
        || ecan_igh_is_stop_requested(&igh) != 1) {
        fail("ecan_igh_observer_request_stop", ecan_last_error_code());
    }
    cycle();
    if (ecan_igh_observer_update(&shared) != ECAN_OK
        || ecan_igh_observer_has_executed(&shared, ticket) != 1) {
        fail("ecan_igh_observer_has_executed", ecan_last_error_code());
    }
    ecan_igh_deinit(&igh);
    ecan_igh_observer_deinit(&own);
    ecan_igh_observer_deinit(&shared);
    pthread_barrier_destroy(&before_end);
    printf("observer_stress: %" PRIu64 " cycles; calls of the threads:", cycles);
    for (size_t i = 0; i < THREADS; ++i) {
        printf(" %" PRIu64, calls[i]);
    }
    printf("\n");
    return 0;
}
