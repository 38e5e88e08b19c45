//! LSS slave of a drive (CiA 305): states, addresses, pending settings, and the switch of the bit rate.

use ecan_canopen::{
    LssAddress, LssAddressRange, LssBitRate, LssConfirmation, LssPart, LssRequest, LssResponse,
    NodeId, RangePart, UNCONFIGURED_NODE_ID, object,
};

use super::dictionary::Dictionary;

const MS: u64 = 1_000_000;

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
struct BitRateSwitch {
    bit_per_s: Option<u32>,
    /// End of both delays: the drive takes part in the bus again.
    ends_at: u64,
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
    node: Option<NodeId>,
    /// Bit rate that was configured, in bit/s.
    bit_per_s: Option<u32>,
    switch: Option<BitRateSwitch>,
    pending: Settings,
    stored: Settings,
}

impl LssSlave {
    /// Active node-ID; `None` before one was configured.
    pub(super) const fn node(&self) -> Option<NodeId> {
        self.node
    }

    /// Bit rate that was configured, in bit/s.
    pub(super) const fn bit_per_s(&self) -> Option<u32> {
        self.bit_per_s
    }

    /// Begins a switch of the bit rate: the drive is off the bus during both delays.
    pub(super) fn begin_switch(&mut self, bit_per_s: Option<u32>, delay_ms: u16, now: u64) {
        let delays = 2 * u64::from(delay_ms) * MS;
        let ends_at = now.saturating_add(delays.max(1));
        self.switch = Some(BitRateSwitch { bit_per_s, ends_at });
    }

    /// Ends a switch of the bit rate that is due. Returns whether there was one.
    pub(super) fn finish_switch(&mut self, now: u64) -> bool {
        let due = self.switch.take_if(|switch| switch.ends_at <= now);
        due.map(|switch| self.bit_per_s = switch.bit_per_s).is_some()
    }

    pub(super) fn cancel_switch(&mut self) {
        self.switch = None;
    }

    pub(super) fn switch_ends_at(&self) -> Option<u64> {
        self.switch.map(|switch| switch.ends_at)
    }

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
            bit_per_s: None,
            switch: None,
            pending: settings,
            stored: settings,
        }
    }

    /// Power-on or reset of the node: the stored settings apply.
    pub(super) fn reset_node(&mut self) {
        self.pending = self.stored;
        self.reset_communication();
        self.bit_per_s = self.pending.bit_rate.and_then(LssBitRate::bit_per_s);
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

/// LSS address of a drive: its identity object.
pub(super) fn lss_address(objects: &Dictionary) -> LssAddress {
    let mut address = LssAddress::default();
    for part in LssPart::ALL {
        let value = objects.number(object::IDENTITY, part.raw() + 1).unwrap_or(0);
        address.set_part(*part, value as u32);
    }
    address
}
