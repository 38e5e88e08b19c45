//! `ecan node emcy`: error history and emergency messages.

use std::io::Write as _;
use std::time::Duration;

use clap::Args;
use ecan_canopen::{Emcy, ErrorRegister, Service as CanopenService, object};
use serde::Serialize;

use super::node_client::{NodeClient, start_for};
use super::node_target::{JsonTarget, LiveViewArguments, PositionalTarget};
use super::object_value::error_text;
use crate::context::{Context, Failure, Output, Result, Tone};
use crate::frames::FrameOptions;
use crate::output::with_simulated;

#[derive(Debug, Args)]
pub struct EmcyArguments {
    #[command(flatten)]
    target: PositionalTarget,
    /// Clear the history after printing it: write 0 to 0x1003:00
    #[arg(long, conflicts_with = "watch")]
    clear: bool,
    /// Then print the emergency messages of the node as they arrive
    #[arg(long)]
    watch: bool,
    #[command(flatten)]
    view: LiveViewArguments,
    #[command(flatten)]
    options: FrameOptions,
}

#[derive(Debug, Serialize)]
struct HistoryEntry {
    number: u8,
    code: u16,
    text: String,
    /// Upper half of the entry, of the manufacturer.
    additional: u16,
}

#[derive(Debug, Serialize)]
struct History {
    #[serde(flatten)]
    node: JsonTarget,
    error_register: Option<u8>,
    error_register_text: Option<String>,
    /// `None` if the node has no history.
    history: Option<Vec<HistoryEntry>>,
    is_cleared: bool,
}

#[derive(Debug, Serialize)]
struct Message {
    /// Seconds since the start of the command.
    seconds: f64,
    code: u16,
    text: String,
    error_register: u8,
    manufacturer: [u8; 5],
}

const SDO_TIMEOUT: Duration = Duration::from_millis(500);

pub fn run(arguments: &EmcyArguments, context: &Context) -> Result {
    let context = &context.on_stderr(arguments.options.capture.is_on_output());
    let selected = arguments.target.select(&arguments.options, context)?;
    let has_end = !arguments.watch || arguments.view.has_end();
    let link = start_for(&selected, has_end, context)?;
    NodeClient::new(link, selected.target, SDO_TIMEOUT).run(|client| {
        let history = read(client, arguments.clear)?;
        context.output.data(&history, |out| print(&history, &context.output, out))?;
        if arguments.watch { watch(arguments.view, client, context) } else { Ok(()) }
    })
}

fn read(client: &mut NodeClient, is_clearing: bool) -> Result<History> {
    let register = client.number(object::ERROR_REGISTER, 0)?.map(|value| value as u8);
    let count = client.number(object::ERROR_HISTORY, 0)?;
    let mut history = count.map(|_| Vec::new());
    for number in 1..=count.unwrap_or(0).min(254) as u8 {
        let Some(raw) = client.number(object::ERROR_HISTORY, number)? else { break };
        let (code, additional) = (raw as u16, (raw >> 16) as u16);
        let text = error_text(code);
        history.iter_mut().for_each(|entry| {
            entry.push(HistoryEntry { number, code, text: text.clone(), additional });
        });
    }
    if is_clearing {
        if history.is_none() {
            let message = format!("{} has no error history (0x1003)", client.target());
            return Err(Failure::Rejected(message));
        }
        client.download(object::ERROR_HISTORY, 0, &[0])?;
    }
    Ok(History {
        node: client.json(),
        error_register: register,
        error_register_text: register.map(|register| ErrorRegister(register).to_string()),
        history,
        is_cleared: is_clearing,
    })
}

fn print(history: &History, output: &Output, out: &mut dyn std::io::Write) -> std::io::Result<()> {
    let JsonTarget { channel, node, .. } = history.node;
    let register = history.error_register_text.as_deref().unwrap_or("not available");
    writeln!(out, "node {node} on can{channel}, error register: {register}")?;
    match &history.history {
        None => writeln!(out, "no error history (0x1003)")?,
        Some(entries) if entries.is_empty() => writeln!(out, "error history: empty")?,
        Some(entries) => {
            writeln!(out, "error history, the newest first:")?;
            for HistoryEntry { number, code, text, additional } in entries {
                let code = output.toned(Tone::Bad, format_args!("0x{code:04X}"));
                let additional = match additional {
                    0 => String::new(),
                    additional => format!(" (manufacturer 0x{additional:04X})"),
                };
                writeln!(out, "{number:>3}  {code} {text}{additional}")?;
            }
        }
    }
    if history.is_cleared {
        writeln!(out, "error history cleared")?;
    }
    Ok(())
}

fn watch(arguments: LiveViewArguments, client: &mut NodeClient, context: &Context) -> Result {
    let mut view = arguments.start(&client.link.service);
    let node = client.target().node;
    loop {
        let mut messages = Vec::new();
        let cycle = client.cycle(|observed| {
            if observed.service() == Some(CanopenService::Emcy(node)) {
                messages.extend(
                    Emcy::parse(observed.frame.frame.data()).map(|emcy| (observed.time_ns, emcy)),
                );
            }
        });
        let Some(now_ns) = view.after_cycle(cycle)? else { return Ok(()) };
        for (time_ns, emcy) in messages {
            view.receive(now_ns);
            let message = Message {
                seconds: view.seconds(time_ns),
                code: emcy.code,
                text: error_text(emcy.code),
                error_register: emcy.register.0,
                manufacturer: emcy.manufacturer,
            };
            print_message(&message, context)?;
            if view.count_line() {
                return Ok(());
            }
        }
        if view.has_timed_out(now_ns) {
            return match view.count {
                Some(count) => Err(Failure::Incomplete(format!(
                    "{} of {count} emergency messages received",
                    view.printed
                ))),
                None => Ok(()),
            };
        }
    }
}

fn print_message(message: &Message, context: &Context) -> Result {
    let mut stream = context.output.stream();
    if context.global.json {
        let json = serde_json::to_string(message).map_err(std::io::Error::from)?;
        writeln!(stream, "{}", with_simulated(json))?;
    } else {
        let Message { seconds, code, text, error_register, manufacturer } = message;
        let tone = if *code == 0 { Tone::Good } else { Tone::Bad };
        let code = context.output.toned(tone, format_args!("0x{code:04X}"));
        let bytes: Vec<_> = manufacturer.iter().map(|byte| format!("{byte:02X}")).collect();
        let register = ErrorRegister(*error_register);
        let bytes = bytes.join(" ");
        writeln!(stream, "{seconds:9.3}  {code} {text}; error register: {register}; {bytes}")?;
    }
    stream.flush()?;
    Ok(())
}
