//! Startup lists for other masters: each is read back and starts gateways up to OP with an
//! independent master (ethercrab).

use crate::config_files::two;
use crate::ethercrab_support::{Fixture, Group, MAX_GATEWAYS, MAX_PDI, MS, on_a_deep_stack};
use crate::list_readers::{Line, codesys, csv, run_script, twincat};
use ecan_host::StartupStep;
use ecan_lite::config::export::{Format, ProcessData, SlaveAddress, export};
use ecan_mcan_port::Config;
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::image::{CommitFields, ImageReader, ImageWriter, Packet, Timestamp};
use ecan_protocol::mapping::Direction;
use ethercrab::subdevice_group::PreOp;

/// A frame for the only channel of the first gateway, and one that passes the filters of the second.
fn frame(gateway: usize) -> (u8, CanFrame) {
    let id = CanId::standard(0x150).unwrap();
    match gateway {
        0 => (0, CanFrame::classic(id, &[1, 2, 3]).unwrap()),
        _ => (1, CanFrame::fd(id, &[7; 64], true, false).unwrap()),
    }
}

fn send(file: &Config, gateway: usize, image: &mut [u8]) {
    let multiplier = file.adapter.slaves[gateway].rx_multiplier;
    let profile = file.port.gateways[gateway].profile(Direction::RxPdo, multiplier);
    let mut writer = ImageWriter::new(Direction::RxPdo, profile);
    let (channel, frame) = frame(gateway);
    writer.push(image, channel, 0, frame.as_ref(), Timestamp::None).unwrap();
    writer.commit(image, CommitFields::default());
}

/// Number of echoes of the frame in an image.
fn received(file: &Config, gateway: usize, image: &[u8]) -> u32 {
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

/// Runs a list on each of two gateways in PREOP, sets them to OP and sends a frame through each.
fn brings_gateways_to_op(lists: [Vec<Line>; 2]) {
    on_a_deep_stack(|| {
        let mut fixture = Fixture::new(&ecan_sim::echo(2));
        let group = fixture.run(async |master| {
            let group: Group<PreOp> =
                master.init_single_group::<MAX_GATEWAYS, MAX_PDI>(|| 0).await?;
            for (gateway, lines) in group.iter(master).zip(lists) {
                for line in lines {
                    assert!(line.replay(&gateway).await?, "{line:?}");
                }
            }
            group.into_op(master).await
        });
        let file = two();
        let mut echoes = [0, 0];
        for cycle in 0..20 {
            fixture.pass(MS);
            fixture.run(async |master| {
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
        let station = |gateway, channel| {
            fixture.wire.world().gateway(gateway).unwrap().station_config(channel)
        };
        for (gateway, enabled) in
            [(0, [true, false, false, false]), (1, [false, true, false, true])]
        {
            for (channel, is_enabled) in enabled.into_iter().enumerate() {
                assert_eq!(station(gateway, channel).is_some(), is_enabled, "{gateway}.{channel}");
            }
        }
    });
}

fn steps_and_list(gateway: usize, format: Format) -> (Vec<StartupStep>, String) {
    let steps = ecan_lite::config::startup(&two(), gateway);
    let process_data = ProcessData::of(&two().adapter, gateway).unwrap();
    let list = export(format, &steps, SlaveAddress::default(), &process_data);
    (steps, list)
}

/// The writes of the steps.
fn writes(steps: &[StartupStep]) -> Vec<Line> {
    let write = |step: &StartupStep| match step {
        StartupStep::Download(it) => {
            let (bytes, length) = it.bytes();
            let (index, subindex) = (it.index, it.subindex);
            Some(Line::Write { index, subindex, bytes: bytes[..length].to_vec() })
        }
        StartupStep::Expect { .. } => None,
    };
    steps.iter().filter_map(write).collect()
}

/// The writes of the lists of both gateways, read back.
fn read_back(format: Format, read: impl Fn(&str, &[StartupStep]) -> Vec<Line>) -> [Vec<Line>; 2] {
    [0, 1].map(|gateway| {
        let (steps, list) = steps_and_list(gateway, format);
        let lines = read(&list, &steps);
        assert_eq!(lines, writes(&steps));
        lines
    })
}

#[test]
fn csv_list_starts_gateways_up_to_op() {
    brings_gateways_to_op([0, 1].map(|gateway| {
        let (steps, list) = steps_and_list(gateway, Format::Csv);
        let lines = csv(&list);
        assert_eq!(lines.len(), steps.len());
        assert!(lines.len() > 100, "{}", lines.len());
        lines
    }));
}

#[test]
fn twincat_list_starts_gateways_up_to_op() {
    let (_, list) = steps_and_list(0, Format::TwinCat);
    assert!(list.contains("<![CDATA[MCAN Channel Config, Node mode]]>"));
    brings_gateways_to_op(read_back(Format::TwinCat, |list, _| twincat(list)));
}

#[test]
fn codesys_list_starts_gateways_up_to_op() {
    let (_, list) = steps_and_list(0, Format::Codesys);
    let third = list.lines().nth(2).unwrap();
    assert!(third.starts_with("2;16#1C12:16#01;") && third.contains(";5632;16;TRUE;FALSE;0;"));
    brings_gateways_to_op(read_back(Format::Codesys, |list, _| codesys(list)));
}

#[test]
fn ethercat_lines_start_gateways_up_to_op() {
    brings_gateways_to_op(read_back(Format::Ethercat, |list, steps| {
        let (output, lines) = run_script(list, steps, None);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        lines
    }));
}

#[test]
fn failed_check_stops_the_ethercat_lines() {
    let steps = ecan_lite::config::startup(&two(), 1);
    let address = SlaveAddress { master: 1, alias: 7, position: 0 };
    let process_data = ProcessData::of(&two().adapter, 1).unwrap();
    let script = export(Format::Ethercat, &steps, address, &process_data);
    assert!(script.contains("transfer download -m 1 -a 7 -p 0 --type uint16 0x1c12 1 5632  # "));
    let (output, lines) = run_script(&script, &steps, None);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(lines, writes(&steps));
    // Checks of each kind, followed by writes.
    for wrong in [(0xF000, 12), (0xF000, 11), (0xF000, 17), (0x8010, 12)] {
        let (output, lines) = run_script(&script, &steps, Some(wrong));
        let errors = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{errors}");
        assert!(errors.contains(&format!("0x{:04X}:{:02}", wrong.0, wrong.1)), "{errors}");
        assert!(lines.len() < writes(&steps).len());
    }
}
