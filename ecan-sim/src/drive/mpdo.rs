//! Multiplexed PDOs of a drive (CiA 301, 7.2.2.4): it consumes them in destination address mode and produces them in
//! source address mode.

use ecan_canopen::{Mpdo, MpdoAddress};

use super::device::{Device, send};
use crate::node::NodeOutput;

/// EMCY error code: the destination object of an MPDO is not available.
const NO_DESTINATION: u16 = 0x8230;
/// EMCY error code: MPDO with another length than 8 bytes.
const LENGTH: u16 = 0x8210;

impl Device {
    /// Writes the object that an MPDO in destination address mode names.
    pub(super) fn on_mpdo(&mut self, data: &[u8]) {
        let Ok(mpdo) = Mpdo::parse(data) else { return self.report(LENGTH) };
        let is_destination = matches!(mpdo.address, MpdoAddress::Destination(_));
        if !is_destination || !mpdo.is_for(self.config.node) {
            return;
        }
        self.received_pdos += 1;
        let key = (mpdo.index, mpdo.subindex);
        let value = self.size(key).and_then(|size| mpdo.data.get(..size));
        if value.is_none_or(|value| self.download(key, value).is_err()) {
            self.report(NO_DESTINATION);
        }
    }

    /// Sends the changed objects of scanner lists.
    pub(super) fn send_scanned(&mut self, out: &mut NodeOutput) {
        let node = self.config.node;
        for pdo in &mut self.transmit {
            let Some(id) = pdo.id else { continue };
            while let Some((slot, value)) = pdo.next_scanned(self.now, &self.objects) {
                let Some(object) = self.objects.object(slot) else { continue };
                let bytes = value.to_le_bytes();
                let value = bytes.get(..4).unwrap_or_default();
                if let Some(mpdo) = Mpdo::new(MpdoAddress::Source(node), object.key(), value) {
                    send(&self.config, out, id, &mpdo.to_bytes());
                }
            }
        }
    }
}
