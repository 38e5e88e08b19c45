//! Checks of the whole configuration, and the keys that its faults come from.

use ecan_host::{ConfigFault, PlanError};
use ecan_mcan_port::{Config, PortConfigFault, PortPlanError};
use ecan_protocol::can::{BitTimingError, MCAN_CLOCK_HZ, Phase, solve_bit_timing};
use ecan_protocol::config::{
    ChannelFault, DataPathFault, FilterElementFault, FilterFault, RangeFault,
};
use ecan_protocol::image::ProfileError;
use ecan_protocol::mapping::Direction;
use ecan_protocol::object::lookup;

use super::gateway::{EXTENDED_TABLE, STANDARD_TABLE};
use crate::config_file::document::Document;
use crate::config_file::gateway::CHANNEL_TABLES;

/// Checks the configuration and reports its faults to the document.
pub(crate) fn check(document: &Document<'_>, file: &Config) {
    let Err(faults) = file.port.check(&file.adapter) else { return };
    for fault in faults.0 {
        document.semantic_fault(&locations(&fault), fault.to_string());
        if let Some(hidden) = hidden_by(file, &fault) {
            document.semantic_fault(&locations(&hidden), hidden.to_string());
        }
    }
}

/// The fault of a bit rate without a timing that an invalid sample point window hides.
fn hidden_by(file: &Config, fault: &PortConfigFault) -> Option<PortConfigFault> {
    let PortConfigFault::Channel { slave, channel, fault } = *fault else { return None };
    let ChannelFault::Timing { phase, error: BitTimingError::Window { .. } } = fault else {
        return None;
    };
    let gateway = file.port.gateways.get(slave)?;
    let can = &gateway.channels.get(usize::from(channel))?.as_ref()?.can;
    let bitrate = match phase {
        Phase::Nominal => can.nominal_bitrate,
        Phase::Data => can.data_bitrate,
    };
    let error = solve_bit_timing(phase, MCAN_CLOCK_HZ, bitrate, 0, 1_000).err()?;
    let fault = ChannelFault::Timing { phase, error };
    Some(PortConfigFault::Channel { slave, channel, fault })
}

fn gateway(slave: usize) -> String {
    format!("gateway[{slave}]")
}

fn in_channel(slave: usize, channel: u8, keys: &[&str]) -> Vec<String> {
    let table = CHANNEL_TABLES.get(usize::from(channel)).copied().unwrap_or("can0");
    let table = format!("{}.{table}", gateway(slave));
    keys.iter().map(|key| format!("{table}.{key}")).collect()
}

fn in_direction(slave: usize, pdo: &str, key: &str) -> Vec<String> {
    let gateway = gateway(slave);
    let table = if pdo == "TxPDO" { "tx_pdo" } else { "rx_pdo" };
    vec![format!("{gateway}.{table}.{key}"), format!("{gateway}.{key}")]
}

/// Keys that a fault may come from, the most likely one first.
fn locations(fault: &PortConfigFault) -> Vec<String> {
    let one = |path: String| vec![path];
    match *fault {
        PortConfigFault::Adapter(fault) => adapter_locations(&fault),
        PortConfigFault::NoChannel { slave } => one(gateway(slave)),
        PortConfigFault::Profile { slave, direction, fault } => {
            let key = match fault {
                ProfileError::Multiplier(_) => "n",
                ProfileError::ChannelMask(_) => "channels",
                _ => "options",
            };
            in_direction(slave, pdo(direction), key)
        }
        PortConfigFault::MaskBeyondChannels { slave, direction, .. } => {
            in_direction(slave, pdo(direction), "channels")
        }
        PortConfigFault::ChannelInNoMask { slave, channel } => in_channel(slave, channel, &[""]),
        PortConfigFault::Bypass { slave, direction } => {
            in_direction(slave, pdo(direction), "options")
        }
        PortConfigFault::Channel { slave, channel, fault } => {
            channel_locations(slave, channel, fault)
        }
        PortConfigFault::DataPath { slave, channel, fault } => match fault {
            DataPathFault::Range(RangeFault { index, subindex, .. }) => {
                let key = key_of(index, subindex).unwrap_or("enable");
                in_channel(slave, channel, &[&format!("data_path.{key}")])
            }
            DataPathFault::RxBudget { .. } => {
                in_channel(slave, channel, &["data_path.rx_drain_min", "data_path.rx_drain_max"])
            }
            DataPathFault::TxBudget { .. } => {
                in_channel(slave, channel, &["data_path.tx_budget_min", "data_path.tx_budget_max"])
            }
        },
        PortConfigFault::Plan(error) => match error {
            PortPlanError::EtherCat(error) => plan_locations(&error),
            PortPlanError::Budget { slave, channel, .. } => {
                in_channel(slave, channel, &["traffic"])
            }
            _ => Vec::new(),
        },
        PortConfigFault::Filter { slave, channel, fault } => {
            filter_locations(slave, channel, &fault)
        }
        PortConfigFault::HoldLimit { slave } => one(format!("{}.hold_limit", gateway(slave))),
        _ => Vec::new(),
    }
}

fn key_of(index: u16, subindex: u8) -> Option<&'static str> {
    lookup(index, subindex)?.1.key
}

fn pdo(direction: Direction) -> &'static str {
    match direction {
        Direction::TxPdo => "TxPDO",
        Direction::RxPdo => "RxPDO",
    }
}

fn adapter_locations(fault: &ConfigFault) -> Vec<String> {
    let one = |path: &str| vec![path.to_owned()];
    match *fault {
        ConfigFault::SameAddress { second, .. } => {
            let gateway = gateway(second);
            vec![format!("{gateway}.position"), format!("{gateway}.alias"), gateway]
        }
        ConfigFault::Multiplier { slave, pdo, .. } => in_direction(slave, pdo, "n"),
        ConfigFault::Cycle { .. } => one("cycle_us"),
        ConfigFault::WatchdogTime { .. } => one("watchdog_us"),
        ConfigFault::Plan(error) => plan_locations(&error),
        ConfigFault::Sync0Cycle { .. } => one("dc.cycle_us"),
        ConfigFault::Sync0Shift { .. } => one("dc.shift_us"),
        ConfigFault::ReferenceClock { .. } => one("dc.reference"),
        ConfigFault::Identity { slave } => vec![format!("{}.identity", gateway(slave))],
        _ => Vec::new(),
    }
}

fn plan_locations(error: &PlanError) -> Vec<String> {
    match *error {
        PlanError::LargePdo { slave, pdo, .. } => in_direction(slave, pdo, "n"),
        PlanError::Watchdog { .. } => vec!["watchdog_us".to_owned(), "cycle_us".to_owned()],
        _ => vec!["cycle_us".to_owned()],
    }
}

fn channel_locations(slave: usize, channel: u8, fault: ChannelFault) -> Vec<String> {
    let phase_keys = |phase, [nominal, data]: [&[&str]; 2]| match phase {
        Phase::Nominal => in_channel(slave, channel, nominal),
        Phase::Data => in_channel(slave, channel, data),
    };
    match fault {
        ChannelFault::Range(RangeFault { index, subindex, .. }) => {
            in_channel(slave, channel, &[key_of(index, subindex).unwrap_or("bitrate")])
        }
        ChannelFault::Timing { phase, error } => match error {
            BitTimingError::Window { .. } | BitTimingError::SamplePoint { .. } => phase_keys(
                phase,
                [&["sample_point", "bitrate"], &["data_sample_point", "data_bitrate"]],
            ),
            _ => phase_keys(phase, [&["bitrate"], &["data_bitrate"]]),
        },
        ChannelFault::ManualTiming { phase, .. } | ChannelFault::ManualBitrate { phase, .. } => {
            phase_keys(phase, [&["nominal_timing", "bit_timing"], &["data_timing", "bit_timing"]])
        }
        ChannelFault::DataBelowNominal { .. } => in_channel(slave, channel, &["data_bitrate"]),
        ChannelFault::TdcPrescaler { .. } => in_channel(slave, channel, &["tdc", "data_bitrate"]),
        ChannelFault::TransmitElements { .. } => {
            in_channel(slave, channel, &["ram.tx_dedicated_count", "ram.tx_fifo_size"])
        }
        ChannelFault::NoTransmitFifo => in_channel(slave, channel, &["ram.tx_fifo_size"]),
        ChannelFault::NonMatchWithoutFifo { fifo } => {
            let size = format!("ram.rx_fifo{fifo}_size");
            in_channel(slave, channel, &[&size, "non_match_standard", "non_match_extended"])
        }
        ChannelFault::MessageRam { .. } => in_channel(slave, channel, &["ram"]),
    }
}

fn filter_locations(slave: usize, channel: u8, fault: &FilterFault) -> Vec<String> {
    let (extended, at, key) = match *fault {
        FilterFault::TooMany { extended, max, .. } => (extended, usize::from(max), ""),
        FilterFault::Element { extended, at, fault } => {
            let key = match fault {
                FilterElementFault::Identifier { .. } => "id1",
                FilterElementFault::EmptyRange { .. } => "id2",
                FilterElementFault::NoBuffer { .. } => "rx_buffer",
                FilterElementFault::NoFifo { .. } => "action",
            };
            (extended, at, key)
        }
    };
    let table = if extended { EXTENDED_TABLE } else { STANDARD_TABLE };
    let table = format!("{table}[{at}]");
    in_channel(slave, channel, &[&format!("{table}.{key}"), &table])
}
