//! Touch probes: function 0x60B8 and status 0x60B9 (CiA 402-2, 12).

/// A touch probe of a drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Probe {
    /// Touch probe 1.
    One,
    /// Touch probe 2.
    Two,
}

impl Probe {
    /// Both probes.
    pub const ALL: [Self; 2] = [Self::One, Self::Two];

    /// Place of the probe's byte in function and status: 0 or 1.
    pub const fn byte(self) -> usize {
        self as usize
    }
}

/// Signal whose edges a touch probe samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ProbeSource {
    /// The probe's input.
    #[default]
    Input,
    /// The index pulse of the encoder.
    IndexPulse,
}

/// Function of a touch probe, its byte in 0x60B8.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ProbeTrigger {
    /// Signal.
    pub source: ProbeSource,
    /// Samples the position at positive edges.
    pub positive: bool,
    /// Samples the position at negative edges.
    pub negative: bool,
    /// Samples at every edge; otherwise at the first one only.
    pub is_continuous: bool,
}

impl ProbeTrigger {
    /// Samples the first positive edge of a signal.
    pub const fn first_positive(source: ProbeSource) -> Self {
        Self { source, positive: true, negative: false, is_continuous: false }
    }

    /// The byte of the probe, enabled.
    pub const fn byte(self) -> u8 {
        1 | (self.is_continuous as u8) << 1
            | match self.source {
                ProbeSource::Input => 0,
                ProbeSource::IndexPulse => 1 << 2,
            }
            | (self.positive as u8) << 4
            | (self.negative as u8) << 5
    }
}

/// The touch probe status, 0x60B9.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ProbeStatus(pub u16);

impl ProbeStatus {
    const fn bit(self, probe: Probe, bit: usize) -> bool {
        self.0 >> (8 * probe.byte() + bit) & 1 != 0
    }

    /// Returns whether a probe is enabled.
    pub const fn is_enabled(self, probe: Probe) -> bool {
        self.bit(probe, 0)
    }

    /// Returns whether the position at a positive edge is stored.
    pub const fn has_positive(self, probe: Probe) -> bool {
        self.bit(probe, 1)
    }

    /// Returns whether the position at a negative edge is stored.
    pub const fn has_negative(self, probe: Probe) -> bool {
        self.bit(probe, 2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn function_and_status_have_the_bits_of_the_standard() {
        let trigger = ProbeTrigger::first_positive(ProbeSource::Input);
        assert_eq!(trigger.byte(), 0x11);
        let trigger = ProbeTrigger {
            source: ProbeSource::IndexPulse,
            positive: false,
            negative: true,
            is_continuous: true,
        };
        assert_eq!(trigger.byte(), 0x27);
        let status = ProbeStatus(0x0503);
        assert!(status.is_enabled(Probe::One) && status.has_positive(Probe::One));
        assert!(!status.has_negative(Probe::One));
        assert!(status.is_enabled(Probe::Two) && status.has_negative(Probe::Two));
        assert!(!status.has_positive(Probe::Two));
    }
}
