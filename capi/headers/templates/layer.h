/**
 * @TITLE@
 *
@INTRO@ *
 * igh_ecan_common.h has the rules for all functions and the change log of all headers.
 */
#ifndef @GUARD@
#define @GUARD@

@INCLUDES@
#ifdef __cplusplus
extern "C" {
#endif

@SECTIONS@
#ifdef __cplusplus
}
#endif

#endif /* @GUARD@ */
