/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/** ECAN-Lite host SDK for C++17: the EtherCAT master with its gateways. */
#ifndef ECAN_LITE_MASTER_HPP
#define ECAN_LITE_MASTER_HPP

#include <cstring>

#include "bus.hpp"
#include "bus_config.hpp"
#include "times.hpp"

namespace ecan {
inline namespace ECAN_LITE_STYLE {

/**
 * A master with its gateways (igh_adapter.h). Its destruction, with that of Port and axes on it, releases
 * the bus.
 */
class master {
public:
    /**
     * Opens the master: checks the configuration, reserves the master, identifies the gateways and
     * registers their startup.
     *
     * @param stop As the function of stop_waiting_when(), from now on: also while the bus is scanned.
     * @usage not rt, any thread
     * @return As ecan_igh_init().
     */
    static outcome<master> open(const bus_config &config, std::function<bool()> stop = {})
    {
        return make(config, std::move(stop),
                    [](ecan_igh_context_t *context, const ecan_igh_config_t *applied) {
                        return ecan_igh_init(context, applied);
                    });
    }

    /**
     * Adds gateways to a master that the application owns, before ecrt_master_activate().
     *
     * @param owned The owner's ec_master_t. The result and all that is made of it must be destroyed
     *              before the owner deactivates or releases the master.
     * @usage not rt, the owner's thread
     * @return As ecan_igh_attach().
     */
    static outcome<master> attach(const bus_config &config, void *owned)
    {
        return make(config, {},
                    [owned](ecan_igh_context_t *context, const ecan_igh_config_t *applied) {
                        return ecan_igh_attach(context, applied, owned);
                    });
    }

    /** Reports that the owner has activated the master. */
    outcome<> owner_activated() { return detail::finish(ecan_igh_owner_activated(raw())); }

    /** Starts cyclic operation without waiting for OP. */
    outcome<> activate() { return detail::finish(ecan_igh_activate(raw())); }

    /**
     * Starts cyclic operation and runs the cycle until every gateway is in OP, with a Port until it is
     * ready.
     *
     * @usage not rt, the cycle's thread
     */
    outcome<> wait_op(std::chrono::milliseconds timeout)
    {
        return detail::waited(bus_, ecan_igh_wait_op_timeout(raw(), detail::ms_of(timeout)));
    }
    /** As wait_op() with a sufficient timeout. */
    outcome<> wait_op() { return wait_op(startup_timeout()); }

    /** A sufficient timeout of wait_op(). */
    std::chrono::milliseconds startup_timeout() const noexcept
    {
        return std::chrono::milliseconds(ecan_igh_startup_timeout_ms(raw()));
    }

    /**
     * Sets a function that waiting calls of all layers call in each cycle. If it returns true, they end
     * with errc::stopped; if it throws, they end and throw the same exception.
     *
     * @param stop An empty function for none. It may only call functions of the SDK that any thread may
     *             call.
     */
    outcome<> stop_waiting_when(std::function<bool()> stop)
    {
        if (!bus_) {
            return detail::finish(ecan_igh_stop_waiting_when(nullptr, nullptr, nullptr));
        }
        bus_->stop = std::move(stop);
        return outcome<>();
    }

    /** Returns whether an observer has requested the application to stop. Real-time safe. */
    bool is_stop_requested() const noexcept { return ecan_igh_is_stop_requested(raw()) == 1; }
    /** Withdraws the request, so that waiting calls wait again. */
    outcome<> clear_stop_request() { return detail::finish(ecan_igh_clear_stop_request(raw())); }

    /** Requests another startup of gateways whose startup failed. */
    outcome<> retry_startup() { return detail::finish(ecan_igh_retry_startup(raw())); }

    // The cycle without a Port.

    /** Sleeps until the next cycle. */
    status wait_next_cycle() noexcept { return status(ecan_igh_wait_next_cycle(raw())); }
    status receive() noexcept { return status(ecan_igh_receive(raw())); }
    status send() noexcept { return status(ecan_igh_send(raw())); }
    /** The image that the gateway gets, valid until the next reconfiguration. */
    outcome<span<std::uint8_t>> rxpdo(std::size_t slave)
    {
        std::uint8_t *data = nullptr;
        std::size_t size = 0;
        const int code = ecan_igh_get_rxpdo_buffer(raw(), slave, &data, &size);
        return detail::finish_with(code, span<std::uint8_t>(data, size));
    }
    /** The image of the gateway. */
    outcome<span<const std::uint8_t>> txpdo(std::size_t slave)
    {
        const std::uint8_t *data = nullptr;
        std::size_t size = 0;
        const int code = ecan_igh_get_txpdo_buffer(raw(), slave, &data, &size);
        return detail::finish_with(code, span<const std::uint8_t>(data, size));
    }

    // State, real-time safe.

    /** The time of the bus; steps only in waits if clock_is_stepped(). */
    bus_time now() const noexcept { return detail::time_of(ecan_igh_now_ns(raw())); }
    /** The time of the running cycle on the grid of deadlines. */
    bus_time cycle_time() const noexcept { return detail::time_of(ecan_igh_cycle_time_ns(raw())); }
    bool is_operational() const noexcept { return ecan_igh_is_operational(raw()) == 1; }
    /** Returns whether every gateway was exchanged in the last cycle, by the working counter. */
    bool domain_is_complete() const noexcept { return ecan_igh_domain_is_complete(raw()) == 1; }
    bool is_simulated() const noexcept { return ecan_igh_is_simulated(raw()) == 1; }
    bool clock_is_stepped() const noexcept { return ecan_igh_clock_is_stepped(raw()) == 1; }
    std::size_t slave_count() const noexcept { return ecan_igh_slave_count(raw()); }

    /** State of the master; not for the cycle. */
    outcome<ecan_igh_master_state_t> state() const
    {
        ecan_igh_master_state_t state = {};
        const int code = ecan_igh_get_master_state(raw(), &state);
        return detail::finish_with(code, state);
    }
    /** Name, identity and state of a gateway; not for the cycle. */
    outcome<ecan_igh_slave_info_t> slave_info(std::size_t slave) const
    {
        ecan_igh_slave_info_t info = {};
        const int code = ecan_igh_get_slave_info(raw(), slave, &info);
        return detail::finish_with(code, info);
    }
    /** Reads an object of a gateway; runs the cycle if the bus is active. Returns the number of bytes. */
    outcome<std::size_t> sdo_upload(std::size_t slave, std::uint16_t index, std::uint8_t subindex,
                                    span<std::uint8_t> data)
    {
        std::size_t length = 0;
        const int code = ecan_igh_sdo_upload(raw(), slave, index, subindex, data.data(),
                                             data.size(), &length);
        return detail::finish_with(code, length);
    }
    /** Writes an object of a gateway; runs the cycle if the bus is active. */
    outcome<> sdo_download(std::size_t slave, std::uint16_t index, std::uint8_t subindex,
                           span<const std::uint8_t> data)
    {
        return detail::finish(ecan_igh_sdo_download(raw(), slave, index, subindex, data.data(),
                                                    data.size()));
    }

    /** The C context; a null pointer after a move. */
    ecan_igh_context_t *raw() const noexcept { return detail::master_of(bus_); }

private:
    friend class port;
    friend class axes;

    explicit master(detail::bus_ptr bus) noexcept : bus_(std::move(bus)) {}

    template <class Open>
    static outcome<master> make(const bus_config &config, std::function<bool()> stop, Open open)
    {
        if (config.failure_of()) {
            return detail::failed_as<master>(*config.failure_of());
        }
        auto bus = std::make_shared<detail::bus>();
        // the startup of the channels is added to a copy
        auto applied = std::make_unique<ecan_igh_config_t>(config.raw_master());
        int code = ECAN_OK;
        if (config.has_channels()) {
            code = igh_mcan_port_apply_config(applied.get(), &config.raw_port());
        }
        bus->stop = std::move(stop);
        if (code == ECAN_OK) {
            code = ecan_igh_config_stop_waiting_when(applied.get(), detail::bus::on_stop, bus.get());
        }
        if (code == ECAN_OK) {
            code = open(&bus->master, applied.get());
        }
        bus->throw_pending();
        return detail::finish_with(code, master(std::move(bus)));
    }

    detail::bus_ptr bus_;
};

} // namespace ECAN_LITE_STYLE
} // namespace ecan

#endif
