//! Comparison of a node with the device that a DCF describes.

use ecan_canopen::{DeviceFile, object};

use crate::commands::node::node_client::NodeClient;
use crate::context::{Failure, Result};

/// Rejects a node that is another device than the one of the file.
///
/// # Errors
/// Vendor-ID or product code differ; the node does not answer.
pub fn check(client: &mut NodeClient, file: &DeviceFile, name: &str) -> Result {
    let info = &file.device_info;
    let parts = [("vendor-ID", 1, info.vendor_number), ("product code", 2, info.product_number)];
    for (what, subindex, expected) in parts {
        let Some(expected) = expected.filter(|it| *it != 0) else { continue };
        let Some(found) = client.number(object::IDENTITY, subindex)? else { continue };
        if found != u64::from(expected) {
            return Err(Failure::Rejected(format!(
                "{} has {what} 0x{found:08X}, and {name} is for 0x{expected:08X}; use the file of \
                 this device",
                client.target()
            )));
        }
    }
    Ok(())
}
