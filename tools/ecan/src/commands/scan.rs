//! `ecan scan`: slaves of the bus.

use std::io::Write;

use ecan_host::{Error, SlaveKind};
use ecan_protocol::device::AlState;
use serde::Serialize;

use crate::context::{Context, Output, Result, Tone};
use crate::output;
use crate::slave_choice::Unknown;

#[derive(Debug, Serialize)]
struct Found {
    position: u16,
    alias: u16,
    state: String,
    has_error_flag: bool,
    name: String,
    vendor_id: u32,
    product_code: u32,
    revision: u32,
    /// `None` if the slave cannot be identified.
    is_gateway: Option<bool>,
    unknown: Option<String>,
    serial: Option<u64>,
    firmware: Option<String>,
    hardware: Option<String>,
}

pub fn run(context: &Context) -> Result {
    let bus = context.bus()?;
    let chosen = if bus.is_chosen() { Some(bus.slave()?) } else { None };
    let mut found = Vec::new();
    let kinds = bus.kinds().into_iter();
    for (slave, (info, kind)) in bus.slaves()?.into_iter().zip(kinds).enumerate() {
        if chosen.is_some_and(|chosen| chosen != slave) {
            continue;
        }
        let is_gateway = kind.is_gateway();
        let unknown = match kind {
            SlaveKind::Unknown(why) => Some(why.to_string()),
            SlaveKind::Gateway | SlaveKind::Other => None,
        };
        let text = |index| if is_gateway { bus.text(slave, index).ok() } else { None };
        let state = AlState::from_status(info.al_state.into());
        found.push(Found {
            position: info.position,
            alias: info.alias,
            state: state
                .map_or_else(|| format!("{:#04x}", info.al_state), |state| state.to_string()),
            has_error_flag: info.error_flag,
            vendor_id: info.vendor_id,
            product_code: info.product_code,
            revision: info.revision_number,
            is_gateway: unknown.is_none().then_some(is_gateway),
            unknown,
            serial: if is_gateway { bus.serial(slave).ok() } else { None },
            firmware: text(0x100A),
            hardware: text(0x1009),
            name: info.name,
        });
    }
    context.output.data(&found, |out| print(&found, &context.output, out))?;
    if found.is_empty() { Err(Error::NoSlaves.into()) } else { Ok(()) }
}

fn print(found: &[Found], output: &Output, out: &mut dyn Write) -> std::io::Result<()> {
    if found.is_empty() {
        return Ok(());
    }
    let titles = ["POS", "ALIAS", "STATE", "NAME", "FIRMWARE", "HARDWARE", "SERIAL", "IDENTITY"];
    let or_dash = |text: Option<String>| text.unwrap_or_else(|| "-".to_owned());
    output::print_with_titles(out, titles, found, |slave| {
        [
            slave.position.to_string(),
            if slave.alias == 0 { "-".to_owned() } else { slave.alias.to_string() },
            format!("{}{}", slave.state, if slave.has_error_flag { " E" } else { "" }),
            slave.name.clone(),
            or_dash(slave.firmware.clone()),
            or_dash(slave.hardware.clone()),
            or_dash(slave.serial.map(|serial| serial.to_string())),
            format!(
                "0x{:08X} 0x{:08X} 0x{:08X}",
                slave.vendor_id, slave.product_code, slave.revision
            ),
        ]
    })?;
    for slave in found {
        if let Some(reason) = slave.unknown.clone() {
            let message = Unknown { position: slave.position.into(), reason };
            writeln!(out, "{}", output.toned(Tone::Warning, message))?;
        }
    }
    if found.iter().any(|slave| slave.has_error_flag) {
        let message = "E: error flag set, the master keeps the slave in this state";
        writeln!(out, "{}", output.toned(Tone::Bad, message))?;
    }
    Ok(())
}
