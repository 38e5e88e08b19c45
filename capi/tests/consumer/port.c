/* The smallest program of a customer: sends a frame, and receives it from the simulator's echo
 * node. */
#include <stdio.h>

#include <igh_cia402_protocol.h>
#include <igh_sim.h>

static int failed(const char *what)
{
    fprintf(stderr, "%s: %s\n", what, ecan_last_error());
    return 1;
}

int main(void)
{
    ecan_igh_config_t config;
    igh_mcan_port_config_t gateways;
    ecan_igh_context_t igh;
    igh_mcan_port_t port;
    const uint8_t data[3] = {1, 2, 3};
    int is_back = 0;

    if (ecan_version() != ECAN_VERSION) {
        fprintf(stderr, "header %d, library %d\n", ECAN_VERSION, ecan_version());
        return 1;
    }
    ecan_igh_default_config(&config);
    ecan_igh_config_set_stepped_clock(&config, 1);
    igh_mcan_port_default_config(&gateways);
    igh_mcan_port_set_classic_channel(&gateways, 0, 0, 500000);
    if (igh_mcan_port_apply_config(&config, &gateways) != ECAN_OK ||
        ecan_igh_init(&igh, &config) != ECAN_OK) {
        return failed("init");
    }
    if (igh_mcan_port_init(&port, &igh, &gateways) != ECAN_OK ||
        ecan_igh_wait_op_timeout(&igh, 10000) != ECAN_OK) {
        int code = failed("bring-up");
        ecan_igh_deinit(&igh);
        return code;
    }
    for (int cycle = 0; cycle < 50 && !is_back; cycle++) {
        igh_mcan_rx_frame_t rx[8];
        size_t count = 0;
        igh_mcan_port_wait_next_cycle(&port);
        igh_mcan_port_cycle_begin(&port);
        igh_mcan_port_receive(&port, rx, 8, &count);
        is_back = count > 0 && rx[0].can_id == 0x321 && rx[0].len == 3;
        if (cycle == 0) {
            igh_mcan_port_send_can(&port, 0, 0, 0x321, 0, data, sizeof(data));
        }
        igh_mcan_port_cycle_end(&port);
    }
    ecan_igh_deinit(&igh);
    puts(is_back ? "the frame received back" : "the frame did not come back");
    return is_back ? 0 : 1;
}
