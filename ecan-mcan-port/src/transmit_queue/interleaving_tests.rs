//! Every order in which a thread gives frames and the cycle takes them, by loom.

use loom::thread;

use super::*;

fn queues(accepted: [u8; 4]) -> (CycleQueues, TransmitQueues) {
    let (writer, reader) = ring(2 * (1 + FRAME_WORDS));
    let gateway = SharedGateway {
        accepted: AtomicU32::new(u32::from_le_bytes(accepted)),
        ..SharedGateway::default()
    };
    let shared = Arc::new(Shared { pushed: AtomicU64::new(0), gateways: [gateway].into() });
    let of_cycle = CycleQueues {
        shared: shared.clone(),
        readers: vec![reader],
        removed: 0,
        sent: vec![[0; CHANNELS]],
        has_sent: false,
    };
    (of_cycle, TransmitQueues { shared, writers: vec![writer] })
}

/// Data of the frames that wait.
fn take(queues: &mut CycleQueues) -> Vec<u8> {
    let mut all = Vec::new();
    let mut record = [0; FRAME_WORDS];
    while queues.readers[0].peek(&mut record) > 0 {
        all.push(record[2] as u8);
        queues.readers[0].remove();
        queues.removed += 1;
    }
    all
}

#[test]
fn cycle_takes_each_frame_once() {
    loom::model(|| {
        let (mut cycle, mut given) = queues([1, 1, 0, 0]);
        let giver = thread::spawn(move || {
            for number in 1..=2 {
                given
                    .push(
                        0,
                        0,
                        &CanFrame::classic(CanId::new(1, false).unwrap(), &[number]).unwrap(),
                    )
                    .unwrap();
            }
            given
        });
        let mut taken = Vec::new();
        for _ in 0..2 {
            if cycle.begin() {
                let frames = take(&mut cycle);
                // A frame may be taken before it is announced.
                assert!(!frames.is_empty() || taken.len() == 2);
                taken.extend(frames);
            }
        }
        let _given = giver.join().unwrap();
        assert_eq!(cycle.begin(), taken.len() < 2);
        taken.extend(take(&mut cycle));
        assert_eq!(taken, [1, 2]);
        assert!(!cycle.begin());
    });
}
