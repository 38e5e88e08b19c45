//! The option `--log` and the variable `RUST_LOG`: `tracing` events on standard error.

use clap::Args;
use tracing_subscriber::EnvFilter;

use crate::command_line::screen::{CleanWriter, Content, Stream};

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

#[cfg(test)]
mod tests {
    use super::parse_filter;

    #[test]
    fn filter_is_a_level_or_names_targets() {
        for valid in ["off", "debug", "ecan_host=trace", "warn,ecan_mcan_port=debug"] {
            assert_eq!(parse_filter(valid).as_deref(), Ok(valid));
        }
        assert!(parse_filter("ecan_host=loud").unwrap_err().contains("expected a level"));
    }
}
