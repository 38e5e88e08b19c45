//! No allocation for the frames of a cycle.

use crate::wire_support::{Datagram, Line, MS, command::*};
use ecan_test_support::allocations;

#[test]
fn frames_of_a_cycle_allocate_nothing() {
    let mut line = Line::op();
    let frame = crate::wire_support::encode(&[
        Datagram::new(FRMW, 0x1001, 0x0910, &[0; 4]),
        Datagram::logical(LRW, 0, &[0; 768]),
        Datagram::new(BRD, 0, 0x0130, &[0; 2]),
    ]);
    let mut inside = 0;
    let mut bytes = frame.clone();
    for cycle in 0..300 {
        line.pass(MS);
        bytes.copy_from_slice(&frame);
        let before = allocations();
        assert!(line.wire.pass(line.now, &mut bytes));
        if cycle >= 100 {
            inside += allocations() - before;
        }
    }
    assert_eq!(inside, 0);
}
