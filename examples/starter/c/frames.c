/* Sends a frame in every cycle and prints the frames that return. machine.toml describes the gateways. */
#include <stdio.h>

#include <igh_mcan_port.h>

enum { SLAVE = 0, CHANNEL = 0, CYCLES = 1000 };

static ecan_igh_context_t igh;
static igh_mcan_port_t mcan;

/* Prints what was lost, why, and what returned. */
static void print_changes(void)
{
    char text[256];
    while (igh_mcan_port_next_change(&mcan, text, sizeof(text), NULL) == ECAN_OK && text[0]) {
        fprintf(stderr, "%s\n", text);
    }
}

static int run_cycle(unsigned count)
{
    igh_mcan_rx_frame_t rx[32];
    size_t received = 0;
    const uint8_t data[2] = {(uint8_t)count, (uint8_t)(count >> 8)};
    int code = igh_mcan_port_wait_next_cycle(&mcan);
    if (code == ECAN_OK) {
        code = igh_mcan_port_cycle_begin(&mcan);
    }
    if (code == ECAN_OK) {
        code = igh_mcan_port_receive(&mcan, rx, 32, &received);
    }
    for (size_t i = 0; i < received; i++) {
        printf("can%u %03X, %u bytes\n", rx[i].channel, (unsigned)rx[i].can_id, rx[i].len);
    }
    if (code == ECAN_OK) {
        code = igh_mcan_port_send_can(&mcan, SLAVE, CHANNEL, 0x123, 0, data, sizeof(data));
    }
    /* A full queue, a lost link or a restarting gateway is temporary: the loop continues. */
    if (code == ECAN_OK || ecan_result_is_temporary(code)) {
        code = igh_mcan_port_cycle_end(&mcan);
    }
    print_changes();
    return code;
}

int main(void)
{
    int code = ecan_open(&igh, &mcan, "machine.toml");
    for (unsigned count = 0; code == ECAN_OK && count < CYCLES; count++) {
        code = run_cycle(count);
    }
    if (code == ECAN_OK) {
        code = igh_mcan_port_check_delivery(&mcan);
    }
    if (code != ECAN_OK) {
        fprintf(stderr, "starter: %s\n", ecan_last_error());
    }
    ecan_igh_deinit(&igh);
    return code == ECAN_OK ? 0 : 1;
}
