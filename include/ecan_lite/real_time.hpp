/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/** ECAN-Lite host SDK for C++17: the real-time thread and the timing of its cycles. */
#ifndef ECAN_LITE_REAL_TIME_HPP
#define ECAN_LITE_REAL_TIME_HPP

#include "../igh_real_time.h"
#include "master.hpp"

namespace ecan {
inline namespace ECAN_LITE_STYLE {

/** Requests of the cycle's thread: nothing, and all fields of ecan_igh_real_time_t by `->`. */
class real_time_settings {
public:
    real_time_settings() noexcept { detail::ignore(ecan_igh_default_real_time(&raw_)); }

    ecan_igh_real_time_t *operator->() noexcept { return &raw_; }
    const ecan_igh_real_time_t &raw() const noexcept { return raw_; }

private:
    ecan_igh_real_time_t raw_ = {};
};

/**
 * Applies the requests to the calling thread. Returns the report: what was granted, and what was denied
 * with the remedy.
 */
inline outcome<std::string> apply_real_time(const real_time_settings &settings)
{
    std::string report(4096, '\0');
    std::size_t needed = 0;
    const int code =
        ecan_igh_apply_real_time(&settings.raw(), report.data(), report.size(), &needed);
    report.resize(needed > 0 && needed <= report.size() ? needed - 1 : 0);
    return detail::finish_with(code, std::move(report));
}

/** Final spin before each deadline, and catching up after an overrun instead of skipping. */
inline outcome<> set_cycle_timing(master &of, std::chrono::microseconds spin, bool catches_up)
{
    return detail::finish(ecan_igh_set_cycle_timing(
        of.raw(), detail::count_of<std::chrono::microseconds>(spin), catches_up));
}

/** Starts the statistics of the cycle. Allocates. */
inline outcome<> measure_cycles(master &of)
{
    return detail::finish(ecan_igh_measure_cycles(of.raw()));
}

/** Statistics since measure_cycles(). Not for the cycle. */
inline outcome<ecan_igh_cycle_statistics_t> cycle_statistics(const master &of)
{
    ecan_igh_cycle_statistics_t statistics = {};
    const int code = ecan_igh_get_cycle_statistics(of.raw(), &statistics);
    return detail::finish_with(code, statistics);
}

/** The same as text, as the programs print it. */
inline outcome<std::string> cycle_statistics_text(const master &of)
{
    return detail::text_of([&](char *text, std::size_t size, std::size_t *needed) {
        return ecan_igh_get_cycle_statistics_text(of.raw(), text, size, needed);
    });
}

} // namespace ECAN_LITE_STYLE
} // namespace ecan

#endif
