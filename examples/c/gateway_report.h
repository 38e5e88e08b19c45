/* Reports of the gateways: what was lost and returned, and a table at the end. */
#ifndef GATEWAY_REPORT_H
#define GATEWAY_REPORT_H

#include <stdbool.h>
#include <stdint.h>

#include "bring_up.h"

/* Prints what changed at gateways and channels since the last call. */
void gateway_report_print_changes(bus_t *bus);

/* Returns true while the delivery of a frame is not proven yet. */
bool gateway_report_has_pending(bus_t *bus, const bus_settings_t *settings);

/* Prints the counters of all gateways and channels. */
bool gateway_report_print(bus_t *bus, const bus_settings_t *settings);

/* Returns true if a gateway is ready and nothing that it sent was lost; prints each fault. */
bool gateway_report_is_flawless(bus_t *bus, size_t slave);

#endif /* GATEWAY_REPORT_H */
