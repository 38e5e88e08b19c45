//! Reads or writes an object of a CANopen node through a gateway (manual 15.4).
//!
//! ```text
//! canopen_sdo_probe --ecrt sim --node 1 --index 0x1000 --sub 0
//! canopen_sdo_probe --ecrt sim --node 1 --index 0x6081 --sub 0 --type u32 --write 5000
//! ```

use std::error::Error;
use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;
use ecan_canopen::{Network, NetworkConfig, NodeAddress, NodeConfig, NodeId};
use ecan_example_support::MasterArguments;
use ecan_example_support::object_value::ValueType;
use ecan_example_support::{EXIT_STATUS, report_exit};
use ecan_lite::EcrtOptions;
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig};
use ecan_tool_support::command_line::options::parse_bit_rate;
use ecan_tool_support::command_line::screen::parse_arguments;
use ecan_tool_support::print_line;

/// PDO size per direction, in chunks of 128 bytes.
const PDO_N: u8 = 3;

/// Read or write an object of a CANopen node through an ECAN-Lite gateway
#[derive(Debug, Parser)]
#[command(name = "canopen_sdo_probe", version, after_help = EXIT_STATUS)]
struct Arguments {
    #[command(flatten)]
    master: MasterArguments,
    /// Position of the gateway
    #[arg(long, value_name = "N", default_value_t = 0)]
    slave: u16,
    /// CAN channel of the node
    #[arg(long, value_name = "CHANNEL", default_value_t = 0,
          value_parser = clap::value_parser!(u8).range(0..4))]
    channel: u8,
    /// Node-ID
    #[arg(long, value_name = "ID", value_parser = clap::value_parser!(u8).range(1..=127))]
    node: u8,
    /// Index of the object; hexadecimal with 0x
    #[arg(long, value_name = "INDEX", value_parser = parse_index)]
    index: u16,
    /// Subindex of the object
    #[arg(long, value_name = "SUB", default_value = "0", value_parser = parse_u8)]
    sub: u8,
    /// CAN bit rate in bit/s, or 500k, 1M
    #[arg(long, value_name = "BITRATE", default_value = "1M", value_parser = parse_bit_rate)]
    bitrate: u32,
    /// Type of the value: u8, u16, u32, u64, i8, i16, i32, i64, string or hex [default: shown as
    /// number and text]
    #[arg(long = "type", value_name = "TYPE")]
    value_type: Option<ValueType>,
    /// Write this value first; needs --type
    #[arg(long, value_name = "VALUE", requires = "value_type", allow_hyphen_values = true)]
    write: Option<String>,
    /// EtherCAT cycle
    #[arg(long, value_name = "US", default_value_t = 10_000)]
    cycle_us: u32,
    /// Timeout of the transfer
    #[arg(long, value_name = "MS", default_value_t = 5_000)]
    timeout_ms: u32,
}

fn parse_u16(text: &str) -> Result<u16, String> {
    let parsed = match text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        Some(digits) => u16::from_str_radix(digits, 16),
        None => text.parse(),
    };
    parsed.map_err(|_| "expected a number from 0 to 65535 (0xFFFF)".into())
}

/// The numbers of objects begin at 0x1000, so that four digits without 0x are read in two ways.
fn parse_index(text: &str) -> Result<u16, String> {
    let hexadecimal = u16::from_str_radix(text, 16).ok().filter(|meant| *meant >= 0x1000);
    match (hexadecimal, text.parse::<u16>()) {
        (Some(meant), Ok(read)) => Err(format!(
            "read as the decimal number of 0x{read:04X}; for the hexadecimal index 0x{meant:04X} \
             write 0x{text}, or 0x{read:04X} for the other"
        )),
        (Some(meant), Err(_)) => {
            Err(format!("index without prefix; for 0x{meant:04X} write 0x{text}"))
        }
        (None, _) => parse_u16(text),
    }
}

fn parse_u8(text: &str) -> Result<u8, String> {
    let number = parse_u16(text)?;
    u8::try_from(number).map_err(|_| "expected a number from 0 to 255".into())
}

fn main() -> ExitCode {
    report_exit("canopen_sdo_probe", run(&parse_arguments()))
}

fn run(arguments: &Arguments) -> Result<bool, Box<dyn Error>> {
    let written = match (&arguments.write, arguments.value_type) {
        (Some(text), Some(kind)) => Some(kind.encode(text)?),
        _ => None,
    };
    let mut adapter = arguments.master.adapter(1, PDO_N, arguments.cycle_us);
    adapter.slaves[0].position = arguments.slave;
    let backend = arguments.master.open("drives", EcrtOptions::for_gateways(&adapter))?;
    let channel = ChannelConfig::classic(arguments.bitrate);
    let config = PortConfig::uniform(1, GatewayConfig::on_channel(arguments.channel, channel));
    let mut port = Port::open(&backend.ecrt, (adapter, config))?;
    port.wait_ready()?;

    let node = NodeId::new(arguments.node)?;
    let mut network = Network::new(NetworkConfig::default());
    let address = NodeAddress { slave: 0, channel: arguments.channel, node };
    let node = network.add_node(address, NodeConfig::default())?;
    let object = (arguments.index, arguments.sub);
    let timeout = Duration::from_millis(arguments.timeout_ms.into());
    let name = format!("0x{:04X}:{:02X}", arguments.index, arguments.sub);
    if let Some(data) = written {
        network.blocking(&mut port, timeout).download(node, object, &data)?;
        print_line!("{name} written");
    }
    let data = network.blocking(&mut port, timeout).upload(node, object)?;
    let kind = arguments.value_type.unwrap_or(ValueType::Any);
    print_line!("{name} = {}", kind.show(&data)?);
    Ok(true)
}
