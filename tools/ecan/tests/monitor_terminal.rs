//! `ecan monitor` on a terminal that does what terminals do.
#![allow(missing_docs)]

#[path = "support/terminal.rs"]
mod terminal;

use terminal::OnTerminal;

const MONITOR: [&str; 3] = ["--ecrt", "sim", "monitor"];

#[test]
fn it_ends_with_its_terminal() {
    // Whether the signal comes depends on how it was started.
    for start in [OnTerminal::start, OnTerminal::start_leader] {
        let mut monitor = start((100, 40), &MONITOR);
        monitor.wait_for("in service 3/3");
        monitor.close();
        let (status, errors) = monitor.end();
        assert_eq!(status.code(), Some(0), "{errors}");
        assert!(errors.starts_with("SIMULATED") && errors.lines().count() == 1, "{errors}");
    }
}
