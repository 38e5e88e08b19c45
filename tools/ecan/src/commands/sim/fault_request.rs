//! Fault on the command line: a subcommand per kind, an option per key.

use clap::error::ErrorKind;
use clap::{Arg, ArgGroup, ArgMatches, Command, Error, FromArgMatches, Subcommand};
use ecan_sim::{FaultDescription, FaultKey, FaultKind, FaultValue};
use serde_json::{Map, Value};

use crate::value::parse_unsigned;

use super::duration;

/// A `[[fault]]` that is not checked against a scenario.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FaultRequest(Map<String, Value>);

impl FaultRequest {
    pub fn new(kind: FaultKind, keys: impl IntoIterator<Item = (&'static str, Value)>) -> Self {
        let kind = ("kind", Value::from(kind.name()));
        let keys = std::iter::once(kind).chain(keys);
        Self(keys.map(|(name, value)| (name.to_owned(), value)).collect())
    }

    pub fn into_params(self) -> Value {
        Value::Object(self.0)
    }
}

/// The keys of a kind, with those of the time.
fn keys_of(kind: FaultKind) -> impl Iterator<Item = &'static FaultKey> {
    let is_own = move |name| kind.keys().contains(&name) || is_time(name);
    FaultDescription::KEYS.iter().filter(move |key| is_own(key.name))
}

fn is_time(key: &str) -> bool {
    FaultDescription::TIMES.contains(&key)
}

/// `for_ms` is `--for`, `after_op_ms` is `--after-op`.
fn option_name(key: &str) -> String {
    key.strip_suffix("_ms").unwrap_or(key).replace('_', "-")
}

fn command(kind: FaultKind) -> Command {
    let times =
        ArgGroup::new("time").args(keys_of(kind).map(|it| it.name).filter(|it| is_time(it)));
    let command = Command::new(option_name(kind.name())).about(kind.help()).group(times);
    keys_of(kind).fold(command, |command, key| command.arg(option(key)))
}

fn option(key: &FaultKey) -> Arg {
    let name = option_name(key.name);
    let arg = Arg::new(key.name).long(name.clone()).help(key.help).allow_negative_numbers(true);
    let arg = match key.value {
        _ if key.name.ends_with("_ms") => arg.value_name("TIME").value_parser(duration::parse),
        FaultValue::Number => arg.value_name("N").value_parser(parse_number),
        FaultValue::Text => arg.value_name(name.to_uppercase()).value_parser(parse_text),
        FaultValue::NumberOrText => {
            let parse = |text: &str| parse_number(text).or_else(|_| parse_text(text));
            arg.value_name(name.to_uppercase()).value_parser(parse)
        }
    };
    match is_time(key.name) {
        true => arg.help_heading("Time [default: now]"),
        false => arg.required(key.is_required()),
    }
}

fn parse_text(text: &str) -> Result<Value, String> {
    Ok(Value::from(text))
}

fn parse_number(text: &str) -> Result<Value, String> {
    let number = parse_unsigned(text).map(Value::from);
    let number = number.or_else(|| text.parse::<i64>().ok().map(Value::from));
    number.ok_or_else(|| "expected an integer, decimal or hexadecimal with 0x".to_owned())
}

impl FromArgMatches for FaultRequest {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, Error> {
        let chosen = matches.subcommand().and_then(|(name, matches)| {
            let kind = FaultKind::ALL.iter().find(|kind| option_name(kind.name()) == name)?;
            Some((*kind, matches))
        });
        let (kind, matches) = chosen.ok_or_else(|| Error::new(ErrorKind::MissingSubcommand))?;
        let given =
            |key: &'static FaultKey| Some((key.name, matches.get_one::<Value>(key.name)?.clone()));
        Ok(Self::new(kind, keys_of(kind).filter_map(given)))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl Subcommand for FaultRequest {
    fn augment_subcommands(parent: Command) -> Command {
        let parent = parent.subcommand_required(true).arg_required_else_help(true);
        parent
            .subcommand_value_name("KIND")
            .subcommands(FaultKind::ALL.iter().copied().map(command))
    }

    fn augment_subcommands_for_update(parent: Command) -> Command {
        Self::augment_subcommands(parent)
    }

    fn has_subcommand(name: &str) -> bool {
        FaultKind::ALL.iter().any(|kind| option_name(kind.name()) == name)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn parse(arguments: &[&str]) -> Result<Value, String> {
        let parent = FaultRequest::augment_subcommands(Command::new("fault").no_binary_name(true));
        let matches = parent.try_get_matches_from(arguments).map_err(|error| error.to_string())?;
        Ok(FaultRequest::from_arg_matches(&matches).unwrap().into_params())
    }

    #[test]
    fn options_become_keys_of_the_fault() {
        let cases: [(&[&str], Value); 6] = [
            (&["link-loss", "--for", "300ms"], json!({ "kind": "link_loss", "for_ms": 300 })),
            (
                &["power-cycle", "--gateway", "1", "--off", "2s", "--after", "1min"],
                json!({ "kind": "power_cycle", "gateway": 1, "off_ms": 2000, "after_ms": 60000 }),
            ),
            (
                &["sdo-abort", "--index", "0x8010", "--code", "0x06090030"],
                json!({ "kind": "sdo_abort", "index": 0x8010, "code": 0x0609_0030 }),
            ),
            (&["clock-jump", "--ns", "-100"], json!({ "kind": "clock_jump", "ns": -100 })),
            (
                &["library-error", "--call", "send", "--errno", "EINTR", "--cycle", "7"],
                json!({ "kind": "library_error", "call": "send", "errno": "EINTR", "cycle": 7 }),
            ),
            (
                &["drive-blocked", "--node", "5", "--for", "1s"],
                json!({ "kind": "drive_blocked", "node": "5", "for_ms": 1000 }),
            ),
        ];
        for (arguments, params) in cases {
            assert_eq!(parse(arguments).as_ref(), Ok(&params), "{arguments:?}");
            serde_json::from_value::<FaultDescription>(params).unwrap();
        }
    }

    #[test]
    fn wrong_options_are_rejected() {
        let cases: [(&[&str], &str); 5] = [
            (&["link-loss"], "--for <TIME>"),
            (&["link-loss", "--for", "300"], "expected a time with its unit"),
            (&["power-off", "--for", "1s"], "unexpected argument '--for'"),
            (&["bus-off", "--channel", "one"], "expected an integer"),
            (&["crc-error", "--at", "1s", "--after", "1s"], "cannot be used with"),
        ];
        for (arguments, words) in cases {
            let message = parse(arguments).unwrap_err();
            assert!(message.contains(words), "{arguments:?}: {message}");
        }
        assert!(parse(&["meteor"]).unwrap_err().contains("unrecognized subcommand"));
    }

    #[test]
    fn every_kind_has_a_valid_command() {
        for kind in FaultKind::ALL {
            command(*kind).debug_assert();
            assert!(FaultRequest::has_subcommand(&option_name(kind.name())));
        }
    }
}
