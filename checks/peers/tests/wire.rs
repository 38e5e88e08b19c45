//! An independent master drives the gateways over frames in memory.

use std::time::Duration;

use crate::ethercrab_support::bring_up::configure;
use crate::ethercrab_support::{Fixture, MAX_GATEWAYS, MAX_PDI, MS, into_op, on_a_deep_stack};
use ethercrab::DcSync;
use ethercrab::subdevice_group::DcConfiguration;

/// N of the example image.
const CHUNKS: u8 = 8;

/// The first example image of manual 5.4.4.1 (N = 8, all channels), up to the end of its frame.
const EXAMPLE: [u8; 36] = [
    0x16, 0x00, 0x01, 0x00, 0x01, 0x00, 0x0C, 0x00, 0xD3, 0x56, 0xE7, 0x01, 0x0F, 0x01, 0x00, 0x01,
    0, 0, 0, 0, 0, 0, 0, 0, 0x40, 0x00, 0x23, 0x01, 0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88,
];

#[test]
fn example_image_of_the_manual_goes_out_and_its_echo_returns() {
    on_a_deep_stack(|| {
        for gateways in [1, 3] {
            let mut fixture = Fixture::new(&ecan_sim::echo(gateways));
            let group = fixture.run(async |master| into_op(master, gateways, CHUNKS).await);
            let mut echoes = vec![0; gateways];
            let mut counter = None;
            for cycle in 0..20 {
                fixture.pass(MS);
                fixture.run(async |master| {
                    for gateway in group.iter(master) {
                        let mut io = gateway.io_raw_mut();
                        let outputs = io.outputs();
                        assert_eq!(outputs.len(), 1024);
                        if cycle == 3 {
                            outputs[..EXAMPLE.len()].copy_from_slice(&EXAMPLE);
                        }
                    }
                    let response = group.tx_rx(master).await?;
                    // images on two frames count in both
                    let complete = *counter.get_or_insert(response.working_counter);
                    assert!(complete >= 3 * gateways as u16, "{complete}");
                    assert_eq!(response.working_counter, complete, "cycle {cycle}");
                    for (gateway, echoes) in group.iter(master).zip(&mut echoes) {
                        let inputs = gateway.inputs_raw();
                        // a received frame has its source in the upper bits of the ID
                        let has_frame = inputs[24..26] == EXAMPLE[24..26];
                        if inputs[13] == 1 && has_frame && inputs[28..36] == EXAMPLE[28..36] {
                            assert_eq!(inputs[26..28], EXAMPLE[26..28]);
                            *echoes += 1;
                        }
                    }
                    Ok(())
                });
            }
            assert_eq!(echoes, vec![1; gateways]);
            for gateway in 0..gateways {
                let counters = fixture.wire.world().counters(gateway).unwrap();
                assert_eq!((counters.frames_on_bus, counters.frames_from_bus), (1, 1));
            }
        }
    });
}

#[test]
fn every_size_of_process_data_reaches_op() {
    on_a_deep_stack(|| {
        for (gateways, chunks) in [(1, 1), (3, 3), (1, 8), (1, 24), (3, 24)] {
            let mut fixture = Fixture::new(&ecan_sim::echo(gateways));
            let group = fixture.run(async |master| into_op(master, gateways, chunks).await);
            let before = fixture.wire.world().counters(0).unwrap();
            for _ in 0..20 {
                fixture.pass(MS);
                fixture.run(async |master| {
                    group.tx_rx(master).await?;
                    for gateway in group.iter(master) {
                        assert_eq!(gateway.inputs_raw().len(), 128 * usize::from(chunks));
                        assert_eq!(gateway.inputs_raw()[0], 0x16, "a header of version 1");
                        assert_eq!(gateway.status().await?.0, ethercrab::SubDeviceState::Op);
                    }
                    Ok(())
                });
            }
            let counters = fixture.wire.world().counters(0).unwrap();
            assert_eq!(counters.images_written - before.images_written, 20, "N = {chunks}");
            assert_eq!(counters.images_read - before.images_read, 20, "N = {chunks}");
        }
    });
}

#[test]
fn objects_of_all_sizes_are_read_and_written() {
    on_a_deep_stack(|| {
        let mut fixture = Fixture::new(&ecan_sim::echo(1));
        fixture.run(async |master| {
            let group = master.init_single_group::<4, 64>(|| 0).await?;
            let gateway = group.subdevice(master, 0)?;
            assert_eq!(gateway.name(), "ECAN-Lite");
            assert_eq!(gateway.identity().vendor_id, 0x4543);
            let name: [u8; 9] = gateway.sdo_read(0x1008, 0).await?;
            assert_eq!(&name, b"ECAN-Lite");
            assert!(gateway.sdo_read::<u32>(0x8000, 4).await? > 0);
            let aborted = gateway.sdo_read::<u32>(0x5555, 0).await.unwrap_err();
            assert!(aborted.to_string().contains("0x5555"), "{aborted}");
            let rejected = gateway.sdo_write(0xF000, 2, 1_u8).await.unwrap_err();
            assert!(matches!(rejected, ethercrab::error::Error::Mailbox(_)), "{rejected}");
            let unit: [u8; 16] = gateway.sdo_read(0x6000, 1).await?;
            assert_eq!(unit.len(), 16);
            let counts = gateway.sdo_info_object_quantities().await?.unwrap();
            assert!(counts.all > 400, "{counts:?}");
            configure(&gateway, 3).await
        });
    });
}

/// Drifting clocks are set, measured and synchronized; Sync0 is simultaneous.
#[test]
fn distributed_clocks_reach_op_with_sync0_in_phase() {
    on_a_deep_stack(|| {
        let mut scenario = ecan_sim::echo(3);
        for (gateway, drift) in scenario.gateways.iter_mut().zip([20_000, 50_000, -50_000]) {
            gateway.config.clock_drift_ppb = drift;
        }
        let mut fixture = Fixture::new(&scenario);
        let group = fixture.run(async |master| {
            let mut group = master.init_single_group::<MAX_GATEWAYS, MAX_PDI>(|| 0).await?;
            for mut gateway in group.iter_mut(master) {
                gateway.set_dc_sync(DcSync::Sync0);
            }
            for gateway in group.iter(master) {
                configure(&gateway, 3).await?;
            }
            let delays: Vec<_> =
                group.iter(master).map(|gateway| gateway.propagation_delay()).collect();
            assert_eq!(delays, [0, 600, 1200], "a hop on the wire takes 600 ns");
            group.into_pre_op_pdi(master).await
        });
        for _ in 0..1_000 {
            fixture.pass(MS);
            fixture.run(async |master| group.tx_rx_sync_system_time(master).await.map(|_| ()));
        }
        let group = fixture.run(async |master| {
            let configuration = DcConfiguration {
                start_delay: Duration::from_millis(20),
                sync0_period: Duration::from_millis(1),
                sync0_shift: Duration::from_micros(300),
            };
            let group = group.configure_dc_sync(master, configuration).await?;
            let group = group.into_safe_op(master).await?;
            group.request_into_op(master).await
        });
        let mut in_op = 0;
        for _ in 0..200 {
            fixture.pass(MS);
            let is_in_op = fixture.run(async |master| {
                let response = group.tx_rx_dc(master).await?;
                Ok(response.all_op())
            });
            in_op += u32::from(is_in_op);
        }
        assert!(in_op > 150, "{in_op} of 200 cycles");
        let now = fixture.now;
        let pulses: Vec<_> = (0..3)
            .map(|index| fixture.wire.world().gateway(index).unwrap().next_sync0(now).unwrap())
            .collect();
        let spread = pulses.iter().max().unwrap() - pulses.iter().min().unwrap();
        assert!(spread < 1_000, "{pulses:?}");
        fixture.run(async |master| {
            for gateway in group.iter(master) {
                assert!(gateway.sdo_read::<u32>(0x9011, 2).await? > 100, "Sync0 pulses");
                let difference = gateway.register_read::<u32>(0x092C_u16).await? & 0x7FFF_FFFF;
                assert!(
                    difference < 1_000,
                    "{:#06x}: {difference} ns",
                    gateway.configured_address()
                );
            }
            Ok(())
        });
    });
}
