/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/**
 * ECAN-Lite host SDK: the built-in simulator.
 *
 * Scenario, clock and seed of a simulated bus. Not necessary to use one.
 *
 * igh_ecan_common.h has the rules for all functions.
 *
 * Change log
 *
 *   0.2.0  First version, from igh_adapter.h.
 */
#ifndef IGH_SIM_H
#define IGH_SIM_H

#include "igh_adapter.h"
#include "igh_ecan_common.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---------------------------------------------------------------------------
 * Simulated bus
 *
 * The setting "sim" of ecan_igh_config_set_ecrt(), or of the environment variable ECAN_ECRT, selects
 * the built-in simulator. The settings have no effect on a real bus.
 * --------------------------------------------------------------------------- */

/**
 * Suggests the scenario for a plain "sim": "echo" (the default) or "drives".
 *
 * @usage   not rt, any thread, before init
 * @return  ECAN_OK, ECAN_ERR_ARGUMENT, ECAN_ERR_BUFFER.
 */
int ecan_igh_config_suggest_scenario(ecan_igh_config_t *config, const char *name);

/**
 * Selects the clock of a simulated master, unless its scenario does. A real library ignores it.
 *
 * @param stepped  0: wall-clock time, the default. Else: time passes only while the program waits
 *                 for the next cycle, as fast as the machine allows; same seed, same result.
 *
 * @usage   not rt, any thread, before init
 */
int ecan_igh_config_set_stepped_clock(ecan_igh_config_t *config, int stepped);

/**
 * Sets the seed of a simulation, in place of the scenario's.
 *
 * @usage   not rt, any thread, before init
 */
int ecan_igh_config_set_seed(ecan_igh_config_t *config, uint64_t seed);

/**
 * Returns 1 if the bus is simulated.
 *
 * @usage   rt, the cycle's thread, after init
 * @return  1 or 0; 0 after an error, which ecan_last_error_code() gives.
 */
int ecan_igh_is_simulated(ecan_igh_context_t *context);

/**
 * Returns 1 if time passes only while the program waits for the next cycle: in a simulation with a
 * stepped clock. The program must then take its own deadlines from ecan_igh_now_ns().
 *
 * @usage   rt, the cycle's thread, after init
 * @return  1 or 0; 0 after an error, which ecan_last_error_code() gives.
 */
int ecan_igh_clock_is_stepped(ecan_igh_context_t *context);

#ifdef __cplusplus
}
#endif

#endif /* IGH_SIM_H */
