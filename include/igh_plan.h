/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/**
 * ECAN-Lite host SDK: the plan of configurations before the first run.
 *
 * Load of wire, CAN buses, images and mailboxes, with warnings and errors, without a bus.
 *
 * igh_ecan_common.h has the rules for all functions.
 *
 * Change log
 *
 *   0.2.0  First version, from igh_mcan_port.h and igh_cia402_protocol.h. Added: `needed` of
 *          igh_mcan_port_plan() and igh_cia402_plan().
 *          Structs that the library fills end with reserved fields, which are 0; reserved fields of
 *          structs that the application fills must be 0.
 */
#ifndef IGH_PLAN_H
#define IGH_PLAN_H

#include "igh_cia402_protocol.h"
#include "igh_mcan_port.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---------------------------------------------------------------------------
 * Preflight plan
 *
 * Load of configurations on wire, CAN buses, images and mailboxes, with warnings and errors,
 * before anything touches a bus.
 * --------------------------------------------------------------------------- */

/** Route of the frames of a plan. */
typedef enum {
    /** From the host through the gateway to the bus. */
    IGH_MCAN_ROUTE_TO_BUS = 0,
    /** From the bus through the gateway to the host. */
    IGH_MCAN_ROUTE_FROM_BUS = 1,
    /** Between other nodes: only bus time counts. */
    IGH_MCAN_ROUTE_ON_BUS_ONLY = 2
} igh_mcan_frame_route_t;

/** Frames of one kind on one channel, for a plan. */
typedef struct {
    /**
     * One of them, filled by igh_mcan_tx_frame_set_can() or a similar function; slave, channel,
     * kind of CAN ID, flags, length and schedule are relevant.
     */
    igh_mcan_tx_frame_t frame;
    /** Number of frames ... */
    uint32_t frames;
    /** ... in this number of cycles; 0 counts as 1. More than one frame needs 1. */
    uint32_t cycles;
    /** An igh_mcan_frame_route_t. */
    uint8_t route;
    /** Must be 0; for fields of later versions. */
    uint8_t reserved[23];
} igh_mcan_frame_stream_t;

/**
 * Plans configurations for a given traffic.
 *
 * @param streams  The frames; may be NULL if count is 0.
 * @param text     Gets the plan as a table with its warnings, also if the plan has errors; see the
 *                 rules for texts in igh_ecan_common.h. 4096 bytes are enough for a few gateways.
 *
 * @usage   not rt, any thread, any time
 * @return  ECAN_OK, also with warnings; ECAN_ERR_CONFIG if the plan has errors, all of them in
 *          ecan_last_error(); ECAN_ERR_ARGUMENT, ECAN_ERR_FRAME for a stream; ECAN_ERR_BUFFER.
 */
ECAN_MUST_CHECK
int igh_mcan_port_plan(const ecan_igh_config_t *igh_config,
                       const igh_mcan_port_config_t *config,
                       const igh_mcan_frame_stream_t *streams,
                       size_t count,
                       char *text,
                       size_t size,
                       size_t *needed);

/* ---------------------------------------------------------------------------
 * Preflight plan of axes
 * --------------------------------------------------------------------------- */

/**
 * Plans configurations for the process data of axes: targets, TPDOs and SYNC. As
 * igh_mcan_port_plan().
 *
 * @param motion_div  Cycles from target to target; 0 counts as 1.
 *
 * @usage   not rt, any thread, any time
 * @return  As igh_mcan_port_plan(); ECAN_ERR_NOT_INITIALISED also for an axis that is not filled,
 *          ECAN_ERR_CONFIG also for a value out of range.
 */
ECAN_MUST_CHECK
int igh_cia402_plan(const ecan_igh_config_t *igh_config,
                    const igh_mcan_port_config_t *config,
                    const igh_cia402_axis_t *axes,
                    size_t axis_count,
                    uint32_t motion_div,
                    char *text,
                    size_t size,
                    size_t *needed);

#ifdef __cplusplus
}
#endif

#endif /* IGH_PLAN_H */
