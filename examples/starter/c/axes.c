/* Enables the axes of machine.toml at their actual positions, moves them, and brings them to rest. */
#include <stdio.h>

#include <igh_cia402_protocol.h>

enum { CYCLES = 1000, READY_MS = 20000, TIMEOUT_MS = 20000 };

/* Static: the configurations are too large for the stack of some threads. */
static ecan_igh_config_t igh_config;
static igh_mcan_port_config_t mcan_config;
static ecan_igh_context_t igh;
static igh_mcan_port_t mcan;
static igh_cia402_context_t axes;

static void print_progress(void *user, size_t axis, const char *text)
{
    (void)user;
    (void)axis;
    printf("%s\n", text);
}

static int open_machine(void)
{
    int code = ecan_igh_default_config(&igh_config);
    if (code == ECAN_OK) {
        code = igh_mcan_port_load_config(&igh_config, &mcan_config, "machine.toml", NULL, 0, NULL);
    }
    if (code == ECAN_OK) {
        code = ecan_igh_init(&igh, &igh_config);
    }
    if (code == ECAN_OK) {
        code = igh_mcan_port_init(&mcan, &igh, &mcan_config);
    }
    if (code == ECAN_OK) {
        code = ecan_igh_wait_op_timeout(&igh, READY_MS);
    }
    if (code == ECAN_OK) {
        code = igh_cia402_context_init_file(&axes, &mcan, "machine.toml", NULL);
    }
    if (code == ECAN_OK) {
        code = igh_cia402_set_progress_callback(&axes, print_progress, NULL);
    }
    return code == ECAN_OK ? igh_cia402_start_up_timeout(&axes, TIMEOUT_MS) : code;
}

static int run_cycle(void)
{
    int code = igh_mcan_port_wait_next_cycle(&mcan);
    if (code == ECAN_OK) {
        code = igh_mcan_port_cycle_begin(&mcan);
    }
    if (code == ECAN_OK) {
        code = igh_cia402_process_rx(&axes);
    }
    if (code == ECAN_OK) {
        code = igh_cia402_send_target_step(&axes);
    }
    return code == ECAN_OK ? igh_mcan_port_cycle_end(&mcan) : code;
}

int main(void)
{
    int code = open_machine();
    for (unsigned count = 0; code == ECAN_OK && count < CYCLES; count++) {
        code = run_cycle();
    }
    if (code == ECAN_OK) {
        code = igh_cia402_shutdown_timeout(&axes, TIMEOUT_MS);
    }
    if (code != ECAN_OK) {
        fprintf(stderr, "starter: %s\n", ecan_last_error());
    }
    /* Stops axes that may still move, also after an error. */
    igh_cia402_context_deinit(&axes);
    ecan_igh_deinit(&igh);
    return code == ECAN_OK ? 0 : 1;
}
