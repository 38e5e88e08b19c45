//! Search for LSS slaves.

use std::io::{self, Write};
use std::str::FromStr;

use clap::Args;
use ecan_canopen::{FastscanFilter, LssAddress, LssAddressRange, LssCommand, LssFault, LssResult};
use ecan_tool_support::command_line::options::milliseconds;
use serde::Serialize;

use super::lss_client::{JsonAddress, LssClient, LssOptions};
use crate::context::{Context, Failure, Result};
use crate::output;
use crate::output::Progress;
use crate::value::parse_unsigned;

#[derive(Debug, Args)]
pub struct ScanArguments {
    /// Only this vendor-ID; a known part shortens the scan
    #[arg(long, value_name = "NUMBER", value_parser = number)]
    vendor: Option<u32>,
    /// Only this product code
    #[arg(long, value_name = "NUMBER", value_parser = number)]
    product: Option<u32>,
    /// Waiting time of each request; all slaves must respond within it
    /// [default: 25ms, through a service 50ms]
    #[arg(long, value_name = "TIME", value_parser = milliseconds::<u64>(1..=10_000))]
    scan_time: Option<u64>,
    #[command(flatten)]
    lss: LssOptions,
}

#[derive(Debug, Serialize)]
struct Scanned {
    slave: usize,
    channel: u8,
    found: Vec<JsonAddress>,
    /// False if a slave was found twice, so that further ones are not found.
    is_complete: bool,
}

/// Most slaves of a bus (CiA 301): a slave that does not enter the configuration state would be found
/// again and again.
const MOST: usize = 127;
/// Repetitions of a scan in which a response was lost or late.
const RETRIES: u32 = 2;

pub fn scan(arguments: &ScanArguments, context: &Context) -> Result {
    let context = &context.on_stderr(arguments.lss.options.capture.is_on_output());
    let filter = FastscanFilter {
        vendor: arguments.vendor,
        product: arguments.product,
        ..FastscanFilter::default()
    };
    let client = LssClient::start(&arguments.lss, arguments.scan_time, context)?;
    let (slave, channel) = (client.slave(), arguments.lss.channel);
    let (found, is_complete) = client.run(|client| {
        let _progress = Progress::show("scanning for slaves without node-ID");
        client.release()?;
        let scanned = scan_all(client, filter, context);
        // A slave that was found is in the configuration state.
        let released = client.release();
        if scanned.as_ref().is_ok_and(|found| found.0.is_empty()) {
            client.check_alive()?;
        }
        scanned.and_then(|found| released.map(|()| found))
    })?;
    let addresses = found.iter().copied().map(JsonAddress::from).collect();
    let scanned = Scanned { slave, channel, found: addresses, is_complete };
    context.output.data(&scanned, |out| print_scan(&found, &scanned, out))?;
    match found.last() {
        None => Err(Failure::Incomplete("no slave without node-ID found".to_owned())),
        Some(_) if is_complete => Ok(()),
        Some(last) => Err(Failure::Incomplete(format!(
            "the slave {last} was found twice: it takes part in the scan while selected, or two slaves \
             have this address; configure its node-ID, then scan again"
        ))),
    }
}

/// The slaves, and whether all were found: the last one may be found again.
fn scan_all(
    client: &mut LssClient,
    filter: FastscanFilter,
    context: &Context,
) -> Result<(Vec<LssAddress>, bool)> {
    let mut found: Vec<LssAddress> = Vec::new();
    while let LssResult::Address(address) = scan_one(client, filter, context)? {
        if found.last() == Some(&address) || found.len() >= MOST {
            return Ok((found, false));
        }
        context.output.progress(format_args!("# found {address}"));
        found.push(address);
    }
    Ok((found, true))
}

/// Scans for one slave, again if a response was lost or late.
fn scan_one(
    client: &mut LssClient,
    filter: FastscanFilter,
    context: &Context,
) -> Result<LssResult> {
    let command = LssCommand::Fastscan(filter);
    for _ in 0..RETRIES {
        match client.try_command(command)? {
            Err(fault @ LssFault::Inconsistent { .. }) => {
                context.output.progress(format_args!("# {fault}"));
            }
            other => return other.map_err(|fault| client.failure(command, fault)),
        }
    }
    client.command(command)
}

fn print_scan(found: &[LssAddress], scanned: &Scanned, out: &mut dyn Write) -> io::Result<()> {
    if !found.is_empty() {
        output::print_with_titles(
            out,
            ["VENDOR", "PRODUCT", "REVISION", "SERIAL", "ADDRESS"],
            found,
            |LssAddress { vendor, product, revision, serial }| {
                [
                    format!("0x{vendor:08X}"),
                    format!("0x{product:08X}"),
                    format!("0x{revision:08X}"),
                    serial.to_string(),
                    format!("0x{vendor:X}:0x{product:X}:0x{revision:X}:{serial}"),
                ]
            },
        )?;
        writeln!(out)?;
    }
    let (slave, channel, count) = (scanned.slave, scanned.channel, found.len());
    writeln!(out, "slave {slave} can{channel}: {count} slave(s) without node-ID")
}

fn number(text: &str) -> Result<u32, String> {
    let number = parse_unsigned(text).and_then(|number| u32::try_from(number).ok());
    number.ok_or_else(|| "expected a number of 32 bits, decimal or hexadecimal with 0x".to_owned())
}

/// `NUMBER` or `FIRST-LAST`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct NumberRange(u32, u32);

impl FromStr for NumberRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (first, last) = text.split_once('-').unwrap_or((text, text));
        let (first, last) = (number(first)?, number(last)?);
        match first <= last {
            true => Ok(Self(first, last)),
            false => Err(format!("{first} is above {last}; expected FIRST-LAST")),
        }
    }
}

#[derive(Debug, Args)]
pub struct IdentifyArguments {
    /// Vendor-ID; without it slaves without node-ID are asked
    #[arg(long, value_name = "NUMBER", value_parser = number, requires = "product")]
    vendor: Option<u32>,
    /// Product code
    #[arg(long, value_name = "NUMBER", value_parser = number, requires = "vendor")]
    product: Option<u32>,
    /// Revision number, or FIRST-LAST [default: any]
    #[arg(long, value_name = "RANGE", requires = "vendor")]
    revision: Option<NumberRange>,
    /// Serial number, or FIRST-LAST [default: any]
    #[arg(long, value_name = "RANGE", requires = "vendor")]
    serial: Option<NumberRange>,
    #[command(flatten)]
    lss: LssOptions,
}

#[derive(Debug, Serialize)]
struct Identified {
    slave: usize,
    channel: u8,
    found: bool,
}

pub fn identify(arguments: &IdentifyArguments, context: &Context) -> Result {
    let context = &context.on_stderr(arguments.lss.options.capture.is_on_output());
    let command = match (arguments.vendor, arguments.product) {
        (Some(vendor), Some(product)) => {
            let mut range = LssAddressRange::of_product(vendor, product);
            let pair =
                |range: Option<NumberRange>| range.map(|NumberRange(first, last)| (first, last));
            range.revision = pair(arguments.revision).unwrap_or(range.revision);
            range.serial = pair(arguments.serial).unwrap_or(range.serial);
            LssCommand::Identify(range)
        }
        _ => LssCommand::IdentifyNonConfigured,
    };
    let client = LssClient::start(&arguments.lss, None, context)?;
    let (slave, channel) = (client.slave(), arguments.lss.channel);
    let found = client.run(|client| Ok(client.command(command)? == LssResult::Found))?;
    let what = match command {
        LssCommand::IdentifyNonConfigured => "without node-ID",
        _ => "in the range",
    };
    let identified = Identified { slave, channel, found };
    context.output.data(&identified, |out| match found {
        true => writeln!(out, "slave {slave} can{channel}: at least one slave {what} responds"),
        false => writeln!(out, "slave {slave} can{channel}: no slave {what} responds"),
    })?;
    match found {
        true => Ok(()),
        false => Err(Failure::Incomplete(format!("no slave {what} found"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn range_is_one_number_or_two() {
        assert_eq!("7".parse(), Ok(NumberRange(7, 7)));
        assert_eq!("0x10-0x20".parse(), Ok(NumberRange(16, 32)));
        for wrong in ["", "2-1", "1-", "x"] {
            assert!(wrong.parse::<NumberRange>().is_err(), "{wrong}");
        }
    }
}
