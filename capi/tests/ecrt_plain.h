/*
 * Part of libethercat's interface (1.6) for a plain C master, for tests on
 * machines without IgH's header.
 */
#ifndef ECRT_PLAIN_H
#define ECRT_PLAIN_H

#include <stddef.h>
#include <stdint.h>

/* Ends a list of sync managers; as a number: all. */
#define EC_END (~0U)

typedef struct ec_master ec_master_t;
typedef struct ec_domain ec_domain_t;
typedef struct ec_slave_config ec_slave_config_t;

typedef enum { EC_DIR_INVALID, EC_DIR_OUTPUT, EC_DIR_INPUT } ec_direction_t;
typedef enum { EC_WD_DEFAULT, EC_WD_ENABLE, EC_WD_DISABLE } ec_watchdog_mode_t;
typedef enum { EC_WC_ZERO, EC_WC_INCOMPLETE, EC_WC_COMPLETE } ec_wc_state_t;

typedef struct {
    unsigned int slaves_responding;
    unsigned int al_states : 4;
    unsigned int link_up : 1;
} ec_master_state_t;

typedef struct {
    unsigned int online : 1;
    unsigned int operational : 1;
    unsigned int al_state : 4;
} ec_slave_config_state_t;

typedef struct {
    unsigned int working_counter;
    ec_wc_state_t wc_state;
    unsigned int redundancy_active;
} ec_domain_state_t;

typedef struct {
    uint16_t position;
    uint32_t vendor_id;
    uint32_t product_code;
    uint32_t revision_number;
    uint32_t serial_number;
    uint16_t alias;
    int16_t current_on_ebus;
    struct {
        int desc;
        struct {
            uint8_t link_up;
            uint8_t loop_closed;
            uint8_t signal_detected;
        } link;
        uint32_t receive_time;
        uint16_t next_slave;
        uint32_t delay_to_next_dc;
    } ports[4];
    uint8_t al_state;
    uint8_t error_flag;
    uint8_t sync_count;
    uint16_t sdo_count;
    char name[64];
} ec_slave_info_t;

typedef struct {
    uint16_t index;
    uint8_t subindex;
    uint8_t bit_length;
} ec_pdo_entry_info_t;

typedef struct {
    uint16_t index;
    unsigned int n_entries;
    ec_pdo_entry_info_t *entries;
} ec_pdo_info_t;

typedef struct {
    uint8_t index;
    ec_direction_t dir;
    unsigned int n_pdos;
    ec_pdo_info_t *pdos;
    ec_watchdog_mode_t watchdog_mode;
} ec_sync_info_t;

typedef struct {
    uint16_t alias;
    uint16_t position;
    uint32_t vendor_id;
    uint32_t product_code;
    uint16_t index;
    uint8_t subindex;
    unsigned int *offset;
    unsigned int *bit_position;
} ec_pdo_entry_reg_t;

unsigned int ecrt_version_magic(void);
ec_master_t *ecrt_request_master(unsigned int master_index);
void ecrt_release_master(ec_master_t *master);

int ecrt_master_get_slave(ec_master_t *master, uint16_t position, ec_slave_info_t *info);
int ecrt_master_sdo_upload(ec_master_t *master, uint16_t position, uint16_t index,
                           uint8_t subindex, uint8_t *target, size_t target_size,
                           size_t *result_size, uint32_t *abort_code);
ec_domain_t *ecrt_master_create_domain(ec_master_t *master);
ec_slave_config_t *ecrt_master_slave_config(ec_master_t *master, uint16_t alias,
                                            uint16_t position, uint32_t vendor_id,
                                            uint32_t product_code);
int ecrt_master_set_send_interval(ec_master_t *master, size_t interval_us);
int ecrt_master_activate(ec_master_t *master);
int ecrt_master_send(ec_master_t *master);
int ecrt_master_receive(ec_master_t *master);
int ecrt_master_state(const ec_master_t *master, ec_master_state_t *state);
int ecrt_master_application_time(ec_master_t *master, uint64_t time_ns);
int ecrt_master_sync_reference_clock(ec_master_t *master);
int ecrt_master_sync_slave_clocks(ec_master_t *master);

int ecrt_slave_config_pdos(ec_slave_config_t *config, unsigned int n_syncs,
                           const ec_sync_info_t syncs[]);
int ecrt_slave_config_dc(ec_slave_config_t *config, uint16_t assign_activate,
                         uint32_t sync0_cycle, int32_t sync0_shift, uint32_t sync1_cycle,
                         int32_t sync1_shift);
int ecrt_slave_config_sdo8(ec_slave_config_t *config, uint16_t index, uint8_t subindex,
                           uint8_t value);
int ecrt_slave_config_sdo16(ec_slave_config_t *config, uint16_t index, uint8_t subindex,
                            uint16_t value);
int ecrt_slave_config_sdo32(ec_slave_config_t *config, uint16_t index, uint8_t subindex,
                            uint32_t value);
int ecrt_slave_config_state(const ec_slave_config_t *config, ec_slave_config_state_t *state);

int ecrt_domain_reg_pdo_entry_list(ec_domain_t *domain, const ec_pdo_entry_reg_t *entries);
size_t ecrt_domain_size(const ec_domain_t *domain);
uint8_t *ecrt_domain_data(ec_domain_t *domain);
int ecrt_domain_process(ec_domain_t *domain);
int ecrt_domain_queue(ec_domain_t *domain);
int ecrt_domain_state(const ec_domain_t *domain, ec_domain_state_t *state);

#endif
