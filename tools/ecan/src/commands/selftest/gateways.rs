//! The gateways of a test: identity, configuration and traffic before it, and the configuration restored after it. A
//! test must not begin on a bus with traffic: a loopback takes the channel off its bus, and each new configuration
//! loses frames.

use std::collections::BTreeMap;

use ecan_protocol::can::CanId;
use ecan_protocol::device::Recognition;
use ecan_protocol::image::{ChannelState, ChannelStatus};
use ecan_protocol::mapping::CHANNELS;
use ecan_tool_support::diagnosis::registers::{
    ErrorCounters, LastErrorCode, ProtocolStatus, ReceiveFifoStatus,
};

use super::exchange;
use super::plan::{SelftestArguments, TestPlan};
use super::report::GatewayReport;
use crate::bus::FirmwareVersion;
use crate::commands::saved_config::{Changes, Saved, wait_present};
use crate::context::{Bus, Failure, Result};
use crate::output::Progress;

pub(super) struct TestedGateway {
    pub(super) report: GatewayReport,
    /// Configuration before the test; `None` for a slave that is not tested further.
    pub(super) saved: Option<Saved>,
    pub(super) is_changed: bool,
    pub(super) was_lost: bool,
}

/// Reads the identity and the configuration of the slaves.
pub(super) fn read(
    bus: &Bus,
    slaves: &[usize],
    arguments: &SelftestArguments,
) -> Vec<TestedGateway> {
    let _progress = Progress::show("reading the configuration");
    tracing::info!(?slaves, "reading identity and configuration");
    let read = if arguments.restart { Saved::by_restart } else { Saved::read };
    let read = read_with(bus, slaves, arguments, |bus, slave, report| {
        read(bus, slave)
            .map_err(|error| report.add("configuration", Err(format!("not read: {error}"))))
            .ok()
    });
    let untouched = |(report, saved): (_, Option<Option<Saved>>)| TestedGateway {
        report,
        saved: saved.flatten(),
        is_changed: false,
        was_lost: false,
    };
    read.into_iter().map(untouched).collect()
}

/// Reads the identity of the slaves, and more of those that are gateways.
pub(super) fn read_with<T: Send>(
    bus: &Bus,
    slaves: &[usize],
    arguments: &SelftestArguments,
    more: impl Fn(&Bus, usize, &mut GatewayReport) -> T + Sync,
) -> Vec<(GatewayReport, Option<T>)> {
    let expected = arguments.expect_version.as_deref();
    let read = bus.in_parallel(slaves, |bus, slave| {
        let time = jiff::Timestamp::now().to_string();
        let mut report = GatewayReport { position: slave, time, ..GatewayReport::default() };
        let is_gateway = check_identity(bus, slave, expected, &mut report);
        let found = is_gateway.then(|| more(bus, slave, &mut report));
        Ok((report, found))
    });
    let failed = |(slave, failure): (usize, Failure)| {
        let mut report = GatewayReport { position: slave, ..GatewayReport::default() };
        report.add("recognition", Err(failure.to_string()));
        (report, None)
    };
    let read = slaves.iter().zip(read);
    read.map(|(slave, read)| read.unwrap_or_else(|failure| failed((*slave, failure)))).collect()
}

/// Restores the configuration of the gateways.
pub(super) fn restore(bus: &Bus, plan: &TestPlan<'_>, tested: &mut [TestedGateway]) -> Result {
    let written = plan.written_objects()?;
    let _progress = Progress::show("restoring the configuration");
    tracing::info!("restoring the configuration");
    let changed = |gateway: &&mut TestedGateway| gateway.is_changed;
    let positions: Vec<_> =
        tested.iter_mut().filter(changed).map(|gateway| gateway.report.position).collect();
    let jobs: BTreeMap<_, _> = tested
        .iter()
        .filter_map(|gateway| {
            Some((gateway.report.position, (gateway.saved.as_ref()?, gateway.was_lost)))
        })
        .collect();
    let restored = bus.in_parallel(&positions, |bus, slave| match jobs.get(&slave) {
        Some((saved, was_lost)) => {
            let changes =
                Changes { tested: plan.tested(), written: &written, is_unknown: *was_lost };
            saved.restore(bus, &changes)
        }
        None => Ok(false),
    });
    let mut restored: BTreeMap<_, _> = positions.into_iter().zip(restored).collect();
    for gateway in tested.iter_mut().filter(|tested| tested.saved.is_some()) {
        let found = match restored.remove(&gateway.report.position) {
            None | Some(Ok(false)) => Ok("as before the test".to_owned()),
            Some(Ok(true)) if plan.arguments().restart => Ok("as saved, by a restart".to_owned()),
            Some(Ok(true)) => Ok("as before the test, by a restart".to_owned()),
            Some(Err(error)) => Err(format!("not restored: {error}")),
        };
        gateway.report.add("configuration", found);
    }
    Ok(())
}

/// Checks a slave; returns whether further tests make sense.
fn check_identity(
    bus: &Bus,
    slave: usize,
    expected_version: Option<&str>,
    report: &mut GatewayReport,
) -> bool {
    let info = wait_present(bus, slave).and_then(|()| Ok(bus.diagnostics().slave_info(slave)?));
    let info = match info {
        Ok(info) => info,
        Err(error) => {
            report.add("recognition", Err(error.to_string()));
            return false;
        }
    };
    (report.vendor_id, report.product_code) = (info.vendor_id, info.product_code);
    report.revision = info.revision_number;
    let recognised = recognise(bus, slave);
    let is_gateway = recognised.is_ok();
    report.add("recognition", recognised);
    if !is_gateway {
        return false;
    }
    let of_sii = [info.vendor_id, info.product_code, info.revision_number];
    report.add("identity", identity(bus, slave, of_sii));
    let running = bus.firmware_version(slave);
    report.firmware = running.as_ref().ok().and_then(|running| running.firmware.clone());
    report.add("firmware", version(running, expected_version));
    report.hardware = bus.text(slave, 0x1009).ok();
    let serial = bus.serial(slave);
    report.serial = serial.as_ref().ok().copied();
    let serial = match serial {
        Ok(0 | u64::MAX) => {
            Err("not programmed; two such gateways cannot be distinguished (assumption H19)"
                .to_owned())
        }
        Ok(serial) => Ok(serial.to_string()),
        Err(error) => Err(error.to_string()),
    };
    report.add("serial number", serial);
    true
}

fn recognise(bus: &Bus, slave: usize) -> Result<String, String> {
    let upload = |subindex| {
        let value = bus.diagnostics().sdo_upload_u32(slave, 0xF000, subindex);
        ecan_host::Error::or_assumed(value, 0xF000, subindex)
    };
    let recognition = Recognition::read(upload).map_err(|error| error.to_string())?;
    match recognition.looks_like_ecan_lite() {
        true => Ok("ECAN-Lite (0xF000)".to_owned()),
        false => Err("not an ECAN-Lite (0xF000)".to_owned()),
    }
}

/// The identity in the SII, which the master uses, must match that of the firmware.
fn identity(bus: &Bus, slave: usize, of_sii: [u32; 3]) -> Result<String, String> {
    let names = ["vendor", "product", "revision"];
    for ((subindex, name), sii) in (1..).zip(names).zip(of_sii) {
        let own = bus.read(slave, 0x1018, subindex).map_err(|error| error.to_string())?;
        if own != sii {
            return Err(format!("{name} is 0x{sii:08X} in the SII and 0x{own:08X} in 0x1018"));
        }
    }
    let [vendor, product, revision] = of_sii;
    Ok(format!("vendor 0x{vendor:08X}, product 0x{product:08X}, revision 0x{revision:08X}"))
}

fn version(running: Result<FirmwareVersion>, expected: Option<&str>) -> Result<String, String> {
    let running = running.map_err(|error| error.to_string())?;
    match expected {
        Some(expected) if !running.is_version(expected) => {
            Err(format!("{running}, expected {expected}"))
        }
        _ => Ok(running.to_string()),
    }
}

/// Traffic on the bus of a channel.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Traffic {
    pub(super) position: usize,
    pub(super) channel: u8,
    /// Frames or errors, as text.
    pub(super) seen: String,
}

/// Ends the test if there is traffic.
pub(super) fn require_no_traffic(traffic: &[Traffic], observe_ms: u32) -> Result {
    if traffic.is_empty() {
        return Ok(());
    }
    let channels: Vec<_> = traffic
        .iter()
        .map(|traffic| {
            format!("channel {} of slave {}: {}", traffic.channel, traffic.position, traffic.seen)
        })
        .collect();
    Err(Failure::Rejected(format!(
        "traffic on the bus within {observe_ms} ms: {}; the test would disturb it: disconnect the bus or stop \
         its nodes, or test nevertheless with --force",
        channels.join("; ")
    )))
}

/// Values of an active channel that change with frames on its bus (0x9000, manual 13.5).
#[derive(Clone, Copy, Debug)]
struct ActiveChannel {
    status: ProtocolStatus,
    counters: ErrorCounters,
    fifos: [ReceiveFifoStatus; 2],
    interrupts: u32,
    pending: u32,
    dropped: u32,
}

impl ActiveChannel {
    fn read(bus: &Bus, slave: usize, channel: u8) -> Result<Self> {
        let get = |subindex| bus.read(slave, 0x9000 + u16::from(channel), subindex);
        Ok(Self {
            counters: ErrorCounters::from_raw(get(1)?),
            status: ProtocolStatus::from_raw(get(2)?),
            interrupts: get(3)?,
            fifos: [ReceiveFifoStatus::from_raw(get(4)?), ReceiveFifoStatus::from_raw(get(5)?)],
            pending: get(10)?,
            dropped: get(13)?,
        })
    }

    fn traffic(&self, before: &Self) -> Option<String> {
        if self.status.last_error.is_error() || self.counters.logged > 0 {
            return Some(error_text(&self.status, &self.counters));
        }
        let received = self.fifos != before.fifos
            || self.interrupts != before.interrupts
            || (self.pending, self.dropped) != (before.pending, before.dropped)
            // The first read has cleared the code: a frame has passed since.
            || self.status.last_error == LastErrorCode::None
                && before.status.last_error != LastErrorCode::None;
        if received {
            return Some("it is active and has received frames".to_owned());
        }
        let is_full = |fifo: &ReceiveFifoStatus| fifo.is_full || fifo.has_lost;
        self.fifos
            .iter()
            .position(is_full)
            .map(|number| format!("it is active, and RX FIFO{number} is full of frames"))
    }
}

fn error_text(status: &ProtocolStatus, counters: &ErrorCounters) -> String {
    let last = match status.last_error.is_error() {
        true => format!(", the last one a {}", status.last_error),
        false => String::new(),
    };
    format!("bus errors ({counters}{last}), as of traffic with another bit rate")
}

/// Observes the channels that are active, without changing anything. A slave whose values cannot be
/// read is left to the test.
pub(super) fn of_active_channels(
    bus: &Bus,
    slaves: &[usize],
    tested: [bool; CHANNELS],
    observe_ms: u32,
) -> Vec<Traffic> {
    let read = |bus: &Bus, slave: usize| -> Result<BTreeMap<u8, ActiveChannel>> {
        let mut active = BTreeMap::new();
        for channel in (0..).zip(tested).filter(|numbered| numbered.1).map(|numbered| numbered.0) {
            let raw = bus.read(slave, 0x9000 + u16::from(channel), 9)?;
            let status = ChannelStatus::from_raw(raw as u16);
            let is_off = matches!(status.state(), ChannelState::Disabled | ChannelState::Init);
            if !is_off || status.bus_off() {
                active.insert(channel, ActiveChannel::read(bus, slave, channel)?);
            }
        }
        Ok(active)
    };
    let before = bus.in_parallel(slaves, read);
    if before.iter().flatten().all(BTreeMap::is_empty) {
        return Vec::new();
    }
    bus.sleep_ns(u64::from(observe_ms) * 1_000_000);
    let mut traffic = Vec::new();
    for ((slave, before), after) in slaves.iter().zip(before).zip(bus.in_parallel(slaves, read)) {
        let (Ok(before), Ok(after)) = (before, after) else { continue };
        for (channel, after) in after {
            if let Some(seen) = before.get(&channel).and_then(|before| after.traffic(before)) {
                traffic.push(Traffic { position: *slave, channel, seen });
            }
        }
    }
    traffic
}

/// Frames that a channel received while it only listened.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct FramesReceived {
    count: u64,
    first: Option<CanId>,
}

impl FramesReceived {
    pub(super) fn add(&mut self, id: CanId) {
        self.count += 1;
        self.first.get_or_insert(id);
    }

    /// Traffic by the received frames, or by the errors that the channel has seen.
    pub(super) fn traffic(&self, state: &exchange::ChannelState) -> Option<String> {
        if let Some(first) = self.first {
            return Some(format!("{} frames, the first with CAN ID 0x{first}", self.count));
        }
        let ErrorCounters { receive, is_receive_passive, logged, .. } = state.counters;
        let has_errors = receive > 0 || is_receive_passive || logged > 0;
        (has_errors || state.status.last_error.is_error())
            .then(|| error_text(&state.status, &state.counters))
    }
}
