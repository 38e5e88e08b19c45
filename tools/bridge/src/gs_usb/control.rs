//! Control transfers: the descriptors of the device, and the requests of the gs_usb protocol.

use std::time::SystemTime;

use crate::gs_usb::host_frame::micros;
use crate::rates::BusRates;

/// Clock of the bit timing, in hertz.
const CLOCK: u32 = 80_000_000;

// Features and modes of the protocol.
const HARDWARE_TIMESTAMP: u32 = 1 << 4;
const FD: u32 = 1 << 8;
const BT_CONST_EXTENDED: u32 = 1 << 10;

/// Address of the candleLight protocol, to which the kernel's driver binds.
const VENDOR_PRODUCT: [u8; 4] = [0x09, 0x12, 0x23, 0x23];

const DEVICE: [u8; 18] = {
    let [v0, v1, p0, p1] = VENDOR_PRODUCT;
    [18, 1, 0x00, 0x02, 0, 0, 0, 64, v0, v1, p0, p1, 0x00, 0x01, 1, 2, 3, 1]
};
/// One configuration, one vendor-specific interface, the bulk endpoints 0x81 and 0x02.
const CONFIGURATION: [u8; 32] = [
    9, 2, 32, 0, 1, 1, 0, 0x80, 0, //
    9, 4, 0, 0, 2, 0xFF, 0xFF, 0xFF, 0, //
    7, 5, 0x81, 2, 0x00, 0x02, 0, //
    7, 5, 0x02, 2, 0x00, 0x02, 0,
];

/// Change of the device's state by a control transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Change {
    None,
    Started,
    Stopped,
}

/// Data for the kernel and the change, or `None`: the device rejects the request.
pub(super) type Response = Option<(Vec<u8>, Change)>;

/// Responds to a control transfer of a device with one channel.
pub(super) fn respond(setup: [u8; 8], data: &[u8], serial: &str, rates: BusRates) -> Response {
    let [kind, request, value_low, value_high, ..] = setup;
    let good = |bytes: Vec<u8>| Some((bytes, Change::None));
    match (kind, request) {
        // GET_DESCRIPTOR
        (0x80, 6) => good(match (value_high, value_low) {
            (1, _) => DEVICE.to_vec(),
            (2, 0) => CONFIGURATION.to_vec(),
            (3, 0) => vec![4, 3, 0x09, 0x04],
            (3, 1) => string("ECAN SDK"),
            (3, 2) => string("ECAN-Lite channel"),
            (3, 3) => string(serial),
            _ => return None,
        }),
        // GET_STATUS of the device, interface and endpoint
        (0x80..=0x82, 0) => good(vec![0, 0]),
        // CLEAR_FEATURE, SET_CONFIGURATION, SET_INTERFACE
        (0..=2, 1 | 9 | 11) => good(Vec::new()),
        // Vendor requests from the driver to the device's interface.
        (0x41, 0) => good(Vec::new()),
        (0x41, 1) => rate(data, rates.nominal_bitrate),
        (0x41, 10) => rate(data, rates.data_bitrate),
        (0x41, 2) => {
            let is_start = data.first() == Some(&1);
            Some((Vec::new(), if is_start { Change::Started } else { Change::Stopped }))
        }
        (0xC1, 4) => good(little_endian(&timing_limits(rates))),
        (0xC1, 11) => {
            let extended = [1, 32, 1, 16, 16, 1, 32, 1];
            good(little_endian(&[&timing_limits(rates)[..], &extended].concat()))
        }
        // One channel, software and hardware version 2.
        (0xC1, 5) => good([vec![0; 4], little_endian(&[2, 2])].concat()),
        (0xC1, 6) => good(micros(now_ns()).to_le_bytes().to_vec()),
        _ => None,
    }
}

fn now_ns() -> u64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(0)
}

fn string(text: &str) -> Vec<u8> {
    let units: Vec<_> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
    [&[units.len() as u8 + 2, 3][..], &units].concat()
}

fn little_endian(values: &[u32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// Features, clock, and limits of the bit timing.
fn timing_limits(rates: BusRates) -> [u32; 10] {
    let fd = if rates.fd { FD | BT_CONST_EXTENDED } else { 0 };
    [HARDWARE_TIMESTAMP | fd, CLOCK, 1, 256, 1, 128, 128, 1, 512, 1]
}

/// Accepts a bit timing with the bit rate of the bus, which the bridge cannot change.
fn rate(data: &[u8], expected: u32) -> Response {
    let mut values = data.as_chunks().0.iter().map(|bytes| u64::from(u32::from_le_bytes(*bytes)));
    let [prop, phase1, phase2, _sjw, brp] = std::array::from_fn(|_| values.next().unwrap_or(0));
    let quanta = 1 + prop + phase1 + phase2;
    let found = u64::from(CLOCK) / brp.checked_mul(quanta).filter(|divisor| *divisor > 0)?;
    let is_right = found.abs_diff(expected.into()) * 100 <= u64::from(expected);
    is_right.then_some((Vec::new(), Change::None))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_bit_rate_of_bus_is_accepted() {
        let timing = |values: [u32; 5]| rate(&little_endian(&values), 500_000);
        assert!(timing([69, 70, 20, 10, 1]).is_some());
        assert!(timing([6, 7, 2, 1, 10]).is_some());
        assert!(timing([69, 70, 20, 10, 2]).is_none());
        assert!(timing([0; 5]).is_none());
        assert!(rate(&[], 500_000).is_none());
    }

    #[test]
    fn lengths_of_responses_match_driver() {
        let rates = BusRates::fd(500_000, 2_000_000);
        let length = |setup: [u8; 8]| respond(setup, &[], "s", rates).map(|it| it.0.len());
        assert_eq!(length([0xC1, 4, 0, 0, 0, 0, 40, 0]), Some(40));
        assert_eq!(length([0xC1, 11, 0, 0, 0, 0, 72, 0]), Some(72));
        assert_eq!(length([0xC1, 5, 1, 0, 0, 0, 12, 0]), Some(12));
        assert_eq!(length([0xC1, 6, 0, 0, 0, 0, 4, 0]), Some(4));
        assert_eq!(length([0x80, 6, 3, 3, 0, 0, 255, 0]), Some(4));
        assert_eq!(length([0x80, 6, 0, 6, 0, 0, 10, 0]), None);
    }
}
