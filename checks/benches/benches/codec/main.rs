//! The process data codec against a plain C codec: ratios of their times, from one run.
//!
//! Both sides do the same work, in turn, and the medians of many rounds are compared. An image is
//! written from frames made beforehand, then judged and read, with a look at channel, identifier,
//! length and first data byte of each frame. The baseline is in `src/baseline`; it writes the
//! same bytes and reads the same packets, as `tests/codec_baseline.rs` shows.
#![allow(missing_docs)]

mod images;
mod pair;

use std::hint::black_box;

use ecan_bench::baseline;
use ecan_bench::measure::{Evictor, Outcome, Row, print_rows, warm, wire_ns};
use ecan_protocol::image::{crc16, crc16_is_accelerated, crc16_use_portable};
use ecan_protocol::mapping::MAX_MULTIPLIER;

use images::Images;
use pair::Random;

const CRC_SIZES: [usize; 12] = [2, 4, 8, 12, 16, 24, 32, 64, 128, 512, 1512, 3048];

/// The CRC of `size` bytes, Rust over C.
fn crc_ratio(size: usize) -> f64 {
    let mut random = Random(size as u64);
    let data: Vec<u8> = (0..size).map(|_| random.bits() as u8).collect();
    warm(crc_rounds(&data, crc16), crc_rounds(&data, baseline::crc16)).ratio
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

/// What is walked before cold calls.
struct Cold {
    second_level: Evictor,
    last_level: Evictor,
}

/// Every measure with the kernel that is chosen now, in the order of the table.
fn all(cold: &Cold) -> Vec<Row> {
    let mut random = Random(7);
    let data: Vec<[u8; 64]> =
        (0..255).map(|_| std::array::from_fn(|_| random.bits() as u8)).collect();
    let image = |name: &str, goals: [f64; 2], outcome: Outcome| {
        let name = format!("encode + decode, {name}");
        Row::new(name, "codec / plain C codec", outcome.ratio).with_goals(goals[0], goals[1])
    };
    let three = Images::classic(3, 10, &data);
    let mut rows = vec![
        image(
            "N = 24, 254 frames of 8 bytes",
            [0.09, 0.15],
            Images::classic(24, 254, &data).warm(4),
        ),
        image(
            "N = 24, 44 CAN FD frames of 64 bytes",
            [0.045, 0.11],
            Images::fd(24, 44, &data).warm(4),
        ),
        image("N = 24, one random mix", [0.14, 0.20], Images::mixed(24, 1, &data).warm(4)),
        image("N = 24, 64 random mixes in turn", [0.14, 0.20], {
            Images::mixed(24, 64, &data).warm(1)
        }),
        image("N = 3, 10 frames of 8 bytes", [0.11, 0.17], three.warm(64)),
        image("the same, from the last-level cache", [0.22, 0.45], three.cold(&cold.second_level)),
        image("the same, from memory", [0.22, 0.45], three.cold(&cold.last_level)),
    ];
    let shares = (1..=MAX_MULTIPLIER)
        .map(|multiplier| Images::full(multiplier, &data).rust_alone(32) / wire_ns(multiplier));
    let share = shares.fold(0.0, f64::max);
    let share = Row::new("encode + decode, worst N", "codec / wire time at 100 Mbit/s", share);
    rows.push(share.with_goals(0.004, 0.008).as_share());
    for size in CRC_SIZES {
        let row = Row::new(format!("CRC of {size} bytes"), "codec / C table", crc_ratio(size));
        rows.push(match size {
            12 => row.with_goals(1.0, 1.0),
            64.. => row.with_goals(0.06, 0.12),
            _ => row,
        });
    }
    rows
}

fn main() {
    let cold =
        Cold { second_level: Evictor::of_second_level(), last_level: Evictor::of_last_level() };
    let is_accelerated = crc16_is_accelerated();
    let mut rows = all(&cold);
    crc16_use_portable(true);
    if is_accelerated && !crc16_is_accelerated() {
        for (row, portable) in rows.iter_mut().zip(all(&cold)) {
            row.values.extend(portable.values);
        }
    }
    crc16_use_portable(false);
    print_rows(&rows);
    if !is_accelerated {
        println!("This processor has no carry-less multiplication: one kernel is measured.");
    }
    let [second, last] = [&cold.second_level, &cold.last_level].map(|level| level.bytes() >> 20);
    println!("From the last-level cache: {second} MiB walked before each timed call.");
    println!("From memory: {last} MiB.");
}
