// Behaviour of ecan_lite.hpp without exceptions: results. Built with -fno-exceptions -fno-rtti.
#include <ecan_lite.hpp>

#include <array>

#include "check.hpp"

using namespace std::chrono_literals;

namespace {

const ecan::channel_address CAN0 = {0, 0};

void frames_return()
{
    ecan::bus_config config;
    config.set_ecrt("sim:echo").set_stepped_clock().set_classic_channel(CAN0, 500'000);
    CHECK(config.check().has_value());
    auto master = ecan::master::open(config);
    CHECK(master.has_value());
    auto port = ecan::port::open(*master, config);
    CHECK(port && master->wait_op(10s));
    int echoes = 0;
    const std::array<std::uint8_t, 2> data = {7, 8};
    for (int n = 0; n < 20; n++) {
        auto cycle = port->next_cycle();
        cycle.for_each_received([&](const ecan::received_frame &frame) {
                 echoes += frame.data().size() == 2 && frame.data()[1] == 8;
             }).ignore();
        if (n == 0) {
            CHECK(cycle.send(CAN0, ecan::can_id::extended(0x12345), data).ok());
        }
    }
    CHECK(echoes == 1);
    const auto second = ecan::port::open(*master, config);
    CHECK(!second && second.error().code == ecan::errc::order);
    CHECK(!second.error().message.empty());
}

void failures_are_results()
{
    ecan::bus_config config;
    config.set_slave_count(0);
    const auto checked = config.check();
    CHECK(!checked && checked.error().code == config.failure_of()->code);
    CHECK(!ecan::master::open(config));
    CHECK(!ecan::bus_config::load("/nonexistent.toml"));
    const auto made = ecan::check(ecan::status(ECAN_ERR_NO_ROOM));
    CHECK(!made && made.error().code == ecan::errc::no_room);
    CHECK(ecan::status(ECAN_ERR_NO_ROOM).is_temporary());
    CHECK(ecan::check(ecan::status()).has_value());
}

void results_are_read_if_constant()
{
    const ecan::result<std::string> text(std::string("abc"));
    CHECK(text.value() == "abc" && *text == "abc" && text->size() == 3);
    const auto moved = *ecan::result<std::string>(std::string("d"));
    CHECK(moved == "d");
}

} // namespace

int main()
{
    frames_return();
    failures_are_results();
    results_are_read_if_constant();
    return check::report("results");
}
