//! Search for the LSS address of a slave without node-ID, bit by bit (CiA 305, fastscan).

use super::lss::{LssAddress, LssPart, LssRequest};

/// Known parts of the address that a fastscan searches. A known part takes one request instead of 33.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub struct FastscanFilter {
    /// Vendor-ID.
    pub vendor: Option<u32>,
    /// Product code.
    pub product: Option<u32>,
    /// Revision number.
    pub revision: Option<u32>,
    /// Serial number.
    pub serial: Option<u32>,
}

impl FastscanFilter {
    const fn part(&self, part: LssPart) -> Option<u32> {
        match part {
            LssPart::Vendor => self.vendor,
            LssPart::Product => self.product,
            LssPart::Revision => self.revision,
            LssPart::Serial => self.serial,
        }
    }
}

/// State of a fastscan after a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FastscanStep {
    /// Another [`request`](Fastscan::request) is due.
    Continue,
    /// The slave with this address was found and is in the configuration state.
    Found(LssAddress),
    /// No slave without node-ID matches the filter.
    NotFound,
    /// A slave matched each bit, and no slave matches the address that the bits form: a response was lost or
    /// late.
    Inconsistent {
        /// Part of the address.
        part: LssPart,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// First request: is there any slave?
    Start,
    /// Tests whether a bit is 0.
    Bit(u8),
    /// Compares the whole part.
    Confirm,
}

/// Search for the LSS address of one slave without node-ID.
///
/// It sends a request, waits for a fixed time whether any slave responds, and continues. A bit is first assumed to
/// be 0; silence shows that it is 1. Of several slaves, the one with the lowest address is found. A scan takes
/// 1 + 4 * 33 requests without filter. Plain data without time and I/O.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fastscan {
    filter: FastscanFilter,
    address: LssAddress,
    part: LssPart,
    stage: Stage,
}

impl Fastscan {
    /// Creates a scan at its first request.
    pub const fn new(filter: FastscanFilter) -> Self {
        let address = LssAddress { vendor: 0, product: 0, revision: 0, serial: 0 };
        Self { filter, address, part: LssPart::Vendor, stage: Stage::Start }
    }

    /// The request that is due.
    pub const fn request(&self) -> LssRequest {
        let part = self.part;
        let value = self.address.part(part);
        match self.stage {
            Stage::Start => LssRequest::Fastscan {
                value: 0,
                bit_check: LssRequest::FASTSCAN_START,
                part: LssPart::Vendor,
                next: LssPart::Vendor,
            },
            Stage::Bit(bit) => LssRequest::Fastscan { value, bit_check: bit, part, next: part },
            Stage::Confirm => LssRequest::Fastscan { value, bit_check: 0, part, next: part.next() },
        }
    }

    /// Takes the result of the request: whether any slave responded in time.
    pub fn advance(&mut self, has_response: bool) -> FastscanStep {
        match self.stage {
            Stage::Start if !has_response => return FastscanStep::NotFound,
            Stage::Start => self.begin(LssPart::Vendor),
            Stage::Bit(bit) => {
                if !has_response {
                    let value = self.address.part(self.part);
                    self.address.set_part(self.part, value | 1 << bit);
                }
                self.stage = bit.checked_sub(1).map_or(Stage::Confirm, Stage::Bit);
            }
            Stage::Confirm if !has_response => {
                return match self.filter.part(self.part) {
                    Some(_) => FastscanStep::NotFound,
                    None => FastscanStep::Inconsistent { part: self.part },
                };
            }
            Stage::Confirm if self.part == LssPart::Serial => {
                return FastscanStep::Found(self.address);
            }
            Stage::Confirm => self.begin(self.part.next()),
        }
        FastscanStep::Continue
    }

    fn begin(&mut self, part: LssPart) {
        self.part = part;
        match self.filter.part(part) {
            Some(value) => {
                self.address.set_part(part, value);
                self.stage = Stage::Confirm;
            }
            None => self.stage = Stage::Bit(31),
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::vec::Vec;

    use proptest::prelude::*;

    use super::*;

    /// A slave as CiA 305 describes it, byte by byte.
    struct Slave {
        parts: [u32; 4],
        position: u8,
        is_selected: bool,
    }

    impl Slave {
        fn new(parts: [u32; 4]) -> Self {
            Self { parts, position: 0, is_selected: false }
        }

        fn responds(&mut self, frame: [u8; 8]) -> bool {
            let [0x51, a, b, c, d, check, sub, next] = frame else { return false };
            if self.is_selected {
                return false;
            }
            if check == 0x80 {
                self.position = 0;
                return true;
            }
            let value = u32::from_le_bytes([a, b, c, d]);
            let own = self.parts[usize::from(self.position)];
            if sub != self.position || (value ^ own) >> check != 0 {
                return false;
            }
            self.position = next;
            self.is_selected = check == 0 && next < sub;
            true
        }
    }

    fn scan(slaves: &mut [Slave], filter: FastscanFilter) -> (FastscanStep, usize) {
        let mut scan = Fastscan::new(filter);
        for requests in 1.. {
            let frame = scan.request().to_bytes();
            let responses =
                slaves.iter_mut().filter_map(|s| s.responds(frame).then_some(())).count();
            let step = scan.advance(responses > 0);
            if step != FastscanStep::Continue {
                return (step, requests);
            }
        }
        unreachable!()
    }

    fn address([vendor, product, revision, serial]: [u32; 4]) -> LssAddress {
        LssAddress { vendor, product, revision, serial }
    }

    #[test]
    fn scan_without_slaves_takes_one_request() {
        assert_eq!(scan(&mut [], FastscanFilter::default()), (FastscanStep::NotFound, 1));
    }

    #[test]
    fn known_parts_shorten_the_scan() {
        let parts = [0x100, 2, 3, 0x8000_0001];
        let filter = FastscanFilter {
            vendor: Some(0x100),
            product: Some(2),
            revision: Some(3),
            serial: None,
        };
        let found = (FastscanStep::Found(address(parts)), 1 + 3 + 33);
        assert_eq!(scan(&mut [Slave::new(parts)], filter), found);
        let other = FastscanFilter { vendor: Some(0x101), ..filter };
        assert_eq!(scan(&mut [Slave::new(parts)], other), (FastscanStep::NotFound, 2));
    }

    #[test]
    fn lost_response_is_detected_by_the_confirmation() {
        let mut slave = Slave::new([0, 0, 0, 0]);
        let mut scan = Fastscan::new(FastscanFilter::default());
        for request in 0..40 {
            let responds = slave.responds(scan.request().to_bytes());
            let step = scan.advance(responds && request != 10);
            if step != FastscanStep::Continue {
                assert_eq!(step, FastscanStep::Inconsistent { part: LssPart::Vendor });
                return;
            }
        }
        panic!("the scan continued");
    }

    proptest! {
        /// Repeated scans find all slaves, each once, the lowest address first.
        #[test]
        fn scans_find_every_slave_in_order(
            mut all in proptest::collection::btree_set(any::<[u32; 4]>(), 1..6),
            close in any::<[u32; 4]>(),
        ) {
            // Addresses that differ in the last bits only.
            let [vendor, product, revision, serial] = close;
            all.extend([close, [vendor, product, revision, serial ^ 1]]);
            let mut slaves: Vec<Slave> = all.iter().rev().copied().map(Slave::new).collect();
            for parts in &all {
                let (step, requests) = scan(&mut slaves, FastscanFilter::default());
                prop_assert_eq!(step, FastscanStep::Found(address(*parts)));
                prop_assert_eq!(requests, 133);
            }
            let (step, _) = scan(&mut slaves, FastscanFilter::default());
            prop_assert_eq!(step, FastscanStep::NotFound);
        }
    }
}
