//! Finds settings that lose frames, or may not match the bus.

use ecan_host::AdapterConfig;
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::config::{DataSize, FilterAction, NodeMode, NonMatch};
use ecan_protocol::image::{BudgetPolicy, OptionFlags, PdoProfile};
use ecan_protocol::mapping::Direction;

use super::GatewayPlan;
use super::image::ImagePlan;
use super::setting_warning::{Elements, FD_MULTIPLIER, SettingWarning};
use crate::port_config::{ChannelConfig, GatewayConfig, PortConfig};

/// The warnings of a configuration. Allocates.
pub(super) fn warnings(
    adapter: &AdapterConfig,
    port: &PortConfig,
    plans: &[GatewayPlan],
) -> Vec<SettingWarning> {
    let mut warnings = Vec::new();
    let gateways = port.gateways.iter().zip(&adapter.slaves).zip(plans);
    for (slave, ((gateway, size), images)) in gateways.enumerate() {
        for (channel, settings) in channels(gateway) {
            settings.can.warnings(&mut |warning| {
                warnings.push(SettingWarning::BitTiming { slave, channel, warning });
            });
            let actions = filter_actions(port, slave, channel);
            let [sends, receives] =
                [&images.rx, &images.tx].map(|image| image.profile.has_channel(channel));
            let uses = |elements| if elements == Elements::Transmit { sends } else { receives };
            warnings.extend(short_elements(slave, channel, settings, &actions, uses));
            if receives && receives_nothing(settings, &actions) {
                warnings.push(SettingWarning::NothingReceived { slave, channel });
            }
            let reports = images.tx.profile.options.contains(OptionFlags::TX_RESULT);
            if reports && !receives {
                warnings.push(SettingWarning::ResultsOfSendOnly { slave, channel });
            }
            let directions = [&images.rx, &images.tx].into_iter();
            let carrying = directions.filter(|image| image.profile.has_channel(channel));
            warnings.extend(carrying.filter_map(|it| short_share(slave, channel, settings, it)));
        }
        let sizes =
            [(Direction::RxPdo, size.rx_multiplier), (Direction::TxPdo, size.tx_multiplier)];
        for (direction, multiplier) in sizes {
            let has_fd = channels(gateway)
                .any(|(channel, settings)| settings.can.fd && gateway.carries(direction, channel));
            if has_fd && multiplier < FD_MULTIPLIER {
                warnings.push(SettingWarning::FdImageSize { slave, direction, multiplier });
            }
        }
    }
    warnings
}

fn short_share(
    slave: usize,
    channel: u8,
    settings: &ChannelConfig,
    image: &ImagePlan,
) -> Option<SettingWarning> {
    let frame = largest_frame(settings.can.fd)?;
    let direction = image.direction;
    let frame_bytes = image.packet_bytes(frame.as_ref(), false);
    let share_bytes = share(direction, &image.profile);
    (frame_bytes > share_bytes).then_some(SettingWarning::ShareBelowFrame {
        slave,
        channel,
        direction,
        frame_bytes,
        share_bytes,
    })
}

fn filter_actions(port: &PortConfig, slave: usize, channel: u8) -> Vec<FilterAction> {
    let standard = port.standard_filters(slave, channel).into_iter().map(|it| it.action);
    let extended = port.extended_filters(slave, channel).into_iter().map(|it| it.action);
    standard.chain(extended).collect()
}

fn receives_nothing(settings: &ChannelConfig, actions: &[FilterAction]) -> bool {
    let can = &settings.can;
    let rejects = |non_match| matches!(non_match, NonMatch::Reject | NonMatch::RejectToo);
    let takes_none = |action: &FilterAction| {
        matches!(action, FilterAction::Disabled | FilterAction::Reject | FilterAction::Priority)
    };
    rejects(can.non_match_standard)
        && rejects(can.non_match_extended)
        && actions.iter().all(takes_none)
}

fn channels(gateway: &GatewayConfig) -> impl Iterator<Item = (u8, &ChannelConfig)> {
    (0..).zip(&gateway.channels).filter_map(|(channel, it)| Some((channel, it.as_ref()?)))
}

/// Data of the largest length with a CAN ID of 29 bits.
fn largest_frame(is_fd: bool) -> Option<CanFrame> {
    let id = CanId::extended(0).ok()?;
    match is_fd {
        true => CanFrame::fd(id, &[0; 64], true, false).ok(),
        false => CanFrame::classic(id, &[0; 8]).ok(),
    }
}

/// Bytes of the frame area that one channel can use. The Port lets any channel fill an RxPDO.
fn share(direction: Direction, profile: &PdoProfile) -> usize {
    let area = profile.frame_area_bytes();
    match (direction, profile.budget) {
        (Direction::TxPdo, BudgetPolicy::Deterministic) => {
            area / profile.channel_mask.count_ones().max(1) as usize
        }
        _ => area,
    }
}

/// Elements that a CAN FD channel uses and that do not hold 64 bytes.
fn short_elements(
    slave: usize,
    channel: u8,
    settings: &ChannelConfig,
    actions: &[FilterAction],
    uses: impl Fn(Elements) -> bool,
) -> impl Iterator<Item = SettingWarning> {
    let (can, ram) = (&settings.can, &settings.can.ram);
    let takes = |non_match, is_used: fn(FilterAction) -> bool| {
        [can.non_match_standard, can.non_match_extended].map(Some).contains(&non_match)
            || actions.iter().any(|action| is_used(*action))
    };
    let fifo0 = |action| matches!(action, FilterAction::Fifo0 | FilterAction::PriorityFifo0);
    let fifo1 = |action| matches!(action, FilterAction::Fifo1 | FilterAction::PriorityFifo1);
    let buffer = |action| matches!(action, FilterAction::RxBuffer(_));
    let used = [
        (Elements::RxFifo0, ram.rx_fifo0.data_size, takes(Some(NonMatch::Fifo0), fifo0)),
        (Elements::RxFifo1, ram.rx_fifo1.data_size, takes(Some(NonMatch::Fifo1), fifo1)),
        (Elements::RxBuffers, ram.rx_buffer_data_size, takes(None, buffer)),
        (Elements::Transmit, ram.tx_data_size, can.node_mode != NodeMode::Listen),
    ];
    let is_fd = can.fd;
    let is_short = move |(elements, size, is_used): (Elements, DataSize, bool)| {
        let bytes = size.bytes();
        (is_fd && is_used && uses(elements) && bytes < DataSize::B64.bytes())
            .then_some(SettingWarning::ShortElements { slave, channel, elements, bytes })
    };
    used.into_iter().filter_map(is_short)
}
