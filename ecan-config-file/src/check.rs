//! What is wrong with the whole of a configuration, put to the keys that it comes from.

use ecan_host::{ConfigFault, PlanError};
use ecan_mcan_port::{PortConfigFault, PortPlanError};
use ecan_protocol::can::{BitTimingError, MCAN_CLOCK_HZ, Phase, solve_data, solve_nominal};
use ecan_protocol::config::{
    ChannelFault, DataPathFault, FilterElementFault, FilterFault, RangeFault,
};
use ecan_protocol::image::ProfileError;
use ecan_protocol::mapping::Direction;

use crate::ConfigFile;
use crate::channel;
use crate::data_path;
use crate::document::Document;
use crate::filter::{EXTENDED_TABLE, STANDARD_TABLE};
use crate::gateway::CHANNEL_TABLES;

/// Checks the configuration; faults go to the document.
pub(crate) fn check(document: &mut Document<'_>, file: &ConfigFile) {
    let Err(faults) = file.port.check(&file.adapter) else { return };
    for fault in faults.0 {
        document.semantic_fault(&places(&fault), fault.to_string());
        if let Some(hidden) = hidden_behind(file, &fault) {
            document.semantic_fault(&places(&hidden), hidden.to_string());
        }
    }
}

/// A bit rate that has no timing either, behind a sample point window that is no window.
fn hidden_behind(file: &ConfigFile, fault: &PortConfigFault) -> Option<PortConfigFault> {
    let PortConfigFault::Channel { slave, channel, fault } = *fault else { return None };
    let ChannelFault::Timing { phase, error: BitTimingError::Window { .. } } = fault else {
        return None;
    };
    let gateway = file.port.gateways.get(slave)?;
    let can = &gateway.channels.get(usize::from(channel))?.as_ref()?.can;
    let solved = match phase {
        Phase::Nominal => solve_nominal(MCAN_CLOCK_HZ, can.nominal_bitrate, 0, 1_000),
        Phase::Data => solve_data(MCAN_CLOCK_HZ, can.data_bitrate, 0, 1_000),
    };
    let fault = ChannelFault::Timing { phase, error: solved.err()? };
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

/// The keys that a fault comes from, the likeliest first.
fn places(fault: &PortConfigFault) -> Vec<String> {
    let one = |path: String| vec![path];
    match *fault {
        PortConfigFault::Adapter(fault) => adapter_places(&fault),
        PortConfigFault::NoChannel { slave } => one(gateway(slave)),
        PortConfigFault::Profile { slave, direction, fault } => {
            let key = match fault {
                ProfileError::Multiplier(_) => "n",
                ProfileError::Encapsulation(_) => "profile",
                ProfileError::Budget(_) => "budget",
                _ => "options",
            };
            in_direction(slave, pdo(direction), key)
        }
        PortConfigFault::Bypass { slave, direction } => {
            in_direction(slave, pdo(direction), "options")
        }
        PortConfigFault::Channel { slave, channel, fault } => channel_places(slave, channel, fault),
        PortConfigFault::DataPath { slave, channel, fault } => {
            let keys: Vec<String> = match fault {
                DataPathFault::Range(RangeFault { subindex, .. }) => data_path::KEYS
                    .iter()
                    .filter(|(_, of, _)| *of == subindex)
                    .map(|(key, ..)| format!("data_path.{key}"))
                    .collect(),
                DataPathFault::RxBudget { .. } => {
                    ["rx_drain_min", "rx_drain_max"].map(|key| format!("data_path.{key}")).into()
                }
                DataPathFault::TxBudget { .. } => {
                    ["tx_budget_min", "tx_budget_max"].map(|key| format!("data_path.{key}")).into()
                }
            };
            in_channel(slave, channel, &keys.iter().map(String::as_str).collect::<Vec<_>>())
        }
        PortConfigFault::Plan(refusal) => match refusal {
            PortPlanError::EtherCat(refusal) => refusal_places(&refusal),
            PortPlanError::Budget { slave, channel, .. } => {
                in_channel(slave, channel, &["traffic"])
            }
            _ => Vec::new(),
        },
        PortConfigFault::Filter { slave, channel, fault } => filter_places(slave, channel, &fault),
        PortConfigFault::HoldLimit { slave } => one(format!("{}.hold_limit", gateway(slave))),
        _ => Vec::new(),
    }
}

fn pdo(direction: Direction) -> &'static str {
    match direction {
        Direction::TxPdo => "TxPDO",
        Direction::RxPdo => "RxPDO",
    }
}

fn adapter_places(fault: &ConfigFault) -> Vec<String> {
    let one = |path: &str| vec![path.to_owned()];
    match *fault {
        ConfigFault::SamePlace { second, .. } => {
            let gateway = gateway(second);
            vec![format!("{gateway}.position"), format!("{gateway}.alias"), gateway]
        }
        ConfigFault::Multiplier { slave, pdo, .. } => in_direction(slave, pdo, "n"),
        ConfigFault::Cycle { .. } => one("cycle_us"),
        ConfigFault::WatchdogTime { .. } => one("watchdog_us"),
        ConfigFault::Plan(refusal) => refusal_places(&refusal),
        ConfigFault::Sync0Cycle { .. } => one("dc.cycle_us"),
        ConfigFault::Sync0Shift { .. } => one("dc.shift_us"),
        ConfigFault::ReferenceClock { .. } => one("dc.reference"),
        ConfigFault::Identity { slave } => vec![format!("{}.identity", gateway(slave))],
        _ => Vec::new(),
    }
}

fn refusal_places(refusal: &PlanError) -> Vec<String> {
    match *refusal {
        PlanError::LargePdo { slave, pdo, .. } => in_direction(slave, pdo, "n"),
        PlanError::Watchdog { .. } => vec!["watchdog_us".to_owned(), "cycle_us".to_owned()],
        _ => vec!["cycle_us".to_owned()],
    }
}

fn channel_places(slave: usize, channel: u8, fault: ChannelFault) -> Vec<String> {
    let phase_keys = |phase, [nominal, data]: [&[&str]; 2]| match phase {
        Phase::Nominal => in_channel(slave, channel, nominal),
        Phase::Data => in_channel(slave, channel, data),
    };
    match fault {
        ChannelFault::Range(RangeFault { subindex, .. }) => {
            let key = channel::key_of(subindex);
            in_channel(slave, channel, &[key.as_deref().unwrap_or("bitrate")])
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

fn filter_places(slave: usize, channel: u8, fault: &FilterFault) -> Vec<String> {
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
