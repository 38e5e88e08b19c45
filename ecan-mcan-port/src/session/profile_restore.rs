//! Applies the PDO profiles again to a gateway that lost them before OP.
//!
//! IgH writes the PDO assignment again after the startup SDOs. A gateway may then drop its profiles
//! (docs/ASSUMPTIONS.md, H41) and reject OP. The manual permits an apply in SAFEOP (5.4.3), and the requested
//! fields are those of the startup. The master does not request OP a second time; the register AL control does.

use ecan_host::{Adapter, RequestState, SdoRequestId};
use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::Direction;

use super::verification::IN_USE;

/// Time in SAFEOP before the profiles are read, in nanoseconds.
pub(crate) const SAFEOP_NS: u64 = 1_000_000_000;
/// Time in SAFEOP in which another startup must not be requested, since it would begin before the restored profiles
/// lead to OP. It passes only if the mailbox does not answer or OP is rejected.
pub(crate) const RESTORE_NS: u64 = 10_000_000_000;

const ACTIVE_WORD: u8 = 12;
const STATUS: u8 = 2;
const APPLY: u8 = 1;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum RestoreStep {
    ReadActive(usize),
    Apply(usize),
    ReadStatus(usize),
    OpRequested,
    /// The attempt is over: no profile was lost, or a transfer failed.
    Ended,
}

use RestoreStep::{Apply, Ended, OpRequested, ReadActive, ReadStatus};

#[derive(Debug)]
pub(crate) struct ProfileRestore {
    slave: usize,
    read: SdoRequestId,
    apply: SdoRequestId,
    /// Profile objects and the words of their profiles.
    profiles: [(u16, u32); 2],
    step: RestoreStep,
    is_begun: bool,
    is_lost: bool,
}

impl ProfileRestore {
    /// Creates the request; the Adapter must be configured and not yet active.
    pub(crate) fn new(
        adapter: &mut Adapter,
        slave: usize,
        [tx, rx]: [PdoProfile; 2],
    ) -> Result<Self, ecan_host::Error> {
        let mut request = |size| {
            let request = adapter.requests().create_sdo(slave, size)?;
            adapter.requests().sdo_timeout(request, 0)?;
            Ok::<_, ecan_host::Error>(request)
        };
        let (read, apply) = (request(4)?, request(1)?);
        let profiles = [(Direction::TxPdo, tx), (Direction::RxPdo, rx)];
        Ok(Self {
            slave,
            read,
            apply,
            profiles: profiles.map(|(direction, it)| (direction.profile_object(), it.word())),
            step: ReadActive(0),
            is_begun: false,
            is_lost: false,
        })
    }

    /// The gateway is not in SAFEOP: its next stay there has an attempt of its own.
    pub(crate) fn reset(&mut self) {
        (self.step, self.is_begun, self.is_lost) = (ReadActive(0), false, false);
    }

    /// Returns whether the attempt of this stay in SAFEOP is over and leads to no OP.
    pub(crate) fn has_ended(&self) -> bool {
        self.step == Ended
    }

    /// One step, once a cycle in SAFEOP; one attempt until [`reset`](Self::reset).
    pub(crate) fn step(&mut self, adapter: &mut Adapter) {
        let (ReadActive(nth) | Apply(nth) | ReadStatus(nth)) = self.step else { return };
        let Some(&(index, word)) = self.profiles.get(nth) else { return };
        let request = if let Apply(_) = self.step { self.apply } else { self.read };
        let state = adapter.requests().sdo_state(request);
        if matches!(state, Ok(RequestState::Busy)) {
            return;
        }
        if !self.is_begun {
            self.is_begun = match self.step {
                Apply(_) => adapter.requests().sdo_write(request, index, APPLY, &[1]).is_ok(),
                ReadActive(_) => adapter.requests().sdo_read(request, index, ACTIVE_WORD).is_ok(),
                _ => adapter.requests().sdo_read(request, index, STATUS).is_ok(),
            };
            return;
        }
        self.is_begun = false;
        if !matches!(state, Ok(RequestState::Success)) {
            self.step = Ended;
            return;
        }
        let mut value = [0; 4];
        for (to, from) in value.iter_mut().zip(adapter.requests().sdo_data(request)) {
            *to = *from;
        }
        let value = u32::from_le_bytes(value);
        let is_in_use = IN_USE.contains(&u64::from(value));
        self.step = match self.step {
            ReadActive(0) => {
                self.is_lost |= value != word;
                ReadActive(1)
            }
            ReadActive(_) if self.is_lost || value != word => Apply(0),
            Apply(0) => Apply(1),
            Apply(_) => ReadStatus(0),
            ReadStatus(0) if is_in_use => ReadStatus(1),
            ReadStatus(_) if is_in_use => self.request_op(adapter),
            _ => Ended,
        };
    }

    fn request_op(&self, adapter: &mut Adapter) -> RestoreStep {
        let slave = self.slave;
        tracing::warn!(
            slave,
            "slave {slave}: PDO profiles applied again in SAFEOP (lost after the master rewrote the PDO \
             assignment, assumption H41)"
        );
        // A request that is rejected leaves the gateway in SAFEOP, as it was.
        let _ = adapter.requests().enter_op(self.slave);
        OpRequested
    }
}
