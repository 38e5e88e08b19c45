/**
 * @TITLE@
 *
@INTRO@ *
 * The rules for all functions, and the change log of all headers, stand at the head of
 * igh_ecan_common.h.
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
