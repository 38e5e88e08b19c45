//! The startup sequence of a gateway as lists for other EtherCAT masters (manual 5.4.3, 5.4.5).
//!
//! CSV and `ethercat` lines contain the checks of the sequence; the startup lists of TwinCAT and
//! CODESYS can only write.

use std::fmt::{self, Write};

use ecan_host::{Expectation, StartupStep};
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
    /// XML of the startup list of TwinCAT, for the transition from PREOP to SAFEOP.
    TwinCat,
    /// Columns of the startup parameters of CODESYS, separated by semicolons.
    Codesys,
    /// Calls of the `ethercat` tool of IgH.
    Ethercat,
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
pub fn export(format: Format, steps: &[StartupStep], address: SlaveAddress) -> String {
    match format {
        Format::Csv => csv(steps),
        Format::TwinCat => twincat(steps),
        Format::Codesys => codesys(steps),
        Format::Ethercat => ethercat(steps, address),
    }
}

fn downloads(steps: &[StartupStep]) -> impl Iterator<Item = &SdoWrite> {
    steps.iter().filter_map(|step| match step {
        StartupStep::Download(write) => Some(write),
        StartupStep::Expect { .. } => None,
    })
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

fn twincat(steps: &[StartupStep]) -> String {
    let mut out = String::from(
        "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<EtherCATMailbox>\n  <CoE>\n    <InitCmds>\n",
    );
    for write in downloads(steps) {
        let (bytes, length) = write.bytes();
        let data: String = bytes
            .get(..length)
            .unwrap_or_default()
            .iter()
            .map(|byte| format!("{byte:02x}"))
            .collect();
        let comment = name(write.index, write.subindex);
        let _ = write!(
            out,
            "      <InitCmd>\n        <Transition>PS</Transition>\n        \
             <Comment><![CDATA[{comment}]]></Comment>\n        <Timeout>5000</Timeout>\n        \
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
    for (line, write) in downloads(steps).enumerate() {
        let (index, subindex) = (write.index, write.subindex);
        let entry = lookup(index, subindex).map_or("", |(_, entry)| entry.name);
        let object = lookup(index, subindex).map_or("", |(object, _)| object.name);
        let bits = write.bytes().1 * 8;
        let (entry, object) = (quoted(entry), quoted(object));
        let _ = writeln!(
            out,
            "{};16#{index:04X}:16#{subindex:02X};{entry};{};{bits};TRUE;FALSE;0;{object}",
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

fn ethercat(steps: &[StartupStep], address: SlaveAddress) -> String {
    let mut out = String::from(FUNCTIONS);
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
