//! The help of `-h`, without the options of every command.

use clap::Command;

/// Folds the options of every command into one line.
pub fn fold(command: Command) -> Command {
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
