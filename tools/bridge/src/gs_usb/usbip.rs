//! Messages of USB/IP between the kernel's virtual host controller and a device
//! (`Documentation/usb/usbip_protocol.rst`). All numbers are big-endian.

use std::io::{self, Read};

const HEADER: usize = 48;
const SUBMIT: u32 = 1;
const UNLINK: u32 = 2;
const SUBMITTED: u32 = 3;
const UNLINKED: u32 = 4;

/// Maximum length of a transfer; a control transfer or one frame.
const MAX_LENGTH: usize = 64 * 1024;

/// Request of the kernel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Request {
    /// Transfer with the device.
    Submit(Transfer),
    /// Cancellation of the transfer with the number `victim`.
    Unlink { number: u32, victim: u32 },
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Transfer {
    pub(super) number: u32,
    pub(super) endpoint: u32,
    pub(super) is_in: bool,
    /// Number of bytes that the kernel accepts or sends.
    pub(super) length: usize,
    pub(super) setup: [u8; 8],
    /// Data for the device.
    pub(super) data: Vec<u8>,
}

fn word(header: &[u8; HEADER], at: usize) -> u32 {
    let bytes = header.get(at..).and_then(|rest| rest.first_chunk());
    bytes.map_or(0, |bytes| u32::from_be_bytes(*bytes))
}

impl Request {
    /// Waits for the next request.
    pub(super) fn read(from: &mut impl Read) -> io::Result<Self> {
        let mut header = [0; HEADER];
        from.read_exact(&mut header)?;
        let number = word(&header, 4);
        match word(&header, 0) {
            UNLINK => Ok(Self::Unlink { number, victim: word(&header, 20) }),
            SUBMIT => {
                let is_in = word(&header, 12) == 1;
                let length = word(&header, 24) as usize;
                if length > MAX_LENGTH {
                    return Err(io::ErrorKind::InvalidData.into());
                }
                let mut data = vec![0; if is_in { 0 } else { length }];
                from.read_exact(&mut data)?;
                let setup = *header.last_chunk().unwrap_or(&[0; 8]);
                let endpoint = word(&header, 16);
                Ok(Self::Submit(Transfer { number, endpoint, is_in, length, setup, data }))
            }
            _ => Err(io::ErrorKind::InvalidData.into()),
        }
    }
}

fn response(kind: u32, number: u32, status: i32, length: usize) -> Vec<u8> {
    let mut bytes = vec![0; HEADER];
    let words = [(0, kind), (4, number), (20, status.cast_unsigned()), (24, length as u32)];
    for (at, value) in words {
        if let Some(place) = bytes.get_mut(at..at + 4) {
            place.copy_from_slice(&value.to_be_bytes());
        }
    }
    bytes
}

/// Completion of a transfer from the device.
pub(super) fn complete_in(number: u32, data: &[u8]) -> Vec<u8> {
    let mut bytes = response(SUBMITTED, number, 0, data.len());
    bytes.extend(data);
    bytes
}

/// Completion of a transfer to the device.
pub(super) fn complete_out(number: u32, length: usize) -> Vec<u8> {
    response(SUBMITTED, number, 0, length)
}

/// Failure of a transfer, with a negative error number.
pub(super) fn fail(number: u32, status: i32) -> Vec<u8> {
    response(SUBMITTED, number, status, 0)
}

/// Response to a cancellation.
pub(super) fn unlinked(number: u32, status: i32) -> Vec<u8> {
    response(UNLINKED, number, status, 0)
}
