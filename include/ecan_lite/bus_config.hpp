/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/** ECAN-Lite host SDK for C++17: configuration of a bus, its gateways and their channels. */
#ifndef ECAN_LITE_BUS_CONFIG_HPP
#define ECAN_LITE_BUS_CONFIG_HPP

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>

#include "../igh_mcan_port.h"
#include "../igh_sim.h"
#include "error.hpp"
#include "frame.hpp"
#include "span.hpp"
#include "times.hpp"

namespace ecan {
inline namespace ECAN_LITE_STYLE {

/**
 * Configuration of a bus. A value: copies are independent, and a move copies.
 *
 * The setters return the object. The first one that fails is kept: failure_of() shows it, and check(),
 * master::open() and port::open() report it.
 */
class bus_config {
public:
    /** One gateway with N = 3, a cycle of 10 ms, without channels. */
    bus_config() : data_(std::make_unique<data>())
    {
        note(ecan_igh_default_config(&data_->master));
        note(igh_mcan_port_default_config(&data_->port));
    }
    bus_config(const bus_config &other) : data_(std::make_unique<data>(*other.data_)) {}
    bus_config &operator=(const bus_config &other)
    {
        *data_ = *other.data_;
        return *this;
    }

    /** Reads a configuration file (docs/TOOL.md). The message of a failure has all faults by line. */
    static outcome<bus_config> load(const std::string &path)
    {
        return read(igh_mcan_port_load_config, path);
    }

    /** Reads the text of a configuration file. */
    static outcome<bus_config> parse(const std::string &text)
    {
        return read(igh_mcan_port_parse_config, text);
    }

    /** EtherCAT library: empty for the installed one, a path, "sim", "sim:FILE.toml". Default: ECAN_ECRT. */
    bus_config &set_ecrt(const std::string &setting)
    {
        return note(ecan_igh_config_set_ecrt(&data_->master, setting.c_str()));
    }
    /** Scenario of a plain "sim": "echo", "drives". */
    bus_config &suggest_scenario(const std::string &name)
    {
        return note(ecan_igh_config_suggest_scenario(&data_->master, name.c_str()));
    }
    /** Lets simulated time pass only in waits: a run takes no longer than its computation. */
    bus_config &set_stepped_clock(bool is_stepped = true)
    {
        return note(ecan_igh_config_set_stepped_clock(&data_->master, is_stepped));
    }
    bus_config &set_seed(std::uint64_t seed)
    {
        return note(ecan_igh_config_set_seed(&data_->master, seed));
    }
    bus_config &set_master_index(std::uint32_t index)
    {
        return note(ecan_igh_config_set_master_index(&data_->master, index));
    }
    /** Number of gateways. */
    bus_config &set_slave_count(std::size_t count)
    {
        return note(ecan_igh_config_set_slave_count(&data_->master, count));
    }
    /** Alias and position of a gateway. */
    bus_config &set_position(std::size_t slave, std::uint16_t alias, std::uint16_t position)
    {
        return note(ecan_igh_config_set_slave_position(&data_->master, slave, alias, position));
    }
    bus_config &set_identity(std::size_t slave, std::uint32_t vendor_id, std::uint32_t product_code)
    {
        return note(
            ecan_igh_config_set_slave_identity(&data_->master, slave, vendor_id, product_code));
    }
    bus_config &set_cycle(std::chrono::microseconds cycle)
    {
        return note(ecan_igh_config_set_cycle_us(&data_->master, us(cycle)));
    }
    /** Process data watchdog of the gateways. */
    bus_config &set_watchdog(std::chrono::microseconds watchdog)
    {
        return note(ecan_igh_config_set_watchdog_us(&data_->master, us(watchdog)));
    }
    /** Time that the slaves may take to PREOP. */
    bus_config &set_preop_timeout(std::chrono::milliseconds timeout)
    {
        return note(ecan_igh_config_set_preop_timeout_ms(&data_->master, detail::ms_of(timeout)));
    }
    /** N of all gateways: chunks of 128 bytes in each direction. */
    bus_config &set_pdo_multiplier(std::uint32_t n)
    {
        return note(ecan_igh_config_set_pdo_multiplier(&data_->master, n));
    }
    bus_config &set_pdo_multipliers(std::size_t slave, std::uint32_t rx_n, std::uint32_t tx_n)
    {
        return note(
            ecan_igh_config_set_slave_pdo_multipliers(&data_->master, slave, rx_n, tx_n));
    }
    /** Accepts N from 12 on, for masters that segment process data. */
    bus_config &allow_large_pdos(bool is_allowed = true)
    {
        return note(ecan_igh_config_allow_large_pdos(&data_->master, is_allowed));
    }
    /** Distributed clocks with Sync0. */
    bus_config &set_dc_sync0(std::chrono::microseconds cycle, std::chrono::microseconds shift)
    {
        return note(ecan_igh_config_set_dc_sync0(&data_->master, us(cycle), us(shift)));
    }
    /** Sync0 with the shift of the plan. */
    bus_config &set_dc_sync0_planned(std::chrono::microseconds cycle)
    {
        return note(ecan_igh_config_set_dc_sync0_planned(&data_->master, us(cycle)));
    }
    /** An SDO that the master writes at each startup of the gateway: a number, little endian. */
    template <class Number>
    bus_config &add_startup_sdo(std::size_t slave, std::uint16_t index, std::uint8_t subindex,
                                Number value)
    {
        static_assert(std::is_integral_v<Number>, "an object of this size is an integer");
        std::uint8_t bytes[sizeof(Number)];
        auto rest = static_cast<std::uint64_t>(value);
        for (auto &byte : bytes) {
            byte = static_cast<std::uint8_t>(rest & 0xFF);
            rest >>= 8;
        }
        return note(ecan_igh_config_add_startup_sdo(&data_->master, slave, index, subindex, bytes,
                                                    sizeof(bytes)));
    }
    /** A readback in the startup of the gateway: an object that must have this value. */
    bus_config &add_startup_readback(std::size_t slave, std::uint16_t index, std::uint8_t subindex,
                                     std::uint32_t value)
    {
        return note(ecan_igh_config_add_startup_readback(&data_->master, slave, index, subindex,
                                                         value));
    }
    /**
     * An entry of a configuration object (manual 13.2 to 13.4, 13.7): 0x8000, 0x8001..0x8004, 0x8010 and
     * 0x8011, 0x8020, 0x8021..0x8024, 0x8030, 0xB000:03.
     */
    bus_config &set_object(std::size_t slave, std::uint16_t index, std::uint8_t subindex,
                           std::uint32_t value)
    {
        return note(igh_mcan_port_set_gateway_object(&data_->port, slave, index, subindex, value));
    }
    /** Permits diagnostic tests (0x8030) and the application bypass. */
    bus_config &allow_diagnostic_tests(std::size_t slave, bool is_allowed = true)
    {
        return note(igh_mcan_port_allow_diagnostic_tests(&data_->port, slave, is_allowed));
    }

    /** A classic CAN channel. */
    bus_config &set_classic_channel(channel_address at, std::uint32_t bitrate)
    {
        data_->has_channels = true;
        return note(
            igh_mcan_port_set_classic_channel(&data_->port, at.slave, at.channel, bitrate));
    }
    /** A CAN FD channel. */
    bus_config &set_canfd_channel(channel_address at, std::uint32_t nominal, std::uint32_t data_rate)
    {
        data_->has_channels = true;
        return note(igh_mcan_port_set_canfd_channel(&data_->port, at.slave, at.channel, nominal,
                                                    data_rate));
    }
    /** Expected frames per cycle, from which the budgets of the gateway are set. */
    bus_config &set_traffic(channel_address at, std::uint8_t received, std::uint8_t sent)
    {
        return note(
            igh_mcan_port_set_traffic(&data_->port, at.slave, at.channel, received, sent));
    }

    /** The failure of the first setter that failed, if any. */
    const std::optional<failure> &failure_of() const noexcept { return data_->fault; }

    /** Checks the configuration as a whole. The message of a failure names every fault. */
    outcome<> check() const
    {
        if (data_->fault) {
            return detail::failed(*data_->fault);
        }
        if (!data_->has_channels) {
            return detail::finish(ecan_igh_check_config(&data_->master));
        }
        return detail::finish(igh_mcan_port_check_config(&data_->master, &data_->port));
    }

    /** Returns whether a channel is configured, so that a Port can be opened. */
    bool has_channels() const noexcept { return data_->has_channels; }
    /** The C configurations, for functions that have no method here. */
    ecan_igh_config_t &raw_master() noexcept { return data_->master; }
    const ecan_igh_config_t &raw_master() const noexcept { return data_->master; }
    igh_mcan_port_config_t &raw_port() noexcept { return data_->port; }
    const igh_mcan_port_config_t &raw_port() const noexcept { return data_->port; }

private:
    struct data {
        ecan_igh_config_t master;
        igh_mcan_port_config_t port;
        std::optional<failure> fault;
        bool has_channels = false;
    };

    static std::uint32_t us(std::chrono::microseconds duration) noexcept
    {
        return detail::count_of<std::chrono::microseconds>(duration);
    }

    template <class Read>
    static outcome<bus_config> read(Read function, const std::string &source)
    {
        bus_config config;
        config.data_->has_channels = true;
        std::size_t count = 0;
        const int code = function(&config.data_->master, &config.data_->port, source.c_str(),
                                  nullptr, 0, &count);
        return detail::finish_with(code, config);
    }

    bus_config &note(int code)
    {
        if (code != ECAN_OK && !data_->fault) {
            data_->fault = failure::last(code);
        }
        return *this;
    }

    std::unique_ptr<data> data_;
};

} // namespace ECAN_LITE_STYLE
} // namespace ecan

#endif
