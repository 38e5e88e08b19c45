//! Reading PDO images (manual 6.1, 8), and their sequence numbers.

use core::hint::black_box;
use core::sync::atomic::{Ordering, fence};

use super::crc::crc16;
use super::diagnosis::{ImageFault, ParseDiagnosis, PdoError};
use super::header::{CRC_ALG_CCITT_FALSE, CRC_ALG_NONE, Header, VER_IHL, words_of};
use super::packet::allowed_formats;
use super::packets::{PacketCursor, Packets, Rules};
use crate::mapping::{Direction, HEADER_BYTES};
use crate::object::pdo_profile::{OptionFlags, PdoProfile};

/// Reads images of one direction.
///
/// The reader holds no state of the stream; [`SequenceTracker`] detects repeated
/// and lost images. Nothing here allocates, blocks or panics; all of it is real-time safe.
#[derive(Clone, Debug)]
pub struct ImageReader {
    profile: PdoProfile,
    crc: bool,
    layout_id: u16,
    image_bytes: usize,
    rules: Rules,
}

impl ImageReader {
    /// Creates a reader for this direction and profile. The options of the profile decide if an image
    /// without CRC is accepted.
    pub const fn new(direction: Direction, profile: PdoProfile) -> Self {
        Self {
            profile,
            crc: !profile.options.contains(OptionFlags::NO_CRC16),
            layout_id: profile.layout_id(),
            image_bytes: profile.pdo_bytes(),
            rules: Rules {
                direction,
                channel_mask: profile.channel_mask as u32 & 0x0F,
                formats: allowed_formats(direction, profile.profile),
                d64: profile.profile.allows_d64(),
                align_mask: if profile.options.contains(OptionFlags::ALIGN4) { 3 } else { 0 },
            },
        }
    }

    /// Requires a CRC or not, regardless of the option (0x8030:04, manual 13.2.3).
    #[must_use]
    pub const fn with_crc(mut self, crc: bool) -> Self {
        self.crc = crc;
        self
    }

    /// The direction.
    pub const fn direction(&self) -> Direction {
        self.rules.direction
    }

    /// The profile.
    pub const fn profile(&self) -> &PdoProfile {
        &self.profile
    }

    /// Checks an image in the order of manual 6.1: header, sequence numbers, CRC algorithm,
    /// version, payload length, CRC, header again. Bytes after the payload are ignored.
    ///
    /// If the image has a CRC, it is checked even if none is required. A layout other than that of the
    /// profile is not an error; see [`Image::layout_changed`].
    ///
    /// # Errors
    /// [`ParseDiagnosis`] with the fault of the image as a whole. `ActiveArea` means that `image`
    /// is smaller than the profile's.
    #[inline]
    pub fn read<'a>(&self, image: &'a [u8]) -> Result<Image<'a>, ParseDiagnosis> {
        let parts =
            image.get(..self.image_bytes).and_then(<[u8]>::split_first_chunk::<HEADER_BYTES>);
        let Some((head, area)) = parts else {
            return Err(short_image(image));
        };
        // Others may write this memory: keep the first copy of the header, and compare at the end.
        let first = words_of(head);
        let header = Header::from_words(first);
        let payload = self.check(&header, area)?;
        fence(Ordering::Acquire);
        unchanged(&header, first, words_of(black_box(head)))?;
        Ok(Image {
            header,
            payload,
            rules: self.rules,
            layout_changed: header.layout_id != self.layout_id,
        })
    }

    /// Continues with the packets of an image that [`read`](Self::read) has checked: with its header,
    /// and the cursor of [`Packets::cursor`], or a default one to start again.
    ///
    /// The image must be the one that was checked. Another one gives wrong packets or errors, nothing
    /// worse.
    #[inline]
    pub fn resume<'a>(
        &self,
        image: &'a [u8],
        header: &Header,
        cursor: PacketCursor,
    ) -> Packets<'a> {
        let end = HEADER_BYTES + usize::from(header.payload_len);
        let payload = image.get(HEADER_BYTES..end).unwrap_or_default();
        Packets::from_cursor(self.rules, header, payload, cursor)
    }

    /// The checks between the two reads of the header; returns the payload.
    #[inline]
    fn check<'a>(&self, header: &Header, area: &'a [u8]) -> Result<&'a [u8], ParseDiagnosis> {
        let reject = |error| Err(ParseDiagnosis::of_image(header, ImageFault::Pdo(error), 0));
        if !header.is_settled() {
            return Err(ParseDiagnosis::of_image(header, ImageFault::Updating, 0));
        }
        let with_crc = match header.crc_alg {
            CRC_ALG_CCITT_FALSE => true,
            CRC_ALG_NONE if !self.crc && header.payload_crc16 == 0 => false,
            _ => return reject(PdoError::BadHeader),
        };
        if header.ver_ihl != VER_IHL {
            return reject(PdoError::BadHeader);
        }
        let Some(payload) = area.get(..usize::from(header.payload_len)) else {
            return reject(PdoError::BadHeader);
        };
        if with_crc {
            let crc = crc16(payload);
            if crc != header.payload_crc16 {
                let fault = ImageFault::Pdo(PdoError::BadCrc);
                return Err(ParseDiagnosis::of_image(header, fault, crc));
            }
        }
        Ok(payload)
    }
}

#[inline]
fn unchanged(header: &Header, before: [u64; 3], now: [u64; 3]) -> Result<(), ParseDiagnosis> {
    // Word by word: compared as arrays they would go through memory.
    let is_same = before[0] == now[0] && before[1] == now[1] && before[2] == now[2];
    if is_same { Ok(()) } else { Err(ParseDiagnosis::of_image(header, ImageFault::Torn, 0)) }
}

#[cold]
fn short_image(image: &[u8]) -> ParseDiagnosis {
    let mut head = [0; HEADER_BYTES];
    for (to, from) in head.iter_mut().zip(image) {
        *to = *from;
    }
    ParseDiagnosis::of_image(&Header::parse(&head), ImageFault::Pdo(PdoError::ActiveArea), 0)
}

/// An image that was received completely. Each packet is checked when it is read.
#[derive(Clone, Copy, Debug)]
pub struct Image<'a> {
    header: Header,
    payload: &'a [u8],
    rules: Rules,
    layout_changed: bool,
}

impl<'a> Image<'a> {
    /// The header.
    #[inline]
    pub const fn header(&self) -> &Header {
        &self.header
    }

    /// The sequence number.
    #[inline]
    pub const fn sequence(&self) -> u16 {
        self.header.seq_begin
    }

    /// True if the sender left something out: truncation flag or overflow count.
    #[inline]
    pub const fn is_incomplete(&self) -> bool {
        self.header.is_incomplete()
    }

    /// True if the image has another profile than the reader. Its packets may be misinterpreted;
    /// compare with 0x8010:12 or 0x8011:12.
    #[inline]
    pub const fn layout_changed(&self) -> bool {
        self.layout_changed
    }

    /// The valid bytes of the frame area.
    #[inline]
    pub const fn payload(&self) -> &'a [u8] {
        self.payload
    }

    /// The packets, from the first.
    #[inline]
    pub const fn packets(&self) -> Packets<'a> {
        Packets::from_start(self.rules, &self.header, self.payload)
    }
}

/// Relation of the sequence number of an image to the previous one (manual 6.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Arrival {
    /// The first image, or one with a lower number, as after a restart of the sender: losses are
    /// unknown.
    First,
    /// The expected number.
    Next,
    /// The image that was received last; its packets were already received.
    Repeated,
    /// A new image; others before it were lost.
    Gap {
        /// Number of lost images, at least 1.
        lost: u16,
    },
}

impl Arrival {
    /// True if the image has new packets.
    #[inline]
    pub const fn is_new(self) -> bool {
        !matches!(self, Self::Repeated)
    }
}

/// Follows the sequence numbers of one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SequenceTracker {
    // Zero is a valid number, so "none received yet" is separate.
    last: Option<u16>,
}

impl SequenceTracker {
    /// Creates a tracker without an image.
    pub const fn new() -> Self {
        Self { last: None }
    }

    /// Compares the number of a valid image with the previous one, and stores it.
    #[inline]
    pub const fn observe(&mut self, sequence: u16) -> Arrival {
        let arrival = match self.last {
            None => Arrival::First,
            Some(last) => match sequence.wrapping_sub(last) {
                0 => Arrival::Repeated,
                1 => Arrival::Next,
                step @ 2..=0x7FFF => Arrival::Gap { lost: step - 1 },
                _ => Arrival::First,
            },
        };
        self.last = Some(sequence);
        arrival
    }

    /// The last number.
    pub const fn last(&self) -> Option<u16> {
        self.last
    }

    /// Resets the tracker, as after a session reset of the sender.
    pub const fn reset(&mut self) {
        self.last = None;
    }
}

#[cfg(test)]
mod tests {
    use super::{Arrival, Header, ImageReader, SequenceTracker, unchanged};
    use crate::image::*;
    use crate::mapping::*;

    #[test]
    fn header_that_changes_meanwhile_is_torn() {
        let before = [0x1616_1616_1616_1616; 3];
        let mut now = before;
        let header = Header::from_words(before);
        assert_eq!(unchanged(&header, before, now), Ok(()));
        now[2] ^= 1;
        let diagnosis = unchanged(&header, before, now).unwrap_err();
        assert_eq!(diagnosis.fault, ImageFault::Torn);
        assert_eq!(diagnosis.pdo_error(), None);
    }

    #[test]
    fn short_image_is_no_image() {
        let reader = ImageReader::new(Direction::TxPdo, PdoProfile::default());
        for length in [0, 1, 23, 24, 1023] {
            let image = [0; 1023];
            let diagnosis = reader.read(&image[..length]).unwrap_err();
            assert_eq!(diagnosis.pdo_error(), Some(PdoError::ActiveArea));
        }
    }

    #[test]
    fn zero_is_a_number_like_any_other() {
        let mut tracker = SequenceTracker::new();
        assert_eq!(tracker.observe(0), Arrival::First);
        assert_eq!(tracker.observe(0), Arrival::Repeated);
        assert_eq!(tracker.observe(1), Arrival::Next);
    }

    #[test]
    fn gaps_are_counted_over_the_wrap() {
        let mut tracker = SequenceTracker::new();
        tracker.observe(0xFFFE);
        assert_eq!(tracker.observe(0xFFFF), Arrival::Next);
        assert_eq!(tracker.observe(0), Arrival::Next);
        assert_eq!(tracker.observe(3), Arrival::Gap { lost: 2 });
    }

    #[test]
    fn step_back_is_a_new_start() {
        let mut tracker = SequenceTracker::new();
        tracker.observe(500);
        assert_eq!(tracker.observe(1), Arrival::First);
        assert_eq!(tracker.observe(2), Arrival::Next);
        tracker.reset();
        assert_eq!(tracker.last(), None);
        assert_eq!(tracker.observe(2), Arrival::First);
    }
}
