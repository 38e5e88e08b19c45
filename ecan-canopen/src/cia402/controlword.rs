//! The controlword (CiA 402-2, 8.4.1) and its commands.

/// A command of the state machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Command {
    /// To ready to switch on.
    Shutdown,
    /// To switched on.
    SwitchOn,
    /// To operation enabled.
    EnableOperation,
    /// Power off at once.
    DisableVoltage,
    /// Quick stop.
    QuickStop,
    /// From operation enabled back to switched on.
    DisableOperation,
    /// Out of a fault; works on the rising edge of its bit only.
    FaultReset,
}

/// The controlword, 0x6040.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Controlword(pub u16);

impl Controlword {
    /// Bit 0: switch on.
    pub const SWITCH_ON: u16 = 1 << 0;
    /// Bit 1: enable voltage.
    pub const ENABLE_VOLTAGE: u16 = 1 << 1;
    /// Bit 2: clear for a quick stop.
    pub const QUICK_STOP: u16 = 1 << 2;
    /// Bit 3: enable operation.
    pub const ENABLE_OPERATION: u16 = 1 << 3;
    /// Bit 4: by mode; new set-point in PP, start in homing, interpolation in IP, ramp in VL.
    pub const MODE_4: u16 = 1 << 4;
    /// Bit 5: by mode; change set immediately in PP, ramp not locked in VL.
    pub const MODE_5: u16 = 1 << 5;
    /// Bit 6: by mode; the target is relative in PP, the ramp follows the target in VL.
    pub const MODE_6: u16 = 1 << 6;
    /// Bit 7: fault reset, by its rising edge.
    pub const FAULT_RESET: u16 = 1 << 7;
    /// Bit 8: halt.
    pub const HALT: u16 = 1 << 8;

    /// The bits of a command, all others 0.
    pub const fn of(command: Command) -> Self {
        Self(match command {
            Command::Shutdown => 0x06,
            Command::SwitchOn | Command::DisableOperation => 0x07,
            Command::EnableOperation => 0x0F,
            Command::DisableVoltage => 0x00,
            Command::QuickStop => 0x02,
            Command::FaultReset => 0x80,
        })
    }

    /// The command in this word, `previous` being the word before: fault reset needs an edge.
    ///
    /// 0x07 is [`Command::SwitchOn`] here; in operation enabled it means
    /// [`Command::DisableOperation`].
    pub const fn command(self, previous: Self) -> Command {
        if self.has(Self::FAULT_RESET) && !previous.has(Self::FAULT_RESET) {
            return Command::FaultReset;
        }
        if !self.has(Self::ENABLE_VOLTAGE) {
            Command::DisableVoltage
        } else if !self.has(Self::QUICK_STOP) {
            Command::QuickStop
        } else if !self.has(Self::SWITCH_ON) {
            Command::Shutdown
        } else if self.has(Self::ENABLE_OPERATION) {
            Command::EnableOperation
        } else {
            Command::SwitchOn
        }
    }

    /// Returns whether all of these bits are set.
    pub const fn has(self, bits: u16) -> bool {
        self.0 & bits == bits
    }

    /// The same with these bits set.
    #[must_use]
    pub const fn with(self, bits: u16) -> Self {
        Self(self.0 | bits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_read_as_they_are_written() {
        let idle = Controlword(0);
        for command in [
            Command::Shutdown,
            Command::SwitchOn,
            Command::EnableOperation,
            Command::DisableVoltage,
            Command::QuickStop,
            Command::FaultReset,
        ] {
            assert_eq!(Controlword::of(command).command(idle), command);
            let with_mode = Controlword::of(command).with(Controlword::MODE_4 | Controlword::HALT);
            assert_eq!(with_mode.command(idle), command);
        }
    }

    #[test]
    fn fault_reset_needs_its_edge() {
        let reset = Controlword::of(Command::FaultReset);
        assert_eq!(reset.command(reset), Command::DisableVoltage);
        assert_eq!(Controlword(0x86).command(reset), Command::Shutdown);
    }
}
