//! A whole cycle of the Port on a master that exchanges nothing: begin, receive all, send, end.
//!
//! ```text
//! cargo bench -p ecan-mcan-port --bench cycle
//! ```
//!
//! Set against the bare codec that writes and reads the same images, and against the time that they
//! take on the wire. The rest is the Port's own: sessions, working counters, sequences, statistics,
//! tickets. A real master adds its system calls.
#![allow(missing_docs)]

use std::cell::RefCell;
use std::hint::black_box;

use ecan_bench::measure::{Row, print_rows, warm, wire_ns};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, ChannelHandle, GatewayConfig, Port, PortConfig, ReceivedView};
use ecan_protocol::can::{CanId, FrameRef};
use ecan_protocol::image::{
    ChannelState, ChannelStatus, CommitFields, ImageReader, ImageWriter, Packet, PdoProfile,
    Timestamp, crc16_is_accelerated, crc16_use_portable,
};
use ecan_protocol::mapping::{CHANNELS, Direction};

/// Cycles in a round.
const REPEAT: usize = 16;
const DATA: [u8; 8] = [1, 2, 3, 4, 5, 6, 7, 8];

struct Case {
    slaves: usize,
    multiplier: u8,
    /// In each image.
    frames: usize,
}

impl Case {
    fn size(&self) -> String {
        let Self { slaves, multiplier, frames } = self;
        let plural = if *slaves == 1 { "" } else { "s" };
        format!("{slaves} slave{plural}, N = {multiplier}, {frames} frames each way")
    }
}

const CASES: [Case; 4] = [
    Case { slaves: 1, multiplier: 3, frames: 10 },
    Case { slaves: 3, multiplier: 3, frames: 10 },
    Case { slaves: 1, multiplier: 11, frames: 115 },
    Case { slaves: 3, multiplier: 11, frames: 115 },
];

fn frame(number: usize) -> (u8, FrameRef<'static>) {
    let id = CanId::new(0x100 + number as u32, false).unwrap();
    ((number % CHANNELS) as u8, FrameRef::classic(id, &DATA).unwrap())
}

fn push_all(
    writer: &mut ImageWriter,
    image: &mut [u8],
    frames: &[(u8, FrameRef<'_>)],
    fields: CommitFields,
) {
    for &(channel, frame) in frames {
        writer.push(image, channel, 0, frame, Timestamp::None).unwrap();
    }
    writer.commit(image, fields);
}

/// The look that both sides take at each frame.
fn look(channel: u8, frame: FrameRef<'_>) -> u64 {
    let data = frame.data();
    u64::from(channel)
        + u64::from(frame.id().raw())
        + data.len() as u64
        + data.first().map_or(0, |&first| first.into())
}

/// The bare codec, with the images of one slave.
struct Codec {
    writer: ImageWriter,
    reader: ImageReader,
    rx_image: Vec<u8>,
    tx_image: Vec<u8>,
}

impl Codec {
    fn new(rx: PdoProfile, tx: PdoProfile, frames: &[(u8, FrameRef<'_>)]) -> Self {
        let mut tx_image = vec![0; tx.pdo_bytes()];
        let running = ChannelStatus::default().with_state(ChannelState::Run);
        let fields = CommitFields { channel_status: [running; CHANNELS], ..Default::default() };
        push_all(&mut ImageWriter::new(Direction::TxPdo, tx), &mut tx_image, frames, fields);
        Self {
            writer: ImageWriter::new(Direction::RxPdo, rx),
            reader: ImageReader::new(Direction::TxPdo, tx),
            rx_image: vec![0; rx.pdo_bytes()],
            tx_image,
        }
    }

    #[inline(never)]
    fn cycle(&mut self, frames: &[(u8, FrameRef<'_>)]) -> u64 {
        let mut sum = 0;
        for packet in self.reader.read(black_box(&self.tx_image)).unwrap().packets() {
            if let Ok(Packet::Frame(packet)) = packet {
                sum += look(packet.channel, packet.frame);
            }
        }
        push_all(&mut self.writer, &mut self.rx_image, frames, CommitFields::default());
        sum
    }
}

/// Both sides of a case.
struct Bench {
    case: &'static Case,
    frames: Vec<(u8, FrameRef<'static>)>,
    port: Port,
    codecs: Vec<Codec>,
}

impl Bench {
    fn new(case: &'static Case) -> Self {
        let gateway = GatewayConfig {
            paced: false,
            ..GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000))
        };
        let profile = |direction| gateway.profile(direction, case.multiplier);
        let frames: Vec<_> = (0..case.frames).map(frame).collect();
        let codec = || Codec::new(profile(Direction::RxPdo), profile(Direction::TxPdo), &frames);
        let codecs: Vec<_> = (0..case.slaves).map(|_| codec()).collect();

        let ecrt = ecan_bench::null_master::open(ecan_sim::echo(case.slaves)).unwrap();
        let adapter = AdapterConfig::new(case.slaves as u16).with_multiplier(case.multiplier);
        let config = PortConfig::uniform(case.slaves, gateway);
        let mut port = Port::open(&ecrt, (adapter, config)).unwrap();
        port.wait_ready().unwrap();
        for (slave, codec) in codecs.iter().enumerate() {
            let image = port.adapter().tx_pdo(slave);
            ecan_bench::null_master::keep_new(image);
            ecan_bench::null_master::replace(image, &codec.tx_image);
        }
        Self { case, frames, port, codecs }
    }

    /// A cycle of the Port; the sum over what was received.
    #[inline(never)]
    fn cycle(
        port: &mut Port,
        channels: &[[ChannelHandle; CHANNELS]],
        frames: &[(u8, FrameRef<'_>)],
    ) -> u64 {
        let mut sum = 0;
        let mut cycle = port.begin_cycle();
        for item in cycle.received() {
            if let ReceivedView::Frame { packet, .. } = item {
                sum += look(packet.channel, packet.frame);
            }
        }
        for channels in channels {
            for &(channel, frame) in frames {
                cycle.send(channels[usize::from(channel)], frame).unwrap();
            }
        }
        cycle.end().unwrap();
        sum
    }

    /// Cycle over codec, and cycle over wire.
    fn measure(&mut self) -> (f64, f64) {
        let Self { case, frames, port, codecs } = self;
        // What is timed is the same work.
        let handles: Vec<[ChannelHandle; CHANNELS]> = (0..case.slaves)
            .map(|slave| [0, 1, 2, 3].map(|channel| port.channel(slave, channel).unwrap()))
            .collect();
        Self::cycle(port, &handles, frames);
        let through_port = Self::cycle(port, &handles, frames);
        let bare: u64 = codecs.iter_mut().map(|codec| codec.cycle(frames)).sum();
        assert_eq!(through_port, bare);
        for (slave, codec) in codecs.iter().enumerate() {
            let image = port.adapter().rx_pdo(slave);
            let (sent, bare) = (image.get(24..), codec.rx_image.get(24..));
            assert!(sent == bare, "the images of slave {slave} differ");
        }

        let outcome = warm(
            || {
                for _ in 0..REPEAT {
                    black_box(Self::cycle(port, &handles, black_box(frames)));
                }
            },
            || {
                for _ in 0..REPEAT {
                    for codec in codecs.iter_mut() {
                        black_box(codec.cycle(black_box(frames)));
                    }
                }
            },
        );
        let wire = wire_ns(case.multiplier) * case.slaves as f64 * REPEAT as f64;
        (outcome.ratio, outcome.first / wire)
    }

    /// Cycles that copy their images for another thread, over cycles that do not.
    fn sharing_row(&mut self) -> Row {
        let Self { case, frames, port, .. } = self;
        let handles: Vec<[ChannelHandle; CHANNELS]> = (0..case.slaves)
            .map(|slave| [0, 1, 2, 3].map(|channel| port.channel(slave, channel).unwrap()))
            .collect();
        let stream = RefCell::new(port.image_stream(1 << 20));
        let port = RefCell::new(port);
        let run = |is_paused| {
            let (mut stream, mut port) = (stream.borrow_mut(), port.borrow_mut());
            stream.set_paused(is_paused);
            for _ in 0..REPEAT {
                black_box(Self::cycle(&mut port, &handles, black_box(frames)));
            }
            // The other thread reads at another time; here the ring only has to be empty.
            stream.clear();
        };
        let outcome = warm(|| run(false), || run(true));
        assert_eq!(stream.borrow().lost(), 0);
        let name = format!("images for another thread, {}", case.size());
        Row::new(name, "whole cycle with / without them, null master", outcome.ratio)
    }

    fn rows(&mut self) -> [Row; 2] {
        let (over_codec, over_wire) = self.measure();
        let name = format!("whole cycle, {}", self.case.size());
        let row = Row::new(name, "Port on a null master / bare codec, same images", over_codec);
        let share = Row::new("the same, share of the wire time", "Port / 100 Mbit/s", over_wire);
        [row, share.as_share()]
    }
}

fn main() {
    let mut benches: Vec<Bench> = CASES.iter().map(Bench::new).collect();
    ecan_bench::null_master::freeze();
    let sharing: Vec<_> = benches.iter_mut().map(Bench::sharing_row).collect();
    let mut all = || -> Vec<Row> { benches.iter_mut().flat_map(Bench::rows).collect() };
    let is_accelerated = crc16_is_accelerated();
    let mut rows = all();
    crc16_use_portable(true);
    if is_accelerated && !crc16_is_accelerated() {
        for (row, portable) in rows.iter_mut().zip(all()) {
            row.values.extend(portable.values);
        }
    }
    crc16_use_portable(false);
    rows.extend(sharing);
    print_rows(&rows);
}
