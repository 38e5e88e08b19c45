//! Selection of an axis, and its configuration.

use std::path::Path;

use clap::Args;
use ecan_canopen::NodeAddress;
use ecan_cia402::{AxisConfig, Scale, ScaleSource};
use ecan_lite::config::NetworkSettings;
use ecan_protocol::text::Printable;

use super::envelope::parse_number;
use super::unit::{AxisUnits, Unit};
use crate::commands::node::node_target::{NodeIdArgument, NodeTarget};
use crate::config_file;
use crate::config_file::ConfiguredNodes;
use crate::context::{Context, Failure, GlobalOptions, Result};
use crate::frames::parse_channel;

/// Options that select one axis: of a file, or a node.
#[derive(Clone, Debug, Args)]
pub struct AxisOptions {
    /// Axis of the configuration file: name of its node, or index
    #[arg(long, value_name = "NAME|N", requires = "config", conflicts_with = "node")]
    axis: Option<String>,
    /// Node-ID of the drive, 1 to 127, or CHANNEL.ID
    #[arg(long, value_name = "ID", required_unless_present = "axis", conflicts_with = "config")]
    node: Option<NodeIdArgument>,
    /// CAN channel, 0 to 3 [default: 0]
    #[arg(long, value_name = "N", value_parser = parse_channel, conflicts_with = "config")]
    channel: Option<u8>,
    /// Axis of a drive with several, 0 to 7
    #[arg(long, value_name = "N", default_value_t, conflicts_with = "config",
          value_parser = clap::value_parser!(u8).range(0..=7))]
    node_axis: u8,
    /// Steps of the position counter per turn of the axis; below 0 reverses the direction
    #[arg(long, value_name = "STEPS", value_parser = parse_number, allow_hyphen_values = true,
          conflicts_with = "config")]
    steps_per_turn: Option<f64>,
    /// Velocity of the drive (0x60FF, 0x6081, 0x6099) at one turn/s [default: steps/s]
    #[arg(long, value_name = "VELOCITY", value_parser = parse_number, allow_hyphen_values = true,
          conflicts_with = "config")]
    velocity_units: Option<f64>,
    /// Unit of positions, and with /s and /s^2 of velocities and accelerations
    #[arg(long, value_enum, default_value_t, value_name = "UNIT")]
    unit: Unit,
}

/// An axis with its configuration.
#[derive(Clone, Debug)]
pub struct ChosenAxis {
    /// Name for messages: `axis elbow (node 2 on can0)`.
    pub label: String,
    pub target: NodeTarget,
    /// As in the file, or the defaults; its slave is the only gateway of the command.
    pub config: AxisConfig,
    /// Table `[network]` of the file, or the defaults.
    pub network: NetworkSettings,
    pub units: AxisUnits,
    /// Options that select the gateway of the axis.
    pub global: GlobalOptions,
}

impl ChosenAxis {
    /// A context that uses the gateway of the axis.
    pub fn context<'a>(&'a self, context: &Context<'a>) -> Context<'a> {
        Context { global: &self.global, ..*context }
    }
}

impl AxisOptions {
    /// The axis; `needs_scale` if positions are used.
    pub fn choose(
        &self,
        file: Option<&Path>,
        needs_scale: bool,
        context: &Context,
    ) -> Result<ChosenAxis> {
        match (file, &self.axis, self.node) {
            (Some(path), Some(axis), _) => self.of_file(path, axis, context),
            (_, _, Some(node)) => self.of_node(node, needs_scale, context),
            _ => {
                Err(Failure::Usage("no axis selected; set --axis with --config, or --node".into()))
            }
        }
    }

    fn of_node(
        &self,
        node: NodeIdArgument,
        needs_scale: bool,
        context: &Context,
    ) -> Result<ChosenAxis> {
        let target = node.on(self.channel)?;
        let steps = match (self.steps_per_turn, self.unit) {
            (Some(steps), _) => steps,
            (None, Unit::Step) => 1.0,
            (None, _) if !needs_scale => 0.0,
            (None, unit) => {
                return Err(Failure::Usage(format!(
                    "positions in {unit} need --steps-per-turn; set it, or use --unit step"
                )));
            }
        };
        let mut scale = Scale::steps_per_turn(steps);
        // Without a scale there are positions in steps only.
        let unit = if scale.is_valid() { self.unit } else { Unit::Step };
        if self.steps_per_turn.is_some() && !scale.is_valid() {
            return Err(Failure::Usage("--steps-per-turn 0 is invalid; must not be 0".into()));
        }
        if !scale.is_valid() {
            scale = Scale::default();
        }
        if let Some(velocity) = self.velocity_units {
            // Without a scale a turn is a step.
            scale = scale.with_velocity_units(velocity);
        }
        let scale_source = match self.steps_per_turn {
            Some(_) => ScaleSource::Checked,
            None => ScaleSource::Configured,
        };
        let NodeTarget { channel, node } = target;
        let address = NodeAddress { slave: 0, channel, node };
        Ok(ChosenAxis {
            label: match self.node_axis {
                0 => target.to_string(),
                axis => format!("axis {axis} of {target}"),
            },
            target,
            config: AxisConfig {
                node_axis: self.node_axis,
                scale,
                scale_source,
                ..AxisConfig::new(address)
            },
            network: NetworkSettings::default(),
            units: AxisUnits::new(unit, scale, 0),
            global: context.global.clone(),
        })
    }

    fn of_file(&self, path: &Path, axis: &str, context: &Context) -> Result<ChosenAxis> {
        let file = ConfiguredNodes::load(path)?;
        let axes = ecan_lite::config::load_axes(path).map_err(config_file::failure)?;
        let network =
            ecan_lite::config::load_network_settings(path).map_err(config_file::failure)?;
        let names = ecan_lite::config::load_axis_names(path).map_err(config_file::failure)?;
        let index = find(axis, &names).map_err(|error| {
            Failure::Usage(format!(
                "--axis {axis}: {error}; axes of {}: {}",
                Printable(path.display()),
                list(&names)
            ))
        })?;
        let mut config = axes.into_iter().nth(index).ok_or_else(|| {
            Failure::Usage(format!("--axis {axis}: {} has no axes", Printable(path.display())))
        })?;
        context.global.without_slave("the axis determines its gateway")?;
        let mut global = context.global.clone();
        global.master = Some(config_file::master(file.config(), context.global));
        global.slave = file.slave_of(config.address.slave)?;
        config.address.slave = 0;
        let NodeAddress { channel, node, .. } = config.address;
        let target = NodeTarget { channel, node };
        let name = names.get(index).cloned().flatten().unwrap_or_else(|| index.to_string());
        let origin = config.scale.from_degrees(0.0, config.range).unwrap_or(0);
        Ok(ChosenAxis {
            label: format!("axis {name} ({target})"),
            target,
            units: AxisUnits::new(self.unit, config.scale, origin),
            config,
            network,
            global,
        })
    }
}

/// Index of an axis by its name or number.
fn find(axis: &str, names: &[Option<String>]) -> Result<usize, String> {
    let mut named = names.iter().enumerate().filter(|(_, name)| name.as_deref() == Some(axis));
    match (named.next(), named.next(), axis.parse::<usize>()) {
        (Some((index, _)), None, _) => Ok(index),
        (Some(_), Some(_), _) => Err("several axes have this name; use the index".to_owned()),
        (None, _, Ok(index)) if index < names.len() => Ok(index),
        (None, ..) => Err("no such axis".to_owned()),
    }
}

fn list(names: &[Option<String>]) -> String {
    let entries: Vec<_> = names
        .iter()
        .enumerate()
        .map(|(index, name)| match name {
            Some(name) => format!("{index} ({name})"),
            None => index.to_string(),
        })
        .collect();
    if entries.is_empty() { "none".to_owned() } else { entries.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axis_is_found_by_name_or_index() {
        let name = |name: &str| Some(name.to_owned());
        let names = [name("elbow"), None, name("wheel"), name("wheel"), name("1")];
        assert_eq!(find("elbow", &names), Ok(0));
        assert_eq!(find("2", &names), Ok(2));
        assert_eq!(find("1", &names), Ok(4), "names come first");
        assert!(find("wheel", &names).unwrap_err().contains("use the index"));
        assert_eq!(find("5", &names), Err("no such axis".to_owned()));
        assert_eq!(list(&names), "0 (elbow), 1, 2 (wheel), 3 (wheel), 4 (1)");
        assert_eq!(list(&[]), "none");
    }
}
