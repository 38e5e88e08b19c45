//! `ecan axis enable`: the drive holds its position.

use clap::Args;
use ecan_canopen::OperatingMode;

use crate::context::{Context, Failure, Result};

use super::motion_arguments::MotionArguments;
use super::operator::{InputKind, Operator};
use super::session::AxisSession;
use super::startup;

pub const NOTES: &str = "\
The drive is configured and enabled at its actual position, and holds it until Enter, q, Esc or
Ctrl-C, or for --for. With --hold-key only while any key is held. When the terminal is lost or a pipe
of standard input is closed, the drive gets a quick stop and is switched off (exit status 1).

If it is not enabled, the error names the obstacles, as `ecan axis status` does.";

#[derive(Debug, Args)]
pub struct EnableArguments {
    /// Stay enabled for this time, in ms
    #[arg(long = "for", conflicts_with = "hold_key", value_name = "MS", value_parser = clap::value_parser!(u64).range(1..=3_600_000))]
    milliseconds: Option<u64>,
    #[command(flatten)]
    motion: MotionArguments,
}

pub fn run(arguments: &EnableArguments, context: &Context) -> Result {
    let motion = &arguments.motion;
    let chosen = motion.choose(context)?;
    let envelope = motion.envelope(&chosen)?;
    let operator = motion.permission.obtain("enable", &chosen.label)?;
    if operator.kind() == InputKind::None && arguments.milliseconds.is_none() {
        let message = "without a terminal or a pipe `enable` needs an end; set --for";
        return Err(Failure::Usage(message.to_owned()));
    }
    let is_interactive = arguments.milliseconds.is_none();
    let settings = motion.settings(OperatingMode::CyclicPosition, envelope, is_interactive);
    let session = AxisSession::start(&chosen, settings, Some(operator), context)?;
    let end = session.run_to_end(|session| {
        startup::prepare_within(session, &motion.permission, &envelope)?;
        startup::enable(session)?;
        hold(session, arguments)
    })?;
    end.print(context)
}

fn hold(session: &mut AxisSession, arguments: &EnableArguments) -> Result {
    let end = match (arguments.milliseconds, arguments.motion.permission.holds_key()) {
        (Some(ms), _) => format!("for {ms} ms"),
        (None, true) => "while a key is held".to_owned(),
        (None, false) => "until Enter, q or Ctrl-C".to_owned(),
    };
    session.report(format_args!("enabled {end}"));
    let start_ns = session.now_ns();
    let time_ns = arguments.milliseconds.map(|ms| ms * 1_000_000);
    loop {
        let now_ns = match session.cycle(None) {
            Ok(end) => end.now_ns,
            // The usual end.
            Err(Failure::Incomplete(_)) if session.is_commanded_end() => return Ok(()),
            Err(failure) => return Err(failure),
        };
        session.check_running()?;
        let operator = session.operator.as_ref();
        if operator.is_some_and(|it| it.needs_key() && !it.has_held_key()) {
            session.report("key released: quick stop");
            return session.stop();
        }
        let is_over = time_ns.is_some_and(|time_ns| now_ns.saturating_sub(start_ns) >= time_ns);
        if is_over || session.operator.as_ref().is_some_and(Operator::has_end_key) {
            return Ok(());
        }
    }
}
