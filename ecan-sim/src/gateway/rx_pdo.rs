//! RxPDO parser with its copy of the last image (manual 6, 8, 13.2).

use ecan_protocol::image::{Image, ImageFault, ImageReader, ParseDiagnosis, PdoError, PdoProfile};
use ecan_protocol::mapping::{Direction, MAX_PDO_BYTES};

use super::variant::{GatewayVariant, PdoErrorNumbers, RepeatedImage};

#[derive(Clone, Debug)]
pub(super) struct RxPdoParser {
    reader: Option<ImageReader>,
    last_image: Vec<u8>,
    last_sequence: Option<u16>,
    repeated: RepeatedImage,
    errors: PdoErrorNumbers,
}

impl RxPdoParser {
    pub(super) fn new(variant: &GatewayVariant) -> Self {
        Self {
            reader: None,
            last_image: Vec::with_capacity(MAX_PDO_BYTES),
            last_sequence: None,
            repeated: variant.repeated_image,
            errors: variant.pdo_errors,
        }
    }

    pub(super) fn configure(&mut self, profile: Option<PdoProfile>, crc: bool) {
        self.reader =
            profile.map(|profile| ImageReader::new(Direction::RxPdo, profile).with_crc(crc));
    }

    /// Clears the last sequence number, so that the next image is new with any number.
    pub(super) fn reset_session(&mut self) {
        self.last_sequence = None;
        self.last_image.clear();
    }

    /// Checks header, CRC and sequence number of an image, and keeps a copy of a new one; `None` for
    /// the previous image again, byte for byte: a no-op, unless the variant counts it as an error.
    pub(super) fn parse<'a>(&mut self, image: &'a [u8]) -> Result<Option<Image<'a>>, PdoError> {
        let reader = self.reader.as_ref().ok_or(PdoError::ActiveArea)?;
        let read = reader.read(image).map_err(|diagnosis| error_of(&diagnosis))?;
        if read.layout_changed() {
            // built for another size, mask, profile or option than the active ones
            return Err(match self.errors {
                PdoErrorNumbers::Assumed => PdoError::ActiveArea,
                PdoErrorNumbers::HeaderAndTruncated => PdoError::BadHeader,
            });
        }
        let end = ecan_protocol::mapping::HEADER_BYTES + read.payload().len();
        let content = image.get(..end).unwrap_or_default();
        if self.last_sequence == Some(read.sequence()) {
            let is_repeated = self.last_image == content && self.repeated == RepeatedImage::NoOp;
            return if is_repeated { Ok(None) } else { Err(PdoError::DuplicateSequence) };
        }
        self.last_sequence = Some(read.sequence());
        self.last_image.clear();
        self.last_image.extend_from_slice(content);
        Ok(Some(read))
    }

    /// PDO error of a packet. A packet that ends beyond the frame area is an overrun; one that
    /// ends beyond the payload only is truncated.
    pub(super) fn packet_error(&self, diagnosis: &ParseDiagnosis) -> PdoError {
        let area_end =
            self.reader.as_ref().map_or(MAX_PDO_BYTES, |reader| reader.profile().pdo_bytes());
        match error_of(diagnosis) {
            PdoError::Truncated
                if usize::from(diagnosis.packet_end) > area_end
                    && self.errors == PdoErrorNumbers::Assumed =>
            {
                PdoError::PacketOverrun
            }
            error => error,
        }
    }
}

/// A single buffer is never read while it is written, so differing sequence numbers are an error
/// of the sender: a bad header.
fn error_of(diagnosis: &ParseDiagnosis) -> PdoError {
    match diagnosis.fault {
        ImageFault::Pdo(error) => error,
        ImageFault::Updating | ImageFault::Torn => PdoError::BadHeader,
    }
}
