//! The EtherCAT master ethercrab uses gateways of the program over a veth pair.

use std::time::{Duration, Instant};

use crate::ethercrab_support::bring_up;
use crate::support::image::{self, Frame};
use crate::support::network::{self, MASTER};
use crate::support::program::{DEADLINE, Running};
use crate::support::raw_master::RawMaster;
use crate::support::scenario::echo_without_sync0_window;
use ecan_host::{Clock, MonotonicClock};
use ethercrab::error::Error;
use ethercrab::std::{ethercat_now, tx_rx_task};
use ethercrab::subdevice_group::{DcConfiguration, HasDc, Op};
use ethercrab::{
    DcSync, DefaultLock, MainDevice, MainDeviceConfig, PduStorage, SubDeviceGroup, Timeouts,
};
use nix::sys::signal::Signal;

const CHUNKS: u8 = 3;
const BYTES: usize = 128 * CHUNKS as usize;
const CYCLE: Duration = Duration::from_millis(1);
const FRAMES: u8 = 100;
const MAX_GATEWAYS: usize = 4;
const MAX_PDI: usize = 2 * BYTES * MAX_GATEWAYS;
/// Process data watchdog in units of 100 us: a test machine may stall.
const WATCHDOG: u16 = 50_000;

type Storage = PduStorage<16, { PduStorage::element_size(1100) }>;
type Group = SubDeviceGroup<MAX_GATEWAYS, MAX_PDI, DefaultLock, Op, HasDc>;

/// ethercrab on its end of the veth pair.
fn main_device() -> MainDevice<'static> {
    let storage: &'static Storage = Box::leak(Box::new(PduStorage::new()));
    let (sender, receiver, pdu_loop) = storage.try_split().unwrap();
    let timeouts = Timeouts {
        state_transition: DEADLINE,
        pdu: Duration::from_secs(10),
        eeprom: DEADLINE,
        mailbox_echo: DEADLINE,
        mailbox_response: DEADLINE,
        ..Timeouts::default()
    };
    let config = MainDeviceConfig { dc_static_sync_iterations: 1_000, ..Default::default() };
    std::thread::spawn(move || {
        let task = tx_rx_task(MASTER, sender, receiver).unwrap();
        futures_lite::future::block_on(task).map(drop)
    });
    MainDevice::new(pdu_loop, timeouts, config)
}

/// From INIT to OP, with Sync0 in every gateway.
async fn bring_to_op(master: &MainDevice<'_>, gateways: usize) -> Result<Group, Error> {
    let mut group = master.init_single_group::<MAX_GATEWAYS, MAX_PDI>(ethercat_now).await?;
    assert_eq!(group.len(), gateways);
    for mut gateway in group.iter_mut(master) {
        assert_eq!(gateway.name(), "ECAN-Lite");
        assert!(gateway.dc_support().any());
        bring_up::configure(&gateway, CHUNKS).await?;
        gateway.register_write(0x0420_u16, WATCHDOG).await?;
        gateway.set_dc_sync(DcSync::Sync0);
    }
    let sync = DcConfiguration {
        start_delay: Duration::from_millis(100),
        sync0_period: CYCLE,
        sync0_shift: CYCLE / 2,
    };
    let group = group.into_pre_op_pdi(master).await?.configure_dc_sync(master, sync).await?;
    let group = group.into_safe_op(master).await?;
    for gateway in group.iter(master) {
        assert_eq!((gateway.inputs_raw().len(), gateway.outputs_raw().len()), (BYTES, BYTES));
    }
    let group = group.request_into_op(master).await?;
    let start = Instant::now();
    while !group.tx_rx_dc(master).await?.all_op() {
        assert!(start.elapsed() < DEADLINE, "not in OP");
        pause();
    }
    Ok(group)
}

fn pause() {
    MonotonicClock.sleep_until_ns(MonotonicClock.now_ns() + CYCLE.as_nanos() as u64);
}

/// The frame that a gateway sends in its turn.
fn frame(gateway: usize, turn: u8) -> Frame {
    Frame { id: 0x100 + gateway as u16, data: vec![turn; usize::from(turn % 9)] }
}

/// Sends one frame through each gateway in each turn; the echo nodes return them. Returns the
/// number of cycles.
async fn echo(master: &MainDevice<'_>, group: &Group) -> Result<u64, Error> {
    let mut sequences = vec![None; group.len()];
    let mut cycles = 0;
    let start = Instant::now();
    for turn in 0..FRAMES {
        let mut received = vec![Vec::new(); group.len()];
        // The same image is sent until the echo arrives: gateways recognise it as a repeat.
        while received.iter().any(Vec::is_empty) {
            assert!(start.elapsed() < DEADLINE, "turn {turn}: {received:?}");
            for (nth, gateway) in group.iter(master).enumerate() {
                let mut outputs = gateway.outputs_raw_mut();
                image::write(&mut outputs, u16::from(turn) + 1, &[frame(nth, turn)]);
            }
            pause();
            cycles += 1;
            let response = group.tx_rx_dc(master).await?;
            assert!(response.all_op(), "{response:?}");
            for (nth, gateway) in group.iter(master).enumerate() {
                if let Some((sequence, frames)) = image::read(&gateway.inputs_raw())
                    && sequences[nth].replace(sequence) != Some(sequence)
                {
                    received[nth].extend(frames);
                }
            }
        }
        for (nth, received) in received.iter().enumerate() {
            assert_eq!(received, &[frame(nth, turn)], "gateway {nth}");
        }
    }
    Ok(cycles)
}

fn run(gateways: usize) {
    if !network::enter() {
        return;
    }
    let directory = tempfile::tempdir().unwrap();
    let dump = directory.path().join("can.log");
    let scenario = directory.path().join("scenario.toml");
    std::fs::write(&scenario, echo_without_sync0_window(gateways)).unwrap();
    let [scenario, dump_to] = [&scenario, &dump].map(|path| path.to_str().unwrap());
    let mut program = Running::start(&["--scenario", scenario, "--dump", dump_to]);
    program.wait_for(&format!("gateway {}: booted, INIT", gateways - 1));
    RawMaster::open(MASTER).wait_for_link();
    let master = main_device();
    let cycles = futures_lite::future::block_on(async {
        let group = bring_to_op(&master, gateways).await?;
        for nth in 0..gateways {
            program.wait_for(&format!("gateway {nth}: SAFEOP -> OP"));
        }
        echo(&master, &group).await
    });
    println!("{} cycles", cycles.unwrap());
    let printed = program.end(Signal::SIGINT);
    println!("{printed}");
    assert!(!printed.contains("AL error"), "{printed}");
    assert!(printed.contains(" 0 faulty, 0 foreign, 0 lost; 0 dropped"), "{printed}");
    let log = std::fs::read_to_string(&dump).unwrap();
    for nth in 0..gateways {
        let sent = format!("can0 on bus {nth}.0: {FRAMES} sent, {FRAMES} received, 0 error frames");
        assert!(printed.contains(&sent), "{sent}: {printed}");
        // Each frame twice: the gateway's, and the echo.
        let on_bus = log.lines().filter(|line| line.contains(&format!(") {nth}.0 10{nth}#")));
        assert_eq!(on_bus.count(), 2 * usize::from(FRAMES), "{log}");
    }
    for line in log.lines() {
        assert!(ecan_can_io::candump::parse_line(line).unwrap().is_some(), "{line}");
    }
}

#[test]
fn one_gateway_reaches_op_and_echoes_frames() {
    run(1);
}

#[test]
fn three_gateways_reach_op_and_echo_frames() {
    run(3);
}

/// The example of the manual: N = 8, channel mask 0x0F, sequence 1.
#[test]
fn image_matches_manual() {
    let mut image = [0xEE; 1024];
    let data = vec![0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88];
    image::write(&mut image, 1, &[Frame { id: 0x123, data }]);
    let header = [0x16, 0, 1, 0, 1, 0, 0x0C, 0, 0xD3, 0x56, 0xE7, 0x01, 0x0F, 1, 0, 1];
    assert_eq!(image[..16], header);
    let packet = [0x40, 0, 0x23, 0x01, 0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88];
    assert_eq!(image[24..36], packet);
    assert!(image[16..24].iter().chain(&image[36..]).all(|byte| *byte == 0));
}
