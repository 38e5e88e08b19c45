//! 0x8001..0x8004: the configuration of a channel (manual 13.4), with the choice of a bit timing from the sample
//! point window, which the manual leaves open (5.4.3).

use ecan_protocol::can::{BitTiming, Phase, vendor_driver_timing};
use ecan_protocol::config::{
    ApplyStatus, BitTimingMode, ChannelFault, ConfigObject, EXTENDED_FILTERS_MAX, FilterCommand,
    FilterCommandStatus, FilterWindow, McanChannelConfig, NodeMode, STANDARD_FILTERS_MAX,
    SamplePointWindow,
};

use super::controller::ControllerConfig;
use super::dictionary_values::DictionaryValues;
use super::message_ram::{FilterElement, FilterTable};
use super::variant::{
    BitRates, BitTimingChoice, GatewayVariant, ManualTiming, NodeModes, TdcPrescaler,
};
use crate::bus::{StationConfig, StationMode};

pub(super) const FIRST_CHANNEL_OBJECT: u16 = 0x8001;
/// 0x8000:6, source clock of MCAN0; the others follow.
const SYSTEM_OBJECT: u16 = 0x8000;
const FIRST_CLOCK: u8 = 6;
/// Nominal bit rate in 0x8001.
const NOMINAL_BITRATE: u8 = 19;

/// Command and status subindices of 0x8001..0x8004.
pub(super) mod subindex {
    use ecan_protocol::config::FilterWindow;

    pub(in crate::gateway) const APPLY: u8 = 1;
    pub(in crate::gateway) const APPLY_STATUS: u8 = 2;
    pub(in crate::gateway) const FLASH: u8 = 3;
    pub(in crate::gateway) const FLASH_STATUS: u8 = 4;
    pub(in crate::gateway) const COMMAND_SEQUENCE: u8 = 5;
    pub(in crate::gateway) const STANDARD_COMMAND: u8 = FilterWindow::STANDARD.command;
    pub(in crate::gateway) const EXTENDED_COMMAND: u8 = FilterWindow::EXTENDED.command;
}

/// Edited filter lists of one channel, applied or not.
#[derive(Clone, Debug)]
pub(super) struct FilterLists {
    standard: Vec<FilterElement>,
    extended: Vec<FilterElement>,
}

impl FilterLists {
    pub(super) fn new() -> Self {
        let list = |size: u8| vec![FilterElement::default(); size.into()];
        Self { standard: list(STANDARD_FILTERS_MAX), extended: list(EXTENDED_FILTERS_MAX) }
    }

    /// All elements, standard before extended ones.
    pub(super) fn elements(&self) -> impl Iterator<Item = &FilterElement> {
        self.standard.iter().chain(&self.extended)
    }

    pub(super) fn elements_mut(&mut self) -> impl Iterator<Item = &mut FilterElement> {
        self.standard.iter_mut().chain(&mut self.extended)
    }

    /// Executes a command of the editing window at subindex 45 or 46; the status goes to 47 or 48.
    pub(super) fn command(
        &mut self,
        values: &mut DictionaryValues,
        index: u16,
        extended: bool,
        command: u8,
    ) {
        let (list, window) = if extended {
            (&mut self.extended, FilterWindow::EXTENDED)
        } else {
            (&mut self.standard, FilterWindow::STANDARD)
        };
        let status = edit(list, values, index, window, command);
        values.set(index, window.status, u32::from(status.raw()));
    }
}

fn edit(
    list: &mut [FilterElement],
    values: &mut DictionaryValues,
    index: u16,
    window: FilterWindow,
    command: u8,
) -> FilterCommandStatus {
    let command = match FilterCommand::from_raw(command) {
        Some(FilterCommand::None) => return FilterCommandStatus::Ok,
        // "flash current" is reserved
        None | Some(FilterCommand::Flash) => return FilterCommandStatus::InvalidCommand,
        Some(command) => command,
    };
    let current = values.get_u8(index, window.index);
    let known = current < values.get_u8(index, window.max);
    let Some(element) = list.get_mut(usize::from(current)).filter(|_| known) else {
        return FilterCommandStatus::InvalidIndex;
    };
    let field = |offset| window.first_field + offset;
    match command {
        FilterCommand::Save => {
            *element = FilterElement {
                kind: values.get_u8(index, field(0)),
                action: values.get_u8(index, field(1)),
                sync: values.get_u8(index, field(2)),
                id1: values.get(index, field(3)),
                id2: values.get(index, field(4)),
            };
        }
        FilterCommand::Clear => *element = FilterElement::default(),
        _ => {
            values.set(index, field(0), u32::from(element.kind));
            values.set(index, field(1), u32::from(element.action));
            values.set(index, field(2), u32::from(element.sync));
            values.set(index, field(3), element.id1);
            values.set(index, field(4), element.id2);
        }
    }
    FilterCommandStatus::Ok
}

/// `BuildFail` for undefined or out-of-range values and for a bit rate without timing;
/// `RuntimeFail` for too small a Message RAM or too few transmit elements.
pub(super) fn build(
    values: &DictionaryValues,
    channel: u8,
    filters: &FilterLists,
    variant: &GatewayVariant,
) -> Result<ControllerConfig, ApplyStatus> {
    let index = FIRST_CHANNEL_OBJECT + u16::from(channel);
    let config = McanChannelConfig::from_values(|subindex| values.get(index, subindex))
        .map_err(|_| ApplyStatus::BuildFail)?;
    let config = with_physical_timing(config, variant.manual_timing);
    let clock = values.get(SYSTEM_OBJECT, FIRST_CLOCK + channel);
    let mut verdict = Ok(());
    config.check_at(clock, &mut |fault| {
        let status = match fault {
            ChannelFault::TransmitElements { .. } => ApplyStatus::RuntimeFail,
            ChannelFault::Range(fault)
                if fault.subindex == NOMINAL_BITRATE && variant.bit_rates == BitRates::Any =>
            {
                return;
            }
            ChannelFault::DataBelowNominal { .. } if variant.bit_rates == BitRates::Rejected => {
                ApplyStatus::BuildFail
            }
            ChannelFault::TdcPrescaler { .. } if variant.tdc_prescaler == TdcPrescaler::Any => {
                return;
            }
            // no error for the controller, or checked below
            ChannelFault::MessageRam { .. }
            | ChannelFault::DataBelowNominal { .. }
            | ChannelFault::ManualBitrate { .. }
            | ChannelFault::NoTransmitFifo
            | ChannelFault::NonMatchWithoutFifo { .. } => return,
            _ => ApplyStatus::BuildFail,
        };
        // a configuration that cannot be built is not tried on the controller
        if verdict != Err(ApplyStatus::BuildFail) {
            verdict = Err(status);
        }
    });
    verdict?;
    if config.message_ram_bytes() > variant.message_ram_bytes.get() {
        return Err(ApplyStatus::RuntimeFail);
    }
    let timings = choose(&config, clock, variant.bit_timing);
    let (nominal, data) = timings.ok_or(ApplyStatus::BuildFail)?;
    let table = filter_table(values, index, &config, filters)?;
    let manual = config.bit_timing_mode == BitTimingMode::Manual;
    let rate = |configured, timing: BitTiming| {
        if manual { timing.bitrate(clock) } else { configured }
    };
    let nominal_bitrate = rate(config.nominal_bitrate, nominal);
    let station = StationConfig {
        nominal_bitrate,
        data_bitrate: data.map_or(nominal_bitrate, |data| rate(config.data_bitrate, data)),
        fd: config.fd,
        non_iso: config.non_iso,
        mode: station_mode(config.node_mode, variant.node_modes),
        auto_retransmit: !config.disable_auto_retransmission,
    };
    Ok(ControllerConfig {
        station,
        ram: config.ram,
        filters: table,
        timing: (nominal, data),
        captures_start: config.tsu && config.tsu_capture_sof,
        tdc: config.tdc_runs().then_some((config.tdc_offset, config.tdc_filter)),
    })
}

/// The configuration with the values that a manual timing has on the bus.
fn with_physical_timing(config: McanChannelConfig, values: ManualTiming) -> McanChannelConfig {
    if values == ManualTiming::Physical {
        return config;
    }
    let physical = |timing: BitTiming| BitTiming {
        brp: timing.brp.saturating_add(1),
        tseg1: timing.tseg1.saturating_add(1),
        tseg2: timing.tseg2.saturating_add(1),
        sjw: timing.sjw.saturating_add(1),
    };
    McanChannelConfig {
        manual_nominal: physical(config.manual_nominal),
        manual_data: physical(config.manual_data),
        ..config
    }
}

fn station_mode(mode: NodeMode, numbers: NodeModes) -> StationMode {
    match numbers {
        NodeModes::Manual => match mode {
            NodeMode::Normal => StationMode::Normal,
            NodeMode::Listen => StationMode::Listen,
            NodeMode::InternalLoopback => StationMode::InternalLoopback,
            NodeMode::ExternalLoopback => StationMode::ExternalLoopback,
        },
        NodeModes::LoopbackFirst => match mode.raw() {
            0 => StationMode::Normal,
            1 => StationMode::InternalLoopback,
            2 => StationMode::ExternalLoopback,
            _ => StationMode::Listen,
        },
    }
}

fn filter_table(
    values: &DictionaryValues,
    index: u16,
    config: &McanChannelConfig,
    lists: &FilterLists,
) -> Result<FilterTable, ApplyStatus> {
    let used = |list: &[FilterElement], window: FilterWindow| {
        let count = usize::from(values.get_u8(index, window.count));
        list.get(..count).map(<[FilterElement]>::to_vec).ok_or(ApplyStatus::BuildFail)
    };
    Ok(FilterTable {
        standard: used(&lists.standard, FilterWindow::STANDARD)?,
        extended: used(&lists.extended, FilterWindow::EXTENDED)?,
        non_match_standard: config.non_match_standard,
        non_match_extended: config.non_match_extended,
        reject_remote_standard: config.reject_remote_standard,
        reject_remote_extended: config.reject_remote_extended,
        extended_mask: config.extended_id_mask,
    })
}

/// Nominal and, for CAN FD, data bit timing of a configuration; `None` if there is none.
pub(super) fn choose(
    config: &McanChannelConfig,
    clock_hz: u32,
    choice: BitTimingChoice,
) -> Option<(BitTiming, Option<BitTiming>)> {
    let (nominal, data) = config.timings(clock_hz).ok()?;
    if config.bit_timing_mode == BitTimingMode::Manual {
        return Some((nominal, data));
    }
    let of = |phase, middle: BitTiming| {
        let (bitrate, window) = config.bit_rate_and_window(phase);
        match choice {
            BitTimingChoice::Middle => Some(middle),
            BitTimingChoice::Lowest => Some(at_bound(phase, middle, window, Bound::Lowest)),
            BitTimingChoice::Highest => Some(at_bound(phase, middle, window, Bound::Highest)),
            BitTimingChoice::Driver => {
                vendor_driver_timing(phase, config.fd, clock_hz, bitrate, window.min, window.max)
            }
        }
    };
    let data = match data {
        Some(middle) => Some(of(Phase::Data, middle)?),
        None => None,
    };
    Some((of(Phase::Nominal, nominal)?, data))
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Bound {
    Lowest,
    Highest,
}

/// The timing with the same quanta whose sample point is the lowest or highest of the window.
fn at_bound(phase: Phase, middle: BitTiming, window: SamplePointWindow, bound: Bound) -> BitTiming {
    let quanta = middle.quanta();
    let inside = |before: &u32| {
        let permille = u32::from(window.min) * quanta..=u32::from(window.max) * quanta;
        permille.contains(&(before * 1000)) && with_sample_point(middle, *before).fits(phase)
    };
    let mut points = (2..quanta).filter(inside);
    let chosen = match bound {
        Bound::Lowest => points.next(),
        Bound::Highest => points.next_back(),
    };
    chosen.map_or(middle, |before| with_sample_point(middle, before))
}

/// The timing with `before` quanta up to its sample point.
fn with_sample_point(timing: BitTiming, before: u32) -> BitTiming {
    let tseg2 = (timing.quanta() - before) as u16;
    let tseg1 = (before - 1) as u16;
    BitTiming { brp: timing.brp, tseg1, tseg2, sjw: timing.sjw.min(tseg2).max(1) }
}
