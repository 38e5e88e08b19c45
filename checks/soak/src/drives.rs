//! The drives of a machine: their place in the scenario, the axes of the application, and what a drive may record.

use std::fmt::Write as _;

use ecan_canopen::{DriveState, NodeAddress, NodeId, OperatingMode, SyncConfig};
use ecan_cia402::{AxisConfig, AxisPhase, AxisRef, Cia402, Cia402Config, StopKind};
use ecan_mcan_port::{Cycle, Port, Received};
use ecan_sim::Simulation;
use fastrand::Rng;
use serde::{Deserialize, Serialize};

use crate::channel::Partner;
use crate::draw::{chance, pick};
use crate::machine::Machine;

/// Most drives of a channel: with SYNC, more than six frames per cycle cannot be paced.
pub const MOST_ON_CHANNEL: u8 = 5;
/// Most drives of a machine.
pub const MOST: u8 = 40;
/// Largest velocity of a target, increments per second.
const FASTEST: u64 = 100_000;
/// Friction that brings a motor without current to rest soon, increments per second squared.
const FRICTION: u32 = 15_000_000;
/// Range of the targets of profile position, increments.
const PROFILE_RANGE: i32 = 50_000;

/// Operating mode of the drives of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    Csp,
    Csv,
    Pp,
    Ip,
}

/// A command of the application to an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AxisCommand {
    Enable,
    Disable,
    QuickStop,
    Halt,
    ResetFault,
    Configure,
    FarTarget,
    StopAll,
}

impl AxisCommand {
    pub const ALL: [Self; 8] = [
        Self::Enable,
        Self::Disable,
        Self::QuickStop,
        Self::Halt,
        Self::ResetFault,
        Self::Configure,
        Self::FarTarget,
        Self::StopAll,
    ];
}

/// Addresses and modes of the drives.
pub fn drives(machine: &Machine) -> Vec<(NodeAddress, Mode)> {
    let mut drives = Vec::new();
    for (slave, gateway) in machine.gateway.iter().enumerate() {
        for channel in &gateway.channel {
            if let Partner::Drives { count, mode } = channel.partner {
                let nodes = (1..=count).filter_map(NodeId::from_raw);
                let address = |node| NodeAddress { slave, channel: channel.number, node };
                drives.extend(nodes.map(|node| (address(node), mode)));
            }
        }
    }
    drives
}

/// Name of a drive in the scenario.
pub fn name(address: &NodeAddress) -> String {
    let NodeAddress { slave, channel, node } = address;
    format!("drive {slave}.{channel}/{node}")
}

/// The drives as tables of a scenario file.
pub fn scenario_text(machine: &Machine) -> String {
    let mut text = String::new();
    for (n, (address, _)) in drives(machine).iter().enumerate() {
        let NodeAddress { slave, channel, node } = address;
        // infallible: writing to a string
        let _ = write!(
            text,
            "\n[[node]]\nkind = \"drive\"\nbus = \"{slave}.{channel}\"\nname = \"{}\"\nnode_id = {node}\n\
             serial = {}\nmotor = {{ start_position = {}, friction = {FRICTION} }}\n",
            name(address),
            n + 1,
            1_000 * n,
        );
    }
    text
}

/// Cycles from one SYNC to the next in which a channel carries the frames of its drives.
pub fn sync_cycles(count: u8, bitrate: u32, cycle_us: u32) -> u32 {
    // A target and a TPDO of each drive, SYNC, and two thirds for everything else.
    let bits = (2 * u64::from(count) + 1) * crate::channel::FRAME_BITS * 5 / 3;
    let us = bits * 1_000_000 / u64::from(bitrate);
    us.div_ceil(u64::from(cycle_us)).max(1) as u32
}

/// The number of cycles, or a few more, whose time 0x60C2 can have as interpolation time.
pub fn with_interpolation_time(mut cycles: u32, cycle_us: u32) -> u32 {
    let has_value = |us: u32| {
        let units = [1, 10, 100, 1_000];
        units.iter().any(|unit| us.is_multiple_of(*unit) && us / unit <= u32::from(u8::MAX))
    };
    while !has_value(cycles * cycle_us) {
        cycles += 1;
    }
    cycles
}

/// Configuration of the axes.
pub fn configs(machine: &Machine) -> (Vec<AxisConfig>, Cia402Config) {
    let table = Cia402Config {
        sync: SyncConfig { every_cycles: machine.sync_cycles, ..SyncConfig::default() },
        ..Cia402Config::default()
    };
    let period_us = u64::from(machine.cycle_us) * u64::from(table.target_cycles());
    let step = (FASTEST * period_us / 1_000_000).max(2) as u32;
    let axis = |(address, mode): &(NodeAddress, Mode)| {
        let axis = AxisConfig::new(*address);
        match mode {
            Mode::Csp => axis.with_mode(OperatingMode::CyclicPosition).with_step_limit(step),
            Mode::Ip => axis.with_mode(OperatingMode::InterpolatedPosition).with_step_limit(step),
            Mode::Pp => axis.with_mode(OperatingMode::ProfilePosition).with_step_limit(step),
            Mode::Csv => AxisConfig {
                bounds: Some((-(FASTEST as i32), FASTEST as i32)),
                ..axis.with_mode(OperatingMode::CyclicVelocity).with_step_limit(5_000)
            },
        }
    };
    (drives(machine).iter().map(axis).collect(), table)
}

/// The axes of the application.
pub struct Axes {
    drives: Vec<(NodeAddress, Mode)>,
    config: (Vec<AxisConfig>, Cia402Config),
    /// Direction of each axis.
    directions: Vec<i32>,
    cia402: Option<Cia402>,
}

impl Axes {
    pub fn new(machine: &Machine) -> Self {
        let drives = drives(machine);
        let directions = vec![1; drives.len()];
        Self { config: configs(machine), directions, drives, cia402: None }
    }

    pub fn is_empty(&self) -> bool {
        self.drives.is_empty()
    }

    /// Begins to command the drives.
    pub fn open(&mut self, port: &Port) -> Result<(), String> {
        if !self.is_empty() {
            let (axes, table) = self.config.clone();
            self.cia402 = Some(Cia402::new(port, axes, table).map_err(|error| error.to_string())?);
        }
        Ok(())
    }

    /// The application ends, without a stop.
    pub fn close(&mut self) {
        self.cia402 = None;
    }

    pub fn is_open(&self) -> bool {
        self.cia402.is_some()
    }

    /// Receives; what belongs to no axis is passed to `other`.
    pub fn receive(&mut self, cycle: &mut Cycle<'_>, other: impl FnMut(Received)) {
        if let Some(cia402) = &mut self.cia402 {
            cia402.process_rx_with(cycle, other);
        }
    }

    /// Sets and sends a target for each axis.
    pub fn send(&mut self, cycle: &mut Cycle<'_>, r: &mut Rng) {
        let Some(cia402) = &mut self.cia402 else { return };
        let axes = self.drives.iter().zip(&self.config.0).zip(&mut self.directions);
        for (axis, (((_, mode), config), direction)) in axes.enumerate() {
            if r.u16(..500) == 0 {
                *direction = pick(r, &[-1, 0, 1]);
            }
            let Some(last) = cia402.axis(axis).and_then(AxisRef::target) else { continue };
            let step = *direction * config.step_limit as i32;
            let target = match mode {
                Mode::Csp | Mode::Ip => last.wrapping_add(step),
                Mode::Csv => last.saturating_add(step / 4).clamp(-(FASTEST as i32), FASTEST as i32),
                Mode::Pp if chance(r, 1) => r.i32(-PROFILE_RANGE..PROFILE_RANGE),
                Mode::Pp => continue,
            };
            // A rejected target is one that the axis does not follow.
            let _ = cia402.axis_mut(axis).and_then(|mut axis| axis.set_target(target));
        }
        cia402.send_targets_all(cycle);
    }

    pub fn command(&mut self, axis: usize, command: AxisCommand, r: &mut Rng) {
        let Some(cia402) = &mut self.cia402 else { return };
        // A rejected command is one more thing that happens.
        let _ = match command {
            AxisCommand::StopAll => cia402.command_all(stop(StopKind::QuickStopThenDisable)),
            command => cia402.axis_mut(axis).and_then(|mut axis| match command {
                AxisCommand::Enable => axis.enable(),
                AxisCommand::Disable => axis.command(stop(StopKind::Disable)),
                AxisCommand::QuickStop => axis.command(stop(StopKind::QuickStop)),
                AxisCommand::Halt => axis.command(ecan_cia402::AxisCommand::Halt),
                AxisCommand::ResetFault => axis.reset_fault(),
                AxisCommand::Configure => axis.configure(),
                AxisCommand::FarTarget => axis.set_target(r.i32(..)),
                AxisCommand::StopAll => Ok(()),
            }),
        };
    }

    /// As an operator does: brings every axis back.
    pub fn operate(&mut self) {
        let Some(cia402) = &mut self.cia402 else { return };
        for axis in 0..self.drives.len() {
            let is_free = |axis: AxisRef<'_>| {
                let is_busy = matches!(
                    axis.phase(),
                    AxisPhase::Running | AxisPhase::ChangingMode(_) | AxisPhase::Homing(_)
                );
                !is_busy && !axis.is_recovering()
            };
            if cia402.axis(axis).is_some_and(is_free) {
                let _ = cia402.axis_mut(axis).and_then(|mut axis| axis.recover());
            }
        }
    }

    /// Every axis follows targets; true without axes.
    pub fn all_running(&self) -> bool {
        self.cia402.as_ref().is_none_or(Cia402::all_running)
    }

    pub fn quick_stop(&mut self) {
        if let Some(cia402) = &mut self.cia402 {
            // infallible: any axis can be stopped
            let _ = cia402.command_all(stop(StopKind::QuickStop));
        }
    }

    /// Returns whether the application reports all axes as stopped, and no drive is enabled.
    pub fn all_stopped(&self, simulation: &Simulation) -> bool {
        let is_off = |(address, _): &(NodeAddress, Mode)| {
            drive_axis(simulation, address, |axis| {
                axis.statusword().state() != Some(DriveState::OperationEnabled)
            })
        };
        self.cia402.as_ref().is_none_or(Cia402::all_stopped)
            && self.drives.iter().all(|drive| is_off(drive).unwrap_or(true))
    }

    /// Position targets that a drive got are near its position: the first after enabling within twice the
    /// standstill window, all others within the following-error window.
    pub fn check(&self, simulation: &Simulation) -> Result<(), String> {
        for ((address, mode), config) in self.drives.iter().zip(&self.config.0) {
            if !matches!(mode, Mode::Csp | Mode::Ip) {
                continue;
            }
            let sums = drive_axis(simulation, address, |axis| *axis.targets().sums());
            let Some(sums) = sums else { continue };
            let (first, window) = (2 * config.standstill, config.following_window);
            if sums.largest_first_offset > first || sums.largest_offset > window {
                return Err(format!(
                    "{}: a target off the actual position by more than {first} (first) or {window}: {sums:?}",
                    name(address)
                ));
            }
        }
        Ok(())
    }

    /// State of the axes that do not run.
    pub fn status(&self) -> String {
        let Some(cia402) = &self.cia402 else { return String::new() };
        let waiting = cia402.axes().filter(|axis| !axis.is_running());
        waiting.map(|axis| format!("; {}", axis.progress())).collect()
    }
}

fn stop(kind: StopKind) -> ecan_cia402::AxisCommand {
    ecan_cia402::AxisCommand::Stop(kind)
}

fn drive_axis<T>(
    simulation: &Simulation,
    address: &NodeAddress,
    read: impl FnOnce(ecan_sim::DriveAxis<'_>) -> T,
) -> Option<T> {
    let NodeAddress { slave, channel, node } = *address;
    simulation.with_world(|world| {
        let drive = world.drive_at(slave, usize::from(channel), node)?;
        drive.axis(0).map(read)
    })
}
