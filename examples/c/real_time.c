#include "real_time.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "igh_real_time.h"
#include "report.h"

enum { STACK_BYTES = 256 * 1024, MAX_CPUS = 64 };

void real_time_add_options(real_time_t *settings, option_list_t *list)
{
    options_add(list, (option_t){
        .name = "rt-priority", .value_name = "PRIORITY", .number = &settings->priority,
        .minimum = 1, .maximum = 99,
        .help = "Run under SCHED_FIFO with this priority, 1 to 99"});
    options_add(list, (option_t){
        .name = "cpu", .value_name = "CPU", .text = &settings->cpus,
        .help = "Run on these CPUs only, comma-separated, 0 to 63"});
    options_add(list, (option_t){
        .name = "lock-memory", .flag = &settings->lock_memory,
        .help = "Lock all memory in RAM"});
    options_add(list, (option_t){
        .name = "rt-required", .flag = &settings->is_required,
        .help = "Fail if the system denies a requested real-time setting"});
    options_add(list, (option_t){
        .name = "cpu-latency-us", .value_name = "US", .number = &settings->latency_us,
        .maximum = INT32_MAX, .is_given = &settings->is_latency_given,
        .help = "Limit the exit latency of CPU sleep states, in microseconds"});
    options_add(list, (option_t){
        .name = "spin-us", .value_name = "US", .number = &settings->spin_us, .maximum = 1000,
        .help = "Spin instead of sleeping for this time before each cycle, in microseconds"});
}

void real_time_check(real_time_t *settings)
{
    const char *rest = settings->cpus;
    settings->cpu_mask = 0;
    while (rest != NULL) {
        char text[24] = "";
        uint64_t cpu = 0;
        size_t length = strcspn(rest, ",");
        memcpy(text, rest, length < sizeof(text) ? length : sizeof(text) - 1);
        if (!parse_number(text, &cpu) || cpu >= MAX_CPUS) {
            options_wrong_use("--cpu %s: expected numbers from 0 to %d, comma-separated",
                              settings->cpus, MAX_CPUS - 1);
        }
        settings->cpu_mask |= UINT64_C(1) << cpu;
        rest = rest[length] == ',' ? rest + length + 1 : NULL;
    }
}

static bool is_given(const real_time_t *settings)
{
    return settings->priority != 0 || settings->cpus != NULL || settings->lock_memory ||
           settings->is_required || settings->is_latency_given || settings->spin_us != 0;
}

bool real_time_enter(const real_time_t *settings, bus_t *bus)
{
    ecan_igh_real_time_t requests;
    char text[2048] = "";
    if (!is_given(settings)) {
        return true;
    }
    ecan_igh_default_real_time(&requests);
    requests.priority = (int32_t)settings->priority;
    requests.lock_memory = settings->lock_memory;
    requests.stack_bytes = settings->lock_memory ? STACK_BYTES : 0;
    requests.is_required = settings->is_required;
    requests.cpu_mask = settings->cpu_mask;
    if (settings->is_latency_given) {
        requests.wake_up_latency_us = (int32_t)settings->latency_us;
    }
    int code = ecan_igh_apply_real_time(&requests, text, sizeof(text), NULL);
    printf("%s%s", text, text[0] == '\0' ? "" : "\n");
    if (code != ECAN_OK ||
        ecan_igh_set_cycle_timing(&bus->igh, (uint32_t)settings->spin_us, 0) != ECAN_OK ||
        ecan_igh_measure_cycles(&bus->igh) != ECAN_OK) {
        report_sdk_error();
        return false;
    }
    return true;
}

void real_time_print_statistics(const real_time_t *settings, bus_t *bus)
{
    char text[512];
    if (is_given(settings) &&
        ecan_igh_get_cycle_statistics_text(&bus->igh, text, sizeof(text), NULL) == ECAN_OK) {
        printf("\n%s\n", text);
    }
}
