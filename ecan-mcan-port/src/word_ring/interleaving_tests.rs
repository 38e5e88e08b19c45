//! Every order in which the two ends access the ring, by loom.

use loom::thread;

use super::{RingReader, ring};

/// Explores all orders in which a thread is interrupted at most twice.
fn explore(model: impl Fn() + Sync + Send + 'static) {
    let mut builder = loom::model::Builder::new();
    builder.preemption_bound = Some(2);
    builder.check(model);
}

fn take(reader: &mut RingReader) -> Option<Vec<u64>> {
    let mut record = [0; 4];
    let words = reader.peek(&mut record);
    reader.remove();
    (words > 0).then(|| record[..words].to_vec())
}

/// Records until the writer is gone and the ring is empty.
fn take_all(reader: &mut RingReader) -> Vec<Vec<u64>> {
    let mut records = Vec::new();
    loop {
        let is_closed = reader.is_closed();
        match take(reader) {
            Some(record) => records.push(record),
            None if is_closed => return records,
            None => thread::yield_now(),
        }
    }
}

#[test]
fn written_records_arrive_whole_and_in_order() {
    explore(|| {
        let (mut writer, mut reader) = ring(4);
        let sender = thread::spawn(move || {
            let records = [vec![1, 2], vec![3], vec![4, 5]].into_iter();
            records.filter(|record| writer.write(record, &[])).collect::<Vec<_>>()
        });
        let received = take_all(&mut reader);
        assert_eq!(received, sender.join().unwrap());
        assert!(!received.is_empty());
    });
}

#[test]
fn removed_records_give_room() {
    explore(|| {
        let (mut writer, mut reader) = ring(2);
        let sender = thread::spawn(move || {
            for number in 1..=3 {
                while !writer.write(&[number], &[]) {
                    thread::yield_now();
                }
            }
        });
        assert_eq!(take_all(&mut reader), [[1], [2], [3]]);
        sender.join().unwrap();
    });
}

#[test]
fn cleared_ring_has_later_records_only() {
    explore(|| {
        let (mut writer, mut reader) = ring(8);
        assert!(writer.write(&[1], &[]));
        let sender =
            thread::spawn(move || assert!(writer.write(&[2], &[]) && writer.write(&[3], &[])));
        reader.clear();
        let received = take_all(&mut reader);
        assert!(
            [&[[2], [3]][..], &[[3]], &[]]
                .contains(&received.iter().map(|r| [r[0]]).collect::<Vec<_>>().as_slice())
        );
        sender.join().unwrap();
    });
}

#[test]
fn writer_sees_that_the_reader_is_gone() {
    explore(|| {
        let (mut writer, reader) = ring(2);
        let other = thread::spawn(move || drop(reader));
        assert!(writer.write(&[1], &[]));
        other.join().unwrap();
        assert!(writer.is_closed() && !writer.is_wanted());
    });
}
