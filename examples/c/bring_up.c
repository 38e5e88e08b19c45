#include "bring_up.h"

#include <stdio.h>
#include <string.h>

#include "igh_sim.h"
#include "interrupt.h"
#include "report.h"

void bus_settings_default(bus_settings_t *settings, const char *scenario)
{
    memset(settings, 0, sizeof(*settings));
    settings->scenario = scenario;
    settings->slaves = 1;
    settings->cycle_us = ECAN_DEFAULT_CYCLE_US;
    settings->bitrate = 1000000;
}

void bus_settings_add_options(bus_settings_t *settings, option_list_t *list)
{
    options_add(list, (option_t){
        .name = "ecrt", .value_name = "SETTING", .text = &settings->ecrt,
        .help = "EtherCAT master library: a path, `sim` for the built-in simulator, `sim:NAME` or "
                "`sim:FILE.toml` for a scenario of it. Unset: the environment variable ECAN_ECRT, "
                "then the installed libethercat"});
    options_add(list, (option_t){
        .name = "master", .value_name = "N", .number = &settings->master, .maximum = UINT32_MAX,
        .excluded_by = "config",
        .help = "Index of the EtherCAT master"});
    options_add(list, (option_t){
        .name = "pdo-n", .value_name = "N", .number = &settings->pdo_n,
        .minimum = 1, .maximum = ECAN_PDO_MAX_MULTIPLIER,
        .excluded_by = "config",
        .help = "PDO size per direction, in chunks of 128 bytes [default: 3, with CAN FD 8]"});
    options_add(list, (option_t){
        .name = "large-pdos", .flag = &settings->large_pdos, .excluded_by = "config",
        .help = "The installed master supports more than 1486 bytes of process data per sync "
                "manager"});
    options_add(list, (option_t){
        .name = "cycle-us", .value_name = "US", .number = &settings->cycle_us,
        .minimum = 1, .maximum = 4294967,
        .excluded_by = "config",
        .help = "EtherCAT cycle in microseconds"});
    options_add(list, (option_t){
        .name = "bitrate", .value_name = "BITRATE", .number = &settings->bitrate,
        .minimum = 1, .maximum = UINT32_MAX, .is_bit_rate = true,
        .excluded_by = "config",
        .help = "CAN bit rate in bit/s, or 500k, 1M; nominal for CAN FD"});
    options_add(list, (option_t){
        .name = "seed", .value_name = "SEED", .number = &settings->seed, .maximum = UINT64_MAX,
        .is_given = &settings->is_seed_given,
        .help = "Seed of the random numbers of a simulation"});
    options_add(list, (option_t){
        .name = "real-time", .flag = &settings->real_time,
        .help = "Run a simulation in wall-clock time instead of at full speed"});
}

void bus_settings_add_fd_option(bus_settings_t *settings, option_list_t *list)
{
    options_add(list, (option_t){
        .name = "fd", .value_name = "DATA_BITRATE", .number = &settings->fd_bitrate,
        .minimum = 1, .maximum = UINT32_MAX, .is_bit_rate = true,
        .excluded_by = "config",
        .help = "Use CAN FD with this data bit rate in bit/s, or 2M"});
}

void bus_settings_add_dc_options(bus_settings_t *settings, option_list_t *list)
{
    options_add(list, (option_t){
        .name = "dc-sync0", .flag = &settings->dc_sync0,
        .help = "Use distributed clocks with Sync0"});
    options_add(list, (option_t){
        .name = "dc-cycle-us", .value_name = "US", .number = &settings->dc_cycle_us,
        .minimum = 1, .maximum = 4294967,
        .help = "Period of Sync0 in microseconds [default: the cycle]"});
    options_add(list, (option_t){
        .name = "dc-shift-us", .value_name = "US", .number = &settings->dc_shift_us,
        .maximum = 4294967, .is_given = &settings->is_dc_shift_given,
        .help = "Shift of Sync0 in microseconds [default: the middle of the usable ones, by the "
                "plan]"});
}

void bus_settings_add_config_option(bus_settings_t *settings, option_list_t *list)
{
    options_add(list, (option_t){
        .name = "config", .value_name = "FILE", .text = &settings->config,
        .help = "Read gateways, channels, bit rates, filters, cycle and clocks from this "
                "configuration file (`ecan config init` prints one); `-` is standard input"});
}

void bus_settings_add_plan_option(bus_settings_t *settings, option_list_t *list)
{
    options_add(list, (option_t){
        .name = "plan", .flag = &settings->plan,
        .excluded_by = "config",
        .help = "Print the load of wire, buses and mailboxes, with warnings and errors, "
                "without touching a bus"});
}

/* Library and simulation, which a configuration file does not contain. */
static bool configure_library(ecan_igh_config_t *config, const bus_settings_t *settings)
{
    if (ecan_igh_default_config(config) != ECAN_OK ||
        ecan_igh_config_suggest_scenario(config, settings->scenario) != ECAN_OK ||
        ecan_igh_config_set_stepped_clock(config, !settings->real_time) != ECAN_OK) {
        return false;
    }
    if (settings->ecrt != NULL && ecan_igh_config_set_ecrt(config, settings->ecrt) != ECAN_OK) {
        return false;
    }
    return !settings->is_seed_given ||
           ecan_igh_config_set_seed(config, settings->seed) == ECAN_OK;
}

/* After the slaves, their PDO size and the cycle, which determine the planned shift. */
static bool configure_sync0(ecan_igh_config_t *config, const bus_settings_t *settings)
{
    uint64_t dc_cycle_us = settings->dc_cycle_us != 0 ? settings->dc_cycle_us : settings->cycle_us;
    if (!settings->is_dc_shift_given) {
        return ecan_igh_config_set_dc_sync0_planned(config, (uint32_t)dc_cycle_us) == ECAN_OK;
    }
    return ecan_igh_config_set_dc_sync0(config, (uint32_t)dc_cycle_us,
                                        (uint32_t)settings->dc_shift_us) == ECAN_OK;
}

static bool configure_master(ecan_igh_config_t *config, const bus_settings_t *settings)
{
    uint32_t pdo_n = settings->pdo_n != 0        ? (uint32_t)settings->pdo_n
                     : settings->fd_bitrate != 0 ? ECAN_DEFAULT_FD_PDO_MULTIPLIER
                                                 : ECAN_DEFAULT_PDO_MULTIPLIER;
    if (ecan_igh_config_set_master_index(config, (uint32_t)settings->master) != ECAN_OK ||
        ecan_igh_config_set_slave_count(config, (size_t)settings->slaves) != ECAN_OK ||
        ecan_igh_config_allow_large_pdos(config, settings->large_pdos) != ECAN_OK ||
        ecan_igh_config_set_pdo_multiplier(config, pdo_n) != ECAN_OK ||
        ecan_igh_config_set_cycle_us(config, (uint32_t)settings->cycle_us) != ECAN_OK) {
        return false;
    }
    if (settings->dc_sync0 && !configure_sync0(config, settings)) {
        return false;
    }
    for (size_t slave = 0; slave < settings->slaves; slave++) {
        uint16_t position = (uint16_t)(settings->first_position + slave);
        if (ecan_igh_config_set_slave_position(config, slave, 0, position) != ECAN_OK) {
            return false;
        }
    }
    return true;
}

static bool configure_channel(igh_mcan_port_config_t *config, size_t slave, uint8_t channel,
                              const bus_settings_t *settings)
{
    uint32_t bitrate = (uint32_t)settings->bitrate;
    if (settings->fd_bitrate == 0) {
        return igh_mcan_port_set_classic_channel(config, slave, channel, bitrate) == ECAN_OK;
    }
    return igh_mcan_port_set_canfd_channel(config, slave, channel, bitrate,
                                           (uint32_t)settings->fd_bitrate) == ECAN_OK;
}

static bool configure_gateways(igh_mcan_port_config_t *config, const bus_settings_t *settings)
{
    int profile = (int)settings->profile;
    uint8_t options = settings->align4 ? IGH_MCAN_OPTION_ALIGN4 : 0;
    if (igh_mcan_port_default_config(config) != ECAN_OK) {
        return false;
    }
    for (size_t slave = 0; slave < settings->slaves; slave++) {
        if (igh_mcan_port_set_encapsulation(config, slave, profile, profile) != ECAN_OK ||
            igh_mcan_port_set_options(config, slave, options, options) != ECAN_OK) {
            return false;
        }
        for (uint8_t channel = 0; channel < ECAN_MCAN_CHANNELS; channel++) {
            bool is_used = (settings->channel_masks[slave] >> channel & 1) != 0;
            if (is_used && !configure_channel(config, slave, channel, settings)) {
                return false;
            }
        }
    }
    return true;
}

bool bus_settings_configure(const bus_settings_t *settings, ecan_igh_config_t *igh_config,
                            igh_mcan_port_config_t *mcan_config)
{
    bool is_good = configure_library(igh_config, settings);
    if (is_good && settings->config != NULL) {
        is_good = igh_mcan_port_load_config(igh_config, mcan_config, settings->config, NULL, 0,
                                            NULL) == ECAN_OK;
        if (!is_good) {
            report_is_of_file();
        }
    } else if (is_good) {
        is_good = configure_master(igh_config, settings) &&
                  configure_gateways(mcan_config, settings);
    }
    if (!is_good) {
        report_sdk_error();
    }
    return is_good;
}

bool bus_settings_read_config(bus_settings_t *settings)
{
    ecan_igh_config_t igh_config;
    igh_mcan_port_config_t mcan_config;
    size_t slaves = 0;
    uint32_t cycle_ns = 0;
    if (!bus_settings_configure(settings, &igh_config, &mcan_config)) {
        return false;
    }
    bool is_good = ecan_igh_config_get_slave_count(&igh_config, &slaves) == ECAN_OK &&
                   ecan_igh_config_get_cycle_ns(&igh_config, &cycle_ns) == ECAN_OK;
    for (size_t slave = 0; is_good && slave < slaves; slave++) {
        is_good = igh_mcan_port_get_channel_mask(&mcan_config, slave,
                                                 &settings->channel_masks[slave],
                                                 &settings->fd_masks[slave]) == ECAN_OK;
    }
    if (!is_good) {
        report_sdk_error();
    }
    settings->slaves = slaves;
    settings->cycle_us = cycle_ns / 1000;
    return is_good;
}

static int is_stopped_by_user(void *user)
{
    (void)user;
    return interrupt_is_set();
}

static bool wait_until_ready(bus_t *bus)
{
    int code = ecan_igh_wait_op_timeout(&bus->igh, ecan_igh_startup_timeout_ms(&bus->igh));
    if (code == ECAN_ERR_STOPPED) {
        puts("stopped by the user");
    } else if (code != ECAN_OK) {
        report_sdk_error();
    }
    return code == ECAN_OK;
}

/* Prints the Sync0 shift and judges its margin. */
static bool check_sync0(const ecan_igh_config_t *config, const bus_settings_t *settings)
{
    uint32_t shift_ns;
    int64_t margin_ns;
    if (ecan_igh_config_get_dc_margin(config, &shift_ns, &margin_ns) != ECAN_OK) {
        return true; /* without distributed clocks */
    }
    printf("Sync0 shift %.1f us, margin by the plan %.1f us\n", shift_ns / 1e3,
           (double)margin_ns / 1e3);
    if (margin_ns >= 0) {
        return true;
    }
    bool is_rejected = settings->rejects_dc_shift && !settings->is_dc_shift_measured;
    static const char text[] = "Sync0 falls into the arrival of the outputs: outputs that arrive "
                               "around or after it are missed (manual 16.1); use another shift";
    if (is_rejected) {
        report("%s; --dc-shift-measured accepts a measured one", text);
    } else {
        fprintf(stderr, "warning: %s\n", text);
    }
    return !is_rejected;
}

bool bring_up(bus_t *bus, const bus_settings_t *settings)
{
    ecan_igh_config_t igh_config;
    igh_mcan_port_config_t mcan_config;
    if (!bus_settings_configure(settings, &igh_config, &mcan_config)) {
        return false;
    }
    /* Without startup SDOs the gateways keep their configuration. */
    if (!settings->skip_sdo_config &&
        igh_mcan_port_apply_config(&igh_config, &mcan_config) != ECAN_OK) {
        report_sdk_error();
        return false;
    }
    if (!check_sync0(&igh_config, settings) || !interrupt_install()) {
        return false;
    }
    if (ecan_igh_init(&bus->igh, &igh_config) != ECAN_OK) {
        report_sdk_error();
        return false;
    }
    if (igh_mcan_port_init(&bus->mcan, &bus->igh, &mcan_config) != ECAN_OK ||
        ecan_igh_stop_waiting_when(&bus->igh, is_stopped_by_user, NULL) != ECAN_OK) {
        report_sdk_error();
        shut_down(bus);
        return false;
    }
    if (!wait_until_ready(bus)) {
        shut_down(bus);
        return false;
    }
    printf("%zu gateway(s) ready\n", ecan_igh_slave_count(&bus->igh));
    return true;
}

bool shut_down(bus_t *bus)
{
    /* The Port ends with its master. */
    if (ecan_igh_deinit(&bus->igh) != ECAN_OK) {
        report_sdk_error();
        return false;
    }
    return true;
}
