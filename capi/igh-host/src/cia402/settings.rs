//! Settings of all axes together

use crate::milliseconds::{duration, milliseconds};
use ecan_c_export::export;

use ecan_canopen::{
    BlockTransferConfig, HostHeartbeat, NetworkConfig, NodeConfig, NodeId, SdoConfig, SyncConfig,
};
use ecan_cia402::Cia402Config;
use ecan_mcan_host::boundary::Call;
use ecan_mcan_host::common::result::ecan_result_t;

/// Marks filled settings.
const SEAL: u64 = 0x6563_616e_5f63_3432;

/// Upper limit of sdo_buffer_bytes.
const MOST_SDO_BYTES: u32 = 1 << 24;

/// Common settings of the axes of a context. igh_cia402_default_settings() fills it; change fields
/// after it. Plain data: it may be copied and needs no deinit.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct igh_cia402_settings_t {
    /// Not for the application: marks filled settings.
    pub seal: u64,
    /// Cycles from target to target (--motion-div); 0 counts as 1. Default 1.
    pub motion_div: u32,
    /// Cycles from SYNC to SYNC; 0 counts as 1. Default 1.
    pub sync_every_cycles: u32,
    /// Heartbeat of the host, in milliseconds; 0 sends none, and no drive detects a lost host.
    /// Default 50.
    pub host_heartbeat_ms: u32,
    /// Node-ID of the host's heartbeat, which no drive may have. Default 127.
    pub host_node_id: u8,
    /// SYNC with a counter from 1 to this value, 2 to 240, as in the drives' 0x1019; 0 sends SYNC
    /// without data. Default 0.
    pub sync_counter_overflow: u8,
    /// Most SDO frames and NMT commands per cycle and channel. Default 2.
    pub service_frames_per_cycle: u8,
    /// Number of pending frames of the channel in the gateway at which SDO frames wait, at most 7.
    /// Default 7.
    pub sdo_pending_limit: u8,
    /// Bytes of each RxPDO image that SDO frames leave free for frames that the application sends
    /// after the targets. Default 0.
    pub reserved_image_bytes: u32,
    /// Size of the NMT command queue of a channel. Default 32.
    pub nmt_queue: u32,
    /// Timeout for the response to an SDO request, in milliseconds. Default 500.
    pub sdo_timeout_ms: u32,
    /// Longest value of an SDO transfer, in bytes. Default 1024.
    pub sdo_buffer_bytes: u32,
    /// Downloads with at least this number of bytes try block transfer; 0 never does. Default 64.
    pub sdo_block_from: u32,
    /// Number of retries of an SDO transfer without a response. Default 2.
    pub sdo_retries: u8,
    /// 1: uploads request block transfer. Default 0.
    pub sdo_block_upload: u8,
    /// Segments per block of a block upload, 1 to 127. Default 16.
    pub sdo_block_segments: u8,
    /// Not used.
    pub reserved_bytes: [u8; 5],
    /// Not used.
    pub reserved: [u64; 4],
}

impl From<Cia402Config> for igh_cia402_settings_t {
    fn from(settings: Cia402Config) -> Self {
        let Cia402Config { network, node, sync, motion_div } = settings;
        let host = network.host_heartbeat;
        let short = |count: usize| u32::try_from(count).unwrap_or(u32::MAX);
        Self {
            seal: SEAL,
            motion_div,
            sync_every_cycles: sync.every_cycles,
            host_heartbeat_ms: host.map_or(0, |host| milliseconds(host.period)),
            host_node_id: host.map_or(NodeId::MAX, |host| host.node).get(),
            sync_counter_overflow: sync.counter_overflow.unwrap_or(0),
            service_frames_per_cycle: network.service_frames_per_cycle,
            sdo_pending_limit: network.sdo_pending_limit,
            reserved_image_bytes: short(network.reserved_image_bytes),
            nmt_queue: short(network.nmt_queue),
            sdo_timeout_ms: milliseconds(node.sdo.timeout),
            sdo_buffer_bytes: short(node.sdo.buffer_bytes),
            sdo_block_from: node.sdo.block.download_from.map_or(0, short),
            sdo_retries: node.sdo.retries,
            sdo_block_upload: node.sdo.block.upload.into(),
            sdo_block_segments: node.sdo.block.segments,
            reserved_bytes: [0; 5],
            reserved: [0; 4],
        }
    }
}

impl igh_cia402_settings_t {
    /// Converts to Rust.
    pub(crate) fn checked(&self, call: Call) -> Result<Cia402Config, ecan_result_t> {
        if self.seal != SEAL {
            let text = format_args!(
                "`settings` is not filled: call igh_cia402_default_settings on it first"
            );
            return Err(call.fail(ecan_result_t::ECAN_ERR_NOT_INITIALISED, text));
        }
        let fault = |name: &str, value: u32| {
            let text = format_args!("invalid value {value} for `{name}`");
            call.fail(ecan_result_t::ECAN_ERR_CONFIG, text)
        };
        let host_heartbeat = match self.host_heartbeat_ms {
            0 => None,
            period_ms => {
                let id = self.host_node_id;
                let node = NodeId::new(id).ok_or_else(|| fault("host_node_id", id.into()))?;
                Some(HostHeartbeat { node, period: duration(period_ms) })
            }
        };
        if self.sdo_buffer_bytes > MOST_SDO_BYTES {
            return Err(fault("sdo_buffer_bytes", self.sdo_buffer_bytes));
        }
        if self.nmt_queue > u32::from(u16::MAX) {
            return Err(fault("nmt_queue", self.nmt_queue));
        }
        if !(1..=127).contains(&self.sdo_block_segments) {
            return Err(fault("sdo_block_segments", self.sdo_block_segments.into()));
        }
        let block = BlockTransferConfig {
            download_from: (self.sdo_block_from != 0).then_some(self.sdo_block_from as usize),
            upload: self.sdo_block_upload != 0,
            segments: self.sdo_block_segments,
        };
        Ok(Cia402Config {
            network: NetworkConfig {
                service_frames_per_cycle: self.service_frames_per_cycle,
                sdo_pending_limit: self.sdo_pending_limit,
                reserved_image_bytes: self.reserved_image_bytes as usize,
                nmt_queue: self.nmt_queue as usize,
                host_heartbeat,
            },
            node: NodeConfig {
                sdo: SdoConfig {
                    timeout: duration(self.sdo_timeout_ms),
                    retries: self.sdo_retries,
                    buffer_bytes: self.sdo_buffer_bytes as usize,
                    block,
                },
                ..NodeConfig::default()
            },
            sync: SyncConfig {
                every_cycles: self.sync_every_cycles,
                counter_overflow: (self.sync_counter_overflow != 0)
                    .then_some(self.sync_counter_overflow),
                schedule: None,
            },
            motion_div: self.motion_div,
        })
    }
}

/// Fills settings: targets and SYNC in every cycle, a heartbeat of the host every 50 ms.
///
/// @param settings  Is overwritten.
///
/// @usage   not rt, any thread, any time
#[export(call)]
pub fn igh_cia402_default_settings(settings: *mut igh_cia402_settings_t) {
    // SAFETY: the pointer is C's, valid or NULL as the header demands.
    unsafe { call.out("settings", settings)? }.set(Cia402Config::default().into());
}

#[cfg(test)]
mod tests {
    use ecan_mcan_host::boundary::call;
    use std::ffi::c_int;

    use super::*;

    fn to_rust(settings: &igh_cia402_settings_t) -> Result<Cia402Config, c_int> {
        let mut rust = None;
        let code = call("to_rust", |call| {
            rust = Some(settings.checked(call)?);
            Ok(())
        });
        rust.ok_or(code)
    }

    #[test]
    fn the_defaults_of_c_are_those_of_rust() {
        assert_eq!(to_rust(&Cia402Config::default().into()), Ok(Cia402Config::default()));
    }

    #[test]
    fn other_values_come_back() {
        let mut settings = Cia402Config { motion_div: 3, ..Cia402Config::default() };
        settings.network.host_heartbeat = None;
        settings.sync.counter_overflow = Some(10);
        settings.sync.every_cycles = 2;
        settings.node.sdo.block =
            BlockTransferConfig { download_from: None, upload: true, segments: 9 };
        assert_eq!(to_rust(&settings.clone().into()), Ok(settings));
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let config = Err(ecan_result_t::ECAN_ERR_CONFIG.code());
        let mut settings: igh_cia402_settings_t = Cia402Config::default().into();
        settings.host_node_id = 0;
        assert_eq!(to_rust(&settings), config);
        settings.host_heartbeat_ms = 0;
        assert!(to_rust(&settings).is_ok(), "no heartbeat needs no node-ID");
        settings.sdo_block_segments = 0;
        assert_eq!(to_rust(&settings), config);
        settings.seal = 1;
        assert_eq!(to_rust(&settings), Err(ecan_result_t::ECAN_ERR_NOT_INITIALISED.code()));
    }
}
