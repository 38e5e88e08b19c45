//! The handshake of a new set-point in profile position mode (CiA 402-2, 11.2).

use ecan_canopen::Controlword;

/// Hands one position after the other to a drive in profile position mode.
///
/// The drive takes a position with the rising edge of controlword bit 4 and says so with
/// statusword bit 12; only after both have fallen can the next be handed over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SetPoint {
    /// The position that the drive has taken, or that needs no taking.
    taken: Option<i32>,
    /// Bit 4 is up with this position.
    offered: Option<i32>,
}

impl SetPoint {
    /// The drive stands at `position` and need not be told to go there.
    pub fn start(&mut self, position: i32) {
        *self = Self { taken: Some(position), offered: None };
    }

    /// The bits of the controlword and the target for this cycle. `acknowledged` is statusword
    /// bit 12. Real-time safe.
    pub fn step(&mut self, requested: i32, acknowledged: bool) -> (u16, i32) {
        if let Some(offered) = self.offered {
            if !acknowledged {
                return (Controlword::MODE_4 | Controlword::MODE_5, offered);
            }
            self.taken = Some(offered);
            self.offered = None;
        } else if !acknowledged && self.taken != Some(requested) {
            self.offered = Some(requested);
            return (Controlword::MODE_4 | Controlword::MODE_5, requested);
        }
        (Controlword::MODE_5, self.taken.unwrap_or(requested))
    }

    /// Returns whether the drive has taken this position.
    pub fn has_taken(&self, position: i32) -> bool {
        self.taken == Some(position) && self.offered.is_none()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UP: u16 = 0x30;
    const DOWN: u16 = 0x20;

    #[test]
    fn position_is_offered_until_the_drive_accepts_it() {
        let mut point = SetPoint::default();
        point.start(5);
        assert_eq!(point.step(5, false), (DOWN, 5), "it is there");
        assert_eq!(point.step(900, false), (UP, 900));
        assert_eq!(point.step(900, false), (UP, 900));
        assert_eq!(point.step(900, true), (DOWN, 900));
        assert_eq!(point.step(900, true), (DOWN, 900));
        assert_eq!(point.step(900, false), (DOWN, 900));
        assert!(point.has_taken(900));
    }

    #[test]
    fn new_position_waits_for_the_handshake() {
        let mut point = SetPoint::default();
        point.start(0);
        assert_eq!(point.step(100, false), (UP, 100));
        assert_eq!(point.step(200, false), (UP, 100), "what is offered stays");
        assert_eq!(point.step(200, true), (DOWN, 100));
        assert_eq!(point.step(200, true), (DOWN, 100), "no edge while bit 12 is up");
        assert_eq!(point.step(200, false), (UP, 200));
    }
}
