// The headers in C++: the same program, with contexts on the heap.
#include <cstdint>
#include <cstdio>
#include <memory>

#include <igh_cia402_protocol.h>
#include <igh_sim.h>

int main()
{
    auto config = std::make_unique<ecan_igh_config_t>();
    auto gateways = std::make_unique<igh_mcan_port_config_t>();
    auto igh = std::make_unique<ecan_igh_context_t>();
    auto port = std::make_unique<igh_mcan_port_t>();
    const std::uint8_t data[3] = {1, 2, 3};
    bool is_back = false;

    ecan_igh_default_config(config.get());
    ecan_igh_config_set_stepped_clock(config.get(), 1);
    igh_mcan_port_default_config(gateways.get());
    igh_mcan_port_set_canfd_channel(gateways.get(), 0, 1, 1000000, 5000000);
    if (igh_mcan_port_apply_config(config.get(), gateways.get()) != ECAN_OK ||
        ecan_igh_init(igh.get(), config.get()) != ECAN_OK ||
        igh_mcan_port_init(port.get(), igh.get(), gateways.get()) != ECAN_OK ||
        ecan_igh_wait_op_timeout(igh.get(), 10000) != ECAN_OK) {
        std::fprintf(stderr, "%s\n", ecan_last_error());
        return 1;
    }
    for (int cycle = 0; cycle < 50 && !is_back; cycle++) {
        igh_mcan_rx_frame_t rx[8];
        std::size_t count = 0;
        igh_mcan_port_wait_next_cycle(port.get());
        igh_mcan_port_cycle_begin(port.get());
        igh_mcan_port_receive(port.get(), rx, 8, &count);
        is_back = count > 0 && (rx[0].flags & IGH_MCAN_FLAG_FD) != 0 && rx[0].len == 3;
        if (cycle == 0) {
            igh_mcan_port_send_canfd(port.get(), 0, 1, 0x321, IGH_MCAN_FLAG_BRS, data, 3);
        }
        igh_mcan_port_cycle_end(port.get());
    }
    ecan_igh_deinit(igh.get());
    std::puts(is_back ? "the frame received back" : "the frame did not come back");
    return is_back ? 0 : 1;
}
