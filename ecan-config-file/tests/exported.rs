//! Startup lists for other masters, used as those would.
#![allow(missing_docs)]

mod common;
#[path = "../../ecan-sim/tests/ethercrab_support/mod.rs"]
mod ethercrab_support;

use std::fmt::Write as _;
use std::ops::Deref;
use std::process::{Command, Output};

use common::two;
use ecan_config_file::ConfigFile;
use ecan_config_file::export::{Format, SlavePlace, export};
use ecan_host::{Expectation, StartupStep};
use ecan_protocol::{
    CanFrame, CanId, CommitFields, Direction, ImageReader, ImageWriter, Packet, Timestamp,
};
use ethercrab::error::Error;
use ethercrab::subdevice_group::PreOp;
use ethercrab::{SubDevice, SubDeviceRef};
use ethercrab_support::{Bench, Group, MAX_GATEWAYS, MAX_PDI, MS, on_a_deep_stack};

fn csv(gateway: usize) -> String {
    export(Format::Csv, &two().startup(gateway), SlavePlace::default())
}

/// A line of the CSV, as a program that knows nothing else reads it.
async fn replay<S>(gateway: &SubDeviceRef<'_, S>, line: &str) -> Result<bool, Error>
where
    S: Deref<Target = SubDevice>,
{
    let fields: Vec<&str> = line.splitn(6, ',').collect();
    let [action, index, subindex, ty, value, _comment] = fields[..] else { panic!("{line}") };
    let index = u16::from_str_radix(index.strip_prefix("0x").unwrap(), 16).unwrap();
    let subindex: u8 = subindex.parse().unwrap();
    let value: u32 = value.parse().unwrap();
    if action == "write" {
        match ty {
            "uint8" => gateway.sdo_write(index, subindex, value as u8).await?,
            "uint16" => gateway.sdo_write(index, subindex, value as u16).await?,
            "uint32" => gateway.sdo_write(index, subindex, value).await?,
            other => panic!("{other}"),
        }
        return Ok(true);
    }
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

/// A frame for the first gateway's only channel, and one through the second one's filters.
fn frame(gateway: usize) -> (u8, CanFrame) {
    let id = CanId::standard(0x150).unwrap();
    match gateway {
        0 => (0, CanFrame::classic(id, &[1, 2, 3]).unwrap()),
        _ => (1, CanFrame::fd(id, &[7; 64], true, false).unwrap()),
    }
}

fn send(file: &ConfigFile, gateway: usize, image: &mut [u8]) {
    let multiplier = file.adapter.slaves[gateway].rx_multiplier;
    let profile = file.port.gateways[gateway].profile(Direction::RxPdo, multiplier);
    let mut writer = ImageWriter::new(Direction::RxPdo, profile);
    let (channel, frame) = frame(gateway);
    writer.push(image, channel, 0, frame.as_ref(), Timestamp::None).unwrap();
    writer.commit(image, CommitFields::default());
}

/// How many echoes of the frame an image brings.
fn received(file: &ConfigFile, gateway: usize, image: &[u8]) -> u32 {
    let multiplier = file.adapter.slaves[gateway].tx_multiplier;
    let profile = file.port.gateways[gateway].profile(Direction::TxPdo, multiplier);
    let reader = ImageReader::new(Direction::TxPdo, profile);
    let (channel, sent) = frame(gateway);
    let is_echo = |packet: Packet<'_>| match packet {
        Packet::Frame(packet) => packet.channel == channel && packet.frame.data() == sent.data(),
        Packet::TxResult(_) => false,
    };
    let image = reader.read(image).unwrap();
    image.packets().filter(|packet| is_echo(packet.unwrap())).count() as u32
}

#[test]
fn the_csv_brings_gateways_to_op_with_a_master_that_no_one_here_wrote() {
    on_a_deep_stack(|| {
        let mut bench = Bench::new(&ecan_sim::echo(2));
        let group = bench.run(async |master| {
            let group: Group<PreOp> =
                master.init_single_group::<MAX_GATEWAYS, MAX_PDI>(|| 0).await?;
            for (nth, gateway) in group.iter(master).enumerate() {
                let mut lines = 0;
                for line in csv(nth).lines().skip(1) {
                    assert!(replay(&gateway, line).await?, "{line}");
                    lines += 1;
                }
                assert!(lines > 100, "{lines}");
            }
            group.into_op(master).await
        });
        let file = two();
        let mut echoes = [0, 0];
        for cycle in 0..20 {
            bench.pass(MS);
            bench.run(async |master| {
                for (nth, gateway) in group.iter(master).enumerate() {
                    let mut io = gateway.io_raw_mut();
                    if cycle == 3 {
                        send(&file, nth, io.outputs());
                    }
                }
                group.tx_rx(master).await?;
                let sizes = [(384, 384), (256, 512)];
                for (nth, (gateway, (outputs, inputs))) in group.iter(master).zip(sizes).enumerate()
                {
                    assert_eq!(gateway.status().await?.0, ethercrab::SubDeviceState::Op);
                    assert_eq!(gateway.outputs_raw().len(), outputs);
                    assert_eq!(gateway.inputs_raw().len(), inputs);
                    echoes[nth] += received(&file, nth, &gateway.inputs_raw());
                }
                Ok(())
            });
        }
        assert_eq!(echoes, [1, 1]);
        let station =
            |gateway, channel| bench.wire.world().gateway(gateway).unwrap().station_config(channel);
        for (gateway, enabled) in
            [(0, [true, false, false, false]), (1, [false, true, false, true])]
        {
            for (channel, is_enabled) in enabled.into_iter().enumerate() {
                assert_eq!(station(gateway, channel).is_some(), is_enabled, "{gateway}.{channel}");
            }
        }
    });
}

/// The `ethercat` tool of the tests: notes downloads, answers uploads from a table.
const STAND_IN: &str = r#"#!/bin/sh
command=$1
shift
[ "$1" = -m ] && shift 2
[ "$1" = -a ] && shift 2
[ "$1" = -p ] && shift 2
[ "$1" = --type ] || { echo "no type" >&2; exit 9; }
shift 2
if [ $command = download ]; then echo "$1 $2 $3" >>"$DIRECTORY/downloads"; exit; fi
while read index subindex value; do
    if [ "$index $subindex" = "$1 $2" ]; then printf '0x%02x %d\n' $value $value; exit; fi
done <"$DIRECTORY/values"
exit 9
"#;

fn run_script(script: &str, steps: &[StartupStep], wrong: Option<(u16, u8)>) -> (Output, String) {
    use std::os::unix::fs::PermissionsExt;
    let directory = tempfile::tempdir().unwrap();
    let tool = directory.path().join("ethercat");
    std::fs::write(&tool, STAND_IN).unwrap();
    std::fs::set_permissions(&tool, std::fs::Permissions::from_mode(0o755)).unwrap();
    let mut values = String::new();
    for step in steps {
        let StartupStep::Expect { index, subindex, expected } = *step else { continue };
        let value = match expected {
            Expectation::Equals(value)
            | Expectation::AtLeast(value)
            | Expectation::AtMost(value)
            | Expectation::HasBits(value)
            | Expectation::HasAny(value) => value,
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
    (output, downloads)
}

#[test]
fn the_ethercat_lines_write_and_check() {
    let steps = two().startup(1);
    let script = export(Format::Ethercat, &steps, SlavePlace { master: 1, alias: 7, position: 0 });
    assert!(script.contains("ethercat download -m 1 -a 7 -p 0 --type uint16 0x1c12 1 5632  # "));
    let (output, downloads) = run_script(&script, &steps, None);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let written: Vec<_> = steps
        .iter()
        .filter_map(|step| match step {
            StartupStep::Download(it) => {
                Some(format!("0x{:04x} {} {}", it.index, it.subindex, it.value))
            }
            StartupStep::Expect { .. } => None,
        })
        .collect();
    assert_eq!(downloads.lines().collect::<Vec<_>>(), written);
    // Checks of each kind stop it, those behind the first writes too.
    for wrong in [(0xF000, 12), (0xF000, 11), (0xF000, 17), (0x8010, 12)] {
        let (output, downloads) = run_script(&script, &steps, Some(wrong));
        let errors = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{errors}");
        assert!(errors.contains(&format!("0x{:04X}:{:02}", wrong.0, wrong.1)), "{errors}");
        assert!(downloads.lines().count() < written.len());
    }
}

#[test]
fn startup_lists_of_other_tools_have_every_write_in_order() {
    let steps = two().startup(0);
    let downloads = steps.iter().filter(|step| step.is_download()).count();
    let twincat = export(Format::TwinCat, &steps, SlavePlace::default());
    assert_eq!(twincat.matches("<InitCmd>").count(), downloads);
    let bitrate =
        "<Index>32769</Index>\n        <SubIndex>19</SubIndex>\n        <Data>90d00300</Data>";
    assert!(twincat.contains(bitrate), "250000 little-endian");
    assert!(twincat.contains("<![CDATA[MCAN Channel Config, Node mode]]>"));
    let codesys = export(Format::Codesys, &steps, SlavePlace::default());
    let lines: Vec<_> = codesys.lines().collect();
    assert_eq!(lines.len(), downloads + 1);
    for line in &lines {
        assert_eq!(line.split(';').count(), 9, "{line}");
    }
    assert!(lines[2].starts_with("2;16#1C12:16#01;"), "{}", lines[2]);
    assert!(lines[2].contains(";5632;16;TRUE;FALSE;0;"), "{}", lines[2]);
}
