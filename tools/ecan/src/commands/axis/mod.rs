//! `ecan axis`: commissioning of one CiA 402 axis.

mod axis_choice;
mod enable;
mod envelope;
mod home;
mod jog;
mod motion_arguments;
mod motion_watch;
mod move_axis;
mod operator;
mod session;
mod status;
mod tune;
mod tune_analysis;
mod unit;

use clap::{Args, Subcommand};

use crate::context::{Context, Result};

pub const EXAMPLES: &str = "\
Examples:
  ecan axis status --node 1                            bits of the statusword, obstacles to enabling
  ecan axis status --config machine.toml --axis elbow  an axis of a file
  ecan axis stop --node 1                              quick stop, then off
  ecan axis enable --node 1 --unit step --max-velocity 5000 --range -1000..1000
  ecan axis jog --config machine.toml --axis elbow --max-velocity 20 --range -90..90
  ecan axis move --config machine.toml --axis elbow --to 45 --max-velocity 20 --range -90..90
  ecan axis home --config machine.toml --axis elbow --method 1 --max-velocity 5 --range -370..10
  ecan axis tune --config machine.toml --axis elbow --step 10 --plot step.svg \\
      --max-velocity 60 --acceleration 600 --range -90..90
  ecan --ecrt sim:drives axis move ...                 rehearsal on the simulator

All but `status` configure the gateway and the drive, and run the cycle themselves: no application
can use the master then. The motion guard checks each target. Limits have no defaults.

Not functional safety: keep an emergency stop in hardware within reach.";

#[derive(Debug, Args)]
pub struct AxisArguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Show the state of a drive, and the obstacles to enabling it
    #[command(after_help = status::NOTES)]
    Status(Box<status::StatusArguments>),
    /// Enable a drive at its position, as long as the operator is present
    #[command(after_help = enable::NOTES)]
    Enable(Box<enable::EnableArguments>),
    /// Move an axis while an arrow key is held, or for a time
    #[command(after_help = jog::NOTES)]
    Jog(Box<jog::JogArguments>),
    /// Move an axis to a position or by a distance
    #[command(name = "move", after_help = move_axis::NOTES)]
    Move(Box<move_axis::MoveArguments>),
    /// Find the home position by a method of the drive
    #[command(after_help = home::NOTES)]
    Home(Box<home::HomeArguments>),
    /// Stop a drive in any state by quick stop, and switch it off
    #[command(after_help = enable::STOP_NOTES)]
    Stop(Box<enable::StopArguments>),
    /// Record the response to a step or a sweep, with a picture
    #[command(after_help = tune::NOTES)]
    Tune(Box<tune::TuneArguments>),
}

pub fn run(arguments: &AxisArguments, context: &Context) -> Result {
    match &arguments.action {
        Action::Status(arguments) => status::run(arguments, context),
        Action::Enable(arguments) => enable::run(arguments, context),
        Action::Jog(arguments) => jog::run(arguments, context),
        Action::Move(arguments) => move_axis::run(arguments, context),
        Action::Home(arguments) => home::run(arguments, context),
        Action::Stop(arguments) => enable::run_stop(arguments, context),
        Action::Tune(arguments) => tune::run(arguments, context),
    }
}
