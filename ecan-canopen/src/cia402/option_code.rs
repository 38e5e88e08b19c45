//! Option codes: how a drive stops (CiA 402-2, 8.4.3 and 9).

/// Defines an option code: named values, everything else kept as a number.
macro_rules! option_code {
    (
        $(#[$meta:meta])*
        $name:ident { $( $(#[$variant_meta:meta])* $variant:ident = $value:literal, )+ }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum $name {
            $( $(#[$variant_meta])* $variant, )+
            /// Another value, mostly of the manufacturer.
            Other(i16),
        }

        impl $name {
            /// The number.
            #[must_use]
            pub const fn raw(self) -> i16 {
                match self {
                    $( Self::$variant => $value, )+
                    Self::Other(raw) => raw,
                }
            }

            /// The option with this number.
            #[must_use]
            pub const fn from_raw(raw: i16) -> Self {
                match raw {
                    $( $value => Self::$variant, )+
                    other => Self::Other(other),
                }
            }
        }
    };
}

option_code! {
    /// Quick stop option code, 0x605A.
    QuickStopOption {
        /// Power off, the motor coasts.
        Disable = 0,
        /// Slow down on the profile deceleration, then power off.
        SlowDown = 1,
        /// Slow down on the quick stop deceleration, then power off.
        QuickStop = 2,
        /// Slow down on the current limit, then power off.
        CurrentLimit = 3,
        /// Slow down on the voltage limit, then power off.
        VoltageLimit = 4,
        /// Slow down on the profile deceleration and stay in quick stop active.
        SlowDownAndStay = 5,
        /// Slow down on the quick stop deceleration and stay in quick stop active.
        QuickStopAndStay = 6,
        /// Slow down on the current limit and stay in quick stop active.
        CurrentLimitAndStay = 7,
        /// Slow down on the voltage limit and stay in quick stop active.
        VoltageLimitAndStay = 8,
    }
}

option_code! {
    /// Shutdown and disable operation option codes, 0x605B and 0x605C.
    StopOption {
        /// Power off, the motor coasts.
        Disable = 0,
        /// Slow down on the profile deceleration, then power off.
        SlowDown = 1,
    }
}

option_code! {
    /// Halt option code, 0x605D.
    HaltOption {
        /// Slow down on the profile deceleration and stay enabled.
        SlowDown = 1,
        /// Slow down on the quick stop deceleration and stay enabled.
        QuickStop = 2,
        /// Slow down on the current limit and stay enabled.
        CurrentLimit = 3,
        /// Slow down on the voltage limit and stay enabled.
        VoltageLimit = 4,
    }
}

option_code! {
    /// Fault reaction option code, 0x605E.
    FaultReaction {
        /// Power off, the motor coasts.
        Disable = 0,
        /// Slow down on the profile deceleration.
        SlowDown = 1,
        /// Slow down on the quick stop deceleration.
        QuickStop = 2,
        /// Slow down on the current limit.
        CurrentLimit = 3,
        /// Slow down on the voltage limit.
        VoltageLimit = 4,
    }
}

option_code! {
    /// What a drive does when the host's heartbeat is missing, 0x6007.
    NodeLossReaction {
        /// Nothing.
        None = 0,
        /// Goes to fault.
        Fault = 1,
        /// Disables voltage.
        DisableVoltage = 2,
        /// Quick stop.
        QuickStop = 3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_back() {
        for raw in -3..=10 {
            assert_eq!(QuickStopOption::from_raw(raw).raw(), raw);
            assert_eq!(StopOption::from_raw(raw).raw(), raw);
            assert_eq!(HaltOption::from_raw(raw).raw(), raw);
            assert_eq!(FaultReaction::from_raw(raw).raw(), raw);
            assert_eq!(NodeLossReaction::from_raw(raw).raw(), raw);
        }
        assert_eq!(QuickStopOption::from_raw(6), QuickStopOption::QuickStopAndStay);
    }
}
