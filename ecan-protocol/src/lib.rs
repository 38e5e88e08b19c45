//! The ECAN-Lite manual as types: PDO stream codec, object dictionary, bit timing.
//!
//! `no_std`, without allocation and without I/O. Host and simulated gateway both build on it, so
//! that every byte is defined once.
//!
//! # Process data
//!
//! An [`ImageWriter`] packs frames into a process data image of one [`Direction`] under a
//! [`PdoProfile`]; an [`ImageReader`] judges an image as manual 6.1 asks and gives borrowed views
//! of its packets.
//!
//! ```
//! use ecan_protocol::{
//!     CanId, CommitFields, Direction, FrameRef, ImageReader, ImageWriter, Packet, PdoProfile,
//!     Timestamp,
//! };
//!
//! let profile = PdoProfile::default();
//! let mut image = [0; 1024];
//! let mut writer = ImageWriter::new(Direction::RxPdo, profile);
//! let frame = FrameRef::classic(CanId::standard(0x123)?, &[0x11, 0x22])?;
//! writer.push(&mut image, 0, 0, frame, Timestamp::None)?;
//! let sequence = writer.commit(&mut image, CommitFields::default());
//!
//! let reader = ImageReader::new(Direction::RxPdo, profile);
//! let received = reader.read(&image)?;
//! assert_eq!(received.sequence(), sequence);
//! for packet in received.packets() {
//!     if let Packet::Frame(packet) = packet? {
//!         assert_eq!(packet.frame, frame);
//!     }
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![no_std]
#![deny(missing_docs)]

// Process data codec
mod can_id;
mod control;
mod copy;
mod crc;
mod diagnosis;
mod dlc;
mod frame;
mod frame_bits;
mod header;
mod mapping;
mod packet;
mod packets;
mod profile;
mod reader;
mod schedule;
mod sequence;
mod status;
mod timestamp;
mod tx_result;
mod writer;

pub use can_id::CanId;
#[doc(hidden)]
pub use crc::crc16_use_portable;
pub use crc::{crc16, crc16_is_accelerated, crc16_portable};
pub use diagnosis::{ImageFault, ParseDiagnosis, PdoError};
pub use dlc::Dlc;
pub use frame::{CanFrame, FrameError, FrameKind, FrameRef};
pub use frame_bits::FrameBits;
pub use header::{CRC_ALG_CCITT_FALSE, CRC_ALG_NONE, Header, HeaderFlags, VER_IHL};
pub use mapping::{
    CHANNELS, CHUNK_BYTES, Direction, HEADER_BYTES, MAX_MULTIPLIER, MAX_PACKETS, MAX_PDO_BYTES,
    UNIT_BYTES, UNITS_PER_CHUNK, assignment_index, buffer_offset, data_object_index,
    locate_data_object, map_subindex, pdo_map_index, sync_manager, sync_manager_address,
    sync_manager_control,
};
pub use packet::{FramePacket, Packet};
pub use packets::{PacketCursor, Packets};
pub use profile::{BudgetPolicy, EncapsulationProfile, OptionFlags, PdoProfile, ProfileError};
pub use reader::{Image, ImageReader};
pub use schedule::Schedule;
pub use sequence::{Arrival, SequenceTracker};
pub use status::{ChannelState, ChannelStatus};
pub use timestamp::Timestamp;
pub use tx_result::{ResultCode, TxResult};
pub use writer::{CommitFields, ImageWriter, PushError};

// Object dictionary and configuration
mod abort_code;
mod al_status;
mod bit_timing;
mod capabilities;
mod config;
mod maintenance;
mod message_ram;
mod object;
mod raw_enum;
mod sdo_write;

pub use abort_code::AbortCode;
pub use al_status::{AlState, AlStatusCode};
pub use bit_timing::{
    BITRATE_TOLERANCE_PPM, BitTiming, BitTimingError, MCAN_CLOCK_HZ, Phase, SamplePoint,
    TDC_FORCED_FROM, TDC_MAX_PRESCALER, TimingLimits, solve_data, solve_nominal, tdc_active,
};
pub use capabilities::{Capabilities, FeatureFlags, Recognition};
pub use config::{
    ApplyStatus, AssignmentWrites, BitTimingMode, BusOffRecovery, CacheDepth, ChannelFault,
    CrcTest, CriticalFrames, DATA_PATH_BUDGET_MAX, DATA_PATH_CONFIG_WRITES,
    DATA_PATH_GLOBAL_WRITES, DIAGNOSTIC_TEST_KEY, DIAGNOSTIC_TEST_WRITES, DataPathConfig,
    DataPathFault, DataPathGlobal, DiagnosticFault, DiagnosticTest, ExtendedFilter, ExtendedMatch,
    FilterAction, FilterCommand, FilterCommandStatus, FilterElementFault, FilterFault,
    FilterWindow, InvalidValue, MCAN_CHANNEL_BRING_UP_WRITES, MCAN_CHANNEL_CONFIG_WRITES,
    McanChannelConfig, NodeMode, NonMatch, PDO_PROFILE_WRITES, ProfileMismatch, ProfileReadback,
    ProfileStatus, RxBudget, RxBypass, RxOverflow, SamplePointWindow, SessionCommand, Sides,
    StandardFilter, StandardMatch, TxBypass, TxOverflow, assignment_writes, check_filters,
    filter_writes, session_command_write,
};
pub use maintenance::{AccessMode, MaintenanceCommand, MaintenanceStatus};
pub use message_ram::{
    DataSize, EXTENDED_FILTERS_MAX, FifoMode, MESSAGE_RAM_BYTES, MessageRamLayout, RxFifo,
    STANDARD_FILTERS_MAX, TxMode,
};
pub use object::{
    Access, Apply, Entry, MAPPED_SUBINDEX, Object, ObjectType, WRITABLE_REGISTERS, describe,
    lookup, object, objects, pdo_mapping_entry,
};
pub use sdo_write::SdoWrite;
