//! CRC32 of stored configurations and firmware. The manual specifies no polynomial; this is the one
//! of Ethernet frames (reflected 0x04C11DB7).

use crc::{CRC_32_ISO_HDLC, Crc};

static CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

pub(super) fn crc32(bytes: &[u8]) -> u32 {
    CRC.checksum(bytes)
}
