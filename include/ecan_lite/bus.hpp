/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/** ECAN-Lite host SDK for C++17: the C contexts of a bus, and its callbacks. Not for applications. */
#ifndef ECAN_LITE_BUS_HPP
#define ECAN_LITE_BUS_HPP

#include <functional>
#include <memory>
#include <string_view>

#include "../igh_canopen.h"
#include "../igh_cia402_protocol.h"
#include "error.hpp"

namespace ecan {
inline namespace ECAN_LITE_STYLE {
namespace detail {

/** The contexts of one bus at addresses that do not change, shared by master, Port and axes. */
struct bus {
    ecan_igh_context_t master = {};
    igh_mcan_port_t port = {};
    igh_cia402_context_t axes = {};
    std::function<bool()> stop;
    std::function<void(std::size_t, std::string_view)> progress;
    std::function<void(std::size_t, std::string_view)> boot_progress;
#ifndef ECAN_LITE_NO_EXCEPTIONS
    std::exception_ptr pending;
#endif

    bus() = default;
    bus(const bus &) = delete;
    bus &operator=(const bus &) = delete;
    ~bus() { ignore(ecan_igh_deinit(&master)); }

    /** Runs a callback; keeps its exception, which the wait throws when it has ended. */
    template <class Call>
    void guarded(Call call) noexcept
    {
#ifdef ECAN_LITE_NO_EXCEPTIONS
        call();
#else
        try {
            call();
        } catch (...) {
            if (!pending) {
                pending = std::current_exception();
            }
        }
#endif
    }

    bool has_pending() const noexcept
    {
#ifdef ECAN_LITE_NO_EXCEPTIONS
        return false;
#else
        return pending != nullptr;
#endif
    }

    static int on_stop(void *user) noexcept
    {
        auto &self = *static_cast<bus *>(user);
        bool stops = false;
        if (self.stop && !self.has_pending()) {
            self.guarded([&] { stops = self.stop(); });
        }
        return stops || self.has_pending() ? 1 : 0;
    }

    static void on_progress(void *user, std::size_t axis, const char *text) noexcept
    {
        auto &self = *static_cast<bus *>(user);
        if (self.progress && !self.has_pending()) {
            self.guarded([&] { self.progress(axis, text); });
        }
    }

    static void on_boot(void *user, std::size_t node, const char *text) noexcept
    {
        auto &self = *static_cast<bus *>(user);
        if (self.boot_progress && !self.has_pending()) {
            self.guarded([&] { self.boot_progress(node, text); });
        }
    }

    /** Throws the exception of a callback, if there is one. */
    void throw_pending()
    {
#ifndef ECAN_LITE_NO_EXCEPTIONS
        if (pending) {
            std::rethrow_exception(std::exchange(pending, nullptr));
        }
#endif
    }

    /** The outcome of a call that may have called callbacks. */
    outcome<> waited(int code)
    {
        throw_pending();
        return finish(code);
    }
};

using bus_ptr = std::shared_ptr<bus>;

/** The context of a layer; a null pointer, which the C functions report, after a move. */
inline ecan_igh_context_t *master_of(const bus_ptr &bus) noexcept
{
    return bus ? &bus->master : nullptr;
}
inline igh_mcan_port_t *port_of(const bus_ptr &bus) noexcept
{
    return bus ? &bus->port : nullptr;
}
inline igh_cia402_context_t *axes_of(const bus_ptr &bus) noexcept
{
    return bus ? &bus->axes : nullptr;
}

/** The outcome of a waiting call of any layer. */
inline outcome<> waited(const bus_ptr &bus, int code)
{
    return bus ? bus->waited(code) : finish(code);
}

/** The text that a C function stores by (text, size, needed). */
template <class Store>
outcome<std::string> text_of(Store store)
{
    std::size_t needed = 0;
    int code = store(nullptr, std::size_t{0}, &needed);
    std::string text(needed, '\0');
    if (needed > 0) {
        code = store(text.data(), text.size(), &needed);
        text.resize(needed > 0 && needed <= text.size() ? needed - 1 : 0);
    }
    return finish_with(code, std::move(text));
}

} // namespace detail
} // namespace ECAN_LITE_STYLE
} // namespace ecan

#endif
