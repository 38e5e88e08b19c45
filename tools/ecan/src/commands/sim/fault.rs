//! Faults of a simulation: a subcommand per kind with an option per key, their report, and the state of the
//! machine.

use std::io;
use std::io::Write;

use clap::error::ErrorKind;
use clap::{Arg, ArgGroup, ArgMatches, Command, Error, FromArgMatches, Subcommand};
use ecan_protocol::device::AlStatusCode;
use ecan_sim::{
    FaultDescription, FaultEffect, FaultKey, FaultKind, FaultRecord, FaultValue, Gateway,
    ScriptedFault, Simulation, When, World,
};
use ecan_tool_support::command_line::options::{ANY_TIME, milliseconds};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::output;
use crate::value::parse_unsigned;

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
        ArgGroup::new("time").args(keys_of(kind).map(|key| key.name).filter(|name| is_time(name)));
    let command = Command::new(option_name(kind.name())).about(kind.help()).group(times);
    keys_of(kind).fold(command, |command, key| command.arg(option(key)))
}

fn option(key: &FaultKey) -> Arg {
    let name = option_name(key.name);
    let arg = Arg::new(key.name).long(name.clone()).help(key.help).allow_negative_numbers(true);
    let arg = match key.value {
        _ if key.name.ends_with("_ms") => arg.value_name("TIME").value_parser(parse_time),
        FaultValue::Number => arg.value_name("N").value_parser(parse_number),
        FaultValue::Text => arg.value_name(name.to_uppercase()).value_parser(parse_text),
        FaultValue::NumberOrText => {
            let parse_value = |text: &str| parse_number(text).or_else(|_| parse_text(text));
            arg.value_name(name.to_uppercase()).value_parser(parse_value)
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

/// Parses a time as a number of milliseconds.
pub fn parse_time(text: &str) -> Result<Value, String> {
    milliseconds::<u64>(ANY_TIME)(text).map(Value::from)
}

/// What has become of a fault, or will.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultState {
    Injected,
    Pending,
    NoEffect,
}

/// A fault with its time.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FaultReport {
    pub state: FaultState,
    /// Time since the start of the simulation, in ns.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub time_ns: Option<u64>,
    /// Number of sends with process data.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub cycle: Option<u64>,
    /// Time after all gateways are in OP for the first time, in ns.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub after_op_ns: Option<u64>,
    /// Time after the program has all gateways ready for the first time, in ns.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub after_ready_ns: Option<u64>,
    /// The fault.
    pub fault: String,
    /// The fault with its time, as a line for users.
    pub text: String,
}

impl FaultReport {
    fn new(state: FaultState, fault: String, text: String) -> Self {
        Self {
            state,
            time_ns: None,
            cycle: None,
            after_op_ns: None,
            after_ready_ns: None,
            fault,
            text,
        }
    }

    pub fn print(&self, out: &mut dyn Write) -> io::Result<()> {
        writeln!(out, "{}", self.text)
    }
}

impl From<&FaultRecord> for FaultReport {
    fn from(record: &FaultRecord) -> Self {
        let (time_ns, cycle) = (Some(record.time_ns), Some(record.cycle));
        let new = Self::new(FaultState::Injected, record.fault.to_string(), record.to_string());
        Self { time_ns, cycle, ..new }
    }
}

impl From<&ScriptedFault> for FaultReport {
    fn from(scripted: &ScriptedFault) -> Self {
        let text = format!("pending {scripted}");
        let new = Self::new(FaultState::Pending, scripted.fault.to_string(), text);
        match scripted.when {
            When::At(ns) => Self { time_ns: Some(ns), ..new },
            When::Cycle(cycle) => Self { cycle: Some(cycle), ..new },
            When::AfterOp(ns) => Self { after_op_ns: Some(ns), ..new },
            When::AfterReady(ns) => Self { after_ready_ns: Some(ns), ..new },
        }
    }
}

impl From<&FaultEffect> for FaultReport {
    fn from(effect: &FaultEffect) -> Self {
        match effect {
            FaultEffect::Injected(record) => record.into(),
            FaultEffect::Scheduled(scripted) => scripted.into(),
            FaultEffect::Nothing(fault) => {
                Self::new(FaultState::NoEffect, fault.to_string(), effect.to_string())
            }
        }
    }
}

/// The last faults that took effect, oldest first, and the pending ones.
#[derive(Debug, Serialize, Deserialize)]
pub struct FaultList {
    pub injected: Vec<FaultReport>,
    pub pending: Vec<FaultReport>,
}

impl FaultList {
    pub fn of(simulation: &Simulation) -> Self {
        // Copied only: the cycle waits for the world.
        let (injected, pending): (Vec<_>, Vec<_>) = simulation.with_world(|world| {
            (world.faults().cloned().collect(), world.pending_faults().collect())
        });
        let injected = injected.iter().map(FaultReport::from).collect();
        Self { injected, pending: pending.iter().map(FaultReport::from).collect() }
    }

    pub fn print(&self, out: &mut dyn Write) -> io::Result<()> {
        if self.injected.is_empty() && self.pending.is_empty() {
            return writeln!(out, "no faults");
        }
        let mut all = self.injected.iter().chain(&self.pending);
        all.try_for_each(|fault| fault.print(out))
    }
}

#[derive(Debug, Serialize, Deserialize)]
pub struct SimulationStatus {
    pub scenario: String,
    pub seed: u64,
    /// Time since the start of the simulation, in ns.
    pub time_ns: u64,
    /// Number of sends with process data.
    pub cycle: u64,
    /// Time at which all gateways were in OP for the first time, in ns.
    pub op_ns: Option<u64>,
    /// Time at which the program had all gateways ready for the first time, in ns.
    pub ready_ns: Option<u64>,
    pub gateways: Vec<GatewayStatus>,
    pub nodes: Vec<NodeStatus>,
}

#[derive(Debug, Serialize, Deserialize)]
pub struct GatewayStatus {
    /// Index in the scenario.
    pub gateway: usize,
    /// Position on the line; that on the bus if all slaves before it respond.
    pub position: Option<usize>,
    pub is_powered: bool,
    /// False while it boots.
    pub is_running: bool,
    pub is_cable_open: bool,
    /// Returns whether frames of the master reach it and return.
    pub is_reachable: bool,
    /// `None` unless it runs.
    pub al_state: Option<String>,
    /// AL status code; `None` without an error.
    pub al_error: Option<u16>,
}

#[derive(Debug, Serialize, Deserialize)]
pub struct NodeStatus {
    pub name: String,
    pub kind: String,
    pub bus: String,
}

impl SimulationStatus {
    pub fn of(simulation: &Simulation) -> Self {
        let scenario = simulation.scenario();
        let nodes = scenario.nodes.iter().map(|node| NodeStatus {
            name: node.name.clone(),
            kind: node.kind.name().to_owned(),
            bus: node.bus.clone(),
        });
        let nodes = nodes.collect();
        simulation.with_world(|world| Self {
            scenario: scenario.name.clone(),
            seed: scenario.seed,
            time_ns: world.now_ns().saturating_sub(world.start_ns()),
            cycle: world.cycles(),
            op_ns: world.op_ns(),
            ready_ns: world.ready_ns(),
            gateways: (0..world.gateway_count())
                .filter_map(|index| Some(GatewayStatus::of(world, index, world.gateway(index)?)))
                .collect(),
            nodes,
        })
    }

    pub fn print(&self, out: &mut dyn Write) -> io::Result<()> {
        let Self { scenario, seed, time_ns, cycle, op_ns, ready_ns, gateways, nodes } = self;
        let seconds = |ns: u64| ns as f64 / 1e9;
        let at = |ns: &Option<u64>| {
            ns.map_or("not yet".to_owned(), |ns| format!("at {:.3} s", seconds(ns)))
        };
        let op = format!("all gateways in OP {}, ready {}", at(op_ns), at(ready_ns));
        let time = seconds(*time_ns);
        writeln!(out, "scenario {scenario}, seed {seed}: {time:.3} s, {cycle} cycles, {op}")?;
        let titles = ["GATEWAY", "POS", "SUPPLY", "CABLE", "REACHED", "STATE"];
        output::print_with_titles(out, titles, gateways, |gateway| {
            [
                gateway.gateway.to_string(),
                output::or_dash(gateway.position),
                if gateway.is_powered { "on" } else { "off" }.to_owned(),
                if gateway.is_cable_open { "open" } else { "closed" }.to_owned(),
                if gateway.is_reachable { "yes" } else { "no" }.to_owned(),
                gateway.state(),
            ]
        })?;
        if nodes.is_empty() {
            return Ok(());
        }
        writeln!(out)?;
        output::print_with_titles(out, ["NODE", "KIND", "BUS"], nodes, |node| {
            [node.name.clone(), node.kind.clone(), node.bus.clone()]
        })
    }
}

impl GatewayStatus {
    fn of(world: &World, index: usize, gateway: &Gateway) -> Self {
        let is_running = gateway.is_responding();
        Self {
            gateway: index,
            position: world.position_of(index),
            is_powered: gateway.is_powered(),
            is_running,
            is_cable_open: world.is_cable_open(index),
            is_reachable: world.is_reachable(index),
            al_state: is_running.then(|| gateway.al_state().to_string()),
            al_error: gateway.al_error().then(|| gateway.al_status_code()),
        }
    }

    /// Returns whether the master has identified it, and has brought it to OP if a cycle runs.
    pub fn is_started(&self, has_cycle: bool) -> bool {
        let is_in_state = match self.al_state.as_deref() {
            Some("OP") => true,
            Some("PREOP" | "SAFEOP") => !has_cycle,
            _ => false,
        };
        is_in_state && self.is_reachable && self.al_error.is_none()
    }

    pub fn state(&self) -> String {
        let state = match &self.al_state {
            Some(state) => state.as_str(),
            None if self.is_powered => "booting",
            None => "-",
        };
        match self.al_error {
            Some(code) => format!("{state}, AL status code {}", AlStatusCode(code)),
            None => state.to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn parse_command(arguments: &[&str]) -> Result<Value, String> {
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
            assert_eq!(parse_command(arguments).as_ref(), Ok(&params), "{arguments:?}");
            serde_json::from_value::<FaultDescription>(params).unwrap();
        }
    }

    #[test]
    fn wrong_options_are_rejected() {
        let cases: [(&[&str], &str); 5] = [
            (&["link-loss"], "--for <TIME>"),
            (&["link-loss", "--for", "2h"], "expected a time, such as 300ms"),
            (&["power-off", "--for", "1s"], "unexpected argument '--for'"),
            (&["bus-off", "--channel", "one"], "expected an integer"),
            (&["crc-error", "--at", "1s", "--after", "1s"], "cannot be used with"),
        ];
        for (arguments, words) in cases {
            let message = parse_command(arguments).unwrap_err();
            assert!(message.contains(words), "{arguments:?}: {message}");
        }
        assert!(parse_command(&["meteor"]).unwrap_err().contains("unrecognized subcommand"));
    }

    #[test]
    fn every_kind_has_a_valid_command() {
        for kind in FaultKind::ALL {
            command(*kind).debug_assert();
            assert!(FaultRequest::has_subcommand(&option_name(kind.name())));
        }
    }

    #[test]
    fn help_lists_every_kind_with_its_keys() {
        // Without the breaks of lines.
        let help = |mut command: Command| {
            let text = command.render_help().to_string();
            text.split_whitespace().collect::<Vec<_>>().join(" ")
        };
        let kinds = help(FaultRequest::augment_subcommands(Command::new("fault")));
        for kind in FaultKind::ALL {
            let row = format!("{} {}", option_name(kind.name()), kind.help());
            assert!(kinds.contains(&row), "{row}: {kinds}");
            let keys = help(command(*kind));
            for key in keys_of(*kind) {
                let option = format!("--{} <", option_name(key.name));
                assert!(keys.contains(&option) && keys.contains(key.help), "{option}: {keys}");
            }
        }
    }

    #[test]
    fn times_are_whole_milliseconds() {
        for (text, ms) in
            [("300", 300), ("300ms", 300), ("1.1s", 1100), ("2min", 120_000), ("0s", 0)]
        {
            assert_eq!(parse_time(text), Ok(Value::from(ms)), "{text}");
        }
        for wrong in ["ms", "0.5ms", "-1s", "2h", "nans", "80000min", ""] {
            assert!(parse_time(wrong).is_err(), "{wrong}");
        }
    }
}
