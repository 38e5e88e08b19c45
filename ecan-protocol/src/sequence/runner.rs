//! Execution of a list of steps.

use core::ops::Deref;
use core::time::Duration;

use super::step::{Action, Expectation, SdoValue, Step, StepError, Tolerance};
use crate::object::AbortCode;

/// State of a [`Sequence`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SequenceState<E> {
    /// Steps remain.
    Running,
    /// All steps are complete.
    Done,
    /// The current step failed. The next call would execute it again.
    Failed(StepError<E>),
}

enum Turn {
    Busy,
    Done,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Stage {
    #[default]
    Start,
    Reading,
    /// `Modify`: the download of this value could not start yet.
    Changed(u32),
    Writing,
}

/// Executes a list of steps, as much as possible in each call, without blocking or allocating.
///
/// The list is any slice of steps: a `Vec`, a [`List`](crate::config::List), a reference. While a
/// transfer runs, the client of the device belongs to the sequence.
///
/// ```
/// # use core::time::Duration;
/// # use ecan_protocol::object::AbortCode;
/// use ecan_protocol::sequence::*;
///
/// # struct Device([u8; 4]);
/// # impl ObjectAccess for Device {
/// #     type Action = NoAction;
/// #     type Error = AbortCode;
/// #     fn start_write(&mut self, _: u16, _: u8, data: &[u8]) -> Result<bool, AbortCode> {
/// #         self.0.copy_from_slice(data);
/// #         Ok(true)
/// #     }
/// #     fn start_read(&mut self, _: u16, _: u8) -> Result<bool, AbortCode> { Ok(true) }
/// #     fn poll(&mut self) -> Result<Transfer, AbortCode> {
/// #         Ok(Transfer::Done(SdoValue::from_bytes(&self.0).raw()))
/// #     }
/// #     fn act(&mut self, action: &NoAction, _: Duration) -> Result<bool, AbortCode> { match *action {} }
/// #     fn abort_code(error: &AbortCode) -> Option<AbortCode> { Some(*error) }
/// # }
/// # let mut device = Device([0; 4]);
/// let steps = [Step::write(0x60FF, 0, 1_000_i32), Step::expect(0x60FF, 0, 1_000_i32)];
/// let mut sequence = Sequence::new(&steps[..]);
/// let state = sequence.advance(&mut device, 0, |index, subindex, value| {
///     println!("{index:04X}:{subindex:02X} = {value}");
/// });
/// assert_eq!(state, SequenceState::Done);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Sequence<S> {
    steps: S,
    next: usize,
    stage: Stage,
    /// Start of the current step; `None` before its first turn.
    since_ns: Option<u64>,
}

impl<S> Sequence<S> {
    /// Creates a sequence at its first step.
    pub const fn new(steps: S) -> Self {
        Self { steps, next: 0, stage: Stage::Start, since_ns: None }
    }

    /// All steps.
    pub fn steps(&self) -> &S {
        &self.steps
    }

    /// All steps, to append some.
    pub fn steps_mut(&mut self) -> &mut S {
        &mut self.steps
    }

    /// Starts over at the first step. A running transfer is not ended.
    pub fn restart(&mut self) {
        self.next = 0;
        self.stage = Stage::Start;
        self.since_ns = None;
    }

    /// Index of the current step; the number of steps if all are complete.
    pub fn position(&self) -> usize {
        self.next
    }

    /// Returns whether a transfer of the sequence is running.
    pub fn is_transferring(&self) -> bool {
        matches!(self.stage, Stage::Reading | Stage::Writing)
    }

    /// Time since the current step began.
    pub fn elapsed(&self, now_ns: u64) -> Duration {
        Duration::from_nanos(self.since_ns.map_or(0, |since| now_ns.saturating_sub(since)))
    }
}

impl<S, A: Copy> Sequence<S>
where
    S: Deref<Target = [Step<A>]>,
{
    /// The current step; `None` if all are complete.
    pub fn current(&self) -> Option<Step<A>> {
        self.steps.get(self.next).copied()
    }

    /// Executes steps until one must wait, all are complete, or one fails. `on_read` receives the
    /// value of each [`Action::Read`] with its index and subindex. `now_ns` is any clock that does
    /// not go back. Real-time safe if `access` and `on_read` are.
    pub fn advance<T: ObjectAccess<Action = A>>(
        &mut self,
        access: &mut T,
        now_ns: u64,
        mut on_read: impl FnMut(u16, u8, u64),
    ) -> SequenceState<T::Error> {
        while let Some(step) = self.current() {
            self.since_ns.get_or_insert(now_ns);
            let turn = match self.turn(&step.action, access, now_ns, &mut on_read) {
                Err(error) if is_tolerated::<T>(step.tolerance, &error) => Ok(Turn::Done),
                turn => turn,
            };
            match turn {
                Ok(Turn::Busy) => return SequenceState::Running,
                Ok(Turn::Done) => {
                    self.next += 1;
                    self.stage = Stage::Start;
                    self.since_ns = Some(now_ns);
                }
                Err(error) => {
                    self.stage = Stage::Start;
                    return SequenceState::Failed(error);
                }
            }
        }
        SequenceState::Done
    }

    fn turn<T: ObjectAccess<Action = A>>(
        &mut self,
        action: &Action<A>,
        access: &mut T,
        now_ns: u64,
        on_read: &mut impl FnMut(u16, u8, u64),
    ) -> Result<Turn, StepError<T::Error>> {
        loop {
            let value = match self.stage {
                Stage::Start => match *action {
                    Action::Write { index, subindex, value } => {
                        if !access.start_write(index, subindex, value.as_bytes())? {
                            return Ok(Turn::Busy);
                        }
                        self.stage = Stage::Writing;
                        continue;
                    }
                    Action::Modify { index, subindex, .. }
                    | Action::Read { index, subindex }
                    | Action::Expect { index, subindex, .. }
                    | Action::Await { index, subindex, .. } => {
                        if !access.start_read(index, subindex)? {
                            return Ok(Turn::Busy);
                        }
                        self.stage = Stage::Reading;
                        continue;
                    }
                    Action::Pause(time) => return Ok(done_if(self.elapsed(now_ns) >= time)),
                    Action::Device(ref action) => {
                        return Ok(done_if(access.act(action, self.elapsed(now_ns))?));
                    }
                },
                Stage::Changed(value) => {
                    if let Action::Modify { index, subindex, .. } = *action
                        && !access.start_write(index, subindex, SdoValue::from(value).as_bytes())?
                    {
                        return Ok(Turn::Busy);
                    }
                    self.stage = Stage::Writing;
                    continue;
                }
                Stage::Reading | Stage::Writing => match access.poll()? {
                    Transfer::Busy => return Ok(Turn::Busy),
                    Transfer::Lost => {
                        self.stage = Stage::Start;
                        continue;
                    }
                    Transfer::Done(_) if self.stage == Stage::Writing => return Ok(Turn::Done),
                    Transfer::Done(value) => value,
                },
            };
            match *action {
                Action::Modify { clear, set, .. } => {
                    self.stage = Stage::Changed(value as u32 & !clear | set);
                }
                Action::Expect { expected, .. } => return check(value, expected),
                Action::Await { expected, timeout, .. } => {
                    if expected.is_met_by(value) {
                        return Ok(Turn::Done);
                    }
                    let waited = self.elapsed(now_ns);
                    if waited > timeout {
                        return Err(StepError::TimedOut { found: value, expected, waited });
                    }
                    // The next read starts in the next call, so that a blocking client waits too.
                    self.stage = Stage::Start;
                    return Ok(Turn::Busy);
                }
                Action::Read { index, subindex } => {
                    on_read(index, subindex, value);
                    return Ok(Turn::Done);
                }
                Action::Write { .. } | Action::Pause(_) | Action::Device(_) => {
                    return Ok(Turn::Done);
                }
            }
        }
    }
}

fn done_if(is_done: bool) -> Turn {
    if is_done { Turn::Done } else { Turn::Busy }
}

fn check<E>(found: u64, expected: Expectation) -> Result<Turn, StepError<E>> {
    if expected.is_met_by(found) {
        Ok(Turn::Done)
    } else {
        Err(StepError::Mismatch { found, expected })
    }
}

fn is_tolerated<T: ObjectAccess>(tolerance: Tolerance, error: &StepError<T::Error>) -> bool {
    match error {
        StepError::Access(error) => T::abort_code(error).is_some_and(|code| tolerance.covers(code)),
        StepError::Mismatch { .. } => tolerance == Tolerance::Any,
        StepError::TimedOut { .. } => false,
    }
}

/// State of the transfer that was started last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transfer {
    /// The transfer is running.
    Busy,
    /// The transfer succeeded: the value of an upload without sign, any number after a download.
    Done(u64),
    /// The result is gone, because another part of the application used the client: the step
    /// starts again.
    Lost,
}

/// Object access of one device, by one client that executes one transfer at a time.
///
/// A blocking client executes the transfer in `start_…` and returns its result from
/// [`poll`](Self::poll).
pub trait ObjectAccess {
    /// Device-specific action of a step; [`NoAction`](super::NoAction) if there are none.
    type Action: Copy;
    /// Cause of the failure of a transfer or an action.
    type Error;

    /// Starts a download. Returns `false` if the client is busy; the sequence then retries.
    ///
    /// # Errors
    /// The transfer cannot start, or failed.
    fn start_write(&mut self, index: u16, subindex: u8, data: &[u8]) -> Result<bool, Self::Error>;

    /// Starts an upload. Returns `false` if the client is busy; the sequence then retries.
    ///
    /// # Errors
    /// The transfer cannot start, or failed.
    fn start_read(&mut self, index: u16, subindex: u8) -> Result<bool, Self::Error>;

    /// Returns the state of the transfer that was started last.
    ///
    /// # Errors
    /// The transfer failed.
    fn poll(&mut self) -> Result<Transfer, Self::Error>;

    /// Executes a device-specific action, `elapsed` after its step began. Returns whether it is
    /// complete.
    ///
    /// # Errors
    /// The action failed.
    fn act(&mut self, action: &Self::Action, elapsed: Duration) -> Result<bool, Self::Error>;

    /// Returns the abort code of a transfer that the device aborted.
    fn abort_code(error: &Self::Error) -> Option<AbortCode>;
}

#[cfg(test)]
mod tests {
    use std::vec;
    use std::vec::Vec;

    use super::*;
    use crate::object::AbortCode;

    extern crate std;

    /// A device whose transfers take one call, with objects 0x2000 and upwards.
    #[derive(Default)]
    struct Device {
        values: [u64; 4],
        log: Vec<(char, u16)>,
        result: Option<Result<Transfer, AbortCode>>,
        is_busy: bool,
        refusal: Option<AbortCode>,
    }

    impl Device {
        fn value(&mut self, index: u16) -> Result<&mut u64, AbortCode> {
            let slot = usize::from(index.wrapping_sub(0x2000));
            let value = self.values.get_mut(slot).ok_or(AbortCode::NO_OBJECT);
            self.refusal.map_or(value, Err)
        }
    }

    impl ObjectAccess for Device {
        type Action = char;
        type Error = AbortCode;

        fn start_write(&mut self, index: u16, _: u8, data: &[u8]) -> Result<bool, AbortCode> {
            self.log.push(('w', index));
            if !self.is_busy {
                let new = SdoValue::from_bytes(data).raw();
                self.result = Some(self.value(index).map(|value| {
                    *value = new;
                    Transfer::Done(0)
                }));
            }
            Ok(!self.is_busy)
        }

        fn start_read(&mut self, index: u16, _: u8) -> Result<bool, AbortCode> {
            self.log.push(('r', index));
            if !self.is_busy {
                self.result = Some(self.value(index).map(|value| Transfer::Done(*value)));
            }
            Ok(!self.is_busy)
        }

        fn poll(&mut self) -> Result<Transfer, AbortCode> {
            self.result.take().unwrap_or(Ok(Transfer::Busy))
        }

        fn act(&mut self, action: &char, elapsed: Duration) -> Result<bool, AbortCode> {
            self.log.push((*action, 0));
            Ok(elapsed >= Duration::from_nanos(5))
        }

        fn abort_code(error: &AbortCode) -> Option<AbortCode> {
            Some(*error)
        }
    }

    fn run(device: &mut Device, steps: Vec<Step<char>>) -> (SequenceState<AbortCode>, Vec<u64>) {
        let (mut read, mut sequence) = (Vec::new(), Sequence::new(steps));
        for now_ns in 0..100 {
            let state = sequence.advance(device, now_ns, |_, _, value| read.push(value));
            if state != SequenceState::Running {
                return (state, read);
            }
        }
        (SequenceState::Running, read)
    }

    #[test]
    fn steps_run_in_order() {
        let mut device = Device { values: [0, 0xF0, 7, 0], ..Device::default() };
        let steps = vec![
            Step::write(0x2000, 0, 5_u16),
            Step::expect(0x2000, 0, 5_u8),
            Step::modify(0x2001, 0, 0x10, 0x01),
            Step::read(0x2001, 0),
            Step::device('a'),
            Step::await_value(0x2002, 0, 7_u8, Duration::from_nanos(3)),
        ];
        assert_eq!(run(&mut device, steps), (SequenceState::Done, vec![0xE1]));
        let (first, rest) = device.log.split_at(5);
        let expected = [('w', 0x2000), ('r', 0x2000), ('r', 0x2001), ('w', 0x2001), ('r', 0x2001)];
        assert_eq!(first, expected);
        assert_eq!(rest.iter().filter(|entry| entry.0 == 'a').count(), 6);
        assert_eq!(rest.last(), Some(&('r', 0x2002)));
    }

    #[test]
    fn missing_object_fails_unless_tolerated() {
        let mut device = Device::default();
        let step: Step<char> = Step::write(0x3000, 0, 1_u8);
        let error = StepError::Access(AbortCode::NO_OBJECT);
        assert_eq!(run(&mut device, vec![step]).0, SequenceState::Failed(error));
        assert_eq!(run(&mut device, vec![step.if_present()]).0, SequenceState::Done);
        let other: Step<char> = Step::expect(0x2000, 0, 1_u8);
        let error = StepError::Mismatch { found: 0, expected: Expectation::Equals(1) };
        assert_eq!(run(&mut device, vec![other.if_present()]).0, SequenceState::Failed(error));
        assert_eq!(run(&mut device, vec![other.if_accepted()]).0, SequenceState::Done);
    }

    #[test]
    fn each_tolerance_covers_its_refusals() {
        let step: Step<char> = Step::write(0x2000, 0, 1_u8);
        let cases = [
            (AbortCode::NO_OBJECT, [false, true, false, true]),
            (AbortCode::NO_SUBINDEX, [false, true, false, true]),
            (AbortCode::READ_ONLY, [false, false, true, true]),
            (AbortCode::UNSUPPORTED_ACCESS, [false, false, true, true]),
            (AbortCode::GENERAL, [false, false, false, true]),
        ];
        for (code, covered) in cases {
            let steps = [step, step.if_present(), step.if_writable(), step.if_accepted()];
            for (step, is_covered) in steps.into_iter().zip(covered) {
                let mut device = Device { refusal: Some(code), ..Device::default() };
                let error = SequenceState::Failed(StepError::Access(code));
                let expected = if is_covered { SequenceState::Done } else { error };
                assert_eq!(run(&mut device, vec![step]).0, expected, "{:?}", step.tolerance);
                assert_eq!(device.log, [('w', 0x2000)]);
            }
        }
    }

    #[test]
    fn await_ends_after_its_timeout() {
        let mut device = Device::default();
        let step = Step::await_value(0x2000, 0, 1_u8, Duration::from_nanos(3));
        let error = StepError::TimedOut {
            found: 0,
            expected: Expectation::Equals(1),
            waited: Duration::from_nanos(4),
        };
        assert_eq!(run(&mut device, vec![step]).0, SequenceState::Failed(error));
        assert_eq!(device.log.len(), 5);
    }

    #[test]
    fn lost_transfer_starts_again() {
        let mut device = Device::default();
        let mut sequence = Sequence::new([Step::<char>::write(0x2000, 0, 9_u8)].to_vec());
        device.is_busy = true;
        assert_eq!(sequence.advance(&mut device, 0, |_, _, _| {}), SequenceState::Running);
        assert!(!sequence.is_transferring() && sequence.position() == 0);
        device.is_busy = false;
        assert!(device.start_write(0x2001, 0, &[1]).is_ok());
        sequence.stage = Stage::Writing;
        device.result = Some(Ok(Transfer::Lost));
        assert_eq!(sequence.advance(&mut device, 1, |_, _, _| {}), SequenceState::Done);
        assert_eq!((device.values[0], sequence.position()), (9, 1));
    }
}
