//! Contexts of C, as the attribute `export` enters them.

use ecan_c_boundary::Call;
use ecan_c_boundary::result::ecan_result_t;

use crate::guard::Access;
use crate::handle::{self, Entered, Kind, Pooled, Words};

pub(crate) trait Context: Sized {
    /// The object that it names.
    type Object: Pooled;
    const KIND: Kind;
    /// The layer that calls with this context work on.
    type Layer<'a>;

    /// Returns false for a context that outlived its part of the object.
    fn is_current(_: &Entered<Self::Object>) -> bool {
        true
    }

    fn layer(
        call: Call,
        object: &mut Entered<Self::Object>,
    ) -> Result<Self::Layer<'_>, ecan_result_t>;
}

/// Enters the object that a context names.
///
/// # Safety
/// `context` is NULL or valid for reading, with any content.
#[inline(always)]
pub(crate) unsafe fn enter<C: Context>(
    call: Call,
    context: *const C,
    access: Access,
) -> Result<Entered<C::Object>, ecan_result_t> {
    const { assert!(size_of::<Words>() == size_of::<C>()) };
    // SAFETY: the caller's promise.
    let object = unsafe { handle::enter(call, context.cast(), C::KIND, access)? };
    if !C::is_current(&object) {
        return Err(handle::not_initialised(call, C::KIND));
    }
    Ok(object)
}

/// The layer that calls with a context work on.
#[inline(always)]
pub(crate) fn layer_of<C: Context>(
    _: *const C,
    call: Call,
    object: &mut Entered<C::Object>,
) -> Result<C::Layer<'_>, ecan_result_t> {
    C::layer(call, object)
}

/// Enters the object that a context names, if any.
///
/// # Safety
/// As for [`enter`].
pub(crate) unsafe fn enter_to_end<C: Context>(
    call: Call,
    context: *const C,
) -> Result<Option<Entered<C::Object>>, ecan_result_t> {
    // SAFETY: the caller's promise.
    let object = unsafe { handle::enter_to_end(call, context.cast(), C::KIND)? };
    Ok(object.filter(C::is_current))
}
