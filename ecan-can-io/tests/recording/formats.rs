//! Recordings of each format, and their errors.

use ecan_can_io::candump::{FrameText, parse_frame};
use ecan_can_io::recording::{Format, ReadOptions, Recording, RecordingErrorKind, ScreenTimes};
use proptest::prelude::*;

fn read(text: &str) -> Recording {
    Recording::parse(text, &ReadOptions::default()).unwrap()
}

/// Time in microseconds, interface and frame for cansend.
fn shown(recording: &Recording) -> Vec<(u64, String, String)> {
    let row = |logged: &ecan_can_io::recording::LoggedFrame| {
        (logged.time_ns / 1000, logged.interface.clone(), FrameText(&logged.frame).to_string())
    };
    recording.frames.iter().map(row).collect()
}

fn check(recording: &Recording, expected: &[(u64, &str, &str)]) {
    let rows = shown(recording);
    let rows: Vec<_> = rows.iter().map(|(a, b, c)| (*a, b.as_str(), c.as_str())).collect();
    assert_eq!(rows, expected);
    for row in expected {
        parse_frame(row.2).unwrap();
    }
}

const LOG: &str = "\
# comment
(1.000000) can0 123#11
(1.000500) can0 20000080#0000000000000000
(1.001000) can1 12345678##1AABB
";

const SCREEN: &str = " (000.000000)  can0  123   [2]  11 22
 (000.010000)  can0  20000004   [8]  00 04 00 00 00 00 00 00   ERRORFRAME
\tcontroller-problem{rx-error-warning}
 (000.012000)  can1  00000123  [01]  AA
";

/// Forms of the specification of Vector and of can-utils.
const ASC: &str = "\
date Wed Apr 16 09:21:13.159 am 2014
base hex  timestamps absolute
internal events logged
// version 8.2.1
Begin Triggerblock Wed Apr 16 09:21:13.159 am 2014
   0.000000 Start of measurement
   0.003040 1  123             Tx   d 2 00 01  Length = 768000 BitCount = 67 ID = 291
   0.010000 1  18EFC034x       Rx   d 0
   0.011000 2  7FF             Rx   r 4
   0.012000 2  7FE             Rx   r  Length = 0
   0.013000 1  ErrorFrame  ECC: 10100010
   0.014000 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%
   0.015000 CAN 1 Status:chip status error passive - TxErr: 132 RxErr: 0
   0.016000 1  124             TxRq d 1 01
   0.017000 1  EngineData      Rx   d 1 05 Length = 0 BitCount = 0 ID = 418119680x
   0.018000 1  125             Rx   d f 01 02 03 04 05 06 07 08
   0.019000 CANFD   1 Rx        12a  Name_1                           1 0 9 12 00 01 02 03 04 05 06 07 08 09 0a 0b   100000  214   303000 80000000 46500250 460a0250 20011736 20010205
   0.020000 CANFD   1 Tx        12bx                                  0 1 2  2 01 02   100000  214     5000 0 0 0 0 0
   0.021000 CANFD   2 Rx        12c  0 0 4  0   100000  214       10 0 0 0 0 0
   0.022000 CANFD   2 Rx        12d  0 0 1  1 55   100000  214        0 0 0 0 0 0
   0.023000 CANFD   1 Rx   ErrorFrame   Not Acknowledge error
End TriggerBlock
";

const TRC_1_1: &str = "\
;$FILEVERSION=1.1
;$STARTTIME=37704.5364870833
;   Message Number
     1)      1059.9  Rx         0300  7  00 00 00 00 04 00 00 \r
     2)      1283.2  Tx     18EFC034  2  0A FF
     3)      1298.9  Warng  FFFFFFFF  4  00 00 00 08  BUSHEAVY
     4)      1300.0  Rx         0400  3  RTR
     5)      1323.0  Error      0008  4  00 19 08 08
";

const TRC_1_3: &str = "\
;$FILEVERSION=1.3
     1)      1059.900 1  Rx        0300 -  7    00 00 00 00 04 00 00
     2)      1283.231 2  Tx        0010 -  2    0A FF
     3)      1298.945 1  Warng FFFFFFFF -  4    00 00 00 08  BUSHEAVY
     4)      1300.000 1  Rx        0400 -  3    RTR
";

const TRC_2_0: &str = "\
;$FILEVERSION=2.0
;$STARTTIME=42209.4075997106
;$COLUMNS=N,O,T,I,d,l,D
      1      1059.900 DT     0300 Rx 7  00 00 00 00 04 00 00
      2      1283.231 DT 18EFC034 Tx 1  FF
      3      1298.945 ST          Rx    00 00 00 08
      4      1323.201 ER          Rx    04 00 08 00 00
      5      1334.416 FD     0500 Tx 12 01 02 03 04 05 06 07 08 09 0A 0B 0C
      6      1334.500 RR     0400 Rx 3
";

const TRC_2_1: &str = "\
;$FILEVERSION=2.1
;$STARTTIME=43008.920986006946
;$COLUMNS=N,O,T,B,I,d,R,L,D
      1      1059.900 DT 1      0300 Rx -  7    00 00 00 00 04 00 00
      2      1283.231 FB 2      0400 Tx -  9    01 02 03 04 05 06 07 08 09 0A 0B 0C
      3      1298.945 FE 1  12345678 Rx -  1    01
      4      1298.950 BI 1      0401 Rx -  1    02
      5      1300.000 EV -  User-defined event
      6      1400.000 EC 1           Rx -       00 01
";

#[test]
fn candump_texts_give_frames() {
    let log = read(LOG);
    assert_eq!((log.format, log.error_frames, log.screen_times), (Format::CandumpLog, 1, None));
    check(&log, &[(1_000_000, "can0", "123#11"), (1_001_000, "can1", "12345678##1AABB")]);
    let screen = read(SCREEN);
    assert_eq!((screen.format, screen.error_frames), (Format::CandumpScreen, 1));
    check(&screen, &[(0, "can0", "123#1122"), (12_000, "can1", "00000123##0AA")]);
    assert_eq!(screen.frames[1].line, 4);
    let bare = read("  can0  123   [1]  11\n  can0  124   [1]  22\n");
    check(&bare, &[(0, "can0", "123#11"), (0, "can0", "124#22")]);
    assert_eq!(bare.screen_times, None);
    let dates = " (2014-04-22 23:59:59.500000)  can0  123   [0] \n\
                 (2014-04-23 00:00:00.250000)  can0  124   [0] \n";
    let dates = read(dates).frames;
    assert_eq!(dates[1].time_ns - dates[0].time_ns, 750_000_000);
}

#[test]
fn screen_times_are_recognized_or_selected() {
    let screen = |times: &[f64]| -> String {
        times.iter().map(|time| format!(" ({time:010.6})  can0  123   [0] \n")).collect()
    };
    let times_us = |text: &str, screen_times| {
        let options = ReadOptions { screen_times, ..ReadOptions::default() };
        let recording = Recording::parse(text, &options).unwrap();
        let times = recording.frames.iter().map(|frame| frame.time_ns / 1000).collect::<Vec<_>>();
        (recording.screen_times.unwrap(), times)
    };
    let zero = screen(&[0.0, 0.01, 0.02, 0.03]);
    assert_eq!(times_us(&zero, None), (ScreenTimes::SinceFirst, vec![0, 10_000, 20_000, 30_000]));
    let delta = screen(&[0.0, 0.01, 0.009, 0.011]);
    let sums = vec![0, 10_000, 19_000, 30_000];
    assert_eq!(times_us(&delta, None), (ScreenTimes::SincePrevious, sums));
    // Without a decrease the text leaves it open; the option decides.
    let growing = screen(&[0.0, 0.01, 0.01]);
    assert_eq!(times_us(&growing, None).0, ScreenTimes::SinceFirst);
    let selected = times_us(&growing, Some(ScreenTimes::SincePrevious));
    assert_eq!(selected, (ScreenTimes::SincePrevious, vec![0, 10_000, 20_000]));
    // One late stamp of another interface does not make a long recording one of differences.
    let mut late: Vec<_> = (0..40).map(|step| f64::from(step) / 100.0).collect();
    late.swap(20, 21);
    assert_eq!(times_us(&screen(&late), None).0, ScreenTimes::SinceFirst);
    let absolute = screen(&[1_398_128_223.803_317, 1_398_128_223.803_3]);
    assert_eq!(times_us(&absolute, None).0, ScreenTimes::Absolute);
}

#[test]
fn asc_gives_frames_of_both_forms() {
    let asc = read(ASC);
    assert_eq!((asc.format, asc.error_frames, asc.events), (Format::Asc, 2, 4));
    check(
        &asc,
        &[
            (3_040, "can0", "123#0001"),
            (10_000, "can0", "18EFC034#"),
            (11_000, "can1", "7FF#R4"),
            (12_000, "can1", "7FE#R"),
            (17_000, "can0", "18EC0000#05"),
            (18_000, "can0", "125#0102030405060708"),
            (19_000, "can0", "12A##1000102030405060708090A0B"),
            (20_000, "can0", "0000012B##20102"),
            (21_000, "can1", "12C#R4"),
            (22_000, "can1", "12D#55"),
        ],
    );
    assert_eq!(asc.frames[0].line, 7);
}

#[test]
fn asc_base_and_relative_times_are_those_of_the_header() {
    let text = "base dec  timestamps relative\n\
                0.5 1 291 Rx d 2 16 255\n\
                0.25 CAN 1 Status:chip status error active\n\
                0.25 1 418119680x Rx d 1 7\n";
    let frames = [(500_000, "can0", "123#10FF"), (1_000_000, "can0", "18EC0000#07")];
    check(&read(text), &frames);
}

#[test]
fn asc_keeps_what_other_programs_write() {
    let text = "base hex timestamps absolute\n\
                -1.0 1 100 Rx d 1 01\n\
                -0.5 1 101 Rx d 1 02\n\
                0.1 CANFD 1 Rx 102 0 0 9 12 1 2 3 4 5 6 7 8 9 a b c 0 0 0\n\
                0.2 CANFD 2 Rx 103 1 0 1 1 7 0 0 0\n\
                0.3 CANXL 1 Rx CBFF 0\n\
                0.4 1 104 Rx d 1 zz\n";
    let recording = read(text);
    check(
        &recording,
        &[
            (0, "can0", "100#01"),
            (500_000, "can0", "101#02"),
            (1_100_000, "can0", "102##00102030405060708090A0B0C"),
            (1_200_000, "can1", "103##107"),
        ],
    );
    let skipped: Vec<_> = recording.skipped.iter().map(ToString::to_string).collect();
    assert_eq!(skipped.len(), 2);
    assert!(skipped[0].starts_with("line 6, lines of kind CANXL"), "{skipped:?}");
    assert!(skipped[1].ends_with(": 0.4 1 104 Rx d 1 zz"), "{skipped:?}");
}

#[test]
fn lost_frames_of_candump_are_counted() {
    let text = "(1.000000) can0 123#11\n\
                DROPCOUNT: dropped 3 CAN frames on 'can0' socket (total drops 3)\n\
                DROPCOUNT: dropped 1 CAN frame on 'can0' socket (total drops 4)\n\
                (1.100000) can0 124#11\n";
    let recording = read(text);
    assert_eq!((recording.frames.len(), recording.dropped, recording.skipped.len()), (2, 4, 0));
    let screen = read("  can0  123   [0] \nDROPCOUNT: dropped 2 CAN frames on 'can0' socket\n");
    assert_eq!((screen.frames.len(), screen.dropped), (1, 2));
}

#[test]
fn trc_of_each_version_gives_frames() {
    let first = (1_059_900, "can0", "300#00000000040000");
    let old = read(TRC_1_1);
    assert_eq!((old.format, old.error_frames, old.events), (Format::Trc, 1, 1));
    let frames = [first, (1_283_200, "can0", "18EFC034#0AFF"), (1_300_000, "can0", "400#R3")];
    check(&old, &frames);
    let with_bus = read(TRC_1_3);
    let frames = [first, (1_283_231, "can1", "010#0AFF"), (1_300_000, "can0", "400#R3")];
    check(&with_bus, &frames);
    // 1.2 has no reserved column.
    let reduced = TRC_1_3.replace("=1.3", "=1.2").replace(" -  ", " ");
    check(&read(&reduced), &frames);
    let two = read(TRC_2_0);
    assert_eq!((two.error_frames, two.events), (1, 1));
    let fd = "500##00102030405060708090A0B0C";
    let frames = [
        first,
        (1_283_231, "can0", "18EFC034#FF"),
        (1_334_416, "can0", fd),
        (1_334_500, "can0", "400#R3"),
    ];
    check(&two, &frames);
    let newest = read(TRC_2_1);
    assert_eq!((newest.error_frames, newest.events), (0, 2));
    let frames = [
        first,
        (1_283_231, "can1", "400##10102030405060708090A0B0C"),
        (1_298_945, "can0", "12345678##201"),
        (1_298_950, "can0", "401##302"),
    ];
    check(&newest, &frames);
    let first_version = ";####\n     1)      1841  0001  8  00 01 02 03 04 05 06 07\n\
                         2)      1842  0008  4  ERROR  00 19 08 08\n\
                         3)      1843  FFFFFFFF  4  00 00 00 04  BUSLIGHT\n\
                         4)      1844  0100  3  RTR\n";
    let version_1_0 = read(first_version);
    assert_eq!((version_1_0.error_frames, version_1_0.events), (1, 1));
    let frames = [(1_841_000, "can0", "001#0001020304050607"), (1_844_000, "can0", "100#R3")];
    check(&version_1_0, &frames);
}

#[test]
fn error_names_line_and_field() {
    let columns = ";$FILEVERSION=2.0\n;$COLUMNS=N,O,T,I,d,l,D\n";
    let cases = [
        ("\n\nnonsense\n", "line 3, format not recognized; allowed: candump log, candump screen"),
        ("(1.0) can0 12#\n", "line 1, column 5: expected 6 or 9 decimals"),
        ("(1.000000) can0 123#\n  can0  123   [0] \n", "line 2, column 3: expected `(`"),
        ("  can0  123   [2]  11\n", "line 1, column 22: expected 2 data bytes"),
        (
            " (2014-02-30 00:00:00.000000)  can0  123   [0] \n",
            "line 1, date \"2014-02-30 00:00:00.000000\" is invalid; expected YYYY-MM-DD",
        ),
        ("base oct\n", "line 1, base \"oct\" is invalid; expected hex or dec"),
        ("0.1 1 123 Rx d 9x\n", "line 1, DLC \"9x\" is invalid; expected a hex digit"),
        ("0.1 1 123 Rx d 2 11\n", "line 1, data byte is missing; expected a byte in hexadecimal"),
        ("0.1 1 123 Rx d 1 100\n", "line 1, data byte \"100\" is invalid"),
        ("0.1 1 800 Rx d 0\n", "line 1, CAN ID \"800\" is invalid; expected 000 to 7FF, or 0x to"),
        ("0.1 1 123 up d 0\n", "line 1, direction \"up\" is invalid; expected Rx, Tx or TxRq"),
        ("0.1 0 123 Rx d 0\n", "line 1, channel \"0\" is invalid; expected a number, from 1"),
        ("0.1 1 123 Rx q 0\n", "line 1, kind of frame \"q\" is invalid; expected d or r"),
        ("0.1 CANFD 1 Rx 123 1 0 9 8 0 0 0 0 0 0 0 0\n", "line 1, 8 data bytes do not match DLC 9"),
        ("0.1 CANXL 1 Rx CBFF 0\n", "line 1, lines of kind CANXL are not supported"),
        (
            "base hex timestamps relative\n18446744073.0 Start\n1.0 1 123 Rx d 0\n",
            "line 2, time exceeds 64 bits of nanoseconds",
        ),
        (";$FILEVERSION=3.0\n", "line 1, file version \"3.0\" is invalid; expected 1.0, 1.1"),
        (";$FILEVERSION=2.0\n 1 1.0 DT 0300 Rx 0\n", "line 2, no line ;$COLUMNS before"),
        (";$COLUMNS=N,O,T,I,d,D\n", "line 1, list of columns \"N,O,T,I,d,D\" is invalid"),
    ];
    let lines = [
        ("x 1.0 DT 0300 Rx 0", "message number \"x\" is invalid; expected a number"),
        ("1 1,0 DT 0300 Rx 0", "time offset \"1,0\" is invalid; expected milliseconds"),
        ("1 1.0 XX 0300 Rx 0", "type \"XX\" is invalid; expected Rx, Tx, DT"),
        ("1 1.0 DT 0800 Rx 0", "CAN ID \"0800\" is invalid; expected 4 or 8 hex digits"),
        ("1 1.0 DT 0300 Rx 9", "data length \"9\" is invalid; expected 0 to 8 in a CAN frame"),
        ("1 1.0 FD 0300 Rx 9", "data length \"9\" is invalid; expected 0 to 8, 12"),
        ("1 1.0 DT 0300", "direction is missing; expected Rx or Tx"),
        ("1 1.0 DT 0300 Rx 2 11", "data byte is missing"),
    ];
    let lines =
        lines.map(|(line, words)| (format!("{columns}{line}\n"), format!("line 3, {words}")));
    let cases = cases.map(|(text, words)| (text.to_owned(), words.to_owned()));
    for (text, words) in cases.into_iter().chain(lines) {
        let error = match Recording::parse(&text, &ReadOptions::default()) {
            Ok(recording) => recording.skipped.first().expect(&text).error.clone(),
            Err(error) => error,
        };
        assert!(error.to_string().starts_with(&words), "{text}: {error}");
    }
}

#[test]
fn selected_format_replaces_the_recognized_one() {
    let options =
        |name: &str| ReadOptions { format: Some(name.parse().unwrap()), ..Default::default() };
    for format in Format::TEXT {
        assert_eq!(format.to_string().parse(), Ok(format));
    }
    assert!("blf".parse::<Format>().is_err());
    let error = Recording::parse(ASC, &options("trc")).unwrap().skipped.remove(0).error;
    assert_eq!(error.line, 1);
    assert!(matches!(error.kind, RecordingErrorKind::Invalid { field: "message number", .. }));
    assert_eq!(read("").format, Format::CandumpLog);
    assert_eq!(read("\u{FEFF}date x\n").format, Format::Asc);
}

proptest! {
    /// A text with damage is read or rejected in a line that it has.
    #[test]
    fn damaged_text_parses_or_fails_in_a_line(
        text in prop::sample::select(vec![LOG, SCREEN, ASC, TRC_1_1, TRC_1_3, TRC_2_0, TRC_2_1]),
        at in any::<prop::sample::Index>(),
        other in prop::option::of(any::<char>()),
        format in prop::option::of(prop::sample::select(Format::TEXT.to_vec())),
    ) {
        let mut characters: Vec<char> = text.chars().collect();
        let at = at.index(characters.len());
        characters.remove(at);
        if let Some(other) = other {
            characters.insert(at, other);
        }
        let text: String = characters.into_iter().collect();
        let lines = 1..=text.lines().count().max(1);
        match Recording::parse(&text, &ReadOptions { format, screen_times: None }) {
            Err(error) => prop_assert!(lines.contains(&error.line), "{}", error),
            Ok(recording) => for line in recording.skipped {
                prop_assert!(lines.contains(&line.error.line), "{}", line);
            },
        }
    }
}
