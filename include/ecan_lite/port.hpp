/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/** ECAN-Lite host SDK for C++17: CAN frames through the gateways. */
#ifndef ECAN_LITE_PORT_HPP
#define ECAN_LITE_PORT_HPP

#include <utility>

#include "frame.hpp"
#include "master.hpp"

namespace ecan {
inline namespace ECAN_LITE_STYLE {

class port;

namespace detail {
/** The contexts of a Port. */
bus_ptr bus_of(const port &on) noexcept;
} // namespace detail

/**
 * One cycle of a Port: from the received images to the images to send. Its functions are real-time safe.
 * The destructor ends the cycle, also after an exception; end() does so with a status. It keeps the
 * master open like the Port.
 */
class cycle {
public:
    cycle(cycle &&other) noexcept = default;
    cycle(const cycle &) = delete;
    cycle &operator=(const cycle &) = delete;
    cycle &operator=(cycle &&) = delete;
    ~cycle()
    {
        if (bus_) {
            detail::ignore(igh_mcan_port_cycle_end(&bus_->port));
        }
    }

    /** Status of the begin of the cycle: a call of the master that failed. The cycle may continue. */
    status began() const noexcept { return began_; }

    /** Passes every received frame and result of a transmission that was not taken in this cycle. */
    template <class Function>
    status for_each_received(Function function)
    {
        igh_mcan_rx_frame_t frames[BATCH];
        for (;;) {
            std::size_t count = 0;
            const status received(igh_mcan_port_receive(raw(), frames, BATCH, &count));
            for (std::size_t i = 0; i < count; i++) {
                function(received_frame(frames[i]));
            }
            if (!received || count < BATCH) {
                return received;
            }
        }
    }

    /** Stores received frames in `frames`; returns the status and those that were stored. */
    std::pair<status, span<igh_mcan_rx_frame_t>> receive(span<igh_mcan_rx_frame_t> frames) noexcept
    {
        std::size_t count = 0;
        const status received(igh_mcan_port_receive(raw(), frames.data(), frames.size(), &count));
        return {received, frames.first(count)};
    }

    /** Sends a classic CAN frame of up to 8 bytes. A status that is_temporary() allows another attempt. */
    status send(channel_address at, can_id id, span<const std::uint8_t> data) noexcept
    {
        return status(igh_mcan_port_send_can(raw(), at.slave, at.channel, id.value(), id.flag(),
                                             data.data(), data.size()));
    }

    /** Sends a CAN FD frame of up to 64 bytes. */
    status send_fd(channel_address at, can_id id, span<const std::uint8_t> data,
                   fd_options options = {}) noexcept
    {
        const int flags = id.flag() | (options.bit_rate_switch ? IGH_MCAN_FLAG_BRS : 0) |
                          (options.error_state ? IGH_MCAN_FLAG_ESI : 0);
        return status(igh_mcan_port_send_canfd(raw(), at.slave, at.channel, id.value(),
                                               static_cast<std::uint8_t>(flags), data.data(),
                                               data.size()));
    }

    /** Sends a classic CAN frame at a phase of the next Sync0 period (manual 8.4). */
    status schedule(channel_address at, can_id id, span<const std::uint8_t> data,
                    std::chrono::nanoseconds offset, std::uint16_t tag) noexcept
    {
        return status(igh_mcan_port_schedule_can(
            raw(), at.slave, at.channel, id.value(), id.flag(), data.data(), data.size(),
            detail::count_of<std::chrono::nanoseconds>(offset), tag));
    }

    /** Sends a frame of the C interface. */
    status send(const igh_mcan_tx_frame_t &frame) noexcept
    {
        return status(igh_mcan_port_send(raw(), &frame));
    }

    /** Ends the cycle: completes the images and sends them. */
    status end() noexcept
    {
        const detail::bus_ptr bus = std::move(bus_);
        return status(igh_mcan_port_cycle_end(detail::port_of(bus)));
    }

private:
    friend class port;
    static constexpr std::size_t BATCH = 16;

    cycle(detail::bus_ptr bus, status began) noexcept : bus_(std::move(bus)), began_(began) {}

    igh_mcan_port_t *raw() const noexcept { return detail::port_of(bus_); }

    detail::bus_ptr bus_;
    status began_;
};

/** The CAN channels of the gateways of a master (igh_mcan_port.h). A master has one Port. */
class port {
public:
    /**
     * Opens the Port on a master that was opened with the same configuration and is not active yet.
     *
     * @usage not rt, the cycle's thread
     * @return As igh_mcan_port_init().
     */
    static outcome<port> open(master &on, const bus_config &config)
    {
        const int code = igh_mcan_port_init(detail::port_of(on.bus_), on.raw(), &config.raw_port());
        return detail::finish_with(code, port(code == ECAN_OK ? on.bus_ : nullptr));
    }

    /**
     * Opens what a configuration file describes, and waits until frames can be sent.
     *
     * @usage not rt, the cycle's thread
     * @return As ecan_open().
     */
    static outcome<port> open_file(const std::string &path)
    {
        const detail::bus_ptr bus = std::make_shared<detail::bus>();
        const int code = ecan_open(&bus->master, &bus->port, path.c_str());
        return detail::finish_with(code, port(code == ECAN_OK ? bus : nullptr));
    }

    port(port &&other) noexcept = default;
    port &operator=(port &&other) noexcept
    {
        port old(std::move(other));
        std::swap(bus_, old.bus_);
        return *this;
    }
    ~port()
    {
        if (bus_) {
            detail::ignore(igh_mcan_port_deinit(&bus_->port));
        }
    }

    /** Sleeps until the next cycle. Together with begin_cycle() it is next_cycle(). */
    status wait_next_cycle() noexcept { return status(igh_mcan_port_wait_next_cycle(raw())); }
    /** Begins a cycle without waiting: for an own period, and after the receive of the owner. */
    cycle begin_cycle() noexcept { return {bus_, status(igh_mcan_port_cycle_begin(raw()))}; }
    /** Waits for the next cycle and begins it. */
    cycle next_cycle() noexcept
    {
        wait_next_cycle().ignore();
        return begin_cycle();
    }

    /** Returns whether every gateway is verified, so that frames can be sent. Real-time safe. */
    bool is_ready() const noexcept { return igh_mcan_port_is_ready(raw()) == 1; }

    /** Text of the session of a gateway: the step that it waits for, the fault of its verification. */
    outcome<std::string> session_text(std::size_t slave) const
    {
        return detail::text_of([&](char *text, std::size_t size, std::size_t *needed) {
            return igh_mcan_port_get_session_text(raw(), slave, text, size, needed);
        });
    }
    /** Passes each change of a gateway or channel that was not told yet, as a line (igh_mcan_port_next_change()). */
    template <class Function>
    void for_each_change(Function function)
    {
        char text[256];
        while (igh_mcan_port_next_change(raw(), text, sizeof(text), nullptr) == ECAN_OK &&
               text[0] != '\0') {
            function(static_cast<const char *>(text));
        }
    }
    /** As igh_mcan_port_check_delivery(). Real-time safe. */
    status check_delivery() const noexcept
    {
        return status(igh_mcan_port_check_delivery(raw()));
    }
    /** Counters of a gateway. Real-time safe. */
    status get_statistics(std::size_t slave, igh_mcan_statistics_t &statistics) const noexcept
    {
        return status(igh_mcan_port_get_statistics(raw(), slave, &statistics));
    }
    /** Counters of a channel. Real-time safe. */
    status get_statistics(channel_address at, igh_mcan_channel_statistics_t &statistics) const noexcept
    {
        return status(
            igh_mcan_port_get_channel_statistics(raw(), at.slave, at.channel, &statistics));
    }
    /** State of a channel: error counters, bus-off, pending frames. Real-time safe. */
    status get_channel_status(channel_address at, igh_mcan_channel_status_t &channel) const noexcept
    {
        return status(igh_mcan_port_get_channel_status(raw(), at.slave, at.channel, &channel));
    }

    /** The C context; a null pointer after a move. */
    igh_mcan_port_t *raw() const noexcept { return detail::port_of(bus_); }

private:
    friend class axes;
    friend detail::bus_ptr detail::bus_of(const port &on) noexcept;

    explicit port(detail::bus_ptr bus) noexcept : bus_(std::move(bus)) {}

    detail::bus_ptr bus_;
};

namespace detail {
inline bus_ptr bus_of(const port &on) noexcept
{
    return on.bus_;
}
} // namespace detail

} // namespace ECAN_LITE_STYLE
} // namespace ecan

#endif
