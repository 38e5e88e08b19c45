//! The simulated library allocates nothing in the steady state, so that a counting allocator
//! around an application's cycle counts the application.

use crate::ecrt_support::{Program, frame, stepped_echo};
use ecan_test_support::allocations;

#[test]
fn cycles_with_traffic_allocate_nothing() {
    let mut program = Program::new(stepped_echo(2), &[3, 8]);
    let config = program.slaves[0].config;
    let request = program.master.create_sdo_request(config, 0x1018, 1, 4).unwrap();
    let mut program = program.into_op();
    program.received.reserve(10_000);
    let frames = [0, 1, 2, 3, 4, 5, 6, 7].map(|number| {
        (usize::from(number / 4), (number % 4) as u8, frame(0x100 + number, &[0x55; 8]))
    });
    let run = |program: &mut Program, cycles: usize| {
        for cycle in 0..cycles {
            if cycle % 4 == 0 {
                program.cycle_with(&frames);
            } else {
                program.cycle();
            }
            if cycle % 16 == 0 {
                program.master.requests().sdo_read(request).unwrap();
            }
            program.master.requests().sdo_state(request).unwrap();
            program.master.state().unwrap();
            program.state(1);
        }
    };
    // buffers grow to their final size
    run(&mut program, 1_000);
    let before = allocations();
    run(&mut program, 2_000);
    assert_eq!(allocations() - before, 0);
    assert!(program.received.len() > 1_000);
}
