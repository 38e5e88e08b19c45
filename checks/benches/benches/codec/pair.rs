//! The same things for both codecs, and seeded random frames.

use ecan_bench::baseline;
use ecan_protocol::can::{CanId, Dlc, FrameRef};
use ecan_protocol::image::{OptionFlags, PdoProfile};
use ecan_protocol::mapping::Direction;

/// The profile as the baseline takes it.
pub fn profile(direction: Direction, profile: &PdoProfile) -> baseline::Profile {
    let to_gateway = direction == Direction::RxPdo;
    baseline::Profile {
        bytes: profile.pdo_bytes() as u16,
        layout_id: profile.layout_id(),
        channel_mask: profile.channel_mask,
        formats: match (to_gateway, profile.profile.allows_delta16()) {
            (true, _) => 0b1001,
            (false, true) => 0b1111,
            (false, false) => 0b0001,
        },
        windows: profile.profile.allows_d64(),
        align4: profile.options.contains(OptionFlags::ALIGN4),
        to_gateway,
        crc: !profile.options.contains(OptionFlags::NO_CRC16),
    }
}

/// The frame as this codec takes it.
pub fn frame<'a>(frame: &baseline::Frame<'a>) -> FrameRef<'a> {
    let flags = frame.flags();
    let id = CanId::new(frame.id, flags & baseline::EXTENDED != 0).unwrap();
    let x = flags & baseline::X != 0;
    if flags & baseline::FD != 0 {
        FrameRef::fd(id, frame.data(), flags & baseline::BRS != 0, x)
    } else if x {
        FrameRef::remote(id, Dlc::new(frame.dlc()).unwrap())
    } else {
        FrameRef::classic(id, frame.data())
    }
    .unwrap()
}

/// Random numbers that a seed determines (splitmix64).
pub struct Random(pub u64);

impl Random {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ z >> 31
    }

    pub fn below(&mut self, end: u64) -> u64 {
        self.bits() % end
    }

    pub fn chance(&mut self, of: u64) -> bool {
        self.below(of) == 0
    }

    /// A frame of any kind: half of them CAN FD, half with 29 bit identifiers, some remote.
    pub fn frame<'a>(&mut self, data: &'a [u8; 64]) -> baseline::Frame<'a> {
        let mut flags = 0;
        let dlc = if self.chance(2) {
            flags |= baseline::FD;
            flags |= if self.chance(2) { baseline::BRS } else { 0 };
            flags |= if self.chance(8) { baseline::X } else { 0 };
            self.below(16)
        } else {
            flags |= if self.chance(8) { baseline::X } else { 0 };
            self.below(9)
        } as u8;
        let id = if self.chance(2) {
            flags |= baseline::EXTENDED;
            self.below(1 << 29)
        } else {
            self.below(1 << 11)
        };
        let mut frame = baseline::Frame::new(id as u32, flags, dlc, data);
        frame.channel = self.below(4) as u8;
        frame.id_aux = self.below(8) as u8;
        frame
    }
}
