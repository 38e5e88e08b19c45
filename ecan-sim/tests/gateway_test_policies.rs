//! 0x8030 and the bypass options: the key rule, and what each policy cuts off
//! (manual 9.1, 13.2.3).

mod gateway_support;

use ecan_protocol::config::{
    CrcTest, DIAGNOSTIC_TEST_KEY, DiagnosticTest, RxBypass, Sides, TxBypass,
};
use ecan_protocol::image::{ImageReader, ImageWriter, OptionFlags, PdoProfile};
use ecan_protocol::mapping::Direction;
use ecan_protocol::object::AbortCode;
use gateway_support::{Fixture, MS, chunks, standard};

const KEYED: DiagnosticTest = DiagnosticTest { key: DIAGNOSTIC_TEST_KEY, ..DiagnosticTest::OFF };

fn with(test: DiagnosticTest) -> Fixture {
    let mut bench = Fixture::op(chunks(3), chunks(3));
    for write in test.writes() {
        bench.send(write);
    }
    bench
}

fn send_one(bench: &mut Fixture) -> usize {
    bench.push(0, standard(1, &[]));
    bench.write();
    bench.sent(0).len()
}

fn receive_one(bench: &mut Fixture) -> usize {
    bench.deliver(0, standard(1, &[]));
    bench.write();
    if bench.read() { bench.received().len() } else { 0 }
}

#[test]
fn policies_need_the_key() {
    let mut bench = Fixture::preop();
    for (subindex, data) in
        [(2, &[4, 0, 0, 0][..]), (3, &[4, 0, 0, 0]), (4, &[1]), (5, &[1]), (6, &[1])]
    {
        let refused = bench.download(0x8030, subindex, data);
        assert_eq!(refused, Err(AbortCode::PARAMETER_INCOMPATIBLE));
        assert!(bench.try_upload(0x8030, subindex).unwrap().iter().all(|&byte| byte == 0));
        assert_ne!(bench.upload(0x8030, 9), 0, "reject reason");
        let zeros = vec![0; data.len()];
        assert_eq!(bench.download(0x8030, subindex, &zeros), Ok(()), "0 needs no key");
    }
    bench.download(0x8030, 1, &DIAGNOSTIC_TEST_KEY.to_le_bytes()).unwrap();
    assert_eq!(bench.upload(0x8030, 9), 0);
    bench.download(0x8030, 2, &[0x1C, 0, 0, 0]).unwrap();
    let taken_away = bench.download(0x8030, 1, &[0; 4]);
    assert_eq!(taken_away, Err(AbortCode::PARAMETER_INCOMPATIBLE));
    bench.download(0x8030, 2, &[0; 4]).unwrap();
    bench.download(0x8030, 1, &[0; 4]).unwrap();
}

#[test]
fn bits_and_values_without_meaning_are_refused() {
    let mut bench = with(KEYED);
    for (subindex, data) in
        [(1, &[1, 2, 3, 4][..]), (2, &[1, 0, 0, 0]), (3, &[0x40, 0, 0, 0]), (4, &[3]), (6, &[4])]
    {
        assert!(bench.download(0x8030, subindex, data).is_err());
    }
}

#[test]
fn rx_stages_can_be_skipped() {
    for (bypass, error_seen, lost) in [
        (RxBypass::STAGE, false, 0),
        (RxBypass::PARSE, false, 0),
        (RxBypass::TX_RING, true, 1),
        (RxBypass::MCAN_WRITE, true, 1),
    ] {
        let mut bench = with(DiagnosticTest { rx_bypass: bypass, ..KEYED });
        assert_eq!(send_one(&mut bench), 0, "{bypass:?}");
        assert_eq!(bench.gateway.counters().transmit_losses.bypassed, lost);
        bench.read();
        bench.image[0] = 0;
        bench.write_again();
        assert_eq!(bench.upload(0x8011, 15) != 0, error_seen, "{bypass:?}");
        for write in DiagnosticTest::OFF.writes() {
            bench.send(write);
        }
        bench.read();
        assert_eq!(send_one(&mut bench), 1);
    }
}

#[test]
fn tx_stages_can_be_skipped() {
    for bypass in [TxBypass::MCAN_READ, TxBypass::BUILD] {
        let mut bench = with(DiagnosticTest { tx_bypass: bypass, ..KEYED });
        assert_eq!(receive_one(&mut bench), 0, "{bypass:?}");
        assert_eq!(bench.input().header().payload_len, 0);
        let sequence = bench.input().sequence();
        assert_eq!(receive_one(&mut bench), 0);
        assert_eq!(bench.input().sequence(), sequence + 1, "images go on");
    }
    let mut bench = with(DiagnosticTest { tx_bypass: TxBypass::COPY, ..KEYED });
    assert!(bench.write());
    assert!(!bench.read(), "nothing is published");
}

#[test]
fn app_link_bypass_and_the_option_cut_off_the_same() {
    let option = PdoProfile { options: OptionFlags::APP_BYPASS, ..chunks(3) };
    for (tx, rx, sides, sends, receives) in [
        (chunks(3), chunks(3), Sides::Tx, 1, 0),
        (chunks(3), chunks(3), Sides::Rx, 0, 1),
        (chunks(3), chunks(3), Sides::Both, 0, 0),
        (option, chunks(3), Sides::Off, 1, 0),
        (chunks(3), option, Sides::Off, 0, 1),
    ] {
        let mut bench = Fixture::op(tx, rx);
        for write in (DiagnosticTest { app_link_bypass: sides, ..KEYED }).writes() {
            bench.send(write);
        }
        assert_eq!(send_one(&mut bench), sends, "{sides:?}");
        bench.read();
        bench.pass(MS);
        assert_eq!(receive_one(&mut bench), receives, "{sides:?}");
        assert_eq!(bench.upload(0x8010, 14), 0);
    }
}

#[test]
fn crc_policy_overrides_the_option_both_ways() {
    let without = PdoProfile { options: OptionFlags::NO_CRC16, ..chunks(3) };
    for (profile, crc, with_crc) in [
        (chunks(3), CrcTest::Follow, true),
        (chunks(3), CrcTest::Suppress, false),
        (without, CrcTest::Follow, false),
        (without, CrcTest::Force, true),
    ] {
        let mut bench = Fixture::op(profile, profile);
        for write in (DiagnosticTest { crc, ..KEYED }).writes() {
            bench.send(write);
        }
        bench.writer = ImageWriter::new(Direction::RxPdo, profile).with_crc(with_crc);
        bench.reader = ImageReader::new(Direction::TxPdo, profile).with_crc(with_crc);
        assert_eq!(send_one(&mut bench), 1, "{crc:?}");
        assert!(bench.read());
        assert_eq!(bench.input().header().crc_alg, u8::from(with_crc));
        assert_eq!(bench.upload(0x8010, 12), profile.word(), "the layout stays");
        if with_crc {
            bench.writer = ImageWriter::new(Direction::RxPdo, profile).with_crc(false);
            bench.writer.set_next_sequence(9);
            assert_eq!(send_one(&mut bench), 0);
            assert_eq!(bench.upload(0x8011, 14), 14);
        }
    }
}

#[test]
fn payload_only_policy_leaves_stale_bytes_in_the_input_image() {
    for (sides, stale) in [(Sides::Tx, true), (Sides::Both, true), (Sides::Rx, false)] {
        let mut bench = with(DiagnosticTest { payload_only: sides, ..KEYED });
        bench.deliver(0, standard(1, &[0xAB; 8]));
        bench.cycle();
        bench.cycle();
        assert_eq!(bench.input[28] == 0xAB, stale, "{sides:?}");
        assert_eq!(bench.received(), []);
    }
}

#[test]
fn legal_combinations_are_told() {
    let mut bench = Fixture::preop();
    assert_eq!(bench.upload(0x8030, 8), 0x1F);
}
