/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/** ECAN-Lite host SDK for C++17: times of the bus. */
#ifndef ECAN_LITE_TIMES_HPP
#define ECAN_LITE_TIMES_HPP

#include <chrono>
#include <cstdint>
#include <limits>

#include "error.hpp"

namespace ecan {

/** Clock of the EtherCAT library: CLOCK_MONOTONIC, or the clock of a simulation. master::now() reads it. */
struct bus_clock {
    using duration = std::chrono::nanoseconds;
    using rep = duration::rep;
    using period = duration::period;
    using time_point = std::chrono::time_point<bus_clock, duration>;
    static constexpr bool is_steady = true;
};

/** A time of the bus. */
using bus_time = bus_clock::time_point;

inline namespace ECAN_LITE_STYLE {
namespace detail {

/** A duration as a number of the C interface: rounded up, and limited to its range. */
template <class Unit, class Duration>
constexpr std::uint32_t count_of(Duration duration) noexcept
{
    constexpr auto most = std::numeric_limits<std::uint32_t>::max();
    if (duration <= Duration::zero()) {
        return 0;
    }
    // before the conversion, which overflows for long durations
    if (duration > std::chrono::duration_cast<Duration>(Unit(most))) {
        return most;
    }
    return static_cast<std::uint32_t>(std::chrono::ceil<Unit>(duration).count());
}

constexpr std::uint32_t ms_of(std::chrono::milliseconds duration) noexcept
{
    return count_of<std::chrono::milliseconds>(duration);
}

inline bus_time time_of(std::uint64_t ns) noexcept
{
    return bus_time(std::chrono::nanoseconds(static_cast<std::int64_t>(ns)));
}

} // namespace detail
} // namespace ECAN_LITE_STYLE
} // namespace ecan

#endif
