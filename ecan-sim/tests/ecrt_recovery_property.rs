//! Whatever passes by on line, supply and bus, the slave is back in OP afterwards, and works.

mod ecrt_support;

use ecan_protocol::{CanFrame, CanId};
use ecan_sim::{Fault, GatewayFault, LostWay};
use ecrt_support::{Program, stepped_echo};
use proptest::prelude::*;

fn faults() -> impl Strategy<Value = Fault> {
    let way = prop_oneof![Just(LostWay::Outward), Just(LostWay::Return)];
    let gateway = 0..2usize;
    let channel = 0..4usize;
    let inside = prop_oneof![
        (1..3u32).prop_map(|images| GatewayFault::TornTxPdo { images }),
        (1..3u32).prop_map(|images| GatewayFault::CrcErrorTxPdo { images }),
        (1..200u32).prop_map(|ms| GatewayFault::ServiceStall { ms }),
        Just(GatewayFault::AlError { code: 0x001A }),
    ];
    prop_oneof![
        (way, 1..300u32).prop_map(|(way, cycles)| Fault::LostFrame { way, cycles }),
        (-3..4i32, 1..10u32)
            .prop_map(|(offset, cycles)| Fault::WorkingCounterOffset { offset, cycles }),
        (gateway.clone(), 1..500u32)
            .prop_map(|(gateway, off_ms)| Fault::PowerCycle { gateway, off_ms }),
        (gateway.clone(), 1..500u32)
            .prop_map(|(gateway, for_ms)| Fault::LinkLoss { gateway, for_ms }),
        (gateway.clone(), inside).prop_map(|(gateway, fault)| Fault::Gateway { gateway, fault }),
        (gateway.clone(), channel.clone())
            .prop_map(|(gateway, channel)| Fault::BusOff { gateway, channel }),
        (gateway, channel, 1..50u32).prop_map(|(gateway, channel, frames)| Fault::ErrorFrames {
            gateway,
            channel,
            frames
        }),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 12,
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn the_bus_recovers_from_any_sequence_of_passing_faults(
        script in proptest::collection::vec((faults(), 0..1_000usize), 1..6),
    ) {
        let mut program = Program::new(stepped_echo(2), &[3, 2]).into_op();
        for (fault, cycles) in script {
            program.simulation().inject(fault);
            program.cycles(cycles);
        }
        // The longest fault, a look at the bus, a scan.
        program.cycles(4_000);
        prop_assert!(program.reaches_op(), "{:#?}", program.simulation().kernel_log());
        program.cycles(20);
        program.received.clear();
        let frames: Vec<_> = (0..2u16)
            .map(|slave| {
                let id = CanId::standard(0x100 + slave).unwrap();
                (usize::from(slave), 1, CanFrame::classic(id, &[7]).unwrap())
            })
            .collect();
        program.cycle_with(&frames);
        program.receive_frames(2);
        program.received.sort_by_key(|(slave, ..)| *slave);
        prop_assert_eq!(&program.received, &frames);
    }
}
