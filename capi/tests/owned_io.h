/*
 * The owner's own slave in the tests of attached masters: the digital I/O at position 0 of
 * attached_cell.toml, configured and exchanged by plain ecrt_* calls in a domain of its own.
 */
#ifndef OWNED_IO_H
#define OWNED_IO_H

#include "ecrt_plain.h"

#include <stddef.h>

#define IO_VENDOR 2u
#define IO_PRODUCT 0x07433052u

typedef struct {
    ec_slave_config_t *config;
    ec_domain_t *domain;
    uint8_t *data;
    unsigned int output;
    unsigned int input;
} owned_io_t;

/* Configures the I/O, before the master is activated; returns 0 if the library accepts it. */
static int owned_io_configure(owned_io_t *io, ec_master_t *master)
{
    static ec_pdo_entry_info_t outputs[] = {{0x7000, 1, 8}};
    static ec_pdo_entry_info_t inputs[] = {{0x6000, 1, 8}, {0x6000, 2, 8}};
    static ec_pdo_info_t rx = {0x1600, 1, outputs};
    static ec_pdo_info_t tx = {0x1A00, 2, inputs};
    static const ec_sync_info_t syncs[] = {
        {0, EC_DIR_OUTPUT, 1, &rx, EC_WD_ENABLE},
        {1, EC_DIR_INPUT, 1, &tx, EC_WD_DISABLE},
        {0xFF, EC_DIR_INVALID, 0, NULL, EC_WD_DEFAULT},
    };
    const ec_pdo_entry_reg_t entries[] = {
        {0, 0, IO_VENDOR, IO_PRODUCT, 0x7000, 1, &io->output, NULL},
        {0, 0, IO_VENDOR, IO_PRODUCT, 0x6000, 1, &io->input, NULL},
        {0, 0, 0, 0, 0, 0, NULL, NULL},
    };
    io->config = ecrt_master_slave_config(master, 0, 0, IO_VENDOR, IO_PRODUCT);
    io->domain = ecrt_master_create_domain(master);
    if (io->config == NULL || io->domain == NULL) {
        return -1;
    }
    if (ecrt_slave_config_pdos(io->config, EC_END, syncs) != 0) {
        return -1;
    }
    return ecrt_domain_reg_pdo_entry_list(io->domain, entries);
}

/* After the activation of the master. */
static int owned_io_begin(owned_io_t *io)
{
    io->data = ecrt_domain_data(io->domain);
    return io->data == NULL ? -1 : 0;
}

/* After ecrt_master_receive(); returns 1 if both directions were exchanged. */
static int owned_io_receive(owned_io_t *io)
{
    ec_domain_state_t state;
    ecrt_domain_process(io->domain);
    ecrt_domain_state(io->domain, &state);
    return state.wc_state == EC_WC_COMPLETE;
}

/* Before ecrt_master_send(). */
static void owned_io_send(owned_io_t *io, uint8_t output)
{
    io->data[io->output] = output;
    ecrt_domain_queue(io->domain);
}

#endif
