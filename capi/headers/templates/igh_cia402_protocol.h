/**
 * ECAN-Lite host SDK: CANopen and CiA 402 (manual 15.1, 15.4, 15.5.4).
 *
 * Motors behind the gateways: start-up, targets, states, SDO.
 *
 * The rules for all functions stand at the head of igh_ecan_common.h.
 *
 * Change log
 *
 *   0.1.0  First version.
 */
#ifndef @GUARD@
#define @GUARD@

#include "igh_ecan_common.h"
#include "igh_mcan_port.h"

#ifdef __cplusplus
extern "C" {
#endif

@SECTIONS@
#ifdef __cplusplus
}
#endif

#endif /* @GUARD@ */
