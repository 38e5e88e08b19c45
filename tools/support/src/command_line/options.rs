//! Options that programs share: bit rates, the log (`--log`, `RUST_LOG`), and the real-time settings of a thread
//! (manual 13.9).

use std::ops::RangeInclusive;
use std::path::PathBuf;

use clap::Args;
use ecan_host::{
    Adapter, CycleStatistics, CycleTiming, MAX_SPIN_NS, Need, OverrunPolicy, RealTimeConfig,
    RealTimeError,
};
use tracing_subscriber::EnvFilter;

use super::screen::{CleanWriter, Content, Stream};
use crate::print_line;

/// Units of a time and their length in nanoseconds; a unit that is the end of another one follows it.
const UNITS: [(&str, f64); 4] = [("us", 1e3), ("ms", 1e6), ("min", 6e10), ("s", 1e9)];
const MS: u64 = 1_000_000;
const SECOND: u64 = 1_000 * MS;
/// Milliseconds of an option without another limit: about 49 days, as in scenario files.
pub const ANY_TIME: RangeInclusive<u64> = 0..=u32::MAX as u64;

/// Parses a time as a number of nanoseconds: `300ms`, `1.5s`, `1min`. A number without a unit is in milliseconds.
///
/// # Errors
/// The text is not a time from 0 to about 49 days.
pub fn parse_time(text: &str) -> Result<u64, String> {
    let unit = |(unit, ns): &(&str, f64)| Some((text.strip_suffix(unit)?, *ns));
    let (number, unit_ns) = UNITS.iter().find_map(unit).unwrap_or((text, MS as f64));
    let ns = number.parse::<f64>().ok().map(|number| (number * unit_ns).round());
    match ns.filter(|ns| (0.0..=(*ANY_TIME.end() * MS) as f64).contains(ns)) {
        Some(ns) => Ok(ns as u64),
        None => Err("expected a time, such as 300ms, 1.5s or 1min".to_owned()),
    }
}

/// Parser of an option: a time in whole milliseconds, within these limits.
pub fn milliseconds<T: TryFrom<u64>>(
    limits: RangeInclusive<u64>,
) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static {
    move |text| whole(text, MS, &limits)
}

/// Parser of an option: a time in whole seconds, within these limits.
pub fn seconds<T: TryFrom<u64>>(
    limits: RangeInclusive<u64>,
) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static {
    move |text| whole(text, SECOND, &limits)
}

fn whole<T: TryFrom<u64>>(
    text: &str,
    unit_ns: u64,
    limits: &RangeInclusive<u64>,
) -> Result<T, String> {
    let ns = parse_time(text)?;
    let is_allowed = ns.is_multiple_of(unit_ns) && limits.contains(&(ns / unit_ns));
    is_allowed.then(|| T::try_from(ns / unit_ns).ok()).flatten().ok_or_else(|| {
        let unit = if unit_ns == MS { "ms" } else { "s" };
        let without_unit = match text.parse::<f64>() {
            Ok(_) => "; a number without a unit is in milliseconds",
            Err(_) => "",
        };
        format!("expected {} to {} {unit}{without_unit}", limits.start(), limits.end())
    })
}

/// Parses a bit rate: `500000`, `500k`, `1M` or `2.5M`.
///
/// # Errors
/// The text is not a bit rate from 1000 to 4294967295 bit/s: a smaller number is meant in kbit/s, since
/// transceivers do not transmit that slowly.
pub fn parse_bit_rate(text: &str) -> Result<u32, String> {
    let (digits, factor) = match text.strip_suffix(['k', 'M']) {
        Some(digits) if text.ends_with('k') => (digits, 1_000),
        Some(digits) => (digits, 1_000_000),
        None => (text, 1),
    };
    let rate = scaled(digits, factor).filter(|rate| *rate >= 1_000);
    rate.ok_or_else(|| {
        "expected a bit rate in bit/s, at least 1000, with k or M for thousands or millions: 500000, 500k, 1M"
            .to_owned()
    })
}

/// Parses the name of a picture.
///
/// # Errors
/// The name does not end in `.svg`.
pub fn parse_svg_path(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let is_svg = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("svg"));
    if is_svg {
        return Ok(path);
    }
    Err("only SVG is written: use a name that ends in .svg, and convert the file afterwards, for example with \
         rsvg-convert"
        .to_owned())
}

/// The decimal number times the factor, if that is an integer.
fn scaled(digits: &str, factor: u32) -> Option<u32> {
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let (whole, fraction) = match digits.split_once('.') {
        Some((whole, fraction)) if is_number(fraction) => (whole, fraction),
        Some(_) => return None,
        None => (digits, ""),
    };
    if !is_number(whole) {
        return None;
    }
    let divisor = 10_u64.checked_pow(fraction.len().try_into().ok()?)?;
    let product = format!("{whole}{fraction}").parse::<u64>().ok()?.checked_mul(factor.into())?;
    if product % divisor != 0 {
        return None;
    }
    u32::try_from(product / divisor).ok()
}

/// Option for the log on standard error.
#[derive(Debug, Clone, Default, Args)]
pub struct LogArguments {
    /// Log to standard error: off, error, warn, info, debug, trace or TARGET=LEVEL,...
    /// [default: RUST_LOG, or off]
    #[arg(long, global = true, value_name = "FILTER", value_parser = parse_filter)]
    log: Option<String>,
}

impl LogArguments {
    /// Starts the log of the process. Without `--log` and `RUST_LOG` nothing is installed, and events
    /// cost nothing.
    ///
    /// Call once, at the start of the program; later calls have no effect. Invalid parts of `RUST_LOG`
    /// are ignored.
    pub fn start(&self) {
        let filter = match (&self.log, std::env::var(EnvFilter::DEFAULT_ENV)) {
            (Some(filter), _) => EnvFilter::builder().parse_lossy(filter),
            (None, Ok(filter)) if !filter.is_empty() => EnvFilter::builder().parse_lossy(filter),
            (None, _) => return,
        };
        let subscriber = tracing_subscriber::fmt()
            .with_env_filter(filter)
            .with_writer(|| CleanWriter::with_content(Stream::Error, Content::Log))
            .with_ansi(Stream::Error.is_terminal() && std::env::var_os("NO_COLOR").is_none());
        let _ = subscriber.try_init();
    }
}

fn parse_filter(text: &str) -> Result<String, String> {
    match EnvFilter::builder().parse(text) {
        Ok(_) => Ok(text.to_owned()),
        Err(error) => Err(format!("{error}; expected a level or target=level, for example debug")),
    }
}

/// Size of the stack to prefault with `--lock-memory`, in bytes.
const STACK_BYTES: usize = 256 * 1024;

/// Real-time options of a thread.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Real time")]
pub struct ThreadArguments {
    /// Run under SCHED_FIFO with this priority, 1 to 99
    #[arg(long, value_name = "PRIORITY", value_parser = clap::value_parser!(u8).range(1..=99))]
    rt_priority: Option<u8>,
    /// Run on these CPUs only, comma-separated
    #[arg(long, value_name = "CPU", value_delimiter = ',')]
    cpu: Option<Vec<usize>>,
    /// Lock all memory in RAM
    #[arg(long)]
    lock_memory: bool,
    /// Fail if the system denies a requested real-time setting
    #[arg(long)]
    rt_required: bool,
}

impl ThreadArguments {
    /// Returns the settings.
    pub fn settings(&self) -> RealTimeConfig {
        let need = if self.rt_required { Need::Required } else { Need::Optional };
        RealTimeConfig {
            priority: self.rt_priority,
            priority_need: need,
            cpus: self.cpu.clone(),
            cpus_need: need,
            lock_memory: self.lock_memory.then_some(STACK_BYTES),
            lock_memory_need: need,
            wake_up_latency_need: need,
            ..RealTimeConfig::default()
        }
    }
}

/// Real-time options of the cycle thread.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Real time")]
pub struct RealTimeArguments {
    #[command(flatten)]
    thread: ThreadArguments,
    /// Limit the exit latency of CPU sleep states, in us
    #[arg(long, value_name = "US")]
    cpu_latency_us: Option<u32>,
    /// Spin instead of sleeping for this time before each cycle, in us
    #[arg(long, value_name = "US", default_value_t = 0, hide_default_value = true,
          value_parser = clap::value_parser!(u64).range(..=MAX_SPIN_NS / 1000))]
    spin_us: u64,
}

impl RealTimeArguments {
    /// Returns whether any option is given.
    pub fn is_given(&self) -> bool {
        self.settings() != RealTimeConfig::default()
    }

    /// Spin before each cycle, as set by the options.
    pub fn timing(&self) -> CycleTiming {
        CycleTiming { spin_ns: self.spin_us * 1000, overrun: OverrunPolicy::Skip }
    }

    fn settings(&self) -> RealTimeConfig {
        RealTimeConfig {
            wake_up_latency_us: self.cpu_latency_us,
            timing: self.timing(),
            ..self.thread.settings()
        }
    }

    /// Applies the settings to this thread and reports each result as a line.
    ///
    /// Call it after starting threads that must not inherit the settings, and before the cycle
    /// starts.
    ///
    /// # Errors
    /// A setting was denied and `--rt-required` is given.
    pub fn apply(&self, mut report_line: impl FnMut(&str)) -> Result<(), RealTimeError> {
        let report = self.settings().apply()?;
        for outcome in &report.outcomes {
            report_line(&outcome.to_string());
        }
        if !report.is_complete() {
            report_line("continuing without the denied settings");
        }
        Ok(())
    }

    /// Sets the cycle timing of the Adapter.
    pub fn set_timing(&self, adapter: &mut Adapter) {
        adapter.set_cycle_timing(self.timing());
    }
}

/// Prints the cycle statistics.
pub fn print_statistics(adapter: &Adapter, statistics: &CycleStatistics) {
    print_line!("\n{statistics}");
    if !adapter.clock().is_free_running() {
        print_line!("simulated times; use --real-time to measure this machine");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_units_and_are_milliseconds_without_one() {
        for (text, ns) in [
            ("300", 300_000_000),
            ("0.3", 300_000),
            ("300ms", 300_000_000),
            ("250us", 250_000),
            ("1.5s", 1_500_000_000),
            ("2min", 120_000_000_000),
        ] {
            assert_eq!(parse_time(text), Ok(ns), "{text}");
        }
        for wrong in ["", "s", "2h", "-1s", "nan", "infs", "80000min", "1 s"] {
            assert!(parse_time(wrong).is_err(), "{wrong}");
        }
        assert_eq!(milliseconds::<u16>(1..=10_000)("1.5s"), Ok(1_500));
        assert_eq!(seconds::<u64>(1..=3_600)("1min"), Ok(60));
        let message = seconds::<u64>(1..=3_600)("60").unwrap_err();
        assert_eq!(message, "expected 1 to 3600 s; a number without a unit is in milliseconds");
        assert_eq!(milliseconds::<u64>(1..=9)("0.5ms").unwrap_err(), "expected 1 to 9 ms");
    }

    #[test]
    fn pictures_are_svg_files() {
        assert_eq!(parse_svg_path("a/b.svg"), Ok(PathBuf::from("a/b.svg")));
        assert!(parse_svg_path("A.SVG").is_ok());
        for text in ["a.png", "svg", ".svg", ""] {
            let error = parse_svg_path(text).unwrap_err();
            assert!(
                error.starts_with("only SVG is written: use a name that ends in .svg"),
                "{text}"
            );
        }
    }

    #[test]
    fn bit_rates_have_factors() {
        for (text, rate) in [
            ("500000", 500_000),
            ("500k", 500_000),
            ("83.333k", 83_333),
            ("1M", 1_000_000),
            ("2.5M", 2_500_000),
            ("4294967295", u32::MAX),
        ] {
            assert_eq!(parse_bit_rate(text), Ok(rate), "{text}");
        }
        for wrong in [
            "",
            "0",
            "0k",
            "500",
            "0.5k",
            "k",
            "M",
            "5K",
            "5 k",
            "-5k",
            "+5k",
            ".5M",
            "1.M",
            "1.5",
            "0.0001k",
            "4295M",
            "500kk",
            "1e6",
            "99999999999999999999k",
            "1.00000000000000000000M",
        ] {
            let message = parse_bit_rate(wrong).unwrap_err();
            assert!(message.contains("500000, 500k, 1M"), "{wrong}: {message}");
        }
    }

    #[test]
    fn filter_is_a_level_or_names_targets() {
        for valid in ["off", "debug", "ecan_host=trace", "warn,ecan_mcan_port=debug"] {
            assert_eq!(parse_filter(valid).as_deref(), Ok(valid));
        }
        assert!(parse_filter("ecan_host=loud").unwrap_err().contains("expected a level"));
    }
}
