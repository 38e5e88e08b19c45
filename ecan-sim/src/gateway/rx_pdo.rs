//! From SM2 to frames: the RxPDO parser with its memory of the last image (manual 6, 8, 13.2).

use ecan_protocol::image::{Image, ImageFault, ImageReader, ParseDiagnosis, PdoError, PdoProfile};
use ecan_protocol::mapping::{Direction, MAX_PDO_BYTES};

/// What the parser says about a written image as a whole.
#[derive(Debug)]
pub(super) enum Verdict<'a> {
    /// A new image; its packets are still to be judged.
    New(Image<'a>),
    /// The last image again, byte for byte: nothing to do.
    Repeated,
    /// A fault of the header, the CRC or the sequence.
    Faulty(PdoError),
}

/// Reads RxPDO images of the active profile.
#[derive(Debug)]
pub(super) struct RxPdoParser {
    reader: Option<ImageReader>,
    last_image: Box<[u8]>,
    last_length: usize,
    last_sequence: Option<u16>,
}

impl RxPdoParser {
    pub(super) fn new() -> Self {
        Self {
            reader: None,
            last_image: vec![0; MAX_PDO_BYTES].into_boxed_slice(),
            last_length: 0,
            last_sequence: None,
        }
    }

    /// A parser without memory, to stand in while the real one is lent out.
    pub(super) fn vacant() -> Self {
        Self { reader: None, last_image: Box::default(), last_length: 0, last_sequence: None }
    }

    /// Takes the active profile, and whether images need a CRC.
    pub(super) fn configure(&mut self, profile: Option<PdoProfile>, crc: bool) {
        self.reader =
            profile.map(|profile| ImageReader::new(Direction::RxPdo, profile).with_crc(crc));
    }

    /// Forgets the last sequence, so that the image which still lies in SM2 counts as new.
    pub(super) fn reset_session(&mut self) {
        self.last_sequence = None;
        self.last_length = 0;
    }

    /// Judges an image and, if it is new, remembers it.
    pub(super) fn judge<'a>(&mut self, image: &'a [u8]) -> Verdict<'a> {
        let Some(reader) = &self.reader else {
            return Verdict::Faulty(PdoError::ActiveArea);
        };
        let read = match reader.read(image) {
            Ok(read) => read,
            Err(diagnosis) => return Verdict::Faulty(error_of(&diagnosis)),
        };
        if read.layout_changed() {
            // made for another size, mask, profile or option than those in force
            return Verdict::Faulty(PdoError::ActiveArea);
        }
        let end = ecan_protocol::mapping::HEADER_BYTES + read.payload().len();
        let content = image.get(..end).unwrap_or_default();
        if self.last_sequence == Some(read.sequence()) {
            return if self.last_image.get(..self.last_length) == Some(content) {
                Verdict::Repeated
            } else {
                Verdict::Faulty(PdoError::DuplicateSequence)
            };
        }
        self.last_sequence = Some(read.sequence());
        self.last_length = end.min(self.last_image.len());
        for (to, from) in self.last_image.iter_mut().zip(content) {
            *to = *from;
        }
        Verdict::New(read)
    }

    /// The PDO error of a packet's fault. A packet that reaches beyond the whole frame area
    /// is an overrun, one that only reaches beyond the payload is truncated.
    pub(super) fn packet_error(&self, diagnosis: &ParseDiagnosis) -> PdoError {
        let area_end =
            self.reader.as_ref().map_or(MAX_PDO_BYTES, |reader| reader.profile().pdo_bytes());
        match error_of(diagnosis) {
            PdoError::Truncated if usize::from(diagnosis.packet_end) > area_end => {
                PdoError::PacketOverrun
            }
            error => error,
        }
    }
}

/// A single buffer is never read while it is written, so sequence numbers that differ are
/// the sender's fault and count as a bad header.
fn error_of(diagnosis: &ParseDiagnosis) -> PdoError {
    match diagnosis.fault {
        ImageFault::Pdo(error) => error,
        ImageFault::Updating | ImageFault::Torn => PdoError::BadHeader,
    }
}
