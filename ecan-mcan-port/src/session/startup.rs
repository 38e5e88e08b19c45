//! The startup steps that a gateway needs, in the manual's order (5.4.3, 14).

use ecan_host::{AdapterConfig, Expectation, StartupPlan, StartupStep};
use ecan_protocol::config::{DataPathConfig, McanChannelConfig, filter_writes};
use ecan_protocol::device::Capabilities;
use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::{CHANNELS, CHUNK_BYTES, Direction, HEADER_BYTES};
use ecan_protocol::object::SdoWrite;

use crate::port_config::{ChannelConfig, GatewayConfig, PortConfig};
use crate::session::verification::profile_readback;

const STATUS_OK: u32 = 0;
/// Support of header version 1, bit 1 of 0xF000:09.
const HEADER_VERSION_1: u64 = 1 << 1;

impl PortConfig {
    /// The startup steps that each gateway needs: capability checks, PDO profiles with readback,
    /// channels, filters and data paths.
    ///
    /// [`Port::open`](crate::Port::open) passes them to the Adapter; call this only to open the
    /// Adapter yourself. A slave without a gateway entry has none.
    pub fn startup_plan(&self, adapter: &AdapterConfig) -> StartupPlan {
        let slaves = adapter.slaves.iter().zip(&self.gateways);
        let steps = slaves.enumerate().map(|(index, (slave, gateway))| {
            let rx = gateway.profile(Direction::RxPdo, slave.rx_multiplier);
            let tx = gateway.profile(Direction::TxPdo, slave.tx_multiplier);
            let mut steps = Vec::with_capacity(400);
            push_capabilities(&mut steps, gateway, &rx, &tx);
            push_profile(&mut steps, Direction::TxPdo, &tx);
            push_profile(&mut steps, Direction::RxPdo, &rx);
            push_apply(&mut steps, Direction::TxPdo, &tx);
            push_apply(&mut steps, Direction::RxPdo, &rx);
            for (channel, settings) in gateway.channels.iter().enumerate() {
                if let Some(settings) = settings {
                    let channel = channel as u8;
                    let standard = self.standard_filters(index, channel);
                    let extended = self.extended_filters(index, channel);
                    let filters = filter_writes(channel, &standard, &extended);
                    push_channel(&mut steps, channel, settings, filters);
                }
            }
            steps
        });
        steps.collect()
    }
}

/// Capabilities that the gateway must have, from 0xF000 (manual 13.8), and the diagnostic tests of
/// 0x8030 that must not cut the CAN side off.
fn push_capabilities(
    steps: &mut Vec<StartupStep>,
    gateway: &GatewayConfig,
    rx: &PdoProfile,
    tx: &PdoProfile,
) {
    use Expectation::{AtLeast, AtMost, Equals, HasBits};
    let channels = 8 - gateway.channel_mask().leading_zeros();
    let profiles = (1 << rx.profile.raw()) | (1 << tx.profile.raw());
    let options = rx.options.with(tx.options);
    let least = u64::from(rx.multiplier.min(tx.multiplier));
    let most = u64::from(rx.multiplier.max(tx.multiplier));
    let capabilities = [
        (2, AtLeast(channels.into())),
        (9, HasBits(HEADER_VERSION_1)),
        (10, AtMost(least)),
        (11, AtLeast(most)),
        (12, HasBits(profiles)),
        (15, HasBits(options.bits().into())),
        (17, Equals(CHUNK_BYTES as u64)),
        (18, Equals(HEADER_BYTES as u64)),
    ];
    for (subindex, expected) in capabilities {
        steps.push(StartupStep::Expect { index: Capabilities::INDEX, subindex, expected });
    }
    if !gateway.allow_diagnostic_tests {
        steps.extend((2..=6).map(|subindex| StartupStep::expect(0x8030, subindex, 0)));
    }
}

fn push_profile(steps: &mut Vec<StartupStep>, direction: Direction, profile: &PdoProfile) {
    steps.extend(profile.writes(direction).map(StartupStep::Download));
}

/// Applies a profile and reads back what became active (manual 5.4.3 phase D).
fn push_apply(steps: &mut Vec<StartupStep>, direction: Direction, profile: &PdoProfile) {
    let apply = PdoProfile::apply_write(direction);
    let index = apply.index;
    steps.push(StartupStep::Download(apply));
    steps.push(StartupStep::expect(index, 2, STATUS_OK));
    let readback = profile_readback(profile);
    steps.extend(readback.map(|(subindex, value)| StartupStep::expect(index, subindex, value)));
}

fn push_channel(
    steps: &mut Vec<StartupStep>,
    channel: u8,
    settings: &ChannelConfig,
    filters: impl Iterator<Item = SdoWrite>,
) {
    debug_assert!(usize::from(channel) < CHANNELS);
    steps.extend(settings.can.needed_writes(channel).map(StartupStep::Download));
    steps.extend(filters.map(StartupStep::Download));
    push_applied(steps, McanChannelConfig::apply_write(channel), 2);
    steps.extend(settings.data_path.writes(channel).map(StartupStep::Download));
    push_applied(steps, DataPathConfig::apply_write(channel), 3);
}

fn push_applied(steps: &mut Vec<StartupStep>, apply: SdoWrite, status_subindex: u8) {
    steps.push(StartupStep::Download(apply));
    steps.push(StartupStep::expect(apply.index, status_subindex, STATUS_OK));
}
