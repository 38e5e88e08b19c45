//! Bit rates of slcan commands.

/// Clock of the SJA1000's time quanta in Lawicel's adapters, Hz: 16 MHz divided by two.
const QUANTA_CLOCK: u32 = 8_000_000;

/// Tolerance of a bit rate in thousandths: commands have rounded rates.
const TOLERANCE_PERMILLE: u32 = 5;

/// Bit rate in a client's command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct NamedRate {
    rate: u32,
    /// Meaning of the same command for other clients.
    or: Option<u32>,
}

impl NamedRate {
    /// Rate in bit/s.
    pub(super) const fn exactly(rate: u32) -> Self {
        Self { rate, or: None }
    }

    /// Returns whether the command may mean this bit rate.
    pub(super) fn fits(self, real: u32) -> bool {
        let is_near = |named: u32| {
            u64::from(named.abs_diff(real)) * 1000
                <= u64::from(named) * u64::from(TOLERANCE_PERMILLE)
        };
        is_near(self.rate) || self.or.is_some_and(is_near)
    }
}

/// `Sn`: arbitration phase. 7 is 800 kbit/s for Lawicel and most clients and 750 kbit/s for
/// python-can; 9 is an extension of python-can and some adapters.
pub(super) fn standard(code: u8) -> Option<NamedRate> {
    let rates =
        [10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000, 83_300];
    let rate = rates.get(usize::from(code)).copied()?;
    Some(NamedRate { rate, or: (code == 7).then_some(750_000) })
}

/// `Yn`: data phase, of CANable 2 and its successors.
pub(super) fn data(code: u8) -> Option<u32> {
    matches!(code, 1 | 2 | 4 | 5 | 8).then(|| u32::from(code) * 1_000_000)
}

/// `sxxyy`: bus timing registers of an SJA1000.
pub(super) fn of_registers(btr0: u8, btr1: u8) -> u32 {
    let prescaler = u32::from(btr0 & 0x3F) + 1;
    let before_sample = u32::from(btr1 & 0x0F) + 1;
    let after_sample = u32::from(btr1 >> 4 & 0x07) + 1;
    QUANTA_CLOCK / (prescaler * (1 + before_sample + after_sample))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lawicel_register_values_give_standard_rates() {
        // The table of the CAN232 manual.
        let table = [
            (0x31, 0x1C, 10_000),
            (0x18, 0x1C, 20_000),
            (0x09, 0x1C, 50_000),
            (0x04, 0x1C, 100_000),
            (0x03, 0x1C, 125_000),
            (0x01, 0x1C, 250_000),
            (0x00, 0x1C, 500_000),
            (0x00, 0x16, 800_000),
            (0x00, 0x14, 1_000_000),
        ];
        for (btr0, btr1, rate) in table {
            assert_eq!(of_registers(btr0, btr1), rate, "{btr0:#04X} {btr1:#04X}");
        }
    }

    #[test]
    fn codes_match_rates_that_clients_mean() {
        let fits = |code, rate| standard(code).unwrap().fits(rate);
        assert!(fits(7, 800_000) && fits(7, 750_000) && !fits(7, 775_000));
        assert!(fits(9, 83_333) && fits(9, 83_300) && !fits(9, 100_000));
        assert!(fits(6, 497_500) && !fits(6, 497_499) && !fits(6, 250_000));
        assert!(!fits(6, 0) && !fits(8, u32::MAX));
    }

    #[test]
    fn codes_without_rate_are_none() {
        let rate = |code| standard(code).map(|it| it.rate);
        assert_eq!((rate(6), rate(8), rate(10)), (Some(500_000), Some(1_000_000), None));
        assert_eq!(
            (data(2), data(5), data(0), data(3)),
            (Some(2_000_000), Some(5_000_000), None, None)
        );
    }
}
