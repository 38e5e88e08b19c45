//! Settings of all axes together

use crate::milliseconds::{duration, milliseconds};
use ecan_c_export::export;

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, mirror};
use ecan_canopen::{
    BlockTransferConfig, HostHeartbeat, NetworkConfig, NodeConfig, NodeId, SdoConfig, SyncConfig,
};
use ecan_cia402::{Cia402Config, Takeover};

/// Marks filled settings.
const SEAL: u64 = 0x6563_616e_5f63_3432;

/// Upper limit of sdo_buffer_bytes.
const MOST_SDO_BYTES: u32 = 1 << 24;

mirror! {
    /// Common settings of the axes of a context. igh_cia402_default_settings() fills it; change
    /// fields after it. Plain data: it may be copied and needs no deinit.
    pub struct igh_cia402_settings_t from rust: Cia402Config {
        /// Not for the application: marks filled settings.
        seal: u64 = SEAL,
        /// Fewest cycles from target to target (--motion-div); 0 counts as 1. The target period is the
        /// least multiple of sync_every_cycles that is not below it. Default 1.
        motion_div: u32,
        /// Cycles from SYNC to SYNC; 0 counts as 1. Default 1.
        sync_every_cycles: u32 = rust.sync.every_cycles,
        /// Heartbeat of the host, in milliseconds; 0 sends none, and no drive detects a lost host.
        /// Default 50.
        host_heartbeat_ms: u32 = {
            rust.network.host_heartbeat.map_or(0, |host| milliseconds(host.period))
        },
        /// Node-ID of the host's heartbeat, which no drive may have. Default 127.
        host_node_id: u8 = rust.network.host_heartbeat.map_or(NodeId::MAX, |host| host.node).get(),
        /// SYNC with a counter from 1 to this value, 2 to 240, as in the drives' 0x1019; 0 sends
        /// SYNC without data. Default 0.
        sync_counter_overflow: u8 = rust.sync.counter_overflow.unwrap_or(0),
        /// Most SDO frames and NMT commands per cycle and channel. Default 2.
        service_frames_per_cycle: u8 = rust.network.service_frames_per_cycle,
        /// Number of pending frames of the channel in the gateway at which SDO frames wait, at most
        /// 7. Default 7.
        sdo_pending_limit: u8 = rust.network.sdo_pending_limit,
        /// Bytes of each RxPDO image that SDO frames leave free for frames that the application
        /// sends after the targets. Default 0.
        reserved_image_bytes: u32 = short(rust.network.reserved_image_bytes),
        /// Size of the NMT command queue of a channel. Default 32.
        nmt_queue: u32 = short(rust.network.nmt_queue),
        /// Timeout for the response to an SDO request, in milliseconds. Default 500.
        sdo_timeout_ms: u32 = milliseconds(rust.node.sdo.timeout),
        /// Longest value of an SDO transfer, in bytes. Default 1024.
        sdo_buffer_bytes: u32 = short(rust.node.sdo.buffer_bytes),
        /// Downloads with at least this number of bytes try block transfer; 0 never does. Default
        /// 64.
        sdo_block_from: u32 = rust.node.sdo.block.download_from.map_or(0, short),
        /// Number of retries of an SDO transfer without a response. Default 2.
        sdo_retries: u8 = rust.node.sdo.retries,
        /// 1: uploads request block transfer. Default 0.
        sdo_block_upload: u8 = rust.node.sdo.block.upload.into(),
        /// Segments per block of a block upload, 1 to 127. Default 16.
        sdo_block_segments: u8 = rust.node.sdo.block.segments,
        /// An igh_cia402_takeover_t: treatment of a drive that is enabled at the first contact.
        /// Default IGH_CIA402_TAKEOVER_STOP.
        takeover: u8 = igh_cia402_takeover_t::from(rust.takeover) as u8,
        /// Must be 0; for fields of later versions.
        reserved: [u64; 8] = [0; 8],
    }
}

mirror! {
    /// Treatment of a drive that is enabled at the first contact.
    pub enum igh_cia402_takeover_t from Takeover {
        /// The drive is quick-stopped, and disabled at rest.
        IGH_CIA402_TAKEOVER_STOP = 0 => Takeover::Stop,
        /// The drive remains enabled if it is at rest, has mode and process data of the configuration, and
        /// takes a target that keeps it at standstill; otherwise the drive is stopped.
        IGH_CIA402_TAKEOVER_ADOPT = 1 => Takeover::Adopt,
    }
}

impl igh_cia402_takeover_t {
    fn parse(number: u8) -> Option<Takeover> {
        [Takeover::Stop, Takeover::Adopt].into_iter().find(|it| Self::from(*it) as u8 == number)
    }
}

fn short(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

impl igh_cia402_settings_t {
    pub(crate) fn checked(&self, call: Call) -> Result<Cia402Config, ecan_result_t> {
        if self.seal != SEAL {
            let text = format_args!(
                "`settings` is not filled: call igh_cia402_default_settings on it first"
            );
            return Err(call.fail(ecan_result_t::ECAN_ERR_NOT_INITIALISED, text));
        }
        call.reserved("settings", &self.reserved)?;
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
                    ..SdoConfig::default()
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
            takeover: igh_cia402_takeover_t::parse(self.takeover)
                .ok_or_else(|| fault("takeover", self.takeover.into()))?,
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
    use ecan_c_boundary::call;
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
    fn defaults_of_c_are_those_of_rust() {
        assert_eq!(to_rust(&Cia402Config::default().into()), Ok(Cia402Config::default()));
    }

    #[test]
    fn other_values_round_trip() {
        let mut settings = Cia402Config { motion_div: 3, ..Cia402Config::default() };
        settings.network.host_heartbeat = None;
        settings.sync.counter_overflow = Some(10);
        settings.sync.every_cycles = 2;
        settings.node.sdo.block =
            BlockTransferConfig { download_from: None, upload: true, segments: 9 };
        assert_eq!(to_rust(&settings.clone().into()), Ok(settings));
    }

    #[test]
    fn invalid_settings_return_errors() {
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
