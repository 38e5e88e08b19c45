//! Images that are written and read, by both codecs.

use std::hint::black_box;

use ecan_bench::baseline;
use ecan_bench::measure::{Evictor, Outcome};
use ecan_protocol::can::FrameRef;
use ecan_protocol::image::{CommitFields, ImageReader, ImageWriter, Packet, PdoProfile, Timestamp};
use ecan_protocol::mapping::Direction;

use crate::pair::{self, Random};

/// Most frames of a mix, more than fit.
const MIX_FRAMES: usize = 255;

/// A frame to send, as the application of this codec has it.
struct Sent<'a> {
    frame: FrameRef<'a>,
    channel: u8,
    id_aux: u8,
}

/// Images of one profile, written one after the other into one buffer.
pub struct Images<'a> {
    profile: PdoProfile,
    frames: Vec<(Vec<Sent<'a>>, Vec<baseline::Frame<'a>>)>,
}

impl<'a> Images<'a> {
    fn new(multiplier: u8, frames: Vec<Vec<baseline::Frame<'a>>>) -> Self {
        let sent = |frame: &baseline::Frame<'a>| Sent {
            frame: pair::frame(frame),
            channel: frame.channel,
            id_aux: frame.id_aux,
        };
        let frames =
            frames.into_iter().map(|frames| (frames.iter().map(sent).collect(), frames)).collect();
        let this = Self { profile: PdoProfile { multiplier, ..PdoProfile::default() }, frames };
        this.assert_equal();
        this
    }

    /// One image of `count` frames of 8 bytes, standard identifiers, all channels.
    pub fn classic(multiplier: u8, count: usize, data: &'a [[u8; 64]]) -> Self {
        Self::uniform(multiplier, count, data, 0, 8)
    }

    /// As many frames of 8 bytes as there is room for.
    pub fn full(multiplier: u8, data: &'a [[u8; 64]]) -> Self {
        let area = PdoProfile { multiplier, ..PdoProfile::default() }.frame_area_bytes();
        Self::classic(multiplier, area / 12, data)
    }

    /// One image of `count` CAN FD frames of 64 bytes.
    pub fn fd(multiplier: u8, count: usize, data: &'a [[u8; 64]]) -> Self {
        Self::uniform(multiplier, count, data, baseline::FD | baseline::BRS, 15)
    }

    fn uniform(multiplier: u8, count: usize, data: &'a [[u8; 64]], flags: u16, dlc: u8) -> Self {
        let frames = data.iter().take(count).enumerate().map(|(number, data)| {
            let mut frame = baseline::Frame::new(0x100 + number as u32, flags, dlc, data);
            frame.channel = (number % 4) as u8;
            frame
        });
        Self::new(multiplier, vec![frames.collect()])
    }

    /// Full images of frames of any kind, as many as there are `seeds`.
    pub fn mixed(multiplier: u8, seeds: u64, data: &'a [[u8; 64]]) -> Self {
        let mix = |seed| {
            let mut random = Random(seed);
            data.iter().take(MIX_FRAMES).map(|data| random.frame(data)).collect()
        };
        Self::new(multiplier, (0..seeds).map(mix).collect())
    }

    fn both(&self) -> (Rust, C) {
        (Rust::new(self.profile), C::new(self.profile))
    }

    /// What is timed is the same work.
    fn assert_equal(&self) {
        let (mut rust, mut c) = self.both();
        for (sent, frames) in &self.frames {
            assert_eq!(rust.encode(sent), c.encode(frames));
            assert!(rust.image == c.image);
            let sum = rust.decode();
            assert_eq!(sum, c.decode());
            assert_ne!(sum, 0);
        }
    }

    /// Writes and reads all images `repeat` times a round.
    pub fn warm(&self, repeat: usize) -> Outcome {
        let (mut rust, mut c) = self.both();
        ecan_bench::measure::warm(|| self.rust(&mut rust, repeat), || self.c(&mut c, repeat))
    }

    /// This codec alone, nanoseconds per image.
    pub fn rust_alone(&self, repeat: usize) -> f64 {
        let (mut rust, _) = self.both();
        let round = ecan_bench::measure::warm_alone(|| self.rust(&mut rust, repeat));
        round / (repeat * self.frames.len()) as f64
    }

    /// Writes and reads the images once a round, with everything out of the caches before.
    pub fn cold(&self, evictor: &Evictor) -> Outcome {
        let (mut rust, mut c) = self.both();
        evictor.cold(|| self.rust(&mut rust, 1), || self.c(&mut c, 1))
    }

    fn rust(&self, side: &mut Rust, repeat: usize) {
        for _ in 0..repeat {
            for (sent, _) in &self.frames {
                side.encode(black_box(sent));
                black_box(side.decode());
            }
        }
    }

    fn c(&self, side: &mut C, repeat: usize) {
        for _ in 0..repeat {
            for (_, frames) in &self.frames {
                side.encode(black_box(frames));
                black_box(side.decode());
            }
        }
    }
}

/// This codec at work.
struct Rust {
    writer: ImageWriter,
    reader: ImageReader,
    image: Vec<u8>,
}

impl Rust {
    fn new(profile: PdoProfile) -> Self {
        Self {
            writer: ImageWriter::new(Direction::RxPdo, profile),
            reader: ImageReader::new(Direction::RxPdo, profile),
            image: vec![0; profile.pdo_bytes()],
        }
    }

    /// As many of the frames as fit; returns how many.
    #[inline(never)]
    fn encode(&mut self, frames: &[Sent<'_>]) -> usize {
        let Self { writer, image, .. } = self;
        let mut count = 0;
        for sent in frames {
            let (channel, id_aux) = (sent.channel, sent.id_aux);
            if writer.push(image, channel, id_aux, sent.frame, Timestamp::None).is_err() {
                break;
            }
            count += 1;
        }
        writer.commit(image, CommitFields::default());
        count
    }

    /// The same look at each frame as the baseline takes.
    #[inline(never)]
    fn decode(&self) -> u64 {
        let Ok(image) = self.reader.read(&self.image) else { return 0 };
        let mut sum = 0;
        for packet in image.packets() {
            if let Ok(Packet::Frame(packet)) = packet {
                let (id, data) = (packet.frame.id().raw(), packet.frame.data());
                sum += u64::from(packet.channel) + u64::from(id) + data.len() as u64;
                if let Some(&first) = data.first() {
                    sum += u64::from(first);
                }
            }
        }
        sum
    }
}

/// The baseline at work.
struct C {
    writer: baseline::Writer,
    reader: baseline::Reader,
    image: Vec<u8>,
}

impl C {
    fn new(profile: PdoProfile) -> Self {
        let baseline_profile = pair::profile(Direction::RxPdo, &profile);
        Self {
            writer: baseline::Writer::new(&baseline_profile, 1),
            reader: baseline::Reader::new(&baseline_profile),
            image: vec![0; profile.pdo_bytes()],
        }
    }

    fn encode(&mut self, frames: &[baseline::Frame<'_>]) -> usize {
        self.writer.encode(&mut self.image, frames)
    }

    fn decode(&mut self) -> u64 {
        self.reader.decode(&self.image)
    }
}
