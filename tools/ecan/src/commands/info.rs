//! `ecan info`: one gateway.

use std::io::Write;

use ecan_protocol::{AlState, CHANNELS, ChannelStatus};
use serde::Serialize;

use crate::bus::Bus;
use crate::failure::Failure;
use crate::global::GlobalOptions;
use crate::output::{Output, Tone};
use crate::table;

/// A direction of process data.
#[derive(Debug, Serialize)]
struct Profile {
    bytes: u32,
    chunks: u32,
    channel_mask: u32,
    apply_status: u32,
    pdo_errors: u32,
}

/// A CAN channel.
#[derive(Debug, Serialize)]
struct Channel {
    channel: usize,
    status: u16,
    words: String,
    nominal_bitrate: u32,
    data_bitrate: Option<u32>,
}

/// What `info` tells.
#[derive(Debug, Serialize)]
struct Info {
    position: u16,
    alias: u16,
    state: String,
    name: String,
    firmware: Option<String>,
    hardware: Option<String>,
    serial: u64,
    vendor_id: u32,
    product_code: u32,
    revision: u32,
    tx_pdo: Profile,
    rx_pdo: Profile,
    channels: Vec<Channel>,
}

pub fn run(global: &GlobalOptions, output: &Output) -> Result<(), Failure> {
    let bus = Bus::open(global, output)?;
    let slave = bus.slave()?;
    let info = read(&bus, slave)?;
    output.data(&info, |out| print(&info, output, out))
}

fn read(bus: &Bus, slave: usize) -> Result<Info, Failure> {
    let known = bus.diagnostics().slave_info(slave).map_err(Failure::Device)?;
    let upload = |index, subindex| {
        bus.diagnostics().sdo_upload_u32(slave, index, subindex).map_err(Failure::Device)
    };
    let profile = |index| {
        let word = upload(index, 12)?;
        let bytes = upload(index, 9)?;
        Ok::<_, Failure>(Profile {
            bytes,
            chunks: bytes / 128,
            channel_mask: if bytes == 0 { 0 } else { word >> 5 & 0xFF },
            apply_status: upload(index, 2)?,
            pdo_errors: upload(index, 15)?,
        })
    };
    let mut channels = Vec::new();
    for channel in 0..CHANNELS {
        let (config, information) = (0x8001 + channel as u16, 0x9000 + channel as u16);
        let status = ChannelStatus::from_raw(upload(information, 9)? as u16);
        let is_fd = upload(config, 15)? == 1;
        channels.push(Channel {
            channel,
            status: status.raw(),
            words: status.to_string(),
            nominal_bitrate: upload(config, 19)?,
            data_bitrate: if is_fd { Some(upload(config, 20)?) } else { None },
        });
    }
    let state = AlState::from_status(known.al_state.into());
    Ok(Info {
        position: known.position,
        alias: known.alias,
        state: state.map_or_else(|| format!("{:#04x}", known.al_state), |it| it.to_string()),
        name: known.name,
        firmware: bus.text(slave, 0x100A).ok(),
        hardware: bus.text(slave, 0x1009).ok(),
        serial: bus.serial(slave)?,
        vendor_id: known.vendor_id,
        product_code: known.product_code,
        revision: known.revision_number,
        tx_pdo: profile(0x8010)?,
        rx_pdo: profile(0x8011)?,
        channels,
    })
}

fn print(info: &Info, output: &Output, out: &mut dyn Write) -> std::io::Result<()> {
    let images = |profile: &Profile| {
        let Profile { bytes, chunks, channel_mask, pdo_errors, .. } = profile;
        match bytes {
            0 => "no profile applied".to_owned(),
            _ => format!(
                "{bytes} bytes (N = {chunks}), mask 0x{channel_mask:02X}, {pdo_errors} errors"
            ),
        }
    };
    let or_not_read = |text: &Option<String>| text.clone().unwrap_or_else(|| "not read".to_owned());
    let alias = if info.alias == 0 { String::new() } else { format!(", alias {}", info.alias) };
    let mut rows = vec![
        ["slave".to_owned(), format!("{}{alias}, {}", info.position, info.state)],
        ["name".to_owned(), info.name.clone()],
        ["firmware".to_owned(), or_not_read(&info.firmware)],
        ["hardware".to_owned(), or_not_read(&info.hardware)],
        ["serial".to_owned(), info.serial.to_string()],
        [
            "identity".to_owned(),
            format!(
                "vendor 0x{:08X}, product 0x{:08X}, revision 0x{:08X}",
                info.vendor_id, info.product_code, info.revision
            ),
        ],
        ["TxPDO".to_owned(), images(&info.tx_pdo)],
        ["RxPDO".to_owned(), images(&info.rx_pdo)],
    ];
    for it in &info.channels {
        let rates = match it.data_bitrate {
            None => format!("{} kbit/s", it.nominal_bitrate / 1000),
            Some(data) => format!("{} / {} kbit/s FD", it.nominal_bitrate / 1000, data / 1000),
        };
        let tone = if it.words.contains("bus-off") { Tone::Bad } else { Tone::Faint };
        let status = output.toned(tone, &it.words);
        rows.push([format!("CAN{}", it.channel), format!("{rates}  {status}")]);
    }
    table::print(out, &rows)
}
