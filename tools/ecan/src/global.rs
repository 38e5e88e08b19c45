//! Options of every command, and which of them a service permits.

use std::path::PathBuf;
use std::str::FromStr;

use clap::parser::ValueSource;
use clap::{ArgMatches, Args, Command, ValueEnum};
#[cfg(feature = "zenoh")]
use ecan_service_zenoh::Keys;
use ecan_tool_support::command_line::options::LogArguments;

use crate::failure::{Failure, Result};
use crate::slave_choice::SlaveChoice;

pub const EXIT_STATUS: &str = "\
Exit status:
  0  success, no problems found
  1  problems found (difference, fault), not all frames sent, not confirmed, stopped
  2  invalid arguments
  3  no EtherCAT master: library, module, permission or link is missing
  4  no slave, no such slave, or several slaves and none selected
  5  slave or node rejected a request or did not respond
  6  file or scenario cannot be read, written or parsed
  7  host denied a resource: real time (--rt-required), thread, socket, address or interface

Without hardware: ecan --ecrt sim scan";

/// When to use colours.
// Not doc comments on the values: they would double the length of every help.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Color {
    #[default]
    Auto,
    Always,
    Never,
}

/// Options of every command.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Bus and output")]
pub struct GlobalOptions {
    /// EtherCAT library: a path, or sim, sim:echo, sim:drives, sim:FILE.toml (simulated)
    /// [default: ECAN_ECRT, or libethercat.so.1]
    #[arg(long, global = true, value_name = "LIBRARY")]
    pub ecrt: Option<String>,
    /// Way to the bus: auto, direct (library), the socket of a service (ecan serve), or
    /// zenoh:PREFIX (ecan zenoh of another host)
    #[arg(long, global = true, value_name = "WAY", default_value = "auto")]
    pub via: Via,
    /// Index of the EtherCAT master [default: from the configuration file, or 0]
    #[arg(long, global = true, value_name = "N")]
    pub master: Option<u32>,
    /// Slave: position, alias=N or serial=N [default: the only gateway]
    #[arg(long, global = true, value_name = "SLAVE")]
    pub slave: Option<SlaveChoice>,
    /// Print JSON
    #[arg(long, global = true)]
    pub json: bool,
    /// Use colours; auto: on a terminal unless NO_COLOR is set
    #[arg(long, global = true, value_enum, default_value_t = Color::Auto, value_name = "WHEN")]
    pub color: Color,
    #[command(flatten)]
    pub log: LogArguments,
    /// Options of the command, to reject those without effect.
    #[arg(skip)]
    pub given: GivenOptions,
}

impl GlobalOptions {
    /// Rejects `--slave` for a command that does not use it. (clap does not check an option before the
    /// command against those after it.)
    pub fn without_slave(&self, reason: &str) -> Result {
        match self.slave {
            None => Ok(()),
            Some(_) => {
                Err(Failure::Usage(format!("--slave is not used by this command: {reason}")))
            }
        }
    }

    /// Rejects a service for a command that does not use it.
    pub fn without_service(&self, reason: &str) -> Result {
        match self.via.is_service() {
            false => Ok(()),
            true => Err(Failure::Usage(format!("this command does not use a service: {reason}"))),
        }
    }

    /// The master of a command without a configuration file.
    pub fn master(&self) -> u32 {
        self.master.unwrap_or(0)
    }
}

/// Argument of `--via`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Via {
    /// A service that responds at a default path, otherwise the library.
    #[default]
    Auto,
    Direct,
    Service(PathBuf),
    /// A service of another host, by the prefix of its keys.
    #[cfg(feature = "zenoh")]
    Remote(Keys),
}

impl Via {
    pub fn is_service(&self) -> bool {
        !matches!(self, Self::Auto | Self::Direct)
    }
}

impl FromStr for Via {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match (text, text.strip_prefix("zenoh:")) {
            ("auto", _) => Ok(Self::Auto),
            ("direct", _) => Ok(Self::Direct),
            #[cfg(feature = "zenoh")]
            (_, Some(prefix)) => match Keys::new(prefix) {
                Ok(keys) => Ok(Self::Remote(keys)),
                Err(error) => Err(error.to_string()),
            },
            #[cfg(not(feature = "zenoh"))]
            (_, Some(_)) => {
                Err("this program has no Zenoh; build it with --features zenoh".to_owned())
            }
            (path, None) => Ok(Self::Service(path.into())),
        }
    }
}

/// Options that have no effect with a service, by the reason. The service runs the cycle and has
/// configured the gateways.
const UNUSED: [(&str, &[&str]); 3] = [
    (
        "the program of the service has its own real-time settings",
        &["rt-priority", "cpu", "lock-memory", "rt-required", "cpu-latency-us", "spin-us"],
    ),
    (
        "the service has configured the gateways and the cycle",
        &["sample-point", "data-sample-point", "pdo-n", "large-pdos", "cycle-us"],
    ),
    ("a test through a service changes no configuration", &["selftest --restart"]),
];

/// Options of the command line, in their order of declaration, without those of every command.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GivenOptions {
    /// Names of the command and its subcommands, for example "node sdo read".
    command: String,
    names: Vec<String>,
}

impl GivenOptions {
    /// Reads which options come from the command line and not from a default.
    pub fn of(command: &Command, matches: &ArgMatches) -> Self {
        let (mut command, mut matches) = (command, matches);
        let mut given = Self::default();
        while let Some((name, inner)) = matches.subcommand() {
            let Some(found) = command.find_subcommand(name) else { break };
            let separator = if given.command.is_empty() { "" } else { " " };
            given.command = format!("{}{separator}{name}", given.command);
            let is_given = |id: &str| inner.value_source(id) == Some(ValueSource::CommandLine);
            let arguments = found.get_arguments().filter(|argument| !argument.is_global_set());
            let arguments = arguments.filter(|argument| is_given(argument.get_id().as_str()));
            given
                .names
                .extend(arguments.filter_map(|argument| argument.get_long().map(str::to_owned)));
            (command, matches) = (found, inner);
        }
        given
    }

    /// Rejects options that have no effect with a service; `program` is that of the service.
    pub fn check_with_service(&self, program: &str) -> Result {
        for (reason, _) in UNUSED {
            let unused = |name: &&String| unused_reason(&self.command, name) == Some(reason);
            let names: Vec<_> =
                self.names.iter().filter(unused).map(|name| format!("--{name}")).collect();
            if !names.is_empty() {
                return Err(Failure::Usage(format!(
                    "{} has no effect with a service, here {program}: {reason}; remove it, or use \
                     --via direct",
                    names.join(", ")
                )));
            }
        }
        Ok(())
    }
}

/// Reason why an option of a command has no effect with a service; `None` if it has.
fn unused_reason(command: &str, name: &str) -> Option<&'static str> {
    let of_command = format!("{command} --{name}");
    let is_listed =
        |names: &[&str]| names.iter().any(|listed| *listed == name || *listed == of_command);
    UNUSED.iter().find(|(_, names)| is_listed(names)).map(|(reason, _)| *reason)
}

/// Folds the options of every command into one line.
pub fn fold_global_options(command: Command) -> Command {
    let mut folded = Vec::new();
    let command = command.after_help("").mut_args(|arg| {
        if !arg.is_global_set() {
            return arg;
        }
        folded.extend(arg.get_long().map(|name| format!("--{name}")));
        arg.hide(true)
    });
    let line = format!("Bus, output, exit status: see --help ({})", folded.join(", "));
    with_line(command, &line)
}

fn with_line(command: Command, line: &str) -> Command {
    let text = match command.get_after_help().map(ToString::to_string) {
        Some(text) if !text.is_empty() => format!("{text}\n\n{line}"),
        _ => line.to_owned(),
    };
    command.after_help(text).mut_subcommands(|command| with_line(command, line))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Options that a command uses with a service, rejects itself, or uses without any bus. A new
    /// option is listed here or in `UNUSED`.
    const USED: &[&str] = &[
        "acceleration",
        "accept-risk",
        "activate",
        "active",
        "address",
        "all",
        "amplitude",
        "any-firmware",
        "application",
        "ascii",
        "axis",
        "beacon",
        "bitrate",
        "bitrates",
        "brief",
        "brs",
        "buffer",
        "by",
        "bytes",
        "capture",
        "channel",
        "channels",
        "clear",
        "config",
        "control-group",
        "count",
        "data",
        "data-bitrate",
        "dbc",
        "device-time",
        "eds",
        "ethercat",
        "ethtool",
        "expect-version",
        "extended",
        "extra",
        "fd",
        "for",
        "force",
        "format",
        "frames",
        "from",
        "gap",
        "gateway",
        "gateways",
        "group",
        "hold-key",
        "id",
        "idle",
        "images",
        "key-timeout",
        "lang",
        "length",
        "listen",
        "listen-only",
        "log-format",
        "loop",
        "mask",
        "max-clients",
        "max-velocity",
        "method",
        "metrics",
        "metrics-objects",
        "metrics-remote",
        "mix",
        "mode",
        "names",
        "nanoseconds",
        "no-apply",
        "node",
        "observe",
        "node-axis",
        "nodes",
        "notes",
        "off",
        "offset",
        "once",
        "only",
        "plot",
        "points",
        "product",
        "pty",
        "range",
        "read-only",
        "record",
        "remote",
        "replay",
        "report",
        "reset-fault",
        "revision",
        "root",
        "save",
        "scan-time",
        "screen",
        "sdk",
        "seed",
        "serial",
        "settle",
        "slaves",
        "slcan",
        "socket",
        "socketcan",
        "socketcand",
        "sort",
        "speed",
        "standard",
        "step",
        "steps",
        "steps-per-turn",
        "store",
        "sweep",
        "switch-speed",
        "sync",
        "time",
        "time-stamps",
        "timeout",
        "to",
        "tolerance",
        "type",
        "unattended",
        "unit",
        "unmasked",
        "velocity",
        "velocity-units",
        "vendor",
        "verbose",
        "view",
        "wait",
        "watch",
        "wired",
        "write-profile",
        "yes",
        "zero-speed",
    ];

    /// Calls `visit` with the names of each command and its options.
    fn walk(command: &Command, path: &str, visit: &mut dyn FnMut(&str, &str)) {
        for argument in command.get_arguments().filter(|argument| !argument.is_global_set()) {
            argument.get_long().into_iter().for_each(|name| visit(path, name));
        }
        for inner in command.get_subcommands() {
            let separator = if path.is_empty() { "" } else { " " };
            walk(inner, &format!("{path}{separator}{}", inner.get_name()), visit);
        }
    }

    #[test]
    fn every_option_is_used_with_a_service_or_rejected() {
        let (mut seen, mut count) = (std::collections::BTreeSet::new(), 0);
        walk(&crate::command(), "", &mut |command, name| {
            if command == "zenoh" {
                // The command is in some builds only, and needs a service.
                return;
            }
            // The options of a fault are parameters of the service.
            let is_used = USED.contains(&name) || command.starts_with("sim fault ");
            let rejected = unused_reason(command, name);
            let of_command = format!("{command} --{name}");
            let is_special = UNUSED.iter().any(|(_, names)| names.contains(&of_command.as_str()));
            assert!(
                is_used != rejected.is_some() || is_special,
                "{of_command}: decide whether it has an effect with a service"
            );
            seen.extend([name.to_owned(), of_command]);
            count += usize::from(rejected.is_some());
        });
        assert!(count > 100, "{count}");
        let listed = UNUSED.iter().flat_map(|(_, names)| names.iter()).chain(USED);
        for name in listed {
            assert!(seen.contains(*name), "{name} is no option");
        }
    }

    #[test]
    fn given_options_are_those_of_the_command_line() {
        let mut command = crate::command();
        let line = ["ecan", "--slave", "0", "node", "sdo", "read", "--cpu", "1", "0x1000"];
        let line = line.into_iter().chain(["--node", "1", "--pdo-n", "3", "--rt-required"]);
        let matches = command.try_get_matches_from_mut(line).unwrap();
        let given = GivenOptions::of(&command, &matches);
        assert_eq!(given.command, "node sdo read");
        assert!(given.names.iter().all(|name| !["cycle-us", "slave"].contains(&name.as_str())));
        let message = given.check_with_service("cell 1.0 (pid 7)").unwrap_err().to_string();
        assert!(
            message.contains("--cpu, --rt-required has no effect with a service, here cell 1.0")
                && message.contains("--via direct"),
            "{message}"
        );
        assert!(GivenOptions::default().check_with_service("x").is_ok());
    }

    #[test]
    fn way_is_parsed_from_text() {
        let parse = |text: &str| text.parse::<Via>().unwrap();
        assert_eq!((parse("auto"), parse("direct")), (Via::Auto, Via::Direct));
        assert_eq!(parse("/run/x.sock"), Via::Service("/run/x.sock".into()));
    }
}
