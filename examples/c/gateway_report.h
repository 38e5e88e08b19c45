/* Reports of the gateways: lost and ready sessions, and a table at the end. */
#ifndef GATEWAY_REPORT_H
#define GATEWAY_REPORT_H

#include <stdbool.h>
#include <stdint.h>

#include "bring_up.h"

/* Last reported sessions. */
typedef struct {
    int sessions[ECAN_IGH_MAX_SLAVES];
} session_watch_t;

/* Starts with ready gateways. */
void session_watch_init(session_watch_t *watch);

/* Prints a line for every gateway whose session changed since the last call. */
void session_watch_print(session_watch_t *watch, bus_t *bus, uint64_t elapsed_ns);

/* Returns true while the delivery of a frame is not proven yet. */
bool gateway_report_has_pending(bus_t *bus, const bus_settings_t *settings);

/* Prints the counters of all gateways and channels. */
bool gateway_report_print(bus_t *bus, const bus_settings_t *settings);

/* Returns true if a gateway is ready and nothing that it sent was lost; prints each fault. */
bool gateway_report_is_flawless(bus_t *bus, size_t slave);

#endif /* GATEWAY_REPORT_H */
