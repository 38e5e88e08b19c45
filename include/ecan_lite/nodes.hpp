/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/** ECAN-Lite host SDK for C++17: CANopen nodes and LSS. */
#ifndef ECAN_LITE_NODES_HPP
#define ECAN_LITE_NODES_HPP

#include <algorithm>
#include <vector>

#include "../igh_canopen.h"
#include "port.hpp"

namespace ecan {
inline namespace ECAN_LITE_STYLE {

/** Progress of the boot-up of a node: all fields of igh_canopen_boot_progress_t by `->`. */
class boot_progress {
public:
    explicit boot_progress(const igh_canopen_boot_progress_t &raw) noexcept : raw_(raw) {}

    const igh_canopen_boot_progress_t *operator->() const noexcept { return &raw_; }
    igh_canopen_boot_phase_t phase() const noexcept
    {
        return static_cast<igh_canopen_boot_phase_t>(raw_.phase);
    }
    bool is_booted() const noexcept { return raw_.phase == IGH_CANOPEN_BOOT_PHASE_BOOTED; }
    bool has_failed() const noexcept { return raw_.phase == IGH_CANOPEN_BOOT_PHASE_FAILED; }
    /** Error status of CiA 302-2, 'A' to 'O'; '\0' while there is none. */
    char status() const noexcept { return static_cast<char>(raw_.status); }

private:
    igh_canopen_boot_progress_t raw_;
};

/** One node of the network of an axes object. A handle to copy, valid as long as that object. */
class node {
public:
    std::size_t index() const noexcept { return index_; }

    /** State of the node; empty if there is no such node. Real-time safe. */
    std::optional<igh_canopen_node_state_t> state() const noexcept
    {
        igh_canopen_node_state_t state = {};
        if (igh_canopen_get_node_state(raw(), index_, &state) != ECAN_OK) {
            return std::nullopt;
        }
        return state;
    }
    /** Progress of its boot-up; empty if there is no such node. Real-time safe. */
    std::optional<boot_progress> progress() const noexcept
    {
        igh_canopen_boot_progress_t progress = {};
        if (igh_canopen_get_boot_progress(raw(), index_, &progress) != ECAN_OK) {
            return std::nullopt;
        }
        return boot_progress(progress);
    }
    /** Text of its boot-up, with the cause of a failure. Not for the cycle. */
    outcome<std::string> boot_text() const
    {
        return detail::text_of([&](char *text, std::size_t size, std::size_t *needed) {
            return igh_canopen_get_boot_text(raw(), index_, text, size, needed);
        });
    }

    // Commands, real-time safe.

    status send_nmt(igh_canopen_nmt_t command) noexcept
    {
        return status(igh_canopen_send_nmt(raw(), index_, command));
    }
    status boot_again() noexcept { return status(igh_canopen_boot_again(raw(), index_)); }

    // Waiting calls: they run the cycle. Not on an attached master.

    /**
     * Guards the node in place of its heartbeat, with a time of at most 65535 ms; `life_time_factor` 0 with
     * a time of 0 ends it.
     */
    outcome<> set_guarding(std::chrono::milliseconds guard_time, std::uint8_t life_time_factor,
                           std::chrono::milliseconds timeout)
    {
        const auto ms = std::min<std::uint32_t>(detail::ms_of(guard_time), UINT16_MAX);
        return waited(igh_canopen_set_guarding(raw(), index_, static_cast<std::uint16_t>(ms),
                                               life_time_factor, detail::ms_of(timeout)));
    }
    /** Stores the parameters of a group, an igh_canopen_parameters_t or a subindex of the manufacturer. */
    outcome<> store_parameters(std::uint8_t group, std::chrono::milliseconds timeout)
    {
        return waited(igh_canopen_store_parameters(raw(), index_, group, detail::ms_of(timeout)));
    }
    /** Restores the defaults of a group; they become valid with the next reset. */
    outcome<> restore_parameters(std::uint8_t group, std::chrono::milliseconds timeout)
    {
        return waited(igh_canopen_restore_parameters(raw(), index_, group, detail::ms_of(timeout)));
    }
    /** Reads the error history 0x1003, newest entry first. */
    outcome<std::vector<igh_canopen_history_entry_t>> error_history(std::chrono::milliseconds timeout)
    {
        std::vector<igh_canopen_history_entry_t> entries(IGH_CANOPEN_MAX_HISTORY);
        std::size_t count = 0;
        const int code = igh_canopen_read_error_history(raw(), index_, entries.data(),
                                                        entries.size(), &count,
                                                        detail::ms_of(timeout));
        entries.resize(count < entries.size() ? count : entries.size());
        if (bus_ != nullptr) {
            bus_->throw_pending();
        }
        return detail::finish_with(code, std::move(entries));
    }
    outcome<> clear_error_history(std::chrono::milliseconds timeout)
    {
        return waited(igh_canopen_clear_error_history(raw(), index_, detail::ms_of(timeout)));
    }

private:
    friend class axes;
    node(detail::bus *bus, std::size_t index) noexcept : bus_(bus), index_(index) {}

    igh_cia402_context_t *raw() const noexcept { return bus_ != nullptr ? &bus_->axes : nullptr; }
    outcome<> waited(int code) { return bus_ != nullptr ? bus_->waited(code) : detail::finish(code); }

    detail::bus *bus_;
    std::size_t index_;
};

/** An LSS command: the defaults for a service, and all fields of igh_canopen_lss_command_t by `->`. */
class lss_command {
public:
    explicit lss_command(igh_canopen_lss_service_t service) noexcept
    {
        // an enumerator is always a service
        detail::ignore(igh_canopen_lss_init(&raw_, static_cast<std::uint8_t>(service)));
    }

    igh_canopen_lss_command_t *operator->() noexcept { return &raw_; }
    const igh_canopen_lss_command_t &raw() const noexcept { return raw_; }

private:
    igh_canopen_lss_command_t raw_ = {};
};

/**
 * Executes an LSS command on a channel and waits, with axes on the Port at their last targets.
 *
 * @usage not rt, the cycle's thread, active bus
 * @return As igh_canopen_lss().
 */
inline outcome<igh_canopen_lss_result_t> lss(port &on, channel_address at, const lss_command &command,
                                             std::chrono::milliseconds timeout)
{
    igh_canopen_lss_result_t result = {};
    const int code = igh_canopen_lss(on.raw(), at.slave, at.channel, &command.raw(), &result,
                                     detail::ms_of(timeout));
    if (const auto bus = detail::bus_of(on)) {
        bus->throw_pending();
    }
    return detail::finish_with(code, std::move(result));
}

} // namespace ECAN_LITE_STYLE
} // namespace ecan

#endif
