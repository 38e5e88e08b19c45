// An exception that leaves a callback ends the process with a message, and does not return to the
// caller of the library. Run by scripts/check-c.sh, which expects SIGABRT.
#include <cstdio>
#include <stdexcept>

#include "igh_cia402_protocol.h"
#include "igh_sim.h"

extern "C" int stop(void *)
{
    throw std::runtime_error("stop");
}

extern "C" void progress(void *, size_t, const char *)
{
    throw std::runtime_error("progress");
}

int main(int argc, char **)
{
    ecan_igh_config_t igh_config;
    igh_mcan_port_config_t mcan_config;
    ecan_igh_context_t igh;
    igh_mcan_port_t mcan;
    igh_cia402_context_t cia402;
    igh_cia402_axis_t axis;
    const bool is_progress = argc > 1;

    ecan_igh_default_config(&igh_config);
    ecan_igh_config_set_ecrt(&igh_config, "sim:drives");
    ecan_igh_config_set_stepped_clock(&igh_config, 1);
    igh_mcan_port_default_config(&mcan_config);
    igh_mcan_port_set_classic_channel(&mcan_config, 0, 0, 1000000);
    igh_cia402_axis_init(&axis, 0, 0, 1, 0);
    if (igh_mcan_port_apply_config(&igh_config, &mcan_config) != ECAN_OK ||
        ecan_igh_init(&igh, &igh_config) != ECAN_OK ||
        igh_mcan_port_init(&mcan, &igh, &mcan_config) != ECAN_OK ||
        igh_cia402_context_init(&cia402, &mcan, &axis, 1) != ECAN_OK) {
        std::fprintf(stderr, "%s\n", ecan_last_error());
        return 1;
    }
    try {
        if (!is_progress) {
            ecan_igh_stop_waiting_when(&igh, stop, nullptr);
        }
        ecan_igh_wait_op_timeout(&igh, 30000);
        igh_cia402_set_progress_callback(&cia402, progress, nullptr);
        if (igh_cia402_start_up_timeout(&cia402, 30000) != ECAN_OK) {
            std::fprintf(stderr, "%s\n", ecan_last_error());
        }
    } catch (const std::exception &) {
        std::puts("the exception passed through the library");
        return 1;
    }
    std::puts("the exception was lost");
    return 1;
}
