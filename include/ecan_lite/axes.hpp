/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/** ECAN-Lite host SDK for C++17: CiA 402 axes. */
#ifndef ECAN_LITE_AXES_HPP
#define ECAN_LITE_AXES_HPP

#include <vector>

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
    status set_target_radians(double radians) noexcept
    {
        return status(igh_cia402_set_target_radians(context_, index_, radians));
    }
    /** Step per target of axes::send_target_step(). */
    status set_target_step(std::int32_t steps) noexcept
    {
        return status(igh_cia402_set_target_step(context_, index_, steps));
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

    axes(axes &&other) noexcept = default;
    axes &operator=(axes &&other) noexcept
    {
        axes old(std::move(other));
        std::swap(bus_, old.bus_);
        return *this;
    }
    ~axes()
    {
        if (bus_) {
            detail::ignore(igh_cia402_context_deinit(&bus_->axes));
            bus_->progress = nullptr;
        }
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

    // Waiting calls: they run the cycle. Not on an attached master.

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
