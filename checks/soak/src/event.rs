//! What happens to the machine and to the application.

use ecan_sim::{DrawnValue, FaultDescription, FaultKind};
use fastrand::Rng;
use serde::{Deserialize, Serialize};

use crate::channel::Partner;
use crate::draw::{chance, pick, weighted};
use crate::drives::{self, AxisCommand};
use crate::firmware_update::FirmwareUpdate;
use crate::machine::Machine;
use crate::upkeep::Upkeep;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Event {
    /// Cycle of the application, from 0.
    pub cycle: u64,
    pub action: Action,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Action {
    Fault(Box<FaultDescription>),
    /// The application discards the pending frames of a gateway.
    Discard(usize),
    /// With the same configuration.
    Reconfigure,
    /// The process is suspended for this time, ms.
    Pause(u32),
    /// The process ends without a stop, and starts again after this time, ms.
    Restart(u32),
    /// Cycles in which the application takes no frames, or only some.
    LeaveFrames(u32),
    Axis {
        axis: usize,
        command: AxisCommand,
    },
    /// The process ends without a stop; a gateway executes a command; the process starts again.
    Upkeep {
        slave: usize,
        command: Upkeep,
    },
    Firmware {
        slave: usize,
        update: FirmwareUpdate,
    },
}

/// The events of a trial, in the order of their cycles.
pub fn draw(r: &mut Rng, machine: &Machine, cycles: u64) -> Vec<Event> {
    let mut events = Vec::new();
    let count = pick(r, &[0, 1, 2, 4, 8, 16]);
    while events.len() < count {
        let mut cycle = r.u64(..cycles);
        // Faults that overlap: several within 200 ms.
        for _ in 0..pick(r, &[1, 1, 1, 2, 3, 5]) {
            events.push(Event { cycle, action: Action::draw(r, machine) });
            cycle = (cycle + r.u64(..200_000 / u64::from(machine.cycle_us))).min(cycles - 1);
        }
    }
    events.sort_by_key(|event| event.cycle);
    events
}

impl Action {
    fn draw(r: &mut Rng, machine: &Machine) -> Self {
        let drives = drives::drives(machine);
        if !drives.is_empty() && chance(r, 30) {
            let axis = r.usize(..drives.len());
            return match chance(r, 50) {
                true => Self::Axis { axis, command: pick(r, &AxisCommand::ALL) },
                false => {
                    let drive = drives::name(&drives[axis].0);
                    Self::Fault(Box::new(fault(r, machine, Some(&drive))))
                }
            };
        }
        match r.u8(..20) {
            0 => Self::Discard(r.usize(..machine.gateway.len())),
            1 => Self::Reconfigure,
            2 | 3 => Self::Pause(r.u32(1..150)),
            4 => Self::Restart(r.u32(1..2_000)),
            5 => Self::LeaveFrames(r.u32(1..100)),
            6 if chance(r, 50) => Self::Upkeep {
                slave: r.usize(..machine.gateway.len()),
                command: pick(r, &Upkeep::ALL),
            },
            7 if chance(r, 50) => Self::Firmware {
                slave: r.usize(..machine.gateway.len()),
                update: FirmwareUpdate::draw(r),
            },
            _ => Self::Fault(Box::new(fault(r, machine, None))),
        }
    }
}

/// A fault of the machine, or of a drive with this name, at a random place.
fn fault(r: &mut Rng, machine: &Machine, drive: Option<&str>) -> FaultDescription {
    let slave = r.usize(..machine.gateway.len());
    let channel = pick(r, &machine.gateway[slave].channel.iter().collect::<Vec<_>>());
    let echo = (channel.partner == Partner::Echo)
        .then(|| format!("echo {}", Machine::bus(slave, channel)));
    let is_possible = |kind: FaultKind| match kind {
        FaultKind::IoPowerCycle => machine.has_io && drive.is_none(),
        FaultKind::NodeSilent => drive.is_some() || echo.is_some(),
        kind => kind.keys().contains(&"node") == drive.is_some(),
    };
    let kinds = FaultKind::ALL.iter().copied().filter(|kind| is_possible(*kind));
    let kinds: Vec<_> = kinds.filter_map(|kind| Some((kind.draw()?.weight, kind))).collect();
    let kind = weighted(r, &kinds);
    let mut text = format!("kind = \"{}\"\n", kind.name());
    for key in kind.keys() {
        let value = match *key {
            "gateway" => slave.to_string(),
            "channel" => channel.number.to_string(),
            "node" => format!("\"{}\"", drive.or(echo.as_deref()).unwrap_or_default()),
            _ => continue,
        };
        text += &format!("{key} = {value}\n");
    }
    for (key, values) in kind.draw().iter().flat_map(|draw| draw.values) {
        let value = match *values {
            DrawnValue::Between(first, end) => r.i64(first..end).to_string(),
            DrawnValue::OneOf(texts) => pick(r, texts).to_owned(),
        };
        text += &format!("{key} = {value}\n");
    }
    toml::from_str(&text).unwrap_or_else(|error| panic!("{text}\n{error}"))
}
