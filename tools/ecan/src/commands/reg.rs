//! `ecan reg`: registers of the CAN controllers (manual 13.6).

use std::io::Write;

use clap::{Args, Subcommand};
use ecan_host::Maintenance;
use ecan_protocol::device::AccessMode;
use ecan_tool_support::diagnosis::registers::{self, REGISTERS, register, register_named};
use serde::Serialize;

use crate::context::{Bus, Context, Failure, Output, Result, Tone, note};
use crate::frames::ChannelArgument;
use crate::output;
use crate::value::parse_unsigned;

const OFFSETS: std::ops::RangeInclusive<u64> = 0x0004..=0x0404;
/// Attempts while the service is busy.
const TRIES: u32 = 20;
const PAUSE_NS: u64 = 5_000_000;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  ecan reg list
  ecan reg read PSR --channel 0
  ecan reg write IR 0xFFFFFFFF --channel 0       clear the interrupt flags

A write needs engineering mode (0xB000:01), which is requested and restored. Only registers of the
whitelist are writable. DBTP, NBTP, TDCR, GFC and XIDAM are writable only while CCCR has INIT and CCE
set, which disconnects the channel from the bus.")]
pub struct RegArguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Read a register
    Read {
        /// Name or offset of the register
        #[arg(value_parser = parse_offset)]
        register: u16,
        #[command(flatten)]
        channel: ChannelArgument,
    },
    /// Write a register of the whitelist
    Write {
        /// Name or offset of the register
        #[arg(value_parser = parse_offset)]
        register: u16,
        /// Value, 0 to 0xFFFFFFFF
        #[arg(value_parser = parse_value)]
        value: u32,
        #[command(flatten)]
        channel: ChannelArgument,
    },
    /// List the named registers and their access
    List,
}

fn parse_offset(text: &str) -> Result<u16, String> {
    if let Some(register) = register_named(text) {
        return Ok(register.offset);
    }
    let offset = parse_unsigned(text)
        .ok_or_else(|| format!("unknown register \"{text}\"; see `ecan reg list`"))?;
    match u16::try_from(offset) {
        Ok(it) if OFFSETS.contains(&offset) && it.is_multiple_of(4) => Ok(it),
        _ => Err("invalid offset; allowed: multiples of 4 from 0x0004 to 0x0404".to_owned()),
    }
}

fn parse_value(text: &str) -> Result<u32, String> {
    let value = parse_unsigned(text).ok_or_else(|| format!("invalid number \"{text}\""))?;
    u32::try_from(value).map_err(|_| format!("{text} is out of range; allowed: 0 to 0xFFFFFFFF"))
}

#[derive(Debug, Serialize)]
struct Reading {
    position: usize,
    channel: u8,
    offset: u16,
    name: Option<&'static str>,
    value: u32,
    words: Option<String>,
    /// Time of the access, from the gateway.
    timestamp: u64,
}

#[derive(Debug, Serialize)]
struct Listed {
    offset: u16,
    name: &'static str,
    description: &'static str,
    is_writable: bool,
}

pub fn run(arguments: &RegArguments, context: &Context) -> Result {
    match arguments.action {
        Action::List => list(&context.output),
        Action::Read { register, channel } => {
            let bus = context.bus()?;
            let service = Service { bus: &bus, slave: bus.slave()?, channel: channel.channel };
            let reading = service.read(register)?;
            context.output.data(&reading, |out| print(&reading, out))
        }
        Action::Write { register, value, channel } => {
            check_whitelist(register)?;
            let bus = context.bus()?;
            let service = Service { bus: &bus, slave: bus.slave()?, channel: channel.channel };
            let reading = service.write(register, value)?;
            context.output.data(&reading, |out| print(&reading, out))?;
            check_readback(&reading, value, &context.output)
        }
    }
}

fn list(output: &Output) -> Result {
    let listed: Vec<_> = REGISTERS
        .iter()
        .map(|register| Listed {
            offset: register.offset,
            name: register.name,
            description: register.description,
            is_writable: register.is_writable(),
        })
        .collect();
    output.data(&listed, |out| {
        output::print(out, &listed, |row| {
            let access = if row.is_writable { "rw" } else { "ro" };
            let description = row.description.to_owned();
            [format!("0x{:04X}", row.offset), row.name.to_owned(), access.to_owned(), description]
        })
    })
}

/// Checked here, although the gateway rejects it too: saves a change to engineering mode.
fn check_whitelist(offset: u16) -> Result {
    let known = register(offset);
    if known.is_some_and(|register| register.is_writable()) {
        return Ok(());
    }
    let name = known.map_or_else(|| format!("0x{offset:04X}"), |register| register.name.to_owned());
    let names: Vec<_> = REGISTERS
        .iter()
        .filter(|register| register.is_writable())
        .map(|register| register.name)
        .collect();
    Err(Failure::Usage(format!(
        "{name} is not writable (manual 13.6); allowed: {}",
        names.join(", ")
    )))
}

/// Warns if a plain register does not contain the written value.
fn check_readback(reading: &Reading, written: u32, output: &Output) -> Result {
    // Commands, self-clearing flags, and registers with hardware bits.
    const COMMANDS: [&str; 8] = ["IR", "CCCR", "TEST", "RXF0A", "RXF1A", "TXBAR", "TXBCR", "TXEFA"];
    let name = reading.name.unwrap_or_default();
    if reading.value == written || COMMANDS.contains(&name) {
        return Ok(());
    }
    let words = format!(
        "{name} does not contain 0x{written:08X}: a protected register is writable only while CCCR has \
         INIT and CCE set, and reserved bits read 0"
    );
    note(output.toned(Tone::Warning, words));
    Err(Failure::ProblemsFound)
}

fn print(reading: &Reading, out: &mut dyn Write) -> std::io::Result<()> {
    let name = reading.name.unwrap_or("register");
    let Reading { channel, offset, value, .. } = reading;
    write!(out, "CAN{channel} {name} (0x{offset:04X}) = 0x{value:08X}")?;
    match &reading.words {
        Some(words) => writeln!(out, ": {words}"),
        None => writeln!(out),
    }
}

enum Answer {
    Done,
    /// Access mode required.
    Denied,
}

struct Service<'a> {
    bus: &'a Bus,
    slave: usize,
    channel: u8,
}

impl Service<'_> {
    fn object(&self) -> u16 {
        0xA000 + u16::from(self.channel)
    }

    fn get(&self, subindex: u8) -> Result<u32> {
        self.bus.read(self.slave, self.object(), subindex)
    }

    fn set(&self, subindex: u8, value: u32) -> Result {
        self.bus.write(self.slave, self.object(), subindex, value)
    }

    fn read(&self, offset: u16) -> Result<Reading> {
        self.set(1, offset.into())?;
        match self.command(1)? {
            Answer::Done => self.reading(offset),
            Answer::Denied => self.in_engineering_mode(|| {
                self.check_permitted(1)?;
                self.reading(offset)
            }),
        }
    }

    fn write(&self, offset: u16, value: u32) -> Result<Reading> {
        self.in_engineering_mode(|| {
            self.set(1, offset.into())?;
            self.set(4, value)?;
            self.check_permitted(2)?;
            self.read(offset)
        })
    }

    fn reading(&self, offset: u16) -> Result<Reading> {
        let value = self.get(5)?;
        let timestamp = u64::from(self.get(6)?) | u64::from(self.get(7)?) << 32;
        Ok(Reading {
            position: self.slave,
            channel: self.channel,
            offset,
            name: register(offset).map(|register| register.name),
            value,
            words: registers::text(offset, value),
            timestamp,
        })
    }

    fn command(&self, command: u32) -> Result<Answer> {
        for _ in 0..TRIES {
            self.set(2, command)?;
            match self.get(3)? {
                0 => return Ok(Answer::Done),
                1 => return Err(rejection("unknown offset")),
                2 => return Err(rejection("register not in the whitelist of the gateway")),
                3 => self.bus.sleep_ns(PAUSE_NS),
                4 => return Ok(Answer::Denied),
                other => return Err(rejection(&format!("unknown status {other}"))),
            }
        }
        Err(rejection("still busy"))
    }

    fn check_permitted(&self, command: u32) -> Result {
        match self.command(command)? {
            Answer::Done => Ok(()),
            Answer::Denied => Err(rejection("access denied in engineering mode (0xB000:01)")),
        }
    }

    /// Runs an action in engineering mode and always restores the mode.
    fn in_engineering_mode<R>(&self, action: impl FnOnce() -> Result<R>) -> Result<R> {
        Maintenance::new(self.bus.diagnostics(), self.slave)
            .in_mode(AccessMode::Engineering, action)
    }
}

fn rejection(reason: &str) -> Failure {
    Failure::Rejected(format!("register service: {reason}"))
}

#[cfg(test)]
mod tests {
    use ecan_sim::{ClockKind, SimOptions};

    use super::*;

    fn with_bus(test: impl FnOnce(&Bus)) {
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &options).unwrap();
        test(&Bus::over(&backend.ecrt));
    }

    fn mode(bus: &Bus) -> u32 {
        bus.read(0, 0xB000, 2).unwrap()
    }

    #[test]
    fn engineering_mode_is_restored() {
        with_bus(|bus| {
            let service = Service { bus, slave: 0, channel: 0 };
            assert_eq!(service.write(0x54, 5).unwrap().value, 5);
            assert_eq!(mode(bus), 0, "restored after the write");
            // A rejected write restores it too.
            let rejected = service.write(0x44, 5).unwrap_err();
            assert!(
                rejected.to_string().contains("not in the whitelist of the gateway"),
                "{rejected}"
            );
            assert_eq!(rejected.status(), 5);
            assert_eq!(mode(bus), 0);
            // A mode set by another program is kept.
            bus.write(0, 0xB000, 1, 2).unwrap();
            service.write(0x54, 6).unwrap();
            assert_eq!(mode(bus), 2);
        });
    }

    #[test]
    fn protected_register_needs_init_and_cce() {
        with_bus(|bus| {
            let service = Service { bus, slave: 0, channel: 0 };
            assert_eq!(service.write(0x80, 0x3F).unwrap().value, 0, "kept");
            service.write(0x18, 0b11).unwrap();
            assert_eq!(service.write(0x80, 0x3F).unwrap().value, 0x3F);
        });
    }
}
