/* What gateways have to tell: when they go out of service and come back, and a table at the end. */
#ifndef GATEWAY_REPORT_H
#define GATEWAY_REPORT_H

#include <stdbool.h>
#include <stdint.h>

#include "bring_up.h"

/* The sessions as last seen. */
typedef struct {
    int sessions[ECAN_IGH_MAX_SLAVES];
} session_watch_t;

/* Starts with gateways that are in service. */
void session_watch_init(session_watch_t *watch);

/* Prints a line for every gateway whose session changed since the last call. */
void session_watch_print(session_watch_t *watch, bus_t *bus, uint64_t elapsed_ns);

/* Prints the counters of all gateways and channels. */
bool gateway_report_print(bus_t *bus, const bus_settings_t *settings);

/* Whether a gateway is in service and nothing was lost on the way from it; says what is not so. */
bool gateway_report_is_flawless(bus_t *bus, size_t slave);

#endif /* GATEWAY_REPORT_H */
