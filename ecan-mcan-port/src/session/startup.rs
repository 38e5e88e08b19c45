//! The startup steps that a gateway needs, in the manual's order (5.4.3, 14), and the restoring of a PDO
//! profile that it has lost since.

use RestoreStep::{Apply, Ended, OpRequested, ReadActive, ReadStatus};
use ecan_host::{
    Adapter, AdapterConfig, Expectation, RequestState, SdoRequestId, StartupPlan, StartupStep,
};
use ecan_protocol::config::{
    DataPathConfig, DataPathGlobal, DeviceConfig, McanChannelConfig, filter_writes,
};
use ecan_protocol::device::Capabilities;
use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::{CHANNELS, CHUNK_BYTES, Direction, HEADER_BYTES};
use ecan_protocol::object::SdoWrite;

use super::verification::{IN_USE, profile_readback};
use crate::config::{ChannelConfig, GatewayConfig, PortConfig};

const STATUS_OK: u32 = 0;
/// Support of header version 1, bit 1 of 0xF000:09.
const HEADER_VERSION_1: u64 = 1 << 1;

impl PortConfig {
    /// The startup steps that each gateway needs: capability checks, PDO profiles with readback,
    /// objects of the whole gateway, channels, filters and data paths.
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
            steps.extend(gateway.device.first_writes().map(StartupStep::Download));
            for (channel, settings) in gateway.channels.iter().enumerate() {
                if let Some(settings) = settings {
                    let channel = channel as u8;
                    let standard = self.standard_filters(index, channel);
                    let extended = self.extended_filters(index, channel);
                    let filters = filter_writes(channel, &standard, &extended);
                    push_channel(&mut steps, channel, settings, filters);
                }
            }
            push_device(&mut steps, &gateway.device);
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
    if let Some((index, subindex, bit)) = gateway.device.needed_rotation() {
        steps.push(StartupStep::Expect { index, subindex, expected: HasBits(bit.into()) });
    }
    if !gateway.allow_diagnostic_tests && gateway.device.diagnostic_test.is_none() {
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

/// What follows the channels: global data path and diagnostic test, and the readbacks of the whole gateway. A
/// rotation may take effect with the apply command of a channel (assumption H47).
fn push_device(steps: &mut Vec<StartupStep>, device: &DeviceConfig) {
    steps.extend(device.data_path_writes().map(StartupStep::Download));
    let apply = device.data_path.map(|_| DataPathGlobal::apply_write());
    steps.extend(apply.map(StartupStep::Download));
    steps.extend(
        device
            .readbacks()
            .map(|(index, subindex, value)| StartupStep::expect(index, subindex, value)),
    );
    steps.extend(device.test_writes().map(StartupStep::Download));
}

fn push_applied(steps: &mut Vec<StartupStep>, apply: SdoWrite, status_subindex: u8) {
    steps.push(StartupStep::Download(apply));
    steps.push(StartupStep::expect(apply.index, status_subindex, STATUS_OK));
}

/// Time in SAFEOP before the profiles are read, in nanoseconds.
pub(crate) const SAFEOP_NS: u64 = 1_000_000_000;
/// Time in SAFEOP in which another startup must not be requested, since it would begin before the restored profiles
/// lead to OP. It passes only if the mailbox does not answer or OP is rejected.
pub(crate) const RESTORE_NS: u64 = 10_000_000_000;

const ACTIVE_WORD: u8 = 12;
const STATUS: u8 = 2;
const APPLY: u8 = 1;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum RestoreStep {
    ReadActive(usize),
    Apply(usize),
    ReadStatus(usize),
    OpRequested,
    /// The attempt is over: no profile was lost, or a transfer failed.
    Ended,
}

#[derive(Debug)]
pub(crate) struct ProfileRestore {
    slave: usize,
    read: SdoRequestId,
    apply: SdoRequestId,
    /// Profile objects and the words of their profiles.
    profiles: [(u16, u32); 2],
    step: RestoreStep,
    is_begun: bool,
    is_lost: bool,
}

impl ProfileRestore {
    /// Creates the request; the Adapter must be configured and not yet active.
    pub(crate) fn new(
        adapter: &mut Adapter,
        slave: usize,
        [tx, rx]: [PdoProfile; 2],
    ) -> Result<Self, ecan_host::Error> {
        let mut request = |size| {
            let request = adapter.requests().create_sdo(slave, size)?;
            adapter.requests().sdo_timeout(request, 0)?;
            Ok::<_, ecan_host::Error>(request)
        };
        let (read, apply) = (request(4)?, request(1)?);
        let profiles = [(Direction::TxPdo, tx), (Direction::RxPdo, rx)];
        Ok(Self {
            slave,
            read,
            apply,
            profiles: profiles.map(|(direction, it)| (direction.profile_object(), it.word())),
            step: ReadActive(0),
            is_begun: false,
            is_lost: false,
        })
    }

    /// The gateway is not in SAFEOP: its next stay there has an attempt of its own.
    pub(crate) fn reset(&mut self) {
        (self.step, self.is_begun, self.is_lost) = (ReadActive(0), false, false);
    }

    /// Returns whether the attempt of this stay in SAFEOP is over and leads to no OP.
    pub(crate) fn has_ended(&self) -> bool {
        self.step == Ended
    }

    /// One step, once a cycle in SAFEOP; one attempt until [`reset`](Self::reset).
    pub(crate) fn step(&mut self, adapter: &mut Adapter) {
        let (ReadActive(nth) | Apply(nth) | ReadStatus(nth)) = self.step else { return };
        let Some(&(index, word)) = self.profiles.get(nth) else { return };
        let request = if let Apply(_) = self.step { self.apply } else { self.read };
        let state = adapter.requests().sdo_state(request);
        if matches!(state, Ok(RequestState::Busy)) {
            return;
        }
        if !self.is_begun {
            self.is_begun = match self.step {
                Apply(_) => adapter.requests().sdo_write(request, index, APPLY, &[1]).is_ok(),
                ReadActive(_) => adapter.requests().sdo_read(request, index, ACTIVE_WORD).is_ok(),
                _ => adapter.requests().sdo_read(request, index, STATUS).is_ok(),
            };
            return;
        }
        self.is_begun = false;
        if !matches!(state, Ok(RequestState::Success)) {
            self.step = Ended;
            return;
        }
        let mut value = [0; 4];
        for (to, from) in value.iter_mut().zip(adapter.requests().sdo_data(request)) {
            *to = *from;
        }
        let value = u32::from_le_bytes(value);
        let is_in_use = IN_USE.contains(&u64::from(value));
        self.step = match self.step {
            ReadActive(0) => {
                self.is_lost |= value != word;
                ReadActive(1)
            }
            ReadActive(_) if self.is_lost || value != word => Apply(0),
            Apply(0) => Apply(1),
            Apply(_) => ReadStatus(0),
            ReadStatus(0) if is_in_use => ReadStatus(1),
            ReadStatus(_) if is_in_use => self.request_op(adapter),
            _ => Ended,
        };
    }

    fn request_op(&self, adapter: &mut Adapter) -> RestoreStep {
        let slave = self.slave;
        tracing::warn!(
            slave,
            "slave {slave}: PDO profiles applied again in SAFEOP (lost after the master rewrote the PDO \
             assignment, assumption H41)"
        );
        // A request that is rejected leaves the gateway in SAFEOP, as it was.
        let _ = adapter.requests().enter_op(self.slave);
        OpRequested
    }
}
