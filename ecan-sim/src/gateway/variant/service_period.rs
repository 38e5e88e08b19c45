use super::VariantValue;

/// Period of a free-running service loop, or none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServicePeriod(Option<u16>);

impl ServicePeriod {
    /// A service follows each SM2 write.
    pub const AFTER_OUTPUTS: Self = Self(None);

    /// A free-running loop; `None` if the period is not 50 to 1000 us.
    #[must_use]
    pub fn free_running(period_us: u16) -> Option<Self> {
        (50..=1000).contains(&period_us).then_some(Self(Some(period_us)))
    }

    pub(crate) fn ns(self) -> Option<u64> {
        self.0.map(|us| u64::from(us) * 1_000)
    }
}

impl VariantValue for ServicePeriod {
    fn read(value: &toml::Value) -> Option<Self> {
        match u16::try_from(value.as_integer()?).ok()? {
            0 => Some(Self::AFTER_OUTPUTS),
            period_us => Self::free_running(period_us),
        }
    }

    fn allowed() -> String {
        "0 and 50 to 1000".to_owned()
    }
}
