//! The shared library loaded by the SDK's own binding, like IgH's.

use std::thread;

use ecan_host::{Master, OpenError, OpenFailure};
use ecrt_sys::{Ecrt, Origin};

use crate::toolchain::{SONAME, simulated_library};

#[test]
fn binding_finds_every_function_and_all_threads_the_same_world() {
    if !crate::toolchain::is_there() {
        return;
    }
    let library = simulated_library();
    let ecrt = Ecrt::load(Some(&library.path().join(SONAME))).expect("it is a libethercat");
    assert_eq!(ecrt.version(), (1, 6));
    assert_eq!(ecrt.origin(), &Origin::Simulated { scenario: "echo".to_owned() });
    assert!(ecrt.clock().is_free_running(), "the scenario leaves the clock real");

    let ready = std::sync::Barrier::new(4);
    let masters: Vec<_> = thread::scope(|scope| {
        let threads: Vec<_> = (0..4)
            .map(|_| {
                scope.spawn(|| {
                    ready.wait();
                    Master::request(&ecrt, 0)
                })
            })
            .collect();
        threads.into_iter().map(|thread| thread.join().expect("no thread panics")).collect()
    });
    let errors: Vec<&OpenError> =
        masters.iter().filter_map(|master| master.as_ref().err()).collect();
    assert_eq!(errors.len(), 3, "one thread has the master");
    for error in errors {
        assert_eq!(error.failure, OpenFailure::Busy, "{error}");
    }
    let looking = Master::open(&ecrt, 0).expect("anyone may look");
    assert_eq!(looking.info().expect("information").slave_count, 1);
    assert!(Master::open(&ecrt, 3).is_err(), "there is one master");
}
