//! Sender of single EtherCAT frames, which measures the turnaround of each.

use std::time::{Duration, Instant, SystemTime};

use crate::packet_socket::{Interface, PacketSocket, Received, SocketError};

/// Time from one frame to the next, as in a master's cycle.
const CYCLE: Duration = Duration::from_millis(1);
/// Time after which a frame has no response.
const TIMEOUT: Duration = Duration::from_millis(100);
/// Time for the simulator to start.
const START: Duration = Duration::from_secs(10);

const STATION: u16 = 0x1001;
/// Images of N = 3, one after the other.
const IMAGE_BYTES: u16 = 384;
const LOGICAL: u32 = 0x0001_0000;
/// Memory of the slave outside its sync managers.
const MEMORY: u16 = 0x2800;

const APWR: u8 = 2;
const FPRD: u8 = 4;
const FPWR: u8 = 5;
const BRD: u8 = 7;
const LRW: u8 = 12;
const STATION_ADDRESS: u16 = 0x0010;
const AL_STATUS: u16 = 0x0130;
const FMMU: u16 = 0x0600;
const SYSTEM_TIME: u16 = 0x0910;

/// After Ethernet and EtherCAT header.
const DATAGRAM: usize = 16;
const DATA: usize = DATAGRAM + 10;

/// A frame of the measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    State,
    Time,
    Images,
}

impl Kind {
    pub const ALL: [Self; 3] = [Self::State, Self::Time, Self::Images];

    pub fn text(self) -> &'static str {
        match self {
            Self::State => "BRD AL status",
            Self::Time => "FPRD system time",
            Self::Images => "LRW of 768 bytes",
        }
    }

    /// Command, address and bytes of its datagram.
    fn datagram(self) -> (u8, u32, usize) {
        match self {
            Self::State => (BRD, physical(0, AL_STATUS), 2),
            Self::Time => (FPRD, physical(STATION, SYSTEM_TIME), 8),
            Self::Images => (LRW, LOGICAL, 2 * usize::from(IMAGE_BYTES)),
        }
    }
}

fn physical(slave: u16, offset: u16) -> u32 {
    u32::from(slave) | u32::from(offset) << 16
}

pub struct Sample {
    pub kind: Kind,
    pub ns: u64,
}

pub struct Requester {
    socket: PacketSocket,
    index: u8,
    frame: Vec<u8>,
    received: Box<[u8; 2048]>,
    counters: [u16; 3],
    lost: u64,
}

impl Requester {
    pub fn open(interface: Interface) -> Result<Self, SocketError> {
        Ok(Self {
            socket: PacketSocket::open(interface)?,
            index: 0,
            frame: Vec::new(),
            received: Box::new([0; 2048]),
            counters: [0; 3],
            lost: 0,
        })
    }

    /// Waits for the first response, and sets the address of the first slave and its FMMUs.
    pub fn configure(&mut self) -> Result<(), Box<dyn std::error::Error>> {
        let start = Instant::now();
        let state = Kind::State.datagram();
        while self.exchange(state.0, state.1, &[0; 2])?.is_none_or(|(_, counter)| counter == 0) {
            if start.elapsed() > START {
                return Err(format!(
                    "no slave responds at {}: start a slave simulator at its other end",
                    self.socket.interface.name
                )
                .into());
            }
        }
        self.exchange(APWR, physical(0, STATION_ADDRESS), &STATION.to_le_bytes())?;
        for (number, direction) in [(0, 2), (1, 1)] {
            let offset = number * IMAGE_BYTES;
            let mut fmmu = [0; 16];
            fmmu[..4].copy_from_slice(&(LOGICAL + u32::from(offset)).to_le_bytes());
            fmmu[4..6].copy_from_slice(&IMAGE_BYTES.to_le_bytes());
            fmmu[7] = 7;
            fmmu[8..10].copy_from_slice(&(MEMORY + offset).to_le_bytes());
            fmmu[11] = direction;
            fmmu[12] = 1;
            self.exchange(FPWR, physical(STATION, FMMU + 16 * number), &fmmu)?;
        }
        Ok(())
    }

    /// Sends this number of frames of each kind, one per millisecond.
    pub fn segment(&mut self, frames: usize) -> Result<Vec<Sample>, SocketError> {
        let mut samples = Vec::with_capacity(frames * Kind::ALL.len());
        let data = [0; 2 * IMAGE_BYTES as usize];
        let mut next = Instant::now();
        for _ in 0..frames {
            for (kind, counter) in Kind::ALL.into_iter().zip(0..) {
                next += CYCLE;
                std::thread::sleep(next.saturating_duration_since(Instant::now()));
                let (command, address, bytes) = kind.datagram();
                match self.exchange(command, address, &data[..bytes])? {
                    Some((ns, working_counter)) => {
                        self.counters[counter] = working_counter;
                        samples.push(Sample { kind, ns });
                    }
                    None => self.lost += 1,
                }
            }
        }
        Ok(samples)
    }

    /// Working counter of the last frame of this kind.
    pub fn working_counter(&self, kind: Kind) -> u16 {
        self.counters[kind as usize]
    }

    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Sends a datagram; returns turnaround and working counter, or `None` without a response.
    fn exchange(
        &mut self,
        command: u8,
        address: u32,
        data: &[u8],
    ) -> Result<Option<(u64, u16)>, SocketError> {
        self.index = self.index.wrapping_add(1);
        let length = data.len() as u16;
        self.frame.clear();
        self.frame.extend([0xFF; 6]);
        self.frame.extend([0x10, 0x10, 0x10, 0x10, 0x10, 0x10, 0x88, 0xA4]);
        self.frame.extend(((length + 12) | 1 << 12).to_le_bytes());
        self.frame.extend([command, self.index]);
        self.frame.extend(address.to_le_bytes());
        self.frame.extend(length.to_le_bytes());
        self.frame.extend([0, 0]);
        self.frame.extend(data);
        self.frame.extend([0, 0]);
        let start = Instant::now();
        let sent_ns = real_time_ns();
        self.socket.send(&self.frame)?;
        loop {
            match self.socket.receive(&mut self.received[..])? {
                Received::Frame { bytes, arrived_ns: Some(arrived_ns) } => {
                    let frame = &self.received[..bytes];
                    let end = DATA + data.len();
                    if frame.get(DATAGRAM..DATAGRAM + 2) == Some(&[command, self.index]) {
                        let counter = frame.get(end..end + 2).map_or(0, |bytes| {
                            u16::from_le_bytes(bytes.try_into().unwrap_or_default())
                        });
                        return Ok(Some((arrived_ns.saturating_sub(sent_ns), counter)));
                    }
                }
                Received::Frame { .. } => {}
                Received::Nothing | Received::Down => {
                    let left = TIMEOUT.saturating_sub(start.elapsed());
                    if left.is_zero() {
                        return Ok(None);
                    }
                    self.socket.wait(left.as_nanos() as u64);
                }
            }
        }
    }
}

/// The clock of arrival times.
fn real_time_ns() -> u64 {
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    now.as_nanos() as u64
}
