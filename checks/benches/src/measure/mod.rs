//! Measurement and output of the benchmarks.
//!
//! Two sides run in turn in one process, and what counts is the ratio of their times: each round
//! gives one, and the median of them is the result. So neither a change of the processor's clock
//! nor an interruption favours one side. [`Row`] prints the result for a person, and for the
//! script that makes one table of all benchmarks.

mod cold;
mod row;
mod thread_cpu;
mod turns;
mod wire;

pub use cold::Evictor;
pub use row::{Row, print_rows};
pub use thread_cpu::thread_cpu_ns;
pub use turns::{Outcome, interleaved, median, rounds, timed, warm, warm_alone};
pub use wire::wire_ns;
