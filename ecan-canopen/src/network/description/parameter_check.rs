//! Check of the values for a node against its device file.

use super::network_fault::NetworkFaultKind;
use super::node_description::NodeDescription;
use crate::network::boot::Parameter;

pub(super) fn check(node: &NodeDescription, report: &mut impl FnMut(NetworkFaultKind)) {
    let Some(device) = node.device.as_deref() else { return };
    for value in &node.overrides {
        let Parameter { index, subindex, data, .. } = value;
        let subject = value.subject();
        let Some(entry) = device.entry(*index, *subindex) else {
            report(NetworkFaultKind::NoParameter { subject });
            continue;
        };
        if !entry.access.is_writable() {
            report(NetworkFaultKind::ReadOnly { subject });
            continue;
        }
        if let Some(expected) = entry.data_type.size()
            && expected != data.len()
        {
            report(NetworkFaultKind::ValueLength { subject, expected, found: data.len() });
            continue;
        }
        let number = entry.data_type.decode(data).ok().and_then(|value| value.to_integer());
        let (low, high) = entry.limits(node.address.node);
        let (range_low, range_high) = entry.data_type.range().unwrap_or_default();
        let low = low.and_then(|it| it.to_integer()).unwrap_or(range_low);
        let high = high.and_then(|it| it.to_integer()).unwrap_or(range_high);
        if let Some(number) = number
            && !(low..=high).contains(&number)
        {
            let (value, low, high) = (number.to_string(), low.to_string(), high.to_string());
            report(NetworkFaultKind::Limit { subject, value, low, high });
        }
    }
}
