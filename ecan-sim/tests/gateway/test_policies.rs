//! 0x8030 and the bypass options: key rule and effects (manual 9.1, 13.2.3).

use super::fixture::{Fixture, MS, chunks, standard};
use ecan_protocol::config::{
    CrcTest, DIAGNOSTIC_TEST_KEY, DiagnosticTest, RxBypass, Sides, TxBypass,
};
use ecan_protocol::image::{ImageReader, ImageWriter, OptionFlags, PdoProfile};
use ecan_protocol::mapping::Direction;
use ecan_protocol::object::AbortCode;

const KEYED: DiagnosticTest = DiagnosticTest { key: DIAGNOSTIC_TEST_KEY, ..DiagnosticTest::OFF };

fn with(test: DiagnosticTest) -> Fixture {
    let mut fixture = Fixture::op(chunks(3), chunks(3));
    fixture.send(test.writes());
    fixture
}

fn send_one(fixture: &mut Fixture) -> usize {
    fixture.push(0, standard(1, &[]));
    fixture.write();
    fixture.sent(0).len()
}

fn receive_one(fixture: &mut Fixture) -> usize {
    fixture.deliver(0, standard(1, &[]));
    fixture.write();
    if fixture.read() { fixture.received().len() } else { 0 }
}

#[test]
fn test_policies_need_the_key() {
    let mut fixture = Fixture::preop();
    for (subindex, data) in
        [(2, &[4, 0, 0, 0][..]), (3, &[4, 0, 0, 0]), (4, &[1]), (5, &[1]), (6, &[1])]
    {
        let rejected = fixture.download(0x8030, subindex, data);
        assert_eq!(rejected, Err(AbortCode::PARAMETER_INCOMPATIBLE));
        assert!(fixture.try_upload(0x8030, subindex).unwrap().iter().all(|&byte| byte == 0));
        assert_ne!(fixture.upload(0x8030, 9), 0, "reject reason");
        let zeros = vec![0; data.len()];
        assert_eq!(fixture.download(0x8030, subindex, &zeros), Ok(()), "0 needs no key");
    }
    fixture.download(0x8030, 1, &DIAGNOSTIC_TEST_KEY.to_le_bytes()).unwrap();
    assert_eq!(fixture.upload(0x8030, 9), 0);
    fixture.download(0x8030, 2, &[0x1C, 0, 0, 0]).unwrap();
    let taken_away = fixture.download(0x8030, 1, &[0; 4]);
    assert_eq!(taken_away, Err(AbortCode::PARAMETER_INCOMPATIBLE));
    fixture.download(0x8030, 2, &[0; 4]).unwrap();
    fixture.download(0x8030, 1, &[0; 4]).unwrap();
}

#[test]
fn undefined_bits_and_values_are_rejected() {
    let mut fixture = with(KEYED);
    for (subindex, data) in
        [(1, &[1, 2, 3, 4][..]), (2, &[1, 0, 0, 0]), (3, &[0x40, 0, 0, 0]), (4, &[3]), (6, &[4])]
    {
        assert!(fixture.download(0x8030, subindex, data).is_err());
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
        let mut fixture = with(DiagnosticTest { rx_bypass: bypass, ..KEYED });
        assert_eq!(send_one(&mut fixture), 0, "{bypass:?}");
        assert_eq!(fixture.gateway.counters().transmit_losses.bypassed, lost);
        fixture.read();
        fixture.image[0] = 0;
        fixture.write_again();
        assert_eq!(fixture.upload(0x8011, 15) != 0, error_seen, "{bypass:?}");
        fixture.send(DiagnosticTest::OFF.writes());
        fixture.read();
        assert_eq!(send_one(&mut fixture), 1);
    }
}

#[test]
fn tx_stages_can_be_skipped() {
    for bypass in [TxBypass::MCAN_READ, TxBypass::BUILD] {
        let mut fixture = with(DiagnosticTest { tx_bypass: bypass, ..KEYED });
        assert_eq!(receive_one(&mut fixture), 0, "{bypass:?}");
        assert_eq!(fixture.input().header().payload_len, 0);
        let sequence = fixture.input().sequence();
        assert_eq!(receive_one(&mut fixture), 0);
        assert_eq!(fixture.input().sequence(), sequence + 1, "images go on");
    }
    let mut fixture = with(DiagnosticTest { tx_bypass: TxBypass::COPY, ..KEYED });
    assert!(fixture.write());
    assert!(!fixture.read(), "nothing is published");
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
        let mut fixture = Fixture::op(tx, rx);
        fixture.send((DiagnosticTest { app_link_bypass: sides, ..KEYED }).writes());
        assert_eq!(send_one(&mut fixture), sends, "{sides:?}");
        fixture.read();
        fixture.pass(MS);
        assert_eq!(receive_one(&mut fixture), receives, "{sides:?}");
        assert_eq!(fixture.upload(0x8010, 14), 0);
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
        let mut fixture = Fixture::op(profile, profile);
        fixture.send((DiagnosticTest { crc, ..KEYED }).writes());
        fixture.writer = ImageWriter::new(Direction::RxPdo, profile).with_crc(with_crc);
        fixture.reader = ImageReader::new(Direction::TxPdo, profile).with_crc(with_crc);
        assert_eq!(send_one(&mut fixture), 1, "{crc:?}");
        assert!(fixture.read());
        assert_eq!(fixture.input().header().crc_alg, u8::from(with_crc));
        assert_eq!(fixture.upload(0x8010, 12), profile.word(), "the layout stays");
        if with_crc {
            fixture.writer = ImageWriter::new(Direction::RxPdo, profile).with_crc(false);
            fixture.writer.set_next_sequence(9);
            assert_eq!(send_one(&mut fixture), 0);
            assert_eq!(fixture.upload(0x8011, 14), 14);
        }
    }
}

#[test]
fn payload_only_policy_leaves_stale_bytes_in_the_input_image() {
    for (sides, stale) in [(Sides::Tx, true), (Sides::Both, true), (Sides::Rx, false)] {
        let mut fixture = with(DiagnosticTest { payload_only: sides, ..KEYED });
        fixture.deliver(0, standard(1, &[0xAB; 8]));
        fixture.cycle();
        fixture.cycle();
        assert_eq!(fixture.input[28] == 0xAB, stale, "{sides:?}");
        assert_eq!(fixture.received(), []);
    }
}
