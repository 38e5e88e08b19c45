//! Node-ID and bit rate of a drive, as LSS configures them.

use ecan_canopen::{CobId, LssAddress, LssPart, LssRequest, NodeId, object};

use super::can_id_set::CanIdSet;
use super::device::Device;
use super::dictionary::Object;
use super::lss_slave::{BitRateSwitch, LssAction};
use crate::node::NodeOutput;

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
