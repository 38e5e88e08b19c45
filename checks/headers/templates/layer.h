@LICENSE@/**
 * @TITLE@
 *
@INTRO@ *
 * igh_ecan_common.h has the rules for all functions.
 *
 * Change log
 *
@CHANGES@ */
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
