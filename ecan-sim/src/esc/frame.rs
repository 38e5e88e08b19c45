//! Ethernet frames with EtherCAT datagrams, parsed in place (ETG.1000.4).

/// EtherType of EtherCAT.
pub const ETHERCAT_ETHERTYPE: u16 = 0x88A4;

const ETHERNET_HEADER_BYTES: usize = 14;
const SOURCE_ADDRESS: usize = 6;
const ETHERTYPE: usize = 12;
/// Bit that a slave sets in the first byte of the source address: locally administered.
const LOCALLY_ADMINISTERED: u8 = 0x02;

const ETHERCAT_HEADER_BYTES: usize = 2;
const LENGTH_MASK: u16 = 0x07FF;
const TYPE_DATAGRAMS: u16 = 1;

const DATAGRAM_HEADER_BYTES: usize = 10;
const COUNTER_BYTES: usize = 2;
/// Another datagram follows.
const MORE: u16 = 0x8000;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FrameFault {
    NotEtherCat,
    Short,
    /// EtherCAT, but no datagrams (type 1).
    Type,
    /// A datagram ends after the frame or its announced length.
    Datagram,
}

pub(super) struct Datagram<'a> {
    /// Header, data, working counter.
    bytes: &'a mut [u8],
}

impl Datagram<'_> {
    fn u16_at(&self, at: usize) -> u16 {
        match self.bytes.get(at..at + 2) {
            Some(&[low, high]) => u16::from_le_bytes([low, high]),
            _ => 0,
        }
    }

    fn set_u16_at(&mut self, at: usize, value: u16) {
        if let Some(to) = self.bytes.get_mut(at..at + 2) {
            to.copy_from_slice(&value.to_le_bytes());
        }
    }

    pub(super) fn command(&self) -> u8 {
        self.bytes.first().copied().unwrap_or(0)
    }

    /// Position or station address.
    pub(super) fn slave_address(&self) -> u16 {
        self.u16_at(2)
    }

    pub(super) fn count_slave_address_up(&mut self) {
        self.set_u16_at(2, self.slave_address().wrapping_add(1));
    }

    /// Address in the slave's memory.
    pub(super) fn offset(&self) -> u16 {
        self.u16_at(4)
    }

    pub(super) fn logical_address(&self) -> u32 {
        u32::from(self.offset()) << 16 | u32::from(self.slave_address())
    }

    pub(super) fn add_events(&mut self, events: u16) {
        self.set_u16_at(8, self.u16_at(8) | events);
    }

    pub(super) fn data(&mut self) -> &mut [u8] {
        let end = self.bytes.len().saturating_sub(COUNTER_BYTES);
        self.bytes.get_mut(DATAGRAM_HEADER_BYTES..end).unwrap_or_default()
    }

    pub(super) fn count(&mut self, by: u16) {
        let at = self.bytes.len().saturating_sub(COUNTER_BYTES);
        self.set_u16_at(at, self.u16_at(at).wrapping_add(by));
    }

    /// Fault: shifts the working counter, which stays at 0 or above.
    pub(super) fn shift_counter(&mut self, by: i32) {
        let at = self.bytes.len().saturating_sub(COUNTER_BYTES);
        let counter = i32::from(self.u16_at(at)).saturating_add(by).max(0);
        self.set_u16_at(at, u16::try_from(counter).unwrap_or(u16::MAX));
    }

    pub(super) fn is_logical(&self) -> bool {
        matches!(self.command(), 10..=12)
    }
}

/// Passes each datagram to `serve`, in order, up to a fault.
pub(super) fn for_each_datagram(
    frame: &mut [u8],
    mut serve: impl FnMut(Datagram<'_>),
) -> Result<(), FrameFault> {
    let header = frame.get(ETHERTYPE..ETHERTYPE + 2).ok_or(FrameFault::Short)?;
    if header != ETHERCAT_ETHERTYPE.to_be_bytes() {
        return Err(FrameFault::NotEtherCat);
    }
    let Some(&[low, high]) =
        frame.get(ETHERNET_HEADER_BYTES..ETHERNET_HEADER_BYTES + ETHERCAT_HEADER_BYTES)
    else {
        return Err(FrameFault::Short);
    };
    let header = u16::from_le_bytes([low, high]);
    if header >> 12 != TYPE_DATAGRAMS {
        return Err(FrameFault::Type);
    }
    let start = ETHERNET_HEADER_BYTES + ETHERCAT_HEADER_BYTES;
    let end = start + usize::from(header & LENGTH_MASK);
    let mut rest = frame.get_mut(start..end).ok_or(FrameFault::Datagram)?;
    loop {
        let Some(&[low, high]) = rest.get(6..8) else { return Err(FrameFault::Datagram) };
        let length = u16::from_le_bytes([low, high]);
        let bytes = DATAGRAM_HEADER_BYTES + usize::from(length & LENGTH_MASK) + COUNTER_BYTES;
        let Some((datagram, remaining)) = rest.split_at_mut_checked(bytes) else {
            return Err(FrameFault::Datagram);
        };
        serve(Datagram { bytes: datagram });
        if length & MORE == 0 {
            return Ok(());
        }
        rest = remaining;
    }
}

pub(super) fn mark_as_processed(frame: &mut [u8]) {
    if let Some(byte) = frame.get_mut(SOURCE_ADDRESS) {
        *byte |= LOCALLY_ADMINISTERED;
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A frame with these datagrams: command, slave address, offset, data.
    pub(crate) fn frame(datagrams: &[(u8, u16, u16, &[u8])]) -> Vec<u8> {
        let mut frame = vec![0xFF; 6];
        frame.extend([0x10, 0x10, 0x10, 0x10, 0x10, 0x10, 0x88, 0xA4, 0, 0]);
        for (nth, (command, address, offset, data)) in datagrams.iter().enumerate() {
            let more = if nth + 1 < datagrams.len() { MORE } else { 0 };
            frame.extend([*command, nth as u8]);
            frame.extend(address.to_le_bytes());
            frame.extend(offset.to_le_bytes());
            frame.extend((data.len() as u16 | more).to_le_bytes());
            frame.extend([0, 0]);
            frame.extend(*data);
            frame.extend([0, 0]);
        }
        let length = (frame.len() - 16) as u16 | 1 << 12;
        frame[14..16].copy_from_slice(&length.to_le_bytes());
        frame
    }

    #[test]
    fn datagrams_are_changed_in_place() {
        let mut bytes = frame(&[(4, 0x1001, 0x0130, &[0, 0]), (7, 0, 0x0000, &[9])]);
        let mut seen = Vec::new();
        for_each_datagram(&mut bytes, |mut datagram| {
            seen.push((datagram.command(), datagram.slave_address(), datagram.offset()));
            datagram.data().fill(0xAA);
            datagram.count(3);
            datagram.add_events(0x0008);
        })
        .unwrap();
        assert_eq!(seen, [(4, 0x1001, 0x0130), (7, 0, 0)]);
        let first = [4, 0, 0x01, 0x10, 0x30, 0x01, 2, 0x80, 8, 0, 0xAA, 0xAA, 3, 0];
        assert_eq!(bytes[16..30], first);
        assert_eq!(bytes[30..], [7, 1, 0, 0, 0, 0, 1, 0, 8, 0, 0xAA, 3, 0]);
        mark_as_processed(&mut bytes);
        assert_eq!(bytes[6], 0x12);
    }

    #[test]
    fn faulty_frames_have_distinct_errors() {
        let good = frame(&[(4, 0x1001, 0x0130, &[0, 0])]);
        let fault = |bytes: &[u8]| for_each_datagram(&mut bytes.to_vec(), |_| ()).unwrap_err();
        assert_eq!(fault(&good[..13]), FrameFault::Short);
        assert_eq!(fault(&good[..15]), FrameFault::Short);
        assert_eq!(fault(&good[..good.len() - 1]), FrameFault::Datagram);
        let mut other = good.clone();
        other[12] = 0x08;
        assert_eq!(fault(&other), FrameFault::NotEtherCat);
        let mut kind = good.clone();
        kind[15] = 0x40;
        assert_eq!(fault(&kind), FrameFault::Type);
        let mut more = good.clone();
        more[23] |= 0x80;
        assert_eq!(fault(&more), FrameFault::Datagram);
        let mut padded = good;
        padded.resize(60, 0);
        assert!(for_each_datagram(&mut padded, |_| ()).is_ok(), "padding is no datagram");
    }
}
