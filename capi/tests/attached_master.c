/*
 * An application that runs the master itself and hands it to the SDK for its ECAN-Lite slaves: the
 * cycle of the Port lies between the owner's ecrt_master_receive() and ecrt_master_send(), and a
 * frame returns from the echo node.
 *
 *     LD_LIBRARY_PATH=build/sim ./attached_master
 *     LD_LIBRARY_PATH=build/sim ECAN_ECRT=sim:FILE.toml ./attached_master
 */
#include <stdio.h>

#include "ecrt_plain.h"
#include "igh_mcan_port.h"
#include "igh_sim.h"

#define CYCLE_US 1000
/* Cycles until the gateway must be ready, and until the frame must have returned. */
#define START_CYCLES 20000
#define ECHO_CYCLES 200

static int failed(const char *what)
{
    fprintf(stderr, "attached_master: %s: %s\n", what, ecan_last_error());
    return 1;
}

/* Runs one cycle; returns the number of echoes of the frame. */
static int cycle(ec_master_t *master, igh_mcan_port_t *port, int sends)
{
    const uint8_t data[2] = {0x12, 0x34};
    igh_mcan_rx_frame_t rx[16];
    size_t count = 0;
    int echoes = 0;

    igh_mcan_port_wait_next_cycle(port); /* also right in the stepped time of a scenario */
    ecrt_master_receive(master);
    igh_mcan_port_cycle_begin(port);
    igh_mcan_port_receive(port, rx, 16, &count);
    for (size_t i = 0; i < count; i++) {
        echoes += rx[i].can_id == 0x155 && rx[i].len == 2 && rx[i].data[1] == 0x34;
    }
    if (sends && igh_mcan_port_send_can(port, 0, 0, 0x155, 0, data, 2) != ECAN_OK) {
        failed("send");
    }
    igh_mcan_port_cycle_end(port);
    ecrt_master_send(master);
    return echoes;
}

static int run(ec_master_t *master, ecan_igh_context_t *igh, igh_mcan_port_t *port)
{
    ecan_igh_config_t config;
    igh_mcan_port_config_t gateways;
    int cycles = 0;
    int echoes = 0;

    ecan_igh_default_config(&config);
    ecan_igh_config_set_cycle_us(&config, CYCLE_US);
    igh_mcan_port_default_config(&gateways);
    igh_mcan_port_set_classic_channel(&gateways, 0, 0, 1000000);
    if (igh_mcan_port_apply_config(&config, &gateways) != ECAN_OK ||
        ecan_igh_attach(igh, &config, master) != ECAN_OK ||
        igh_mcan_port_init(port, igh, &gateways) != ECAN_OK) {
        return failed("attach");
    }
    if (!ecan_igh_is_simulated(igh)) {
        return failed("the library does not identify itself as simulated");
    }
    if (ecrt_master_activate(master) != 0) {
        return failed("activate");
    }
    if (ecan_igh_owner_activated(igh) != ECAN_OK) {
        return failed("owner_activated");
    }
    if (ecan_igh_wait_op_timeout(igh, 1000) != ECAN_ERR_ATTACHED ||
        ecan_igh_activate(igh) != ECAN_ERR_ATTACHED) {
        return failed("a call that is reserved for the owner was not rejected");
    }
    while (!igh_mcan_port_is_ready(port)) {
        if (++cycles > START_CYCLES) {
            return failed("the gateway did not come into service");
        }
        cycle(master, port, 0);
    }
    for (int n = 0; n < ECHO_CYCLES && echoes == 0; n++) {
        echoes += cycle(master, port, n == 0);
    }
    printf("ready after %d cycles, %d echo(es)\n", cycles, echoes);
    return echoes == 1 ? 0 : failed("the frame did not come back");
}

int main(void)
{
    ecan_igh_context_t igh;
    igh_mcan_port_t port;
    ec_master_t *master = ecrt_request_master(0);
    if (master == NULL) {
        fputs("attached_master: no master\n", stderr);
        return 1;
    }
    int code = run(master, &igh, &port);
    /* Before the owner releases the master. */
    if (ecan_igh_deinit(&igh) != ECAN_OK) {
        code = failed("deinit");
    }
    ecrt_release_master(master);
    return code;
}
