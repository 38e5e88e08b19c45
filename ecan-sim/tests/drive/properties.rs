//! The drive under any input: it neither panics nor violates its own rules.

use super::fixture::{Fixture, config};
use super::sdo_server::block_upload;
use ecan_canopen::{DriveState, OperatingMode};
use ecan_sim::{Drive, MotorConfig, NodeOutput};
use proptest::prelude::*;

/// An event for a drive.
#[derive(Clone, Debug)]
enum Event {
    Frame(u16, Vec<u8>),
    Pass(u32),
    Fail(u16),
    PowerCycle(u16),
    Block(u16),
}

fn event() -> impl Strategy<Value = Event> {
    let identifiers = prop_oneof![
        Just(0x000u16),
        Just(0x080),
        Just(0x205),
        Just(0x305),
        Just(0x605),
        Just(0x77F),
        0..0x800u16,
    ];
    let data = prop::collection::vec(any::<u8>(), 0..=8);
    // valid SDO requests: all of PDO, profile and manufacturer objects
    let index = prop_oneof![
        0x1000..0x1020u16,
        0x1400..0x1404u16,
        0x1600..0x1604u16,
        0x1800..0x1804u16,
        0x1A00..0x1A04u16,
        0x6000..0x6100u16,
        0x2000..0x2002u16
    ];
    let command = prop_oneof![
        Just(0x40u8),
        Just(0x2F),
        Just(0x2B),
        Just(0x23),
        Just(0x21),
        Just(0xC6),
        Just(0xA4),
        Just(0x60),
        Just(0x70),
        Just(0xA3),
        Just(0xA2)
    ];
    let sdo = (command, index, 0..4u8, any::<[u8; 4]>()).prop_map(|(command, index, sub, tail)| {
        let [low, high] = index.to_le_bytes();
        let [a, b, c, d] = tail;
        Event::Frame(0x605, vec![command, low, high, sub, a, b, c, d])
    });
    prop_oneof![
        6 => sdo,
        4 => (identifiers, data).prop_map(|(id, data)| Event::Frame(id, data)),
        4 => prop_oneof![Just(0x06u8), Just(0x07), Just(0x0F), Just(0x80), Just(0x00), Just(0x02),
            Just(0x1F)].prop_map(|word| Event::Frame(0x205, vec![word, 0])),
        1 => Just(Event::Frame(0, vec![1, 0])),
        4 => (0..20_000_000u32).prop_map(Event::Pass),
        1 => any::<u16>().prop_map(Event::Fail),
        1 => (0..300u16).prop_map(Event::PowerCycle),
        1 => (0..300u16).prop_map(Event::Block),
    ]
}

fn apply(fixture: &mut Fixture, event: &Event) {
    let mut out = NodeOutput::new();
    let now = fixture.now;
    match event {
        Event::Frame(id, data) => drop(fixture.frame(*id, data)),
        Event::Pass(ns) => fixture.pass(u64::from(*ns)),
        Event::Fail(code) => fixture.drive.fail(now, *code, &mut out),
        Event::PowerCycle(ms) => {
            fixture.drive.power_cycle(now, now + u64::from(*ms) * 1_000_000);
        }
        Event::Block(ms) => {
            fixture.drive.block(now, now + u64::from(*ms) * 1_000_000, &mut out);
        }
    }
}

/// Everything about a drive that a test can read.
fn picture(fixture: &Fixture) -> String {
    let drive = &fixture.drive;
    format!(
        "{:?} {} {} {:?} {:?}",
        fixture.sent,
        drive.mechanical_position(),
        drive.velocity(),
        drive.targets().sums(),
        drive.statusword(),
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn random_frames_never_panic(events in prop::collection::vec(event(), 0..200)) {
        let mut fixture = Fixture::booted();
        let most = f64::from(MotorConfig::default().max_velocity);
        for event in &events {
            apply(&mut fixture, event);
            prop_assert!(fixture.drive.velocity().abs() <= most);
            prop_assert!(fixture.drive.statusword().state() == Some(fixture.drive.state()));
        }
        // and it always recovers
        fixture.pass_ms(400);
        fixture.frame(0, &[0x81, 0]);
        fixture.pass_ms(50);
        prop_assert_eq!(fixture.drive.state(), DriveState::SwitchOnDisabled);
        prop_assert_eq!(fixture.read(0x1000, 0), Ok(0x0002_0192));
    }

    #[test]
    fn same_input_gives_same_output(events in prop::collection::vec(event(), 0..100)) {
        let run = || {
            let mut fixture = Fixture::cold(Drive::new(&config()));
            events.iter().for_each(|event| apply(&mut fixture, event));
            picture(&fixture)
        };
        prop_assert_eq!(run(), run());
    }

    #[test]
    fn segmented_download_is_read_by_block_upload(
        value in prop::collection::vec(any::<u8>(), 0..600),
        block_size in 1..=127u8,
    ) {
        let mut fixture = Fixture::booted();
        let [a, b, c, d] = (value.len() as u32).to_le_bytes();
        prop_assert_eq!(fixture.sdo([0x21, 0x00, 0x20, 0, a, b, c, d])[0], 0x60);
        let chunks: Vec<_> = if value.is_empty() { vec![&[][..]] } else { value.chunks(7).collect() };
        for (number, chunk) in chunks.iter().enumerate() {
            let last = number + 1 == chunks.len();
            let toggle = (number as u8 & 1) << 4;
            let mut frame = [0; 8];
            frame[0] = toggle | (7 - chunk.len() as u8) << 1 | u8::from(last);
            frame[1..=chunk.len()].copy_from_slice(chunk);
            prop_assert_eq!(fixture.sdo(frame)[0], 0x20 | toggle);
        }
        prop_assert_eq!(block_upload(&mut fixture, block_size), value);
    }

    /// For any targets, the motor's velocity and acceleration stay within their limits, and the
    /// position changes by no more than the velocity allows.
    #[test]
    fn targets_never_exceed_motor_limits(
        targets in prop::collection::vec(prop_oneof![-5_000..5_000i32, any::<i32>()], 1..60),
        jitter in prop::collection::vec(0..900_000u64, 60),
    ) {
        let mut fixture = Fixture::booted();
        fixture.write(0x6065, 0, 0xFFFF_FFFF, 4).unwrap();
        fixture.start_csp(1000);
        let (mut before, mut at) = (fixture.drive.clone(), fixture.now);
        for (target, jitter) in targets.iter().zip(&jitter) {
            fixture.cycle(0x0F, *target);
            fixture.pass(*jitter);
            let seconds = (fixture.now - at) as f64 / 1e9;
            let moved = fixture.drive.mechanical_position() - before.mechanical_position();
            // the last event of the drive may be one period ago
            prop_assert!(moved.abs() <= 6_553_600.0 * (seconds + 0.001) + 1.0);
            let gained = fixture.drive.velocity() - before.velocity();
            prop_assert!(gained.abs() <= 205_000_000.0 * (seconds + 0.001) + 1.0);
            (before, at) = (fixture.drive.clone(), fixture.now);
        }
        prop_assert_eq!(fixture.drive.mode(), Some(OperatingMode::CyclicPosition));
    }
}
