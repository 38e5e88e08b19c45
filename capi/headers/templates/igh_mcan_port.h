/**
 * ECAN-Lite host SDK: the MCAN Port (manual 15.1, 15.4, 15.5).
 *
 * CAN and CAN FD frames through ECAN-Lite gateways.
 *
 * The rules for all functions stand at the head of igh_ecan_common.h.
 *
 * Change log
 *
 *   0.1.0  First version.
 */
#ifndef @GUARD@
#define @GUARD@

#include "igh_adapter.h"
#include "igh_ecan_common.h"
#include "igh_mcan_pdo.h"

#ifdef __cplusplus
extern "C" {
#endif

@SECTIONS@
#ifdef __cplusplus
}
#endif

#endif /* @GUARD@ */
