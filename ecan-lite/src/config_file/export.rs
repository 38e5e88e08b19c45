//! The startup sequence of a gateway as lists for other EtherCAT masters (manual 5.4.3, 5.4.5).
//!
//! CSV and `ethercat` lines execute the checks of the sequence; the startup lists of TwinCAT and
//! CODESYS can only write, and contain the expected values as comments. What a person enters in the
//! project of the master is a text of its own.

use std::fmt::{self, Write};
use std::time::Duration;

use ecan_host::{AdapterConfig, DcSync, Expectation, StartupStep};
use ecan_protocol::mapping::{
    CHUNK_BYTES, Direction, SyncManagerLayout, assignment_index, pdo_map_index,
};
use ecan_protocol::object::{ObjectType, SdoWrite, describe, lookup};

/// Format of a list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// One line per step: action, index, subindex, type, value, comment. `write` writes. The `expect`
    /// actions read and compare: equal (`expect`), at least or at most (`expect_at_least`,
    /// `expect_at_most`), all bits set (`expect_bits`), one bit set (`expect_any_bit`), one of
    /// several values separated by bars (`expect_one_of`), or a value in the bits of a mask
    /// (`expect_masked`, value and mask separated by a bar).
    Csv,
    /// XML of the startup list of TwinCAT, for the transition from PREOP to SAFEOP. Comments have the
    /// checks, and the steps by hand.
    TwinCat,
    /// Columns of the startup parameters of CODESYS, separated by semicolons. The comment of a write has
    /// the checks that follow it.
    Codesys,
    /// Calls of the `ethercat` tool of IgH. Comments have the steps by hand.
    Ethercat,
    /// Text of the steps by hand, for each master: PDO chunks, lengths of the sync managers, process
    /// image, cycle, distributed clocks, and the values to read after the startup (manual 5.1.1,
    /// 5.4.1, 5.4.3, 5.4.5).
    Steps,
}

/// Process data of a gateway, which are declared in the project of a master.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProcessData {
    /// N of the RxPDO, in chunks of 128 bytes.
    pub rx_multiplier: u8,
    /// N of the TxPDO.
    pub tx_multiplier: u8,
    /// Cycle of the master.
    pub cycle: Duration,
    /// Distributed clocks with Sync0.
    pub dc: Option<DcSync>,
}

impl ProcessData {
    /// The process data of a gateway in a configuration; `None` if the gateway does not exist.
    pub fn of(config: &AdapterConfig, gateway: usize) -> Option<Self> {
        let slave = config.slaves.get(gateway)?;
        let (rx_multiplier, tx_multiplier) = (slave.rx_multiplier, slave.tx_multiplier);
        Some(Self { rx_multiplier, tx_multiplier, cycle: config.cycle, dc: config.dc })
    }

    /// The steps by hand, a line each.
    fn lines(&self) -> Vec<String> {
        let directions =
            [(Direction::RxPdo, self.rx_multiplier), (Direction::TxPdo, self.tx_multiplier)];
        let each = |line: &dyn Fn(Direction, usize) -> String| {
            directions.map(|(direction, n)| line(direction, n.into())).join("; ")
        };
        let sii = each(&|direction, _| {
            let SyncManagerLayout { start, length, control, .. } =
                SyncManagerLayout::required(direction);
            let name = manager(direction);
            format!("{name} has start 0x{start:04X}, {length} bytes, control byte 0x{control:02X}")
        });
        let chunks = each(&|direction, n| {
            let (name, assignment) = (manager(direction), assignment_index(direction));
            let [first, last] =
                [0, n.saturating_sub(1)].map(|chunk| pdo_map_index(direction, chunk as u8));
            format!("for {name} (0x{assignment:04X}) the first {n}, 0x{first:04X} to 0x{last:04X}")
        });
        let lengths =
            each(&|direction, n| format!("{} {} bytes", manager(direction), n * CHUNK_BYTES));
        let image = each(&|direction, n| {
            let (access, data) = match direction {
                Direction::RxPdo => ("outputs", 0x7000),
                Direction::TxPdo => ("inputs", 0x6000),
            };
            let bytes = n * CHUNK_BYTES;
            format!(
                "{access} ARRAY[0..{}] OF BYTE, at offset 16 * u the 16 bytes of the entry 0x{data:04X} + \
                 0x10 * u, u = 0 to {}",
                bytes.saturating_sub(1),
                (bytes / 16).saturating_sub(1)
            )
        });
        let us = |duration: Duration| duration.as_nanos() as f64 / 1e3;
        let clocks = match self.dc {
            None => "off (the gateway runs synchronous to process data)".to_owned(),
            Some(dc) => format!(
                "Sync0 with AssignActivate 0x{:04X}, cycle {} us, shift {} us",
                dc.assign_activate,
                us(dc.cycle),
                us(dc.shift)
            ),
        };
        [
            format!("SII, and the ESI file made of it: {sii} (manual 15.7)"),
            format!("PDO chunks: select {chunks}; skip none, keep the order (5.4.1)"),
            format!("lengths of the sync managers: {lengths} (5.4.1)"),
            format!("process image: {image} (5.1.1)"),
            format!("cycle: {} us", us(self.cycle)),
            format!("distributed clocks: {clocks} (15.6)"),
            "startup list: execute the writes in PREOP, before SAFEOP, in their order (5.4.2)"
                .to_owned(),
        ]
        .into_iter()
        .zip(1..)
        .map(|(line, number)| format!("{number}. {line}"))
        .collect()
    }
}

/// Name of the sync manager of a direction.
fn manager(direction: Direction) -> &'static str {
    match direction {
        Direction::RxPdo => "SM2",
        Direction::TxPdo => "SM3",
    }
}

/// Address of a slave in calls of the `ethercat` tool.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SlaveAddress {
    /// Index of the master.
    pub master: u32,
    /// Alias that the position is relative to; 0 is the start of the bus.
    pub alias: u16,
    /// Position.
    pub position: u16,
}

impl fmt::Display for SlaveAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { master, alias, position } = self;
        if *master != 0 {
            write!(f, "-m {master} ")?;
        }
        if *alias != 0 {
            write!(f, "-a {alias} ")?;
        }
        write!(f, "-p {position}")
    }
}

/// Returns the list in a format; only the `ethercat` lines use the address.
pub fn export(
    format: Format,
    steps: &[StartupStep],
    address: SlaveAddress,
    process_data: &ProcessData,
) -> String {
    match format {
        Format::Csv => csv(steps),
        Format::TwinCat => twincat(steps, process_data),
        Format::Codesys => codesys(steps),
        Format::Ethercat => ethercat(steps, address, process_data),
        Format::Steps => steps_by_hand(steps, process_data),
    }
}

/// `0x8010:02, expected 0`; `None` for a write.
fn check(step: &StartupStep) -> Option<String> {
    let (index, subindex) = step.object();
    match step {
        StartupStep::Expect { expected, .. } => {
            Some(format!("0x{index:04X}:{subindex:02}, expected {expected}"))
        }
        StartupStep::Download(_) => None,
    }
}

/// The writes, each with the text of its checks: those before the first one, and those that follow.
fn writes_with_checks(steps: &[StartupStep]) -> Vec<(&SdoWrite, String)> {
    let mut writes: Vec<(&SdoWrite, String)> = Vec::new();
    let mut before = String::new();
    for step in steps {
        if let StartupStep::Download(write) = step {
            writes.push((write, std::mem::take(&mut before)));
        } else if let Some(check) = check(step) {
            let (text, word) = match writes.last_mut() {
                Some((_, text)) => (text, "then"),
                None => (&mut before, "before,"),
            };
            let _ = write!(text, "; {word} check {check}");
        }
    }
    writes
}

fn steps_by_hand(steps: &[StartupStep], process_data: &ProcessData) -> String {
    let mut out = String::from("Steps by hand in the project of the EtherCAT master:\n");
    for line in process_data.lines() {
        let _ = writeln!(out, "{line}");
    }
    let _ = writeln!(out, "Values to read around the writes of the startup list:");
    let mut writes = 0;
    for step in steps {
        let (index, subindex) = step.object();
        match check(step) {
            Some(check) => {
                let _ = writeln!(out, "after {writes} writes: {check} ({})", name(index, subindex));
            }
            None => writes += 1,
        }
    }
    out
}

/// Name of the entry, without its numbers.
fn name(index: u16, subindex: u8) -> String {
    match lookup(index, subindex) {
        Some((object, entry)) => format!("{}, {}", object.name, entry.name),
        None => describe(index, subindex).to_string(),
    }
}

fn type_name(ty: ObjectType) -> &'static str {
    match ty {
        ObjectType::U8 => "uint8",
        ObjectType::U16 => "uint16",
        ObjectType::I32 => "int32",
        _ => "uint32",
    }
}

fn expected_type(index: u16, subindex: u8) -> &'static str {
    type_name(lookup(index, subindex).map_or(ObjectType::U32, |(_, entry)| entry.ty))
}

/// A comparison in CSV and in the shell function `check`, with its values.
fn comparison(expected: &Expectation) -> (&'static str, &'static str, Vec<u64>) {
    match *expected {
        Expectation::Equals(value) => ("expect", "-eq", vec![value]),
        Expectation::AtLeast(value) => ("expect_at_least", "-ge", vec![value]),
        Expectation::AtMost(value) => ("expect_at_most", "-le", vec![value]),
        Expectation::HasBits(value) => ("expect_bits", "bits", vec![value]),
        Expectation::HasAny(value) => ("expect_any_bit", "any", vec![value]),
        Expectation::OneOf(values) => ("expect_one_of", "of", values.to_vec()),
        Expectation::Masked { value, mask } => ("expect_masked", "masked", vec![value, mask]),
    }
}

fn joined(values: &[u64], separator: &str) -> String {
    values.iter().map(ToString::to_string).collect::<Vec<_>>().join(separator)
}

/// The text, in quotation marks if it needs them.
fn quoted(text: &str) -> String {
    if text.contains([',', ';', '"']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

fn csv(steps: &[StartupStep]) -> String {
    let mut out = String::from("action,index,subindex,type,value,comment\n");
    for step in steps {
        let (index, subindex) = step.object();
        let (action, ty, values) = match step {
            StartupStep::Download(write) => {
                ("write", type_name(write.ty), vec![write.value.into()])
            }
            StartupStep::Expect { expected, .. } => {
                let (action, _, values) = comparison(expected);
                (action, expected_type(index, subindex), values)
            }
        };
        let comment = quoted(&name(index, subindex));
        let value = joined(&values, "|");
        let _ = writeln!(out, "{action},0x{index:04X},{subindex},{ty},{value},{comment}");
    }
    out
}

/// Text in a comment of XML, which cannot contain two hyphens.
fn comment(text: &str) -> String {
    format!("<!-- {} -->", text.replace("--", "- -"))
}

fn twincat(steps: &[StartupStep], process_data: &ProcessData) -> String {
    let mut out = String::from("<?xml version=\"1.0\" encoding=\"utf-8\"?>\n");
    for line in process_data.lines() {
        let _ = writeln!(out, "{}", comment(&line));
    }
    out.push_str("<EtherCATMailbox>\n  <CoE>\n    <InitCmds>\n");
    for step in steps {
        let StartupStep::Download(write) = step else {
            let check = check(step).unwrap_or_default();
            let _ = writeln!(out, "      {}", comment(&format!("check {check}")));
            continue;
        };
        let (bytes, length) = write.bytes();
        let data: String = bytes
            .get(..length)
            .unwrap_or_default()
            .iter()
            .map(|byte| format!("{byte:02x}"))
            .collect();
        let name = name(write.index, write.subindex);
        let _ = write!(
            out,
            "      <InitCmd>\n        <Transition>PS</Transition>\n        \
             <Comment><![CDATA[{name}]]></Comment>\n        <Timeout>5000</Timeout>\n        \
             <Ccs>1</Ccs>\n        <Index>{}</Index>\n        <SubIndex>{}</SubIndex>\n        \
             <Data>{data}</Data>\n      </InitCmd>\n",
            write.index, write.subindex
        );
    }
    out.push_str("    </InitCmds>\n  </CoE>\n</EtherCATMailbox>\n");
    out
}

fn codesys(steps: &[StartupStep]) -> String {
    let mut out = String::from(
        "Line;Index:Subindex;Name;Value;Bit length;Abort on error;Jump to line on error;Next line;\
         Comment\n",
    );
    for (line, (write, checks)) in writes_with_checks(steps).into_iter().enumerate() {
        let (index, subindex) = (write.index, write.subindex);
        let entry = lookup(index, subindex).map_or("", |(_, entry)| entry.name);
        let object = lookup(index, subindex).map_or("", |(object, _)| object.name);
        let bits = write.bytes().1 * 8;
        let (entry, comment) = (quoted(entry), quoted(&format!("{object}{checks}")));
        let _ = writeln!(
            out,
            "{};16#{index:04X}:16#{subindex:02X};{entry};{};{bits};TRUE;FALSE;0;{comment}",
            line + 1,
            write.value
        );
    }
    out
}

/// Shell functions: a transfer, and the comparison of a value, which `upload` prints in hexadecimal
/// and decimal.
const FUNCTIONS: &str = r#"#!/bin/sh
set -e
# After a scan the master reads the SDO dictionary, about a second per slave. Other transfers fail
# meanwhile, and are repeated.
transfer() {
    attempts=0
    until answer=$(ethercat "$@" 2>&1); do
        attempts=$((attempts + 1))
        case $answer in
        *"Input/output error"*) [ $attempts -lt 10 ] && sleep 1 && continue ;;
        esac
        echo "ethercat $*: $answer" >&2
        exit 1
    done
    [ -z "$answer" ] || echo "$answer"
}
check() {
    value=${1##* }
    case $2 in
    bits) [ $((value & $3)) -eq $(($3)) ] ;;
    any) [ $((value & $3)) -ne 0 ] ;;
    masked) [ $((value & ${3#* })) -eq $((${3% *})) ] ;;
    of) case " $3 " in *" $value "*) ;; *) false ;; esac ;;
    *) [ "$value" "$2" "$3" ] ;;
    esac || { echo "$4: reads $value, expected $2 $3" >&2; exit 1; }
}
"#;

fn ethercat(steps: &[StartupStep], address: SlaveAddress, process_data: &ProcessData) -> String {
    let mut out = String::from(FUNCTIONS);
    for line in process_data.lines() {
        let _ = writeln!(out, "# {line}");
    }
    for step in steps {
        let (index, subindex) = step.object();
        let comment = name(index, subindex);
        let object = format!("0x{index:04x} {subindex}");
        let _ = match step {
            StartupStep::Download(write) => writeln!(
                out,
                "transfer download {address} --type {} {object} {}  # {comment}",
                type_name(write.ty),
                write.value
            ),
            StartupStep::Expect { expected, .. } => {
                let (_, comparison, values) = comparison(expected);
                let (ty, value) = (expected_type(index, subindex), joined(&values, " "));
                writeln!(
                    out,
                    "check \"$(transfer upload {address} --type {ty} {object})\" {comparison} \
                     \"{value}\" \"0x{index:04X}:{subindex:02} {comment}\""
                )
            }
        };
    }
    out
}
