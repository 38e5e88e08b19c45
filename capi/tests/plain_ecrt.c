/*
 * A master without the SDK: plain ecrt_* calls bring an ECAN-Lite to OP, send
 * one CAN frame and wait for another node to send it back.
 *
 *   plain_ecrt [--dc]      --dc: with distributed clocks and Sync0
 *
 * Exit code 0: the frame received back. 1: the message says what did not happen.
 * Chapters are those of the ECAN-Lite Technical Manual V2.2.
 */
#define _POSIX_C_SOURCE 200809L

#include "ecrt_plain.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

#define CYCLE_NS 1000000LL
#define OP_SECONDS 20
#define ECHO_SECONDS 5
#define RETRY_CYCLES 100

/* N = 8 chunks of 128 bytes in each direction, four channels (5.4.3). */
#define CHUNKS 8
#define UNITS 8
#define IMAGE_BYTES (CHUNKS * 128)
#define HEADER_BYTES 24
#define CHANNEL_MASK 0x0F
#define LAYOUT_ID 0x01E7

/* The frame of 5.4.4.1: channel 0, identifier 0x123, eight bytes. */
static const uint8_t frame[12] = {
    0x40, 0x00, 0x23, 0x01, 0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88,
};

/* The header of its first image, without the four bytes of channel status. */
static const uint8_t first_header[16] = {
    0x16, 0x00, 0x01, 0x00, 0x01, 0x00, 0x0C, 0x00,
    0xD3, 0x56, 0xE7, 0x01, 0x0F, 0x01, 0x00, 0x01,
};

struct program {
    ec_master_t *master;
    ec_domain_t *domain;
    ec_slave_config_t *config;
    uint8_t *outputs;
    uint8_t *inputs;
    unsigned int output_offset;
    unsigned int input_offset;
    uint16_t sequence;
    int with_clocks;
    struct timespec next;
};

static int failed(const char *what)
{
    fprintf(stderr, "plain_ecrt: %s\n", what);
    return -1;
}

/* ---- images (6) ---- */

static void put16(uint8_t *to, unsigned int value)
{
    to[0] = (uint8_t)(value & 0xFF);
    to[1] = (uint8_t)(value >> 8);
}

static unsigned int get16(const uint8_t *from)
{
    return from[0] | (unsigned int)from[1] << 8;
}

/* CRC-16/CCITT-FALSE. */
static unsigned int crc16(const uint8_t *data, size_t size)
{
    unsigned int crc = 0xFFFF;
    for (size_t i = 0; i < size; i++) {
        crc ^= (unsigned int)data[i] << 8;
        for (int bit = 0; bit < 8; bit++) {
            crc = (crc & 0x8000) ? (crc << 1 ^ 0x1021) & 0xFFFF : crc << 1;
        }
    }
    return crc;
}

/* Writes an image with one frame or none. seq_end comes last: it commits. */
static void put_image(uint8_t *image, uint16_t sequence, const uint8_t *packet, size_t size)
{
    memset(image + HEADER_BYTES, 0, IMAGE_BYTES - HEADER_BYTES);
    if (size > 0) {
        memcpy(image + HEADER_BYTES, packet, size);
    }
    image[0] = 0x16;
    image[1] = 0;
    put16(image + 2, sequence);
    put16(image + 6, (unsigned int)size);
    put16(image + 8, crc16(image + HEADER_BYTES, size));
    put16(image + 10, LAYOUT_ID);
    image[12] = CHANNEL_MASK;
    image[13] = size > 0 ? 1 : 0;
    image[14] = 0;
    image[15] = 1;
    memset(image + 16, 0, 8);
    put16(image + 4, sequence);
}

/* Returns true if an image is complete and its first packet is the frame. */
static int holds_frame(const uint8_t *image)
{
    const size_t size = get16(image + 6);
    return image[0] == 0x16 && get16(image + 2) == get16(image + 4)
        && get16(image + 10) == LAYOUT_ID && size >= sizeof frame
        && size <= IMAGE_BYTES - HEADER_BYTES
        && get16(image + 8) == crc16(image + HEADER_BYTES, size)
        && memcmp(image + HEADER_BYTES, frame, sizeof frame) == 0;
}

/* ---- configuration ---- */

static int upload(ec_master_t *master, uint16_t index, uint8_t subindex, uint32_t *value)
{
    uint8_t data[4] = {0};
    size_t size = 0;
    uint32_t abort_code = 0;
    if (ecrt_master_sdo_upload(master, 0, index, subindex, data, sizeof data, &size, &abort_code)) {
        fprintf(stderr, "plain_ecrt: 0x%04X:%02X cannot be read, abort code 0x%08X\n", index,
                subindex, (unsigned int)abort_code);
        return -1;
    }
    *value = (uint32_t)get16(data) | (uint32_t)get16(data + 2) << 16;
    return 0;
}

/* The assignment of one direction, before the settings that depend on it. */
static int assign(ec_slave_config_t *config, uint16_t assignment, uint16_t first_pdo)
{
    int result = ecrt_slave_config_sdo8(config, assignment, 0, 0);
    for (unsigned int chunk = 0; chunk < CHUNKS; chunk++) {
        result |= ecrt_slave_config_sdo16(config, assignment, (uint8_t)(chunk + 1),
                                          (uint16_t)(first_pdo + chunk));
    }
    return result | ecrt_slave_config_sdo8(config, assignment, 0, CHUNKS);
}

/* The profile of one direction (5.4.3, phase C). */
static int set_profile(ec_slave_config_t *config, uint16_t profile)
{
    int result = ecrt_slave_config_sdo8(config, profile, 3, CHUNKS);
    result |= ecrt_slave_config_sdo8(config, profile, 4, CHANNEL_MASK);
    result |= ecrt_slave_config_sdo8(config, profile, 5, 0);
    result |= ecrt_slave_config_sdo8(config, profile, 6, 0);
    result |= ecrt_slave_config_sdo8(config, profile, 7, 0);
    return result | ecrt_slave_config_sdo8(config, profile, 1, 1);
}

static int add_startup_sdos(ec_slave_config_t *config)
{
    int result = assign(config, 0x1C12, 0x1600);
    result |= assign(config, 0x1C13, 0x1A00);
    result |= set_profile(config, 0x8010);
    result |= set_profile(config, 0x8011);
    /* Channel 0: classic CAN at 500 kbit/s (phase E). */
    result |= ecrt_slave_config_sdo8(config, 0x8001, 15, 0);
    result |= ecrt_slave_config_sdo32(config, 0x8001, 19, 500000);
    result |= ecrt_slave_config_sdo8(config, 0x8001, 1, 1);
    return result ? failed("the startup SDOs are rejected") : 0;
}

/* Sync managers, PDOs and entries of both directions (5.1.1). */
static int set_pdos(ec_slave_config_t *config, uint8_t subindex)
{
    static ec_pdo_entry_info_t entries[2][CHUNKS][UNITS];
    static ec_pdo_info_t pdos[2][CHUNKS];
    static const uint16_t first_pdo[2] = {0x1600, 0x1A00};
    static const uint16_t first_object[2] = {0x7000, 0x6000};
    const ec_sync_info_t syncs[] = {
        {2, EC_DIR_OUTPUT, CHUNKS, pdos[0], EC_WD_ENABLE},
        {3, EC_DIR_INPUT, CHUNKS, pdos[1], EC_WD_DISABLE},
        {0xFF, EC_DIR_INVALID, 0, NULL, EC_WD_DEFAULT},
    };
    for (int way = 0; way < 2; way++) {
        for (unsigned int chunk = 0; chunk < CHUNKS; chunk++) {
            for (unsigned int unit = 0; unit < UNITS; unit++) {
                ec_pdo_entry_info_t *entry = &entries[way][chunk][unit];
                entry->index = (uint16_t)(first_object[way] + chunk * 0x80 + unit * 0x10);
                entry->subindex = subindex;
                entry->bit_length = 128;
            }
            pdos[way][chunk].index = (uint16_t)(first_pdo[way] + chunk);
            pdos[way][chunk].n_entries = UNITS;
            pdos[way][chunk].entries = entries[way][chunk];
        }
    }
    return ecrt_slave_config_pdos(config, EC_END, syncs) ? failed("the PDOs are rejected") : 0;
}

static int configure(struct program *program)
{
    ec_slave_info_t info;
    uint32_t chunk_bytes = 0;
    uint32_t header_bytes = 0;
    uint32_t mapping = 0;
    uint8_t subindex;
    if (ecrt_master_get_slave(program->master, 0, &info)) {
        return failed("there is no slave at position 0");
    }
    if (upload(program->master, 0xF000, 17, &chunk_bytes)
        || upload(program->master, 0xF000, 18, &header_bytes)
        || upload(program->master, 0x1600, 1, &mapping)) {
        return -1;
    }
    if (chunk_bytes != 128 || header_bytes != HEADER_BYTES) {
        return failed("the slave at position 0 is no ECAN-Lite");
    }
    /* The manual does not give the subindex of the mapped objects; it is read from the slave. */
    subindex = (uint8_t)(mapping >> 8);
    printf("slave 0: %s, vendor 0x%08X, product 0x%08X\n", info.name,
           (unsigned int)info.vendor_id, (unsigned int)info.product_code);

    program->domain = ecrt_master_create_domain(program->master);
    program->config =
        ecrt_master_slave_config(program->master, 0, 0, info.vendor_id, info.product_code);
    if (program->domain == NULL || program->config == NULL) {
        return failed("domain or slave configuration cannot be made");
    }
    if (add_startup_sdos(program->config) || set_pdos(program->config, subindex)) {
        return -1;
    }
    if (program->with_clocks
        && ecrt_slave_config_dc(program->config, 0x0300, (uint32_t)CYCLE_NS, 0, 0, 0)) {
        return failed("the distributed clocks are rejected");
    }
    const ec_pdo_entry_reg_t registrations[] = {
        {0, 0, info.vendor_id, info.product_code, 0x7000, subindex,
         &program->output_offset, NULL},
        {0, 0, info.vendor_id, info.product_code, 0x6000, subindex,
         &program->input_offset, NULL},
        {0, 0, 0, 0, 0, 0, NULL, NULL},
    };
    if (ecrt_domain_reg_pdo_entry_list(program->domain, registrations)) {
        return failed("the PDO entries cannot be registered");
    }
    if (ecrt_domain_size(program->domain) != 2 * IMAGE_BYTES) {
        return failed("the domain has an unexpected size");
    }
    return 0;
}

/* ---- operation ---- */

static uint64_t to_ns(const struct timespec *time)
{
    return (uint64_t)time->tv_sec * 1000000000ULL + (uint64_t)time->tv_nsec;
}

/* Sleeps until the next cycle. Missed deadlines are skipped. */
static void wait_for_cycle(struct program *program)
{
    struct timespec now;
    do {
        program->next.tv_nsec += CYCLE_NS;
        if (program->next.tv_nsec >= 1000000000L) {
            program->next.tv_nsec -= 1000000000L;
            program->next.tv_sec++;
        }
        clock_gettime(CLOCK_MONOTONIC, &now);
    } while (to_ns(&program->next) <= to_ns(&now));
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &program->next, NULL) != 0) {
    }
}

static int activate(struct program *program)
{
    uint8_t *data;
    ecrt_master_set_send_interval(program->master, CYCLE_NS / 1000);
    clock_gettime(CLOCK_MONOTONIC, &program->next);
    ecrt_master_application_time(program->master, to_ns(&program->next));
    if (ecrt_master_activate(program->master)) {
        return failed("the master cannot be activated");
    }
    data = ecrt_domain_data(program->domain);
    if (data == NULL) {
        return failed("the domain has no memory");
    }
    program->outputs = data + program->output_offset;
    program->inputs = data + program->input_offset;
    program->sequence = 1;
    put_image(program->outputs, program->sequence, NULL, 0);
    clock_gettime(CLOCK_MONOTONIC, &program->next);
    return 0;
}

/* First half of a cycle. Returns true if the last image and a response were exchanged. */
static int begin_cycle(struct program *program)
{
    ec_domain_state_t state;
    ecrt_master_receive(program->master);
    ecrt_domain_process(program->domain);
    ecrt_domain_state(program->domain, &state);
    return state.wc_state == EC_WC_COMPLETE;
}

static void publish(struct program *program, const uint8_t *packet, size_t size)
{
    program->sequence++;
    put_image(program->outputs, program->sequence, packet, size);
}

/* Second half. */
static void end_cycle(struct program *program)
{
    ecrt_domain_queue(program->domain);
    ecrt_master_application_time(program->master, to_ns(&program->next));
    if (program->with_clocks) {
        ecrt_master_sync_reference_clock(program->master);
        ecrt_master_sync_slave_clocks(program->master);
    }
    ecrt_master_send(program->master);
    wait_for_cycle(program);
}

static int wait_for_op(struct program *program)
{
    ec_slave_config_state_t slave = {0, 0, 0};
    for (long cycle = 0; cycle < OP_SECONDS * 1000L; cycle++) {
        const int complete = begin_cycle(program);
        ecrt_slave_config_state(program->config, &slave);
        if (complete) {
            publish(program, NULL, 0);
        }
        end_cycle(program);
        if (complete && slave.operational) {
            printf("OP after %ld cycles\n", cycle);
            return 0;
        }
    }
    fprintf(stderr, "plain_ecrt: not in OP after %d s: online %u, AL state 0x%02X\n", OP_SECONDS,
            (unsigned int)slave.online, (unsigned int)slave.al_state);
    return -1;
}

/*
 * An image that did not arrive is repeated unchanged, which the gateway
 * ignores. A frame without a response is sent again.
 */
static int exchange_frame(struct program *program)
{
    for (long cycle = 0; cycle < ECHO_SECONDS * 1000L; cycle++) {
        if (begin_cycle(program)) {
            if (cycle > 0 && holds_frame(program->inputs)) {
                printf("the frame is back after %ld cycles\n", cycle);
                return 0;
            }
            publish(program, frame, cycle % RETRY_CYCLES == 0 ? sizeof frame : 0);
        }
        end_cycle(program);
    }
    return failed("the frame did not come back");
}

/* The manual's bytes, before anything is sent. */
static int check_first_image(void)
{
    static uint8_t image[IMAGE_BYTES];
    put_image(image, 1, frame, sizeof frame);
    if (memcmp(image, first_header, sizeof first_header) != 0
        || memcmp(image + HEADER_BYTES, frame, sizeof frame) != 0) {
        return failed("the image is not the manual's");
    }
    return 0;
}

int main(int argc, char **argv)
{
    struct program program;
    int result;
    memset(&program, 0, sizeof program);
    program.with_clocks = argc > 1 && strcmp(argv[1], "--dc") == 0;
    if (check_first_image()) {
        return 1;
    }
    printf("libethercat %u.%u\n", ecrt_version_magic() >> 8, ecrt_version_magic() & 0xFF);
    program.master = ecrt_request_master(0);
    if (program.master == NULL) {
        failed("the master cannot be requested");
        return 1;
    }
    result = configure(&program) || activate(&program) || wait_for_op(&program)
          || exchange_frame(&program);
    ecrt_release_master(program.master);
    if (result == 0) {
        printf("done\n");
    }
    return result ? 1 : 0;
}
