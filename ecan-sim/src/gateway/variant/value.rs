//! Values of switches in scenario files.

/// A type that a switch can have.
pub(crate) trait VariantValue: Sized {
    fn read(value: &toml::Value) -> Option<Self>;

    /// The permitted values, for messages.
    fn allowed() -> String;
}

pub(super) fn read<T: VariantValue>(key: &str, value: &toml::Value) -> Result<T, String> {
    T::read(value).ok_or_else(|| {
        format!("`{key}` = {value} is not an alternative; allowed: {}", T::allowed())
    })
}
