//! After any faults of line, supply and bus, the slave returns to OP and works.

use crate::ecrt_support::{Program, frame, stepped_echo};
use ecan_protocol::device::AlState;
use ecan_sim::{Fault, GatewayFault, LossDirection};
use proptest::prelude::*;

fn faults() -> impl Strategy<Value = Fault> {
    let direction = prop_oneof![Just(LossDirection::Outward), Just(LossDirection::Return)];
    let gateway = 0..2usize;
    let channel = 0..4usize;
    let inside = prop_oneof![
        (1..3u32).prop_map(|images| GatewayFault::TornTxPdo { images }),
        (1..3u32).prop_map(|images| GatewayFault::CrcErrorTxPdo { images }),
        (1..200u32).prop_map(|ms| GatewayFault::ServiceStall { ms }),
        Just(GatewayFault::AlError { code: 0x001A }),
    ];
    prop_oneof![
        (direction, 1..300u32)
            .prop_map(|(direction, cycles)| Fault::LostFrame { direction, cycles }),
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

/// An AL error in response to a request of the master keeps the slave in its state, because a real
/// master stops then; so AL errors are injected in OP only.
fn strikes(program: &Program, fault: &Fault) -> bool {
    let Fault::Gateway { gateway, fault: GatewayFault::AlError { .. } } = fault else {
        return true;
    };
    program.simulation().with_world(|world| {
        world.gateway(*gateway).is_some_and(|gateway| gateway.al_state() == AlState::Op)
    })
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 12,
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn bus_recovers_from_any_sequence_of_passing_faults(
        script in proptest::collection::vec((faults(), 0..1_000usize), 1..6),
    ) {
        let mut program = Program::new(stepped_echo(2), &[3, 2]).into_op();
        for (fault, cycles) in script {
            if strikes(&program, &fault) {
                program.simulation().inject(fault);
            }
            program.cycles(cycles);
        }
        // the longest fault, a poll, a scan
        program.cycles(4_000);
        prop_assert!(program.reaches_op(), "{:#?}", program.simulation().kernel_log());
        program.cycles(20);
        program.received.clear();
        let frames = [0, 1].map(|slave| (slave, 1, frame(0x100 + slave as u16, &[7])));
        program.cycle_with(&frames);
        program.receive_frames(2);
        program.received.sort_by_key(|(slave, ..)| *slave);
        prop_assert_eq!(&program.received[..], &frames);
    }
}
