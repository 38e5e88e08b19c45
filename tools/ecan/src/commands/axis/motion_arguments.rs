//! Options that all motions of an axis have.

use clap::Args;
use ecan_canopen::OperatingMode;

use crate::context::{Context, Failure, Result};
use crate::frames::GatewayOptions;

use super::axis_choice::{AxisOptions, ChosenAxis};
use super::dead_man::{PermissionArguments, clock_kind};
use super::envelope::Envelope;
use super::limit_arguments::LimitArguments;
use super::session::SessionSettings;

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
