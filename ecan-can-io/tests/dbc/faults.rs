//! Faults of files, with their lines.

use ecan_can_io::dbc::{Database, DbcFaults};
use ecan_protocol::can::{CanFrame, CanId};
use proptest::prelude::*;

const FILE: &str = include_str!("files/signals.dbc");

/// What is left out of a file, whether or not a message is left.
fn faults(text: &str) -> DbcFaults {
    match Database::parse(text.as_bytes()) {
        Ok(database) => DbcFaults(database.warnings().to_vec()),
        Err(faults) => faults,
    }
}

#[test]
fn each_fault_names_its_line() {
    let signal = |definition: &str| {
        format!(
            "BO_ 1 A: 2 X\n SG_ M M : 0|4@1+ (1,0) [0|0] \"\" X\n SG_ {definition} (1,0) [0|0] \"\" X\n"
        )
    };
    let cases = [
        ("VERSION \"\"\n\nBO_ x\n".to_owned(), "line 3: column 5: syntax error in \"BO_ x\""),
        (signal("S : 0|16@2+"), "line 3: column 15: syntax error in \"SG_ S : 0|16@2+ (1,0)"),
        ("BO_ \u{1b}[2J\n".to_owned(), "line 1: column 5: syntax error in \"BO_ \u{fffd}[2J\""),
        ("BO_ 2048 A: 8 X\n".to_owned(), "line 1: CAN ID 2048 is out of range; allowed: 0 to 2047"),
        ("BO_ 4294967296 A: 8 X\n".to_owned(), "line 1: CAN ID 4294967296 is out of range"),
        ("BO_ 2684354560 A: 8 X\n".to_owned(), "line 1: CAN ID 2684354560 is out of range"),
        (
            "BO_ 1 A: 65 X\n".to_owned(),
            "line 1: message length 65 is out of range; allowed: 0 to 64",
        ),
        ("BO_ 1 A: -1 X\n".to_owned(), "line 1: message length -1 is out of range"),
        ("BO_ 1 A: 8 X\nBO_ 1 B: 8 X\n".to_owned(), "line 2: CAN ID 1 is also in line 1"),
        ("BO_ 1 A: 8 X\nBO_ 2 A: 8 X\n".to_owned(), "line 2: message A is also in line 1"),
        (signal("M : 8|4@1+"), "line 3: signal M is also in line 2"),
        (
            signal("S : 8|9@1+"),
            "line 3: signal S: 9 bits from bit 8 are not in 2 bytes; allowed: 1 to 64 bits",
        ),
        (signal("S : -1|9@1+"), "line 3: signal S: 9 bits from bit -1 are not in 2 bytes"),
        (
            signal("S : 4|4@1+") + "SIG_VALTYPE_ 1 S : 1;\n",
            "line 4: signal S: a 32 bit float has 4 bits",
        ),
        (
            signal("S : 4|4@1+") + "SIG_VALTYPE_ 1 T : 1;\n",
            "line 4: signal T of message 1 does not exist",
        ),
        ("SIG_VALTYPE_ 1 T : 1;\n".to_owned(), "line 1: message 1 does not exist"),
        (
            " SG_ S : 0|4@1+ (1,0) [0|0] \"\" X\nBO_ 1 A: 2 X\n".to_owned(),
            "line 1: the message of signal S does not exist",
        ),
        // The signal of the misspelt message must not become one of message A.
        (
            "BO_ 1 A: 2 X\nB0_ 2 B: 2 X\n SG_ S : 0|4@1+ (1,0) [0|0] \"\" X\nVAL_ 1 S 0 \"x\" ;\n"
                .to_owned(),
            "line 2: column 1: syntax error in \"B0_ 2 B: 2 X\"",
        ),
        (
            "BO_ 1 A: 1 X\n SG_ S m1 : 0|4@1+ (1,0) [0|0] \"\" X\n".to_owned(),
            "line 2: signal S is multiplexed, but the message has 0 multiplexers; expected 1",
        ),
        (
            signal("S M : 8|4@1+") + " SG_ T m1 : 4|1@1+ (1,0) [0|0] \"\" X\n",
            "line 4: signal T is multiplexed, but the message has 2 multiplexers",
        ),
        (
            signal("S m1M : 8|4@1+") + "SG_MUL_VAL_ 1 S S 1-1;\n",
            "line 3: signal S is multiplexed by itself",
        ),
        (
            signal("S m1M : 8|4@1+") + "SG_MUL_VAL_ 1 S T 1-1;\n",
            "2 faults\n  - line 3: signal S is multiplexed, but the message has 2 multiplexers; expected 1, or \
             SG_MUL_VAL_\n  - line 4: signal T of message 1 does not exist",
        ),
        (
            signal("S : 8|4@1+") + "VAL_ 1 S 99999999999999999999 \"x\" ;\n",
            "line 4: value of signal S 99999999999999999999 is out of range; allowed: whole",
        ),
    ];
    for (text, words) in cases {
        let message = faults(&text).to_string();
        assert!(message.starts_with(words), "{text}: {message}");
        assert_eq!(message.lines().count(), words.lines().count(), "{text}: {message}");
    }
}

#[test]
fn all_faults_are_reported_in_order() {
    let text = "BO_ 9999 A: 8 X\nBO_ 1 B: 99 X\nBO_ 2 C: 1 X\n SG_ S : 7|2@1+ (1,0) [0|0] \"\" X\n";
    let message = faults(text).to_string();
    let lines: Vec<_> = message.lines().map(|line| line.split(':').next().unwrap()).collect();
    assert_eq!(lines, ["3 faults", "  - line 1", "  - line 2", "  - line 4"]);
}

/// As in cantools with `strict=False`: the rest of the file is used.
#[test]
fn what_is_faulty_is_left_out() {
    let text = "VERSION \"\"\nNS_ :\n\tCM_\n\tBA_\nBS_:\nBU_: E\n\
        BO_ 2365475321 L: 1785 E\n SG_ A : 0|8@1+ (1,0) [0|0] \"\" E\n\
        BO_ 291 M: 8 E\n SG_ A : 0|8@1+ (1,0) [0|0] \"\" E\n SG_ B : 60|8@1+ (1,0) [0|0] \"\" E\n \
        SG_ C : 8|8@1+ (2,0) [0|0] \"V\"\n SG_ D : 16|8@1+ (1,0)\n nonsense \"\n\
        BO_ 292 N: 8\n SG_ Q x : 0|8@1+ (1,0) [0|0] \"\" E\n SG_ A m7 : 0|8@1+ (1,0) [0|0] \"\" E\n SG_ B : 8|8@1- (1,0) [0|0] \"\" E, F\n\
        CM_ SG_ 291 A \"first line\nBO_ 1 X: 8 E\n\";\n\
        BO_ 291 O: 4 E\n SG_ Z : 0|8@1+ (1,0) [0|0] \"\" E\n\
        VAL_ 292 B 0 \"no\" 1 \"yes\" ; VAL_ 291 Z 7 \"seven\" ;\nVAL_ 291 Z x ;\n";
    let database = Database::parse(text.as_bytes()).unwrap();
    let names = database.messages().iter().map(|message| {
        let signals: Vec<_> = message.signals.iter().map(|signal| signal.name.as_str()).collect();
        (message.name.as_str(), signals.join(" "))
    });
    let expected = [("M", "A C".to_owned()), ("N", "B".to_owned()), ("O", "Z".to_owned())];
    assert_eq!(names.collect::<Vec<_>>(), expected);
    let lines: Vec<_> = database.warnings().iter().map(|fault| fault.line).collect();
    assert_eq!(lines, [7, 11, 13, 14, 16, 17, 22, 25], "{:#?}", database.warnings());
    let frame = |id, data: &[u8]| CanFrame::classic(CanId::standard(id).unwrap(), data).unwrap();
    let texts = |frame: &CanFrame| -> Vec<String> {
        database.decode(frame).unwrap().signals.iter().map(ToString::to_string).collect()
    };
    assert_eq!(texts(&frame(0x123, &[7, 0, 0, 0])), ["Z = 7 (seven)"], "the last one counts");
    assert_eq!(texts(&frame(0x124, &[0, 1, 0, 0, 0, 0, 0, 0])), ["B = 1 (yes)"]);
}

#[test]
fn long_names_are_shown_and_accepted() {
    let text = "BO_ 291 Cut_00: 8 E\n SG_ Sig_00 : 0|8@1+ (1,0) [0|0] \"\" E\n\
        BA_DEF_ BO_ \"SystemMessageLongSymbol\" STRING ;\n\
        BA_DEF_DEF_ \"SystemMessageLongSymbol\" \"\";\n\
        BA_ \"SystemMessageLongSymbol\" BO_ 291 \"Cut_the_long_name\";\n\
        BA_ \"SystemSignalLongSymbol\" SG_ 291 Sig_00 \"Sig_the_long_name\";\n\
        VAL_ 291 Sig_00 5 \"five\" ;\n";
    let database = Database::parse(text.as_bytes()).unwrap();
    let message = &database.messages()[0];
    assert_eq!(
        (message.name.as_str(), &*message.signals[0].name),
        ("Cut_the_long_name", "Sig_the_long_name")
    );
    for name in ["Cut_00", "Cut_the_long_name"] {
        for signal in ["Sig_00", "Sig_the_long_name"] {
            let frame = database.message_named(name).unwrap().encode(&[(signal, "five")]).unwrap();
            assert_eq!(frame.data()[0], 5);
        }
    }
    let similar = database.message_named("Cut_the_long_nam").unwrap_err();
    assert_eq!(similar.similar, ["Cut_the_long_name"]);
}

#[test]
fn texts_may_be_utf_8_or_windows_1252() {
    let file = |unit: &[u8]| {
        let start = b"BO_ 1 A: 1 X\n SG_ S : 0|8@1+ (1,0) [0|0] \"";
        [&start[..], unit, b"\" X\n"].concat()
    };
    for unit in ["°C".as_bytes(), b"\xB0C"] {
        let database = Database::parse(&file(unit)).unwrap();
        assert_eq!(database.messages()[0].signals[0].unit, "°C");
    }
    let with_mark = [&b"\xEF\xBB\xBF"[..], &file(b"V")].concat();
    assert_eq!(Database::parse(&with_mark).unwrap().messages().len(), 1);
}

#[test]
fn windows_line_breaks_are_accepted() {
    let text = FILE.replace('\n', "\r\n");
    assert_eq!(Database::parse(text.as_bytes()), Database::parse(FILE.as_bytes()));
    assert_eq!(Database::parse(b"").unwrap().messages().len(), 0);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// A file with damage is read or rejected in a line that it has.
    #[test]
    fn damaged_file_is_read_or_rejected_in_a_line(
        at in any::<prop::sample::Index>(),
        length in 1..20_usize,
        other in "[ -~\\n]{0,4}",
    ) {
        let characters: Vec<char> = FILE.chars().collect();
        let at = at.index(characters.len());
        let end = (at + length).min(characters.len());
        let text: String =
            characters[..at].iter().chain(&other.chars().collect::<Vec<_>>()).chain(&characters[end..]).collect();
        let lines = text.lines().count() + 1;
        let DbcFaults(faults) = faults(&text);
        prop_assert!(faults.iter().all(|fault| (1..=lines).contains(&fault.line)));
        if Database::parse(text.as_bytes()).is_err() {
            prop_assert!(!faults.is_empty());
        }
    }
}
