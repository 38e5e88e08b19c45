//! Constants

/// Cycle for the first startup, in microseconds (manual 15.5.2).
pub const ECAN_DEFAULT_CYCLE_US: u32 = 10_000;
/// PDO size for classic CAN and CANopen, in chunks of 128 bytes (manual 15.5.2).
pub const ECAN_DEFAULT_PDO_MULTIPLIER: u32 = 3;
/// Bytes of a PDO chunk (manual 5.1).
pub const ECAN_PDO_CHUNK_BYTES: usize = 128;
/// Bytes of an image's header (manual 6).
pub const ECAN_PDO_HEADER_BYTES: usize = 24;
/// Most chunks of a PDO (manual 5.2).
pub const ECAN_PDO_MAX_MULTIPLIER: u32 = 24;
/// Most chunks that IgH 1.6.2 carries per direction: a sync manager never spans two datagrams of
/// at most 1486 bytes.
pub const ECAN_PDO_MAX_PLAIN_MULTIPLIER: u32 = 11;
/// Most packets of an image: its header counts them in a byte.
pub const ECAN_PDO_MAX_PACKETS: usize = 255;
/// CAN channels of a gateway.
pub const ECAN_MCAN_CHANNELS: usize = 4;
/// Most data bytes of a CAN FD frame.
pub const ECAN_CANFD_MAX_BYTES: usize = 64;

/// The CAN channels of a gateway, by number.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ecan_mcan_channel_t {
    /// CAN0.
    ECAN_MCAN0 = 0,
    /// CAN1.
    ECAN_MCAN1 = 1,
    /// CAN2.
    ECAN_MCAN2 = 2,
    /// CAN3.
    ECAN_MCAN3 = 3,
}

const _: () = {
    assert!(ECAN_PDO_CHUNK_BYTES == ecan_protocol::mapping::CHUNK_BYTES);
    assert!(ECAN_PDO_HEADER_BYTES == ecan_protocol::mapping::HEADER_BYTES);
    assert!(ECAN_PDO_MAX_MULTIPLIER == ecan_protocol::mapping::MAX_MULTIPLIER as u32);
    assert!(ECAN_PDO_MAX_PACKETS == ecan_protocol::mapping::MAX_PACKETS);
    assert!(ECAN_MCAN_CHANNELS == ecan_protocol::mapping::CHANNELS);
};
