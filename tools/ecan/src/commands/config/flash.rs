//! `ecan config save`, `load` and `factory`: the Flash of a gateway (manual 13.7).

use ecan_config_file::{FlashCommand, FlashDone};
use ecan_host::MaintenanceError;
use serde::Serialize;

use crate::bus::Bus;
use crate::failure::Failure;
use crate::global::GlobalOptions;
use crate::output::Output;

#[derive(Debug, Serialize)]
struct Done {
    slave: usize,
    active_crc: u32,
    stored_crc: u32,
}

pub fn run(command: FlashCommand, global: &GlobalOptions, output: &Output) -> Result<(), Failure> {
    let bus = Bus::open(global, output)?;
    let slave = bus.slave()?;
    let FlashDone { active_crc, stored_crc } =
        command.run(bus.diagnostics(), slave, bus.clock()).map_err(|error| match error {
            MaintenanceError::Device(error) => Failure::Device(error),
            other => Failure::Refused(format!("slave {slave}: {other}")),
        })?;
    let done = Done { slave, active_crc, stored_crc };
    output.data(&done, |out| {
        let what = match command {
            FlashCommand::Save => "its configuration is saved in the Flash",
            FlashCommand::Load => "the saved configuration is loaded",
            FlashCommand::Factory => "the factory's configuration is restored, none is saved",
        };
        writeln!(
            out,
            "slave {slave}: {what} (CRC32 active 0x{active_crc:08X}, stored 0x{stored_crc:08X})"
        )
    })
}
