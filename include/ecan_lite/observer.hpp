/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/** ECAN-Lite host SDK for C++17: snapshots of the cycle, and commands to it, from other threads. */
#ifndef ECAN_LITE_OBSERVER_HPP
#define ECAN_LITE_OBSERVER_HPP

#include "../igh_observer.h"
#include "axes.hpp"

namespace ecan {
inline namespace ECAN_LITE_STYLE {

/** A command that the next cycle executes: its status, and its number, 0 if it was rejected. */
struct command {
    status given;
    std::uint64_t ticket = 0;
};

/**
 * A handle of another thread to the cycle (igh_observer.h). The cycle never waits for it. One thread reads
 * through an observer; any thread and signal handler may give commands. It may outlive the master.
 */
class observer {
public:
    /**
     * Creates an observer.
     *
     * @usage not rt, the cycle's thread
     * @return As ecan_igh_observer_init().
     */
    static outcome<observer> open(const master &of)
    {
        auto context = std::make_unique<ecan_igh_observer_t>();
        const int code = ecan_igh_observer_init(context.get(), of.raw());
        return detail::finish_with(code, observer(code == ECAN_OK ? std::move(context) : nullptr));
    }

    observer(observer &&other) noexcept = default;
    observer &operator=(observer &&other) noexcept
    {
        observer old(std::move(other));
        std::swap(context_, old.context_);
        return *this;
    }
    ~observer()
    {
        if (context_) {
            detail::ignore(ecan_igh_observer_deinit(context_.get()));
        }
    }

    /**
     * Copies the snapshot of the last cycle, which all getters then read.
     *
     * @return errc::not_ready before the first cycle; errc::order if the master has ended.
     */
    status update() noexcept { return status(ecan_igh_observer_update(raw())); }

    /** Number and times of the cycle; empty before the first update(). */
    std::optional<ecan_igh_observed_cycle_t> cycle() const noexcept
    {
        ecan_igh_observed_cycle_t cycle = {};
        return known(ecan_igh_observer_get_cycle(raw(), &cycle), cycle);
    }
    /** State of an axis at the end of the cycle; empty if the cycle did not serve it. */
    std::optional<axis_state> axis(std::size_t index) const noexcept
    {
        igh_cia402_axis_state_t state = {};
        const int code = igh_cia402_observer_get_axis_state(raw(), index, &state);
        return known(code, axis_state(state));
    }
    /** Exchange with a slave; empty if the cycle did not run it. */
    std::optional<ecan_igh_domain_report_t> domain_report(std::size_t slave) const noexcept
    {
        ecan_igh_domain_report_t report = {};
        return known(ecan_igh_observer_get_domain_report(raw(), slave, &report), report);
    }
    /** Session of a gateway; empty without a Port. */
    std::optional<igh_mcan_session_t> session(std::size_t slave) const noexcept
    {
        const int session = igh_mcan_observer_get_session(raw(), slave);
        return session < 0 ? std::nullopt
                           : std::optional(static_cast<igh_mcan_session_t>(session));
    }
    /** Counters of a gateway; empty without a Port. */
    std::optional<igh_mcan_statistics_t> statistics(std::size_t slave) const noexcept
    {
        igh_mcan_statistics_t statistics = {};
        return known(igh_mcan_observer_get_statistics(raw(), slave, &statistics), statistics);
    }
    /** Counters of a channel; empty without a Port. */
    std::optional<igh_mcan_channel_statistics_t> statistics(channel_address at) const noexcept
    {
        igh_mcan_channel_statistics_t statistics = {};
        const int code =
            igh_mcan_observer_get_channel_statistics(raw(), at.slave, at.channel, &statistics);
        return known(code, statistics);
    }
    /** State of a channel; empty without a Port. */
    std::optional<igh_mcan_channel_status_t> channel_status(channel_address at) const noexcept
    {
        igh_mcan_channel_status_t channel = {};
        const int code =
            igh_mcan_observer_get_channel_status(raw(), at.slave, at.channel, &channel);
        return known(code, channel);
    }
    /**
     * Returns whether the cycle of the snapshot or an earlier one has executed a command; never for one
     * that was rejected. axis() reports the effect of a quick stop.
     */
    bool has_executed(const command &of) const noexcept
    {
        return of.given.ok() && ecan_igh_observer_has_executed(raw(), of.ticket) == 1;
    }

    // Commands, also in signal handlers.

    /** Requests the application to stop: waiting calls end, and master::is_stop_requested() is true. */
    command request_stop() noexcept
    {
        std::uint64_t ticket = 0;
        const status given(ecan_igh_observer_request_stop(raw(), &ticket));
        return {given, ticket};
    }
    /** Commands a quick stop to an axis. */
    command quick_stop(std::size_t axis) noexcept
    {
        std::uint64_t ticket = 0;
        const status given(igh_cia402_observer_quick_stop(raw(), axis, &ticket));
        return {given, ticket};
    }
    /** Commands a quick stop to all axes. */
    command quick_stop_all() noexcept { return quick_stop(std::size_t{IGH_CIA402_ALL_AXES}); }

    /** The C handle; a null pointer after a move. */
    ecan_igh_observer_t *raw() const noexcept { return context_.get(); }

private:
    explicit observer(std::unique_ptr<ecan_igh_observer_t> context) noexcept
        : context_(std::move(context))
    {
    }

    template <class T>
    static std::optional<T> known(int code, const T &value) noexcept
    {
        return code == ECAN_OK ? std::optional<T>(value) : std::nullopt;
    }

    std::unique_ptr<ecan_igh_observer_t> context_;
};

} // namespace ECAN_LITE_STYLE
} // namespace ecan

#endif
