/**
 * ECAN-Lite host SDK: the process data protocol (manual 5 to 12).
 *
 * Writes frames into images and takes them out again. Knows no EtherCAT master: libecan_mcan_host
 * has it alone, libecan_igh_host among everything else. With igh_mcan_port.h it is not needed; it
 * is for applications that exchange raw process data (manual 15.5.3).
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
