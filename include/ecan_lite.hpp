/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/**
 * ECAN-Lite host SDK for C++17: header-only, on top of the C interface.
 *
 *     ecan::bus_config config;
 *     config.set_cycle(1ms).set_classic_channel({0, 0}, 1'000'000);
 *     auto master = ecan::master::open(config);
 *     auto port = ecan::port::open(master, config);
 *     master.wait_op(10s);
 *     for (;;) {
 *         auto cycle = port.next_cycle();
 *         cycle.for_each_received([](const ecan::received_frame &frame) { ... });
 *         cycle.send({0, 0}, ecan::can_id::standard(0x123), data);
 *     }
 *
 * Rules for all classes:
 *
 * - The classes own the C contexts and keep them at one address: objects may be moved, not copied. A
 *   Port, its cycle or axes keep the master open, so that the order of destruction does not matter. Functions of a
 *   moved-from object return errc::null_pointer.
 * - Errors outside the cycle: an outcome. It is an exception of type ecan::error by default; with
 *   ECAN_LITE_NO_EXCEPTIONS defined (or without exceptions in the compiler) functions return an
 *   ecan::result instead. All files of a program that exchange objects use the same style.
 * - Errors in the cycle: an ecan::status in both styles. Functions of the cycle are noexcept and do not
 *   allocate; ecan::check() makes an outcome of a status.
 * - Exceptions of callbacks end the wait that called them, and are thrown again by it.
 * - Threads are those of the C functions, which the C headers describe; raw() gives the C context for
 *   functions that have no method here.
 * - Times are std::chrono durations; those below the resolution of the C function are rounded up.
 *
 * Change log
 *
 *   0.2.0  First version.
 */
#ifndef ECAN_LITE_HPP
#define ECAN_LITE_HPP

#include "ecan_lite/axes.hpp"
#include "ecan_lite/bus_config.hpp"
#include "ecan_lite/diagnostics.hpp"
#include "ecan_lite/error.hpp"
#include "ecan_lite/frame.hpp"
#include "ecan_lite/master.hpp"
#include "ecan_lite/nodes.hpp"
#include "ecan_lite/observer.hpp"
#include "ecan_lite/port.hpp"
#include "ecan_lite/real_time.hpp"
#include "ecan_lite/span.hpp"

#endif
