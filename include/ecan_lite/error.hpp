/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/** ECAN-Lite host SDK for C++17: codes, the status of a call in the cycle, results and exceptions. */
#ifndef ECAN_LITE_ERROR_HPP
#define ECAN_LITE_ERROR_HPP

#include <cstdint>
#include <cstdlib>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "../igh_ecan_common.h"

#if !defined(ECAN_LITE_NO_EXCEPTIONS) && !defined(__cpp_exceptions)
#define ECAN_LITE_NO_EXCEPTIONS
#endif

/* The two error styles have different symbols. */
#ifdef ECAN_LITE_NO_EXCEPTIONS
#define ECAN_LITE_STYLE results
#else
#define ECAN_LITE_STYLE exceptions
#include <exception>
#include <stdexcept>
#endif

namespace ecan {

/** Result codes: an ecan_result_t. */
enum class errc : int {
    ok = ECAN_OK,
    null_pointer = ECAN_ERR_NULL,
    argument = ECAN_ERR_ARGUMENT,
    not_initialised = ECAN_ERR_NOT_INITIALISED,
    order = ECAN_ERR_ORDER,
    busy = ECAN_ERR_BUSY,
    buffer = ECAN_ERR_BUFFER,
    full = ECAN_ERR_FULL,
    config = ECAN_ERR_CONFIG,
    slave = ECAN_ERR_SLAVE,
    channel = ECAN_ERR_CHANNEL,
    frame = ECAN_ERR_FRAME,
    not_fd = ECAN_ERR_NOT_FD,
    schedule = ECAN_ERR_SCHEDULE,
    no_room = ECAN_ERR_NO_ROOM,
    queue_full = ECAN_ERR_QUEUE_FULL,
    bus_off = ECAN_ERR_BUS_OFF,
    not_ready = ECAN_ERR_NOT_READY,
    image_busy = ECAN_ERR_IMAGE_BUSY,
    parse = ECAN_ERR_PARSE,
    ecrt = ECAN_ERR_ECRT,
    master = ECAN_ERR_MASTER,
    not_found = ECAN_ERR_NOT_FOUND,
    identity = ECAN_ERR_IDENTITY,
    sdo = ECAN_ERR_SDO,
    readback = ECAN_ERR_READBACK,
    timeout = ECAN_ERR_TIMEOUT,
    not_operational = ECAN_ERR_NOT_OPERATIONAL,
    verification = ECAN_ERR_VERIFICATION,
    attached = ECAN_ERR_ATTACHED,
    axis = ECAN_ERR_AXIS,
    axis_state = ECAN_ERR_AXIS_STATE,
    axes = ECAN_ERR_AXES,
    canopen = ECAN_ERR_CANOPEN,
    stopped = ECAN_ERR_STOPPED,
    privilege = ECAN_ERR_PRIVILEGE,
    file = ECAN_ERR_FILE,
    layout = ECAN_ERR_LAYOUT,
    node = ECAN_ERR_NODE,
    boot = ECAN_ERR_BOOT,
    internal = ECAN_ERR_INTERNAL,
};

/** Text of the last error of this thread; valid until its next call of the SDK. */
inline std::string_view last_error() noexcept
{
    return ecan_last_error();
}

/** Status of a call in the cycle: a result code that must be looked at. */
class [[nodiscard]] status {
public:
    constexpr status() noexcept = default;
    constexpr explicit status(int code) noexcept : code_(code) {}

    /** Returns whether the call succeeded. */
    constexpr bool ok() const noexcept { return code_ == ECAN_OK; }
    constexpr explicit operator bool() const noexcept { return ok(); }
    constexpr errc code() const noexcept { return static_cast<errc>(code_); }
    /** Returns whether a later cycle may succeed, without a change by the application. */
    bool is_temporary() const noexcept { return ecan_result_is_temporary(code_) == 1; }
    /** Name of the code: "ECAN_ERR_NO_ROOM". */
    const char *name() const noexcept { return ecan_result_name(code_); }
    /** Meaning of the code; last_error() has the details until the next call. */
    const char *text() const noexcept { return ecan_result_text(code_); }
    /** Marks a status that the application does not need. */
    constexpr void ignore() const noexcept {}

private:
    int code_ = ECAN_OK;
};

constexpr bool operator==(status left, errc right) noexcept { return left.code() == right; }
constexpr bool operator!=(status left, errc right) noexcept { return left.code() != right; }

/** A failed call: code, text, and the SDO abort code (0 without one). */
struct failure {
    errc code = errc::ok;
    std::uint32_t abort_code = 0;
    std::string message;

    /** The last failure of this thread, with this code. */
    static failure last(int code)
    {
        return {static_cast<errc>(code), ecan_last_abort_code(), ecan_last_error()};
    }
};

/** A value, or the failure of the call. */
template <class T = void>
class [[nodiscard]] result {
public:
    result(T value) : value_(std::move(value)) {}
    result(failure failed) : failure_(std::move(failed)) {}

    bool has_value() const noexcept { return value_.has_value(); }
    explicit operator bool() const noexcept { return has_value(); }
    /** The value; ends the process if there is none. */
    T &value() &
    {
        if (!value_) {
            std::abort();
        }
        return *value_;
    }
    const T &value() const &
    {
        if (!value_) {
            std::abort();
        }
        return *value_;
    }
    T &&value() && { return std::move(value()); }
    T &operator*() & { return value(); }
    const T &operator*() const & { return value(); }
    T &&operator*() && { return std::move(value()); }
    T *operator->() { return &value(); }
    const T *operator->() const { return &value(); }
    /** The failure, if there is no value. */
    const failure &error() const noexcept { return failure_; }

private:
    std::optional<T> value_;
    failure failure_;
};

/** Success, or the failure of the call. */
template <>
class [[nodiscard]] result<void> {
public:
    result() = default;
    result(failure failed) : failure_(std::move(failed)) {}

    bool has_value() const noexcept { return failure_.code == errc::ok; }
    explicit operator bool() const noexcept { return has_value(); }
    const failure &error() const noexcept { return failure_; }
    /** Marks a result that the application does not need. */
    void ignore() const noexcept {}

private:
    failure failure_;
};

inline namespace ECAN_LITE_STYLE {
namespace detail {
/** Takes the code of a call that cannot fail, or whose failure changes nothing. */
constexpr void ignore(int) noexcept {}
} // namespace detail

#ifdef ECAN_LITE_NO_EXCEPTIONS

/** What a function outside the cycle returns in this error style: a result. */
template <class T = void>
using outcome = result<T>;

namespace detail {
[[nodiscard]] inline outcome<> failed(failure cause) { return cause; }
template <class T>
outcome<T> failed_as(failure cause) { return cause; }
} // namespace detail

#else

/** A failed call as an exception. what() is the text of the SDK. */
class error : public std::runtime_error {
public:
    explicit error(const failure &failed)
        : std::runtime_error(failed.message), code_(failed.code), abort_code_(failed.abort_code)
    {
    }

    errc code() const noexcept { return code_; }
    /** SDO abort code; 0 without one. */
    std::uint32_t abort_code() const noexcept { return abort_code_; }
    /** Returns whether a later attempt may succeed, without a change by the application. */
    bool is_temporary() const noexcept
    {
        return ecan_result_is_temporary(static_cast<int>(code_)) == 1;
    }

private:
    errc code_;
    std::uint32_t abort_code_;
};

/** What a function outside the cycle returns in this error style: the value. It throws ecan::error. */
template <class T = void>
using outcome = T;

namespace detail {
[[noreturn]] inline void failed(const failure &cause) { throw error(cause); }
template <class T>
[[noreturn]] T failed_as(const failure &cause) { throw error(cause); }
} // namespace detail

#endif

namespace detail {
/** The outcome of a call without value. */
inline outcome<> finish(int code)
{
    if (code != ECAN_OK) {
        return failed(failure::last(code));
    }
    return outcome<>();
}

/** The outcome of a call that stored a value. */
template <class T>
outcome<T> finish_with(int code, T value)
{
    if (code != ECAN_OK) {
        return failed_as<T>(failure::last(code));
    }
    return outcome<T>(std::move(value));
}
} // namespace detail

/** Makes an outcome of the status of a call that has just returned in this thread. */
inline outcome<> check(status returned)
{
    return detail::finish(static_cast<int>(returned.code()));
}

} // namespace ECAN_LITE_STYLE
} // namespace ecan

#endif
