//! `ecan axis stop`: quick stop of a drive in any state.

use clap::Args;
use ecan_sim::ClockKind;
use ecan_tool_support::command_line::interrupt::Interrupt;

use crate::context::{Context, Result};
use crate::frames::GatewayOptions;

use super::axis_choice::AxisOptions;
use super::session::{AxisSession, SessionSettings};

pub const NOTES: &str = "\
The drive gets a quick stop in every state, by SDO, and is switched off at rest. It is not
configured, and needs no limits. Exit status 5 if the drive does not report that it is off: it may
be moving; remove its power.";

#[derive(Debug, Args)]
pub struct StopArguments {
    #[command(flatten)]
    axis: AxisOptions,
    #[command(flatten)]
    options: GatewayOptions,
}

pub fn run(arguments: &StopArguments, context: &Context) -> Result {
    let StopArguments { axis, options } = arguments;
    let chosen = axis.choose(options.setup.config.as_deref(), false, context)?;
    // The first Ctrl-C does not end the stop; the second one ends the program.
    let _interrupt = Interrupt::install()?;
    let settings = SessionSettings {
        options,
        mode: None,
        envelope: None,
        clock: ClockKind::Stepped,
        accepts_risk: true,
    };
    AxisSession::start(&chosen, settings, None, context)?.stop_only()?.print(context)
}
