//! Every command of `ecan` that needs a bus, except those of the groups `configuration` and
//! `firmware`.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use nix::sys::signal::Signal;
use serde_json::Value;

use crate::bench::{Bench, Kind};
use crate::bus::{BusSpec, Nodes};
use crate::need::Need;
use crate::step::{Group, Step};
use crate::stop::{Stop, check};

pub const GROUP: Group = Group {
    name: "commands",
    steps: &[
        Step {
            name: "info",
            proves: "`ecan info` reads identity, profiles and channels of a gateway.",
            needs: &[],
            run: info,
        },
        Step {
            name: "caps",
            proves: "`ecan caps` reads every capability (0xF000) that the firmware has.",
            needs: &[],
            run: caps,
        },
        Step {
            name: "sdo_read",
            proves: "`ecan sdo read` reads an object by number and by name.",
            needs: &[],
            run: sdo_read,
        },
        Step {
            name: "sdo_write",
            proves: "`ecan sdo write` writes an object; a value out of range is rejected.",
            needs: &[],
            run: sdo_write,
        },
        Step {
            name: "sdo_list",
            proves: "`ecan sdo list` reads all entries of an object.",
            needs: &[],
            run: |bench| succeeds(bench, &["sdo", "list", "0x8010"]),
        },
        Step {
            name: "diag",
            proves: "`ecan diag` reads the diagnostic objects; a support bundle is explained offline.",
            needs: &[],
            run: diag,
        },
        Step {
            name: "reg",
            proves: "`ecan reg` reads and writes a register of a CAN controller.",
            needs: &[],
            run: reg,
        },
        Step {
            name: "filter",
            proves: "`ecan filter` adds, lists and removes a filter.",
            needs: &[],
            run: filter,
        },
        Step {
            name: "pins",
            proves: "`ecan pins` shows and sets the rotation of the connectors.",
            needs: &[],
            run: pins,
        },
        Step {
            name: "reboot",
            proves: "`ecan reboot --wait` reports the gateway that has restarted.",
            needs: &[],
            run: reboot,
        },
        Step {
            name: "send",
            proves: "`ecan send` reports a frame as sent.",
            needs: &[Need::EchoNodes],
            run: send,
        },
        Step {
            name: "send_without_node",
            proves: "A frame that no node acknowledges is reported with the cause.",
            needs: &[Need::Simulated],
            run: send_without_node,
        },
        Step {
            name: "gen",
            proves: "`ecan gen` sends mixed frames, and each returns.",
            needs: &[Need::EchoNodes],
            run: generate,
        },
        Step {
            name: "replay",
            proves: "`ecan replay` sends a recording, and each frame returns.",
            needs: &[Need::EchoNodes],
            run: replay,
        },
        Step {
            name: "dump",
            proves: "`ecan dump -T` ends when no frame arrives.",
            needs: &[],
            run: dump,
        },
        Step {
            name: "monitor",
            proves: "`ecan monitor` shows a gateway as ready.",
            needs: &[],
            run: monitor,
        },
        Step {
            name: "bridge_slcan",
            proves: "A client of the slcan bridge sends a frame and receives it again.",
            needs: &[Need::EchoNodes],
            run: bridge_slcan,
        },
        Step {
            name: "bridge_socketcan",
            proves: "`ecan bridge --socketcan` starts and ends with a virtual CAN interface of Linux.",
            needs: &[Need::LastingBus, Need::EchoNodes, Need::Root, Need::System("ip")],
            run: bridge_socketcan,
        },
        Step {
            name: "selftest",
            proves: "`ecan selftest` tests each channel by loopback and restores the configuration.",
            needs: &[],
            run: selftest,
        },
        Step {
            name: "no_library_noise",
            proves: "Commands that wait for a gateway print no messages of the library.",
            needs: &[Need::LastingBus],
            run: no_library_noise,
        },
    ],
};

/// Runs a command of `ecan` for the first gateway; returns its JSON.
fn json(bench: &mut Bench, arguments: &[&str]) -> Result<Value, Stop> {
    bench.bus(BusSpec::any(1))?;
    let mut command = bench.ecan_first(["--json"]);
    command.args(arguments);
    bench.run(command)?.expect(0)?.json()
}

fn succeeds(bench: &mut Bench, arguments: &[&str]) -> Result<(), Stop> {
    bench.bus(BusSpec::any(1))?;
    let command = bench.ecan_first(arguments);
    bench.run(command)?.expect(0).map(drop)
}

fn info(bench: &mut Bench) -> Result<(), Stop> {
    let info = json(bench, &["info"])?;
    let channels = info["channels"].as_array().map_or(0, Vec::len);
    check(channels == 4 && info["firmware"].is_string(), || format!("incomplete: {info}"))
}

fn caps(bench: &mut Bench) -> Result<(), Stop> {
    let caps = json(bench, &["caps"])?;
    let entries = caps.as_array().cloned().unwrap_or_default();
    // Older firmware lacks some entries.
    let is_unread = |entry: &&Value| {
        entry["error"].as_str().is_some_and(|error| !error.contains("does not exist"))
    };
    let unread: Vec<_> = entries.iter().filter(is_unread).collect();
    check(!entries.is_empty() && unread.is_empty(), || format!("not read: {unread:?}"))
}

fn sdo_read(bench: &mut Bench) -> Result<(), Stop> {
    let by_number = json(bench, &["sdo", "read", "0xF000:18"])?;
    check(by_number["value"] == 24, || format!("0xF000:18 is not 24: {by_number}"))?;
    let by_name = json(bench, &["sdo", "read", "device objects:PDO fixed header bytes"])?;
    check(by_name["value"] == by_number["value"], || format!("by name: {by_name}"))
}

fn sdo_write(bench: &mut Bench) -> Result<(), Stop> {
    succeeds(bench, &["sdo", "write", "0x8010:3", "5"])?;
    if bench.kind != Kind::Library {
        let value = json(bench, &["sdo", "read", "0x8010:3"])?;
        check(value["value"] == 5, || format!("0x8010:03 does not keep 5: {value}"))?;
    }
    let command = bench.ecan_first(["sdo", "write", "0x8010:3", "300"]);
    bench.run(command)?.expect(2)?.expect_text("out of range").map(drop)
}

fn diag(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::any(1))?;
    let record = bench.with_ethercat(bench.ecan_first(["diag", "--record", "bundle.json"]));
    let _ = std::fs::remove_file(bench.work.join("bundle.json"));
    bench.run(record)?.expect_one_of(&[0, 1])?;
    let explain = bench.plain("ecan", ["diag", "--from", "bundle.json"]);
    bench.run(explain)?.expect_one_of(&[0, 1])?.expect_text("CAN0").map(drop)
}

fn reg(bench: &mut Bench) -> Result<(), Stop> {
    succeeds(bench, &["reg", "read", "PSR", "--channel", "0"])?;
    succeeds(bench, &["reg", "write", "IR", "0xFFFFFFFF", "--channel", "0"])
}

fn filter(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::any(1))?;
    let add = bench.ecan_first(["filter", "add", "--channel", "0", "--id", "0x123"]);
    bench.run(add)?.expect(0)?.expect_text("0x123")?;
    if bench.kind == Kind::Library {
        return Ok(());
    }
    let list = bench.ecan_first(["filter", "list", "--channel", "0"]);
    bench.run(list)?.expect(0)?.expect_text("0x123")?;
    let clear = bench.ecan_first(["filter", "clear", "--channel", "0"]);
    bench.run(clear)?.expect(0)?.expect_text("no filters").map(drop)
}

fn pins(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::any(1))?;
    let rotate = bench.ecan_first(["pins", "1"]);
    bench.run(rotate)?.expect(0)?.expect_text("rotation   1")?;
    let restore = bench.ecan_first(["pins", "0"]);
    bench.run(restore)?.expect(0)?.expect_text("rotation   0").map(drop)
}

fn reboot(bench: &mut Bench) -> Result<(), Stop> {
    let report = json(bench, &["reboot", "--wait"])?;
    if let Some(ms) = report["after_ms"].as_f64() {
        bench.figure("restarted_ms", ms);
    }
    check(report["is_back"] == true, || format!("not back: {report}"))
}

fn send(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::echo(1))?;
    let command = bench.ecan_first(["send", "--bitrate", "500000", "123#1122334455667788"]);
    bench.run(command)?.expect(0)?.expect_text("sent").map(drop)
}

fn send_without_node(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec { gateways: 1, nodes: Nodes::None, ..BusSpec::default() })?;
    let command = bench.ecan_first(["send", "--bitrate", "500000", "123#11"]);
    bench.run(command)?.expect(1)?.expect_text("no acknowledgement").map(drop)
}

/// Expects the report of a command that sends frames: all were sent and returned.
fn expect_all(report: &Value, frames: u64) -> Result<(), Stop> {
    let counts = (report["sent"].as_u64(), report["lost"].as_u64(), report["received"].as_u64());
    check(counts == (Some(frames), Some(0), Some(frames)), || {
        format!("(sent, lost, received) = {counts:?}, expected {frames}: {report}")
    })
}

fn generate(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::echo(1))?;
    let command = bench.ecan_first([
        "--json",
        "gen",
        "-n",
        "200",
        "-g",
        "5",
        "--mix",
        "--seed",
        "1",
        "--bitrate",
        "500000",
        "--data-bitrate",
        "2000000",
    ]);
    let report = bench.run(command)?.expect(0)?.json()?;
    expect_all(&report, 200)
}

fn replay(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::echo(1))?;
    let log = super::recording(bench, 200)?;
    let command = bench.ecan_first(["--json", "replay", "--bitrate", "500000", &log]);
    let report = bench.run(command)?.expect(0)?.json()?;
    expect_all(&report, 200)
}

fn dump(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::any(1))?;
    let command = bench.ecan_first(["dump", "-n", "1", "-T", "500", "--channel", "0"]);
    bench.run(command)?.expect(1)?.expect_text("no frame received").map(drop)
}

fn monitor(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::any(1))?;
    let command = bench.ecan_first(["monitor", "--once"]);
    bench.run(command)?.expect(0)?.expect_text("ready").map(drop)
}

/// Time limit of a connection.
const LIMIT: Duration = Duration::from_secs(60);

fn bridge_slcan(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::echo(1))?;
    let command = bench.ecan_first(["bridge", "--slcan", "--bitrate", "500000"]);
    let mut bridge = bench.start(command)?;
    let prefix = "slcan bridge at ";
    bridge.wait_for(prefix, bench.limit(LIMIT))?;
    let line = bridge.lines.iter().find_map(|line| line.text.strip_prefix(prefix));
    let address = line.and_then(|rest| rest.split(' ').next()).unwrap_or_default().to_owned();
    let limit = bench.limit(LIMIT);
    // Connection errors are those of the bridge: its output follows.
    let received =
        slcan_echo(&address, limit).unwrap_or_else(|error| format!("{address}: {error}"));
    let finished = bridge.stop(Signal::SIGINT, limit)?;
    let finished = bench.note(finished).expect(0)?;
    check(received.contains("t1232AABB"), || {
        format!("no echo of t1232AABB: {received:?}; {}", finished.end_text())
    })
}

/// Sends a frame over slcan until it returns.
fn slcan_echo(address: &str, limit: Duration) -> std::io::Result<String> {
    let mut stream = TcpStream::connect(address)?;
    stream.set_read_timeout(Some(Duration::from_millis(500)))?;
    stream.write_all(b"S6\rO\r")?;
    let begin = std::time::Instant::now();
    let mut received = String::new();
    let mut bytes = [0; 256];
    while !received.contains("t1232AABB") && begin.elapsed() < limit {
        // Rejected while the gateway is not ready.
        stream.write_all(b"t1232AABB\r")?;
        if let Ok(count) = stream.read(&mut bytes) {
            received.push_str(&String::from_utf8_lossy(&bytes[..count]));
        }
    }
    Ok(received)
}

fn bridge_socketcan(bench: &mut Bench) -> Result<(), Stop> {
    const INTERFACE: &str = "ecanacc0";
    bench.bus(BusSpec::echo(1))?;
    let add = bench.system("ip", ["link", "add", "dev", INTERFACE, "type", "vcan"]);
    let added = bench.run(add)?;
    if added.code() != Some(0) {
        let cause = added.errors();
        let cause = cause.trim();
        return Err(Stop::Skipped(format!("no virtual CAN interface: {cause}; try modprobe vcan")));
    }
    let outcome = on_virtual_interface(bench, INTERFACE);
    let delete = bench.system("ip", ["link", "delete", INTERFACE]);
    bench.restore(delete)?;
    outcome
}

fn on_virtual_interface(bench: &mut Bench, interface: &str) -> Result<(), Stop> {
    let up = bench.system("ip", ["link", "set", interface, "up"]);
    bench.run(up)?.expect(0)?;
    let command = bench.ecan_first(["bridge", "--socketcan", interface, "--bitrate", "500000"]);
    let mut bridge = bench.start(command)?;
    let limit = bench.limit(LIMIT);
    bridge.wait_for(interface, limit)?;
    bench.pause(Duration::from_secs(1))?;
    let finished = bridge.stop(Signal::SIGINT, limit)?;
    bench.note(finished).expect(0).map(drop)
}

fn selftest(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::any(1))?;
    let frames = if bench.arguments.quick { "8" } else { "96" };
    let cycle = bench.arguments.cycle_us.to_string();
    let mut command = bench.ecan_first(["selftest", "--frames", frames, "--cycle-us", &cycle]);
    command.args(bench.real_time_options());
    let finished = bench.run(command)?.expect(0)?.expect_text("passed")?;
    bench.figure("selftest_s", finished.seconds);
    Ok(())
}

fn no_library_noise(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::any(1))?;
    let command = bench.ecan_first(["reboot", "--wait"]);
    let errors = bench.run(command)?.expect(0)?.errors();
    let noise = errors.lines().filter(|line| line.starts_with("Failed to ")).count();
    check(noise == 0, || format!("{noise} messages of the library: {errors}"))
}
