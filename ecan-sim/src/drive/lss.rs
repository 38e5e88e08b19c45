//! LSS slave of a drive (CiA 305): states, addresses and pending settings, without time and bus.

use super::device::Device;
use super::dictionary::Object;
use super::pdo::CanIdSet;
use crate::node::NodeOutput;
use ecan_canopen::{
    CobId, LssAddress, LssAddressRange, LssBitRate, LssConfirmation, LssPart, LssRequest,
    LssResponse, NodeId, RangePart, UNCONFIGURED_NODE_ID, object,
};

/// Reaction of the drive to a request, besides the response.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LssAction {
    /// The drive has got its first node-ID and boots.
    Boot,
    /// The drive switches its bit rate, in bit/s, after a delay.
    SwitchBitRate { bit_per_s: Option<u32>, delay_ms: u16 },
}

/// Switch of the bit rate in progress.
#[derive(Clone, Copy, Debug)]
pub(super) struct BitRateSwitch {
    pub(super) bit_per_s: Option<u32>,
    /// End of both delays: the drive takes part in the bus again.
    pub(super) ends_at: u64,
}

/// Node-ID and bit rate; `None` is no node-ID, and the bit rate of the scenario.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Settings {
    node: Option<NodeId>,
    bit_rate: Option<LssBitRate>,
}

#[derive(Clone, Debug)]
pub(super) struct LssSlave {
    can_store: bool,
    is_configuring: bool,
    /// Parts of a selective switch that matched in order.
    matched_parts: u8,
    /// Parts of the range of an identification, in order.
    range: LssAddressRange,
    range_parts: u8,
    fastscan_part: LssPart,
    /// Active node-ID.
    pub(super) node: Option<NodeId>,
    pending: Settings,
    stored: Settings,
}

impl LssSlave {
    pub(super) const fn new(node: Option<NodeId>, can_store: bool) -> Self {
        let settings = Settings { node, bit_rate: None };
        Self {
            can_store,
            is_configuring: false,
            matched_parts: 0,
            range: LssAddressRange::of_product(0, 0),
            range_parts: 0,
            fastscan_part: LssPart::Vendor,
            node,
            pending: settings,
            stored: settings,
        }
    }

    /// Power-on or reset of the node: the stored settings apply. Returns the bit rate in bit/s.
    pub(super) fn reset_node(&mut self) -> Option<u32> {
        self.pending = self.stored;
        self.reset_communication();
        self.pending.bit_rate.and_then(LssBitRate::bit_per_s)
    }

    /// Reset of communication: the pending node-ID applies.
    pub(super) fn reset_communication(&mut self) {
        self.is_configuring = false;
        self.matched_parts = 0;
        self.range_parts = 0;
        self.node = self.pending.node;
    }

    /// Receives a request; `own` is the address of the drive.
    pub(super) fn receive(
        &mut self,
        request: LssRequest,
        own: &LssAddress,
    ) -> (Option<LssResponse>, Option<LssAction>) {
        let mut action = None;
        let response = match request {
            LssRequest::SwitchGlobal { configuration } => {
                self.is_configuring = configuration;
                self.matched_parts = 0;
                if !configuration && self.node.is_none() && self.pending.node.is_some() {
                    self.node = self.pending.node;
                    action = Some(LssAction::Boot);
                }
                None
            }
            LssRequest::SwitchSelective { part, value } => self.select(part, value, own),
            LssRequest::IdentifyRemote { part, value } => self.identify(part, value, own),
            LssRequest::IdentifyNonConfigured => {
                self.is_unconfigured().then_some(LssResponse::NonConfigured)
            }
            LssRequest::Fastscan { value, bit_check, part, next } => self
                .fastscan((value, bit_check, part, next), own)
                .then_some(LssResponse::Identified),
            _ if !self.is_configuring => None,
            LssRequest::ConfigureNodeId { node } => {
                let id = NodeId::new(node);
                let is_valid = id.is_some() || node == UNCONFIGURED_NODE_ID;
                if is_valid {
                    self.pending.node = id;
                }
                Some(LssResponse::NodeIdConfigured(confirmation(is_valid)))
            }
            LssRequest::ConfigureBitTiming { table, entry } => {
                let bit_rate = LssBitRate::from_raw(entry)
                    .filter(|rate| table == LssBitRate::TABLE && rate.bit_per_s().is_some());
                if bit_rate.is_some() {
                    self.pending.bit_rate = bit_rate;
                }
                Some(LssResponse::BitTimingConfigured(confirmation(bit_rate.is_some())))
            }
            LssRequest::ActivateBitTiming { delay_ms } => {
                let bit_per_s = self.pending.bit_rate.and_then(LssBitRate::bit_per_s);
                action = Some(LssAction::SwitchBitRate { bit_per_s, delay_ms });
                None
            }
            LssRequest::Store => {
                if self.can_store {
                    self.stored = self.pending;
                }
                Some(LssResponse::Stored(confirmation(self.can_store)))
            }
            LssRequest::Inquire(part) => Some(LssResponse::Address { part, value: own.part(part) }),
            LssRequest::InquireNodeId => {
                let node = self.node.map_or(UNCONFIGURED_NODE_ID, NodeId::get);
                Some(LssResponse::NodeId { node })
            }
        };
        (response, action)
    }

    const fn is_unconfigured(&self) -> bool {
        self.node.is_none() && self.pending.node.is_none()
    }

    fn select(&mut self, part: LssPart, value: u32, own: &LssAddress) -> Option<LssResponse> {
        if self.is_configuring {
            return None;
        }
        let is_next = part == LssPart::Vendor || self.matched_parts == part.raw();
        let matches = is_next && own.part(part) == value;
        self.matched_parts = if matches { part.raw() + 1 } else { 0 };
        self.is_configuring = matches && part == LssPart::Serial;
        self.is_configuring.then_some(LssResponse::Selected)
    }

    fn identify(&mut self, part: RangePart, value: u32, own: &LssAddress) -> Option<LssResponse> {
        let range = &mut self.range;
        match part {
            RangePart::Vendor => range.vendor = value,
            RangePart::Product => range.product = value,
            RangePart::RevisionLow => range.revision.0 = value,
            RangePart::RevisionHigh => range.revision.1 = value,
            RangePart::SerialLow => range.serial.0 = value,
            RangePart::SerialHigh => range.serial.1 = value,
        }
        let position = part.raw() - RangePart::Vendor.raw();
        let is_next = position == 0 || self.range_parts == position;
        self.range_parts = if is_next { position + 1 } else { 0 };
        let is_complete = is_next && part == RangePart::SerialHigh;
        (is_complete && self.range.contains(own)).then_some(LssResponse::Identified)
    }

    fn fastscan(
        &mut self,
        (value, bit_check, part, next): (u32, u8, LssPart, LssPart),
        own: &LssAddress,
    ) -> bool {
        if self.is_configuring || !self.is_unconfigured() {
            return false;
        }
        if bit_check == LssRequest::FASTSCAN_START {
            self.fastscan_part = LssPart::Vendor;
            return true;
        }
        let differing = u64::from(value ^ own.part(part)) >> bit_check;
        if part != self.fastscan_part || differing != 0 {
            return false;
        }
        self.fastscan_part = next;
        self.is_configuring = bit_check == 0 && next.raw() < part.raw();
        true
    }
}

const fn confirmation(is_accepted: bool) -> LssConfirmation {
    if is_accepted { LssConfirmation::OK } else { LssConfirmation::UNSUPPORTED }
}

const MS: u64 = 1_000_000;
/// Objects whose values a change of the node-ID resets: the communication profile.
const COMMUNICATION: std::ops::RangeInclusive<u16> = 0x1000..=0x1FFF;

impl Device {
    pub(super) fn on_lss(&mut self, data: &[u8], out: &mut NodeOutput) {
        if self.config.quirks.no_lss {
            return;
        }
        let Some(request) = LssRequest::parse(data) else { return };
        let own = self.lss_address();
        let (response, action) = self.lss.receive(request, &own);
        if let Some(response) = response {
            self.send(out, CobId::LSS_RESPONSE, &response.to_bytes());
        }
        match action {
            None => {}
            Some(LssAction::Boot) => self.restart_communication(),
            Some(LssAction::SwitchBitRate { bit_per_s, delay_ms }) => {
                let delays = 2 * u64::from(delay_ms) * MS;
                let ends_at = self.now.saturating_add(delays.max(1));
                self.bit_rate_switch = Some(BitRateSwitch { bit_per_s, ends_at });
                self.on_bus = false;
            }
        }
    }

    pub(super) fn lss_address(&self) -> LssAddress {
        let mut address = LssAddress::default();
        for part in LssPart::ALL {
            let value = self.objects.number(object::IDENTITY, part.raw() + 1).unwrap_or(0);
            address.set_part(*part, value as u32);
        }
        address
    }

    /// Ends a switch of the bit rate that is due.
    pub(super) fn switch_bit_rate(&mut self) {
        if let Some(switch) = self.bit_rate_switch.take_if(|switch| switch.ends_at <= self.now) {
            self.bit_per_s = switch.bit_per_s;
            self.on_bus = true;
        }
    }

    /// Applies the node-ID of the LSS slave. Objects outside the communication profile keep their values.
    pub(super) fn apply_node_id(&mut self) {
        let Some(node) = self.lss.node.filter(|node| *node != self.config.node) else { return };
        self.config.node = node;
        self.services = CanIdSet::services_of(node);
        let (mut objects, _) = self.source.objects(&self.config);
        for object in objects.iter_mut() {
            let Ok(slot) = self.objects.find(object.key()) else { continue };
            if let Some(before) = self.objects.object(slot) {
                carry_over(before, object);
            }
        }
        self.objects = objects;
    }

    pub(super) fn is_unconfigured(&self) -> bool {
        self.lss.node.is_none()
    }

    /// Node-ID; `None` before LSS has configured one.
    pub(super) fn node_id(&self) -> Option<NodeId> {
        self.lss.node
    }
}

/// Keeps the saved value, unless it depends on the node-ID as the default does.
fn carry_over(before: &Object, object: &mut Object) {
    if before.default == object.default {
        object.saved.clone_from(&before.saved);
    }
    if !COMMUNICATION.contains(&object.index) {
        object.value.clone_from(&before.value);
    }
}
