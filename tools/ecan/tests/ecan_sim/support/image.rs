//! Process data images byte by byte, as in manual 5.4.4.1.

/// All channels.
const CHANNEL_MASK: u8 = 0x0F;

const HEADER_BYTES: usize = 24;

/// A classic data frame on CAN0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    pub id: u16,
    pub data: Vec<u8>,
}

/// Writes an RxPDO image with these frames.
pub fn write(image: &mut [u8], sequence: u16, frames: &[Frame]) {
    image.fill(0);
    let mut at = HEADER_BYTES;
    let mut put = |bytes: &[u8]| {
        image[at..at + bytes.len()].copy_from_slice(bytes);
        at += bytes.len();
    };
    for frame in frames {
        put(&((frame.data.len() as u16) << 3).to_le_bytes());
        put(&frame.id.to_le_bytes());
        put(&frame.data);
    }
    let crc = crc16(&image[HEADER_BYTES..at]);
    let layout = (image.len() / 128 - 1) as u16 | u16::from(CHANNEL_MASK) << 5;
    image[0] = 0x16;
    image[2..4].copy_from_slice(&sequence.to_le_bytes());
    image[6..8].copy_from_slice(&((at - HEADER_BYTES) as u16).to_le_bytes());
    image[8..10].copy_from_slice(&crc.to_le_bytes());
    image[10..12].copy_from_slice(&layout.to_le_bytes());
    image[12] = CHANNEL_MASK;
    image[13] = frames.len() as u8;
    image[15] = 1;
    image[4..6].copy_from_slice(&sequence.to_le_bytes());
}

/// Sequence and frames of a TxPDO image; `None` before the first one.
pub fn read(image: &[u8]) -> Option<(u16, Vec<Frame>)> {
    let word = |at: usize| u16::from_le_bytes([image[at], image[at + 1]]);
    if image[0] == 0 {
        return None;
    }
    assert_eq!((image[0], image[15], image[14]), (0x16, 1, 0), "{:?}", &image[..HEADER_BYTES]);
    assert_eq!(word(2), word(4), "a whole image");
    let end = HEADER_BYTES + usize::from(word(6));
    assert_eq!(crc16(&image[HEADER_BYTES..end]), word(8));
    let (mut at, mut frames) = (HEADER_BYTES, Vec::new());
    while at < end {
        let control = word(at);
        assert_eq!(control & !0x78, 0, "classic data frames on CAN0");
        let bytes = usize::from(control >> 3);
        let data = image[at + 4..at + 4 + bytes].to_vec();
        frames.push(Frame { id: word(at + 2) & 0x7FF, data });
        at += 4 + bytes;
    }
    assert_eq!(frames.len(), usize::from(image[13]));
    Some((word(2), frames))
}

/// CRC-16/CCITT-FALSE.
fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte) << 8, |crc: u16, _| {
            if crc & 0x8000 == 0 { crc << 1 } else { crc << 1 ^ 0x1021 }
        })
    })
}
