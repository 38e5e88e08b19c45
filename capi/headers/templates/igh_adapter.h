/**
 * ECAN-Lite host SDK: the Adapter (manual 15.1, 15.5).
 *
 * Master, slaves, one domain for each, startup SDOs, distributed clocks, the cycle and raw process
 * data.
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

#ifdef __cplusplus
extern "C" {
#endif

@SECTIONS@
#ifdef __cplusplus
}
#endif

#endif /* @GUARD@ */
