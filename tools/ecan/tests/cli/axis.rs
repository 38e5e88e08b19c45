//! `ecan axis` on simulated drives, without a terminal.

use serde_json::Value;

use crate::serve::serve_bus;
use crate::support::{
    Running, Scenario, assert_has, ecan, ends, fails, good, json_of, scenario, setting,
};

/// 65536 steps per turn, as the simulated drives have.
pub const SCALE: [&str; 4] = ["--node", "1", "--steps-per-turn", "65536"];
pub const LIMITS: [&str; 4] = ["--max-velocity", "90", "--range", "-100..100"];
const ALONE: [&str; 2] = ["--yes", "--unattended"];
const DRIVES: [&str; 3] = ["--ecrt", "sim:drives", "axis"];
/// Both drives of examples/network, simulated.
const MACHINE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/network/machine.toml");
const SIMULATED: &str =
    concat!("sim:", env!("CARGO_MANIFEST_DIR"), "/../../examples/network/simulated.toml");

/// Arguments of a motion of the first drive, without a terminal.
fn motion<'a>(command: &'a str, arguments: &[&'a str]) -> Vec<&'a str> {
    [&["axis", command][..], &SCALE, &LIMITS, &ALONE, arguments].concat()
}

fn drives_json(command: &str, arguments: &[&str]) -> Value {
    let arguments = [&["--json", "--ecrt", "sim:drives"], &motion(command, arguments)[..]].concat();
    json_of(&good(&arguments))
}

fn drives_fail(status: i32, command: &str, arguments: &[&str]) -> String {
    fails(status, &[&["--ecrt", "sim:drives"], &motion(command, arguments)[..]].concat())
}

/// A scenario with one drive at position 0, with further keys and tables.
fn one_drive(keys: &str, tables: &str) -> Scenario {
    Scenario::new(&format!(
        "[[node]]\nkind = \"drive\"\nname = \"x\"\nbus = \"0.0\"\nnode_id = 1\n{keys}{tables}"
    ))
}

fn fault_after(ms: u32, code: u16) -> String {
    format!(
        "[[fault]]\nafter_ready_ms = {ms}\nkind = \"drive_error\"\nnode = \"x\"\ncode = {code}\n"
    )
}

#[test]
fn status_names_bits_and_obstacles() {
    let text = good(&[&DRIVES[..], &["status", "--node", "1"]].concat());
    for line in [
        "state            switch on disabled (statusword 0x0240)",
        "bits set         switch on disabled (6), remote (9)",
        "position         1007 step",
        "  1. the drive reports no obstacle; no program has enabled it",
    ] {
        assert!(text.lines().any(|shown| shown == line), "{line}: {text}");
    }
    let faulty = one_drive("", &fault_after(1, 0x2310));
    let status = ["--ecrt", &faulty.setting(), "axis", "status", "--node", "1"];
    let text = ends(1, &status);
    let expected =
        "  1. the drive is in fault: error code 0x2310 continuous over-current at the output\n";
    assert!(text.contains(expected) && text.contains("ecan axis enable --reset-fault"), "{text}");
    let report = json_of(&ends(1, &[&["--json"], &status[..]].concat()));
    assert_eq!((&report["state"], &report["has_fault"]), (&"fault".into(), &true.into()));
    assert_eq!(report["bits"][3], serde_json::json!({"bit": 3, "name": "fault", "is_set": true}));
    assert_eq!((&report["error_code"], &report["unit"]), (&0x2310.into(), &"step".into()));
}

#[test]
fn status_watch_prints_each_change() {
    let faulty = one_drive("", &fault_after(1_500, 0x7121));
    let watch = ["axis", "status", "--node", "1", "--watch", "--for", "3s"];
    let text = faulty.good(&watch);
    let lines: Vec<_> = text.lines().collect();
    assert_eq!(lines.len(), 2, "{text}");
    assert_eq!(lines[0], "0.0 s: switch on disabled (0x0240), position 0 step");
    assert!(
        lines[1].ends_with("s: fault (0x0208), position 0 step, error code 0x7121 motor blocked"),
        "{text}"
    );
}

#[test]
fn status_of_another_node_is_rejected() {
    let echo = Scenario::new("[[node]]\nkind = \"silent\"\nbus = \"0.0\"\n");
    let message = echo.fails(5, &["axis", "status", "--node", "9"]);
    assert!(message.contains("0x6041") && message.contains("no answer"), "{message}");
}

#[test]
fn move_ends_at_its_target_within_the_limits() {
    for mode in ["csp", "pp"] {
        let moved = drives_json("move", &["--to", "45", "--mode", mode]);
        let number = |key: &str| moved[key].as_f64().unwrap();
        assert!((number("start") - 5.532).abs() < 0.001, "{moved}");
        assert!((number("end") - 45.0).abs() < 0.01, "{mode}: {moved}");
        // 39.5 degrees at 90 deg/s with ramps of half a second.
        let least = 39.468 / 90.0 + 0.5 - 0.1;
        assert!((least..2.5).contains(&number("seconds")), "{mode}: {moved}");
    }
    let slow = drives_json("move", &["--by", "-10", "--velocity", "5"]);
    assert!((slow["end"].as_f64().unwrap() + 4.468).abs() < 0.01, "{slow}");
    assert!(slow["seconds"].as_f64().unwrap() > 1.9, "10 degrees at 5 deg/s: {slow}");
}

#[test]
fn other_units_and_directions_move_likewise() {
    let run = |options: &[&str]| {
        let arguments =
            [&["--json"], &DRIVES[..], &["move", "--node", "1"], &ALONE, options].concat();
        json_of(&good(&arguments))
    };
    let limits =
        ["--unit", "step", "--max-velocity", "20000", "--range", "0..9000", "--to", "8000"];
    let moved = run(&limits);
    assert!((moved["end"].as_f64().unwrap() - 8_000.0).abs() < 10.0, "{moved}");
    let limits =
        ["--steps-per-turn", "-65536", "--max-velocity", "90", "--range", "-90..0", "--to", "-40"];
    let moved = run(&limits);
    assert!((moved["start"].as_f64().unwrap() + 5.532).abs() < 0.01, "{moved}");
    assert!((moved["end"].as_f64().unwrap() + 40.0).abs() < 0.01, "{moved}");
    let limits = [
        "--steps-per-turn",
        "65536",
        "--unit",
        "turn",
        "--max-velocity",
        "0.001",
        "--range",
        "0..1",
        "--by",
        "0.002",
    ];
    let moved = run(&limits);
    assert!(moved["seconds"].as_f64().unwrap() > 2.0, "slower than a step per cycle: {moved}");
}

#[test]
fn limits_have_no_defaults() {
    for command in ["enable", "jog", "move", "home", "tune"] {
        let arguments = [&DRIVES[..], &[command], &SCALE, &ALONE].concat();
        let message = fails(2, &arguments);
        assert!(message.contains("--max-velocity") && message.contains("--range"), "{message}");
    }
}

#[test]
fn motion_outside_the_range_is_rejected() {
    let message = drives_fail(2, "move", &["--to", "101"]);
    assert!(message.contains("the target 101.000 deg is outside the range"), "{message}");
    // Found out when the position is known: the drive was never enabled.
    let output = ecan(&[&["--ecrt", "sim:drives"], &motion("move", &["--by", "150"])[..]].concat());
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{errors}");
    assert!(errors.contains("the target 155.532 deg is outside"), "{errors}");
    assert!(!errors.contains("following targets"), "{errors}");
    let far =
        ["--node", "1", "--unit", "step", "--max-velocity", "90", "--range", "0..900", "--to", "5"];
    let message = fails(2, &[&DRIVES[..], &["move"], &far, &ALONE].concat());
    assert!(message.contains("the actual position 1007 step is outside the range"), "{message}");
    // An overshoot of an earlier motion is led back.
    let near = ["--node", "1", "--unit", "step", "--max-velocity", "900", "--range", "0..1000"];
    let back = [&["--json"], &DRIVES[..], &["move", "--to", "900"], &near, &ALONE].concat();
    let moved = json_of(&good(&back));
    assert_eq!(moved["start"], 1_007.0, "{moved}");
    assert!((moved["end"].as_f64().unwrap() - 900.0).abs() < 10.0, "{moved}");
    let message = drives_fail(2, "tune", &["--step", "120"]);
    assert!(message.contains("would move the axis to 125.532 deg, outside"), "{message}");
    let message = drives_fail(2, "jog", &["--velocity", "91", "--for", "10"]);
    assert!(message.contains("--velocity 91.000 deg/s is out of range"), "{message}");
}

#[test]
fn motion_needs_an_operator_or_consent() {
    let to = ["--to", "10"];
    let with = |options: &[&str]| {
        fails(2, &[&DRIVES[..], &["move"], &SCALE, &LIMITS, &to, options].concat())
    };
    let message = with(&["--yes"]);
    assert!(message.contains("neither a terminal nor a pipe"), "{message}");
    assert!(message.contains("use --unattended"), "{message}");
    assert_has(&with(&["--unattended"]), "cannot ask for confirmation of motion of node 1 on can0");
    assert_has(&drives_fail(2, "jog", &[]), "keys need a terminal");
    assert_has(&drives_fail(2, "enable", &[]), "set --for");
    let message = fails(2, &[&DRIVES[..], &["move", "--node", "1"], &LIMITS, &ALONE, &to].concat());
    assert!(message.contains("positions in deg need --steps-per-turn"), "{message}");
}

#[test]
fn jog_moves_for_its_time_and_stops_at_the_range() {
    let output = ecan(
        &[&["--ecrt", "sim:drives"], &motion("jog", &["--velocity", "-30", "--for", "1000"])[..]]
            .concat(),
    );
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{errors}");
    assert!(errors.starts_with("SIMULATED: no EtherCAT master, no hardware."), "{errors}");
    // Half a second of ramp each way at up to 30 deg/s: 180 deg/s^2.
    let end = errors.lines().last().unwrap();
    let position: f64 = end.rsplit_once("at ").unwrap().1.trim_end_matches(" deg").parse().unwrap();
    assert!((position - (5.532 - 30.0)).abs() < 1.0, "{errors}");
    let end = drives_json("jog", &["--velocity", "-30", "--for", "1000"]);
    assert!((end["position"].as_f64().unwrap() - position).abs() < 0.01, "{end}");
    assert_eq!((&end["unit"], &end["state"]), (&"deg".into(), &"switch on disabled".into()));
    let held = drives_json("enable", &["--for", "100"]);
    assert!((held["position"].as_f64().unwrap() - 5.532).abs() < 0.001, "{held}");
    let output =
        ecan(&[&["--ecrt", "sim:drives"], &motion("jog", &["--for", "10000"])[..]].concat());
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(errors.contains("the end of the range is reached"), "{errors}");
    assert!(errors.contains("off, at 99.99") || errors.contains("off, at 100.000"), "{errors}");
}

/// A motor with little torque and no friction needs seconds for its stop, and turns on without current.
#[test]
fn first_signal_begins_the_stop_and_the_second_exits() {
    let file = scenario(
        "clock = \"real\"\n[[gateway]]\n[[node]]\nkind = \"drive\"\nname = \"x\"\nbus = \"0.0\"\n\
         node_id = 1\nmotor = { max_acceleration = 1000, friction = 0 }\n",
    );
    let setting = setting(&file);
    let jog = ["--velocity", "20", "--acceleration", "4", "--for", "60000"];
    let limits = ["--max-velocity", "90", "--range", "-1000..1000"];
    let arguments =
        [&["--ecrt", &setting, "axis", "jog"][..], &SCALE, &limits, &ALONE, &jog].concat();
    let status_after = |seconds| {
        let mut running = Running::start(&arguments);
        running.wait_for_error("moving at");
        // The stop lasts as long as the motor was accelerated: on a slow machine more time is needed.
        std::thread::sleep(std::time::Duration::from_secs(seconds));
        running.terminate();
        running.wait_for_error("quick stop: ");
        // Without processor time the motion guard ends the motion first.
        if running.errors().contains("the motion ended") {
            return None;
        }
        running.wait_for_error("stopped: Ctrl-C or SIGTERM");
        running.terminate_until_ended();
        running.wait().0
    };
    let mut attempts = [4, 8, 16].into_iter().cycle().take(9);
    assert!(attempts.any(|seconds| status_after(seconds) == Some(130)));
}

#[test]
fn homing_finds_a_switch_and_keeps_its_travel() {
    let homed = drives_json("home", &["--method", "35"]);
    assert_eq!(homed["position"], 0.0, "{homed}");
    let wide = ["--max-velocity", "2000", "--range", "-4000..10", "--method", "1"];
    let home = [&["--json"], &DRIVES[..], &["home"], &SCALE, &ALONE, &wide].concat();
    let homed = json_of(&good(&home));
    // The negative limit switch is at -500,000 steps; the next index pulse becomes 0.
    assert!(homed["position"].as_f64().unwrap().abs() < 1.0, "{homed}");
    assert!(homed["seconds"].as_f64().unwrap() > 1.0, "{homed}");
    let message = drives_fail(5, "home", &["--method", "1"]);
    assert!(message.contains("is outside the range"), "the switch is farther: {message}");
    assert!(message.contains("stopped, switch on disabled"), "{message}");
    let message = drives_fail(2, "home", &["--method", "1", "--switch-speed", "100"]);
    assert!(message.contains("--switch-speed 100.000 deg/s is out of range"), "{message}");
}

#[test]
fn stop_is_confirmed_by_the_drive() {
    let output = ecan(&[&DRIVES[..], &["stop", "--node", "1"]].concat());
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{errors}");
    assert!(errors.contains("node 1 on can0: stopped, switch on disabled"), "{errors}");
    let end = json_of(&good(&[&["--json"], &DRIVES[..], &["stop", "--node", "1"]].concat()));
    assert_eq!(end["axis"], "node 1 on can0", "{end}");
    assert_eq!(end["state"], "switch on disabled", "{end}");
    let message = fails(5, &[&DRIVES[..], &["stop", "--node", "77"]].concat());
    assert!(message.contains("node 77 on can0: no answer; check the node-ID"), "{message}");
}

#[test]
fn fault_while_moving_ends_the_command() {
    let faulty = one_drive("", &fault_after(1_500, 0x8611));
    let message = faulty.fails(5, &motion("jog", &["--velocity", "5", "--for", "20000"]));
    assert!(message.contains("the motion ended: fault"), "{message}");
    assert!(message.contains("0x8611"), "{message}");
}

#[test]
fn hold_after_an_outage_names_the_next_step() {
    let outage =
        "[[fault]]\nafter_ready_ms = 1500\nkind = \"link_loss\"\ngateway = 0\nfor_ms = 300\n";
    let drive = one_drive("", outage);
    let message = drive.fails(5, &motion("jog", &["--velocity", "5", "--for", "20000"]));
    let next = "the motion ended: holding: the working counter stayed incomplete; next: check the \
                EtherCAT link and the real-time priority, then run the command again";
    assert!(message.ends_with(next), "{message}");
    for told in ["slave 0: lost, waits for the network link of the master", "slave 0: ready after "]
    {
        assert_eq!(message.matches(told).count(), 1, "{told}: {message}");
    }
}

#[test]
fn drive_in_fault_is_explained_and_reset_on_request() {
    let faulty = one_drive("", &fault_after(1, 0x3210));
    assert_has(
        &faulty.fails(5, &motion("enable", &["--for", "100"])),
        "not enabled, because:\n  1. the drive is in fault: error code 0x3210",
    );
    let output = faulty.run(&motion("enable", &["--for", "100", "--reset-fault"]));
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{errors}");
    assert!(errors.contains("enabled for 100 ms"), "{errors}");
}

#[test]
fn drive_that_would_not_stop_without_the_host_is_rejected() {
    let drive = one_drive("[node.quirks]\nmissing = [0x6007]\n", "");
    let enable = motion("enable", &["--for", "100"]);
    let message = drive.fails(5, &enable);
    assert!(message.contains("not enabled, since its motor would not stop"), "{message}");
    assert!(message.contains("--accept-risk"), "{message}");
    let output = drive.run(&[&enable[..], &["--accept-risk"]].concat());
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && errors.contains("warning: if this host fails"), "{errors}");
}

#[test]
fn scale_of_the_drive_and_its_limits_are_compared() {
    let to = ["--to", "10", "--max-velocity", "90", "--range", "-100..100"];
    let scale = ["--node", "1", "--steps-per-turn", "60000"];
    let output = ecan(&[&DRIVES[..], &["move"], &scale, &to, &ALONE].concat());
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{errors}");
    assert!(errors.contains("warning: steps_per_turn is 60000, the drive has 65536"), "{errors}");
    // A drive whose device file limits the positions to 20 degrees.
    let limited = Scenario::new(
        "[[node]]\nkind = \"drive\"\nname = \"x\"\nbus = \"0.0\"\nnode_id = 1\neds = \"x.eds\"\n",
    );
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/network/servo_drive.eds");
    let text = std::fs::read_to_string(path).unwrap();
    assert_eq!(text.matches("DefaultValue=2147483647").count(), 1, "0x607D:02");
    limited.write("x.eds", &text.replace("DefaultValue=2147483647", "DefaultValue=3641"));
    let message = limited.fails(2, &motion("move", &["--to", "90"]));
    let expected = "the target 90.000 deg is outside the range -99.998..20.001 deg";
    assert!(message.contains(expected), "{message}");
    let output = limited.run(&motion("jog", &["--for", "5000"]));
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && errors.contains("the end of the range"), "{errors}");
    assert!(errors.contains("off, at 20.0") || errors.contains("off, at 19.99"), "{errors}");
}

#[test]
fn drive_that_moves_too_fast_is_stopped() {
    // By this unit the drive gets three times the velocity and acceleration.
    let wrong = ["--mode", "pp", "--to", "95", "--velocity-units", "196608"];
    let message = drives_fail(5, "move", &wrong);
    assert!(message.contains("the actual velocity is "), "{message}");
    assert!(message.contains("deg/s; allowed: 90.000 deg/s"), "{message}");
    assert!(message.contains("stopped, switch on disabled"), "{message}");
}

#[test]
fn blocked_motor_ends_the_motion() {
    let blocked = "[[fault]]\nafter_ready_ms = 1500\nkind = \"drive_blocked\"\nnode = \"x\"\nfor_ms = 60000\n";
    let drive = one_drive("", blocked);
    let message = drive.fails(5, &motion("jog", &["--velocity", "40", "--for", "20000"]));
    assert!(message.contains("x") && message.contains("stopped, "), "{message}");
    assert!(
        message.contains("motion guard rejected a target") || message.contains("the motion ended"),
        "{message}"
    );
}

#[test]
fn step_has_figures_and_a_picture() {
    let files = Scenario::new("");
    let path = files.path("step.svg");
    let step = ["--step", "20", "--acceleration", "2000", "--plot", &path];
    let report = drives_json("tune", &step);
    let figure = |key: &str| report["step"][key].as_f64().unwrap();
    assert!(figure("overshoot_percent") < 1.0, "{report}");
    assert!(figure("settling_s") < 0.1, "{report}");
    // A lag of 4 ms at 90 deg/s.
    assert!((0.1..1.0).contains(&figure("max_error")), "{report}");
    assert!(figure("rms_error") < figure("max_error"), "{report}");
    let svg = files.read("step.svg");
    for text in
        ["SIMULATED", "position [deg]", "error [deg]", "node 1 on can0: CSP step", " axis tune "]
    {
        assert!(svg.contains(text), "{text}");
    }
    let velocity = drives_json("tune", &["--mode", "csv", "--step", "-60", "--settle", "300"]);
    assert_eq!(velocity["unit"], "deg/s");
    assert!(velocity["step"]["overshoot_percent"].as_f64().unwrap() < 5.0, "{velocity}");
    // Without feed-forward the drive lags by velocity / gain: 90 / 60 degrees more.
    let soft = one_drive("motor = { position_gain = 60, feed_forward = 0 }\n", "");
    let json = ["--json"];
    let lagging = json_of(&soft.good(&[&json[..], &motion("tune", &step[..4])].concat()));
    let lag = lagging["step"]["max_error"].as_f64().unwrap();
    assert!((lag - figure("max_error") - 1.5).abs() < 0.1, "{lagging}");
}

#[test]
fn plot_that_cannot_be_written_is_reported_before_the_motion() {
    let message = drives_fail(6, "tune", &["--step", "1", "--plot", "/none/step.svg"]);
    let expected = "ecan: cannot write /none/step.svg: the directory does not exist; create it, or name another one";
    assert_eq!(message, expected, "nothing moves");
    let message = drives_fail(2, "tune", &["--step", "1", "--plot", "step.png"]);
    assert!(message.contains("only SVG is written: use a name that ends in .svg"), "{message}");
    // The link to a device is writable until the end, when it is full: the results are printed.
    let files = Scenario::new("");
    let full = files.path("full.svg");
    std::os::unix::fs::symlink("/dev/full", &full).unwrap();
    let step = motion("tune", &["--step", "1", "--plot", &full]);
    let output = ecan(&[&["--ecrt", "sim:drives"], &step[..]].concat());
    assert_eq!(output.status.code(), Some(6));
    assert_has(&String::from_utf8(output.stdout).unwrap(), "settling time");
    assert_has(&String::from_utf8(output.stderr).unwrap(), "full.svg: No space left on device");
}

#[test]
fn picture_of_a_test_that_failed_names_the_cause() {
    let drive = one_drive("", &fault_after(1_500, 0x8611));
    let path = drive.path("fault.svg");
    let sweep = ["--sweep", "0.2..1", "--amplitude", "5", "--plot", &path];
    assert_has(&drive.fails(5, &motion("tune", &sweep)), "the motion ended: fault");
    let svg = drive.read("fault.svg");
    assert!(svg.contains("quick stop: node 1 on can0: the motion ended: fault"));
}

#[test]
fn sweep_measures_gain_and_phase() {
    let files = Scenario::new("");
    let path = files.path("sweep.svg");
    for mode in ["csp", "csv"] {
        let sweep = ["--sweep", "1..16", "--amplitude", "4", "--points", "5", "--mode", mode];
        let limits = ["--acceleration", "5000", "--plot", &path];
        let report = drives_json("tune", &[&sweep[..], &limits].concat());
        let points = report["sweep"].as_array().unwrap();
        assert_eq!(points.len(), 5, "{report}");
        let svg = files.read("sweep.svg");
        for text in
            ["gain [dB]", "phase [deg]", "frequency [Hz], logarithmic", "time since the start [s]"]
        {
            assert!(svg.contains(text), "{text}");
        }
        let value = |nth: usize, key: &str| points[nth][key].as_f64().unwrap();
        assert!((value(0, "gain") - 1.0).abs() < 0.02, "{report}");
        // The delay of the communication and the drive: the phase falls with the frequency.
        let phases: Vec<_> = (0..5).map(|nth| value(nth, "phase_deg")).collect();
        assert!(phases.is_sorted_by(|a, b| a > b) && phases[4] > -90.0, "{phases:?}");
        assert!((value(4, "hertz") - 16.0).abs() < 0.5, "{report}");
    }
}

#[test]
fn axis_of_a_file_is_selected_by_name_or_index() {
    let run = |axis: &str| {
        let arguments =
            ["--json", "--ecrt", SIMULATED, "axis", "move", "--config", MACHINE, "--axis", axis];
        let limits = ["--max-velocity", "60", "--range", "-90..90", "--to", "20"];
        let moved = good(&[&arguments[..], &limits, &ALONE].concat());
        json_of(&moved)
    };
    let (named, numbered) = (run("elbow"), run("1"));
    assert_eq!(named["axis"], "axis elbow (node 2 on can0)");
    assert_eq!(named, numbered);
    assert!((named["end"].as_f64().unwrap() - 20.0).abs() < 0.05, "{named}");
    let status = ["--ecrt", SIMULATED, "axis", "status", "--config", MACHINE, "--axis"];
    assert!(
        good(&[&status[..], &["shoulder"]].concat()).contains("axis shoulder (node 1 on can0)")
    );
    let message = fails(2, &[&status[..], &["wrist"]].concat());
    assert!(message.contains("--axis wrist: no such axis; axes of "), "{message}");
    assert!(message.ends_with("0 (shoulder), 1 (elbow)"), "{message}");
    let message = fails(2, &[&status[..], &["0", "--slave", "0"]].concat());
    assert!(message.contains("the axis determines its gateway"), "{message}");
}

#[test]
fn limits_of_a_file_narrow_those_of_the_command() {
    // The file allows 6 rad/s.
    let arguments = ["--ecrt", SIMULATED, "axis", "jog", "--config", MACHINE, "--axis", "elbow"];
    let limits =
        ["--max-velocity", "1000", "--range", "-90..90", "--velocity", "400", "--for", "10"];
    let message = fails(2, &[&arguments[..], &limits, &ALONE].concat());
    assert!(message.contains("allowed: above 0, up to 343.775 deg/s"), "{message}");
}

#[test]
fn motion_through_a_service_is_rejected_and_status_is_not() {
    let mut served = serve_bus("sim:drives", &[]);
    served.program.wait_for_error("slave 0: ready");
    let via = ["--via", served.path.as_str()];
    for command in [&["move", "--to", "1"][..], &["jog", "--for", "10"], &["enable", "--for", "10"]]
    {
        let message = fails(3, &[&via[..], &motion(command[0], &command[1..])].concat());
        assert!(message.contains("only the owner of the master moves an axis"), "{message}");
        assert!(message.contains("end that program"), "{message}");
    }
    let message = fails(3, &[&via[..], &["axis", "stop", "--node", "1"]].concat());
    assert!(message.contains("only the owner of the master"), "{message}");
    let status = good(&[&via[..], &["axis", "status", "--node", "1"]].concat());
    assert!(status.contains("switch on disabled"), "{status}");
    served.end();
}

#[test]
fn status_of_an_axis_of_a_file_is_read_through_a_service() {
    let mut served = serve_bus(SIMULATED, &["--config", MACHINE]);
    served.program.wait_for_error("slave 0: ready");
    let via = ["--via", served.path.as_str(), "axis", "status", "--config", MACHINE];
    let status = good(&[&via[..], &["--axis", "elbow"]].concat());
    assert!(status.contains("axis elbow (node 2 on can0)"), "{status}");
    assert!(status.contains("position         0.000 deg"), "{status}");
    served.end();
}

#[test]
fn arguments_of_an_axis_exclude_each_other() {
    for (arguments, expected) in [
        (&["--axis", "x"][..], "--config"),
        (&[], "--node <ID>"),
        (&["--node", "1", "--steps-per-turn", "0", "--unit", "deg"], "must not be 0"),
        (&["--node", "0.1", "--channel", "1"], "different channels"),
        (&["--config", MACHINE, "--axis", "0", "--node", "1"], "cannot be used with"),
    ] {
        let message = fails(2, &[&DRIVES[..], &["status"], arguments].concat());
        assert!(message.contains(expected), "{arguments:?}: {message}");
    }
    let file = scenario("[[gateway]]\n[[gateway]]\n");
    let message = fails(4, &["--ecrt", &setting(&file), "axis", "status", "--node", "1"]);
    assert!(message.contains("several gateways; select one with --slave"), "{message}");
}
