//! Process data and mailboxes on the wire: FMMUs, single buffers and their handshake, watchdog.

use crate::wire_support::{Datagram, Line, MS, command::*};
use ecan_sim::{Fault, GatewayFault};

const BYTES: usize = 384;

/// An RxPDO image without frames, N = 3, mask 0x0F.
fn image(line: &mut Line, sequence: u16) -> Vec<u8> {
    let profile = line.upload(0x1001, (0x8011, 12));
    let layout_id = (profile ^ profile >> 16) as u16;
    let mut image = vec![0; BYTES];
    for (at, word) in [(0, 0x0016), (2, sequence), (4, sequence), (8, 0xFFFF), (10, layout_id)] {
        image[at..at + 2].copy_from_slice(&word.to_le_bytes());
    }
    image[12] = 0x0F;
    image[15] = 1;
    image
}

#[test]
fn exchange_counts_read_and_write() {
    let mut line = Line::op();
    let outputs = image(&mut line, 1);
    line.pass(MS);
    let both = [outputs.clone(), vec![0; BYTES]].concat();
    let back = line.logical(LRW, 0, &both);
    assert_eq!(back.counter, 3);
    assert_eq!(back.data[..BYTES], outputs, "what is written stays in the frame");
    assert_eq!(back.data[BYTES], 0x16);
    // the firmware has not run yet
    assert_eq!(line.logical(LRW, 0, &both).counter, 0, "SM2 is full, SM3 empty");
    line.pass(MS);
    assert_eq!(line.logical(LWR, 0, &outputs).counter, 1);
    line.pass(MS);
    let back = line.logical(LRD, 0, &vec![0xEE; 2 * BYTES]);
    assert_eq!((back.counter, back.data[0], back.data[BYTES]), (1, 0xEE, 0x16));
    let back = line.logical(LRD, 0, &vec![0xEE; 2 * BYTES]);
    assert_eq!((back.counter, back.data[BYTES]), (0, 0xEE), "an empty buffer leaves the data");
    assert_eq!(line.logical(LRW, 0x10_0000, &both).counter, 0, "no slave maps it");
}

#[test]
fn image_written_in_parts_is_accepted() {
    let mut line = Line::op();
    let outputs = image(&mut line, 1);
    line.pass(MS);
    let before = line.wire.world().counters(0).unwrap();
    assert_eq!(line.logical(LWR, 100, &outputs[100..]).counter, 0, "not begun");
    assert_eq!(line.logical(LWR, 0, &outputs[..100]).counter, 1);
    assert_eq!(line.logical(LWR, 100, &outputs[100..200]).counter, 1);
    let counters = line.wire.world().counters(0).unwrap();
    assert_eq!(counters.images_written, before.images_written, "not complete");
    assert_eq!(line.logical(LWR, 200, &outputs[200..]).counter, 1);
    line.pass(MS);
    let counters = line.wire.world().counters(0).unwrap();
    assert_eq!(counters.images_written - before.images_written, 1);
    assert_eq!(counters.images_parsed - before.images_parsed, 1);
    let start = BYTES as u32;
    let first = line.logical(LRD, start, &[0; 100]);
    assert_eq!((first.counter, first.data[0]), (1, 0x16));
    assert_eq!(line.logical(LRD, start + 100, &[0; BYTES - 100]).counter, 1);
    assert_eq!(line.logical(LRD, start, &[0; 100]).counter, 0, "read to its end");
}

/// Mailbox status as a bit of the process data.
#[test]
fn bit_of_a_register_is_mapped() {
    let mut line = Line::preop(1);
    let mut fmmu = 0x8000_u32.to_le_bytes().to_vec();
    fmmu.extend([1, 0, 5, 5, 0x0D, 0x08, 3, 1, 1, 0, 0, 0]);
    assert_eq!(line.write(FPWR, 0x1001, 0x0620, &fmmu), 1);
    let back = line.logical(LRD, 0x8000, &[0b1010_1010]);
    assert_eq!((back.counter, back.data[0]), (1, 0b1000_1010), "empty");
    let upload = [10, 0, 0, 0, 0, 0x03, 0x00, 0x20, 0x40, 0x00, 0xF0, 2, 0, 0, 0, 0];
    let mut mailbox = vec![0; 128];
    mailbox[..16].copy_from_slice(&upload);
    assert_eq!(line.write(FPWR, 0x1001, 0x1000, &mailbox), 1);
    line.pass(MS);
    assert_eq!(line.logical(LRD, 0x8000, &[0b1000_1010]).data[0], 0b1010_1010, "full");
    let (answer, _) = line.read(FPRD, 0x1001, 0x1080, 128);
    assert_eq!(answer[6..13], [0x00, 0x30, 0x4F, 0x00, 0xF0, 2, 4], "four channels");
    assert_eq!(line.logical(LRD, 0x8000, &[0]).data[0], 0);
}

#[test]
fn silent_firmware_leaves_its_mailbox_full() {
    let mut line = Line::preop(1);
    let silence = GatewayFault::MailboxSilent { ms: 50 };
    line.wire.world_mut().inject(Fault::Gateway { gateway: 0, fault: silence });
    let mut mailbox = vec![0; 128];
    mailbox[..12].copy_from_slice(&[10, 0, 0, 0, 0, 0x03, 0x00, 0x20, 0x40, 0x00, 0xF0, 2]);
    assert_eq!(line.write(FPWR, 0x1001, 0x1000, &mailbox), 1);
    assert_eq!(line.write(FPWR, 0x1001, 0x1000, &mailbox), 0, "full");
    assert_eq!(line.read(FPRD, 0x1001, 0x0805, 1).0[0] & 0x08, 0x08);
    line.pass(60 * MS);
    line.read(FPRD, 0x1001, 0x0805, 1);
    line.pass(MS);
    let (answer, counter) = line.read(FPRD, 0x1001, 0x1080, 128);
    assert_eq!((counter, answer[12]), (1, 4));
}

#[test]
fn watchdog_forces_safeop_and_is_counted() {
    let mut line = Line::op();
    assert_eq!(line.write(FPWR, 0x1001, 0x0420, &500_u16.to_le_bytes()), 1);
    let outputs = image(&mut line, 1);
    line.logical(LWR, 0, &outputs);
    line.pass(49 * MS);
    assert_eq!(line.state(0x1001), (8, 0));
    line.pass(2 * MS);
    assert_eq!(line.state(0x1001), (0x14, 0x1B));
    assert_eq!(line.read(FPRD, 0x1001, 0x0440, 3).0, [0, 0, 1]);
    assert_eq!(line.write(FPWR, 0x1001, 0x0442, &[0]), 1);
    assert_eq!(line.read(FPRD, 0x1001, 0x0442, 1).0, [0]);
    line.request(0x1001, 0x18);
    assert_eq!(line.state(0x1001), (8, 0));
}

#[test]
fn op_with_sync0_waits_for_its_pulse() {
    let mut line = Line::op();
    line.request(0x1001, 4);
    let now = line.read_u64(0x1001, 0x0910);
    line.start_sync0(now + 10_000 * MS, 1_000_000);
    line.request(0x1001, 8);
    assert_eq!(line.state(0x1001), (4, 0), "it waits");
    line.pass(2_100 * MS);
    assert_eq!(line.state(0x1001), (0x14, 0x2D), "no Sync0");
    let now = line.read_u64(0x1001, 0x0910);
    line.start_sync0(now + 5 * MS, 1_000_000);
    line.request(0x1001, 0x18);
    line.pass(10 * MS);
    assert_eq!(line.state(0x1001), (8, 0));
    assert!(line.upload(0x1001, (0x9011, 2)) > 3, "pulses");
    line.write(FPWR, 0x1001, 0x0980, &[0, 0]);
    assert_eq!(line.state(0x1001), (0x14, 0x2C), "Sync0 switched off in OP");
}

/// The master writes its assignment again after its startup list.
#[test]
fn assignment_can_be_repeated_after_the_startup_list() {
    let mut line = Line::preop(1);
    line.configure(0x1001, 3);
    line.assign(0x1001, 3);
    line.map(0x1001, 3, 0x2000);
    line.request(0x1001, 4);
    line.request(0x1001, 8);
    assert_eq!(line.state(0x1001), (8, 0));
    line.pass(2 * MS);
    assert_eq!(line.logical(LRD, 0x2000 + BYTES as u32, &[0; BYTES]).counter, 1);
}

#[test]
fn process_data_events_are_reported() {
    let mut line = Line::op();
    line.write(FPWR, 0x1001, 0x0200, &[0xC0, 0x00]);
    line.pass(MS);
    let events = |line: &mut Line| line.one(Datagram::new(FPRD, 0x1001, 0, &[0])).events;
    assert_eq!(events(&mut line) & 0x80, 0x80, "SM3 is full");
    line.logical(LRD, BYTES as u32, &[0; BYTES]);
    assert_eq!(events(&mut line) & 0x80, 0);
    let outputs = image(&mut line, 1);
    line.logical(LWR, 0, &outputs);
    assert_eq!(events(&mut line) & 0x40, 0);
    line.pass(MS);
    assert_eq!(events(&mut line) & 0x40, 0x40, "SM2 was read");
}

/// Images of N = 24 take five frames; the firmware serves while the master still reads.
#[test]
fn images_on_several_frames_are_read_in_every_cycle() {
    for gap_ns in [0, 10_000, 110_000] {
        let mut line = Line::preop(1);
        line.configure(0x1001, 24);
        line.map(0x1001, 24, 0);
        line.request(0x1001, 4);
        line.request(0x1001, 8);
        let cycle = |line: &mut Line| {
            line.pass(MS - 5 * (10_000 + gap_ns));
            (0..6144_u32).step_by(1486).fold(0, |sum, at| {
                line.pass(gap_ns);
                let bytes = 1486.min(6144 - at as usize);
                sum + line.logical(LRW, at, &vec![0; bytes]).counter
            })
        };
        cycle(&mut line);
        for _ in 0..100 {
            assert_eq!(cycle(&mut line), 9, "frames {gap_ns} ns apart");
        }
    }
}

#[test]
fn partial_access_ends_when_process_data_stops() {
    let mut line = Line::op();
    let outputs = image(&mut line, 1);
    assert_eq!(line.logical(LWR, 0, &outputs[..10]).counter, 1);
    line.request(0x1001, 2);
    line.request(0x1001, 4);
    assert_eq!(line.logical(LWR, 10, &outputs[10..]).counter, 0);
}

#[test]
fn watchdog_status_stays_until_outputs_come() {
    let mut line = Line::op();
    let outputs = image(&mut line, 1);
    line.pass(500 * MS);
    assert_eq!(line.read(FPRD, 0x1001, 0x0440, 1).0, [0]);
    line.request(0x1001, 0x14);
    assert_eq!(line.state(0x1001), (4, 0));
    assert_eq!(line.read(FPRD, 0x1001, 0x0440, 1).0, [0], "nothing was written");
    assert_eq!(line.logical(LWR, 0, &outputs).counter, 1);
    assert_eq!(line.read(FPRD, 0x1001, 0x0440, 1).0, [1]);
}

/// All frames of a cycle have the same faults.
#[test]
fn faults_count_cycles_and_not_frames() {
    use ecan_sim::LossDirection;
    let mut line = Line::op();
    let frame = |line: &mut Line, at: u32| {
        line.exchange(&[Datagram::logical(LRD, at, &[0; 384])]).is_some()
    };
    frame(&mut line, 0);
    frame(&mut line, 384);
    let before = line.wire.world().cycles();
    line.wire.world_mut().inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 2 });
    let came = [0, 384, 0, 384, 0, 384].map(|at| frame(&mut line, at));
    assert_eq!(came, [false, false, false, false, true, true]);
    assert_eq!(line.wire.world().cycles() - before, 3);
}
