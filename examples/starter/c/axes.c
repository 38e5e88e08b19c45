/* Enables the axes of machine.toml at their actual positions, moves them, and brings them to rest. */
#include <stdio.h>

#include <igh_cia402_protocol.h>

enum { CYCLES = 1000, TIMEOUT_MS = 20000 };

static ecan_igh_context_t igh;
static igh_mcan_port_t mcan;
static igh_cia402_context_t axes;

static void print_progress(void *user, size_t axis, const char *text)
{
    (void)user;
    (void)axis;
    printf("%s\n", text);
}

/* Prints what was lost, why, and what returned. */
static void print_changes(void)
{
    char text[256];
    while (igh_mcan_port_next_change(&mcan, text, sizeof(text), NULL) == ECAN_OK && text[0]) {
        fprintf(stderr, "%s\n", text);
    }
}

static int start(void)
{
    int code = ecan_open(&igh, &mcan, "machine.toml");
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
    if (code == ECAN_OK) {
        code = igh_mcan_port_cycle_end(&mcan);
    }
    print_changes();
    return code;
}

int main(void)
{
    int code = start();
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
