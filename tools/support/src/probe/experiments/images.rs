//! Images and their errors.

use crc::{CRC_32_ISO_HDLC, Crc};
use ecan_protocol::image::{Header, ImageWriter, PdoError, Schedule, crc16};
use ecan_protocol::mapping::HEADER_BYTES;

use super::loopback::{frame, push};
use crate::probe::outcome::{Outcome, Result};
use crate::probe::run::Probe;
use crate::probe::session::{Session, Setup};

const LAST_ERROR: u8 = 14;
const ERROR_COUNTER: u8 = 15;

pub(in crate::probe) fn layout_crc(probe: &mut Probe) -> Result<Outcome> {
    let session = probe.session(&Setup::plain())?;
    let (crc, bytes, word) =
        (session.read(0x8010, 11)?, session.read(0x8010, 9)?, session.read(0x8010, 12)?);
    let crc32 = Crc::<u32>::new(&CRC_32_ISO_HDLC);
    let mut contract = 0x8010_u16.to_le_bytes().to_vec();
    contract.extend(bytes.to_le_bytes());
    contract.extend(word.to_le_bytes());
    let detail =
        format!("0x8010:11 is 0x{crc:08X} with {bytes} bytes and profile word 0x{word:08X}");
    Ok(if crc == crc32.checksum(&contract) {
        Outcome::holds(detail)
    } else if crc == 0 {
        Outcome::differs(detail).like("zero")
    } else if crc == crc32.checksum(&word.to_le_bytes()) {
        Outcome::differs(format!("{detail}: the CRC-32 of the profile word")).like("profile_word")
    } else {
        Outcome::differs(format!("{detail}: another algorithm"))
    })
}

pub(in crate::probe) fn sequence(probe: &mut Probe) -> Result<Outcome> {
    let session = probe.session(&Setup::plain())?;
    let before = session.sequence();
    let found = session.read(0x8011, 13)?;
    let after = session.sequence();
    let detail = format!("0x8011:13 was {found} while the images {before} to {after} were sent");
    let is_met = (found as u16).wrapping_sub(before) <= after.wrapping_sub(before);
    let outcome = Outcome::decided(is_met, detail);
    Ok(if found == 0 { outcome.like("zero") } else { outcome })
}

/// Last error and number of errors after images that `send` sends.
fn errors_of(
    session: &mut Session,
    send: impl FnOnce(&mut Session) -> Result,
) -> Result<(u32, u32)> {
    session.cycles(2)?;
    session.clear_errors()?;
    let before = session.read(0x8011, ERROR_COUNTER)?;
    send(session)?;
    session.cycles(2)?;
    let error = session.read(0x8011, LAST_ERROR)?;
    let count = session.read(0x8011, ERROR_COUNTER)?.wrapping_sub(before);
    Ok((error, count))
}

pub(in crate::probe) fn repeated_image(probe: &mut Probe) -> Result<Outcome> {
    let session = probe.session(&Setup::plain())?;
    let repeat = |session: &mut Session| {
        for _ in 0..4 {
            session.cycle_repeated()?;
        }
        Ok(())
    };
    let (error, count) = errors_of(session, repeat)?;
    session.clear_errors()?;
    let detail = format!("4 repetitions of an image: {count} PDO errors, the last one is {error}");
    Ok(match (count, error) {
        (0, 0) => Outcome::holds(detail),
        (_, 10) => Outcome::differs(detail).like("error_10"),
        _ => Outcome::differs(detail),
    })
}

/// Changes the CRC in the header.
fn bad_crc(image: &mut [u8]) {
    if let Some(crc) = image.get_mut(8..10) {
        crc.iter_mut().for_each(|byte| *byte = !*byte);
    }
}

pub(in crate::probe) fn profile_errors(probe: &mut Probe) -> Result<Outcome> {
    let session = probe.session(&Setup::plain())?;
    let (error, count) = errors_of(session, |session| session.cycle_tampered(bad_crc).map(drop))?;
    let status = session.read(0x8011, 2)?;
    session.clear_errors()?;
    let detail = format!(
        "an image with a wrong CRC: {count} PDO errors, the last one is {error}; 0x8011:02 is {status}"
    );
    Ok(match (count, status) {
        (0, _) => Outcome::undecided(format!("{detail}; the image is not counted as faulty")),
        (_, 7) => Outcome::holds(detail),
        (_, 0) => Outcome::differs(detail).like("counters_only"),
        (_, 5) => Outcome::undecided(format!("{detail}, for another reason")),
        _ => Outcome::differs(detail),
    })
}

pub(in crate::probe) fn error_numbers(probe: &mut Probe) -> Result<Outcome> {
    let session = probe.session(&Setup::plain())?;
    let other_layout: fn(&mut [u8]) = |image| {
        if let Some(byte) = image.get_mut(10) {
            *byte = !*byte;
        }
    };
    let unequal_sequences: fn(&mut [u8]) = |image| {
        if let Some(byte) = image.get_mut(4) {
            *byte = byte.wrapping_sub(1);
        }
    };
    let mut details = Vec::new();
    let mut is_met = true;
    let mut of_layout = 0;
    for (name, tamper, expected) in [
        ("other layout", other_layout, PdoError::ActiveArea),
        ("unequal sequences", unequal_sequences, PdoError::BadHeader),
        ("bad CRC", bad_crc as fn(&mut [u8]), PdoError::BadCrc),
    ] {
        let (error, count) =
            errors_of(session, |session| session.cycle_tampered(tamper).map(drop))?;
        is_met &= count == 1 && error == u32::from(expected.raw());
        if expected == PdoError::ActiveArea {
            of_layout = error;
        }
        details.push(format!("{name}: {error}"));
    }
    session.clear_errors()?;
    let outcome = Outcome::decided(is_met, format!("PDO errors found: {}", details.join(", ")));
    let is_header = of_layout == u32::from(PdoError::BadHeader.raw());
    Ok(if is_header { outcome.like("header_and_truncated") } else { outcome })
}

/// No channel is active in this stage: the frames are not sent.
pub(in crate::probe) fn channel_outside_mask(probe: &mut Probe) -> Result<Outcome> {
    let mut setup = Setup::plain();
    (setup.rx.channel_mask, setup.tx.channel_mask) = (1, 1);
    let frame = frame(0x100)?;
    let session = probe.session(&setup)?;
    let on_channel_1 = |image: &mut [u8]| {
        let Some((header, area)) = image.split_first_chunk_mut::<HEADER_BYTES>() else { return };
        let payload_len = usize::from(Header::parse(header).payload_len);
        if let Some(control) = area.first_mut() {
            *control = *control & !7 | 1;
        }
        let crc = crc16(area.get(..payload_len).unwrap_or_default()).to_le_bytes();
        header[8..10].copy_from_slice(&crc);
    };
    let (error, count) = errors_of(session, |session| {
        session.adapter.wait_next_cycle();
        session.exchange(|writer, image| _ = push(writer, image, &[frame]), on_channel_1).map(drop)
    })?;
    session.clear_errors()?;
    let detail =
        format!("a frame of channel 1 with mask 0x01: {count} PDO errors, the last one is {error}");
    Ok(Outcome::decided((count, error) == (1, 6), detail))
}

pub(in crate::probe) fn schedule_without_sync0(probe: &mut Probe) -> Result<Outcome> {
    let frame = frame(0x101)?;
    let session = probe.session(&Setup::plain())?;
    let (error, count) = errors_of(session, |session| {
        let schedule = Schedule { tag: 0, offset_ns: 0 };
        let fill = |writer: &mut ImageWriter, image: &mut [u8]| {
            let _ = writer.push_scheduled(image, 0, 0, frame.as_ref(), schedule);
        };
        session.cycle(fill).map(drop)
    })?;
    session.clear_errors()?;
    let detail =
        format!("a scheduled frame without Sync0: {count} PDO errors, the last one is {error}");
    Ok(Outcome::decided((count, error) == (1, 16), detail))
}

pub(in crate::probe) fn numbering(probe: &mut Probe) -> Result<Outcome> {
    let session = probe.session(&Setup::plain())?;
    session.take();
    session.write(0x8010, 8, 1)?;
    session.cycles(2)?;
    let sequences: Vec<_> =
        session.take().iter().filter_map(|inputs| Some(inputs.header?.seq_begin)).collect();
    let step = sequences.windows(2).find(|pair| pair[1] != pair[0].wrapping_add(1));
    Ok(match step {
        Some([before, 1]) => Outcome::holds(format!("the sequence stepped from {before} to 1")),
        Some(pair) => {
            Outcome::differs(format!("the sequence stepped from {} to {}", pair[0], pair[1]))
        }
        None => {
            let detail = format!("the sequence continued: {sequences:?}");
            Outcome::differs(detail).like("continued")
        }
    })
}
