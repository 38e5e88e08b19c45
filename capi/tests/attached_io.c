/*
 * An application with a slave of another vendor and an ECAN-Lite on one master: it serves its digital
 * I/O in a domain of its own by plain ecrt_* calls, and the SDK, attached to the master, carries CAN
 * frames through the gateway.
 *
 *     LD_LIBRARY_PATH=build/sim ECAN_ECRT=sim:capi/tests/attached_cell.toml ./attached_io
 */
#include <stdio.h>

#include "igh_mcan_port.h"
#include "owned_io.h"

#define CYCLE_US 1000
/* Cycles until everything must be in OP, and with frames. */
#define START_CYCLES 20000
#define FRAME_CYCLES 500

typedef struct {
    ec_master_t *master;
    igh_mcan_port_t port;
    owned_io_t io;
    /* Echoes in order, and cycles in which the input showed the output. */
    unsigned int echoes;
    unsigned int looped_back;
    uint8_t last_output;
} cell_t;

static int failed(const char *what)
{
    fprintf(stderr, "attached_io: %s: %s\n", what, ecan_last_error());
    return 1;
}

/* Runs one cycle; returns 1 if the I/O was exchanged. Sends a frame if `frame` is not 0. */
static int cycle(cell_t *cell, uint8_t frame)
{
    igh_mcan_rx_frame_t rx[16];
    size_t count = 0;
    int is_complete;

    igh_mcan_port_wait_next_cycle(&cell->port);
    ecrt_master_receive(cell->master);
    is_complete = owned_io_receive(&cell->io);
    if (is_complete && cell->io.data[cell->io.input] == cell->last_output) {
        cell->looped_back++;
    }
    igh_mcan_port_cycle_begin(&cell->port);
    igh_mcan_port_receive(&cell->port, rx, 16, &count);
    for (size_t i = 0; i < count; i++) {
        cell->echoes += rx[i].can_id == 0x155 && rx[i].data[0] == (uint8_t)(cell->echoes + 1);
    }
    if (frame != 0 &&
        igh_mcan_port_send_can(&cell->port, 0, 0, 0x155, 0, &frame, 1) != ECAN_OK) {
        failed("send");
    }
    igh_mcan_port_cycle_end(&cell->port);
    cell->last_output = cell->io.data[cell->io.output];
    owned_io_send(&cell->io, frame);
    ecrt_master_send(cell->master);
    return is_complete;
}

static int run(cell_t *cell, ecan_igh_context_t *igh)
{
    ecan_igh_config_t config;
    igh_mcan_port_config_t gateways;
    int cycles = 0;

    if (owned_io_configure(&cell->io, cell->master) != 0) {
        return failed("the I/O cannot be configured");
    }
    ecan_igh_default_config(&config);
    ecan_igh_config_set_cycle_us(&config, CYCLE_US);
    ecan_igh_config_set_slave_position(&config, 0, 0, 1);
    igh_mcan_port_default_config(&gateways);
    igh_mcan_port_set_classic_channel(&gateways, 0, 0, 1000000);
    if (igh_mcan_port_apply_config(&config, &gateways) != ECAN_OK ||
        ecan_igh_attach(igh, &config, cell->master) != ECAN_OK ||
        igh_mcan_port_init(&cell->port, igh, &gateways) != ECAN_OK) {
        return failed("attach");
    }
    if (ecrt_master_activate(cell->master) != 0 || owned_io_begin(&cell->io) != 0) {
        return failed("activate");
    }
    if (ecan_igh_owner_activated(igh) != ECAN_OK) {
        return failed("owner_activated");
    }
    while (!cycle(cell, 0) || igh_mcan_port_is_ready(&cell->port) != 1) {
        if (++cycles > START_CYCLES) {
            return failed("the gateway or the I/O is not ready");
        }
    }
    cell->looped_back = 0;
    for (int n = 1; n <= FRAME_CYCLES; n++) {
        cycle(cell, (uint8_t)(n % 10 == 0 ? n / 10 : 0));
    }
    printf("ready after %d cycles, %u echoes, %u cycles with the output as input\n", cycles,
           cell->echoes, cell->looped_back);
    if (cell->echoes < FRAME_CYCLES / 10 - 1) {
        return failed("frames did not return");
    }
    return cell->looped_back >= FRAME_CYCLES / 2 ? 0 : failed("the I/O does not work");
}

int main(void)
{
    static cell_t cell;
    ecan_igh_context_t igh;
    cell.master = ecrt_request_master(0);
    if (cell.master == NULL) {
        fputs("attached_io: no master\n", stderr);
        return 1;
    }
    int code = run(&cell, &igh);
    /* Before the owner releases the master. */
    if (ecan_igh_deinit(&igh) != ECAN_OK) {
        code = failed("deinit");
    }
    ecrt_release_master(cell.master);
    return code;
}
