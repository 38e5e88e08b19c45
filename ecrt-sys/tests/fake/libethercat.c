/*
 * A libethercat that works on nothing, for the tests of loading and of the
 * safe handles. Macros choose what it plays:
 *   MAGIC   what ecrt_version_magic returns
 *   SILENT  functions that had no return value in 1.5 have none
 *   LACKING some functions are left out
 *   OLD     functions that came after 1.5.2 are left out
 * Master 0 works, from 101 on requests fail, each in its own way; master 7
 * works but everything that can report reports EINTR.
 */
#include <errno.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "ecrt-abi.h"

#ifndef MAGIC
#define MAGIC 0x106
#endif

struct ec_master { unsigned int index, active; };
struct ec_slave_config { struct ec_master *master; };
struct ec_domain { struct ec_master *master; uint8_t *image; };
struct ec_sdo_request { uint8_t *data; size_t size; int polls; ec_request_state_t state; };
struct ec_reg_request { uint8_t *data; uint16_t address; int polls; };

/* What happened, to be read by SDO upload of 0x2000. */
enum { RELEASED, SENT, RECEIVED, QUEUED, DEACTIVATED, WRITTEN, TIMES };
static uint8_t counts[TIMES];
static uint8_t images[4][16];
static unsigned int domains;

#ifdef SILENT
#define STATUS void
/* Leaves a negative number where a return value would be found. */
static int __attribute__((noinline)) garbage(void) { return -EIO; }
#define DONE(master) do { (void) (master); garbage(); return; } while (0)
#else
#define STATUS int
#define DONE(master) return (master) && (master)->index == 7 ? -EINTR : 0
#endif
#define NO_MASTER ((struct ec_master *) NULL)

unsigned int ecrt_version_magic(void) { return MAGIC; }

ec_master_t *ecrt_open_master(unsigned int index)
{
    switch (index) {
        case 101: errno = ENOENT; return NULL;
        case 102: errno = EACCES; return NULL;
        case 103: errno = EBUSY; return NULL;
        case 104: return NULL;
        case 105: errno = EMFILE; return NULL;
    }
    ec_master_t *master = calloc(1, sizeof(*master));
    master->index = index;
    return master;
}

ec_master_t *ecrt_request_master(unsigned int index) { return ecrt_open_master(index); }
void ecrt_release_master(ec_master_t *master) { counts[RELEASED]++; free(master); }

int ecrt_master(ec_master_t *master, ec_master_info_t *info)
{
    (void) master;
    info->slave_count = 2;
    info->link_up = 1;
    info->scan_busy = 0;
    info->app_time = 0x1122334455667788;
    return 0;
}

int ecrt_master_get_slave(ec_master_t *master, uint16_t position, ec_slave_info_t *info)
{
    (void) master;
    if (position > 1) return -EINVAL;
    memset(info, 0, sizeof(*info));
    info->position = position;
    info->vendor_id = 0x00000ec0;
    info->product_code = 0x12345678;
    info->alias = 5;
    info->al_state = 2;
    info->error_flag = 1;
    info->sdo_count = 300;
    info->ports[0].desc = EC_PORT_MII;
    info->ports[0].link.link_up = 1;
    info->ports[0].next_slave = 0xffff;
    info->ports[1].desc = EC_PORT_EBUS;
    info->ports[1].next_slave = 1;
    strcpy(info->name, "ECAN-Lite");
    return 0;
}

int ecrt_master_get_sync_manager(ec_master_t *master, uint16_t position, uint8_t sync,
        ec_sync_info_t *info)
{
    (void) master; (void) position;
    if (sync > 3) return -ENOENT;
    info->index = sync;
    info->dir = sync == 2 ? EC_DIR_OUTPUT : EC_DIR_INPUT;
    info->n_pdos = 8;
    info->pdos = NULL;
    info->watchdog_mode = sync == 2 ? EC_WD_ENABLE : EC_WD_DISABLE;
    return 0;
}

int ecrt_master_get_pdo(ec_master_t *master, uint16_t position, uint8_t sync, uint16_t at,
        ec_pdo_info_t *info)
{
    (void) master; (void) position; (void) sync;
    info->index = 0x1a00 + at;
    info->n_entries = 8;
    info->entries = NULL;
    return 0;
}

int ecrt_master_get_pdo_entry(ec_master_t *master, uint16_t position, uint8_t sync, uint16_t at,
        uint16_t entry, ec_pdo_entry_info_t *info)
{
    (void) master; (void) position; (void) sync; (void) at;
    info->index = 0x6000;
    info->subindex = entry + 1;
    info->bit_length = 128;
    return 0;
}

int ecrt_master_sdo_download(ec_master_t *master, uint16_t position, uint16_t index,
        uint8_t subindex, const uint8_t *data, size_t size, uint32_t *abort_code)
{
    (void) master; (void) position; (void) subindex;
    if (index == 0x8010 && size == 1 && data[0] == 1) return 0;
    *abort_code = 0x06090030;
    return -EIO;
}

int ecrt_master_sdo_upload(ec_master_t *master, uint16_t position, uint16_t index,
        uint8_t subindex, uint8_t *target, size_t size, size_t *result, uint32_t *abort_code)
{
    (void) master; (void) position;
    switch (index) {
        case 0x2000: target[0] = counts[subindex]; *result = 1; return 0;
        case 0x1018: memcpy(target, "\x44\x33\x22\x11", 4); *result = 4; return 0;
        case 0x3000: memset(target, 1, size); *result = size + 1; return 0;
        /* as 1.6.2 reports a mailbox error: success, without data, with an undefined size */
        case 0x3004: *result = subindex; return 0;
        case 0x3001: *abort_code = 0x06020000; return -EIO;
        case 0x3002: *abort_code = 0x06020000; return -EINVAL;
    }
    return -EIO;
}

STATUS ecrt_master_state(const ec_master_t *master, ec_master_state_t *state)
{
    state->slaves_responding = 2;
    state->al_states = 8;
    state->link_up = 1;
    DONE(master);
}

int ecrt_master_link_state(const ec_master_t *master, unsigned int device,
        ec_master_link_state_t *state)
{
    (void) master;
    if (device) return -EINVAL;
    state->slaves_responding = 2;
    state->al_states = 3;
    state->link_up = 1;
    return 0;
}

ec_domain_t *ecrt_master_create_domain(ec_master_t *master)
{
    if (domains == 4) { errno = EPERM; return NULL; }
    ec_domain_t *domain = calloc(1, sizeof(*domain));
    domain->master = master;
    domain->image = images[domains++];
    return domain;
}

ec_slave_config_t *ecrt_master_slave_config(ec_master_t *master, uint16_t alias,
        uint16_t position, uint32_t vendor_id, uint32_t product_code)
{
    (void) alias; (void) vendor_id; (void) product_code;
    if (position == 9) return NULL;
    ec_slave_config_t *config = calloc(1, sizeof(*config));
    config->master = master;
    return config;
}

int ecrt_master_select_reference_clock(ec_master_t *master, ec_slave_config_t *config)
{
    (void) master;
    return config ? 0 : -ENOENT;
}

int ecrt_master_set_send_interval(ec_master_t *master, size_t interval)
{
    (void) master;
    return interval == 1000 ? 0 : -EINVAL;
}

int ecrt_master_activate(ec_master_t *master) { master->active = 1; return 0; }

STATUS ecrt_master_reset(ec_master_t *master)
{
    DONE(master);
}

STATUS ecrt_master_deactivate(ec_master_t *master)
{
    master->active = 0;
    domains = 0;
    counts[DEACTIVATED]++;
    DONE(master);
}

STATUS ecrt_master_send(ec_master_t *master) { counts[SENT]++; DONE(master); }

STATUS ecrt_master_receive(ec_master_t *master)
{
    counts[RECEIVED]++;
    for (int i = 0; i < 4; i++) images[i][8] = counts[RECEIVED] + i;
    DONE(master);
}

STATUS ecrt_master_application_time(ec_master_t *master, uint64_t time)
{
    (void) time;
    DONE(master);
}

STATUS ecrt_master_sync_reference_clock(ec_master_t *master) { DONE(master); }
STATUS ecrt_master_sync_slave_clocks(ec_master_t *master) { DONE(master); }
STATUS ecrt_master_sync_monitor_queue(ec_master_t *master) { DONE(master); }

int ecrt_master_reference_clock_time(ec_master_t *master, uint32_t *time)
{
    (void) master;
    *time = 0xfedcba98;
    return 0;
}

uint32_t ecrt_master_sync_monitor_process(ec_master_t *master)
{
    return master->index == 7 ? 0xffffffff : 42;
}

int ecrt_slave_config_sync_manager(ec_slave_config_t *config, uint8_t sync,
        ec_direction_t direction, ec_watchdog_mode_t watchdog)
{
    (void) config;
    return sync == 2 && direction == EC_DIR_OUTPUT && watchdog == EC_WD_ENABLE ? 0 : -ENOENT;
}

STATUS ecrt_slave_config_watchdog(ec_slave_config_t *config, uint16_t divider, uint16_t intervals)
{
    (void) divider; (void) intervals;
    DONE(config->master);
}

STATUS ecrt_slave_config_pdo_assign_clear(ec_slave_config_t *config, uint8_t sync)
{
    (void) sync;
    DONE(config->master);
}

int ecrt_slave_config_pdo_assign_add(ec_slave_config_t *config, uint8_t sync, uint16_t index)
{
    (void) config; (void) sync;
    return index == 0x1600 ? 0 : -EEXIST;
}

STATUS ecrt_slave_config_pdo_mapping_clear(ec_slave_config_t *config, uint16_t index)
{
    (void) index;
    DONE(config->master);
}

int ecrt_slave_config_pdo_mapping_add(ec_slave_config_t *config, uint16_t pdo, uint16_t index,
        uint8_t subindex, uint8_t bits)
{
    (void) config; (void) pdo; (void) index; (void) subindex;
    return bits == 128 ? 0 : -ENOENT;
}

int ecrt_slave_config_reg_pdo_entry(ec_slave_config_t *config, uint16_t index, uint8_t subindex,
        ec_domain_t *domain, unsigned int *bit_position)
{
    (void) config; (void) domain;
    return index == 0x7000 && !bit_position ? 16 * (subindex - 1) : -ENOENT;
}

STATUS ecrt_slave_config_dc(ec_slave_config_t *config, uint16_t assign_activate, uint32_t cycle0,
        int32_t shift0, uint32_t cycle1, int32_t shift1)
{
    (void) assign_activate; (void) cycle0; (void) shift0; (void) cycle1; (void) shift1;
    DONE(config->master);
}

int ecrt_slave_config_sdo(ec_slave_config_t *config, uint16_t index, uint8_t subindex,
        const uint8_t *data, size_t size)
{
    (void) config; (void) index; (void) subindex; (void) data;
    return size ? 0 : -EINVAL;
}

STATUS ecrt_slave_config_state(const ec_slave_config_t *config, ec_slave_config_state_t *state)
{
    state->online = 1;
    state->operational = 0;
    state->al_state = 4;
    DONE(config->master);
}

ec_sdo_request_t *ecrt_slave_config_create_sdo_request(ec_slave_config_t *config, uint16_t index,
        uint8_t subindex, size_t size)
{
    (void) config; (void) index; (void) subindex;
    ec_sdo_request_t *request = calloc(1, sizeof(*request));
    request->data = malloc(size);
    memset(request->data, 0xee, size);
    request->size = size;
    return request;
}

size_t ecrt_domain_size(const ec_domain_t *domain) { (void) domain; return 16; }

uint8_t *ecrt_domain_data(ec_domain_t *domain)
{
    /* Before activation an old library gives an offset for an address. */
    return domain->master->active ? domain->image : (uint8_t *) 16;
}

STATUS ecrt_domain_process(ec_domain_t *domain) { DONE(domain->master); }

#ifndef LACKING
STATUS ecrt_domain_queue(ec_domain_t *domain) { counts[QUEUED]++; DONE(domain->master); }
#endif

STATUS ecrt_domain_state(const ec_domain_t *domain, ec_domain_state_t *state)
{
    state->working_counter = 3;
    state->wc_state = EC_WC_COMPLETE;
    state->redundancy_active = 0;
    DONE(domain->master);
}

STATUS ecrt_sdo_request_index(ec_sdo_request_t *request, uint16_t index, uint8_t subindex)
{
    (void) request; (void) index; (void) subindex;
    DONE(NO_MASTER);
}

STATUS ecrt_sdo_request_timeout(ec_sdo_request_t *request, uint32_t timeout)
{
    (void) request; (void) timeout;
    DONE(NO_MASTER);
}

uint8_t *ecrt_sdo_request_data(ec_sdo_request_t *request) { return request->data; }
size_t ecrt_sdo_request_data_size(const ec_sdo_request_t *request) { return request->size; }

/* Busy when polled first; a read returns two bytes for any requested size. */
ec_request_state_t ecrt_sdo_request_state(ec_sdo_request_t *request)
{
    if (request->state == EC_REQUEST_BUSY && request->polls++) {
        request->state = EC_REQUEST_SUCCESS;
        if (request->size > 2 && request->data[0] != 0x77) {
            request->data[0] = 0xcd;
            request->data[1] = 0xab;
            request->size = 2;
        }
    }
    return request->state;
}

STATUS ecrt_sdo_request_write(ec_sdo_request_t *request)
{
    counts[WRITTEN] = request->data[0];
    request->state = EC_REQUEST_BUSY;
    request->polls = 0;
    DONE(NO_MASTER);
}

#ifndef LACKING
STATUS ecrt_sdo_request_read(ec_sdo_request_t *request)
{
    request->state = EC_REQUEST_BUSY;
    request->polls = 0;
    request->data[0] = 0;
    DONE(NO_MASTER);
}
#endif

ec_reg_request_t *ecrt_slave_config_create_reg_request(ec_slave_config_t *config, size_t size)
{
    (void) config;
    ec_reg_request_t *request = calloc(1, sizeof(*request));
    request->data = malloc(size);
    memset(request->data, 0xee, size);
    return request;
}

uint8_t *ecrt_reg_request_data(ec_reg_request_t *request) { return request->data; }

ec_request_state_t ecrt_reg_request_state(ec_reg_request_t *request)
{
    if (!request->address) return EC_REQUEST_UNUSED;
    if (!request->polls++) return EC_REQUEST_BUSY;
    request->data[0] = request->address & 0xff;
    request->data[1] = request->address >> 8;
    return EC_REQUEST_SUCCESS;
}

STATUS ecrt_reg_request_read(ec_reg_request_t *request, uint16_t address, size_t size)
{
    (void) size;
    request->address = address;
    request->polls = 0;
    DONE(NO_MASTER);
}

STATUS ecrt_reg_request_write(ec_reg_request_t *request, uint16_t address, size_t size)
{
    (void) size;
    request->address = address;
    request->polls = 0;
    DONE(NO_MASTER);
}

#ifndef OLD
int ecrt_master_scan_progress(ec_master_t *master, ec_master_scan_progress_t *progress)
{
    (void) master;
    progress->slave_count = 2;
    progress->scan_index = 1;
    return 0;
}

int ecrt_slave_config_flag(ec_slave_config_t *config, const char *key, int32_t value)
{
    (void) config;
    return strcmp(key, "AssignToPdi") == 0 && value == 1 ? 0 : -ENOENT;
}

int ecrt_slave_config_state_timeout(ec_slave_config_t *config, ec_al_state_t from,
        ec_al_state_t to, unsigned int timeout)
{
    (void) config;
    return from == EC_AL_STATE_SAFEOP && to == EC_AL_STATE_OP && timeout == 500 ? 0 : -EINVAL;
}

STATUS ecrt_master_sync_reference_clock_to(ec_master_t *master, uint64_t time)
{
    (void) time;
    DONE(master);
}
#endif
