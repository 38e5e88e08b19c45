// Two CiA 402 axes on a gateway, in C++17: configures and enables them, moves them in opposite
// directions until the end or Ctrl-C, and brings them to rest.
//
//     two_axes --ecrt sim
//     two_axes --ecrt sim --cycles 5000 --step 50
#include <ecan_lite.hpp>

#include <array>
#include <csignal>
#include <cstdio>
#include <cstdlib>

#include "arguments.hpp"

using namespace std::chrono_literals;

namespace {

volatile std::sig_atomic_t is_interrupted = 0;

/** The first signal stops the axes, which may take its whole time; the second one ends the program. */
void interrupt(int)
{
    if (is_interrupted != 0) {
        std::_Exit(130);
    }
    is_interrupted = 1;
}

ecan::bus_config configure(const arguments &from)
{
    ecan::bus_config config;
    if (from.ecrt) {
        config.set_ecrt(*from.ecrt);
    }
    config.suggest_scenario("drives").set_stepped_clock(!from.real_time);
    config.set_cycle(from.cycle).set_pdo_multiplier(from.pdo_n);
    config.set_classic_channel({0, from.channel}, from.bitrate);
    return config;
}

/** A bus with two axes. Its members end in reverse order: the axes first, the master last. */
class machine {
public:
    explicit machine(const arguments &from)
        : machine(configure(from), ecan::channel_address{0, from.channel})
    {
    }

    void start()
    {
        master_.stop_waiting_when([] { return is_interrupted != 0; });
        axes_.on_progress([](std::size_t, std::string_view text) {
            std::printf("  %.*s\n", static_cast<int>(text.size()), text.data());
        });
        master_.wait_op();
        const auto begin = master_.now();
        axes_.start_up(30s);
        const std::chrono::duration<double> took = master_.now() - begin;
        std::printf("both axes enabled after %.2f s\n", took.count());
    }

    /** Moves the axes by a step per cycle. Nothing here throws or allocates in a good cycle. */
    void move(std::uint32_t cycles, std::int32_t step)
    {
        ecan::check(axes_[0].set_target_step(step));
        ecan::check(axes_[1].set_target_step(-step));
        for (std::uint32_t n = 0; n < cycles && is_interrupted == 0; n++) {
            auto cycle = port_.next_cycle();
            ecan::check(axes_.process_received());
            ecan::check(axes_.send_target_step());
            // a cycle that failed is repeated by the next one
            if (const auto sent = cycle.end(); !sent && !sent.is_temporary()) {
                ecan::check(sent);
            }
        }
    }

    void print()
    {
        for (auto axis : axes_) {
            if (const auto state = axis.state()) {
                std::printf("axis %zu: position %d, target %d\n", axis.index(),
                            state->actual().value_or(0), state->target().value_or(0));
            }
        }
        igh_mcan_statistics_t statistics = {};
        ecan::check(port_.get_statistics(0, statistics));
        std::printf("%llu cycles, %llu incomplete\n",
                    static_cast<unsigned long long>(statistics.cycles),
                    static_cast<unsigned long long>(statistics.incomplete_cycles));
    }

    void shut_down() { axes_.shutdown(20s); }

private:
    machine(const ecan::bus_config &config, ecan::channel_address at)
        : master_(ecan::master::open(config)), port_(ecan::port::open(master_, config)),
          axes_(ecan::axes::open(port_, std::array{ecan::axis_config(at, 1), ecan::axis_config(at, 2)}))
    {
    }

    ecan::master master_;
    ecan::port port_;
    ecan::axes axes_;
};

} // namespace

int main(int argc, char **argv)
{
    const auto options = read_arguments(argc, argv);
    std::signal(SIGINT, interrupt);
    std::signal(SIGTERM, interrupt);
    try {
        machine machine(options);
        try {
            machine.start();
            machine.move(options.cycles, options.step);
            machine.print();
        } catch (const ecan::error &) {
            // after any failure, no axis is left moving
            machine.shut_down();
            throw;
        }
        machine.shut_down();
    } catch (const ecan::error &error) {
        std::fprintf(stderr, "two_axes: %s\n", error.what());
        return 1;
    }
    return 0;
}
