//! The mailboxes of the slave controllers: lost responses, contents voided by a stop, BOOT.

use crate::wire_support::{Line, MS, command::*};
use ecan_sim::{Fault, GatewayFault};

/// The first fragment of the list of all objects; seven more follow.
const LIST: [u8; 8] = [0x00, 0x80, 0x01, 0x00, 0x00, 0x00, 0x01, 0x00];
const UPLOAD: [u8; 10] = [0x00, 0x20, 0x40, 0x00, 0xF0, 2, 0, 0, 0, 0];

fn write(line: &mut Line, protocol: u8, message: &[u8]) {
    let mut mailbox = vec![0; 128];
    mailbox[..2].copy_from_slice(&(message.len() as u16).to_le_bytes());
    mailbox[5] = protocol;
    mailbox[6..6 + message.len()].copy_from_slice(message);
    assert_eq!(line.write(FPWR, 0x1001, 0x1000, &mailbox), 1);
    line.pass(MS);
}

/// The message in the read mailbox.
fn read(line: &mut Line) -> Option<Vec<u8>> {
    let (message, counter) = line.read(FPRD, 0x1001, 0x1080, 128);
    (counter == 1).then_some(message)
}

fn is_full(line: &mut Line) -> bool {
    line.read(FPRD, 0x1001, 0x080D, 1).0[0] & 0x08 != 0
}

#[test]
fn lost_fragment_is_repeated_in_order() {
    let mut line = Line::preop(1);
    write(&mut line, 3, &LIST);
    let first = read(&mut line).unwrap();
    let mut toggle = 1;
    let mut messages = vec![first];
    for lost in 0..3 {
        toggle ^= 2;
        assert_eq!(line.write(FPWR, 0x1001, 0x080E, &[toggle]), 1);
        assert_eq!(line.read(FPRD, 0x1001, 0x080F, 1).0[0], toggle & 2, "acknowledged");
        assert_eq!(read(&mut line), messages.last().cloned(), "fragment {lost} again");
        line.pass(MS);
        messages.push(read(&mut line).unwrap());
    }
    let left = messages.iter().map(|message| message[10]).collect::<Vec<_>>();
    let counters = messages.iter().map(|message| message[5] >> 4).collect::<Vec<_>>();
    assert_eq!(left, [left[0], left[0] - 1, left[0] - 2, left[0] - 3]);
    assert_eq!(counters, [1, 2, 3, 4]);
}

#[test]
fn request_stays_in_sm0_while_the_queue_is_full() {
    let mut line = Line::preop(1);
    // one response in SM1, eight in the queue, one request in SM0
    for _ in 0..10 {
        write(&mut line, 3, &UPLOAD);
    }
    assert_eq!(line.write(FPWR, 0x1001, 0x1000, &[0; 128]), 0, "SM0 is full");
    for response in 0..10 {
        let message = read(&mut line).unwrap();
        assert_eq!(message[5] & 0x0F, 3, "response {response} is CoE, no mailbox error");
        line.pass(MS);
    }
    assert_eq!(read(&mut line), None);
    write(&mut line, 3, &UPLOAD);
    assert!(read(&mut line).is_some());
}

#[test]
fn repeat_with_nothing_read_gives_nothing() {
    let mut line = Line::preop(1);
    assert_eq!(line.write(FPWR, 0x1001, 0x080E, &[3]), 1);
    assert!(!is_full(&mut line));
    // disabled and enabled with the same repeat bit, nothing old appears
    write(&mut line, 3, &UPLOAD);
    read(&mut line).unwrap();
    line.write(FPWR, 0x1001, 0x080E, &[0]);
    line.write(FPWR, 0x1001, 0x080E, &[3]);
    assert!(!is_full(&mut line));
}

#[test]
fn init_discards_mailbox_contents() {
    let mut line = Line::preop(1);
    write(&mut line, 3, &UPLOAD);
    assert!(is_full(&mut line));
    line.request(0x1001, 1);
    line.request(0x1001, 2);
    assert!(!is_full(&mut line), "the answer");
    let silence = GatewayFault::MailboxSilent { ms: 5 };
    line.wire.world_mut().inject(Fault::Gateway { gateway: 0, fault: silence });
    write(&mut line, 3, &UPLOAD);
    line.request(0x1001, 1);
    line.request(0x1001, 2);
    line.pass(10 * MS);
    assert!(!is_full(&mut line), "the request");
    // both in one frame
    write(&mut line, 3, &UPLOAD);
    let request = |state| crate::wire_support::Datagram::new(FPWR, 0x1001, 0x0120, &[state, 0]);
    line.exchange(&[request(1), request(2)]).unwrap();
    line.pass(MS);
    assert!(!is_full(&mut line));
    assert_eq!(line.upload(0x1001, (0xF000, 2)), 4, "and it works on");
}

#[test]
fn boot_state_serves_only_firmware() {
    let mut line = Line::addressed(1);
    line.request(0x1001, 3);
    assert_eq!(line.state(0x1001), (0x11, 0x15), "no mailboxes for BOOT");
    line.set_up_mailboxes(0x1001);
    line.request(0x1001, 0x13);
    assert_eq!(line.state(0x1001), (3, 0));
    write(&mut line, 3, &UPLOAD);
    let answer = read(&mut line).unwrap();
    assert_eq!((answer[5] & 0x0F, &answer[6..10]), (0, &[1, 0, 2, 0][..]), "unsupported protocol");
    write(&mut line, 4, &[1, 0, 0, 0, 0, 0, b'x']);
    assert_eq!(read(&mut line).unwrap()[5] & 0x0F, 4, "FoE");
}

#[test]
fn unusable_mailboxes_are_rejected() {
    let good = [0x00, 0x10, 0x80, 0, 0x26, 0, 1, 0, 0x80, 0x10, 0x80, 0, 0x22, 0, 1, 0];
    let changed = |at: usize, value: u8| {
        let mut registers = good;
        registers[at] = value;
        registers
    };
    let cases = [
        (changed(2, 8), "too short"),
        (changed(8, 0x40), "one in the other"),
        (changed(1, 0x0F), "registers"),
        (changed(4, 0x22), "two to read"),
        (changed(12, 0x20), "three buffers"),
    ];
    for (registers, what) in cases {
        let mut line = Line::addressed(1);
        line.write(FPWR, 0x1001, 0x0800, &registers);
        line.request(0x1001, 2);
        assert_eq!(line.state(0x1001), (0x11, 0x16), "{what}");
        line.request(0x1001, 1);
        assert_eq!(line.state(0x1001), (1, 0), "INIT needs no acknowledge");
    }
}
