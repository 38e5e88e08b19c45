//! Which part of a logical datagram a slave exchanges.

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ProcessDirection {
    Output,
    Input,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LogicalCommand {
    /// LRD
    Read,
    /// LWR
    Write,
    /// LRW
    ReadWrite,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Fmmu {
    pub(crate) logical_start: u32,
    /// Length in bytes.
    pub(crate) length: u16,
    pub(crate) sync_manager: u8,
    pub(crate) direction: ProcessDirection,
}

impl Fmmu {
    /// The part of a datagram's data that the FMMU maps; none unless the datagram covers all of it.
    fn part<'a>(&self, logical: u32, data: &'a mut [u8]) -> Option<&'a mut [u8]> {
        let from = usize::try_from(self.logical_start.checked_sub(logical)?).ok()?;
        data.get_mut(from..from + usize::from(self.length))
    }

    /// Exchanges the mapped part of a datagram by `access`, which returns whether it succeeds; returns
    /// what the slave adds to the working counter.
    pub(super) fn exchange(
        &self,
        command: LogicalCommand,
        logical: u32,
        data: &mut [u8],
        access: impl FnOnce(ProcessDirection, &mut [u8]) -> bool,
    ) -> u16 {
        let weight = match (self.direction, command) {
            (ProcessDirection::Output, LogicalCommand::Read)
            | (ProcessDirection::Input, LogicalCommand::Write) => return 0,
            (ProcessDirection::Output, LogicalCommand::ReadWrite) => 2,
            _ => 1,
        };
        let Some(part) = self.part(logical, data) else { return 0 };
        if access(self.direction, part) { weight } else { 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn partly_covered_fmmu_is_ignored() {
        let fmmu = Fmmu {
            logical_start: 100,
            length: 4,
            sync_manager: 2,
            direction: ProcessDirection::Output,
        };
        let mut data = [0, 1, 2, 3, 4, 5, 6, 7];
        assert_eq!(fmmu.part(98, &mut data).as_deref(), Some(&[2, 3, 4, 5][..]));
        assert_eq!(fmmu.part(96, &mut data).as_deref(), Some(&[4, 5, 6, 7][..]));
        assert!(fmmu.part(95, &mut data).is_none());
        assert!(fmmu.part(101, &mut data).is_none());
    }
}
