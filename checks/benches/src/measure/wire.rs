//! Time on the EtherCAT wire.

/// Bytes around the process data: preamble and start 8, Ethernet header 14, EtherCAT header 2,
/// datagram header 10 and working counter 2, check sequence 4, gap 12.
const FRAME_OVERHEAD: usize = 52;
/// Process data that an Ethernet frame of 1500 bytes holds in one datagram.
const FRAME_DATA: usize = 1486;
/// Nanoseconds of a byte at 100 Mbit/s.
const BYTE_NS: f64 = 80.0;

/// Nanoseconds that an RxPDO and a TxPDO image of `multiplier` x 128 bytes each take on the wire at
/// 100 Mbit/s.
#[must_use]
pub fn wire_ns(multiplier: u8) -> f64 {
    let data = 2 * 128 * usize::from(multiplier);
    (data + FRAME_OVERHEAD * data.div_ceil(FRAME_DATA)) as f64 * BYTE_NS
}
