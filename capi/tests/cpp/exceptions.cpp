// Behaviour of ecan_lite.hpp with exceptions: echoes of frames, moves, callbacks, errors, axes.
#include <ecan_lite.hpp>

#include <array>
#include <stdexcept>
#include <thread>

#include "check.hpp"
#include "counting_new.hpp"

using namespace std::chrono_literals;

namespace {

const std::array<std::uint8_t, 3> DATA = {1, 2, 3};
const ecan::channel_address CAN0 = {0, 0};
const ecan::can_id ID = ecan::can_id::standard(0x123);

ecan::bus_config echo()
{
    ecan::bus_config config;
    config.set_ecrt("sim:echo").set_stepped_clock().set_cycle(1ms).set_canfd_channel(
        CAN0, 1'000'000, 5'000'000);
    return config;
}

/** Code of the error that the call throws; ok without one. */
template <class Call>
ecan::errc thrown(Call call)
{
    try {
        call();
    } catch (const ecan::error &error) {
        CHECK(error.what()[0] != '\0');
        return error.code();
    }
    return ecan::errc::ok;
}

/** Sends a frame in the first cycle; returns the echoes of all cycles. */
int exchange(ecan::port &port, int cycles)
{
    int echoes = 0;
    for (int n = 0; n < cycles; n++) {
        auto cycle = port.next_cycle();
        CHECK(cycle.began().ok());
        const auto received = cycle.for_each_received([&](const ecan::received_frame &frame) {
            const auto data = frame.data();
            echoes += frame.is_frame() && frame.address() == CAN0 && frame.id() == ID &&
                      data.size() == DATA.size() && data[2] == 3;
        });
        CHECK(received.ok());
        if (n == 0) {
            CHECK(cycle.send(CAN0, ID, DATA).ok());
        }
        CHECK(cycle.end().ok());
    }
    return echoes;
}

void frames_return_and_contexts_move()
{
    const auto config = echo();
    auto opened = ecan::master::open(config);
    CHECK(opened.is_simulated() && opened.clock_is_stepped());
    auto first = ecan::port::open(opened, config);
    // moved before and after the start, as into members of a machine
    ecan::master master(std::move(opened));
    CHECK(opened.raw() == nullptr);
    CHECK(opened.receive() == ecan::errc::null_pointer);
    master.wait_op();
    CHECK(master.is_operational() && first.is_ready());
    ecan::port port(std::move(first));
    CHECK(exchange(port, 20) == 1);
    CHECK(first.wait_next_cycle() == ecan::errc::null_pointer);
    CHECK(!first.is_ready());
    {
        auto cycle = first.next_cycle();
        CHECK(cycle.began() == ecan::errc::null_pointer);
        CHECK(cycle.send(CAN0, ID, DATA) == ecan::errc::null_pointer);
    }
    // a second Port is rejected, and the first one stays
    CHECK(thrown([&] { ecan::port::open(master, config); }) == ecan::errc::order);
    CHECK(exchange(port, 20) == 1);
    CHECK(master.slave_info(0).vendor_id != 0);
    CHECK(thrown([&] { master.slave_info(7); }) == ecan::errc::slave);
}

void order_of_destruction_does_not_matter()
{
    const auto config = echo();
    auto master = std::make_unique<ecan::master>(ecan::master::open(config));
    auto port = ecan::port::open(*master, config);
    master->wait_op();
    master.reset();
    CHECK(exchange(port, 20) == 1);
}

void cycle_may_outlive_port_and_master()
{
    const auto config = echo();
    auto master = std::make_unique<ecan::master>(ecan::master::open(config));
    auto port = std::make_unique<ecan::port>(ecan::port::open(*master, config));
    master->wait_op();
    auto cycle = port->next_cycle();
    port.reset();
    master.reset();
    CHECK(!cycle.send(CAN0, ID, DATA).ok());
    auto moved = std::move(cycle);
    CHECK(!moved.end().ok());
    CHECK(moved.end() == ecan::errc::null_pointer);
}

void cycle_allocates_nothing()
{
    const auto config = echo();
    auto master = ecan::master::open(config);
    auto port = ecan::port::open(master, config);
    master.wait_op();
    const auto before = allocations();
    int echoes = 0;
    std::array<igh_mcan_rx_frame_t, 8> frames;
    for (int n = 0; n < 500; n++) {
        auto cycle = port.next_cycle();
        const auto [status, received] = cycle.receive(frames);
        echoes += status.ok() ? static_cast<int>(received.size()) : 0;
        cycle.send_fd(CAN0, ID, DATA).ignore();
        igh_mcan_statistics_t statistics = {};
        port.get_statistics(0, statistics).ignore();
    }
    CHECK(allocations() == before);
    CHECK(echoes > 400);
}

void exception_in_a_cycle_ends_the_cycle()
{
    const auto config = echo();
    auto master = ecan::master::open(config);
    auto port = ecan::port::open(master, config);
    master.wait_op();
    try {
        auto cycle = port.next_cycle();
        throw std::logic_error("application");
    } catch (const std::logic_error &) {
    }
    CHECK(exchange(port, 20) == 1);
}

void exception_of_a_callback_passes_the_wait()
{
    const auto config = echo();
    auto master = ecan::master::open(config);
    auto port = ecan::port::open(master, config);
    int calls = 0;
    master.stop_waiting_when([&]() -> bool {
        if (++calls == 5) {
            throw std::range_error("stop");
        }
        return false;
    });
    try {
        master.wait_op();
        FAILED("the exception was lost");
    } catch (const std::range_error &error) {
        CHECK(std::string_view(error.what()) == "stop");
    }
    CHECK(calls == 5);
    master.stop_waiting_when([] { return true; });
    CHECK(thrown([&] { master.wait_op(); }) == ecan::errc::stopped);
    master.stop_waiting_when({});
    master.wait_op();
    CHECK(exchange(port, 20) == 1);
}

void opening_can_be_stopped()
{
    // a missing gateway is searched for until the PREOP timeout
    auto config = echo();
    config.set_slave_count(1).set_position(0, 0, 7).set_preop_timeout(60s);
    int calls = 0;
    const auto stop = [&calls] { return ++calls == 3; };
    CHECK(thrown([&] { ecan::master::open(config, stop); }) == ecan::errc::stopped);
    CHECK(calls == 3);
    try {
        ecan::master::open(config, []() -> bool { throw std::range_error("scan"); });
        FAILED("the exception was lost");
    } catch (const std::range_error &) {
    }
}

void faults_of_a_configuration_are_kept()
{
    ecan::bus_config config;
    config.set_cycle(0us).set_classic_channel({0, 9}, 500'000);
    config.set_pdo_multiplier(0).set_slave_count(99);
    CHECK(config.failure_of().has_value());
    const auto kept = config.failure_of()->code;
    CHECK(thrown([&] { config.check(); }) == kept);
    CHECK(thrown([&] { ecan::master::open(config); }) == kept);
    auto copy = config;
    copy = echo();
    copy.check();
    CHECK(config.failure_of() && !copy.failure_of());

    try {
        ecan::bus_config::parse("cycle_us = \"fast\"\n");
        FAILED("a faulty file was accepted");
    } catch (const ecan::error &error) {
        CHECK(error.code() == ecan::errc::config || error.code() == ecan::errc::file);
        CHECK(std::string_view(error.what()).find("line 1") != std::string_view::npos);
    }
    ecan::bus_config::parse("[[gateway]]\nn = 3\n[gateway.can0]\nbitrate = 500_000\n").check();
    CHECK(thrown([] { ecan::bus_config::load("/nonexistent.toml"); }) == ecan::errc::file);
    ecan::bus_config absent;
    absent.set_ecrt("/nonexistent/libethercat.so.1");
    CHECK(thrown([&] { ecan::master::open(absent); }) == ecan::errc::ecrt);
}

void objects_are_read_on_both_handles()
{
    const auto config = echo();
    auto master = ecan::master::open(config);
    std::array<std::uint8_t, 4> bytes = {};
    CHECK(master.sdo_upload(0, 0x1018, 1, bytes) == 4);
    auto handle = ecan::diagnostics::open(master);
    ecan::diagnostics moved(std::move(handle));
    std::array<std::uint8_t, 4> again = {};
    CHECK(moved.sdo_upload(0, 0x1018, 1, again) == 4 && again == bytes);
    CHECK(moved.master_state().slaves_responding == 1);
    CHECK(thrown([&] { handle.master_state(); }) == ecan::errc::null_pointer);
    try {
        master.sdo_upload(0, 0x7FFF, 0, bytes);
        FAILED("the object does not exist");
    } catch (const ecan::error &error) {
        CHECK(error.code() == ecan::errc::sdo && error.abort_code() == 0x06020000);
    }
}

ecan::bus_config drives()
{
    ecan::bus_config config;
    config.set_ecrt("sim:drives").set_stepped_clock().set_cycle(2ms);
    config.set_classic_channel(CAN0, 1'000'000);
    return config;
}

/** A network of two drives, one of them without an axis, described by a file. */
void network_boots_from_a_file()
{
    const std::string path = check::temporary_file(
        "cycle_us = 1000\n[[gateway]]\nn = 3\ncan0 = { bitrate = 1_000_000 }\n"
        "[[node]]\nname = \"arm\"\ngateway = 0\nchannel = 0\nnode = 1\n"
        "[node.axis]\ntarget_step = 10\n"
        "[[node]]\nname = \"pump\"\ngateway = 0\nchannel = 0\nnode = 2\n"
        "[[node]]\nname = \"lamp\"\ngateway = 0\nchannel = 0\nnode = 99\n"
        "boot_timeout_ms = 200\nmandatory = false\n");
    auto config = ecan::bus_config::load(path);
    config.set_ecrt("sim:drives").set_stepped_clock();
    auto master = ecan::master::open(config);
    auto port = ecan::port::open(master, config);
    master.wait_op(10s);
    CHECK(thrown([&] { ecan::axes::open_file(port, "/nonexistent.toml"); }) == ecan::errc::file);
    auto axes = ecan::axes::open_file(port, path);
    CHECK(axes.size() == 1 && axes.node_count() == 3);
    CHECK(axes.boot_state() == IGH_CANOPEN_BOOT_RUNNING);
    int calls = 0;
    axes.on_boot([&](std::size_t node, std::string_view text) {
        CHECK(node == 1 || node == 2);
        CHECK(text.find(node == 1 ? "pump" : "lamp") != std::string_view::npos);
        if (++calls == 2) {
            throw std::runtime_error("enough");
        }
    });
    bool is_caught = false;
    try {
        axes.wait_booted(20s);
    } catch (const std::runtime_error &error) {
        is_caught = std::string(error.what()) == "enough";
    }
    CHECK(is_caught);
    axes.on_boot({});
    axes.wait_booted(20s);
    CHECK(axes.boot_state() == IGH_CANOPEN_BOOT_DONE);
    auto pump = axes.find_node(CAN0, 2);
    CHECK(pump && pump->index() == 1 && pump->progress()->is_booted());
    CHECK(pump->boot_text().find("booted after") != std::string::npos);
    CHECK(!axes.find_node(CAN0, 50) && !axes.node_at(3).state());
    CHECK(axes.node_at(3).send_nmt(IGH_CANOPEN_NMT_START) == ecan::errc::node);
    CHECK(axes.node_at(0).progress()->phase() == IGH_CANOPEN_BOOT_PHASE_NONE);
    pump->set_guarding(100ms, 3, 2s);
    CHECK(thrown([&] { pump->set_guarding(100ms, 0, 2s); }) == ecan::errc::argument);
    pump->set_guarding(100s, 3, 2s);
    pump->set_guarding(0ms, 0, 2s);
    CHECK(pump->error_history(2s).empty());
    pump->store_parameters(IGH_CANOPEN_PARAMETERS_ALL, 10s);
    pump->restore_parameters(IGH_CANOPEN_PARAMETERS_ALL, 10s);
    pump->clear_error_history(2s);
    CHECK(pump->boot_again().ok());
    axes.wait_booted(20s);
    auto other = axes.add_node(CAN0, 3);
    CHECK(other.index() == 3 && other.state()->node_id == 3);
    ecan::lss_command selected(IGH_CANOPEN_LSS_SWITCH_GLOBAL);
    CHECK(ecan::lss(port, CAN0, selected, 1s).outcome == IGH_CANOPEN_LSS_OUTCOME_DONE);
    selected = ecan::lss_command(IGH_CANOPEN_LSS_IDENTIFY_NON_CONFIGURED);
    CHECK(ecan::lss(port, CAN0, selected, 5s).outcome == IGH_CANOPEN_LSS_OUTCOME_NOT_FOUND);
    axes.start_up(30s);
    CHECK(axes[0].set_digital_outputs(1) == ecan::errc::axis_state);
    CHECK(axes[0].arm_probe(1, 300) == ecan::errc::argument);
    CHECK(axes[0].disarm_probe(1) == ecan::errc::axis_state);
    igh_cia402_probe_t probe = {};
    CHECK(axes[0].get_probe(1, probe).ok() && probe.is_armed == 0);
    igh_cia402_drive_limits_t limits = {};
    CHECK(axes[0].get_drive_limits(limits).ok() && limits.is_read == 0);
    igh_cia402_drive_units_t units = {};
    CHECK(axes[0].get_drive_units(units).ok() && units.is_read == 0);
    CHECK(axes[0].set_target_with(axes[0].state()->target().value_or(0), 0, 0).ok());
    axes.shutdown(20s);
    std::remove(path.c_str());
}

void axes_start_move_and_stop()
{
    const auto config = drives();
    auto master = ecan::master::open(config);
    auto port = ecan::port::open(master, config);
    master.wait_op();
    const std::array<ecan::axis_config, 2> table = {
        ecan::axis_config{CAN0, 1}, ecan::axis_config{CAN0, 2}};
    auto opened = ecan::axes::open(port, table);
    ecan::axes axes(std::move(opened));
    CHECK(opened.size() == 0 && axes.size() == 2);
    CHECK(opened.send_targets() == ecan::errc::null_pointer);

    int steps = 0;
    axes.on_progress([&](std::size_t, std::string_view text) {
        steps += text.empty() ? 0 : 1;
        if (steps == 3) {
            throw std::out_of_range("progress");
        }
    });
    try {
        axes.start_up(30s);
        FAILED("the exception was lost");
    } catch (const std::out_of_range &) {
    }
    CHECK(steps == 3);
    axes.on_progress({});
    axes.start_up(30s);
    CHECK(axes.all_running());

    std::array<std::int32_t, 2> start = {};
    for (auto axis : axes) {
        start[axis.index()] = axis.state()->actual().value_or(0);
        CHECK(axis.set_target_step(axis.index() == 0 ? 10 : -10).ok());
    }
    const auto before = allocations();
    for (int n = 0; n < 300; n++) {
        auto cycle = port.next_cycle();
        CHECK(axes.process_received().ok());
        CHECK(axes.send_target_step().ok());
        for (auto axis : axes) {
            CHECK(axis.state()->is_running());
        }
    }
    CHECK(allocations() == before);
    CHECK(axes[0].state()->actual().value_or(0) - start[0] > 2000);
    CHECK(axes[1].state()->actual().value_or(0) - start[1] < -2000);
    CHECK(axes[5].halt() == ecan::errc::axis && !axes[5].state());
    CHECK(!axes[0].text().empty());
    CHECK(axes.all().quick_stop().ok());
    axes.shutdown(20s);
    CHECK(axes.shutdown_is_done());
}

void observer_reads_and_commands_from_another_thread()
{
    const auto config = drives();
    auto master = std::make_unique<ecan::master>(ecan::master::open(config));
    auto port = std::make_unique<ecan::port>(ecan::port::open(*master, config));
    master->wait_op();
    const std::array<ecan::axis_config, 1> table = {ecan::axis_config{CAN0, 1}};
    auto axes = std::make_unique<ecan::axes>(ecan::axes::open(*port, table));
    axes->start_up(30s);
    auto opened = ecan::observer::open(*master);
    CHECK(opened.update() == ecan::errc::not_ready && !opened.cycle());
    ecan::observer observer(std::move(opened));
    const auto run = [&](int cycles) {
        for (int n = 0; n < cycles; n++) {
            auto cycle = port->next_cycle();
            CHECK(axes->process_received().ok() && axes->send_targets().ok());
        }
    };
    run(3);
    ecan::command stop;
    std::thread([&] {
        const auto before = allocations();
        // takes memory for the first snapshot only, and not by operator new
        CHECK(observer.update().ok() && allocations() == before);
        CHECK(observer.cycle() && observer.cycle()->axis_count == 1);
        CHECK(observer.axis(0) && observer.axis(0)->is_running() && !observer.axis(1));
        CHECK(observer.session(0) == IGH_MCAN_SESSION_READY && !observer.session(5));
        CHECK(observer.statistics(0)->cycles > 3 && observer.statistics(CAN0)->frames_sent > 0);
        CHECK(observer.domain_report(0)->is_complete == 1 && observer.channel_status(CAN0));
        stop = observer.quick_stop_all();
        CHECK(stop.given.ok() && stop.ticket > 0 && !observer.has_executed(stop));
    }).join();
    run(2);
    CHECK(observer.update().ok() && observer.has_executed(stop));
    CHECK(!observer.axis(0)->is_running());
    const ecan::command rejected = observer.quick_stop(7);
    CHECK(rejected.given == ecan::errc::axis && rejected.ticket == 0);
    CHECK(!observer.has_executed(rejected));

    CHECK(observer.request_stop().given.ok());
    CHECK(thrown([&] { axes->start_up(30s); }) == ecan::errc::stopped);
    CHECK(master->is_stop_requested());
    master->clear_stop_request();
    CHECK(!master->is_stop_requested());
    axes->start_up(30s);
    axes->shutdown(20s);
    axes.reset();
    port.reset();
    master.reset();
    CHECK(observer.update() == ecan::errc::order);
    CHECK(opened.request_stop().given == ecan::errc::null_pointer);
}

void faults_of_the_axis_table_are_reported()
{
    const auto config = drives();
    auto master = ecan::master::open(config);
    auto port = ecan::port::open(master, config);
    const std::array<ecan::axis_config, 2> twice = {
        ecan::axis_config{CAN0, 1}, ecan::axis_config{CAN0, 1}};
    CHECK(thrown([&] { ecan::axes::open(port, twice); }) != ecan::errc::ok);
    CHECK(!ecan::axis_config({0, 9}, 1).checked());
    // the Port can still get axes
    const std::array<ecan::axis_config, 1> one = {ecan::axis_config{CAN0, 1}};
    CHECK(ecan::axes::open(port, one).size() == 1);
}

void durations_are_rounded_up()
{
    using ecan::detail::count_of;
    CHECK(count_of<std::chrono::milliseconds>(1500us) == 2);
    CHECK(count_of<std::chrono::microseconds>(-1ns) == 0);
}

void long_durations_are_limited()
{
    using ecan::detail::count_of;
    constexpr std::uint32_t most = 0xFFFFFFFF;
    CHECK(count_of<std::chrono::nanoseconds>(1000h) == most);
    CHECK(count_of<std::chrono::milliseconds>(std::chrono::milliseconds::max()) == most);
    CHECK(count_of<std::chrono::nanoseconds>(std::chrono::hours::max()) == most);
    CHECK(count_of<std::chrono::milliseconds>(std::chrono::nanoseconds::max()) == most);
    CHECK(count_of<std::chrono::milliseconds>(std::chrono::milliseconds::min()) == 0);
    CHECK(count_of<std::chrono::nanoseconds>(4294967295ns) == most);
    CHECK(count_of<std::chrono::nanoseconds>(4294967294ns) == most - 1);
    CHECK(count_of<std::chrono::nanoseconds>(4294ms) == 4294000000u);
    const auto config = echo();
    auto master = ecan::master::open(config);
    auto port = ecan::port::open(master, config);
    master.wait_op(std::chrono::milliseconds::max());
    CHECK(master.is_operational());
}

} // namespace

int main()
{
    frames_return_and_contexts_move();
    order_of_destruction_does_not_matter();
    cycle_may_outlive_port_and_master();
    cycle_allocates_nothing();
    exception_in_a_cycle_ends_the_cycle();
    exception_of_a_callback_passes_the_wait();
    opening_can_be_stopped();
    faults_of_a_configuration_are_kept();
    objects_are_read_on_both_handles();
    axes_start_move_and_stop();
    network_boots_from_a_file();
    observer_reads_and_commands_from_another_thread();
    faults_of_the_axis_table_are_reported();
    durations_are_rounded_up();
    long_durations_are_limited();
    return check::report("exceptions");
}
