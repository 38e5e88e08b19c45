//! Faults while a program exchanges frames.

use std::time::Duration;

use nix::sys::signal::Signal;

use crate::bench::Bench;
use crate::bus::BusSpec;
use crate::child::Finished;
use crate::need::Need;
use crate::step::{Group, Run, Step};
use crate::steps::running_loop::{RunningLoop, expect_accounts};
use crate::stop::{Stop, check};
use crate::table;

pub const GROUP: Group = Group {
    name: "faults",
    steps: &[
        Step {
            name: "link_loss",
            proves: "After a link loss of 2 s the gateway becomes ready again.",
            needs: &[Need::Wire, Need::Root, Need::System("ip")],
            run: |bench| outage(bench, |bench| with_link_down(bench, Duration::from_secs(2))),
        },
        Step {
            name: "power_cycle",
            proves: "After a power cycle of 2 s the gateway becomes ready again.",
            needs: &[Need::LastingBus, Need::EchoNodes],
            run: |bench| outage(bench, |bench| bench.power_cycle(Duration::from_secs(2))),
        },
        Step {
            name: "stalled_slave",
            proves: "After 2 s without responses the gateway becomes ready again.",
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
            run: |bench| {
                returns_to_op(bench, 3, 1, "kind = \"power_cycle\"\ngateway = 1\noff_ms = 300")
            },
        },
        simulated(
            "restart",
            "A gateway that restarts during the cycle becomes ready again.",
            |bench| returns_to_op(bench, 1, 0, "kind = \"power_cycle\"\ngateway = 0\noff_ms = 300"),
        ),
        simulated(
            "link_of_the_gateway",
            "A gateway without link for 500 ms becomes ready again.",
            |bench| returns_to_op(bench, 1, 0, "kind = \"link_loss\"\ngateway = 0\nfor_ms = 500"),
        ),
        simulated(
            "al_error",
            "A gateway that leaves OP with an AL error becomes ready again.",
            |bench| returns_to_op(bench, 1, 0, "kind = \"al_error\"\ngateway = 0\ncode = 0x1B"),
        ),
        simulated(
            "lost_frames",
            "Three lost EtherCAT frames cost no CAN frame: the images are repeated.",
            lost_frames,
        ),
        simulated(
            "crc_error",
            "Images with a wrong CRC are counted, and the cycle continues.",
            crc_error,
        ),
        simulated(
            "service_stall",
            "A firmware that pauses for 20 ms continues without a new start.",
            |bench| {
                stays_in_op(bench, "kind = \"service_stall\"\ngateway = 0\nfor_ms = 20").map(drop)
            },
        ),
        simulated(
            "bus_off",
            "A channel in bus-off is recovered, and the cycle continues.",
            bus_off,
        ),
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

/// A step with a fault that only simulated gateways can have.
const fn simulated(name: &'static str, proves: &'static str, run: Run) -> Step {
    Step { name, proves, needs: &[Need::Simulated], run }
}

/// Sends with process data before a scripted fault, for each gateway: well after the start, which
/// sends too.
const SENDS_BEFORE: u32 = 2_000;
/// Cycles after it: the master may read the dictionary of another gateway before it notices the fault.
const CYCLES_AFTER_OUTAGE: u32 = 5_000;
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
    let mut running = RunningLoop::launch(bench, 1)?;
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
    format!("[[fault]]\ncycle = {}\n{text}\n", SENDS_BEFORE * u32::from(gateways))
}

/// Runs a program on a bus with a fault, which must account every frame.
fn run_with_fault(
    bench: &mut Bench,
    gateways: u16,
    fault: &str,
    cycles_after: u32,
) -> Result<Finished, Stop> {
    bench.fresh_bus(BusSpec::echo(gateways).with_faults(fault_in_cycle(gateways, fault)))?;
    let cycles = (SENDS_BEFORE * u32::from(gateways) + cycles_after).to_string();
    let slaves = gateways.to_string();
    let program = bench.cyclic_example("simple_loop", ["--slaves", &slaves, "--cycles", &cycles]);
    let finished = bench.run(program)?.expect(0)?;
    expect_accounts(&finished, gateways)?;
    Ok(finished)
}

/// Takes this gateway out of OP; it must become ready again.
fn returns_to_op(bench: &mut Bench, gateways: u16, gateway: u16, fault: &str) -> Result<(), Stop> {
    let finished = run_with_fault(bench, gateways, fault, CYCLES_AFTER_OUTAGE)?;
    finished.expect_text(&format!("slave {gateway}: ready")).map(drop)
}

/// Disturbs the only gateway, which must stay in OP.
fn stays_in_op(bench: &mut Bench, fault: &str) -> Result<Finished, Stop> {
    let finished = run_with_fault(bench, 1, fault, CYCLES_AFTER_DISTURBANCE)?;
    check(!finished.output().contains("waiting for OP"), || {
        format!("the gateway left OP: {}", finished.end_text())
    })?;
    Ok(finished)
}

fn lost_frames(bench: &mut Bench) -> Result<(), Stop> {
    let finished = stays_in_op(bench, "kind = \"lost_frame\"\nway = \"outward\"\ncycles = 3")?;
    let output = finished.output();
    for column in ["lost", "discarded", "unknown"] {
        let count = table::number(&output, column, "slave 0 can0");
        check(count == Some(0), || format!("{column} {count:?}: {}", finished.end_text()))?;
    }
    Ok(())
}

fn crc_error(bench: &mut Bench) -> Result<(), Stop> {
    let finished = stays_in_op(bench, "kind = \"crc_error\"\ngateway = 0\ntimes = 3")?;
    let errors = table::number(&finished.output(), "errors", "slave 0");
    // An image that is lost as well is not among them.
    check(matches!(errors, Some(1..=3)), || {
        format!("errors {errors:?}, expected 1 to 3: {}", finished.end_text())
    })
}

fn bus_off(bench: &mut Bench) -> Result<(), Stop> {
    let finished = stays_in_op(bench, "kind = \"bus_off\"\ngateway = 0\nchannel = 0")?;
    // The channel rejects frames until it is recovered.
    let rejected = table::number(&finished.output(), "rejected", "slave 0 can0");
    let is_recovered = rejected.is_some_and(|count| count < CYCLES_AFTER_DISTURBANCE.into());
    check(is_recovered, || format!("rejected {rejected:?}: {}", finished.end_text()))
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
    let fault = fault_in_cycle(1, "kind = \"lost_frame\"\nway = \"outward\"\ncycles = 1");
    bench.fresh_bus(BusSpec::drives(1).with_faults(fault))?;
    let cycles = (SENDS_BEFORE + CYCLES_AFTER_DISTURBANCE).to_string();
    let arguments = ["--step", "20", "--cycles", &cycles];
    let program = bench.cyclic_example("cia402_single_axis_demo", arguments);
    bench.run(program)?.expect(0)?.expect_text("operation enabled").map(drop)
}
