//! `ecan pins`: connector of each CAN channel (manual 13.3).

use std::io::Write;

use clap::Args;
use ecan_protocol::device::AlState;
use ecan_protocol::mapping::CHANNELS;
use serde::Serialize;

use crate::context::{Bus, Context, Failure, Result};
use crate::output;

const SYSTEM: u16 = 0x8000;
const REQUESTED: u8 = 12;
const ACTIVE: u8 = 13;
const MASK: u8 = 14;
const STATUS: u8 = 15;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  ecan pins                    show the active rotation
  ecan pins 1                  rotate by one: CAN0 uses the pins of CAN1

The manual does not state when a rotation takes effect (assumption H47): the command reads the active one
and fails if it is another. It cannot be changed in OP. To keep it, run `ecan config save`, or add
`pin_rotation` to [gateway.system] of the configuration file.")]
pub struct PinsArguments {
    /// Rotation of the channels over the pin groups, 0 to 3 [default: show it]
    rotation: Option<u8>,
}

#[derive(Debug, Serialize)]
struct Pins {
    position: usize,
    requested: u32,
    active: u32,
    supported: Vec<u32>,
    apply_status: u32,
    pin_groups: Vec<usize>,
}

pub fn run(arguments: &PinsArguments, context: &Context) -> Result {
    let bus = context.bus()?;
    let slave = bus.slave()?;
    if let Some(rotation) = arguments.rotation {
        set(&bus, slave, rotation.into())?;
    }
    let pins = read(&bus, slave)?;
    context.output.data(&pins, |out| print(&pins, out))
}

fn read(bus: &Bus, slave: usize) -> Result<Pins> {
    let value = |subindex| bus.read(slave, SYSTEM, subindex);
    let (active, mask) = (value(ACTIVE)?, value(MASK)?);
    Ok(Pins {
        position: slave,
        requested: value(REQUESTED)?,
        active,
        supported: (0..8).filter(|bit| mask >> bit & 1 == 1).collect(),
        apply_status: value(STATUS)?,
        pin_groups: (0..CHANNELS).map(|channel| (channel + active as usize) % CHANNELS).collect(),
    })
}

fn set(bus: &Bus, slave: usize, rotation: u32) -> Result {
    let supported = read(bus, slave)?.supported;
    if !supported.contains(&rotation) {
        let known: Vec<_> = supported.iter().map(ToString::to_string).collect();
        let message =
            format!("rotation {rotation} is not supported; allowed: {}", known.join(", "));
        return Err(Failure::Usage(message));
    }
    bus.write(slave, SYSTEM, REQUESTED, rotation)?;
    let pins = read(bus, slave)?;
    if pins.apply_status == 0 && pins.active == rotation {
        return Ok(());
    }
    let is_in_op = bus.diagnostics().al_state(slave).is_ok_and(|state| state == Some(AlState::Op));
    let hint = match pins.apply_status {
        _ if is_in_op => "; the gateway is in OP, stop the application first",
        0 => {
            "; the firmware may activate it with the next apply command of a channel (0x8001:01), or at its \
             start after `ecan config save` and `ecan reboot` (assumption H47)"
        }
        _ => "",
    };
    Err(Failure::Rejected(format!(
        "rotation not applied: status {} (0x8000:15), active rotation {}{hint}",
        pins.apply_status, pins.active
    )))
}

fn print(pins: &Pins, out: &mut dyn Write) -> std::io::Result<()> {
    let known: Vec<_> = pins.supported.iter().map(ToString::to_string).collect();
    let rows = [
        ["rotation".to_owned(), format!("{} of {}", pins.active, known.join(", "))],
        ["requested".to_owned(), format!("{}, apply status {}", pins.requested, pins.apply_status)],
    ];
    let groups = pins.pin_groups.iter().enumerate();
    let groups = groups.map(|(channel, it)| [format!("CAN{channel}"), format!("pin group {it}")]);
    output::print(out, rows.into_iter().chain(groups), |row| row)
}
