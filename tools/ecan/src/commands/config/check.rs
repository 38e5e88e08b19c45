//! `ecan config check`: faults of a file, or its derived settings.

use std::fmt;
use std::io::Write;
use std::path::Path;

use ecan_lite::config::{
    ConfigFileError, DeviceProfile, FileFault, IncludedProfile, load, load_notes, load_profiles,
};
use ecan_mcan_port::{ChannelConfig, Config, GatewayConfig, PortPlan};
use ecan_protocol::can::{
    BitTiming, MCAN_CLOCK_HZ, Phase, SamplePoint, sample_point_range, vendor_driver_timing,
};
use ecan_protocol::config::{BitTimingMode, MESSAGE_RAM_BYTES, McanChannelConfig};
use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::{CHUNK_BYTES, Direction};
use ecan_protocol::text::Printable;
use serde::Serialize;

use crate::context::{Failure, Output, Result, Tone};

#[derive(Debug, Serialize)]
struct Faulty {
    line: usize,
    column: usize,
    reason: String,
}

#[derive(Debug, Default, Serialize)]
struct Checked {
    faults: Vec<Faulty>,
    gateways: Vec<Gateway>,
    ethercat: Option<EtherCat>,
    warnings: Vec<String>,
}

#[derive(Debug, Serialize)]
struct EtherCat {
    cycle_ns: u32,
    sync0_shift_ns: Option<u32>,
    process_data_bytes: usize,
    frames: usize,
    wire_ns: u64,
}

#[derive(Debug, Serialize)]
struct Gateway {
    alias: u16,
    position: u16,
    profile: Option<Profile>,
    channel_mask: u8,
    images: Vec<Image>,
    channels: Vec<Channel>,
}

/// Device profile that the gateway includes.
#[derive(Debug, Serialize)]
struct Profile {
    path: String,
    values: DeviceProfile,
    effects: Vec<String>,
}

#[derive(Debug, Serialize)]
struct Image {
    direction: String,
    multiplier: u8,
    bytes: usize,
    frame_area_bytes: usize,
    channel_mask: u8,
    profile: u8,
    options: String,
    profile_word: u32,
}

#[derive(Debug, Serialize)]
struct Channel {
    channel: u8,
    is_fd: bool,
    receives: bool,
    sends: bool,
    nominal: Timing,
    data: Option<Timing>,
    tdc_runs: bool,
    message_ram_bytes: u32,
    message_ram_size: u32,
    standard_filters: usize,
    extended_filters: usize,
}

/// Bit timing of a phase at a clock of 80 MHz.
#[derive(Debug, Serialize)]
struct Timing {
    bitrate: u32,
    error_ppm: i64,
    /// Lowest and highest that the firmware may choose; equal in manual mode.
    sample_point_percent: [f64; 2],
    /// Manual mode: the configured registers.
    registers: Option<Registers>,
    /// Automatic mode: what the public driver of the controller's vendor would choose.
    vendor_driver: Option<Registers>,
}

#[derive(Debug, Serialize)]
struct Registers {
    sample_point_percent: f64,
    brp: u16,
    tseg1: u16,
    tseg2: u16,
    sjw: u16,
}

fn percent(point: SamplePoint) -> f64 {
    f64::from(point.0) / 100.0
}

impl From<BitTiming> for Registers {
    fn from(timing: BitTiming) -> Self {
        let BitTiming { brp, tseg1, tseg2, sjw } = timing;
        Self { sample_point_percent: percent(timing.sample_point()), brp, tseg1, tseg2, sjw }
    }
}

impl fmt::Display for Registers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { brp, tseg1, tseg2, sjw, .. } = self;
        write!(f, "BRP {brp} TSEG1 {tseg1} TSEG2 {tseg2} SJW {sjw}")
    }
}

impl Timing {
    /// `timing` has the bit rate of the phase.
    fn of(can: &McanChannelConfig, phase: Phase, timing: BitTiming) -> Option<Self> {
        let (bitrate, window) = can.bit_rate_and_window(phase);
        let (min, max) = (window.min, window.max);
        let is_manual = can.bit_timing_mode == BitTimingMode::Manual;
        let (lowest, highest) = match is_manual {
            true => (timing.sample_point(), timing.sample_point()),
            false => sample_point_range(phase, MCAN_CLOCK_HZ, bitrate, min, max).ok()?,
        };
        let driver = || vendor_driver_timing(phase, can.fd, MCAN_CLOCK_HZ, bitrate, min, max);
        // From the time quanta per bit: the bit rate itself is rounded.
        let reached = f64::from(MCAN_CLOCK_HZ) / f64::from(timing.clocks_per_bit().max(1));
        let error = (reached / f64::from(bitrate.max(1)) - 1.0) * 1e6;
        Some(Self {
            bitrate,
            error_ppm: error.round() as i64,
            sample_point_percent: [percent(lowest), percent(highest)],
            registers: is_manual.then(|| timing.into()),
            vendor_driver: (!is_manual).then(driver).flatten().map(Into::into),
        })
    }
}

impl fmt::Display for Timing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { bitrate, error_ppm, sample_point_percent: [lowest, highest], .. } = self;
        write!(f, "{bitrate} bit/s, error {error_ppm} ppm, sample point ")?;
        match &self.registers {
            Some(registers) => return write!(f, "{lowest} % ({registers})"),
            None if lowest == highest => write!(f, "{lowest} %")?,
            None => write!(f, "{lowest} to {highest} %, chosen by the firmware")?,
        }
        match &self.vendor_driver {
            Some(driver) if lowest == highest => write!(f, "; vendor's public driver: {driver}"),
            Some(driver) => {
                let point = driver.sample_point_percent;
                write!(f, "; vendor's public driver: {point} % ({driver})")
            }
            None => f.write_str("; vendor's public driver: none"),
        }
    }
}

pub fn run(path: &Path, output: &Output) -> Result {
    let read = || Ok((load(path)?, load_profiles(path)?, load_notes(path)?));
    let (file, profiles, notes) = match read() {
        Ok(read) => read,
        Err(ConfigFileError::Read { path, reason }) => {
            return Err(Failure::file("read", &path, reason));
        }
        Err(ConfigFileError::Faults { faults, .. }) => {
            let faulty = |FileFault { line, column, reason }| Faulty { line, column, reason };
            let faults = faults.0.into_iter().map(faulty).collect();
            let checked = Checked { faults, ..Checked::default() };
            output.data(&checked, |out| {
                for Faulty { line, column, reason } in &checked.faults {
                    let location = format!("{}:{line}:{column}:", Printable(path.display()));
                    writeln!(out, "{} {reason}", output.toned(Tone::Bad, location))?;
                }
                Ok(())
            })?;
            return Err(Failure::ProblemsFound);
        }
    };
    let mut checked = of_file(&file, &profiles);
    checked.warnings.extend(notes);
    output.data(&checked, |out| print(&checked, output, out))
}

fn of_file(file: &Config, profiles: &[IncludedProfile]) -> Checked {
    let plan = PortPlan::of(&file.adapter, &file.port, &[]);
    let gateways = file.adapter.slaves.iter().zip(&file.port.gateways);
    Checked {
        faults: Vec::new(),
        gateways: gateways
            .enumerate()
            .map(|(index, (slave, gateway))| Gateway {
                alias: slave.alias,
                position: slave.position,
                profile: profiles.iter().find(|profile| profile.gateway == index).map(Profile::of),
                channel_mask: gateway.channel_mask(),
                images: vec![
                    image(gateway, Direction::RxPdo, slave.rx_multiplier),
                    image(gateway, Direction::TxPdo, slave.tx_multiplier),
                ],
                channels: (0..)
                    .zip(&gateway.channels)
                    .filter_map(|(number, settings)| {
                        let standard = file.port.standard_filters(index, number).len();
                        let extended = file.port.extended_filters(index, number).len();
                        let of = channel(number, settings.as_ref()?, (standard, extended))?;
                        let [receives, sends] =
                            Direction::ALL.map(|direction| gateway.carries(direction, number));
                        Some(Channel { receives, sends, ..of })
                    })
                    .collect(),
            })
            .collect(),
        ethercat: Some(EtherCat {
            cycle_ns: file.adapter.cycle_ns(),
            sync0_shift_ns: file.adapter.dc.map(|dc| dc.shift_ns()),
            process_data_bytes: plan.ethercat.process_data_bytes(),
            frames: plan.ethercat.frames.len(),
            wire_ns: plan.ethercat.wire_ns(),
        }),
        warnings: plan.warnings.iter().map(ToString::to_string).collect(),
    }
}

impl Profile {
    fn of(included: &IncludedProfile) -> Self {
        Self {
            path: included.path.display().to_string(),
            values: included.profile.clone(),
            effects: included.effects.iter().map(ToString::to_string).collect(),
        }
    }
}

fn image(gateway: &GatewayConfig, direction: Direction, multiplier: u8) -> Image {
    let profile: PdoProfile = gateway.profile(direction, multiplier);
    Image {
        direction: direction.to_string(),
        multiplier,
        bytes: usize::from(multiplier) * CHUNK_BYTES,
        frame_area_bytes: profile.frame_area_bytes(),
        channel_mask: profile.channel_mask,
        profile: profile.profile.raw(),
        options: profile.options.to_string(),
        profile_word: profile.word(),
    }
}

fn channel(number: u8, settings: &ChannelConfig, filters: (usize, usize)) -> Option<Channel> {
    let can: &McanChannelConfig = &settings.can;
    // A file without faults has valid timings.
    let (nominal, data) = can.timings(MCAN_CLOCK_HZ).ok()?;
    Some(Channel {
        channel: number,
        is_fd: can.fd,
        receives: true,
        sends: true,
        nominal: Timing::of(can, Phase::Nominal, nominal)?,
        data: data.and_then(|timing| Timing::of(can, Phase::Data, timing)),
        tdc_runs: can.tdc_runs(),
        message_ram_bytes: can.message_ram_bytes(),
        message_ram_size: MESSAGE_RAM_BYTES,
        standard_filters: filters.0,
        extended_filters: filters.1,
    })
}

fn print(checked: &Checked, output: &Output, out: &mut dyn Write) -> std::io::Result<()> {
    for (number, gateway) in checked.gateways.iter().enumerate() {
        let alias = match gateway.alias {
            0 => String::new(),
            alias => format!(" after alias {alias}"),
        };
        writeln!(out, "gateway {number}: position {}{alias}", gateway.position)?;
        if let Some(profile) = &gateway.profile {
            writeln!(out, "  device profile {}", profile.path)?;
            for effect in &profile.effects {
                writeln!(out, "         {effect}")?;
            }
        }
        for image in &gateway.images {
            writeln!(
                out,
                "  {}  N = {}: {} bytes, frame area {} bytes, profile {}, options {}",
                image.direction,
                image.multiplier,
                image.bytes,
                image.frame_area_bytes,
                image.profile,
                image.options
            )?;
        }
        for channel in &gateway.channels {
            print_channel(channel, out)?;
        }
    }
    if let Some(wire) = &checked.ethercat {
        let share = wire.wire_ns as f64 / f64::from(wire.cycle_ns.max(1)) * 100.0;
        let us = |ns: f64| ns / 1e3;
        writeln!(
            out,
            "EtherCAT: {} bytes of process data, {} frame(s), {:.1} us of {} us ({share:.1} %)",
            wire.process_data_bytes,
            wire.frames,
            us(wire.wire_ns as f64),
            us(f64::from(wire.cycle_ns)),
        )?;
        if let Some(shift) = wire.sync0_shift_ns {
            writeln!(out, "Sync0: {} us after the start of its period", us(f64::from(shift)))?;
        }
    }
    for warning in &checked.warnings {
        writeln!(out, "{} {warning}", output.toned(Tone::Warning, "warning:"))?;
    }
    Ok(())
}

fn print_channel(channel: &Channel, out: &mut dyn Write) -> std::io::Result<()> {
    let kind = if channel.is_fd { "CAN FD" } else { "classic CAN" };
    let tdc = match (channel.is_fd, channel.tdc_runs) {
        (false, _) => "",
        (true, true) => ", delay compensation on",
        (true, false) => ", delay compensation off",
    };
    let directions = match (channel.receives, channel.sends) {
        (true, false) => ", receives only",
        (false, true) => ", sends only",
        _ => "",
    };
    writeln!(out, "  CAN{}   {kind}{tdc}{directions}", channel.channel)?;
    let timings = [("nominal", Some(&channel.nominal)), ("data", channel.data.as_ref())];
    for (name, timing) in timings {
        let Some(timing) = timing else { continue };
        writeln!(out, "         {name:<8} {timing}")?;
    }
    writeln!(
        out,
        "         Message RAM {} of {} bytes, filters: {} standard, {} extended",
        channel.message_ram_bytes,
        channel.message_ram_size,
        channel.standard_filters,
        channel.extended_filters
    )
}
