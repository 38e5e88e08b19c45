//! The process data codec against a plain C codec: ratios of their times, from one run.
//!
//! Both sides do the same work, in turn, and the medians of many rounds are compared. An image is
//! written from frames made beforehand, then judged and read, with a look at channel, identifier,
//! length and first data byte of each frame. The baseline is in `benches/baseline`; it writes the
//! same bytes and reads the same packets, as `tests/codec_baseline.rs` shows.
#![allow(missing_docs)]

mod images;
mod measure;
mod pair;

use std::hint::black_box;

use ecan_codec_baseline as baseline;
use ecan_protocol::{MAX_MULTIPLIER, crc16, crc16_is_accelerated, crc16_use_portable};

use images::Images;
use measure::Evictor;
use pair::Random;

const CRC_SIZES: [usize; 12] = [2, 4, 8, 12, 16, 24, 32, 64, 128, 512, 1512, 3048];

/// Bytes around the process data: preamble and start 8, Ethernet header 14, EtherCAT header 2,
/// datagram header 10 and working counter 2, check sequence 4, gap 12.
const FRAME_OVERHEAD: usize = 52;
/// Process data that an Ethernet frame of 1500 bytes holds in one datagram.
const FRAME_DATA: usize = 1486;
/// Nanoseconds of a byte at 100 Mbit/s.
const BYTE_NS: f64 = 80.0;

/// Wire time of an RxPDO and a TxPDO image of this size, in nanoseconds.
fn wire_ns(multiplier: u8) -> f64 {
    let data = 2 * 128 * usize::from(multiplier);
    (data + FRAME_OVERHEAD * data.div_ceil(FRAME_DATA)) as f64 * BYTE_NS
}

/// The CRC of `size` bytes, Rust over C.
fn crc_ratio(size: usize) -> f64 {
    let mut random = Random(size as u64);
    let data: Vec<u8> = (0..size).map(|_| random.bits() as u8).collect();
    measure::warm(crc_rounds(&data, crc16), crc_rounds(&data, baseline::crc16)).ratio()
}

/// The CRC of `data` over and over.
fn crc_rounds(data: &[u8], crc: impl Fn(&[u8]) -> u16) -> impl FnMut() {
    let repeat = (16_384 / (data.len() + 8)).max(8);
    move || {
        for _ in 0..repeat {
            black_box(crc(black_box(data)));
        }
    }
}

/// A line of the table: what, the goals with and without carry-less multiplication, the measure.
struct Line {
    name: String,
    goals: Option<[f64; 2]>,
    percent: bool,
    values: Vec<f64>,
}

impl Line {
    fn print(&self) {
        let show = |value: f64| {
            if self.percent { format!("{:.2} %", value * 100.0) } else { format!("{value:.3}") }
        };
        let mut line = format!("| {} |", self.name);
        for kernel in 0..2 {
            let value = self.values.get(kernel).copied();
            let goal = self.goals.map(|goals| goals[kernel]);
            let missed = matches!((value, goal), (Some(value), Some(goal)) if value > goal);
            let value = value.map_or("not measured".into(), show);
            let goal = goal.map_or(String::new(), show);
            line += &format!(" {value}{} | {goal} |", if missed { " (missed)" } else { "" });
        }
        println!("{line}");
    }
}

/// Every measure with the kernel that is chosen now, in the order of the table.
fn all(evictor: &Evictor) -> Vec<Line> {
    let mut random = Random(7);
    let data: Vec<[u8; 64]> =
        (0..255).map(|_| std::array::from_fn(|_| random.bits() as u8)).collect();
    let mut lines = Vec::new();
    let mut add = |name: String, goals, percent, value| {
        eprintln!("{name}: {value:.4}");
        lines.push(Line { name, goals, percent, values: vec![value] });
    };
    let three = Images::classic(3, 10, &data);
    let mut image = |name: &str, goals, value| add(name.into(), Some(goals), false, value);
    image("N = 24, 254 frames of 8 bytes", [0.09, 0.15], {
        Images::classic(24, 254, &data).warm(4).ratio()
    });
    image("N = 24, 44 CAN FD frames of 64 bytes", [0.045, 0.11], {
        Images::fd(24, 44, &data).warm(4).ratio()
    });
    image("N = 24, one random mix", [0.14, 0.20], Images::mixed(24, 1, &data).warm(4).ratio());
    image("N = 24, 64 random mixes in turn", [0.14, 0.20], {
        Images::mixed(24, 64, &data).warm(1).ratio()
    });
    image("N = 3, 10 frames of 8 bytes", [0.11, 0.17], three.warm(64).ratio());
    image("the same, cold caches", [0.22, 0.45], three.cold(evictor).ratio());

    let shares = (1..=MAX_MULTIPLIER).map(|multiplier| {
        (Images::full(multiplier, &data).rust_alone(32) / wire_ns(multiplier), multiplier)
    });
    let (share, _) = shares.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
    add("share of the wire time, worst N".into(), Some([0.004, 0.008]), true, share);

    for size in CRC_SIZES {
        let goals = match size {
            12 => Some([1.0, 1.0]),
            64.. => Some([0.06, 0.12]),
            _ => None,
        };
        add(format!("CRC of {size} bytes"), goals, false, crc_ratio(size));
    }
    lines
}

fn main() {
    let evictor = Evictor::new();
    let accelerated = crc16_is_accelerated();
    let mut lines = all(&evictor);
    crc16_use_portable(true);
    if accelerated && !crc16_is_accelerated() {
        for (line, portable) in lines.iter_mut().zip(all(&evictor)) {
            line.values.extend(portable.values);
        }
    }
    crc16_use_portable(false);

    println!("| Rust / C | accelerated | goal | portable | goal |");
    println!("|---|---:|---:|---:|---:|");
    for line in &lines {
        line.print();
    }
    println!();
    if !accelerated {
        println!("This processor has no carry-less multiplication; both columns are one kernel.");
    }
    println!("Cold: {} MiB walked before each timed call.", evictor.bytes() >> 20);
}
