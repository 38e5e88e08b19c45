//! Options that all motions of an axis have, and the permission to move.

use std::time::Duration;

use clap::Args;
use ecan_canopen::OperatingMode;
use ecan_sim::ClockKind;
use ecan_tool_support::command_line::options::milliseconds;

use super::axis_choice::{AxisOptions, ChosenAxis};
use super::envelope::{Envelope, LimitArguments};
use super::operator::{InputKind, Operator, input_kind};
use super::session::SessionSettings;
use crate::context::{Context, Failure, Result};
use crate::frames::GatewayOptions;
use crate::output::confirm;

#[derive(Debug, Args)]
pub struct MotionArguments {
    #[command(flatten)]
    axis: AxisOptions,
    #[command(flatten)]
    pub limits: LimitArguments,
    #[command(flatten)]
    pub permission: PermissionArguments,
    #[command(flatten)]
    options: GatewayOptions,
}

impl MotionArguments {
    /// The axis; its positions need a scale.
    pub fn choose(&self, context: &Context) -> Result<ChosenAxis> {
        self.axis.choose(self.options.setup.config.as_deref(), true, context)
    }

    /// The limits of the command within those of the axis.
    pub fn envelope(&self, chosen: &ChosenAxis) -> Result<Envelope> {
        self.limits.envelope(&chosen.units, &chosen.config).map_err(Failure::Usage)
    }

    /// Settings of the session; `is_interactive` if an operator ends it.
    pub fn settings(
        &self,
        mode: OperatingMode,
        envelope: Envelope,
        is_interactive: bool,
    ) -> SessionSettings<'_> {
        SessionSettings {
            options: &self.options,
            mode: Some(mode),
            envelope: Some(envelope),
            clock: clock_kind(is_interactive),
            accepts_risk: self.permission.accepts_risk(),
        }
    }
}

#[derive(Clone, Copy, Debug, Args)]
#[command(next_help_heading = "Permission")]
pub struct PermissionArguments {
    /// Move without asking
    #[arg(long)]
    yes: bool,
    /// Move although standard input is neither a terminal nor a pipe, whose end stops the axis
    #[arg(long)]
    unattended: bool,
    /// Enable a drive whose motor would not stop if this host failed
    #[arg(long)]
    accept_risk: bool,
    /// Reset a fault of the drive first
    #[arg(long)]
    reset_fault: bool,
    #[command(flatten)]
    keys: KeyArguments,
    /// Move only while any key is held; `jog` always does
    #[arg(long)]
    hold_key: bool,
}

#[derive(Clone, Copy, Debug, Args)]
pub struct KeyArguments {
    /// Time without a repetition after which a key counts as released
    #[arg(long, value_name = "TIME", default_value = "200ms", value_parser = milliseconds::<u64>(50..=1_000))]
    key_timeout: u64,
}

impl PermissionArguments {
    /// Rejects a motion that no operator can stop, asks for confirmation, then watches the operator.
    pub fn obtain(&self, what: &str, label: &str) -> Result<Operator> {
        if input_kind() == InputKind::None && !self.unattended {
            return Err(Failure::Usage(format!(
                "cannot {what} {label} unattended: standard input is neither a terminal nor a pipe, so that \
                 its end cannot stop the axis; run on a terminal, or use --unattended"
            )));
        }
        if self.hold_key && input_kind() != InputKind::Terminal {
            return Err(Failure::Usage("--hold-key needs a terminal as standard input".to_owned()));
        }
        // A signal before this ends the program, and nothing has moved.
        confirm(
            self.yes,
            &format!("motion of {label}"),
            format_args!("This will {what} {label}, and its motor can move. Continue?"),
            "nothing was sent",
        )?;
        Operator::watch(Duration::from_millis(self.keys.key_timeout), self.hold_key)
    }

    pub fn holds_key(&self) -> bool {
        self.hold_key
    }

    pub fn resets_fault(&self) -> bool {
        self.reset_fault
    }

    pub fn accepts_risk(&self) -> bool {
        self.accept_risk
    }
}

/// Clock of a simulation that names none: real time on a terminal, where an operator reacts.
pub fn clock_kind(is_interactive: bool) -> ClockKind {
    match is_interactive || input_kind() == InputKind::Terminal {
        true => ClockKind::Real,
        false => ClockKind::Stepped,
    }
}
