//! The CiA 402 demos and the SDO probe as a user runs them.

use crate::program::{
    all_fail, command, contains_all, fails, interrupt_after, run, succeeds, text,
};

const SINGLE: &str = "cia402_single_axis_demo";
const TEN: &str = "cia402_10axis_demo";
const PROBE: &str = "canopen_sdo_probe";

/// The line of an axis in the table, as columns from the right: target, actual, following error, its
/// maximum, TPDOs, lost, EMCY.
fn axis_line(printed: &str, axis: usize) -> (String, Vec<i64>) {
    let start = format!("{axis}: node");
    let line = printed
        .lines()
        .find(|line| line.starts_with(&start))
        .unwrap_or_else(|| panic!("{printed}"));
    let expected: Vec<&str> = line.split_whitespace().collect();
    let numbers = expected[expected.len() - 7..].iter().map(|word| word.parse().unwrap()).collect();
    (line.to_owned(), numbers)
}

#[test]
fn one_axis_is_enabled_without_motion() {
    let printed = succeeds(SINGLE, &["--ecrt", "sim", "--step", "0", "--slaves", "2"]);
    assert!(printed.contains("2 gateway(s) ready"), "{printed}");
    assert!(printed.starts_with("SIMULATED"), "{printed}");
    assert!(printed.contains("all axes enabled"), "{printed}");
    let (line, numbers) = axis_line(&printed, 0);
    assert!(line.contains("operation enabled"), "{line}");
    // The drive of the scenario stands at 1007.
    assert_eq!(numbers[..4], [1007, 1007, 0, 0], "{line}");
    assert_eq!(numbers[5..], [0, 0], "no TPDO lost, no emergency: {line}");
}

#[test]
fn one_axis_follows_its_steps_and_is_plotted() {
    let directory = tempfile::tempdir().unwrap();
    let plot = directory.path().join("axis.svg");
    let arguments = ["--ecrt", "sim", "--step", "100", "--cycles", "2000", "--plot"];
    let printed = succeeds(SINGLE, &[&arguments[..], &[plot.to_str().unwrap()]].concat());
    let (line, numbers) = axis_line(&printed, 0);
    let travelled = numbers[1] - 1007;
    assert!((190_000..200_000).contains(&travelled), "{line}");
    assert!(numbers[0] - numbers[1] < 1_000, "the axis follows: {line}");
    let svg = std::fs::read_to_string(plot).unwrap();
    let parts = [
        "axis 0: node 1 (slave 0, channel 0), CSP",
        "position [inc]",
        "following error: largest 401 inc",
        "SIMULATED",
        "cia402_single_axis_demo --ecrt sim --step 100 --cycles 2000 --plot ",
    ];
    contains_all(&svg, &parts);
    assert!(svg.trim_end().ends_with("</svg>"));
}

#[test]
fn fault_of_a_drive_is_marked_in_the_plot() {
    let directory = tempfile::tempdir().unwrap();
    let plot = directory.path().join("axis.svg");
    let scenario = concat!("sim:", env!("CARGO_MANIFEST_DIR"), "/scenarios/drive_fault.toml");
    let arguments = ["--ecrt", scenario, "--step", "100", "--cycles", "400", "--plot"];
    let output = run(SINGLE, &[&arguments[..], &[plot.to_str().unwrap()]].concat());
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    let svg = std::fs::read_to_string(plot).unwrap();
    assert!(svg.contains("the drive is in fault, error code 0x2310"), "{svg}");
    assert_eq!(
        svg.matches("fill=\"#C02B2B\" stroke=\"none\"").count(),
        5,
        "the fault in both panels and their legends, and the mark of the simulation"
    );
}

/// A drive of a scenario with these faults.
fn faulty_drive(faults: &str) -> String {
    format!(
        "[[gateway]]\n[[node]]\nkind = \"drive\"\nname = \"x\"\nbus = \"0.0\"\nnode_id = 1\n{faults}\
         [[fault]]\nafter_ready_ms = 4000\nkind = \"drive_error\"\nnode = \"x\"\ncode = 0x2310\n"
    )
}

#[test]
fn fault_during_a_hold_is_in_the_plot_and_the_table() {
    let bus_off = "kind = \"bus_off\"\ngateway = 0\nchannel = 0\n";
    let silent = "kind = \"node_silent\"\nnode = \"x\"\nfor_ms = 6000\n";
    let cases = [
        // The drive reports its fault while the axis holds.
        (bus_off, "the drive is in fault, error code 0x2310"),
        // The drive is silent until the shutdown.
        (silent, "found while stopping: the drive is in fault"),
    ];
    for (hold, line) in cases {
        let directory = tempfile::tempdir().unwrap();
        let path = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
        let (scenario, plot) = (path("x.toml"), path("x.svg"));
        let hold = format!("[[fault]]\nafter_ready_ms = 3000\n{hold}");
        std::fs::write(&scenario, faulty_drive(&hold)).unwrap();
        let setting = format!("sim:{scenario}");
        let arguments = ["--ecrt", &setting, "--step", "100", "--cycles", "600", "--plot", &plot];
        let output = run(SINGLE, &arguments);
        assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
        let printed = text(&output.stdout);
        let table = printed.split("\naxis ").last().unwrap();
        contains_all(table, &["held 1 time(s), last: ", line]);
        let svg = std::fs::read_to_string(plot).unwrap();
        contains_all(
            &svg,
            &[" s: holding: ", " s: the drive is in fault", "\nfault\n", "\nholding\n"],
        );
    }
}

#[test]
fn link_loss_and_its_end_are_told_once_with_the_cause() {
    let directory = tempfile::tempdir().unwrap();
    let scenario = directory.path().join("x.toml");
    let loss =
        "[[fault]]\nafter_ready_ms = 3000\nkind = \"link_loss\"\ngateway = 0\nfor_ms = 300\n";
    std::fs::write(&scenario, faulty_drive(loss)).unwrap();
    let setting = format!("sim:{}", scenario.display());
    let output = run(SINGLE, &["--ecrt", &setting, "--step", "100", "--cycles", "300"]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    let printed = text(&output.stdout);
    for told in ["slave 0: lost, waits for the network link of the master", "slave 0: ready after "]
    {
        assert_eq!(printed.matches(told).count(), 1, "{told}: {printed}");
    }
}

#[test]
fn results_are_printed_before_the_error_of_the_plot() {
    let arguments = ["--ecrt", "sim", "--cycles", "20", "--plot"];
    let png = run(SINGLE, &[&arguments[..], &["a.png"]].concat());
    assert_eq!(png.status.code(), Some(2));
    contains_all(&text(&png.stderr), &["only SVG is written: use a name that ends in .svg"]);
    assert_eq!(text(&png.stdout), "");
    let missing = run(SINGLE, &[&arguments[..], &["/no/such/dir/a.svg"]].concat());
    assert_eq!(missing.status.code(), Some(6));
    assert_eq!(text(&missing.stdout), "", "nothing runs");
    // The link to a device is writable until the end, when it is full.
    let directory = tempfile::tempdir().unwrap();
    let full = directory.path().join("full.svg");
    std::os::unix::fs::symlink("/dev/full", &full).unwrap();
    let output = run(SINGLE, &[&arguments[..], &[full.to_str().unwrap()]].concat());
    assert_eq!(output.status.code(), Some(6));
    assert!(axis_line(&text(&output.stdout), 0).0.contains("operation enabled"));
    contains_all(&text(&output.stderr), &["cannot write ", "full.svg: No space left on device"]);
}

#[test]
fn ten_axes_run_on_one_and_three_gateways() {
    let fast = ["--cycle-us", "1000", "--dc-sync0", "--dc-shift-us", "700", "--step", "20"];
    for (slaves, extra) in [("1", &[][..]), ("3", &fast[..]), ("1", &fast[..])] {
        let base = ["--ecrt", "sim", "--slaves", slaves];
        let printed = succeeds(TEN, &[&base[..], extra].concat());
        assert!(printed.contains("\n  all 10 axes: following targets\n"), "{printed}");
        let lines = printed.lines().filter(|line| line.starts_with("  ")).count();
        assert!(lines < 20, "{lines} lines of progress: {printed}");
        assert!(!printed.contains("for 0 ms"), "{printed}");
        for axis in 0..10 {
            let (line, numbers) = axis_line(&printed, axis);
            assert!(line.contains("operation enabled"), "{line}");
            assert_eq!(numbers[5..], [0, 0], "no TPDO lost, no emergency: {line}");
        }
    }
}

/// A gateway that leaves OP stops its axes, so the demos reject what other programs warn of.
#[test]
fn shift_among_the_arrivals_is_rejected_unless_measured() {
    let shift = ["--ecrt", "sim", "--cycle-us", "1000", "--dc-sync0", "--dc-shift-us", "175"];
    for (program, size) in [(SINGLE, &[][..]), (TEN, &["--slaves", "1"])] {
        let base = [&shift[..], size].concat();
        let message = fails(program, &base);
        let (arrival, remedy) =
            ("falls into the arrival of the outputs, by 18.5 us", "use a shift of 612.0 us");
        contains_all(&message, &[arrival, remedy, "--dc-shift-measured accepts a measured shift"]);
        // The simulated machine sends at once: 175 us is usable on it.
        let measured = [&base[..], &["--dc-shift-measured", "--cycles", "100"]].concat();
        let output = run(program, &measured);
        let (printed, errors) = (text(&output.stdout), text(&output.stderr));
        assert!(output.status.success() && errors.starts_with("warning: Sync0 175.0"), "{errors}");
        assert!(printed.contains("Sync0 shift 175.0 us, margin by the plan -18.5 us"), "{printed}");
        assert!(axis_line(&printed, 0).0.contains("operation enabled"), "{printed}");
    }
    let planned = ["--ecrt", "sim", "--cycle-us", "1000", "--dc-sync0", "--cycles", "100"];
    let printed = succeeds(SINGLE, &planned);
    assert!(printed.contains("Sync0 shift 612.0 us, margin by the plan 418.5 us"), "{printed}");
}

/// Manual 15.6.1: three slaves, 640 bytes, 1 ms.
#[test]
fn stable_point_of_the_manual_is_accepted() {
    let point = ["--slaves", "3", "--pdo-n", "5", "--cycle-us", "1000", "--dc-sync0"];
    let output =
        run(TEN, &[&point[..], &["--ecrt", "sim", "--plan", "--dc-shift-us", "450"]].concat());
    let (printed, errors) = (text(&output.stdout), text(&output.stderr));
    assert!(output.status.success() && !errors.contains("Sync0"), "{printed}{errors}");
    assert!(printed.contains("shifted by 450.0 us, margin 2."), "{printed}");
}

/// 123 to 149 % of the bus: the demo of ten axes does not start with what `--plan` calls a fault.
#[test]
fn faults_of_the_plan_are_rejected_at_the_start() {
    let overload = ["--slaves", "1", "--cycle-us", "1000", "--bitrate", "500000"];
    let planned = fails(TEN, &[&["--plan"], &overload[..]].concat());
    let output = run(TEN, &[&["--ecrt", "sim"], &overload[..]].concat());
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(text(&output.stderr), planned);
    assert!(planned.contains("% of the bus"), "{planned}");
    assert!(!text(&output.stdout).contains("ready"));
    let large = ["--ecrt", "sim", "--pdo-n", "12", "--cycles", "20"];
    assert!(fails(SINGLE, &large).contains("N is at most 11"));
    let printed = succeeds(SINGLE, &[&large[..], &["--large-pdos"]].concat());
    assert!(axis_line(&printed, 0).0.contains("operation enabled"), "{printed}");
}

#[test]
fn options_of_the_manual_are_accepted() {
    for extra in [
        &["--profile", "1", "--align4"][..],
        &["--profile", "5", "--motion-div", "2", "--step", "50"],
        &["--pdo-n", "8", "--bitrate", "500000"],
        &["--dc-sync0", "--dc-cycle-us", "10000", "--dc-shift-us", "3000"],
    ] {
        let printed = succeeds(SINGLE, &[&["--ecrt", "sim", "--cycles", "100"], extra].concat());
        assert!(axis_line(&printed, 0).0.contains("operation enabled"), "{extra:?}: {printed}");
    }
}

#[test]
fn wrong_use_of_the_demos_returns_a_helpful_message() {
    let cases: &[(&[&str], &str)] = &[
        (&["--profile", "2"], "allowed: 0, 1, 4, 5"),
        (&["--node", "0"], "--node"),
        (&["--bitrate", "3M"], "bit timing"),
        (&["--plot", "/no/such/dir/a.svg"], "cannot write /no/such/dir/a.svg"),
        (&["--skip-sdo-config"], "0x8011:09"),
    ];
    all_fail(SINGLE, &["--ecrt", "sim"], cases);
    all_fail(SINGLE, &["--ecrt", "sim:drives"], &[(&["--node", "99"], "node 99")]);
    all_fail(TEN, &[], &[(&["--ecrt", "/no/such/libethercat.so"], "was not found")]);
}

#[test]
fn ctrl_c_stops_the_axes() {
    let arguments = ["--ecrt", "sim", "--cycles", "1000000", "--cycle-us", "2000"];
    let command = command(SINGLE, &[&arguments[..], &["--step", "100"]].concat());
    let rest = interrupt_after(command, "all axes enabled");
    assert!(
        rest.contains("stopped by the user") && rest.contains("being stopped: shutdown"),
        "{rest}"
    );
    axis_line(&rest, 0);
}

#[test]
fn sdo_probe_reads_and_writes_objects() {
    let base = ["--ecrt", "sim", "--node", "1"];
    let probe = |extra: &[&str]| succeeds(PROBE, &[&base[..], extra].concat());
    let printed = probe(&["--index", "0x1000", "--sub", "0", "--bitrate", "1000000"]);
    assert!(printed.contains("0x1000:00 = 0x00020192"), "{printed}");
    let printed = probe(&["--index", "0x6081", "--type", "u32", "--write", "5000"]);
    assert!(printed.contains("written") && printed.contains("= 5000"), "{printed}");
    let printed = probe(&["--index", "0x6064", "--type", "i32"]);
    assert!(printed.contains("= 1007"), "{printed}");
}

#[test]
fn sdo_probe_names_the_cause_of_failures() {
    let cases: &[(&[&str], &str)] = &[
        (
            &["--node", "1", "--index", "1000"],
            "0x03E8; for the hexadecimal index 0x1000 write 0x1000",
        ),
        (&["--node", "1", "--index", "60FF"], "for 0x60FF write 0x60FF"),
        (&["--node", "1", "--index", "0x5FFF"], "0x06020000"),
        (&["--node", "1", "--index", "0x1000", "--type", "u8"], "4 bytes, expected 1"),
        (&["--node", "1", "--index", "0x1000", "--type", "u32", "--write", "1"], "0x06010002"),
        (&["--node", "100", "--index", "0x1000"], "node 100"),
        (&["--node", "1", "--index", "zero"], "expected a number"),
        (&["--node", "1", "--index", "0x1000", "--type", "float"], "expected u8"),
        (&["--node", "1", "--index", "0x6081", "--write", "1"], "--type"),
    ];
    all_fail(PROBE, &["--ecrt", "sim"], cases);
}
