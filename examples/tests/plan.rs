//! `--plan` as a user runs it: no bus, no master, no `--ecrt`.

use crate::program::{contains_all, fails, run, succeeds, text, written};

const LOOP: &str = "simple_loop";
const SINGLE: &str = "cia402_single_axis_demo";
const TEN: &str = "cia402_10axis_demo";
const PROBE: &str = "mcan_gateway_tx_probe";

/// Words of the line that begins with this text.
fn line<'a>(printed: &'a str, start: &str) -> Vec<&'a str> {
    let line = printed.lines().find(|line| line.starts_with(start));
    line.unwrap_or_else(|| panic!("{start} is not in {printed}")).split_whitespace().collect()
}

/// 2 * 384 + 12 + 40 = 820 bytes of 80 ns; out and back 111 to 135 bits each in 10000.
#[test]
fn plan_of_the_plain_loop_needs_no_master() {
    for library in [&[][..], &["--ecrt", "/no/such/libethercat.so"], &["--ecrt", "sim"]] {
        let printed = succeeds(LOOP, &[&["--plan"], library].concat());
        assert_eq!(
            line(&printed, "frame 0")[2..],
            ["820", "65.6", "us", "slave", "0", "LRW", "768"]
        );
        assert_eq!(line(&printed, "in all")[2..7], ["820", "65.6", "us", "0.7", "%"]);
        assert_eq!(
            line(&printed, "slave 0 can0")[3..],
            ["1", "1", "8", "8", "2.2", "to", "2.7", "%"]
        );
        assert_eq!(line(&printed, "slave 0 RxPDO")[3..], ["360", "1", "(1)", "12", "(12)"]);
        contains_all(&printed, &["an estimate", "no problems found"]);
        assert!(!printed.contains("SIMULATED") && !printed.contains("ready"), "{printed}");
    }
}

/// Three slaves of N = 6: six frames of 820 bytes. FD frames of 64 bytes take 68 in the image:
/// 744 / 68 = 10; out and back 2 * (29 + 550 / 5) = 278 to 2 * (32 + 680 / 5) = 336 us of 1000.
#[test]
fn three_gateways_with_can_fd() {
    let arguments = ["--plan", "--slaves", "3", "--pdo-n", "6", "--cycle-us", "1000"];
    let fd = ["--fd", "5000000", "--channel", "all"];
    let printed = succeeds(LOOP, &[&arguments[..], &fd].concat());
    assert_eq!(printed.matches(" 820 ").count(), 6, "{printed}");
    assert_eq!(line(&printed, "in all")[2..7], ["4920", "393.6", "us", "39.4", "%"]);
    let counters = "6 (2 + 2 + 2) with IgH 1.6, 9 (3 + 3 + 3) with 1.5";
    contains_all(&printed, &[counters, "FD with BRS, 11 bit, 64 bytes"]);
    assert_eq!(line(&printed, "slave 1 out")[10..], ["68", "10"]);
    assert_eq!(line(&printed, "slave 2 can3")[7..], ["27.8", "to", "33.6", "%"]);
    assert_eq!(printed.matches(" can").count(), 12);
}

/// 100 frames of 8 bytes with 29 bits and one remote frame in 1 s: 101 frames of which each comes
/// back.
#[test]
fn recording_is_distributed_over_its_length() {
    let mut log: String =
        (0..100).map(|n| format!("({n}.000000) can0 00000123#1122334455667788\n")).collect();
    log.push_str("(100.000000) can0 123#R8\n");
    let (_directory, path) = written(&log);
    let replay = ["--plan", "--replay", &path, "--cycle-us", "2000"];
    let printed = succeeds(LOOP, &replay);
    contains_all(&printed, &["classic, 29 bit, 8 bytes", "remote, 11 bit, 8 bytes"]);
    // 1.01 frames a second are 0.002 a cycle; the fullest cycle may have one of each kind.
    assert_eq!(line(&printed, "slave 0 RxPDO")[3..], ["360", "0.00", "(2)", "0.03", "(18)"]);
}

#[test]
fn impossible_plan_ends_with_the_reason() {
    let cases: [(&[&str], &[&str]); 5] = [
        (&["--pdo-n", "12"], &["N = 12 needs 1536 bytes", "N is at most 11", "2 faults"]),
        (&["--slaves", "3", "--pdo-n", "11", "--cycle-us", "500"], &["700.8 us on the wire"]),
        (&["--cycle-us", "100"], &["1128 bytes", "no slave reach OP"]),
        (&["--bitrate", "125000", "--cycle-us", "1000"], &["178 to 216 % of the bus"]),
        (&["--bitrate", "3M"], &["bit timing"]),
    ];
    for (arguments, expected) in cases {
        let output = run(LOOP, &[&["--plan"], arguments].concat());
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {message}");
        contains_all(&message, expected);
        assert!(
            text(&output.stdout).contains("working counter"),
            "the table is there all the same"
        );
    }
    succeeds(LOOP, &["--plan", "--pdo-n", "12", "--large-pdos"]);
}

/// Three axes on channels 0 and 1, two on 2 and 3: 3 * 2 * 95 + 47 = 617 to 3 * 2 * 115 + 55 = 745
/// of 2500 bits, a SYNC and three targets out, three TPDOs in; 427 to 515 with two axes.
#[test]
fn axes_load_their_channels() {
    let printed = succeeds(TEN, &["--plan", "--slaves", "1", "--cycle-us", "2500"]);
    assert_eq!(
        line(&printed, "slave 0 can0")[3..],
        ["4", "3", "8", "8", "24.7", "to", "29.8", "%"]
    );
    assert_eq!(
        line(&printed, "slave 0 can3")[3..],
        ["3", "2", "8", "8", "17.1", "to", "20.6", "%"]
    );
    // 10 targets of 2 + 2 + 6 bytes and 4 SYNC of 4.
    assert_eq!(line(&printed, "slave 0 RxPDO")[3..], ["360", "14", "(14)", "116", "(116)"]);
    assert_eq!(line(&printed, "slave 0 TxPDO")[3..], ["360", "10", "(10)", "100", "(100)"]);

    let printed = succeeds(TEN, &["--plan", "--slaves", "1", "--cycle-us", "1000"]);
    contains_all(&printed, &["warning: slave 0, channel 0: the frames take 62 to 75 % of the bus"]);

    let slow = ["--plan", "--slaves", "1", "--cycle-us", "1000", "--bitrate", "500000"];
    let message = fails(TEN, &slow);
    contains_all(&message, &["4 faults", "channel 0: the frames take 123 to 149 % of the bus"]);

    let printed = succeeds(SINGLE, &["--plan", "--motion-div", "4", "--channel", "2"]);
    assert_eq!(line(&printed, "slave 0 can2")[3..5], ["1.25", "1"]);
}

/// The line of slave 0 in the table of scheduled frames.
fn schedule(printed: &str) -> Vec<&str> {
    let (_, table) = printed.split_once("\nscheduled").unwrap_or_else(|| panic!("{printed}"));
    line(table, "slave 0")[2..].to_vec()
}

/// The clocks make the frame 48 bytes longer: 868 bytes, of which the last 12 are gap, so that the
/// image arrives 68.5 us after it is sent, and 45 us of work and 30 us through the host later at
/// the latest. A Sync0 at 700 us is 330.7 us before the first arrival that counts from the next.
#[test]
fn plan_with_sync0_shows_the_schedule_margin() {
    let sync0 = ["--plan", "--cycle-us", "1000", "--dc-sync0", "--dc-shift-us", "700"];
    let printed = succeeds(SINGLE, &sync0);
    contains_all(&printed, &["slave 0 LRW 768, clock 4, clock 4", "shifted by 700.0 us"]);
    contains_all(&printed, &["margin 330.7 us (usable: 193.5 us to 30.7 us)"]);
    let arrival = ["68.5", "us", "after", "they", "are", "sent,", "the", "last", "one"];
    assert_eq!(line(&printed, "images arrive")[2..], arrival);
    assert_eq!(
        schedule(&printed),
        ["100.0", "us", "30.7", "us", "143.5", "us", "700.0", "us", "800.0", "us", "330.7", "us"]
    );
    let planned = succeeds(SINGLE, &["--plan", "--cycle-us", "1000", "--dc-sync0"]);
    contains_all(&planned, &["shifted by 612.0 us, margin 418.5 us"]);
    let message = fails(SINGLE, &["--plan", "--dc-sync0", "--dc-shift-us", "10000"]);
    contains_all(&message, &["Sync0 shift of 10000 us is not below its period"]);
}

/// The probe's frame of 8 bytes takes 20 with its schedule record, 12 without; 11 bits and 8 bytes
/// are 111 to 135 us of 1000.
#[test]
fn plan_of_the_tx_probe_contains_the_offset() {
    let printed = succeeds(PROBE, &["--plan", "--offset-ns", "250000"]);
    assert_eq!(
        line(&printed, "slave 0 can0")[3..],
        ["1", "0", "8", "8", "11.1", "to", "13.5", "%"]
    );
    assert_eq!(line(&printed, "slave 0 RxPDO")[3..], ["360", "1", "(1)", "20", "(20)"]);
    assert_eq!(
        schedule(&printed),
        ["250.0", "us", "30.7", "us", "143.5", "us", "612.0", "us", "862.0", "us", "418.7", "us"]
    );
    contains_all(&printed, &["no problems found"]);
    assert!(!printed.contains("SIMULATED") && !printed.contains("ready"), "{printed}");

    let printed = succeeds(PROBE, &["--plan", "--mode", "direct"]);
    assert_eq!(line(&printed, "slave 0 RxPDO")[3..], ["360", "1", "(1)", "12", "(12)"]);
    assert!(!printed.contains("Sync0"), "{printed}");

    let place = ["--slaves", "2", "--slave", "1", "--channel", "3", "--fd", "5000000"];
    let printed = succeeds(PROBE, &[&["--plan"], &place[..]].concat());
    contains_all(&printed, &["FD with BRS, 11 bit, 16 bytes"]);
    assert_eq!(line(&printed, "slave 1 can3")[3], "1");
    assert_eq!(line(&printed, "slave 0 can3")[3], "0");
}

/// Images until 143.5 us, in the firmware until 193.5 us: a pulse at 100 us is among them, one at
/// 155 us is 11.5 us after the last one.
#[test]
fn plan_of_the_tx_probe_warns_of_missed_phases() {
    let shift = |us| ["--plan", "--dc-shift-us", us];
    let printed = succeeds(PROBE, &shift("100"));
    contains_all(
        &printed,
        &[
            "warning: Sync0 100.0 us after the start of the cycle falls into the arrival of the \
             outputs, by 69.3 us: ",
            "use a shift of 612.0 us (manual 16.1)",
            "warning: slave 0: the margin of frames 100.0 us after Sync0 is short by 43.5 us",
        ],
    );
    assert_eq!(schedule(&printed)[10], "-43.5");
    let printed = succeeds(PROBE, &shift("155"));
    contains_all(
        &printed,
        &["warning: slave 0: frames 100.0 us after Sync0 have little to spare, margin 11.5 us"],
    );
    let printed = succeeds(PROBE, &["--plan", "--offset-ns", "90000"]);
    contains_all(&printed, &["warning: an offset of 90.0 us", "begin with 100 us"]);
    let message = fails(PROBE, &["--plan", "--offset-ns", "1000000"]);
    contains_all(&message, &["frames cannot leave 1000.0 us after Sync0", "period of 1000.0 us"]);
    let message = fails(PROBE, &["--plan", "--slave", "1"]);
    contains_all(&message, &["--slave 1 is out of range; allowed: 0 to 0"]);
    contains_all(&fails(PROBE, &["--plan", "--sweep"]), &["cannot be used with"]);
}
