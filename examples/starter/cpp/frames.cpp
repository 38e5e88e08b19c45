// Sends a frame in every cycle and prints the frames that return. machine.toml describes the gateways.
#include <array>
#include <cstdio>

#include <ecan_lite.hpp>

int main()
try {
    const ecan::channel_address can0 = {0, 0};
    ecan::port port = ecan::port::open_file("machine.toml");

    for (unsigned count = 0; count < 1000; count++) {
        auto cycle = port.next_cycle();
        ecan::check(cycle.for_each_received([](const ecan::received_frame &frame) {
            std::printf("%03X, %zu bytes\n", frame.id().value(), frame.data().size());
        }));
        const std::array<std::uint8_t, 2> data = {static_cast<std::uint8_t>(count),
                                                  static_cast<std::uint8_t>(count >> 8)};
        // A full queue, a lost link or a restarting gateway is temporary: the loop continues.
        if (const auto sent = cycle.send(can0, ecan::can_id::standard(0x123), data);
            !sent && !sent.is_temporary()) {
            ecan::check(sent);
        }
        ecan::check(cycle.end());
        port.for_each_change([](const char *change) { std::fprintf(stderr, "%s\n", change); });
    }
    ecan::check(port.check_delivery());
    return 0;
} catch (const ecan::error &error) {
    std::fprintf(stderr, "starter: %s\n", error.what());
    return 1;
}
