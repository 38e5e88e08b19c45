// Sends CAN frames and prints those that return, in C++17 without exceptions: functions outside the cycle
// return a result. Built with -fno-exceptions -fno-rtti.
//
//     frames --ecrt sim
#define ECAN_LITE_NO_EXCEPTIONS
#include <ecan_lite.hpp>

#include <array>
#include <cstdio>
#include <cstring>

using namespace std::chrono_literals;

namespace {

int failed(const ecan::failure &failure)
{
    std::fprintf(stderr, "frames: %s\n", failure.message.c_str());
    return 1;
}

} // namespace

int main(int argc, char **argv)
{
    const ecan::channel_address can0 = {0, 0};
    ecan::bus_config config;
    if (argc == 3 && std::strcmp(argv[1], "--ecrt") == 0) {
        config.set_ecrt(argv[2]);
    }
    config.set_stepped_clock().set_cycle(1ms).set_classic_channel(can0, 500'000);
    auto master = ecan::master::open(config);
    if (!master) {
        return failed(master.error());
    }
    auto port = ecan::port::open(*master, config);
    if (!port) {
        return failed(port.error());
    }
    if (const auto ready = master->wait_op(20s); !ready) {
        return failed(ready.error());
    }
    int received = 0;
    for (std::uint8_t n = 0; n < 20; n++) {
        auto cycle = port->next_cycle();
        const auto taken = cycle.for_each_received([&](const ecan::received_frame &frame) {
            std::printf("%03X [%zu]\n", frame.id().value(), frame.data().size());
            received++;
        });
        const std::array<std::uint8_t, 2> data = {n, 0x55};
        const auto sent = cycle.send(can0, ecan::can_id::standard(0x100u + n), data);
        // a full queue or a lost link is temporary: the loop continues
        for (const auto status : {taken, sent, cycle.end()}) {
            if (!status && !status.is_temporary()) {
                std::fprintf(stderr, "frames: %s\n", status.text());
                return 1;
            }
        }
    }
    return received > 0 ? 0 : 1;
}
