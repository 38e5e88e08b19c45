//! Snapshot of a simulated gateway.

use ecan_sim::Gateway;
use ecan_tool_support::diagnosis::{Depth, ReadError, Snapshot};

/// The entries for findings, AL state and Sync0 of a gateway.
pub fn snapshot_of(gateway: &mut Gateway, now: u64) -> Snapshot {
    let mut bytes = Vec::new();
    let mut snapshot = Snapshot::read(Depth::Findings, |key| {
        gateway
            .sdo_upload(now, key.index, key.subindex, &mut bytes)
            .map_err(|code| ReadError::Rejected(code.to_string()))?;
        let mut value = [0; 4];
        value[..bytes.len()].copy_from_slice(&bytes);
        Ok(u32::from_le_bytes(value))
    });
    snapshot.al_state = gateway.al_state().raw() | u8::from(gateway.al_error()) << 4;
    snapshot.al_status_code = Some(gateway.al_status_code());
    snapshot.sync0_period_ns = gateway.next_sync0(now).map(|_| 1_000_000);
    snapshot
}
