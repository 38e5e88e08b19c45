//! Frames to signals and signals to frames.

use std::sync::OnceLock;

use ecan_can_io::dbc::{Database, Decoded, Number};
use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameKind};
use proptest::prelude::*;

const FILE: &[u8] = include_bytes!("files/signals.dbc");

fn database() -> &'static Database {
    static DATABASE: OnceLock<Database> = OnceLock::new();
    DATABASE.get_or_init(|| Database::parse(FILE).unwrap())
}

fn frame(id: u16, data: &[u8]) -> CanFrame {
    CanFrame::fd(CanId::standard(id).unwrap(), data, false, false).unwrap()
}

fn texts(decoded: &Decoded<'_>) -> Vec<String> {
    decoded.signals.iter().map(ToString::to_string).collect()
}

fn decoded(id: u16, data: &[u8]) -> Vec<String> {
    texts(&database().decode(&frame(id, data)).unwrap())
}

fn encoded(message: &str, values: &[(&str, &str)]) -> CanFrame {
    database().message_named(message).unwrap().encode(values).unwrap()
}

fn rejected(message: &str, values: &[(&str, &str)]) -> String {
    database().message_named(message).unwrap().encode(values).unwrap_err().to_string()
}

/// Values that cantools decodes of the same bytes.
#[test]
fn signals_have_values_units_and_texts() {
    let data = [0x10, 0x27, 0xF3, 0x80, 0x64, 0x1F, 0x00, 0xFC];
    let expected = [
        "Speed = 100.00 km/h",
        "Torque = -110.0 Nm",
        "Temperature = 60 degC",
        "Gear = 15 (Signal not available)",
        "Brake = 1 (Pressed)",
        "Angle = -1.0000000000 rad",
    ];
    assert_eq!(decoded(291, &data), expected);
    assert_eq!(decoded(291, &[0; 8])[1], "Torque = -10.0 Nm");
    assert_eq!(database().decode(&frame(292, &[0; 8])), None);
}

#[test]
fn integers_of_64_bits_are_exact() {
    let database = database();
    let of = |id: u32, data| {
        let frame = CanFrame::classic(CanId::extended(id).unwrap(), data).unwrap();
        texts(&database.decode(&frame).unwrap())
    };
    let id = 2_566_834_709 & 0x1FFF_FFFF;
    assert_eq!(of(id, &[0xFF; 8]), ["Large = 18446744073709551615"]);
    assert_eq!(of(id + 1, &[0x80, 0, 0, 0, 0, 0, 0, 0]), ["Wide = -18446744073709551615"]);
    let frame = encoded("Extended", &[("Large", "18446744073709551615")]);
    assert_eq!((frame.id(), frame.data()), (CanId::extended(id).unwrap(), &[0xFF; 8][..]));
    let frame = encoded("Signed64", &[("Wide", "-18446744073709551615")]);
    assert_eq!(frame.data(), [0x80, 0, 0, 0, 0, 0, 0, 0]);
}

#[test]
fn floats_decode_and_encode() {
    let data = [0xCD, 0xCC, 0xCC, 0x3D, 0xC0, 0x09, 0x21, 0xFB, 0x54, 0x44, 0x2D, 0x18];
    assert_eq!(decoded(800, &data), ["Single = 0.1", "Double = -3.141592653589793 V"]);
    let values = [("Single", "0.1"), ("Double", "-3.141592653589793")];
    assert_eq!(encoded("Floats", &values).data(), data);
    let large = [0xEC, 0x78, 0xAD, 0x60, 0, 0, 0, 0, 0, 0, 0, 0];
    assert_eq!(decoded(800, &large), ["Single = 1e20", "Double = 0 V"]);
}

#[test]
fn multiplexers_select_signals() {
    let page_0 = ["Page = 0 (Supply)", "Always = 7", "Voltage = 12.000 V"];
    assert_eq!(decoded(900, &[0, 7, 0xE0, 0x2E, 9, 0, 0, 0]), page_0);
    let page_1 = ["Page = 1 (Motor)", "Always = 7", "Current = -0.001 A", "Status = 9"];
    assert_eq!(decoded(900, &[1, 7, 0xFF, 0xFF, 9, 0, 0, 0]), page_1);
    assert_eq!(decoded(900, &[2, 7, 0xFF, 0xFF, 9, 0, 0, 0]), ["Page = 2", "Always = 7"]);
    // Several multiplexers, with ranges.
    let nested = |first| decoded(901, &[first, 0x34, 0x12, 0, 0, 0, 0, 0]);
    assert_eq!(nested(0x13), ["Outer = 3", "Inner = 1", "Deep = 52"]);
    assert_eq!(nested(0x53), ["Outer = 3", "Inner = 5", "Deeper = 4660"]);
    assert_eq!(nested(0x73), ["Outer = 3", "Inner = 7"]);
    assert_eq!(nested(0x15), ["Outer = 5", "Side = 65"]);
    assert_eq!(nested(0x10), ["Outer = 0"]);
}

#[test]
fn short_and_remote_frames_have_no_wrong_signals() {
    let database = database();
    let id = CanId::standard(291).unwrap();
    let short = CanFrame::classic(id, &[0x10, 0x27, 0xF3]).unwrap();
    let short = database.decode(&short).unwrap();
    assert_eq!((texts(&short), short.missing), (vec!["Speed = 100.00 km/h".to_owned()], 5));
    let remote = CanFrame::remote(id, Dlc::new(8).unwrap()).unwrap();
    let remote = database.decode(&remote).unwrap();
    assert_eq!((remote.signals.len(), remote.missing), (0, 0));
    assert_eq!(remote.message.name, "Engine");
}

#[test]
fn encoded_signals_are_numbers_texts_and_start_values() {
    let values = [
        ("Speed", "100"),
        ("Torque", "-110"),
        ("Gear", "signal not available"),
        ("Brake", "Pressed"),
        ("Angle", "-1"),
    ];
    let frame = encoded("Engine", &values);
    // Temperature has its start value, 60 as a raw value.
    assert_eq!(frame.data(), [0x10, 0x27, 0xF3, 0x80, 0x3C, 0x1F, 0x00, 0xFC]);
    assert_eq!((frame.id().raw(), frame.kind()), (291, FrameKind::Data));
    assert_eq!(encoded("Engine", &[("Speed", "0x64"), ("Gear", "2")]).data()[..2], [0x10, 0x27]);
    // The nearest raw value.
    assert_eq!(encoded("Engine", &[("Speed", "0.014")]).data()[0], 1);
    assert_eq!(encoded("Engine", &[("Speed", "0.3")]).data()[0], 30);
    let scaled = |name, value| encoded("Scaled", &[(name, value)]).data().to_vec();
    assert_eq!(scaled("Half", "101.5")[..4], [0, 0, 0, 3]);
    assert_eq!(scaled("Down", "3")[4], 7);
    for (value, raw) in [("14", 1), ("16", 1), ("-4", 0xFF), ("-6", 0xFF), ("5", 0)] {
        assert_eq!(scaled("Tenfold", value)[5], raw, "{value}");
    }
    assert_eq!(scaled("Thirds", "1")[6], 3);
}

#[test]
fn encoded_multiplexers_follow_the_signals() {
    assert_eq!(encoded("Selected", &[("Voltage", "12")]).data()[..4], [0, 0, 0xE0, 0x2E]);
    let motor = encoded("Selected", &[("Status", "9"), ("Always", "7")]);
    assert_eq!(motor.data(), [1, 7, 0, 0, 9, 0, 0, 0]);
    let page = encoded("Selected", &[("Page", "Motor"), ("Status", "9")]);
    assert_eq!(page.data(), [1, 0, 0, 0, 9, 0, 0, 0]);
    assert_eq!(encoded("Nested", &[("Deeper", "0x1234")]).data()[..3], [0x23, 0x34, 0x12]);
    let given = [("Deeper", "1"), ("Inner", "5")];
    assert_eq!(encoded("Nested", &given).data()[..3], [0x53, 1, 0]);
    let both = rejected("Selected", &[("Voltage", "1"), ("Current", "1")]);
    assert_eq!(
        both,
        "message Selected: Voltage is in the frame if Page is 0; given or needed otherwise: 1"
    );
    let wrong = rejected("Nested", &[("Inner", "7"), ("Deeper", "1")]);
    assert!(wrong.contains("Deeper is in the frame if Inner is 2 or 4 to 6"), "{wrong}");
}

#[test]
fn fd_messages_give_fd_frames() {
    let long = encoded("Flexible", &[("Last", "255")]);
    assert_eq!((long.data().len(), long.data()[23]), (24, 255));
    assert_eq!(long.kind(), FrameKind::Fd { brs: true, esi: false });
    let short = encoded("ShortFlexible", &[("Value", "1")]);
    assert_eq!(short.kind(), FrameKind::Fd { brs: false, esi: false });
    assert_eq!(short.data(), [1, 0, 0, 0]);
}

#[test]
fn invalid_values_name_what_is_allowed() {
    /// Message, signals with their values, error.
    type Case = (&'static str, &'static [(&'static str, &'static str)], &'static str);
    let cases: [Case; 9] = [
        ("Engine", &[("Sped", "1")], "message Engine: unknown signal \"Sped\"; similar: Speed"),
        ("Engine", &[("Speed", "1"), ("Speed", "2")], "signal Speed is given twice"),
        ("Engine", &[("Speed", "700")], "Speed = 700 is out of range; allowed: 0 to 655.35 km/h"),
        ("Engine", &[("Torque", "2000")], "allowed: -1034.0 to 1013.5 Nm"),
        ("Engine", &[("Speed", "fast")], "Speed = fast is invalid; expected a number"),
        (
            "Engine",
            &[("Gear", "Frst")],
            "Gear = Frst is invalid; expected a number or a text, as in First",
        ),
        ("Scaled", &[("Down", "-246")], "Down = -246 is out of range; allowed: -245 to 10"),
        ("Extended", &[("Large", "1e30")], "allowed: 0 to 18446744073709551615"),
        ("Nested", &[("Outer", "3"), ("Side", "1")], "Side is in the frame if Outer is 5"),
    ];
    for (message, values, words) in cases {
        let error = rejected(message, values);
        assert!(error.contains(words), "{values:?}: {error}");
    }
    let unknown = database().message_named("engin").unwrap_err().to_string();
    assert_eq!(unknown, "unknown message \"engin\"; similar: Engine");
    let overlapping =
        b"BO_ 1 A: 1 X\n SG_ a : 0|4@1+ (1,0) [0|0] \"\" X\n SG_ b : 2|4@1+ (1,0) [0|0] \"\" X\n";
    let overlapping = Database::parse(overlapping).unwrap();
    let message = overlapping.message_named("A").unwrap();
    assert!(message.encode(&[("a", "15")]).is_ok());
    let error = message.encode(&[("a", "15"), ("b", "0")]).unwrap_err().to_string();
    assert_eq!(error, "message A: a shares bits with another signal of the frame");
}

proptest! {
    /// A frame of decoded values decodes to the same values.
    #[test]
    fn decoded_values_encode_to_themselves(
        data: [u8; 24],
        at in any::<prop::sample::Index>(),
    ) {
        let database = database();
        let message = &database.messages()[at.index(database.messages().len())];
        let frame = CanFrame::fd(message.id, &data[..message.length], false, false).unwrap();
        let decoded = message.decode(&frame);
        prop_assert_eq!(decoded.missing, 0);
        let is_finite = |number: Number| number.as_f64().is_finite();
        // Outside the range of the file.
        let is_allowed = |decoded: &&ecan_can_io::dbc::DecodedSignal<'_>| {
            let value = decoded.value.as_f64();
            is_finite(decoded.value) && decoded.signal.range.is_none_or(|(a, b)| (a..=b).contains(&value))
        };
        let values: Vec<_> = decoded.signals.iter().filter(is_allowed).collect();
        prop_assume!(values.len() == decoded.signals.len());
        let values: Vec<_> =
            values.iter().map(|decoded| (decoded.signal.name.as_str(), decoded.value.to_string())).collect();
        let values: Vec<_> = values.iter().map(|(name, value)| (*name, value.as_str())).collect();
        let again = message.encode(&values).unwrap();
        prop_assert_eq!(texts(&message.decode(&again)), texts(&decoded));
    }
}
