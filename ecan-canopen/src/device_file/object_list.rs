//! Lists of the objects of a device (CiA 306-1, 6.6.3.1).

use crate::object;

/// Lists, the mandatory objects first.
pub(super) const LISTS: [&str; 3] = ["MandatoryObjects", "OptionalObjects", "ManufacturerObjects"];
/// Objects that each device has (CiA 301, 7.5.1).
pub(super) const MANDATORY: [u16; 3] =
    [object::DEVICE_TYPE, object::ERROR_REGISTER, object::IDENTITY];

/// The list to which an object belongs.
pub(super) fn list_of(index: u16) -> &'static str {
    let [mandatory, optional, manufacturer] = LISTS;
    match index {
        index if MANDATORY.contains(&index) => mandatory,
        0x2000..=0x5FFF => manufacturer,
        _ => optional,
    }
}
