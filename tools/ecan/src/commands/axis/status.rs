//! `ecan axis status`: state of a drive, and why it is not enabled.

use std::io;
use std::io::Write;
use std::time::Duration;

use clap::Args;
use ecan_canopen::{DriveState, ErrorRegister, OperatingMode, Statusword, error_code_text, object};
use ecan_tool_support::command_line::options::seconds;
use serde::Serialize;

use super::axis_choice::{AxisOptions, ChosenAxis};
use super::unit::AxisUnits;
use crate::commands::node::node_client::{NodeClient, start};
use crate::commands::node::scan::state_name;
use crate::context::{Context, Failure, Result};
use crate::frames::FrameOptions;
use crate::{context, output};

pub const NOTES: &str = "\
Reads objects of the drive by SDO, and writes none; also through a service (--via). Exit status 1 if
the drive is in fault. With --watch a line is printed for each change, until Ctrl-C or for --for;
with --json an object for each.";

#[derive(Debug, Args)]
pub struct StatusArguments {
    #[command(flatten)]
    axis: AxisOptions,
    /// Print each change of state, error or position
    #[arg(long)]
    watch: bool,
    /// Watch for this time
    #[arg(long = "for", value_name = "TIME", requires = "watch", value_parser = seconds::<u32>(1..=1_000_000))]
    seconds: Option<u32>,
    #[command(flatten)]
    options: FrameOptions,
}

const SDO_TIMEOUT: Duration = Duration::from_millis(500);
/// Longest time to wait for a heartbeat.
const MOST_HEARTBEAT_MS: u64 = 3_000;
/// Interval of the live view.
const WATCH: Duration = Duration::from_millis(200);

pub fn run(arguments: &StatusArguments, context: &Context) -> Result {
    let StatusArguments { axis, options, .. } = arguments;
    let file = options.gateway.setup.config.as_deref();
    let chosen = axis.choose(file, false, context)?;
    let context = &chosen.context(context).on_stderr(options.capture.is_on_output());
    let mut options = options.clone();
    if file.is_some() && context::open(context.global, context.global.master())?.is_some() {
        // The service has configured the gateway; the file describes the axis only.
        options.gateway.setup.config = None;
    }
    let has_end = !arguments.watch || arguments.seconds.is_some();
    let link = start(&options, chosen.target.channel, has_end, context)?;
    let client = NodeClient::new(link, chosen.target, SDO_TIMEOUT);
    client.run(|client| {
        let report = read(client, &chosen)?;
        if arguments.watch {
            return watch(client, &chosen, report, arguments, context);
        }
        context.output.data(&report, |out| print(&report, out))?;
        if report.has_fault { Err(Failure::ProblemsFound) } else { Ok(()) }
    })
}

fn read(client: &mut NodeClient, chosen: &ChosenAxis) -> Result<DriveReport> {
    // A node without a statusword is not a drive.
    let statusword = chosen.config.object_index(object::STATUSWORD);
    let Some(_) = client.number(statusword, 0)? else {
        return Err(Failure::Rejected(format!(
            "{} has no statusword 0x{statusword:04X}: it is not a drive (CiA 402), or has fewer axes; \
             `ecan node info` shows the node",
            chosen.label
        )));
    };
    let period_ms = client.number(object::PRODUCER_HEARTBEAT, 0)?.unwrap_or(0);
    if period_ms > 0 && client.state().is_none() {
        let time = Duration::from_millis((period_ms * 2 + 100).min(MOST_HEARTBEAT_MS));
        client.run_for(time, |observed| observed.state().is_some())?;
    }
    let state = client.state().map(state_name);
    DriveReport::read(chosen.label.clone(), chosen.units, state, &mut |index, subindex| {
        client.number(chosen.config.object_index(index), subindex)
    })
}

fn watch(
    client: &mut NodeClient,
    chosen: &ChosenAxis,
    first: DriveReport,
    arguments: &StatusArguments,
    context: &Context,
) -> Result {
    let start_ns = client.link.service.now_ns();
    let mut last = String::new();
    let mut report = first;
    loop {
        let elapsed_ns = client.link.service.now_ns().saturating_sub(start_ns);
        let line = report.line();
        if line != last {
            let seconds = elapsed_ns as f64 / 1e9;
            context.output.data(&report, |out| writeln!(out, "{seconds:.1} s: {line}"))?;
            last = line;
        }
        let most_ns = arguments.seconds.map(|seconds| u64::from(seconds) * 1_000_000_000);
        if most_ns.is_some_and(|most| elapsed_ns >= most) {
            return Ok(());
        }
        let next = client.run_for(WATCH, |_| false).and_then(|_| read(client, chosen));
        report = match next {
            // The user ends it.
            Err(Failure::Incomplete(_)) if client.link.service.is_interrupted() => return Ok(()),
            next => next?,
        };
    }
}

/// DC link voltage, in mV.
const DC_LINK: u16 = 0x6079;
/// Voltage below which a power supply counts as off, in mV.
const NO_VOLTAGE_MV: u64 = 10_000;

/// A bit of the statusword.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct StatusBit {
    pub bit: u8,
    pub name: &'static str,
    pub is_set: bool,
}

/// Reason for which a drive is not enabled, and the remedy.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Obstacle {
    pub reason: String,
    pub remedy: String,
}

/// State of a drive. `None` for an object that the drive does not have.
#[derive(Clone, Debug, Serialize)]
pub struct DriveReport {
    pub axis: String,
    pub nmt_state: Option<&'static str>,
    pub statusword: u16,
    /// `None` for a combination of bits that CiA 402 does not define.
    pub state: Option<String>,
    pub bits: Vec<StatusBit>,
    pub controlword: Option<u16>,
    pub mode: Option<i8>,
    pub mode_text: Option<String>,
    pub error_code: Option<u16>,
    pub error_text: Option<String>,
    pub error_register: Option<u8>,
    pub unit: String,
    pub actual_steps: Option<i32>,
    pub position: Option<f64>,
    /// In units of the drive's velocity.
    pub velocity: Option<i32>,
    /// In thousandths of the rated torque.
    pub torque: Option<i16>,
    pub following_error_steps: Option<i32>,
    pub dc_link_mv: Option<u64>,
    pub digital_inputs: Option<u32>,
    pub is_enabled: bool,
    pub has_fault: bool,
    pub obstacles: Vec<Obstacle>,
    #[serde(skip)]
    units: AxisUnits,
}

/// Reads an object as a number; `None` if the drive does not have it.
pub type ReadObject<'a> = &'a mut dyn FnMut(u16, u8) -> Result<Option<u64>>;

impl DriveReport {
    /// Reads the objects. A drive without a statusword counts as one with 0.
    pub fn read(
        axis: String,
        units: AxisUnits,
        nmt_state: Option<&'static str>,
        read: ReadObject<'_>,
    ) -> Result<Self> {
        let word = Statusword(read(object::STATUSWORD, 0)?.unwrap_or(0) as u16);
        let mode = read(object::MODE_DISPLAY, 0)?.map(|raw| raw as u8 as i8);
        let error_code = read(object::ERROR_CODE, 0)?.map(|raw| raw as u16);
        let actual = read(object::POSITION_ACTUAL, 0)?.map(|raw| raw as u32 as i32);
        let mut report = Self {
            axis,
            nmt_state,
            statusword: word.0,
            state: word.state().map(|state| state.to_string()),
            bits: bits(word, mode.and_then(OperatingMode::from_raw)),
            controlword: read(object::CONTROLWORD, 0)?.map(|raw| raw as u16),
            mode,
            mode_text: mode.map(mode_text),
            error_code,
            error_text: error_code
                .filter(|code| *code != 0)
                .and_then(error_code_text)
                .map(str::to_owned),
            error_register: read(object::ERROR_REGISTER, 0)?.map(|raw| raw as u8),
            unit: units.unit.to_string(),
            actual_steps: actual,
            position: actual.map(|steps| units.position(steps.into())),
            velocity: read(object::VELOCITY_ACTUAL, 0)?.map(|raw| raw as u32 as i32),
            torque: read(object::TORQUE_ACTUAL, 0)?.map(|raw| raw as u16 as i16),
            following_error_steps: read(object::FOLLOWING_ERROR, 0)?.map(|raw| raw as u32 as i32),
            dc_link_mv: read(DC_LINK, 0)?,
            digital_inputs: read(object::DIGITAL_INPUTS, 0)?.map(|raw| raw as u32),
            is_enabled: word.state() == Some(DriveState::OperationEnabled),
            has_fault: matches!(
                word.state(),
                Some(DriveState::Fault | DriveState::FaultReactionActive)
            ),
            obstacles: Vec::new(),
            units,
        };
        report.obstacles = obstacles(&report, word);
        Ok(report)
    }

    /// State and positions in a line, for a live view.
    pub fn line(&self) -> String {
        let state = self.state.as_deref().unwrap_or("state not defined");
        let position = self.actual_steps.map_or_else(
            || "position not reported".to_owned(),
            |steps| format!("position {}", self.units.position_text(steps.into())),
        );
        let error = match self.error_code {
            Some(code) if code != 0 => format!(", error code {}", self.code_text(code)),
            _ => String::new(),
        };
        format!("{state} (0x{:04X}), {position}{error}", self.statusword)
    }

    fn code_text(&self, code: u16) -> String {
        match &self.error_text {
            Some(text) => format!("0x{code:04X} {text}"),
            None => format!("0x{code:04X}"),
        }
    }
}

fn mode_text(mode: i8) -> String {
    match (OperatingMode::from_raw(mode), mode) {
        (Some(mode), _) => mode.to_string(),
        (None, 0) => "none".to_owned(),
        (None, other) => format!("{other}, of the manufacturer"),
    }
}

/// The bits with their names of CiA 402-2, 8.4.2; those of bits 10, 12 and 13 depend on the mode.
fn bits(word: Statusword, mode: Option<OperatingMode>) -> Vec<StatusBit> {
    use OperatingMode as Mode;
    let cyclic =
        matches!(mode, Some(Mode::CyclicPosition | Mode::CyclicVelocity | Mode::CyclicTorque));
    let bit_12 = match mode {
        _ if cyclic => "follows its target",
        Some(Mode::ProfilePosition) => "set-point acknowledged",
        Some(Mode::ProfileVelocity) => "speed is 0",
        Some(Mode::InterpolatedPosition) => "interpolation active",
        Some(Mode::Homing) => "home position found",
        _ => "mode bit 12",
    };
    let bit_13 = match mode {
        Some(Mode::ProfilePosition | Mode::CyclicPosition) => "following error",
        Some(Mode::ProfileVelocity) => "maximum slippage",
        Some(Mode::Homing) => "homing error",
        _ => "mode bit 13",
    };
    let bit_10 = if cyclic { "mode bit 10" } else { "target reached" };
    let names = [
        "ready to switch on",
        "switched on",
        "operation enabled",
        "fault",
        "voltage enabled",
        "no quick stop",
        "switch on disabled",
        "warning",
        "manufacturer 8",
        "remote",
        bit_10,
        "internal limit active",
        bit_12,
        bit_13,
        "manufacturer 14",
        "manufacturer 15",
    ];
    (0..)
        .zip(names)
        .map(|(bit, name)| StatusBit { bit, name, is_set: word.has(1 << bit) })
        .collect()
}

fn obstacles(report: &DriveReport, word: Statusword) -> Vec<Obstacle> {
    let mut found = Vec::new();
    let mut add = |reason: String, remedy: &str| {
        found.push(Obstacle { reason, remedy: remedy.to_owned() });
    };
    if report.is_enabled {
        return found;
    }
    match word.state() {
        Some(DriveState::Fault | DriveState::FaultReactionActive) => {
            let code = report.error_code.filter(|code| *code != 0);
            let code = code.map_or_else(
                || ", the drive reports no error code".to_owned(),
                |code| format!(": error code {}", report.code_text(code)),
            );
            add(
                format!("the drive is in fault{code}"),
                "remove the cause (`ecan node emcy` lists the last errors), then `ecan axis enable --reset-fault`",
            );
        }
        Some(DriveState::NotReadyToSwitchOn) => add(
            "the drive is starting, or its self-test has failed".to_owned(),
            "wait some seconds; check the supply of the drive and its display",
        ),
        Some(DriveState::QuickStopActive) => add(
            "a quick stop is active or has ended".to_owned(),
            "`ecan axis stop` switches the drive off; then enable it",
        ),
        None => add(
            format!("the statusword 0x{:04X} has no state of CiA 402", report.statusword),
            "check 0x6041 with the manual of the drive",
        ),
        Some(_) => {}
    }
    if !word.has(Statusword::REMOTE) {
        add(
            "the drive does not follow the controlword (bit 9, remote, is 0)".to_owned(),
            "end local control: disconnect the program of the maker, or release its enable switch",
        );
    }
    let is_low = report.dc_link_mv.is_some_and(|mv| mv < NO_VOLTAGE_MV);
    if is_low {
        let volts = report.dc_link_mv.unwrap_or(0) as f64 / 1_000.0;
        add(
            format!("the DC link has {volts:.1} V"),
            "switch the power supply of the motor on; check fuses, contactor and emergency stop",
        );
    }
    let waits_for_voltage = !word.has(1 << 4)
        && matches!(word.state(), Some(DriveState::ReadyToSwitchOn | DriveState::SwitchedOn));
    if waits_for_voltage && !is_low {
        add(
            "the power stage has no voltage (bit 4, voltage enabled, is 0)".to_owned(),
            "check the power supply of the motor, STO and the hardware enable input",
        );
    }
    if word.has(Statusword::INTERNAL_LIMIT) {
        add(
            "an internal limit is active (bit 11)".to_owned(),
            "check limit switches (0x60FD), software limits (0x607D), current and speed limits",
        );
    }
    let inputs = report.digital_inputs.unwrap_or(0);
    for (bit, name, direction) in [(0, "negative", "positive"), (1, "positive", "negative")] {
        if inputs & 1 << bit != 0 {
            add(
                format!("the {name} limit switch is active (0x60FD bit {bit})"),
                match direction {
                    "positive" => {
                        "move in positive direction, or check the switch and its polarity"
                    }
                    _ => "move in negative direction, or check the switch and its polarity",
                },
            );
        }
    }
    if found.is_empty() {
        found.push(Obstacle {
            reason: "the drive reports no obstacle; no program has enabled it".to_owned(),
            remedy: "`ecan axis enable`".to_owned(),
        });
    }
    found
}

/// Prints the obstacles to enabling the drive.
pub fn print_obstacles(report: &DriveReport, out: &mut dyn Write) -> io::Result<()> {
    if report.is_enabled {
        return Ok(());
    }
    writeln!(out, "not enabled, because:")?;
    for (number, Obstacle { reason, remedy }) in (1..).zip(&report.obstacles) {
        writeln!(out, "  {number}. {reason}")?;
        writeln!(out, "     next: {remedy}")?;
    }
    Ok(())
}

/// Prints the whole report.
pub fn print(report: &DriveReport, out: &mut dyn Write) -> io::Result<()> {
    let names = |is_set: bool| {
        // A bit without a meaning in CiA 402 is of interest if it is set.
        let has_meaning = |bit: &StatusBit| {
            is_set || !(bit.name.starts_with("manufacturer") || bit.name.starts_with("mode bit"))
        };
        let bits = report.bits.iter().filter(|bit| bit.is_set == is_set && has_meaning(bit));
        let names: Vec<_> = bits.map(|bit| format!("{} ({})", bit.name, bit.bit)).collect();
        if names.is_empty() { "none".to_owned() } else { names.join(", ") }
    };
    let none = || "not reported".to_owned();
    let state = report.state.as_deref().unwrap_or("not defined by CiA 402");
    let mut rows = vec![
        ["axis".to_owned(), report.axis.clone()],
        ["state".to_owned(), format!("{state} (statusword 0x{:04X})", report.statusword)],
        ["bits set".to_owned(), names(true)],
        ["bits clear".to_owned(), names(false)],
        [
            "NMT state".to_owned(),
            report.nmt_state.unwrap_or("not reported (no heartbeat)").to_owned(),
        ],
        ["mode".to_owned(), report.mode_text.clone().unwrap_or_else(none)],
    ];
    if let Some(code) = report.error_code {
        let text = if code == 0 { "none".to_owned() } else { report.code_text(code) };
        rows.push(["error code".to_owned(), text]);
    }
    if let Some(register) = report.error_register {
        rows.push(["error register".to_owned(), ErrorRegister(register).to_string()]);
    }
    rows.push([
        "position".to_owned(),
        report.actual_steps.map_or_else(none, |steps| report.units.position_text(steps.into())),
    ]);
    if let Some(velocity) = report.velocity {
        rows.push(["velocity".to_owned(), format!("{velocity} (unit of the drive)")]);
    }
    if let Some(torque) = report.torque {
        rows.push([
            "torque".to_owned(),
            format!("{:.1} % of the rated torque", f64::from(torque) / 10.0),
        ]);
    }
    if let Some(error) = report.following_error_steps {
        rows.push(["following error".to_owned(), report.units.length_text(error.into())]);
    }
    if let Some(mv) = report.dc_link_mv {
        rows.push(["DC link".to_owned(), format!("{:.1} V", mv as f64 / 1_000.0)]);
    }
    if let Some(inputs) = report.digital_inputs {
        rows.push(["digital inputs".to_owned(), inputs_text(inputs)]);
    }
    output::print(out, rows, |row| row)?;
    print_obstacles(report, out)
}

fn inputs_text(inputs: u32) -> String {
    let names = ["negative limit switch", "positive limit switch", "home switch", "interlock"];
    let active: Vec<_> = (0..)
        .zip(names)
        .filter(|(bit, _)| inputs & 1 << bit != 0)
        .map(|(_, name)| name.to_owned())
        .chain(
            (inputs >> 16 != 0)
                .then(|| format!("inputs of the manufacturer 0x{:04X}", inputs >> 16)),
        )
        .collect();
    if active.is_empty() { "none active".to_owned() } else { active.join(", ") }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use ecan_cia402::Scale;

    use super::*;
    use crate::commands::axis::unit::Unit;

    fn report(objects: &[(u16, u64)]) -> DriveReport {
        let objects: BTreeMap<_, _> = objects.iter().copied().collect();
        let units = AxisUnits::new(Unit::Deg, Scale::steps_per_turn(3_600.0), 0);
        DriveReport::read("axis".to_owned(), units, None, &mut |index, _| {
            Ok(objects.get(&index).copied())
        })
        .unwrap()
    }

    fn reasons(objects: &[(u16, u64)]) -> Vec<String> {
        report(objects).obstacles.into_iter().map(|obstacle| obstacle.reason).collect()
    }

    #[test]
    fn each_obstacle_is_named() {
        for (objects, expected) in [
            (&[(0x6041, 0x0237)][..], &[][..]),
            (&[(0x6041, 0x0240)], &["the drive reports no obstacle; no program has enabled it"]),
            (
                &[(0x6041, 0x0008), (0x603F, 0x2310)],
                &[
                    "the drive is in fault: error code 0x2310 continuous over-current at the output",
                    "the drive does not follow the controlword (bit 9, remote, is 0)",
                ],
            ),
            (&[(0x6041, 0x0208)], &["the drive is in fault, the drive reports no error code"]),
            (&[(0x6041, 0x0221), (0x6079, 2_500)], &["the DC link has 2.5 V"]),
            (
                &[(0x6041, 0x0221), (0x6079, 48_000)],
                &["the power stage has no voltage (bit 4, voltage enabled, is 0)"],
            ),
            (
                &[(0x6041, 0x0A31), (0x60FD, 2)],
                &[
                    "an internal limit is active (bit 11)",
                    "the positive limit switch is active (0x60FD bit 1)",
                ],
            ),
            (&[(0x6041, 0x0201)], &["the statusword 0x0201 has no state of CiA 402"]),
            (&[(0x6041, 0x0217)], &["a quick stop is active or has ended"]),
        ] {
            assert_eq!(reasons(objects), expected, "{objects:?}");
        }
    }

    #[test]
    fn mode_determines_the_names_of_its_bits() {
        let name = |mode: u64, bit: usize| report(&[(0x6041, 0), (0x6061, mode)]).bits[bit].name;
        assert_eq!((name(8, 12), name(8, 13)), ("follows its target", "following error"));
        assert_eq!((name(6, 12), name(6, 13)), ("home position found", "homing error"));
        assert_eq!((name(1, 10), name(8, 10)), ("target reached", "mode bit 10"));
        assert_eq!((name(0xFF, 12), name(0, 13)), ("mode bit 12", "mode bit 13"));
    }

    #[test]
    fn signed_objects_keep_their_sign() {
        let report = report(&[
            (0x6041, 0x1237),
            (0x6064, 0xFFFF_FFF6),
            (0x6077, 0xFFF6),
            (0x6061, 8),
            (0x60FD, 0x0003_0004),
        ]);
        assert_eq!((report.actual_steps, report.torque), (Some(-10), Some(-10)));
        assert_eq!(report.line(), "operation enabled (0x1237), position -1.000 deg");
        let mut text = Vec::new();
        print(&report, &mut text).unwrap();
        let text = String::from_utf8(text).unwrap();
        assert!(text.contains("torque          -1.0 % of the rated torque\n"), "{text}");
        assert!(text.contains("home switch, inputs of the manufacturer 0x0003\n"), "{text}");
        assert!(!text.contains("not enabled"), "{text}");
    }
}
