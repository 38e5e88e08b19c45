//! Option codes: how a drive stops (CiA 402-2, 8.4.3 and 9).

ecan_protocol::open_enum! {
    /// Quick stop option code, 0x605A.
    pub enum QuickStopOption: i16 else Other;
    /// Power off, the motor coasts.
    Disable = 0;
    /// Slow down on the profile deceleration, then power off.
    SlowDown = 1;
    /// Slow down on the quick stop deceleration, then power off.
    QuickStop = 2;
    /// Slow down on the current limit, then power off.
    CurrentLimit = 3;
    /// Slow down on the voltage limit, then power off.
    VoltageLimit = 4;
    /// Slow down on the profile deceleration and stay in quick stop active.
    SlowDownAndStay = 5;
    /// Slow down on the quick stop deceleration and stay in quick stop active.
    QuickStopAndStay = 6;
    /// Slow down on the current limit and stay in quick stop active.
    CurrentLimitAndStay = 7;
    /// Slow down on the voltage limit and stay in quick stop active.
    VoltageLimitAndStay = 8;
}

ecan_protocol::open_enum! {
    /// Shutdown and disable operation option codes, 0x605B and 0x605C.
    pub enum StopOption: i16 else Other;
    /// Power off, the motor coasts.
    Disable = 0;
    /// Slow down on the profile deceleration, then power off.
    SlowDown = 1;
}

ecan_protocol::open_enum! {
    /// Halt option code, 0x605D.
    pub enum HaltOption: i16 else Other;
    /// Slow down on the profile deceleration and stay enabled.
    SlowDown = 1;
    /// Slow down on the quick stop deceleration and stay enabled.
    QuickStop = 2;
    /// Slow down on the current limit and stay enabled.
    CurrentLimit = 3;
    /// Slow down on the voltage limit and stay enabled.
    VoltageLimit = 4;
}

ecan_protocol::open_enum! {
    /// Fault reaction option code, 0x605E.
    pub enum FaultReaction: i16 else Other;
    /// Power off, the motor coasts.
    Disable = 0;
    /// Slow down on the profile deceleration.
    SlowDown = 1;
    /// Slow down on the quick stop deceleration.
    QuickStop = 2;
    /// Slow down on the current limit.
    CurrentLimit = 3;
    /// Slow down on the voltage limit.
    VoltageLimit = 4;
}

ecan_protocol::open_enum! {
    /// Reaction of a drive to a missing heartbeat of the host, 0x6007.
    pub enum NodeLossReaction: i16 else Other;
    /// Nothing.
    None = 0;
    /// Goes to fault.
    Fault = 1;
    /// Disables voltage.
    DisableVoltage = 2;
    /// Quick stop.
    QuickStop = 3;
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
