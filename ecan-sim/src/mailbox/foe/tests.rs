//! FoE messages byte by byte.

use ecan_protocol::device::AlState;
use proptest::prelude::*;

use super::FoeServer;
use crate::fault::GatewayFault;
use crate::gateway::{FirmwarePackage, Gateway, GatewayModelConfig, SyncManagerConfig};
use crate::mailbox::messages::Context;

const MS: u64 = 1_000_000;
const NAME: &[u8] = b"ecan_lite_app";

struct Fixture {
    now: u64,
    room: usize,
    server: FoeServer,
    gateway: Gateway,
}

impl Fixture {
    /// A gateway in PREOP with mailboxes for `room` bytes of FoE.
    fn new(room: usize) -> Self {
        let mut gateway = Gateway::new(GatewayModelConfig::default(), 1);
        gateway.power(0, true);
        let now = 1_000 * MS;
        gateway.set_up_mailboxes();
        gateway.request_al_state(now, AlState::PreOp);
        let length = room as u16 + 6;
        let config = SyncManagerConfig { start: 0x1000, length, control: 0x26 };
        gateway.configure_sync_manager(0, Some(config));
        Self { now, room, server: FoeServer::default(), gateway }
    }

    fn ask(&mut self, request: &[u8]) -> Vec<u8> {
        let Self { now, room, server, gateway } = self;
        let context = &mut Context { now: *now, room: *room, gateway };
        server.request(request, context).unwrap_or_default()
    }

    fn open(&mut self, opcode: u8, password: u32, name: &[u8]) -> Vec<u8> {
        self.ask(&message(opcode, password, name))
    }

    /// Sends a data packet until it is accepted or rejected; returns the response and the number of
    /// BUSYs.
    fn data(&mut self, number: u32, data: &[u8]) -> (Vec<u8>, usize) {
        let request = message(3, number, data);
        for busy in 0..1_000 {
            let answer = self.ask(&request);
            if answer.first() != Some(&6) {
                return (answer, busy);
            }
            self.now += MS;
        }
        panic!("busy for ever");
    }

    /// Writes a file; returns the response to its last packet.
    fn write(&mut self, file: &[u8]) -> Vec<u8> {
        assert_eq!(self.open(2, 0, NAME), [4, 0, 0, 0, 0, 0]);
        let size = self.room - 6;
        let mut packets: Vec<&[u8]> = file.chunks(size).collect();
        if file.len().is_multiple_of(size) {
            packets.push(&[]);
        }
        let last = packets.len() as u32;
        for (number, data) in (1..).zip(packets) {
            let (answer, _) = self.data(number, data);
            if number == last || answer[0] != 4 {
                return answer;
            }
            assert_eq!(answer, message(4, number, &[]));
        }
        unreachable!("every file has a last packet");
    }

    fn version(&mut self) -> (Vec<u8>, String) {
        let mut halves = Vec::new();
        let mut out = Vec::new();
        for subindex in [1, 5, 6] {
            self.gateway.sdo_upload(self.now, 0xF000, subindex, &mut out).unwrap();
            halves.extend(&out);
        }
        self.gateway.sdo_upload(self.now, 0x100A, 0, &mut out).unwrap();
        (halves, String::from_utf8(out).unwrap())
    }

    /// Waits for the restart after a successful update.
    fn restart(&mut self) {
        self.now += 499 * MS;
        self.gateway.advance(self.now);
        assert!(self.gateway.is_responding());
        self.now += MS;
        self.gateway.advance(self.now);
        assert!(!self.gateway.is_responding());
        self.now += 200 * MS;
        self.gateway.advance(self.now);
        assert_eq!(self.gateway.al_state(), AlState::Init);
        self.gateway.set_up_mailboxes();
        self.gateway.request_al_state(self.now, AlState::PreOp);
    }
}

fn message(opcode: u8, field: u32, data: &[u8]) -> Vec<u8> {
    let mut bytes = vec![opcode, 0];
    bytes.extend(field.to_le_bytes());
    bytes.extend(data);
    bytes
}

fn error(code: u32, text: &str) -> Vec<u8> {
    message(5, code, text.as_bytes())
}

fn package(payload: usize) -> FirmwarePackage {
    let bytes = (0..payload).map(|at| (at * 7) as u8).collect();
    FirmwarePackage::new(0, 0x0305_000E, bytes)
}

#[test]
fn update_brings_the_new_version() {
    let mut fixture = Fixture::new(122);
    assert_eq!(fixture.version(), (vec![0, 0x02, 0x02, 0x01, 0x00], "2.2.1".to_owned()));
    let file = package(20_000).to_bytes();
    assert_eq!(fixture.write(&file), message(4, 173, &[]));
    assert_eq!(fixture.version().1, "2.2.1", "until the restart");
    fixture.restart();
    assert_eq!(fixture.version(), (vec![0, 0x05, 0x03, 0x0E, 0x00], "3.5.14".to_owned()));
    assert_eq!(fixture.gateway.running_firmware(), file);
}

#[test]
fn bytes_of_a_write() {
    let mut fixture = Fixture::new(122);
    let request = [
        0x02, 0x00, 0x00, 0x00, 0x00, 0x00, b'e', b'c', b'a', b'n', b'_', b'l', b'i', b't', b'e',
        b'_', b'a', b'p', b'p',
    ];
    assert_eq!(fixture.ask(&request), [0x04, 0x00, 0x00, 0x00, 0x00, 0x00]);
    let file = package(0).to_bytes();
    assert_eq!(file[..16], [b'E', b'C', b'L', b'A', 32, 0, 0, 0, 0, 0, 0, 0, 0x0E, 0, 5, 3]);
    let mut data = vec![0x03, 0x00, 0x01, 0x00, 0x00, 0x00];
    data.extend(&file);
    // the partition is being erased
    assert_eq!(fixture.ask(&data), [0x06, 0x00, 0x00, 0x00, 100, 0x00]);
    fixture.now += 50 * MS;
    assert_eq!(fixture.ask(&data), [0x06, 0x00, 50, 0x00, 100, 0x00]);
    fixture.now += 50 * MS;
    // accepted, being written
    assert_eq!(fixture.ask(&data), [0x06, 0x00, 0x00, 0x00, 100, 0x00]);
    fixture.now += 2 * MS;
    assert_eq!(fixture.ask(&data), [0x04, 0x00, 0x01, 0x00, 0x00, 0x00]);
    fixture.restart();
    assert_eq!(fixture.version().1, "3.5.14");
}

#[test]
fn full_last_packet_is_followed_by_an_empty_one() {
    let mut fixture = Fixture::new(70);
    // 32 bytes of header and 96 of payload are two packets of 64
    let file = package(96).to_bytes();
    assert_eq!(fixture.write(&file), message(4, 3, &[]));
    fixture.restart();
    assert_eq!(fixture.gateway.running_firmware(), file);
}

#[test]
fn wrong_package_is_rejected_and_keeps_the_version() {
    let good = package(500);
    let changed = |at: usize| {
        let mut file = good.to_bytes();
        file[at] ^= 0x10;
        file
    };
    let mut long = good.to_bytes();
    long.push(0);
    let cases = [
        (good.payload.clone(), 0x8010),
        (Vec::new(), 0x8010),
        (changed(0), 0x8010),
        (changed(12), 0x8010),
        (changed(30), 0x8010),
        (long, 0x8010),
        (good.to_bytes()[..300].to_vec(), 0x8010),
        (changed(400), 0x800C),
        (FirmwarePackage::new(7, 1, vec![1]).to_bytes(), 0x800D),
    ];
    let mut fixture = Fixture::new(122);
    for (number, (file, code)) in cases.into_iter().enumerate() {
        assert_eq!(fixture.write(&file), error(code, "OTA verify failed"), "{number}");
        let mut out = Vec::new();
        fixture.gateway.sdo_upload(fixture.now, 0xB000, 11, &mut out).unwrap();
        assert_eq!(out, code.to_le_bytes());
        fixture.gateway.sdo_upload(fixture.now, 0xB000, 9, &mut out).unwrap();
        assert_eq!(out, (file.len() as u32).to_le_bytes());
        fixture.now += 1_000 * MS;
        fixture.gateway.advance(fixture.now);
        assert!(fixture.gateway.is_responding(), "no restart");
    }
    assert_eq!(fixture.version().1, "2.2.1");
    assert_eq!(fixture.write(&good.to_bytes())[0], 4, "a good one works after all");
}

#[test]
fn requests_are_rejected_by_name_and_password() {
    let mut fixture = Fixture::new(122);
    for opcode in [1, 2] {
        for name in [&b"ecan_lite"[..], b"", b"ecan_lite_app2", b"ECAN_LITE_APP"] {
            assert_eq!(fixture.open(opcode, 0, name), error(0x8001, "File not found"));
        }
        assert_eq!(fixture.open(opcode, 1, NAME), error(0x800A, "Password invalid"));
        assert_eq!(fixture.data(1, &[1]).0, error(0x8004, "Illegal operation"), "nothing is open");
    }
    assert_eq!(fixture.open(2, 0, b"ecan_lite_app\0\0")[0], 4, "padded");
    assert_eq!(fixture.ask(&[]), error(0x8004, "Illegal operation"));
    assert_eq!(fixture.ask(&message(9, 0, &[])), error(0x8004, "Illegal operation"));
    assert_eq!(fixture.ask(&message(4, 0, &[])), error(0x8004, "Illegal operation"));
}

#[test]
fn repeated_and_skipped_packets_end_the_transfer() {
    for wrong in [0, 1, 3] {
        let mut fixture = Fixture::new(122);
        fixture.open(2, 0, NAME);
        assert_eq!(fixture.data(1, &[0; 116]).0[0], 4);
        assert_eq!(fixture.data(wrong, &[0; 116]).0, error(0x8005, "Packet number wrong"));
        assert_eq!(fixture.data(2, &[0; 116]).0, error(0x8004, "Illegal operation"));
    }
}

#[test]
fn flash_makes_the_master_wait_or_fail() {
    let mut fixture = Fixture::new(1 << 13);
    fixture.open(2, 0, NAME);
    assert_eq!(fixture.data(1, &[0; (1 << 13) - 6]).1, 100, "erasing");
    assert_eq!(fixture.data(2, &[0; (1 << 13) - 6]).1, 2, "one sector written, the rest kept");
    for failing in 0..3 {
        let mut fixture = Fixture::new(4096);
        if failing == 0 {
            fixture.gateway.inject(fixture.now, GatewayFault::FlashFailure { times: 1 });
            assert_eq!(fixture.open(2, 0, NAME), error(0x8011, "file write fail"));
            continue;
        }
        fixture.open(2, 0, NAME);
        let (answer, _) = fixture.data(1, &[0; 4090]);
        assert_eq!(answer[0], 4);
        fixture.gateway.inject(fixture.now, GatewayFault::FlashFailure { times: 1 });
        let length = if failing == 1 { 4090 } else { 3 };
        assert_eq!(fixture.data(2, &vec![0; length]).0, error(0x8011, "file write fail"));
    }
}

#[test]
fn bootstrap_takes_firmware_too() {
    let mut fixture = Fixture::new(122);
    fixture.gateway.request_al_state(fixture.now, AlState::Init);
    fixture.gateway.request_al_state(fixture.now, AlState::Boot);
    assert_eq!(fixture.gateway.al_state(), AlState::Boot);
    assert_eq!(fixture.write(&package(100).to_bytes())[0], 4);
    fixture.restart();
    assert_eq!(fixture.version().1, "3.5.14");
}

#[test]
fn file_larger_than_the_partition_is_rejected() {
    let mut fixture = Fixture::new(60_000);
    assert_eq!(fixture.write(&vec![0; 512 * 1024 + 1]), error(0x8003, "file write fail"));
}

#[test]
fn interrupted_updates_leave_the_running_version() {
    let file = package(3_000).to_bytes();
    let begin = |fixture: &mut Fixture| {
        fixture.open(2, 0, NAME);
        assert_eq!(fixture.data(1, &file[..116]).0[0], 4);
    };
    // power loss
    let mut fixture = Fixture::new(122);
    begin(&mut fixture);
    fixture.gateway.power(fixture.now, false);
    fixture.server = FoeServer::default();
    fixture.gateway.power(fixture.now, true);
    fixture.now += 300 * MS;
    fixture.gateway.set_up_mailboxes();
    fixture.gateway.request_al_state(fixture.now, AlState::PreOp);
    assert_eq!(fixture.version().1, "2.2.1");
    // the master aborts, starts again, or leaves the mailbox states
    begin(&mut fixture);
    assert_eq!(fixture.ask(&message(5, 0x8000, b"stop")), []);
    assert_eq!(fixture.data(2, &[]).0, error(0x8004, "Illegal operation"));
    begin(&mut fixture);
    fixture.gateway.request_al_state(fixture.now, AlState::Init);
    fixture.gateway.set_up_mailboxes();
    fixture.gateway.request_al_state(fixture.now, AlState::PreOp);
    assert_eq!(fixture.data(2, &[]).0, error(0x8004, "Illegal operation"));
    begin(&mut fixture);
    assert_eq!(fixture.write(&file), message(4, 27, &[]));
    // no further message until the restart
    assert_eq!(fixture.open(2, 0, NAME), error(0x8002, "Access denied"));
    // power loss before the restart: the verified version runs
    fixture.gateway.power(fixture.now, false);
    fixture.gateway.power(fixture.now, true);
    fixture.now += 300 * MS;
    fixture.gateway.set_up_mailboxes();
    fixture.gateway.request_al_state(fixture.now, AlState::PreOp);
    assert_eq!(fixture.version().1, "3.5.14");
    fixture.now += 1_000 * MS;
    fixture.gateway.advance(fixture.now);
    assert!(fixture.gateway.is_responding(), "restarted once");
}

#[test]
fn running_package_is_read_back() {
    for room in [7, 38, 70, 122, 1000] {
        let mut fixture = Fixture::new(room);
        let mut file = Vec::new();
        let mut answer = fixture.open(1, 0, NAME);
        for number in 1.. {
            assert_eq!(answer[..6], message(3, number, &[]));
            let again = fixture.ask(&message(6, 0, &[]));
            assert_eq!(again, answer, "a busy master gets the packet again");
            file.extend(&answer[6..]);
            let is_last = answer.len() < room;
            answer = fixture.ask(&message(4, number, &[]));
            if is_last {
                break;
            }
        }
        assert_eq!(answer, []);
        assert_eq!(file, fixture.gateway.running_firmware());
        assert_eq!(FirmwarePackage::parse(&file).unwrap().version, 0x0202_0001);
    }
    let mut fixture = Fixture::new(38);
    fixture.open(1, 0, NAME);
    assert_eq!(fixture.ask(&message(4, 2, &[])), error(0x8005, "Packet number wrong"));
}

#[test]
fn responses_fit_the_mailbox() {
    for room in 0..40 {
        let mut fixture = Fixture::new(room);
        assert!(fixture.open(1, 1, NAME).len() <= room);
        assert!(fixture.open(1, 0, NAME).len() <= room);
    }
}

fn any_message() -> impl Strategy<Value = Vec<u8>> {
    let data = prop_oneof![
        Just(NAME.to_vec()),
        Just(package(40).to_bytes()),
        proptest::collection::vec(any::<u8>(), 0..140),
    ];
    let field = prop_oneof![0u32..4, any::<u32>()];
    prop_oneof![
        4 => (0u8..8, field, data).prop_map(|(opcode, field, data)| message(opcode, field, &data)),
        1 => proptest::collection::vec(any::<u8>(), 0..160),
    ]
}

proptest! {
    #[test]
    fn any_sequence_is_answered_within_the_room(
        room in 0usize..200,
        messages in proptest::collection::vec((any_message(), 0u64..200), 0..40),
    ) {
        let mut fixture = Fixture::new(room);
        for (message, pause) in messages {
            fixture.now += pause * MS;
            let answer = fixture.ask(&message);
            prop_assert!(answer.len() <= room);
            prop_assert!(answer.is_empty() || (3..=6).contains(&answer[0]));
        }
    }
}
