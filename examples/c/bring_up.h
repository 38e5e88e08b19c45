/* From the options to ready gateways: steps 3 to 5 of the manual (15.5.2). */
#ifndef BRING_UP_H
#define BRING_UP_H

#include <stdbool.h>
#include <stdint.h>

#include "igh_mcan_port.h"
#include "options.h"

/* Settings of the programs for the SDK, mostly from the command line. */
typedef struct {
    const char *ecrt;     /* NULL: the environment decides */
    const char *scenario; /* scenario of a plain "sim" */
    uint64_t master;
    uint64_t slaves;         /* number of gateways */
    uint64_t first_position; /* position of the first one; the others follow */
    uint64_t pdo_n; /* 0: by the kind of CAN */
    bool large_pdos;
    uint64_t cycle_us;
    uint8_t channel_masks[ECAN_IGH_MAX_SLAVES]; /* enabled channels of each gateway */
    uint64_t bitrate;
    uint64_t fd_bitrate; /* data bit rate of CAN FD; 0 for classic CAN */
    uint64_t profile;
    bool align4;
    bool skip_sdo_config;
    bool dc_sync0;
    uint64_t dc_cycle_us; /* 0: the cycle */
    uint64_t dc_shift_us;
    bool is_dc_shift_given; /* false: that of the plan */
    bool rejects_dc_shift;  /* one among the arrivals of the plan, unless measured */
    bool is_dc_shift_measured;
    uint8_t fd_masks[ECAN_IGH_MAX_SLAVES]; /* channels among them with CAN FD */
    const char *config; /* file in place of the options, except for the library; NULL: none */
    uint64_t seed;
    bool is_seed_given;
    bool real_time;
    bool plan;
} bus_settings_t;

/* The master and the Port on it. */
typedef struct {
    ecan_igh_context_t igh;
    igh_mcan_port_t mcan;
} bus_t;

/* One gateway at position 0, with the manual's first values. */
void bus_settings_default(bus_settings_t *settings, const char *scenario);

/* --ecrt, --master, --pdo-n, --cycle-us, --bitrate, --seed, --real-time */
void bus_settings_add_options(bus_settings_t *settings, option_list_t *list);

/* --fd */
void bus_settings_add_fd_option(bus_settings_t *settings, option_list_t *list);

/* --dc-sync0, --dc-cycle-us, --dc-shift-us */
void bus_settings_add_dc_options(bus_settings_t *settings, option_list_t *list);

/* --config, which excludes the options about the bus */
void bus_settings_add_config_option(bus_settings_t *settings, option_list_t *list);

/* Reads gateways, channels and cycle from the configuration file. Returns false, with every
 * fault of the file on standard error. */
bool bus_settings_read_config(bus_settings_t *settings);

/* --plan */
void bus_settings_add_plan_option(bus_settings_t *settings, option_list_t *list);

/* Makes the configurations of the settings. Returns false, with a message on standard error, if
 * the SDK rejects a value. */
bool bus_settings_configure(const bus_settings_t *settings, ecan_igh_config_t *igh_config,
                            igh_mcan_port_config_t *mcan_config);

/* Opens the gateways and waits until they are ready. Returns false, with a message on standard
 * error, if they do not become ready. */
bool bring_up(bus_t *bus, const bus_settings_t *settings);

/* Releases the master. */
bool shut_down(bus_t *bus);

#endif /* BRING_UP_H */
