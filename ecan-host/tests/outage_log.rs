//! What is logged. A program of its own: threads of other tests would register the same events without a subscriber.
#![allow(missing_docs)]

mod common;

use std::sync::{Arc, Mutex};
use std::time::Duration;

use common::{raw_config, run, simulated};
use ecan_host::{Adapter, StartupPlan};
use ecan_sim::Fault;
use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id, Record};
use tracing::{Event, Metadata, Subscriber};

/// Messages of events of this thread.
#[derive(Clone, Default)]
struct Messages(Arc<Mutex<Vec<String>>>);

struct Message(String);

impl Visit for Message {
    fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
        if field.name() == "message" {
            self.0 = format!("{value:?}");
        }
    }
}

impl Subscriber for Messages {
    fn enabled(&self, _: &Metadata<'_>) -> bool {
        true
    }

    fn new_span(&self, _: &Attributes<'_>) -> Id {
        Id::from_u64(1)
    }

    fn record(&self, _: &Id, _: &Record<'_>) {}

    fn record_follows_from(&self, _: &Id, _: &Id) {}

    fn event(&self, event: &Event<'_>) {
        let mut message = Message(String::new());
        event.record(&mut message);
        self.0.lock().unwrap().push(message.0);
    }

    fn enter(&self, _: &Id) {}

    fn exit(&self, _: &Id) {}
}

#[test]
fn outage_of_a_slave_is_logged_once_with_its_cycles() {
    let messages = Messages::default();
    let about_data = || {
        let all = messages.0.lock().unwrap();
        all.iter().filter(|text| text.contains("process data")).cloned().collect::<Vec<_>>()
    };
    tracing::subscriber::with_default(messages.clone(), || {
        let (ecrt, simulation) = simulated(ecan_sim::echo(1));
        let config = raw_config().0;
        let mut adapter = Adapter::open(&ecrt, config, StartupPlan::default()).unwrap();
        adapter.wait_op(Duration::from_secs(20)).unwrap();
        assert_eq!(about_data(), [""; 0], "a slave that was never there has no outage");
        run(&mut adapter, 5);
        simulation.inject(Fault::WorkingCounterOffset { offset: -3, cycles: 7 });
        run(&mut adapter, 20);
        let lost = "slave 0: no process data (working counter 0)";
        let resumed = "slave 0: process data resumed (7 cycles lost)";
        assert_eq!(about_data(), [lost, resumed]);
        adapter.leave_op();
        assert_eq!(about_data().len(), 2, "a slave that leaves OP has no outage");
    });
}
