//! `ecan axis jog`: motion while a key is held, or for a time.

use ecan_cia402::{AxisCommand, AxisRef, StopKind};
use std::time::Duration;

use clap::Args;
use ecan_canopen::OperatingMode;
use ecan_tool_support::command_line::options::milliseconds;

use super::enable;
use super::envelope::{Envelope, ProfileLimits, parse_number};
use super::motion_arguments::MotionArguments;
use super::operator::{Hold, InputKind, Key, Operator};
use super::session::{AxisSession, Motion};
use crate::context::{Context, Failure, Result};

pub const NOTES: &str = "\
Keys: hold Right or Up to move in positive direction, Left or Down in negative direction. The first
press enables the drive; the motion begins when the terminal repeats the key, and ends by quick stop
when the repetition ends: the drive is then switched off until the next press. The axis decelerates
before the ends of --range. q, Esc, Enter or Ctrl-C end the command.

With --for the axis moves for a time without keys, in the direction of the sign of --velocity, and
any key stops it.

When the terminal is lost or a pipe of standard input is closed, the drive gets a quick stop and is
switched off (exit status 1).";

#[derive(Debug, Args)]
pub struct JogArguments {
    /// Velocity, in UNIT/s; with --for its sign is the direction [default: --max-velocity]
    #[arg(long, value_name = "VELOCITY", value_parser = parse_number, allow_hyphen_values = true)]
    velocity: Option<f64>,
    /// Move for this time, without keys
    #[arg(long = "for", value_name = "TIME", value_parser = milliseconds::<u64>(1..=3_600_000))]
    milliseconds: Option<u64>,
    #[command(flatten)]
    motion: MotionArguments,
}

pub fn run(arguments: &JogArguments, context: &Context) -> Result {
    let motion = &arguments.motion;
    let chosen = motion.choose(context)?;
    let envelope = motion.envelope(&chosen)?;
    let velocity = match arguments.velocity {
        None => envelope.velocity,
        Some(velocity) => chosen.units.length(velocity),
    };
    if velocity == 0.0 || velocity.abs() > envelope.velocity * (1.0 + 1e-9) {
        return Err(Failure::Usage(format!(
            "--velocity {} is out of range; allowed: above 0, up to {}",
            chosen.units.velocity_text(velocity),
            chosen.units.velocity_text(envelope.velocity)
        )));
    }
    let operator = motion.permission.obtain("jog", &chosen.label)?;
    if arguments.milliseconds.is_none() && operator.kind() != InputKind::Terminal {
        let message = "keys need a terminal as standard input; use --for without one";
        return Err(Failure::Usage(message.to_owned()));
    }
    let is_interactive = arguments.milliseconds.is_none();
    let settings = motion.settings(OperatingMode::CyclicPosition, envelope, is_interactive);
    let session = AxisSession::start(&chosen, settings, Some(operator), context)?;
    let end = session.run_to_end(|session| {
        let (_, envelope) = enable::prepare_within(session, &motion.permission, &envelope)?;
        let velocity = velocity.clamp(-envelope.velocity, envelope.velocity);
        match arguments.milliseconds {
            Some(ms) => {
                enable::enable(session)?;
                for_time(session, (velocity, &envelope), Duration::from_millis(ms))
            }
            None => {
                session.report("hold Left or Right to move, q ends");
                // The direction of the unit, which a negative scale reverses.
                let positive = chosen.units.length(1.0).signum();
                let jog = Jog { envelope, velocity: velocity.abs(), positive };
                jog.by_keys(session)
            }
        }
    })?;
    end.print(context)
}

/// End of the range in a direction.
fn end_of_range(envelope: &Envelope, direction: f64) -> f64 {
    f64::from(if direction > 0.0 { envelope.max } else { envelope.min })
}

fn for_time(
    session: &mut AxisSession,
    (velocity, envelope): (f64, &Envelope),
    time: Duration,
) -> Result {
    session.report(format_args!(
        "moving at {} for {} ms",
        session.units().velocity_text(velocity),
        time.as_millis()
    ));
    let limits = ProfileLimits { velocity: velocity.abs(), ..envelope.profile() };
    let goal = end_of_range(envelope, velocity);
    let mut motion = Motion::begin(session)?;
    let end_ns = session.now_ns().saturating_add(time.as_nanos() as u64);
    loop {
        let end = motion.toward(session, goal, limits)?;
        session.check_running()?;
        session.check_key()?;
        if motion.profile().is_at(goal) {
            session.report("the end of the range is reached");
            return Ok(());
        }
        if end.now_ns >= end_ns {
            // The shutdown brings the axis to rest by the ramp.
            return Ok(());
        }
    }
}

/// Motion by held keys.
#[derive(Clone, Copy, Debug)]
struct Jog {
    envelope: Envelope,
    velocity: f64,
    /// Sign of steps in positive direction.
    positive: f64,
}

/// State of the drive.
#[derive(Clone, Copy, Debug)]
enum JogState {
    Off,
    /// Being enabled, or at rest at its first target.
    Enabling,
    Moving(Key, Motion),
    Stopping,
}

impl Jog {
    fn direction(&self, key: Key) -> Option<f64> {
        match key {
            Key::Right | Key::Up => Some(self.positive),
            Key::Left | Key::Down => Some(-self.positive),
            _ => None,
        }
    }

    fn by_keys(&self, session: &mut AxisSession) -> Result {
        let mut state = JogState::Off;
        loop {
            let end = match &mut state {
                JogState::Moving(key, motion) => {
                    let goal = end_of_range(&self.envelope, self.direction(*key).unwrap_or(0.0));
                    let limits =
                        ProfileLimits { velocity: self.velocity, ..self.envelope.profile() };
                    motion.toward(session, goal, limits)
                }
                _ => session.cycle(None),
            };
            match end {
                Ok(_) => {}
                Err(Failure::Incomplete(_)) if session.is_commanded_end() => return Ok(()),
                Err(failure) => return Err(failure),
            }
            let operator = session.operator.as_ref();
            if operator.is_some_and(Operator::has_end_key) {
                return Ok(());
            }
            let hold = operator.map_or(Hold::None, Operator::hold);
            state = self.next(session, state, hold)?;
        }
    }

    fn next(
        &self,
        session: &mut AxisSession,
        state: JogState,
        hold: Hold<Key>,
    ) -> Result<JogState> {
        let key = match hold {
            Hold::Pressed(key) | Hold::Held(key) => {
                Some(key).filter(|key| self.direction(*key).is_some())
            }
            Hold::None => None,
        };
        let is_held = matches!(hold, Hold::Held(_));
        Ok(match (state, key) {
            (JogState::Off, Some(_)) => {
                session.command(AxisCommand::Enable)?;
                JogState::Enabling
            }
            (JogState::Off, None) => JogState::Off,
            // Still pressed, also another key.
            (JogState::Enabling, Some(key)) => {
                let axis = session.axis();
                let is_running = axis.is_some_and(AxisRef::is_running);
                if let (false, Some(error)) = (is_running, axis.and_then(AxisRef::error)) {
                    return Err(Failure::Rejected(format!("{}: {error}", session.label())));
                }
                match is_held && is_running {
                    true => JogState::Moving(key, Motion::begin(session)?),
                    false => JogState::Enabling,
                }
            }
            (JogState::Moving(old, motion), Some(key)) if is_held && key == old => {
                session.check_running()?;
                JogState::Moving(old, motion)
            }
            (JogState::Enabling | JogState::Moving(..), _) => {
                session.command(AxisCommand::Stop(StopKind::QuickStopThenDisable))?;
                session.report("key released: quick stop");
                JogState::Stopping
            }
            (JogState::Stopping, _) => match session.axis().is_none_or(AxisRef::is_stopped) {
                true => JogState::Off,
                false => JogState::Stopping,
            },
        })
    }
}
