//! The LSS master without a bus: bytes from the tables of CiA 305, times, faults and any response.

use std::time::Duration;

use ecan_canopen::{
    FastscanFilter, Lss, LssAddress, LssAddressRange, LssBitRate, LssCommand, LssConfig, LssFault,
    LssMaster, LssResult, NodeId,
};
use proptest::prelude::*;

const MS: u64 = 1_000_000;
const ADDRESS: LssAddress =
    LssAddress { vendor: 0x1122_3344, product: 0x55, revision: 0x6677_0001, serial: 0x0809_0A0B };

fn master() -> LssMaster {
    LssMaster::new(LssConfig {
        timeout: Duration::from_millis(100),
        store_timeout: Duration::from_millis(400),
        scan_time: Duration::from_millis(10),
    })
}

/// Starts a command and sends its frames, without a response.
fn frames(master: &mut LssMaster, command: LssCommand) -> Vec<[u8; 8]> {
    assert!(master.start(command));
    let mut frames = Vec::new();
    while let Some(frame) = master.frame() {
        frames.push(frame);
        master.sent(0);
    }
    frames
}

fn state_after(command: LssCommand, response: [u8; 8]) -> Lss {
    let mut master = master();
    frames(&mut master, command);
    master.receive(&response);
    master.state()
}

#[test]
fn commands_have_the_bytes_of_cia_305() {
    let node = NodeId::from_raw(0x12);
    let range = LssAddressRange {
        vendor: 0x1122_3344,
        product: 0x55,
        revision: (1, 0x0203_0405),
        serial: (6, u32::MAX),
    };
    let golden: [(LssCommand, &[[u8; 8]]); 9] = [
        (LssCommand::SwitchGlobal { configuration: true }, &[[0x04, 1, 0, 0, 0, 0, 0, 0]]),
        (LssCommand::SwitchGlobal { configuration: false }, &[[0x04, 0, 0, 0, 0, 0, 0, 0]]),
        (
            LssCommand::SwitchSelective(ADDRESS),
            &[
                [0x40, 0x44, 0x33, 0x22, 0x11, 0, 0, 0],
                [0x41, 0x55, 0, 0, 0, 0, 0, 0],
                [0x42, 0x01, 0x00, 0x77, 0x66, 0, 0, 0],
                [0x43, 0x0B, 0x0A, 0x09, 0x08, 0, 0, 0],
            ],
        ),
        (LssCommand::ConfigureNodeId(node), &[[0x11, 0x12, 0, 0, 0, 0, 0, 0]]),
        (LssCommand::ConfigureBitRate(LssBitRate::Rate125k), &[[0x13, 0, 4, 0, 0, 0, 0, 0]]),
        (LssCommand::ActivateBitRate { delay_ms: 1_000 }, &[[0x15, 0xE8, 3, 0, 0, 0, 0, 0]]),
        (LssCommand::Store, &[[0x17, 0, 0, 0, 0, 0, 0, 0]]),
        (
            LssCommand::Identify(range),
            &[
                [0x46, 0x44, 0x33, 0x22, 0x11, 0, 0, 0],
                [0x47, 0x55, 0, 0, 0, 0, 0, 0],
                [0x48, 1, 0, 0, 0, 0, 0, 0],
                [0x49, 5, 4, 3, 2, 0, 0, 0],
                [0x4A, 6, 0, 0, 0, 0, 0, 0],
                [0x4B, 0xFF, 0xFF, 0xFF, 0xFF, 0, 0, 0],
            ],
        ),
        (LssCommand::IdentifyNonConfigured, &[[0x4C, 0, 0, 0, 0, 0, 0, 0]]),
    ];
    for (command, expected) in golden {
        assert_eq!(frames(&mut master(), command), expected, "{command}");
    }
}

#[test]
fn address_is_read_in_four_requests() {
    let mut master = master();
    assert!(master.start(LssCommand::InquireAddress));
    for (command, value) in [(0x5A, ADDRESS.vendor), (0x5B, 0x55), (0x5C, 0x6677_0001)] {
        assert_eq!(master.frame(), Some([command, 0, 0, 0, 0, 0, 0, 0]));
        master.sent(0);
        assert_eq!(master.frame(), None, "the response is due");
        let [a, b, c, d] = value.to_le_bytes();
        // The response to another part is not the one to this part.
        master.receive(&[0x5D, 9, 9, 9, 9, 0, 0, 0]);
        master.receive(&[command, a, b, c, d, 0, 0, 0]);
    }
    master.sent(0);
    master.receive(&[0x5D, 0x0B, 0x0A, 0x09, 0x08, 0, 0, 0]);
    assert_eq!(master.state(), Lss::Done(LssResult::Address(ADDRESS)));
    assert_eq!(master.strays(), 3);
}

#[test]
fn error_codes_of_slaves_are_typed() {
    let node = NodeId::from_raw(5);
    let configure = LssCommand::ConfigureNodeId(node);
    let bit_rate = LssBitRate::Rate800k;
    let failed = [
        (configure, [0x11, 1, 0, 0, 0, 0, 0, 0], LssFault::NodeIdRejected { node }),
        (configure, [0x11, 255, 7, 0, 0, 0, 0, 0], LssFault::Manufacturer { code: 7 }),
        (configure, [0x11, 2, 0, 0, 0, 0, 0, 0], LssFault::Undefined { code: 2 }),
        (
            LssCommand::ConfigureBitRate(bit_rate),
            [0x13, 1, 0, 0, 0, 0, 0, 0],
            LssFault::BitRateRejected { bit_rate },
        ),
        (LssCommand::Store, [0x17, 1, 0, 0, 0, 0, 0, 0], LssFault::StoreNotSupported),
        (LssCommand::Store, [0x17, 2, 0, 0, 0, 0, 0, 0], LssFault::StoreFailed),
        (
            LssCommand::InquireNodeId,
            [0x5E, 128, 0, 0, 0, 0, 0, 0],
            LssFault::InvalidNodeId { node: 128 },
        ),
    ];
    for (command, response, fault) in failed {
        assert_eq!(state_after(command, response), Lss::Failed(fault), "{command}");
    }
    let done = [
        (configure, [0x11, 0, 0, 0, 0, 0, 0, 0], LssResult::Done),
        (LssCommand::SwitchSelective(ADDRESS), [0x44, 0, 0, 0, 0, 0, 0, 0], LssResult::Done),
        (LssCommand::InquireNodeId, [0x5E, 5, 0, 0, 0, 0, 0, 0], LssResult::NodeId(node)),
        (LssCommand::InquireNodeId, [0x5E, 255, 0, 0, 0, 0, 0, 0], LssResult::NodeId(None)),
    ];
    for (command, response, result) in done {
        assert_eq!(state_after(command, response), Lss::Done(result), "{command}");
    }
    // The response to another command
    assert_eq!(state_after(LssCommand::Store, [0x11, 0, 0, 0, 0, 0, 0, 0]), Lss::Busy);
}

#[test]
fn each_command_has_its_waiting_time() {
    let waited = Duration::from_millis(101);
    let not_found = Lss::Done(LssResult::NotFound);
    let ends = [
        (LssCommand::InquireNodeId, 100, Lss::Failed(LssFault::TimedOut { waited })),
        (LssCommand::SwitchSelective(ADDRESS), 100, Lss::Failed(LssFault::NotSelected { waited })),
        (LssCommand::IdentifyNonConfigured, 100, not_found),
        (LssCommand::Identify(LssAddressRange::of_product(1, 2)), 100, not_found),
        (LssCommand::Fastscan(FastscanFilter::default()), 10, not_found),
        // Both delays
        (LssCommand::ActivateBitRate { delay_ms: 30 }, 60, Lss::Done(LssResult::Done)),
    ];
    for (command, ms, state) in ends {
        let mut master = master();
        frames(&mut master, command);
        master.tick(ms * MS);
        assert_eq!(master.state(), Lss::Busy, "{command}: exactly in time");
        master.tick((ms + 1) * MS);
        assert_eq!(master.state(), state, "{command}");
    }
    let mut master = master();
    frames(&mut master, LssCommand::Store);
    master.tick(400 * MS);
    assert_eq!(master.state(), Lss::Busy, "the memory is slow");
    master.tick(401 * MS);
    assert!(matches!(master.state(), Lss::Failed(LssFault::TimedOut { .. })));
}

#[test]
fn search_waits_for_late_slaves_before_the_next_command() {
    let mut master = master();
    frames(&mut master, LssCommand::IdentifyNonConfigured);
    master.receive(&[0x50, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(master.state(), Lss::Busy, "others may respond");
    assert!(!master.start(LssCommand::Store));
    master.receive(&[0x50, 0, 0, 0, 0, 0, 0, 0]);
    master.tick(101 * MS);
    assert_eq!((master.state(), master.strays()), (Lss::Done(LssResult::Found), 0));
    assert!(master.start(LssCommand::Store));
}

#[test]
fn cancelled_command_sends_nothing_more() {
    let mut master = master();
    assert!(master.start(LssCommand::SwitchSelective(ADDRESS)));
    master.sent(0);
    master.cancel(LssFault::Cancelled);
    assert_eq!((master.frame(), master.state()), (None, Lss::Failed(LssFault::Cancelled)));
    master.receive(&[0x44, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(master.strays(), 1);
    master.cancel(LssFault::GatewayLost);
    assert_eq!(master.state(), Lss::Failed(LssFault::Cancelled), "it had ended");
}

fn commands() -> impl Strategy<Value = LssCommand> {
    prop_oneof![
        any::<bool>().prop_map(|configuration| LssCommand::SwitchGlobal { configuration }),
        Just(LssCommand::SwitchSelective(ADDRESS)),
        (0..=127u8).prop_map(|node| LssCommand::ConfigureNodeId(NodeId::from_raw(node))),
        Just(LssCommand::ConfigureBitRate(LssBitRate::Rate50k)),
        (0..50u16).prop_map(|delay_ms| LssCommand::ActivateBitRate { delay_ms }),
        Just(LssCommand::Store),
        Just(LssCommand::InquireAddress),
        Just(LssCommand::InquireNodeId),
        Just(LssCommand::Identify(LssAddressRange::of_product(1, 2))),
        Just(LssCommand::IdentifyNonConfigured),
        any::<Option<u32>>().prop_map(|vendor| {
            LssCommand::Fastscan(FastscanFilter { vendor, ..FastscanFilter::default() })
        }),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// With any responses at any time a command ends, after at most 133 waiting times.
    #[test]
    fn command_ends_for_any_responses(
        command in commands(),
        responses in proptest::collection::vec((0..200u64, proptest::collection::vec(any::<u8>(), 0..=9)), 0..100),
    ) {
        let mut master = master();
        prop_assert!(master.start(command));
        let mut sent = 0;
        for ms in 0..133 * 12u64 {
            if master.frame().is_some() {
                sent += 1;
                master.sent(ms * MS);
            }
            for (_, data) in responses.iter().filter(|(at, _)| *at == ms) {
                master.receive(data);
            }
            master.tick(ms * MS);
        }
        prop_assert_ne!(master.state(), Lss::Busy);
        prop_assert!(sent <= 133);
    }
}

#[test]
fn fastscan_needs_each_response_within_the_scan_time() {
    // A slave that responds to every request has the address 0.
    let found = Lss::Done(LssResult::Address(LssAddress::default()));
    for (delay_ms, expected, strays) in [(9, found, 0), (12, Lss::Done(LssResult::NotFound), 1)] {
        let mut master = master();
        assert!(master.start(LssCommand::Fastscan(FastscanFilter::default())));
        let mut respond_at = None;
        for ms in 0..133 * 12u64 {
            if master.frame().is_some() {
                master.sent(ms * MS);
                respond_at = Some(ms + delay_ms);
            }
            if respond_at.take_if(|at| *at == ms).is_some() {
                master.receive(&[0x4F, 0, 0, 0, 0, 0, 0, 0]);
            }
            master.tick(ms * MS);
        }
        assert_eq!((master.state(), master.strays()), (expected, strays));
    }
}
