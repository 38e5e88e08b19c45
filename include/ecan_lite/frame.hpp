/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/** ECAN-Lite host SDK for C++17: addresses and CAN frames. */
#ifndef ECAN_LITE_FRAME_HPP
#define ECAN_LITE_FRAME_HPP

#include <cstddef>
#include <cstdint>

#include "../igh_mcan_pdo.h"
#include "span.hpp"

namespace ecan {

/** A CAN channel: the index of its gateway, and the channel there, 0 to 3. */
struct channel_address {
    std::size_t slave = 0;
    std::uint8_t channel = 0;
};

constexpr bool operator==(channel_address left, channel_address right) noexcept
{
    return left.slave == right.slave && left.channel == right.channel;
}
constexpr bool operator!=(channel_address left, channel_address right) noexcept
{
    return !(left == right);
}

/** A CAN ID of 11 or 29 bits. */
class can_id {
public:
    /** An ID of 11 bits; a larger one is rejected when the frame is sent. */
    static constexpr can_id standard(std::uint32_t value) noexcept { return {value, false}; }
    /** An ID of 29 bits. */
    static constexpr can_id extended(std::uint32_t value) noexcept { return {value, true}; }

    constexpr std::uint32_t value() const noexcept { return value_; }
    constexpr bool is_extended() const noexcept { return is_extended_; }
    /** The flag of the C functions: IGH_MCAN_FLAG_EXT or 0. */
    constexpr std::uint8_t flag() const noexcept
    {
        return is_extended_ ? std::uint8_t{IGH_MCAN_FLAG_EXT} : std::uint8_t{0};
    }

private:
    constexpr can_id(std::uint32_t value, bool is_extended) noexcept
        : value_(value), is_extended_(is_extended)
    {
    }
    std::uint32_t value_;
    bool is_extended_;
};

constexpr bool operator==(can_id left, can_id right) noexcept
{
    return left.value() == right.value() && left.is_extended() == right.is_extended();
}
constexpr bool operator!=(can_id left, can_id right) noexcept { return !(left == right); }

/** A received CAN frame or the result of a transmission. Valid during the call that passes it. */
class received_frame {
public:
    explicit received_frame(const igh_mcan_rx_frame_t &raw) noexcept : raw_(&raw) {}

    channel_address address() const noexcept { return {raw_->slave, raw_->channel}; }
    can_id id() const noexcept
    {
        return has(IGH_MCAN_FLAG_EXT) ? can_id::extended(raw_->can_id)
                                      : can_id::standard(raw_->can_id);
    }
    /** Data; empty for a remote frame. */
    span<const std::uint8_t> data() const noexcept
    {
        return {raw_->data, is_remote() ? std::size_t{0} : std::size_t{raw_->len}};
    }
    /** Returns whether this is a CAN frame of the bus. */
    bool is_frame() const noexcept { return raw_->kind == IGH_MCAN_RX_FRAME; }
    /** Returns whether this is the result of a transmission (manual 10). */
    bool is_tx_result() const noexcept { return raw_->kind == IGH_MCAN_RX_TX_RESULT; }
    bool is_fd() const noexcept { return has(IGH_MCAN_FLAG_FD); }
    bool is_remote() const noexcept { return has(IGH_MCAN_FLAG_RTR); }
    /** All fields, also those of a result. */
    const igh_mcan_rx_frame_t &raw() const noexcept { return *raw_; }

private:
    bool has(int flag) const noexcept { return (raw_->flags & flag) != 0; }
    const igh_mcan_rx_frame_t *raw_;
};

/** Options of a CAN FD frame. */
struct fd_options {
    /** The data phase has the data bit rate (BRS). */
    bool bit_rate_switch = true;
    /** The error state indicator (ESI). */
    bool error_state = false;
};

} // namespace ecan

#endif
