// Enables the axes of machine.toml at their actual positions, moves them, and brings them to rest.
#include <chrono>
#include <cstdio>
#include <string_view>

#include <ecan_lite.hpp>

using namespace std::chrono_literals;

int main()
try {
    ecan::port port = ecan::port::open_file("machine.toml");
    // Stops the axes when it is destroyed, also after an error.
    ecan::axes axes = ecan::axes::open_file(port, "machine.toml");
    axes.on_progress([](std::size_t, std::string_view text) {
        std::printf("%.*s\n", static_cast<int>(text.size()), text.data());
    });
    axes.start_up(20s);

    for (unsigned count = 0; count < 1000; count++) {
        auto cycle = port.next_cycle();
        ecan::check(axes.process_received());
        ecan::check(axes.send_target_step());
        ecan::check(cycle.end());
        port.for_each_change([](const char *change) { std::fprintf(stderr, "%s\n", change); });
    }
    axes.shutdown(20s);
    return 0;
} catch (const ecan::error &error) {
    std::fprintf(stderr, "starter: %s\n", error.what());
    return 1;
}
