//! Hints for wrong command lines: the command line that was probably meant, if the program accepts it.

use std::ffi::OsString;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Arg, Command};
use ecan_can_io::candump::parse_frame;
use ecan_tool_support::command_line::run_info::quoted;

use crate::frames::parse_channel;

/// Names that other tools have for a command, by the words of this program.
const OTHER_NAMES: [(&str, &[&str]); 26] = [
    ("slaves", &["scan"]),
    ("list", &["scan"]),
    ("rescan", &["scan"]),
    ("states", &["scan"]),
    ("state", &["info"]),
    ("status", &["info"]),
    ("version", &["--version"]),
    ("upload", &["sdo", "read"]),
    ("download", &["sdo", "write"]),
    ("sdo_upload", &["sdo", "read"]),
    ("sdo_download", &["sdo", "write"]),
    ("sdos", &["sdo", "list"]),
    ("read", &["sdo", "read"]),
    ("write", &["sdo", "write"]),
    ("get", &["read"]),
    ("set", &["write"]),
    ("upload", &["read"]),
    ("download", &["write"]),
    ("foe_write", &["firmware", "update"]),
    ("reg_read", &["reg", "read"]),
    ("reg_write", &["reg", "write"]),
    ("candump", &["dump"]),
    ("cansend", &["send"]),
    ("cangen", &["gen"]),
    ("canplayer", &["replay"]),
    ("emcy", &["node", "emcy"]),
];

/// Options of other tools; `{}` is the value.
const OTHER_OPTIONS: [(&str, &str, &str); 18] = [
    ("-c", "--color always", "the colour is an option"),
    ("-p", "--slave {}", "the slave is an option"),
    ("--position", "--slave {}", "the slave is an option"),
    ("-a", "--slave alias={}", "the slave is an option"),
    ("--alias", "--slave alias={}", "the slave is an option"),
    ("-m", "--master {}", "the master is an option"),
    ("-i", "--channel {}", "the channel is an option"),
    ("--interface", "--channel {}", "the channel is an option"),
    ("--bus", "--channel {}", "the channel is an option"),
    ("--can", "--channel {}", "the channel is an option"),
    ("--sim", "--ecrt sim", "the simulator is an option"),
    ("--simulator", "--ecrt sim", "the simulator is an option"),
    ("--simulated", "--ecrt sim", "the simulator is an option"),
    ("--simulate", "--ecrt sim", "the simulator is an option"),
    ("-v", "--log debug", "the log is an option"),
    ("--verbose", "--log debug", "the log is an option"),
    ("--debug", "--log debug", "the log is an option"),
    ("--node-id", "--node {}", "the node is an option"),
];

/// Options for an argument without a name, in the order in which they are tried, and their arguments.
const SELECTIONS: [(&str, &str); 6] = [
    ("node", "the node is an option"),
    ("axis", "the axis is an option"),
    ("channel", "the channel is an option"),
    ("gateway", "the gateway is an option"),
    ("slave", "the slave is an option"),
    ("master", "the master is an option"),
];

/// Options of files, by the ends of their names.
const FILES: [(&str, &str); 4] =
    [(".toml", "config"), (".dbc", "dbc"), (".eds", "eds"), (".dcf", "eds")];

/// Commands about all slaves of a master.
const OF_MASTER: [&str; 3] = ["scan", "serve", "doctor"];

/// Most mistakes of a command line that are corrected.
const MOST_MISTAKES: usize = 3;

/// Adds to an error of clap the command line that was probably meant.
pub fn with_hint(mut error: clap::Error, root: &Command, arguments: &[OsString]) -> clap::Error {
    let words = arguments.iter().skip(1).map(|word| word.to_str().map(str::to_owned));
    let Some(words) = words.collect::<Option<Vec<_>>>().filter(|_| error.use_stderr()) else {
        return error;
    };
    let mut root = root.clone();
    // Global options become those of each command.
    root.build();
    // No value of this program begins with a hyphen, except numbers.
    error.remove(ContextKind::Suggested);
    if let Some(hint) = correct(&root, &words, &error, MOST_MISTAKES) {
        for kind in [ContextKind::SuggestedSubcommand, ContextKind::SuggestedArg] {
            error.remove(kind);
        }
        let text = hint.to_string();
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![text.into()]));
    }
    error
}

/// A corrected command line, or a part of one.
#[derive(Clone, Debug)]
struct Hint {
    rule: &'static str,
    /// The corrected words.
    part: String,
    line: Vec<String>,
    /// The program accepts the line.
    is_accepted: bool,
}

impl std::fmt::Display for Hint {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { rule, part, line, is_accepted } = self;
        if !is_accepted {
            return write!(f, "{rule}: '{part}'");
        }
        write!(f, "{rule}: `ecan")?;
        line.iter().try_for_each(|word| write!(f, " {}", quoted(word)))?;
        write!(f, "`")
    }
}

/// The first correction that leads to an accepted line, or to one with another error.
fn correct(root: &Command, words: &[String], fault: &clap::Error, most: usize) -> Option<Hint> {
    let mut partial = None;
    let hints = Line::new(root, words).corrections(fault);
    for hint in hints.into_iter().filter(|hint| hint.line != words) {
        let program = std::iter::once("ecan").chain(hint.line.iter().map(String::as_str));
        let parsed = root.clone().try_get_matches_from(program);
        // Help and version are accepted, too.
        let Some(error) = parsed.err().filter(clap::Error::use_stderr) else {
            return Some(Hint { is_accepted: true, ..hint });
        };
        if most > 1
            && let Some(Hint { line, is_accepted: true, .. }) =
                correct(root, &hint.line, &error, most - 1)
        {
            return Some(Hint { line, is_accepted: true, ..hint });
        }
        let missing = ErrorKind::MissingRequiredArgument;
        if partial.is_none() && error.kind() == missing && fault.kind() != missing {
            partial = Some(hint);
        }
    }
    partial
}

/// Meaning of a word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Meaning {
    Command,
    Option,
    UnknownOption,
    Value,
    Positional,
}

/// A command line by its words.
struct Line<'a> {
    root: &'a Command,
    /// The innermost command.
    command: &'a Command,
    words: &'a [String],
    meanings: Vec<Meaning>,
}

impl<'a> Line<'a> {
    fn new(root: &'a Command, words: &'a [String]) -> Self {
        let mut line = Self { root, command: root, words, meanings: Vec::new() };
        let (mut values, mut is_end) = (0, false);
        for word in words {
            let is_option = word.starts_with('-')
                && word.len() > 1
                && !word[1..].starts_with(|c: char| c.is_ascii_digit());
            let meaning = if is_end {
                Meaning::Positional
            } else if is_option {
                is_end = word == "--";
                let option = line.option(word);
                values = option.map_or(0, |option| value_count(option, word));
                if option.is_some() || is_end { Meaning::Option } else { Meaning::UnknownOption }
            } else if values > 0 {
                values -= 1;
                Meaning::Value
            } else if let Some(inner) = line.command.find_subcommand(word)
                && !line.meanings.contains(&Meaning::Positional)
            {
                line.command = inner;
                Meaning::Command
            } else {
                Meaning::Positional
            };
            line.meanings.push(meaning);
        }
        line
    }

    /// The option of the command with the name of the word.
    fn option(&self, word: &str) -> Option<&'a Arg> {
        let name = word.split('=').next().unwrap_or(word);
        let short = name.chars().nth(1);
        self.command.get_arguments().find(|argument| match name.strip_prefix("--") {
            Some(name) => argument.get_long() == Some(name),
            None => argument.get_short().is_some() && argument.get_short() == short,
        })
    }

    fn is_command(&self, name: &str) -> bool {
        self.command.find_subcommand(name).is_some()
    }

    fn has_option(&self, name: &str) -> bool {
        self.command.get_arguments().any(|argument| argument.get_long() == Some(name))
    }

    fn has_positional(&self, name: &str) -> bool {
        self.command.get_positionals().any(|argument| argument.get_id() == name)
    }

    fn is_given(&self, name: &str) -> bool {
        self.words.iter().any(|word| {
            let word = word.strip_prefix("--").unwrap_or_default();
            word.split('=').next() == Some(name)
        })
    }

    fn of(&self, meaning: Meaning) -> impl Iterator<Item = (usize, &'a str)> {
        let words = self.words.iter().zip(&self.meanings).enumerate();
        let words = words.filter(move |(_, (_, found))| **found == meaning);
        words.map(|(at, (word, _))| (at, word.as_str()))
    }

    /// The line with other words in place of `count` words.
    fn replaced<W: AsRef<str>>(
        &self,
        rule: &'static str,
        at: usize,
        count: usize,
        with: impl IntoIterator<Item = W>,
    ) -> Hint {
        let with: Vec<_> = with.into_iter().map(|word| word.as_ref().to_owned()).collect();
        let part = with.join(" ");
        let mut line = self.words.to_vec();
        line.splice(at..(at + count).min(line.len()), with);
        Hint { rule, part, line, is_accepted: false }
    }

    /// The line with a word moved to its end, as the value of an option.
    fn moved(&self, rule: &'static str, at: usize, name: &str, value: &str) -> Hint {
        let mut line = self.words.to_vec();
        line.remove(at);
        let option = [format!("--{name}"), value.to_owned()];
        let part = option.join(" ");
        line.extend(option);
        Hint { rule, part, line, is_accepted: false }
    }

    fn corrections(&self, error: &clap::Error) -> Vec<Hint> {
        let mut hints = Vec::new();
        self.correct_options(error, &mut hints);
        match error.kind() {
            _ if self.command.has_subcommands() => self.correct_command(error, &mut hints),
            ErrorKind::MissingRequiredArgument => {
                self.correct_selection(&mut hints);
                self.add_example(&mut hints);
            }
            _ => {
                self.correct_channels(&mut hints);
                self.correct_object(&mut hints);
                self.correct_frame(&mut hints);
                self.correct_filter(&mut hints);
                self.correct_selection(&mut hints);
                self.correct_value(&mut hints);
            }
        }
        hints
    }

    fn correct_options(&self, error: &clap::Error, hints: &mut Vec<Hint>) {
        for (at, word) in self.of(Meaning::UnknownOption) {
            let (name, attached) = match word.split_once('=') {
                Some((name, value)) => (name, Some(value)),
                None => (word, None),
            };
            let following = self.words.get(at + 1).map(String::as_str);
            let value = attached.or(following).unwrap_or_default();
            let count = if attached.is_some() { 1 } else { 2 };
            for (_, option, rule) in OTHER_OPTIONS.iter().filter(|(other, ..)| *other == name) {
                let count = if option.contains("{}") { count } else { 1 };
                let option = option.replace("{}", value);
                hints.push(self.replaced(rule, at, count, option.split(' ')));
            }
            let long = name.trim_start_matches('-');
            let inner = self.of(Meaning::Command).next().map(|(at, _)| at);
            if let (true, Some(first)) = (["node", "channel"].contains(&long), inner) {
                hints.push(self.replaced("a node has a command of its own", first, 0, ["node"]));
            }
            if let Some(ContextValue::String(similar)) = error.get(ContextKind::SuggestedArg) {
                let similar = word.replacen(name, similar, 1);
                hints.push(self.replaced("a similar option exists", at, 1, [similar]));
            }
            hints.push(self.replaced("this argument has no name", at, count, [value]));
        }
        for (at, word) in self.of(Meaning::Option) {
            let value =
                self.words.get(at + 1).filter(|value| *value == "all" || value.contains(','));
            if let (true, Some(_)) = (word == "--slave" && self.has_option("all"), value) {
                hints.push(self.replaced("all gateways are an option", at, 2, ["--all"]));
            }
        }
    }

    /// Corrects the name of a command, or adds one.
    fn correct_command(&self, error: &clap::Error, hints: &mut Vec<Hint>) {
        let Some((at, word)) = self.of(Meaning::Positional).next() else {
            let name = if self.is_given("slave") { "info" } else { "scan" };
            if error.kind() == ErrorKind::MissingSubcommand {
                hints.push(self.replaced("a command is missing", self.words.len(), 0, [name]));
            }
            return;
        };
        if self.command.get_name() == "sim"
            && let Some((sim, _)) = self.of(Meaning::Command).last()
            && self.root.find_subcommand(word).is_some()
        {
            let with: &[_] = if self.is_given("ecrt") { &[] } else { &["--ecrt", "sim"] };
            hints.push(self.replaced("the simulator is an option", sim, 1, with));
        }
        if word.starts_with("sim:") || word.starts_with("nic:") {
            let rule = "the library is an option";
            hints.push(self.replaced(rule, at, 1, ["--ecrt", word]));
        }
        let others = OTHER_NAMES.iter().filter(|(other, _)| *other == word);
        let others =
            others.filter(|(_, names)| names[0].starts_with('-') || self.is_command(names[0]));
        let rule = "the command has another name here";
        hints.extend(others.map(|(_, with)| self.replaced(rule, at, 1, *with)));
        if let Some(ContextValue::Strings(similar)) = error.get(ContextKind::SuggestedSubcommand) {
            let rule = "a similar command exists";
            hints.extend(similar.iter().rev().map(|name| self.replaced(rule, at, 1, [name])));
        }
        if self.command.get_name() == self.root.get_name() {
            return;
        }
        let is_in_front = self.words.get(at + 1).is_some_and(|next| self.is_command(next));
        if is_in_front && is_selection("node", word) {
            hints.push(self.moved(SELECTIONS[0].1, at, "node", word));
        }
        for name in ["read", "info", "status", "update", "list", "check"] {
            if self.is_command(name) && is_selection("node", word) {
                let with = [name, "--node", word];
                hints.push(self.replaced("a command is missing", at, 1, with));
            } else if self.is_command(name) {
                hints.push(self.replaced("a command is missing", at, 0, [name]));
            }
        }
    }

    /// Corrects channels in front of filters, as of candump: `can0,123:7FF`, `can0 can1`.
    fn correct_channels(&self, hints: &mut Vec<Hint>) {
        let rule = "the channel is an option";
        if !self.has_option("channel") || self.is_given("channel") {
            return;
        }
        let channels: Vec<_> =
            self.of(Meaning::Positional).filter(|(_, word)| parse_channel(word).is_ok()).collect();
        if channels.len() > 1 {
            let names = channels.iter().map(|(_, word)| *word).collect::<Vec<_>>().join(",");
            let is_kept =
                |(at, _): &(usize, &String)| channels.iter().all(|(other, _)| other != at);
            let kept = self.words.iter().enumerate().filter(is_kept).map(|(_, word)| word.clone());
            let option = ["--channel".to_owned(), names];
            let part = option.join(" ");
            let line = kept.chain(option).collect();
            hints.push(Hint { rule, part, line, is_accepted: false });
        }
        for (at, word) in self.of(Meaning::Positional) {
            let mut parts = word.split(',');
            let channel =
                parts.next().and_then(|name| name.find("can").map(|start| &name[start..]));
            let Some(channel) = channel.filter(|name| parse_channel(name).is_ok()) else {
                continue;
            };
            hints.push(self.replaced(rule, at, 1, ["--channel", channel].into_iter().chain(parts)));
        }
    }

    /// Corrects number and subindex of an object, and its value.
    fn correct_object(&self, hints: &mut Vec<Hint>) {
        if !self.has_positional("object") {
            return;
        }
        let Some((at, word)) = self.of(Meaning::Positional).next() else { return };
        let digits = word.strip_prefix("0x").unwrap_or(word);
        let is_index = |text: &str| text.len() > 2 && u16::from_str_radix(text, 16).is_ok();
        let is_subindex = |text: &&String| text.parse::<u8>().is_ok();
        if let Some(subindex) = self.words.get(at + 1).filter(is_subindex)
            && is_index(digits)
        {
            let object = format!("0x{digits}:{subindex}");
            hints.push(self.replaced("a subindex follows a colon", at, 2, [object]));
        }
        if let Some((index, subindex)) = digits.split_once(['.', ',', ';', '/'])
            && is_index(index)
        {
            let object = format!("0x{index}:{subindex}");
            hints.push(self.replaced("a subindex follows a colon", at, 1, [object]));
        }
        if let Some((object, value)) = word.split_once('=') {
            hints.push(self.replaced("a value follows a space", at, 1, [object, value]));
        }
        if let Some((equals, _)) = self.of(Meaning::Positional).find(|(_, word)| *word == "=") {
            hints.push(self.replaced::<&str>("a value follows a space", equals, 1, []));
        }
        if digits == word && is_index(word.split(':').next().unwrap_or_default()) {
            let object = format!("0x{word}");
            hints.push(self.replaced("a hexadecimal number begins with 0x", at, 1, [object]));
        }
    }

    /// Makes an option of a node, axis, channel, slave or master without a name.
    fn correct_selection(&self, hints: &mut Vec<Hint>) {
        let is_of_master = OF_MASTER.contains(&self.command.get_name());
        for (name, rule) in SELECTIONS {
            if !self.has_option(name)
                || self.is_given(name)
                || name == "slave" && is_of_master
                || name == "master" && !is_of_master
                // A number without a name is a node here.
                || name == "slave" && self.has_option("node")
            {
                continue;
            }
            for (at, word) in
                self.of(Meaning::Positional).filter(|(_, word)| is_selection(name, word))
            {
                let mut hint = self.moved(rule, at, name, word);
                if name == "axis" && !self.is_given("config") {
                    hint.line.extend(["--config", "FILE"].map(str::to_owned));
                }
                hints.push(hint);
            }
        }
        for (at, word) in self.of(Meaning::Positional) {
            if self.has_option("id") && word.starts_with(|c: char| c.is_ascii_hexdigit()) {
                hints.push(self.moved("the CAN ID is an option", at, "id", word));
            }
        }
    }

    /// Corrects the frame of `ecan send`.
    fn correct_frame(&self, hints: &mut Vec<Hint>) {
        let words: Vec<_> = self.of(Meaning::Positional).collect();
        let (Some((first, word)), true) = (words.first(), self.has_positional("frames")) else {
            return;
        };
        let is_in_parts = words.iter().enumerate().all(|(number, (at, _))| *at == first + number);
        if !is_in_parts || words[1..].iter().any(|(_, word)| word.contains('#')) {
            return;
        }
        let plain = |text: &str| text.replace("0x", "").replace("0X", "");
        let joined = |words: &[(usize, &str)]| {
            words.iter().map(|(_, word)| plain(word)).collect::<Vec<_>>().join("")
        };
        let (id, data) = match plain(word).split_once(['#', ':', ',']) {
            Some((id, data)) => (id.to_owned(), data.replace([':', ','], "")),
            None => (plain(word), String::new()),
        };
        let width = if id.len() > 3 { 8 } else { 3 };
        let frame = format!("{id:0>width$}#{data}");
        let whole = format!("{frame}{}", joined(&words[1..]));
        let rule = "a frame is ID#DATA in hexadecimal";
        for (frame, count) in [(whole, words.len()), (frame, 1)] {
            if parse_frame(&frame.replace('.', "")).is_ok() {
                hints.push(self.replaced(rule, *first, count, [frame]));
            }
        }
    }

    /// Corrects a filter of `ecan dump` without mask.
    fn correct_filter(&self, hints: &mut Vec<Hint>) {
        if !self.has_positional("rules") {
            return;
        }
        for (at, word) in self.of(Meaning::Positional) {
            let digits = word.trim_start_matches("0x");
            let mask = if digits.len() > 3 { "1FFFFFFF" } else { "7FF" };
            if u32::from_str_radix(digits, 16).is_ok() && parse_channel(word).is_err() {
                let filter = format!("{digits}:{mask}");
                hints.push(self.replaced("a filter has a mask", at, 1, [filter]));
            }
        }
    }

    /// Makes an option of a value that only this option has, and of a file.
    fn correct_value(&self, hints: &mut Vec<Hint>) {
        for (at, word) in self.of(Meaning::Positional) {
            let of_file =
                FILES.iter().filter(|(end, _)| word.ends_with(end)).map(|(_, name)| *name);
            let has_value = |argument: &&Arg| {
                argument.get_possible_values().iter().any(|value| value.matches(word, false))
            };
            let of_value = self.command.get_arguments().filter(has_value).filter_map(Arg::get_long);
            for name in of_file.chain(of_value).filter(|name| self.has_option(name)) {
                hints.push(self.moved("this is an option", at, name, word));
            }
        }
    }

    /// Adds the first node or channel for a command that needs one.
    fn add_example(&self, hints: &mut Vec<Hint>) {
        let examples: &[_] = match self.is_given("axis") {
            true => &[("config", "FILE")],
            false => &[("node", "1"), ("channel", "0")],
        };
        for (name, value) in examples {
            if self.has_option(name) && !self.is_given(name) {
                let option = [format!("--{name}"), (*value).to_owned()];
                hints.push(self.replaced("for example", self.words.len(), 0, option));
            }
        }
    }
}

/// Number of words after an option that are its values.
fn value_count(option: &Arg, word: &str) -> usize {
    let is_attached = word.contains('=') || !word.starts_with("--") && word.len() > 2;
    match option.get_action().takes_values() && !is_attached {
        true => option.get_num_args().map_or(1, |range| range.max_values()),
        false => 0,
    }
}

/// Returns whether a word may select a node, axis, channel, slave or master.
fn is_selection(name: &str, word: &str) -> bool {
    let is_number = |text: &str| text.parse::<u8>().is_ok();
    let is_address = word
        .split_once('.')
        .is_some_and(|(channel, node)| parse_channel(channel).is_ok() && is_number(node));
    match name {
        "node" => is_number(word) || is_address,
        "axis" => is_number(word) || word.starts_with(|c: char| c.is_ascii_alphabetic()),
        "channel" => parse_channel(word).is_ok(),
        "slave" => is_number(word) || word.starts_with("alias=") || word.starts_with("serial="),
        _ => is_number(word),
    }
}
