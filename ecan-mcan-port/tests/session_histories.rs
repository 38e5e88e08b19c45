//! All short histories of a session: every sequence of a few events, one per cycle, while each cycle sends a frame. The
//! simulated bus is the judge: it has each frame once, in order, or the Port reports it as not delivered.
//!
//! ```text
//! HISTORY_STEPS=5 cargo test --release -p ecan-mcan-port --test port session_histories -- --nocapture
//! ```

use std::collections::HashSet;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::time::Duration;

use crate::common::{Fixture, Handles, SendData, classic, id};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelStatistics, GatewayConfig, PortConfig, Received};
use ecan_protocol::image::OptionFlags;
use ecan_sim::{Fault, GatewayFault, LossDirection};

/// Histories that share a machine; the first ones of each machine cross the wraps of both sequences.
const PER_MACHINE: u64 = 256;
/// Images from the begin of a machine's histories to the wrap of the host's sequence.
const BEFORE_WRAP: u16 = 300;

#[derive(Debug, Clone, Copy)]
enum Step {
    Undisturbed,
    ImageLostOutward,
    ImageLostOnReturn,
    WorkingCounterTooLow,
    TornImage,
    CycleLeftOut,
    ServiceStall,
    SafeOp,
    LinkLoss,
    Restart,
}

const STEPS: [Step; 10] = [
    Step::Undisturbed,
    Step::ImageLostOutward,
    Step::ImageLostOnReturn,
    Step::WorkingCounterTooLow,
    Step::TornImage,
    Step::CycleLeftOut,
    Step::ServiceStall,
    Step::SafeOp,
    Step::LinkLoss,
    Step::Restart,
];

impl Step {
    fn fault(self) -> Option<Fault> {
        let lost = |direction| Some(Fault::LostFrame { direction, cycles: 1 });
        let gateway = |fault| Some(Fault::Gateway { gateway: 0, fault });
        match self {
            Self::Undisturbed | Self::CycleLeftOut => None,
            Self::ImageLostOutward => lost(LossDirection::Outward),
            Self::ImageLostOnReturn => lost(LossDirection::Return),
            Self::WorkingCounterTooLow => {
                Some(Fault::WorkingCounterOffset { offset: -1, cycles: 1 })
            }
            Self::TornImage => gateway(GatewayFault::TornTxPdo { images: 1 }),
            Self::ServiceStall => gateway(GatewayFault::ServiceStall { ms: 2 }),
            Self::SafeOp => gateway(GatewayFault::AlError { code: 0x001A }),
            Self::LinkLoss => Some(Fault::LinkLoss { gateway: 0, for_ms: 2 }),
            Self::Restart => Some(Fault::PowerCycle { gateway: 0, off_ms: 1 }),
        }
    }
}

struct Machine {
    fixture: Fixture,
    next: u32,
    /// Numbers of the frames that the Port accepted, and that were on the bus.
    accepted: Vec<u32>,
    on_bus: Vec<u32>,
    echoes: Vec<u32>,
    states: HashSet<u64>,
}

impl Machine {
    fn new() -> Self {
        let mut gateway = GatewayConfig::on_channel(0, classic());
        gateway.tx_options = OptionFlags::TX_RESULT;
        let adapter = AdapterConfig::new(1).with_multiplier(1).with_cycle(Duration::from_millis(1));
        let mut fixture =
            Fixture::ready(ecan_sim::echo(1), adapter, PortConfig::uniform(1, gateway));
        let image = fixture.port.adapter().rx_pdo(0);
        let sequence = u16::from_le_bytes([image[2], image[3]]);
        fixture.idle(0_u16.wrapping_sub(sequence).wrapping_sub(BEFORE_WRAP).into());
        fixture.simulation.with_world(|world| assert!(world.record_bus_of(0, 0)));
        Self {
            fixture,
            next: 0,
            accepted: Vec::new(),
            on_bus: Vec::new(),
            echoes: Vec::new(),
            states: HashSet::new(),
        }
    }

    fn channel(&self) -> ChannelStatistics {
        self.fixture.port.statistics(self.fixture.port.gw(0)).channels[0]
    }

    fn cycle(&mut self, sends: bool) {
        let number = self.next;
        let mut is_accepted = false;
        let items = self.fixture.cycle(|cycle| {
            is_accepted = sends && cycle.send_can(0, 0, id(1), &number.to_le_bytes()).is_ok();
        });
        if is_accepted {
            self.accepted.push(number);
            self.next += 1;
        }
        let of = |data: &[u8]| u32::from_le_bytes(data.try_into().expect("four bytes"));
        let frames = items.iter().filter_map(Received::frame);
        self.echoes.extend(frames.map(|frame| of(frame.frame.data())));
        let recorded = self.fixture.simulation.with_world(|world| world.take_recorded());
        let own = recorded.iter().filter(|frame| frame.is_from_channel);
        self.on_bus.extend(own.map(|frame| of(frame.frame.data())));
        let port = &self.fixture.port;
        let gateway = port.gw(0);
        let mut hasher = DefaultHasher::new();
        format!("{:?} {:?}", port.session(gateway), port.waiting_for(gateway)).hash(&mut hasher);
        let report = port.cycle_report(gateway);
        format!("{:?} {:?}", report.image, report.domain).hash(&mut hasher);
        report.is_unconfirmed.hash(&mut hasher);
        self.states.insert(hasher.finish());
    }

    fn run(&mut self, history: &[Step]) {
        let before = self.channel();
        for step in history {
            if let Some(fault) = step.fault() {
                self.fixture.simulation.inject(fault);
            }
            if let Step::CycleLeftOut = step {
                self.fixture.simulation.pass_ns(1_000_000);
            } else {
                self.cycle(true);
            }
        }
        for _ in 0..3 {
            self.cycle(true);
        }
        let is_settled = |machine: &Self| {
            machine.fixture.port.is_ready() && machine.channel().frames_pending == 0
        };
        let mut cycles = 0;
        while !is_settled(self) {
            assert!(
                cycles < 30_000,
                "{history:?}: not ready, or frames pend: {:?}",
                self.channel()
            );
            self.cycle(false);
            cycles += 1;
        }
        // Frames in the gateway and on the bus, and their echoes.
        (0..10).for_each(|_| self.cycle(false));
        self.judge(history, &before);
    }

    fn judge(&mut self, history: &[Step], before: &ChannelStatistics) {
        let now = self.channel();
        let accepted = std::mem::take(&mut self.accepted);
        let on_bus = std::mem::take(&mut self.on_bus);
        let echoes = std::mem::take(&mut self.echoes);
        assert!(
            on_bus.is_sorted_by(|a, b| a < b),
            "{history:?}: twice or not in order: {on_bus:?}"
        );
        assert!(echoes.is_sorted_by(|a, b| a < b), "{history:?}: {echoes:?}");
        let known: HashSet<_> = accepted.iter().collect();
        assert!(on_bus.iter().all(|number| known.contains(number)), "{history:?}: {on_bus:?}");
        assert!(echoes.iter().all(|number| on_bus.contains(number)), "{history:?}: {echoes:?}");
        let [total, delivered, lost, discarded, unknown] = [
            now.frames_accepted - before.frames_accepted,
            now.frames_delivered - before.frames_delivered,
            now.frames_lost - before.frames_lost,
            now.frames_discarded - before.frames_discarded,
            now.frames_unknown - before.frames_unknown,
        ];
        let sent = on_bus.len() as u64;
        let text = format!("{history:?}: {sent} on the bus of {accepted:?}: {on_bus:?}, {now:?}");
        assert_eq!(total, accepted.len() as u64, "{text}");
        assert_eq!(total, delivered + lost + discarded + unknown, "{text}");
        // The restart of a gateway loses what it has parsed.
        if !history.iter().any(|step| matches!(step, Step::Restart | Step::SafeOp)) {
            assert!(delivered <= sent, "{text}");
        }
        assert!(sent <= delivered + unknown, "{text}");
    }
}

#[test]
fn each_frame_of_a_short_history_is_on_the_bus_once_or_reported() {
    let steps = std::env::var("HISTORY_STEPS").map_or(2, |text| text.parse().expect("a number"));
    let count = (STEPS.len() as u64).pow(steps);
    let mut states = HashSet::new();
    for first in (0..count).step_by(PER_MACHINE as usize) {
        let mut machine = Machine::new();
        for number in first..count.min(first + PER_MACHINE) {
            let base = STEPS.len() as u64;
            let history: Vec<_> =
                (0..steps).map(|nth| STEPS[(number / base.pow(nth) % base) as usize]).collect();
            machine.run(&history);
        }
        states.extend(machine.states);
    }
    println!("{count} histories of {steps} steps, {} different states", states.len());
    assert!(states.len() > 20);
}
