//! Faults while a program exchanges frames.

use std::time::Duration;

use nix::sys::signal::Signal;

use crate::bench::Bench;
use crate::bus::BusSpec;
use crate::need::Need;
use crate::step::{Group, Step};
use crate::steps::running_loop::{RunningLoop, expect_accounts};
use crate::stop::{Stop, check};

pub const GROUP: Group = Group {
    name: "faults",
    steps: &[
        Step {
            name: "link_loss",
            proves: "After a link loss of 2 s the gateway becomes ready by itself.",
            needs: &[Need::Wire, Need::Root, Need::System("ip")],
            run: |bench| outage(bench, |bench| with_link_down(bench, Duration::from_secs(2))),
        },
        Step {
            name: "power_cycle",
            proves: "After a power cycle of 2 s the gateway becomes ready by itself.",
            needs: &[Need::LastingBus, Need::EchoNodes],
            run: |bench| outage(bench, |bench| bench.power_cycle(Duration::from_secs(2))),
        },
        Step {
            name: "stalled_slave",
            proves: "After 2 s without responses the gateway becomes ready by itself.",
            needs: &[Need::Wire],
            run: |bench| outage(bench, stall),
        },
        Step {
            name: "stall_during_startup",
            proves: "A slave that does not respond for 1 s during the start becomes ready.",
            needs: &[Need::Wire],
            run: stall_during_startup,
        },
        Step {
            name: "gateway_switched_off",
            proves: "A gateway that is switched off at the start of a program is named in the error.",
            needs: &[Need::Wire],
            run: gateway_switched_off,
        },
        Step {
            name: "restart_of_one_of_three",
            proves: "One of three gateways restarts during the cycle; all become ready again.",
            needs: &[Need::Simulated, Need::Gateways(3)],
            run: restart_of_one_of_three,
        },
        Step {
            name: "restart",
            proves: "A gateway that restarts during the cycle becomes ready again.",
            needs: &[Need::Simulated],
            run: |bench| {
                scripted(bench, "kind = \"power_cycle\"\ngateway = 0\noff_ms = 300\n", true)
            },
        },
        Step {
            name: "link_of_the_gateway",
            proves: "A gateway without link for 500 ms becomes ready again.",
            needs: &[Need::Simulated],
            run: |bench| scripted(bench, "kind = \"link_loss\"\ngateway = 0\nfor_ms = 500\n", true),
        },
        Step {
            name: "al_error",
            proves: "A gateway that leaves OP with an AL error becomes ready again.",
            needs: &[Need::Simulated],
            run: |bench| scripted(bench, "kind = \"al_error\"\ngateway = 0\ncode = 0x1B\n", true),
        },
        Step {
            name: "lost_frames",
            proves: "Three lost EtherCAT frames cost no CAN frame: the images are repeated.",
            needs: &[Need::Simulated],
            run: |bench| {
                scripted(bench, "kind = \"lost_frame\"\nway = \"outward\"\ncycles = 3\n", false)
            },
        },
        Step {
            name: "crc_error",
            proves: "Images with a wrong CRC are counted, and the cycle continues.",
            needs: &[Need::Simulated],
            run: |bench| scripted(bench, "kind = \"crc_error\"\ngateway = 0\ntimes = 3\n", false),
        },
        Step {
            name: "service_stall",
            proves: "A firmware that pauses for 20 ms continues without a new start.",
            needs: &[Need::Simulated],
            run: |bench| {
                scripted(bench, "kind = \"service_stall\"\ngateway = 0\nfor_ms = 20\n", false)
            },
        },
        Step {
            name: "bus_off",
            proves: "A channel in bus-off is recovered, and the cycle continues.",
            needs: &[Need::Simulated],
            run: |bench| scripted(bench, "kind = \"bus_off\"\ngateway = 0\nchannel = 0\n", false),
        },
        Step {
            name: "rejected_startup_sdo",
            proves: "A startup SDO that the gateway rejects is named with object and abort code.",
            needs: &[Need::Simulated],
            run: rejected_startup_sdo,
        },
        Step {
            name: "motion_with_lost_frame",
            proves: "A lost EtherCAT frame during motion leaves all axes enabled.",
            needs: &[Need::Simulated],
            run: motion_with_lost_frame,
        },
    ],
};

/// Sends with process data before a scripted fault, for each gateway: well after the start, which
/// sends too.
const SENDS_BEFORE: u32 = 2_000;
/// Cycles after it: the master may need a minute to scan a gateway that was away.
const CYCLES_AFTER_OUTAGE: u32 = 12_000;
const CYCLES_AFTER_DISTURBANCE: u32 = 500;

/// Causes an outage while a program runs, which must become ready again and account every frame.
fn outage(bench: &mut Bench, cause: fn(&mut Bench) -> Result<(), Stop>) -> Result<(), Stop> {
    bench.bus(BusSpec::echo(1))?;
    let mut running = RunningLoop::start(bench, 1)?;
    bench.pause(Duration::from_secs(1))?;
    let mark = running.mark();
    let caused = cause(bench);
    let again = caused.and_then(|()| running.wait_ready_again(bench, mark));
    let end = bench.pause(Duration::from_secs(1)).and_then(|()| running.end(bench));
    bench.figure("ready_again_s", again?.as_secs_f64());
    end?.expect_accounts(1)
}

/// Takes the link of the simulated gateways away for this time.
pub fn with_link_down(bench: &mut Bench, time: Duration) -> Result<(), Stop> {
    let interface = bench.arguments.interface.clone().unwrap_or_default();
    let down = bench.system("ip", ["link", "set", &interface, "down"]);
    bench.run(down)?.expect(0)?;
    let pause = bench.pause(time);
    let up = bench.system("ip", ["link", "set", &interface, "up"]);
    bench.restore(up)?.expect(0)?;
    pause
}

fn stall(bench: &mut Bench) -> Result<(), Stop> {
    stall_for(bench, Duration::from_secs(2))
}

fn stall_for(bench: &mut Bench, time: Duration) -> Result<(), Stop> {
    bench.slave()?.signal(Signal::SIGSTOP);
    let pause = bench.pause(time);
    bench.slave()?.signal(Signal::SIGCONT);
    pause
}

fn stall_during_startup(bench: &mut Bench) -> Result<(), Stop> {
    bench.fresh_bus(BusSpec::echo(1))?;
    let mut running = RunningLoop::launch(bench, 1, &["--cycles", "1000000000"])?;
    bench.pause(Duration::from_millis(300))?;
    let ready = stall_for(bench, Duration::from_secs(1)).and_then(|()| running.wait_ready(bench));
    let ended = running.end(bench);
    bench.figure("ready_s", ready?.as_secs_f64());
    ended.map(drop)
}

fn gateway_switched_off(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::echo(1))?;
    bench.stop_slave()?;
    let program = bench.example("simple_loop", ["--cycles", "10"]);
    bench.run(program)?.expect(1)?.expect_text("slave").map(drop)
}

/// A fault during the cycle, as in a scenario file.
fn fault_in_cycle(gateways: u16, text: &str) -> String {
    format!("[[fault]]\ncycle = {}\n{text}", SENDS_BEFORE * u32::from(gateways))
}

/// Runs a program on a bus with a fault; the gateways are ready again afterwards.
fn scripted(bench: &mut Bench, fault: &str, is_outage: bool) -> Result<(), Stop> {
    run_scripted(bench, 1, fault, is_outage)
}

fn restart_of_one_of_three(bench: &mut Bench) -> Result<(), Stop> {
    run_scripted(bench, 3, "kind = \"power_cycle\"\ngateway = 1\noff_ms = 300\n", true)
}

fn run_scripted(
    bench: &mut Bench,
    gateways: u16,
    fault: &str,
    is_outage: bool,
) -> Result<(), Stop> {
    bench.fresh_bus(BusSpec::echo(gateways).with_faults(fault_in_cycle(gateways, fault)))?;
    let after = if is_outage { CYCLES_AFTER_OUTAGE } else { CYCLES_AFTER_DISTURBANCE };
    let cycles = (SENDS_BEFORE * u32::from(gateways) + after).to_string();
    let (slaves, cycle) = (gateways.to_string(), bench.arguments.cycle_us.to_string());
    let arguments = ["--slaves", &slaves, "--cycle-us", &cycle, "--cycles", &cycles];
    let program = bench.example("simple_loop", arguments);
    let finished = bench.run(program)?.expect(0)?;
    let output = finished.output();
    // The gateway with the fault: the last but one in a line, or the only one.
    let ready = format!("slave {}: ready", gateways / 2);
    check(!is_outage || output.contains(&ready), || {
        format!("no \"{ready}\" after the fault: {}", finished.end_text())
    })?;
    check(is_outage || !output.contains("waiting for OP"), || {
        format!("the gateway left OP: {}", finished.end_text())
    })?;
    expect_accounts(&finished, gateways)
}

fn rejected_startup_sdo(bench: &mut Bench) -> Result<(), Stop> {
    let fault = "[[fault]]\nat_ms = 0\nkind = \"sdo_abort\"\ngateway = 0\nindex = 0x8001\n\
                 subindex = 19\ncode = 0x06090030\ntimes = 100000\n";
    bench.fresh_bus(BusSpec::any(1).with_faults(fault))?;
    let program = bench.example("simple_loop", ["--cycles", "10"]);
    let finished = bench.run(program)?.expect(1)?;
    finished.expect_text("0x8001:19")?.expect_text("0x06090030").map(drop)
}

fn motion_with_lost_frame(bench: &mut Bench) -> Result<(), Stop> {
    let fault = fault_in_cycle(1, "kind = \"lost_frame\"\nway = \"outward\"\ncycles = 1\n");
    bench.fresh_bus(BusSpec::drives(1).with_faults(fault))?;
    let cycles = (SENDS_BEFORE + CYCLES_AFTER_DISTURBANCE).to_string();
    let cycle = bench.arguments.cycle_us.to_string();
    let program = bench.example(
        "cia402_single_axis_demo",
        ["--cycle-us", &cycle, "--step", "20", "--cycles", &cycles],
    );
    bench.run(program)?.expect(0)?.expect_text("operation enabled").map(drop)
}
