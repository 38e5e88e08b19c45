//! For any input, the gateway responds with a code or a counter, its counters stay consistent, and
//! the same seed gives the same result.

use super::fixture::{Fixture, MS, chunks, fd, standard};
use ecan_protocol::device::AlState;
use ecan_protocol::image::{CommitFields, Packet, PdoProfile};
use ecan_protocol::object::objects;
use ecan_sim::{ErrorState, GatewayCounters, GatewayModelConfig, ReceiveLosses};
use proptest::prelude::*;

/// An action on a gateway.
#[derive(Clone, Debug)]
enum Step {
    Download { object: prop::sample::Index, instance: u16, subindex: u8, data: Vec<u8> },
    Upload { index: u16, subindex: u8 },
    Request(u8),
    Image(Vec<u8>),
    Frames(u8),
    FromBus(u8),
    Cycle,
    BusState(u8),
    Pass(u32),
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        4 => (any::<prop::sample::Index>(), 0u16..5, 0u8..90, prop::collection::vec(any::<u8>(), 0..5))
            .prop_map(|(object, instance, subindex, data)| {
                Step::Download { object, instance, subindex, data }
            }),
        1 => (any::<u16>(), any::<u8>())
            .prop_map(|(index, subindex)| Step::Upload { index, subindex }),
        2 => (0u8..5).prop_map(Step::Request),
        2 => prop::collection::vec(any::<u8>(), 24..200).prop_map(Step::Image),
        3 => (0u8..40).prop_map(Step::Frames),
        3 => any::<u8>().prop_map(Step::FromBus),
        6 => Just(Step::Cycle),
        1 => any::<u8>().prop_map(Step::BusState),
        1 => (0u32..3_000_000).prop_map(Step::Pass),
    ]
}

fn run(fixture: &mut Fixture, step: &Step) {
    match step {
        Step::Download { object, instance, subindex, data } => {
            let object = object.get(objects());
            let index = object.first + instance % object.count * object.stride;
            let _ = fixture.download(index, *subindex, data);
        }
        Step::Upload { index, subindex } => {
            let _ = fixture.try_upload(*index, *subindex);
        }
        Step::Request(state) => {
            let states =
                [AlState::Init, AlState::PreOp, AlState::Boot, AlState::SafeOp, AlState::Op];
            fixture.gateway.request_al_state(fixture.now, states[usize::from(*state)]);
        }
        Step::Image(bytes) => {
            let mut image = vec![0; fixture.image.len()];
            image[..bytes.len()].copy_from_slice(bytes);
            fixture.gateway.write_outputs(fixture.now, &image);
            fixture.pass(50_000);
        }
        Step::Frames(count) => {
            for number in 0..*count {
                fixture.push(number % 4, standard(number.into(), &[number; 3]));
            }
            fixture.writer.commit(&mut fixture.image, CommitFields::default());
        }
        Step::FromBus(byte) => {
            fixture.deliver(usize::from(*byte) % 4, fd(u16::from(*byte) * 7, &[*byte; 8]));
        }
        Step::Cycle => {
            fixture.write_again();
            fixture.read();
            fixture.pass(MS / 2);
            for channel in 0..4 {
                if let Some(frame) = fixture.gateway.next_transmit(channel) {
                    fixture.gateway.transmitted(fixture.now, channel, &frame);
                }
            }
        }
        Step::BusState(byte) => {
            let states =
                [ErrorState::Active, ErrorState::Warning, ErrorState::Passive, ErrorState::BusOff];
            let state = states[usize::from(byte / 4) % 4];
            fixture.gateway.bus_state(fixture.now, usize::from(byte % 4), state, 0, 0);
        }
        Step::Pass(ns) => fixture.pass(u64::from(*ns)),
    }
}

/// Restores the mailbox, which may drop waiting frames.
fn make_readable(fixture: &mut Fixture) {
    if !fixture.gateway.is_responding() {
        fixture.pass(1_000 * MS);
    }
    if !fixture.gateway.mailbox_answers(fixture.now) || fixture.gateway.al_state() == AlState::Boot
    {
        fixture.request(AlState::Init);
        fixture.request(AlState::PreOp);
    }
}

/// Frames in both directions that are neither delivered, nor lost, nor waiting.
fn unaccounted(fixture: &mut Fixture) -> (i64, i64) {
    let (mut waiting_out, mut waiting_in) = (0, 0);
    for channel in 0..4 {
        waiting_out += i64::from(fixture.upload(0x9000 + channel, 11));
        waiting_in += i64::from(fixture.upload(0x9000 + channel, 10));
    }
    let counters = *fixture.gateway.counters();
    let out = counters.transmit_losses;
    let lost_out = out.invalid_channel
        + out.bus_off
        + out.ring_full
        + out.stale
        + out.late
        + out.schedule_full
        + out.schedule_failed
        + out.bypassed
        + out.not_retransmitted;
    let lost_in = lost_in(&counters);
    (
        counters.frames_parsed as i64 - (counters.frames_on_bus + lost_out) as i64 - waiting_out,
        counters.frames_from_bus as i64 - (counters.frames_to_master + lost_in) as i64 - waiting_in,
    )
}

fn lost_in(counters: &GatewayCounters) -> u64 {
    let ReceiveLosses { filtered, controller_full, cache_full, oversized, masked, flushed } =
        counters.receive_losses;
    filtered + controller_full + cache_full + oversized + masked + flushed
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    #[test]
    fn any_sequence_of_steps_keeps_the_books(steps in prop::collection::vec(step(), 1..80)) {
        let mut fixture = Fixture::op(chunks(8), chunks(8));
        for step in &steps {
            run(&mut fixture, step);
        }
        make_readable(&mut fixture);
        prop_assert_eq!(unaccounted(&mut fixture), (0, 0));
    }

    #[test]
    fn equal_seeds_give_equal_runs(steps in prop::collection::vec(step(), 1..40)) {
        let config = GatewayModelConfig { service_jitter_ns: 20_000, ..Default::default() };
        let [first, second] = [(); 2].map(|()| {
            let mut fixture = Fixture::preop_with(config.clone());
            fixture.apply_profiles(chunks(8), chunks(8));
            fixture.apply_channel(0, Default::default());
            fixture.start();
            for step in &steps {
                run(&mut fixture, step);
            }
            (*fixture.gateway.counters(), fixture.input.clone(), fixture.gateway.next_event())
        });
        prop_assert_eq!(first, second);
    }

    #[test]
    fn every_image_published_is_one_that_the_reader_accepts(
        profile in prop::sample::select(ecan_protocol::image::EncapsulationProfile::ALL),
        budget in 0u8..3,
        multiplier in 1u8..25,
        options in 0u8..0x08,
        frames in prop::collection::vec((0usize..4, 0usize..16, any::<bool>()), 0..60),
    ) {
        let tx = PdoProfile {
            multiplier,
            profile,
            budget: ecan_protocol::image::BudgetPolicy::from_raw(budget).unwrap(),
            options: ecan_protocol::image::OptionFlags::from_bits(options).unwrap(),
            ..PdoProfile::default()
        };
        let mut fixture = Fixture::op(tx, chunks(8));
        let mut cycles = 0;
        for (count, (channel, size, is_fd)) in frames.iter().enumerate() {
            let length = ecan_protocol::can::Dlc::new(*size as u8).unwrap().fd_len();
            let frame = if *is_fd {
                fd(count as u16, &vec![count as u8; length])
            } else {
                standard(count as u16, &vec![count as u8; length.min(8)])
            };
            fixture.deliver(*channel, frame);
            fixture.push(*channel as u8, standard(count as u16, &[]));
            if count % 3 == 0 {
                fixture.cycle();
                cycles += 1;
                fixture.packets(|packet| Some(matches!(packet, Packet::Frame(_))));
            }
        }
        for _ in 0..80 {
            fixture.cycle();
            cycles += 1;
            fixture.packets(|packet| Some(matches!(packet, Packet::Frame(_))));
        }
        let counters = *fixture.gateway.counters();
        prop_assert_eq!(counters.images_read, cycles + 1);
        prop_assert_eq!(counters.frames_to_master + lost_in(&counters), frames.len() as u64);
    }
}
