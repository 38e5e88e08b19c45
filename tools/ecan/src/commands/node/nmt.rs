//! `ecan node nmt`: state of a node (CiA 301, 7.2.8).

use std::collections::BTreeMap;
use std::time::Duration;

use clap::{Args, ValueEnum};
use ecan_canopen::{NmtCommand, NmtRequest, NmtState, NodeId, Service as CanopenService, object};
use ecan_tool_support::command_line::options::milliseconds;
use serde::Serialize;

use super::node_client::{NodeClient, start, start_for};
use super::node_link::{NodeLink, Observed};
use super::node_target::NodeArgument;
use super::scan::state_name;
use crate::context::{Context, Failure, Result};
use crate::frames::{FrameOptions, parse_channel};
use crate::output::confirm;

pub const NOTES: &str = "\
The state is confirmed by a heartbeat, after a reset by the boot-up message. If the producer
heartbeat time (0x1017) of the node is 0, the node is asked by node guarding, unless that would
start its life guarding (0x100C, 0x100D). A PDO of the node confirms operational; a node that no
longer answers SDO requests is stopped.

start can let a motor move if a program sends PDOs; a reset switches off a drive, and a load can
fall. Both ask for confirmation or need --yes.

Exit status 1 if the state is not confirmed.";

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Command {
    /// To operational
    Start,
    /// To stopped: no SDO, no PDO
    Stop,
    /// To pre-operational: no PDO
    Preop,
    /// Restart the node
    Reset,
    /// Restart the communication of the node
    ResetComm,
}

impl Command {
    fn command(self) -> NmtCommand {
        match self {
            Self::Start => NmtCommand::Start,
            Self::Stop => NmtCommand::Stop,
            Self::Preop => NmtCommand::EnterPreOperational,
            Self::Reset => NmtCommand::ResetNode,
            Self::ResetComm => NmtCommand::ResetCommunication,
        }
    }

    fn is_reset(self) -> bool {
        matches!(self, Self::Reset | Self::ResetComm)
    }

    /// State after the command.
    fn goal(self) -> NmtState {
        match self {
            Self::Start => NmtState::Operational,
            Self::Stop => NmtState::Stopped,
            Self::Preop | Self::Reset | Self::ResetComm => NmtState::PreOperational,
        }
    }

    fn needs_confirmation(self) -> bool {
        self == Self::Start || self.is_reset()
    }
}

#[derive(Debug, Args)]
pub struct NmtArguments {
    /// Command
    #[arg(value_enum)]
    command: Command,
    /// Node-ID, 1 to 127, CHANNEL.ID, or a name of the configuration file (--config)
    #[arg(long, value_name = "NODE", required_unless_present = "all", conflicts_with = "all")]
    node: Option<NodeArgument>,
    /// CAN channel, 0 to 3 [default: 0]
    #[arg(long, value_name = "N", value_parser = parse_channel)]
    channel: Option<u8>,
    /// All nodes of the channel
    #[arg(long)]
    all: bool,
    /// Send without asking
    #[arg(long)]
    yes: bool,
    /// Time for the confirmation
    #[arg(long, value_name = "TIME", default_value = "3s", value_parser = milliseconds::<u64>(1..=60_000))]
    timeout: u64,
    #[command(flatten)]
    options: FrameOptions,
}

/// Proof of the state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Proof {
    Heartbeat,
    BootUp,
    NodeGuarding,
    Pdo,
    NoSdo,
}

impl Proof {
    fn text(self) -> &'static str {
        match self {
            Self::Heartbeat => "by its heartbeat",
            Self::BootUp => "by its boot-up message",
            Self::NodeGuarding => "by node guarding",
            Self::Pdo => "by its PDO",
            Self::NoSdo => "it no longer answers SDO requests",
        }
    }
}

#[derive(Debug, Serialize)]
struct Confirmed {
    node: u8,
    state: Option<&'static str>,
    proof: Option<Proof>,
}

#[derive(Debug, Serialize)]
struct Outcome {
    slave: usize,
    channel: u8,
    command: String,
    nodes: Vec<Confirmed>,
}

const SDO_TIMEOUT: Duration = Duration::from_millis(300);
/// Interval of requests by node guarding.
const GUARDING: Duration = Duration::from_millis(100);

pub fn run(arguments: &NmtArguments, context: &Context) -> Result {
    let context = &context.on_stderr(arguments.options.capture.is_on_output());
    let select =
        |argument: &NodeArgument| argument.select(arguments.channel, &arguments.options, context);
    let selected = arguments.node.as_ref().map(select).transpose()?;
    let target = selected.as_ref().map(|selected| selected.target);
    let channel = target.map_or(arguments.channel.unwrap_or(0), |target| target.channel);
    let what = match target {
        Some(target) => target.to_string(),
        None => format!("all nodes on can{channel}"),
    };
    let command = arguments.command.command();
    let consequence = match arguments.command.is_reset() {
        true => "drives switch off, and loads can fall",
        false => "motors can move if a program sends PDOs",
    };
    confirm(
        arguments.yes || !arguments.command.needs_confirmation(),
        &format!("\"{command}\" for {what}"),
        format_args!("Send \"{command}\" to {what}: {consequence}. Continue?"),
        "the command was not sent",
    )?;
    let link = match &selected {
        Some(selected) => start_for(selected, true, context)?,
        None => start(&arguments.options, channel, true, context)?,
    };
    let timeout = Duration::from_millis(arguments.timeout);
    let outcome = match target {
        Some(target) => NodeClient::new(link, target, SDO_TIMEOUT)
            .run(|client| command_one(arguments.command, client, timeout))?,
        None => {
            let mut link = link;
            let outcome = command_all(arguments.command, &mut link, channel, timeout);
            let finished = link.service.finish();
            outcome.and_then(|outcome| finished.map(|()| outcome))?
        }
    };
    context.output.data(&outcome, |out| print(&outcome, out))?;
    check(&outcome, arguments.command, &what)
}

fn print(outcome: &Outcome, out: &mut dyn std::io::Write) -> std::io::Result<()> {
    for Confirmed { node, state, proof } in &outcome.nodes {
        let proof = proof.map_or_else(String::new, |proof| format!(", {}", proof.text()));
        let state = state.unwrap_or("state not reported");
        writeln!(out, "node {node} on can{}: {state}{proof}", outcome.channel)?;
    }
    Ok(())
}

fn check(outcome: &Outcome, command: Command, what: &str) -> Result {
    let goal = state_name(command.goal());
    if outcome.nodes.is_empty() {
        let message = format!(
            "the command was sent, but no node on can{} reported a state; set a producer heartbeat \
             time (0x1017) to see it",
            outcome.channel
        );
        return Err(Failure::Incomplete(message));
    }
    match outcome.nodes.iter().find(|node| node.proof.is_none() || node.state != Some(goal)) {
        None => Ok(()),
        Some(Confirmed { state: Some(state), proof: Some(_), node }) => Err(Failure::Incomplete(
            format!("node {node} is {state} instead of {goal}; see `ecan node emcy`"),
        )),
        Some(_) => Err(Failure::Incomplete(format!(
            "the command was sent, but {what} did not confirm {goal}; set a producer heartbeat \
             time (0x1017) to see the state"
        ))),
    }
}

fn outcome(link: &NodeLink, channel: u8, command: Command, nodes: Vec<Confirmed>) -> Outcome {
    let slave = link.service.position(0);
    Outcome { slave, channel, command: command.command().to_string(), nodes }
}

/// Commands one node and waits for its state.
fn command_one(command: Command, client: &mut NodeClient, timeout: Duration) -> Result<Outcome> {
    let target = client.target();
    // A node in the state stopped answers none of these.
    let period = client.try_upload(object::PRODUCER_HEARTBEAT, 0)?.ok();
    let answers = period.is_some();
    let period_ms = period.map_or(0, |data| super::node_client::decode_unsigned(&data));
    let may_guard = answers && period_ms == 0 && !has_life_guarding(client)?;
    client.forget_state();
    let request = NmtRequest { command: command.command(), node: Some(target.node) };
    let mut watch = StateWatch { node: target.node, ..StateWatch::default() };
    client
        .link
        .send_nmt(target.channel, request, |observed| watch.observe(observed, target.channel))?;
    // What was received until here may be older than the command.
    watch.begin();
    let mut confirmed = None;
    let start_ns = client.link.service.response_ns();
    let (mut asked_ns, timeout_ns) = (start_ns, timeout.as_nanos() as u64);
    loop {
        let now_ns = client.cycle(|observed| watch.observe(observed, target.channel))?;
        if let Some(proof) = watch.proof(command) {
            confirmed = Some(proof);
            break;
        }
        if now_ns.saturating_sub(start_ns) > timeout_ns {
            break;
        }
        let is_due = now_ns.saturating_sub(asked_ns) >= GUARDING.as_nanos() as u64;
        if may_guard && !command.is_reset() && is_due {
            asked_ns = now_ns;
            watch.is_guarded = true;
            client
                .link
                .send_guarding(target, |observed| watch.observe(observed, target.channel))?;
        }
    }
    if confirmed.is_none()
        && command == Command::Stop
        && answers
        && client.try_upload(object::PRODUCER_HEARTBEAT, 0)?.is_err()
    {
        confirmed = Some(Proof::NoSdo);
    }
    let state = match confirmed {
        Some(_) => Some(command.goal()),
        None => watch.last,
    };
    // A state of another kind than expected is reported by a heartbeat.
    let proof = confirmed.or(watch.last.map(|_| Proof::Heartbeat));
    let node = Confirmed { node: target.node.get(), state: state.map(state_name), proof };
    Ok(outcome(&client.link, target.channel, command, vec![node]))
}

/// Returns whether a request by node guarding would start the life guarding of the node.
fn has_life_guarding(client: &mut NodeClient) -> Result<bool> {
    const GUARD_TIME: u16 = 0x100C;
    const LIFE_TIME_FACTOR: u16 = 0x100D;
    let time = client.number(GUARD_TIME, 0)?.unwrap_or(0);
    let factor = client.number(LIFE_TIME_FACTOR, 0)?.unwrap_or(0);
    Ok(time > 0 && factor > 0)
}

/// Observation of the state of one node.
#[derive(Debug)]
struct StateWatch {
    node: NodeId,
    /// Last state after the command, apart from that of the boot-up message.
    last: Option<NmtState>,
    has_booted: bool,
    has_sent_pdo: bool,
    is_guarded: bool,
}

impl Default for StateWatch {
    fn default() -> Self {
        Self {
            node: NodeId::MIN,
            last: None,
            has_booted: false,
            has_sent_pdo: false,
            is_guarded: false,
        }
    }
}

impl StateWatch {
    fn begin(&mut self) {
        (self.last, self.has_booted, self.has_sent_pdo) = (None, false, false);
    }

    fn observe(&mut self, observed: &Observed, channel: u8) {
        if !observed.is_from(0, channel) || observed.frame.frame.as_ref().is_remote() {
            return;
        }
        match (observed.state(), observed.service()) {
            (Some((node, NmtState::Initialising)), _) if node == self.node => {
                self.has_booted = true
            }
            (Some((node, state)), _) if node == self.node => self.last = Some(state),
            (_, Some(CanopenService::Tpdo(node, _))) if node == self.node => {
                self.has_sent_pdo = true;
            }
            _ => {}
        }
    }

    fn proof(&self, command: Command) -> Option<Proof> {
        if command.is_reset() {
            return self.has_booted.then_some(Proof::BootUp);
        }
        match self.last == Some(command.goal()) {
            true if self.is_guarded => Some(Proof::NodeGuarding),
            true => Some(Proof::Heartbeat),
            false => (command == Command::Start && self.has_sent_pdo).then_some(Proof::Pdo),
        }
    }
}

/// Commands all nodes of a channel, and collects the states that they report until the end.
fn command_all(
    command: Command,
    link: &mut NodeLink,
    channel: u8,
    timeout: Duration,
) -> Result<Outcome> {
    let mut states: BTreeMap<u8, (NmtState, Proof)> = BTreeMap::new();
    link.send_nmt(channel, NmtRequest { command: command.command(), node: None }, |_| ())?;
    let end_ns = link.service.response_ns().saturating_add(timeout.as_nanos() as u64);
    loop {
        let now_ns = link.cycle(&mut [], |observed| {
            if let (Some((node, state)), true) = (observed.state(), observed.is_from(0, channel)) {
                let new = match state {
                    NmtState::Initialising => (NmtState::PreOperational, Proof::BootUp),
                    state => (state, Proof::Heartbeat),
                };
                states.insert(node.get(), new);
            }
        })?;
        if now_ns >= end_ns {
            break;
        }
    }
    let confirmed = |(node, (state, proof)): (u8, (NmtState, Proof))| Confirmed {
        node,
        state: Some(state_name(state)),
        proof: Some(proof),
    };
    let nodes = states.into_iter().map(confirmed).collect();
    Ok(outcome(link, channel, command, nodes))
}
