//! For any input, the services neither panic nor break the format of a mailbox, and never keep a
//! front end busy without a message.

use crate::mailbox::MailboxServer;
use ecan_protocol::device::AlState;
use proptest::prelude::*;

use super::fixture::{Fixture, coe, message};
use crate::bus::ErrorState;
use crate::fault::GatewayFault;

#[derive(Clone, Debug)]
enum Step {
    /// Any bytes as the whole write mailbox.
    Write(Vec<u8>),
    /// A message whose length may differ from its header.
    Message {
        protocol: u8,
        counter: u8,
        body: Vec<u8>,
        length: Option<u16>,
    },
    /// The client of the fixture must succeed after any input.
    Upload,
    Read,
    Mailbox(usize),
    Wait(u64),
    Silence(u32),
    BusState(ErrorState),
    State(AlState),
    Reset,
}

/// SDO requests that are probably valid.
fn sdo() -> impl Strategy<Value = Vec<u8>> {
    let index = prop_oneof![
        Just(0x1008_u16),
        Just(0x1018),
        Just(0x1C12),
        Just(0x7000),
        Just(0x8000),
        Just(0x8001),
        Just(0x8010),
        Just(0xA000),
        Just(0xF000),
        any::<u16>(),
    ];
    let size = prop_oneof![0..40_u32, any::<u32>()];
    (any::<u8>(), index, 0..5_u8, size, prop::collection::vec(any::<u8>(), 0..40)).prop_map(
        |(command, index, subindex, size, data)| {
            let mut body = vec![0x00, 0x20, command];
            body.extend_from_slice(&index.to_le_bytes());
            body.push(subindex);
            body.extend_from_slice(&size.to_le_bytes());
            body.extend_from_slice(&data);
            body
        },
    )
}

fn information() -> impl Strategy<Value = Vec<u8>> {
    (0..9_u8, prop_oneof![0..7_u16, Just(0x8001), any::<u16>()], any::<u8>(), any::<u8>()).prop_map(
        |(opcode, index, subindex, requested)| {
            let [i0, i1] = index.to_le_bytes();
            vec![0x00, 0x80, opcode, 0, 0, 0, i0, i1, subindex, requested]
        },
    )
}

fn step() -> impl Strategy<Value = Step> {
    let body = prop_oneof![
        6 => sdo(),
        3 => information(),
        1 => prop::collection::vec(any::<u8>(), 0..80),
    ];
    let protocol = prop_oneof![8 => Just(3_u8), 1 => 0..16_u8];
    let length = prop_oneof![9 => Just(None), 1 => any::<u16>().prop_map(Some)];
    let states = prop::sample::select(vec![
        ErrorState::Active,
        ErrorState::Warning,
        ErrorState::Passive,
        ErrorState::BusOff,
    ]);
    let al = prop::sample::select(vec![AlState::Init, AlState::PreOp, AlState::Boot]);
    prop_oneof![
        10 => (protocol, 0..8_u8, body, length).prop_map(|(protocol, counter, body, length)| {
            Step::Message { protocol, counter, body, length }
        }),
        3 => prop::collection::vec(any::<u8>(), 0..150).prop_map(Step::Write),
        10 => Just(Step::Read),
        1 => Just(Step::Upload),
        1 => (0..200_usize).prop_map(Step::Mailbox),
        2 => (0..400_000_u64).prop_map(Step::Wait),
        1 => (0..3_u32).prop_map(Step::Silence),
        1 => states.prop_map(Step::BusState),
        1 => al.prop_map(Step::State),
        1 => Just(Step::Reset),
    ]
}

/// Checks the format of a mailbox; returns its counter.
fn check_form(out: &[u8]) -> u8 {
    let length = usize::from(u16::from_le_bytes([out[0], out[1]]));
    assert!(6 + length <= out.len());
    assert!(out[6 + length..].iter().all(|&byte| byte == 0));
    let shortest = match out[5] & 0x0F {
        0 => 4,
        3 => 7,
        4 => 6,
        other => panic!("protocol {other}"),
    };
    assert!(length >= shortest);
    let counter = out[5] >> 4;
    assert!((1..=7).contains(&counter));
    counter
}

/// Reads all messages; more rounds than possible messages are an endless loop.
fn drain(fixture: &mut Fixture) {
    for _ in 0..20_000 {
        if !fixture.server.is_due(fixture.now, &fixture.gateway) {
            return;
        }
        let mut out = vec![0xAA; fixture.mailbox];
        if fixture.server.send(fixture.now, &mut out, &mut fixture.gateway) {
            check_form(&out);
        }
    }
    panic!("there is always something to do");
}

fn run(steps: Vec<Step>) {
    let mut fixture = Fixture::preop();
    let mut counter = 0;
    for step in steps {
        match step {
            Step::Write(bytes) => {
                let reply_bytes = fixture.mailbox;
                fixture.server.receive(fixture.now, &bytes, reply_bytes, &mut fixture.gateway);
            }
            Step::Message { protocol, counter, body, length } => {
                let mut bytes = message(protocol, counter, &body);
                if let Some(length) = length {
                    bytes[..2].copy_from_slice(&length.to_le_bytes());
                }
                fixture.write(&bytes);
            }
            Step::Upload => {
                fixture.gateway.advance(fixture.now);
                let is_served = fixture.gateway.mailbox_answers(fixture.now)
                    && fixture.gateway.al_state() == AlState::PreOp
                    && fixture.mailbox >= 16;
                drain(&mut fixture);
                while fixture.read().is_some() {}
                fixture.gateway.advance(fixture.now);
                counter = 0;
                fixture.server = MailboxServer::default();
                if is_served && fixture.gateway.mailbox_answers(fixture.now) {
                    let upload = coe(&[0x00, 0x20, 0x40, 0x00, 0xF0, 0x02, 0, 0, 0, 0]);
                    assert_eq!(fixture.exchange(&upload)[8], 0x4F);
                    counter = 1;
                }
            }
            Step::Read => {
                let mut out = vec![0xAA; fixture.mailbox];
                let before = out.clone();
                if fixture.server.send(fixture.now, &mut out, &mut fixture.gateway) {
                    let found = check_form(&out);
                    // a stopped mailbox (INIT) restarts
                    assert!(found == counter % 7 + 1 || found == 1, "{found} after {counter}");
                    counter = found;
                } else {
                    assert_eq!(out, before, "untouched");
                }
            }
            Step::Mailbox(bytes) => fixture.mailbox = bytes,
            Step::Wait(ns) => fixture.now += ns,
            Step::Silence(ms) => {
                fixture.gateway.inject(fixture.now, GatewayFault::MailboxSilent { ms });
            }
            Step::BusState(state) => fixture.gateway.bus_state(fixture.now, 0, state, 0, 0),
            Step::State(state) => fixture.gateway.request_al_state(fixture.now, state),
            Step::Reset => {
                counter = 0;
                fixture.server = MailboxServer::default();
            }
        }
    }
    // after any silence
    fixture.now += 1_000_000_000;
    drain(&mut fixture);
    if fixture.gateway.mailbox_answers(fixture.now) {
        assert_eq!(fixture.server.next_ready(), None);
    }
}

proptest! {
    #[test]
    fn whatever_is_written(steps in prop::collection::vec(step(), 1..60)) {
        run(steps);
    }

    #[test]
    fn data_goes_down_and_comes_up(
        data in prop::array::uniform16(any::<u8>()),
        mailbox in 16..160_usize,
        unit in 0..192_u16,
    ) {
        let mut fixture = Fixture::with_mailbox(mailbox);
        let index = 0x7000 + 16 * unit;
        prop_assert_eq!(fixture.download(index, 1, false, &data), Ok(()));
        prop_assert_eq!(fixture.upload(index, 1, false), Ok(data.to_vec()));
    }
}
