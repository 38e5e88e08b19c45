//! Readers of startup lists, independent of the code that writes them.

use std::fmt::Write as _;
use std::ops::Deref;
use std::process::{Command, Output};

use ecan_host::{Expectation, StartupStep};
use ethercrab::error::Error;
use ethercrab::{SubDevice, SubDeviceRef};

/// A line of a list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Line {
    Write { index: u16, subindex: u8, bytes: Vec<u8> },
    Check { action: String, index: u16, subindex: u8, ty: String, value: u32 },
}

impl Line {
    fn write(index: u16, subindex: u8, ty: &str, value: u32) -> Self {
        let size = match ty {
            "uint8" => 1,
            "uint16" => 2,
            "uint32" => 4,
            other => panic!("{other}"),
        };
        Self::of_size(index, subindex, size, value)
    }

    fn of_size(index: u16, subindex: u8, size: usize, value: u32) -> Self {
        assert_eq!(u64::from(value) >> (8 * size), 0, "0x{index:04X}:{subindex} = {value}");
        Self::Write { index, subindex, bytes: value.to_le_bytes()[..size].to_vec() }
    }

    /// Writes, or reads and compares; true if the value is as expected.
    pub async fn replay<S>(&self, gateway: &SubDeviceRef<'_, S>) -> Result<bool, Error>
    where
        S: Deref<Target = SubDevice>,
    {
        let (action, index, subindex, ty, value) = match self {
            Self::Write { index, subindex, bytes } => {
                match bytes[..] {
                    [byte] => gateway.sdo_write(*index, *subindex, byte).await?,
                    [low, high] => gateway.sdo_write(*index, *subindex, [low, high]).await?,
                    [a, b, c, d] => gateway.sdo_write(*index, *subindex, [a, b, c, d]).await?,
                    _ => panic!("{self:?}"),
                }
                return Ok(true);
            }
            Self::Check { action, index, subindex, ty, value } => {
                (action.as_str(), *index, *subindex, ty.as_str(), *value)
            }
        };
        let found = match ty {
            "uint8" => gateway.sdo_read::<u8>(index, subindex).await?.into(),
            "uint16" => gateway.sdo_read::<u16>(index, subindex).await?.into(),
            "uint32" => gateway.sdo_read::<u32>(index, subindex).await?,
            other => panic!("{other}"),
        };
        Ok(match action {
            "expect" => found == value,
            "expect_at_least" => found >= value,
            "expect_at_most" => found <= value,
            "expect_bits" => found & value == value,
            other => panic!("{other}"),
        })
    }
}

/// The rows of a list with a head line; each has the columns of the head.
fn rows(list: &str, divider: u8, head: &[&str]) -> Vec<Vec<String>> {
    let mut reader = csv::ReaderBuilder::new().delimiter(divider).from_reader(list.as_bytes());
    assert_eq!(reader.headers().unwrap(), head);
    let fields = |row: csv::StringRecord| row.iter().map(str::to_owned).collect();
    reader.records().map(|row| fields(row.unwrap())).collect()
}

fn hexadecimal(text: &str, prefix: &str) -> u16 {
    u16::from_str_radix(text.strip_prefix(prefix).expect(text), 16).expect(text)
}

pub fn csv(list: &str) -> Vec<Line> {
    let rows = rows(list, b',', &["action", "index", "subindex", "type", "value", "comment"]);
    let line = |row: Vec<String>| {
        let [action, index, subindex, ty, value, _] = &row[..] else { panic!("{row:?}") };
        let (index, subindex) = (hexadecimal(index, "0x"), subindex.parse().unwrap());
        let value = value.parse().unwrap();
        match action.as_str() {
            "write" => Line::write(index, subindex, ty, value),
            _ => Line::Check { action: action.clone(), index, subindex, ty: ty.clone(), value },
        }
    };
    rows.into_iter().map(line).collect()
}

pub fn codesys(list: &str) -> Vec<Line> {
    let head = [
        "Line",
        "Index:Subindex",
        "Name",
        "Value",
        "Bit length",
        "Abort on error",
        "Jump to line on error",
        "Next line",
        "Comment",
    ];
    let line = |(nth, row): (usize, Vec<String>)| {
        let [number, object, name, value, bits, abort, jump, next, _] = &row[..] else {
            panic!("{row:?}")
        };
        assert_eq!(number, &nth.to_string());
        assert!(!name.is_empty(), "{row:?}");
        assert_eq!([abort.as_str(), jump, next], ["TRUE", "FALSE", "0"]);
        let (index, subindex) = object.split_once(':').unwrap();
        let subindex = u8::try_from(hexadecimal(subindex, "16#")).unwrap();
        let bits: usize = bits.parse().unwrap();
        assert!([8, 16, 32].contains(&bits), "{row:?}");
        Line::of_size(hexadecimal(index, "16#"), subindex, bits / 8, value.parse().unwrap())
    };
    (1..).zip(rows(list, b';', &head)).map(line).collect()
}

pub fn twincat(list: &str) -> Vec<Line> {
    let document = roxmltree::Document::parse(list).unwrap();
    let named = |node: &roxmltree::Node<'_, '_>, name: &str| {
        let mut found = node.children().filter(|child| child.has_tag_name(name));
        let only = found.next().unwrap_or_else(|| panic!("no {name}"));
        assert!(found.next().is_none(), "one {name}");
        only.id()
    };
    let get = |id| document.get_node(id).unwrap();
    let mut node = document.root_element();
    assert!(node.has_tag_name("EtherCATMailbox"));
    for name in ["CoE", "InitCmds"] {
        node = get(named(&node, name));
    }
    let commands = node.children().filter(roxmltree::Node::is_element);
    commands
        .map(|command| {
            assert!(command.has_tag_name("InitCmd"));
            let text = |name| get(named(&command, name)).text().unwrap();
            // A download in the transition from PREOP to SAFEOP.
            assert_eq!([text("Transition"), text("Ccs")], ["PS", "1"]);
            assert!(text("Timeout").parse::<u32>().unwrap() > 0 && !text("Comment").is_empty());
            let data = text("Data");
            let byte = |at| u8::from_str_radix(&data[at..at + 2], 16).unwrap();
            let bytes = (0..data.len()).step_by(2).map(byte).collect();
            let (index, subindex) = (text("Index").parse(), text("SubIndex").parse());
            Line::Write { index: index.unwrap(), subindex: subindex.unwrap(), bytes }
        })
        .collect()
}

/// The `ethercat` tool of the tests: records downloads, answers uploads from a table.
const STAND_IN: &str = r#"#!/bin/sh
command=$1
shift
[ "$1" = -m ] && shift 2
[ "$1" = -a ] && shift 2
[ "$1" = -p ] && shift 2
[ "$1" = --type ] || { echo "no type" >&2; exit 9; }
type=$2
shift 2
if [ $command = download ]; then echo "$type $1 $2 $3" >>"$DIRECTORY/downloads"; exit; fi
while read index subindex value; do
    if [ "$index $subindex" = "$1 $2" ]; then printf '0x%02x %d\n' $value $value; exit; fi
done <"$DIRECTORY/values"
exit 9
"#;

/// Runs a script of `ethercat` lines with a fake tool and returns its writes. Uploads return what the
/// steps expect, but 0 for the entry `wrong`.
pub fn run_script(
    script: &str,
    steps: &[StartupStep],
    wrong: Option<(u16, u8)>,
) -> (Output, Vec<Line>) {
    let directory = tempfile::tempdir().unwrap();
    write_program(&directory.path().join("ethercat"), STAND_IN);
    let mut values = String::new();
    for step in steps {
        let StartupStep::Expect { index, subindex, expected } = *step else { continue };
        let value = match expected {
            Expectation::Equals(value)
            | Expectation::AtLeast(value)
            | Expectation::AtMost(value)
            | Expectation::HasBits(value)
            | Expectation::HasAny(value)
            | Expectation::Masked { value, .. } => value,
            Expectation::OneOf(values) => values[0],
        };
        let value = if wrong == Some((index, subindex)) { 0 } else { value };
        writeln!(values, "0x{index:04x} {subindex} {value}").unwrap();
    }
    std::fs::write(directory.path().join("values"), values).unwrap();
    let path = format!("{}:{}", directory.path().display(), std::env::var("PATH").unwrap());
    let output = Command::new("sh")
        .args(["-c", script])
        .env("PATH", path)
        .env("DIRECTORY", directory.path())
        .output()
        .unwrap();
    let downloads = std::fs::read_to_string(directory.path().join("downloads")).unwrap_or_default();
    let line = |line: &str| {
        let fields: Vec<_> = line.split(' ').collect();
        let [ty, index, subindex, value] = fields[..] else { panic!("{line}") };
        let (subindex, value) = (subindex.parse().unwrap(), value.parse().unwrap());
        Line::write(hexadecimal(index, "0x"), subindex, ty, value)
    };
    (output, downloads.lines().map(line).collect())
}

/// Writes a program that another program runs. Another process writes it: a child of a parallel test
/// could inherit our own descriptor, and the file would be busy.
fn write_program(path: &std::path::Path, text: &str) {
    let status = std::process::Command::new("sh")
        .args(["-c", "printf '%s' \"$2\" > \"$1\" && chmod 755 \"$1\"", "sh"])
        .arg(path)
        .arg(text)
        .status()
        .unwrap();
    assert!(status.success());
}
