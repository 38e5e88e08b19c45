//! What happens to the machine and to the application.

use ecan_sim::FaultDescription;
use fastrand::Rng;
use serde::{Deserialize, Serialize};

use crate::channel::Partner;
use crate::draw::{chance, pick};
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
                false => Self::Fault(Box::new(drive_fault(r, &drives::name(&drives[axis].0)))),
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
            _ => Self::Fault(Box::new(fault(r, machine))),
        }
    }
}

fn drive_fault(r: &mut Rng, node: &str) -> FaultDescription {
    let keys = match r.u8(..7) {
        0 | 1 => format!("kind = \"node_silent\"\nfor_ms = {}", r.u32(1..800)),
        2 => format!("kind = \"drive_error\"\ncode = {}", pick(r, &[0x2310, 0x8611, 0x4210])),
        3 => "kind = \"drive_emcy\"\ncode = 0x4210\nregister = 9".to_owned(),
        4 => format!("kind = \"drive_power_cycle\"\noff_ms = {}", r.u32(1..500)),
        5 => format!("kind = \"drive_bus_off\"\nfor_ms = {}", r.u32(1..500)),
        _ => format!("kind = \"drive_blocked\"\nfor_ms = {}", r.u32(1..300)),
    };
    described(&format!("{keys}\nnode = \"{node}\"\n"))
}

fn described(text: &str) -> FaultDescription {
    toml::from_str(text).unwrap_or_else(|error| panic!("{text}\n{error}"))
}

fn fault(r: &mut Rng, machine: &Machine) -> FaultDescription {
    let slave = r.usize(..machine.gateway.len());
    let channel = pick(r, &machine.gateway[slave].channel.iter().collect::<Vec<_>>());
    let (number, bus) = (channel.number, Machine::bus(slave, channel));
    let gateway = format!("gateway = {slave}");
    let kind = |kind: &str, keys: String| format!("kind = \"{kind}\"\n{keys}");
    let way = pick(r, &["outward", "return"]);
    if machine.has_io && chance(r, 10) {
        return described(&kind("io_power_cycle", format!("off_ms = {}", r.u32(1..800))));
    }
    let text = match r.u8(..34) {
        0..6 => kind("lost_frame", format!("way = \"{way}\"\ncycles = {}", r.u32(1..30))),
        // A smaller offset would show a read without the write that took place.
        6..8 => kind("working_counter_offset", format!("offset = -3\ncycles = {}", r.u32(1..15))),
        8..11 => kind("power_cycle", format!("{gateway}\noff_ms = {}", r.u32(1..800))),
        11 => kind("power_off", gateway),
        12 => kind("power_on", gateway),
        13..16 => kind("link_loss", format!("{gateway}\nfor_ms = {}", r.u32(1..500))),
        16 => {
            let index = pick(r, &[0x8010, 0x8011, 0x8001, 0x8002, 0x8021, 0x1C12, 0xF000]);
            let code = pick(r, &[0x0503_0000_u32, 0x0504_0000, 0x0601_0002, 0x0800_0020]);
            let times = r.u32(1..4);
            kind(
                "sdo_abort",
                format!(
                    "{gateway}\nindex = {index}\nsubindex = {}\ncode = {code}\ntimes = {times}",
                    r.u8(..8)
                ),
            )
        }
        17 => {
            let index = pick(r, &[0x8010, 0x8011, 0x8001, 0x8002, 0x8021, 0xF000]);
            kind(
                "sdo_response_lost",
                format!("{gateway}\nindex = {index}\nsubindex = {}", r.u8(..8)),
            )
        }
        18 => kind("mailbox_timeout", format!("{gateway}\nfor_ms = {}", r.u32(1..800))),
        19 | 20 => kind("torn_image", format!("{gateway}\ntimes = {}", r.u32(1..6))),
        21 | 22 => kind("crc_error", format!("{gateway}\ntimes = {}", r.u32(1..6))),
        23 | 24 => {
            kind("al_error", format!("{gateway}\ncode = {}", pick(r, &[0x1A, 0x1B, 0x2C, 0x11])))
        }
        25 | 26 => kind("service_stall", format!("{gateway}\nfor_ms = {}", r.u32(1..60))),
        27 => kind("flash_failure", gateway),
        28 => kind("clock_jump", format!("{gateway}\nns = {}", r.i64(-3_000_000..3_000_000))),
        29 | 30 => kind("bus_off", format!("{gateway}\nchannel = {number}")),
        31 => {
            kind("error_frames", format!("{gateway}\nchannel = {number}\ntimes = {}", r.u32(1..40)))
        }
        32 if channel.partner == Partner::Echo => {
            kind("node_silent", format!("node = \"echo {bus}\"\nfor_ms = {}", r.u32(1..200)))
        }
        32 => kind("requests_held", format!("for_ms = {}", r.u32(1..400))),
        _ => {
            let call =
                pick(r, &["receive", "send", "domain_process", "domain_queue", "domain_state"]);
            let errno = if chance(r, 50) { "EINTR" } else { "EIO" };
            kind(
                "library_error",
                format!("call = \"{call}\"\nerrno = \"{errno}\"\ntimes = {}", r.u32(1..4)),
            )
        }
    };
    described(&text)
}
