//! PDO profiles

use std::ffi::c_int;

use ecan_c_boundary::pointers;
use ecan_c_boundary::profile::igh_mcan_pdo_profile_t;
use ecan_c_export::export;

/// Fills a profile: N chunks of 128 bytes for these channels, all other fields at their defaults.
///
/// @param profile       Is overwritten.
/// @param direction     An igh_mcan_direction_t.
/// @param multiplier    N, 1 to 24.
/// @param channel_mask  Channels, bit 0 for channel 0.
///
/// @usage   rt, any thread, any time
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT or ECAN_ERR_CONFIG.
#[export(call)]
pub fn igh_mcan_pdo_profile_default(
    profile: *mut igh_mcan_pdo_profile_t,
    direction: c_int,
    multiplier: u8,
    channel_mask: u8,
) {
    pointers!(call, out(profile));
    let value = igh_mcan_pdo_profile_t {
        direction: u8::try_from(direction).unwrap_or(u8::MAX),
        multiplier,
        channel_mask,
        encapsulation: 0,
        budget: 0,
        options: 0,
        reserved: [0; 10],
    };
    value.checked(call)?;
    profile.set(value);
}

/// Checks a profile.
///
/// @usage   rt, any thread, any time
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT or ECAN_ERR_CONFIG.
#[must_use]
#[export(call)]
pub fn igh_mcan_pdo_profile_check(profile: *const igh_mcan_pdo_profile_t) {
    pointers!(call, read(profile));
    profile.checked(call).map(|_| ())
}

/// Returns the profile word, as in 0x8010:12 and 0x8011:12 when the profile is active (manual
/// 13.2).
///
/// @usage   rt, any thread, any time
/// @return  The word; 0, which no valid profile has, for a faulty profile or NULL.
#[export(call, or 0)]
pub fn igh_mcan_pdo_profile_word(profile: *const igh_mcan_pdo_profile_t) -> u32 {
    pointers!(call, read(profile));
    Ok(profile.checked(call)?.1.word())
}

/// Returns the layout_id of the image header: the profile word folded to 16 bits (manual 5.4.4.1).
///
/// @usage   rt, any thread, any time
/// @return  The ID; 0 for a faulty profile or NULL.
#[export(call, or 0)]
pub fn igh_mcan_pdo_layout_id(profile: *const igh_mcan_pdo_profile_t) -> u16 {
    pointers!(call, read(profile));
    Ok(profile.checked(call)?.1.layout_id())
}

/// Returns the bytes of an image with a profile: 128 * N.
///
/// @usage   rt, any thread, any time
/// @return  The bytes; 0 for a faulty profile or NULL.
#[export(call, or 0)]
pub fn igh_mcan_pdo_bytes(profile: *const igh_mcan_pdo_profile_t) -> usize {
    pointers!(call, read(profile));
    Ok(profile.checked(call)?.1.pdo_bytes())
}
