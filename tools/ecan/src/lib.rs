//! The program `ecan`: bring-up, diagnosis and maintenance of ECAN-Lite gateways.
//!
//! ```text
//! ecan --ecrt sim scan
//! ecan --slave 0 sdo read 0x8010:3
//! ```
#![forbid(unsafe_code)]

mod bus;
mod commands;
mod config_changes;
mod config_file;
mod context;
mod ethercat_tool;
mod failure;
mod frames;
mod global;
mod hint;
mod object_path;
mod output;
mod program;
mod service_access;
mod slave_choice;
mod value;

use std::ffi::OsString;
use std::path::Path;

use clap::{CommandFactory, FromArgMatches, Parser};
use clap_complete::Shell;
use clap_mangen::Man;
use commands::Command;
use context::{Context, Failure, GlobalOptions, Output, note};
use ecan_protocol::text::Printable;
use ecan_sim::BUILTIN_SCENARIOS;
use ecan_tool_support::command_line::new_file::{Existing, create};
use ecan_tool_support::command_line::screen::{print_message, with_printable_arguments};
use global::{Color, GivenOptions};

/// Bring-up, diagnosis and maintenance of ECAN-Lite gateways.
#[derive(Debug, Parser)]
#[command(name = "ecan", version, after_help = global::EXIT_STATUS)]
struct Arguments {
    #[command(flatten)]
    global: GlobalOptions,
    #[command(subcommand)]
    command: Command,
}

/// Runs the program with its arguments, of which the first one is its name. Prints on the standard streams
/// of the process and returns the exit status.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let arguments: Vec<_> = arguments.into_iter().collect();
    let Arguments { global, command } = match parse(&arguments) {
        Ok(parsed) => parsed,
        Err(error) => return reject(&arguments, &error),
    };
    global.log.start();
    let output = Output::new(global.json, global.color);
    let context = Context { global: &global, output };
    let outcome = match &command {
        Command::Scan => commands::scan::run(&context),
        Command::Info(arguments) => commands::info::run(arguments, &context),
        Command::Caps => commands::info::run_caps(&context),
        Command::Config(arguments) => commands::config::run(arguments, &context),
        Command::Sdo(arguments) => commands::sdo::run(arguments, &context),
        Command::Diag(arguments) => commands::diag::run(arguments, &context),
        Command::Doctor(arguments) => commands::doctor::run(arguments, &context),
        Command::Reg(arguments) => commands::reg::run(arguments, &context),
        Command::Filter(arguments) => commands::filter::run(arguments, &context),
        Command::Pins(arguments) => commands::pins::run(arguments, &context),
        Command::Reboot(arguments) => commands::reboot::run(arguments, &context),
        Command::Plan(arguments) => commands::plan::run(arguments, &context),
        Command::Firmware(arguments) => commands::firmware::run(arguments, &context),
        Command::Dump(arguments) => commands::dump::run(arguments, &context),
        Command::Send(arguments) => commands::send::run(arguments, &context),
        Command::Gen(arguments) => commands::generate::run(arguments, &context),
        Command::Replay(arguments) => commands::replay::run(arguments, &context),
        Command::Monitor(arguments) => commands::monitor::run(arguments, &context),
        Command::Node(arguments) => commands::node::run(arguments, &context),
        Command::Axis(arguments) => commands::axis::run(arguments, &context),
        Command::Bridge(arguments) => commands::bridge::run(arguments, &context),
        Command::Serve(arguments) => commands::serve::run(arguments, &context),
        Command::Sim(arguments) => commands::sim::run(arguments, &context),
        #[cfg(feature = "zenoh")]
        Command::Zenoh(arguments) => commands::zenoh::run(arguments, &context),
        Command::Probe(arguments) => commands::probe::run(arguments, &context),
        Command::Selftest(arguments) => commands::selftest::run(arguments, &context),
        Command::New(arguments) => commands::new::run(arguments, &context),
        Command::Completions { shell } => output.bytes(completions(*shell).as_bytes()),
        Command::Man { directory } => write_manual(&Arguments::command(), directory),
    };
    match outcome {
        Ok(()) | Err(Failure::ReaderGone) => 0,
        Err(failure) => {
            output.failure(&failure, failure.status());
            note(format_args!("ecan: {failure}"));
            failure.status()
        }
    }
}

fn parse(arguments: &[OsString]) -> Result<Arguments, clap::Error> {
    let mut command = command();
    if options(arguments).any(|option| option == "-h") {
        command = global::fold_global_options(command);
    }
    let matches = command.try_get_matches_from_mut(arguments);
    let matches = matches
        .map_err(|error| with_printable_arguments(hint::with_hint(error, &command, arguments)))?;
    let mut arguments =
        Arguments::from_arg_matches(&matches).map_err(|error| error.format(&mut command))?;
    arguments.global.given = GivenOptions::of(&command, &matches);
    Ok(arguments)
}

/// The program with all its commands and options.
fn command() -> clap::Command {
    Arguments::command()
}

/// Arguments that may be options: those before `--`.
fn options(arguments: &[OsString]) -> impl Iterator<Item = &OsString> {
    arguments.iter().skip(1).take_while(|argument| *argument != "--")
}

/// Prints the message for arguments that clap rejects, or a help; returns the exit status.
fn reject(arguments: &[OsString], error: &clap::Error) -> u8 {
    let is_json = error.use_stderr() && options(arguments).any(|option| option == "--json");
    let text = error.render().to_string();
    // The message and the hint, without the usage.
    let (message, rest) = text.split_once("\n\n").unwrap_or((&text, ""));
    let hint = rest.trim_start().strip_prefix("tip: ").and_then(|hint| hint.lines().next());
    let hint = hint.map_or(String::new(), |hint| format!("; {hint}"));
    let failure = Failure::Usage(format!("{}{hint}", message.trim_start_matches("error: ")));
    Output::new(is_json, Color::Never).failure(&failure, failure.status());
    print_message(error)
}

/// Completes the settings of `--ecrt`, whose colon separates words in bash, and keeps a setting `sim` from being taken
/// for the command of this name.
const BASH_SETTINGS: &str = r#"
_ecan_with_settings() {
    local line="${COMP_LINE:0:COMP_POINT}" all words=() word previous=
    read -ra all <<< "$line"
    [[ "$line" == *[[:space:]] ]] && all+=("")
    if [[ "$line" =~ [[:space:]]--ecrt[[:space:]=]+([^[:space:]]*)$ ]]; then
        word="${BASH_REMATCH[1]}"
        COMPREPLY=($(compgen -W "{settings}" -- "$word"))
        if [[ "$word" == sim:* ]]; then
            COMPREPLY+=($(compgen -P sim: -f -X '!*.toml' -- "${word#sim:}"))
        else
            COMPREPLY+=($(compgen -f -- "$word"))
        fi
    else
        for word in "${all[@]}"; do
            [[ "$previous" == --ecrt ]] || words+=("$word")
            previous="$word"
        done
        local COMP_WORDS=("${words[@]}") COMP_CWORD=$((${#words[@]} - 1))
        _ecan "$1" "$word" "${words[COMP_CWORD - 1]}"
    fi
    if [[ "$word" == *:* && "$COMP_WORDBREAKS" == *:* ]]; then
        COMPREPLY=("${COMPREPLY[@]#"${word%:*}:"}")
    fi
}
complete -F _ecan_with_settings -o bashdefault -o default ecan
"#;

/// As [`BASH_SETTINGS`], before the call of the completion.
const ZSH_SETTINGS: &str = r#"
_ecan_settings() {
    compadd -- {settings}
    compset -P 'sim:' && _files -g '*.toml' || _files
}

"#;

/// As [`BASH_SETTINGS`]; files are completed, too.
const FISH_SETTINGS: &str = r#"complete -c ecan -l ecrt -r -a "{settings}"
"#;

/// Returns the completion script of a shell.
fn completions(shell: Shell) -> String {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut command(), "ecan", &mut script);
    let script = String::from_utf8_lossy(&script);
    let scenarios = BUILTIN_SCENARIOS.iter().map(|name| format!(" sim:{name}"));
    let settings = std::iter::once("sim".to_owned()).chain(scenarios).collect::<String>();
    let own = |text: &str| text.replace("{settings}", &settings);
    match shell {
        Shell::Bash => format!("{script}{}", own(BASH_SETTINGS)),
        Shell::Zsh => {
            let script = script.replace(":LIBRARY:_default", ":LIBRARY:_ecan_settings");
            script.replacen("\n_ecan() {", &format!("\n{}_ecan() {{", own(ZSH_SETTINGS)), 1)
        }
        Shell::Fish => format!("{script}{}", own(FISH_SETTINGS)),
        _ => script.into_owned(),
    }
}

/// Writes the help as manual pages.
fn write_manual(command: &clap::Command, directory: &Path) -> context::Result {
    let mut command = command.clone().disable_help_subcommand(true);
    command.build();
    std::fs::create_dir_all(directory)
        .and_then(|()| write_page(&command, directory))
        .map_err(|error| Failure::file("write the manual pages to", directory, error))?;
    note(format_args!("manual pages written to {}", Printable(directory.display())));
    Ok(())
}

/// Writes the pages of a command and its subcommands.
fn write_page(command: &clap::Command, directory: &Path) -> std::io::Result<()> {
    for subcommand in command.get_subcommands().filter(|command| !command.is_hide_set()) {
        write_page(subcommand, directory)?;
    }
    let name = command.get_display_name().unwrap_or_else(|| command.get_name());
    let mut page = create(&directory.join(format!("{name}.1")), Existing::Replace)?;
    Man::new(command.clone()).render(&mut page)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Calls `visit` with the path and the text of each Rust file below a folder.
    fn visit_sources(folder: &Path, visit: &mut dyn FnMut(&Path, &str)) {
        for entry in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            if entry.is_dir() && !entry.ends_with("target") {
                visit_sources(&entry, visit);
            } else if entry.extension().is_some_and(|extension| extension == "rs") {
                visit(&entry, &std::fs::read_to_string(&entry).unwrap());
            }
        }
    }

    /// Returns whether the words name a command of the program, as far as they are names.
    fn is_command(words: &str) -> bool {
        let mut command = command();
        for word in words.split_whitespace().take_while(|word| !word.starts_with('-')) {
            if !command.has_subcommands() {
                break;
            }
            match command.find_subcommand(word) {
                Some(inner) => command = inner.clone(),
                None => return false,
            }
        }
        true
    }

    #[test]
    fn commands_that_messages_name_exist() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let mut count = 0;
        visit_sources(&root, &mut |path, text| {
            // Lines that a string continues are one text.
            let text = text.replace("\\\n", " ");
            for quoted in text.split('`').filter_map(|quoted| quoted.strip_prefix("ecan ")) {
                // The last one is in some builds only.
                let is_text = quoted.len() < 80 && !quoted.contains(['{', '\n', '"']);
                if is_text && !quoted.starts_with("zenoh") {
                    assert!(is_command(quoted), "{}: `ecan {quoted}`", path.display());
                    count += 1;
                }
            }
        });
        assert!(count > 100, "{count}");
    }
}
