//! Check of a network as a whole.

use super::network_description::NetworkDescription;
use super::network_fault::{NetworkFault, NetworkFaultKind};
use super::{cob_id_check, load_check, parameter_check, pdo_check};
use crate::device_file::BitRates;

impl NetworkDescription {
    /// Checks the description as a whole and returns every fault: addresses, bit rates, PDOs,
    /// COB-IDs over each bus, values, bus load. Nothing is sent.
    pub fn check(&self) -> Vec<NetworkFault> {
        let mut faults = Vec::new();
        self.check_addresses(&mut faults);
        for (nth, node) in self.nodes.iter().enumerate() {
            let mut report = |kind| faults.push(NetworkFault { nodes: vec![nth], kind });
            pdo_check::check(node, &mut report);
            parameter_check::check(node, &mut report);
        }
        cob_id_check::check(self, &mut faults);
        load_check::check(self, &mut faults);
        faults
    }

    fn check_addresses(&self, faults: &mut Vec<NetworkFault>) {
        let nodes = || self.nodes.iter().enumerate();
        for (nth, node) in nodes() {
            let address = node.address;
            let mut fault = |nodes, kind| faults.push(NetworkFault { nodes, kind });
            if let Some((first, _)) = nodes().take(nth).find(|(_, it)| it.address == address) {
                fault(vec![first, nth], NetworkFaultKind::Duplicate { address });
            }
            if self.host_heartbeat.is_some_and(|host| host.node == address.node) {
                fault(vec![nth], NetworkFaultKind::HostNode { node: address.node });
            }
            let key = (address.slave, address.channel);
            match self.channels.iter().find(|it| (it.slave, it.channel) == key) {
                None => fault(vec![nth], NetworkFaultKind::Channel { address }),
                Some(channel) => {
                    let bitrate = channel.can.nominal_bitrate;
                    let rates = node.device.as_ref().map(|device| &device.device_info.bit_rates);
                    // A file without any bit rate states nothing.
                    let excludes =
                        |rates: &BitRates| !rates.kbit_per_s.is_empty() && !rates.contains(bitrate);
                    if rates.is_some_and(excludes) {
                        fault(vec![nth], NetworkFaultKind::BitRate { bitrate });
                    }
                }
            }
        }
    }
}
