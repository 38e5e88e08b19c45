/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/** ECAN-Lite host SDK for C++17: CiA 402 axes. */
#ifndef ECAN_LITE_AXES_HPP
#define ECAN_LITE_AXES_HPP

#include <vector>

#include "nodes.hpp"
#include "port.hpp"

namespace ecan {
inline namespace ECAN_LITE_STYLE {

/** Configuration of an axis: the defaults for a drive, and all fields of igh_cia402_axis_t by `->`. */
class axis_config {
public:
    /** Drive with this node-ID on a channel; in CSP, without limits. */
    axis_config(channel_address at, std::uint8_t node_id) noexcept
        : code_(igh_cia402_axis_init(&raw_, at.slave, at.channel, node_id, 0))
    {
    }

    igh_cia402_axis_t *operator->() noexcept { return &raw_; }
    const igh_cia402_axis_t *operator->() const noexcept { return &raw_; }
    const igh_cia402_axis_t &raw() const noexcept { return raw_; }
    /** Status of the address: errc::channel, errc::argument. axes::open() reports it, too. */
    status checked() const noexcept { return code_; }

private:
    igh_cia402_axis_t raw_ = {};
    status code_;
};

/** Settings of all axes: the defaults, and all fields of igh_cia402_settings_t by `->`. */
class axes_settings {
public:
    axes_settings() noexcept { detail::ignore(igh_cia402_default_settings(&raw_)); }

    igh_cia402_settings_t *operator->() noexcept { return &raw_; }
    const igh_cia402_settings_t &raw() const noexcept { return raw_; }

private:
    igh_cia402_settings_t raw_ = {};
};

/** State of an axis: all fields of igh_cia402_axis_state_t by `->`, and usual questions. */
class axis_state {
public:
    explicit axis_state(const igh_cia402_axis_state_t &raw) noexcept : raw_(raw) {}

    const igh_cia402_axis_state_t *operator->() const noexcept { return &raw_; }
    igh_cia402_phase_t phase() const noexcept { return static_cast<igh_cia402_phase_t>(raw_.phase); }
    /** Actual position in steps, if it is known. */
    std::optional<std::int32_t> actual() const noexcept { return given(raw_.has_actual, raw_.actual); }
    /** Last target in steps, if there is one. */
    std::optional<std::int32_t> target() const noexcept { return given(raw_.has_target, raw_.target); }
    /** Returns whether the axis follows the targets of the application. */
    bool is_running() const noexcept { return raw_.is_running != 0; }
    bool is_at_rest() const noexcept { return raw_.is_at_rest != 0; }

private:
    static std::optional<std::int32_t> given(std::uint8_t has, std::int32_t value) noexcept
    {
        return has != 0 ? std::optional<std::int32_t>(value) : std::nullopt;
    }
    igh_cia402_axis_state_t raw_;
};

/** One axis of an axes object, or all of them. A handle to copy, valid as long as that object. */
class axis {
public:
    std::size_t index() const noexcept { return index_; }

    // Targets, real-time safe.

    /** Target of the next igh_cia402_send_targets_all(), in steps. */
    status set_target(std::int32_t steps) noexcept
    {
        return status(igh_cia402_set_target(context_, index_, steps));
    }
    /** Target with a feed-forward for the drive: velocity offset 0x60B1 and torque offset 0x60B2. */
    status set_target_with(std::int32_t steps, std::int32_t velocity_offset,
                           std::int16_t torque_offset) noexcept
    {
        return status(igh_cia402_set_target_with(context_, index_, steps, velocity_offset,
                                                 torque_offset));
    }
    status set_target_radians(double radians) noexcept
    {
        return status(igh_cia402_set_target_radians(context_, index_, radians));
    }
    /** Step per target of axes::send_target_step(). */
    status set_target_step(std::int32_t steps) noexcept
    {
        return status(igh_cia402_set_target_step(context_, index_, steps));
    }

    // Outputs and touch probes, real-time safe.

    status set_digital_outputs(std::uint32_t outputs) noexcept
    {
        return status(igh_cia402_set_digital_outputs(context_, index_, outputs));
    }
    /** Arms touch probe 1 or 2; `trigger` is a sum of igh_cia402_probe_trigger_t. */
    status arm_probe(std::uint8_t probe, int trigger) noexcept
    {
        const bool fits = trigger >= 0 && trigger <= UINT8_MAX;
        return status(igh_cia402_arm_probe(context_, index_, probe,
                                           fits ? static_cast<std::uint8_t>(trigger) : UINT8_MAX));
    }
    status disarm_probe(std::uint8_t probe) noexcept
    {
        return status(igh_cia402_disarm_probe(context_, index_, probe));
    }
    status get_probe(std::uint8_t probe, igh_cia402_probe_t &state) const noexcept
    {
        return status(igh_cia402_get_probe(context_, index_, probe, &state));
    }

    // Commands. Each starts an operation, which the cycle continues.

    status configure() noexcept { return status(igh_cia402_configure(context_, index_)); }
    status request_actual_position() noexcept
    {
        return status(igh_cia402_request_actual_position(context_, index_));
    }
    status enable() noexcept { return status(igh_cia402_enable(context_, index_)); }
    status disable() noexcept { return status(igh_cia402_disable(context_, index_)); }
    status quick_stop() noexcept { return status(igh_cia402_quick_stop(context_, index_)); }
    status halt() noexcept { return status(igh_cia402_halt(context_, index_)); }
    status resume() noexcept { return status(igh_cia402_resume(context_, index_)); }
    status recover() noexcept { return status(igh_cia402_recover(context_, index_)); }
    status reset_fault() noexcept { return status(igh_cia402_reset_fault(context_, index_)); }
    status change_mode(igh_cia402_mode_t mode) noexcept
    {
        return status(igh_cia402_change_mode(context_, index_, mode));
    }
    status home(const igh_cia402_homing_t &homing) noexcept
    {
        return status(igh_cia402_home(context_, index_, &homing));
    }

    /** State of the axis; empty if there is no such axis. Real-time safe. */
    std::optional<axis_state> state() const noexcept
    {
        igh_cia402_axis_state_t state = {};
        if (igh_cia402_get_axis_state(context_, index_, &state) != ECAN_OK) {
            return std::nullopt;
        }
        return axis_state(state);
    }
    /** Counters of the axis. Real-time safe. */
    status get_statistics(igh_cia402_axis_statistics_t &statistics) const noexcept
    {
        return status(igh_cia402_get_axis_statistics(context_, index_, &statistics));
    }
    /** Limits of the drive, and those in force. Real-time safe. */
    status get_drive_limits(igh_cia402_drive_limits_t &limits) const noexcept
    {
        return status(igh_cia402_get_drive_limits(context_, index_, &limits));
    }
    /** Units of the drive. Real-time safe. */
    status get_drive_units(igh_cia402_drive_units_t &units) const noexcept
    {
        return status(igh_cia402_get_drive_units(context_, index_, &units));
    }
    /** Text of the state. Not for the cycle. */
    outcome<std::string> text() const
    {
        return detail::text_of([&](char *text, std::size_t size, std::size_t *needed) {
            return igh_cia402_get_axis_text(context_, index_, text, size, needed);
        });
    }

private:
    friend class axes;
    axis(igh_cia402_context_t *context, std::size_t index) noexcept
        : context_(context), index_(index)
    {
    }
    igh_cia402_context_t *context_;
    std::size_t index_;
};

/** The axes of a Port (igh_cia402_protocol.h). A Port has one axes object. */
class axes {
public:
    /** Goes through the axes. */
    class iterator {
    public:
        iterator(igh_cia402_context_t *context, std::size_t index) noexcept
            : context_(context), index_(index)
        {
        }
        axis operator*() const noexcept { return {context_, index_}; }
        iterator &operator++() noexcept
        {
            index_++;
            return *this;
        }
        bool operator!=(const iterator &other) const noexcept { return index_ != other.index_; }
        bool operator==(const iterator &other) const noexcept { return index_ == other.index_; }

    private:
        igh_cia402_context_t *context_;
        std::size_t index_;
    };

    /**
     * Opens the axes on a Port.
     *
     * @usage not rt, the cycle's thread
     * @return As igh_cia402_context_init_ex(); the message names every fault of the table.
     */
    static outcome<axes> open(port &on, span<const axis_config> table,
                              const axes_settings &settings = {})
    {
        std::vector<igh_cia402_axis_t> rows;
        for (const auto &entry : table) {
            rows.push_back(entry.raw());
        }
        const int code = igh_cia402_context_init_ex(detail::axes_of(on.bus_), on.raw(), rows.data(),
                                                    rows.size(), &settings.raw());
        return detail::finish_with(code, axes(code == ECAN_OK ? on.bus_ : nullptr));
    }

    /**
     * Opens the axes and nodes of a configuration file on a Port; the nodes boot from the first cycle on.
     *
     * @usage not rt, the cycle's thread
     * @return As igh_cia402_context_init_file(); the message names every fault of the file.
     */
    static outcome<axes> open_file(port &on, const std::string &path,
                                   const axes_settings &settings = {})
    {
        const int code = igh_cia402_context_init_file(detail::axes_of(on.bus_), on.raw(),
                                                      path.c_str(), &settings.raw());
        return detail::finish_with(code, axes(code == ECAN_OK ? on.bus_ : nullptr));
    }

    axes(axes &&other) noexcept = default;
    axes &operator=(axes &&other) noexcept
    {
        axes old(std::move(other));
        std::swap(bus_, old.bus_);
        return *this;
    }
    /** Stops axes that may move, within the time of set_stop_time(): also after an exception. */
    ~axes()
    {
        if (bus_) {
            detail::ignore(igh_cia402_context_deinit(&bus_->axes));
            bus_->progress = nullptr;
            bus_->boot_progress = nullptr;
        }
    }

    /** Sets the longest time for which the destructor waits until the axes have stopped; zero leaves them as they are. */
    status set_stop_time(std::chrono::milliseconds time) noexcept
    {
        return status(igh_cia402_set_stop_time_ms(raw(), detail::ms_of(time)));
    }

    std::size_t size() const noexcept { return igh_cia402_axis_count(raw()); }
    /** An axis; one that does not exist returns errc::axis. */
    axis operator[](std::size_t index) noexcept { return {raw(), index}; }
    /** All axes, for commands. */
    axis all() noexcept { return {raw(), std::size_t{IGH_CIA402_ALL_AXES}}; }
    iterator begin() noexcept { return {raw(), 0}; }
    iterator end() noexcept { return {raw(), size()}; }

    /**
     * Sets a function that the waiting calls call with the progress of an axis. If it throws, the wait
     * ends and throws the same exception.
     */
    outcome<> on_progress(std::function<void(std::size_t axis, std::string_view text)> progress)
    {
        if (bus_) {
            bus_->progress = std::move(progress);
        }
        return detail::finish(
            igh_cia402_set_progress_callback(raw(), detail::bus::on_progress, bus_.get()));
    }

    // Nodes of the network: the drives, then those of the file, then added ones.

    std::size_t node_count() const noexcept { return igh_canopen_node_count(raw()); }
    /** A node; one that does not exist returns errc::node. */
    node node_at(std::size_t index) noexcept { return {bus_.get(), index}; }
    /** The node at an address, if the network has it. */
    std::optional<node> find_node(channel_address at, std::uint8_t node_id) noexcept
    {
        std::size_t index = 0;
        if (igh_canopen_find_node(raw(), at.slave, at.channel, node_id, &index) != ECAN_OK) {
            return std::nullopt;
        }
        return node_at(index);
    }
    /** Adds a node that does not boot. Not for the cycle. */
    outcome<node> add_node(channel_address at, std::uint8_t node_id)
    {
        std::size_t index = 0;
        const int code = igh_canopen_add_node(raw(), at.slave, at.channel, node_id, &index);
        return detail::finish_with(code, node_at(index));
    }
    /** State of the boot-up of all nodes. Real-time safe. */
    igh_canopen_boot_state_t boot_state() const noexcept
    {
        std::uint8_t state = IGH_CANOPEN_BOOT_FAILED;
        // it stays failed without axes
        detail::ignore(igh_canopen_get_boot_state(raw(), &state));
        return static_cast<igh_canopen_boot_state_t>(state);
    }
    /** Sets a function that wait_booted() calls with the progress of a node, as on_progress(). */
    outcome<> on_boot(std::function<void(std::size_t node, std::string_view text)> progress)
    {
        if (bus_) {
            bus_->boot_progress = std::move(progress);
        }
        return detail::finish(
            igh_canopen_set_boot_callback(raw(), detail::bus::on_boot, bus_.get()));
    }

    // Waiting calls: they run the cycle. Not on an attached master.

    /** Waits until all mandatory nodes are booted. */
    outcome<> wait_booted(std::chrono::milliseconds timeout)
    {
        return wait(igh_canopen_wait_booted_timeout, timeout);
    }
    outcome<> configure_csp(std::chrono::milliseconds timeout)
    {
        return wait(igh_cia402_configure_csp_all_timeout, timeout);
    }
    outcome<> request_actual_positions(std::chrono::milliseconds timeout)
    {
        return wait(igh_cia402_request_actual_position_all_timeout, timeout);
    }
    outcome<> enable(std::chrono::milliseconds timeout)
    {
        return wait(igh_cia402_enable_all_timeout, timeout);
    }
    /** Configures and enables all axes. */
    outcome<> start_up(std::chrono::milliseconds timeout)
    {
        return wait(igh_cia402_start_up_timeout, timeout);
    }
    outcome<> finish(std::chrono::milliseconds timeout)
    {
        return wait(igh_cia402_finish_all_timeout, timeout);
    }
    outcome<> recover(std::chrono::milliseconds timeout)
    {
        return wait(igh_cia402_recover_all_timeout, timeout);
    }
    outcome<> stop(std::chrono::milliseconds timeout)
    {
        return wait(igh_cia402_stop_all_timeout, timeout);
    }
    /** Brings all axes to rest and disables their drives; does not call the function of stop_waiting_when. */
    outcome<> shutdown(std::chrono::milliseconds timeout)
    {
        return wait(igh_cia402_shutdown_timeout, timeout);
    }

    // The cycle, real-time safe.

    /** Evaluates the received frames of the running cycle, after port::begin_cycle(). */
    status process_received() noexcept { return status(igh_cia402_process_rx(raw())); }
    /** Sends the targets, before cycle::end(). */
    status send_targets() noexcept { return status(igh_cia402_send_targets_all(raw())); }
    /** As send_targets(), moving every CSP axis by its target step. */
    status send_target_step() noexcept { return status(igh_cia402_send_target_step(raw())); }
    status stop_together() noexcept { return status(igh_cia402_stop_together(raw())); }
    status stop() noexcept { return status(igh_cia402_stop_all(raw())); }
    status begin_shutdown() noexcept { return status(igh_cia402_begin_shutdown(raw())); }
    bool shutdown_is_done() const noexcept { return igh_cia402_shutdown_is_done(raw()) == 1; }
    bool all_running() const noexcept { return igh_cia402_all_running(raw()) == 1; }
    bool all_stopped() const noexcept { return igh_cia402_all_stopped(raw()) == 1; }
    igh_cia402_send_summary_t send_summary() const noexcept
    {
        igh_cia402_send_summary_t summary = {};
        // it stays zero without axes
        detail::ignore(igh_cia402_get_send_summary(raw(), &summary));
        return summary;
    }

    /** The C context; a null pointer after a move. */
    igh_cia402_context_t *raw() const noexcept { return detail::axes_of(bus_); }

private:
    explicit axes(detail::bus_ptr bus) noexcept : bus_(std::move(bus)) {}

    outcome<> wait(int (*call)(igh_cia402_context_t *, std::uint32_t),
                   std::chrono::milliseconds timeout)
    {
        return detail::waited(bus_, call(raw(), detail::ms_of(timeout)));
    }

    detail::bus_ptr bus_;
};

} // namespace ECAN_LITE_STYLE
} // namespace ecan

#endif
