//! No system call in a cycle beyond those of the master's library.
//!
//! A child process runs cycles on a master whose functions make none. Once it has forbidden itself
//! every system call but those that end it, the first one of a cycle kills it.
#![cfg(all(target_os = "linux", any(target_arch = "x86_64", target_arch = "aarch64")))]
#![allow(missing_docs)]

use std::collections::BTreeMap;
use std::os::unix::process::ExitStatusExt as _;
use std::process::{Command, ExitStatus};
use std::time::Duration;

use ecan_host::{AdapterConfig, ClockSource, DcSync};
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig, ReceivedView};
use ecan_protocol::can::{CanFrame, CanId, FrameRef};
use ecan_protocol::image::{OptionFlags, Schedule};
use seccompiler::{BpfProgram, SeccompAction, SeccompFilter};

/// Tells the child what to do; without it the child's part is skipped.
const ROLE: &str = "ECAN_TEST_CHILD";
const CYCLES: u16 = 2_000;

fn port() -> Port {
    let ecrt = ecan_bench::null_master::open(ecan_sim::echo(2)).unwrap();
    let mut adapter = AdapterConfig::new(2).with_multiplier(3).with_cycle(Duration::from_millis(1));
    let source = ClockSource::Reference;
    adapter.dc = Some(DcSync {
        source,
        monitor_every: 10,
        ..DcSync::new(Duration::from_millis(1), Duration::from_micros(500))
    });
    let mut gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000));
    gateway.tx_options = OptionFlags::TX_RESULT;
    gateway.schedule.watch_ms = 1;
    let mut port = Port::open(&ecrt, (adapter, PortConfig::uniform(2, gateway))).unwrap();
    port.wait_ready().unwrap();
    // Every cycle publishes a snapshot, copies its images and takes frames of another thread; the other
    // ends live as long as the process.
    std::mem::forget(port.adapter().observer());
    std::mem::forget(port.image_stream(1 << 16));
    let mut queues = port.transmit_queues(64);
    let frame = CanFrame::classic(CanId::standard(0x321).unwrap(), &[5]).unwrap();
    (0..64).for_each(|_| queues.push(0, 2, &frame).unwrap());
    std::mem::forget(queues);
    for slave in 0..2 {
        ecan_bench::null_master::keep_new(port.adapter().tx_pdo(slave));
    }
    ecan_bench::null_master::freeze();
    port
}

/// A cycle with frames both ways; true when some were sent.
fn cycle(port: &mut Port, tag: u16) -> bool {
    let mut sent = 0;
    let mut cycle = port.begin_cycle();
    let frames = cycle.received().filter(|item| matches!(item, ReceivedView::Frame { .. }));
    sent += frames.count();
    let id = CanId::standard(0x123).unwrap();
    for slave in 0..2 {
        let [first, second] = [0, 1].map(|channel| cycle.channel(slave, channel).unwrap());
        let frame = FrameRef::classic(id, &[1, 2, 3]).unwrap();
        sent += usize::from(cycle.send(first, frame).is_ok());
        let at = Schedule { tag, offset_ns: 100_000 };
        let frame = FrameRef::classic(id, &[4]).unwrap();
        sent += usize::from(cycle.send_with(second, frame, at.into()).is_ok());
    }
    cycle.finish();
    sent > 0
}

/// Kills the process at every system call but those that end it.
fn forbid_system_calls() {
    let ending = [libc::SYS_exit_group, libc::SYS_exit, libc::SYS_sigaltstack, libc::SYS_munmap];
    let rules: BTreeMap<i64, Vec<_>> = ending.map(|call| (call, Vec::new())).into();
    let arch = std::env::consts::ARCH.try_into().unwrap();
    let (others, these) = (SeccompAction::KillProcess, SeccompAction::Allow);
    let filter: BpfProgram =
        SeccompFilter::new(rules, others, these, arch).unwrap().try_into().unwrap();
    seccompiler::apply_filter(&filter).unwrap();
}

/// The child's part, run by the tests below.
#[test]
fn child() {
    let Ok(role) = std::env::var(ROLE) else { return };
    let mut port = port();
    // What grows to its working size has grown; errors have been put into words once.
    (0..100).for_each(|tag| assert!(cycle(&mut port, tag)));
    forbid_system_calls();
    let mut all_sent = true;
    for tag in 0..CYCLES {
        all_sent &= cycle(&mut port, tag);
        if role == "calls" {
            std::thread::yield_now();
        }
    }
    std::process::exit(i32::from(!all_sent));
}

fn child_as(role: &str) -> ExitStatus {
    let test = std::env::current_exe().unwrap();
    let mut command = Command::new(test);
    command.args(["--exact", "child", "--test-threads", "1"]).env(ROLE, role);
    command.output().unwrap().status
}

#[test]
fn cycle_makes_none() {
    assert_eq!(child_as("works").code(), Some(0));
}

#[test]
fn one_would_be_noticed() {
    assert_eq!(child_as("calls").signal(), Some(libc::SIGSYS));
}
