//! The application of the test: a cycle of 1 ms on a simulated bus, with a service. It runs in a
//! process of its own, takes one command per line and answers each with a line in JSON.

use std::io::{BufRead as _, Write as _};
use std::path::Path;
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use ecan_host::{AdapterConfig, CycleStatistics, Distribution, Need, RealTimeConfig};
use ecan_mcan_port::{ChannelConfig, ChannelHandle, GatewayConfig, Port, PortConfig, ReceivedView};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::image::OptionFlags;
use ecan_service::server::{Control, ServePort as _, ServiceConfig};
use ecan_sim::{ClockKind, SimOptions, Simulation};
use serde_json::{Value, json};

use super::sequence::{APPLICATION, CLIENT};

/// Frames of a channel whose echo the application awaits: with those of the client they fit into the
/// gateway's queues, however late a cycle is.
const WINDOW: u64 = 8;
/// Pause of a busy machine that does not end the session.
const LONGEST_STALL: Duration = Duration::from_secs(5);

/// One channel, as the application sees it.
#[derive(Debug)]
struct Traffic {
    channel: ChannelHandle,
    /// Frames that it may send in total.
    credit: u64,
    sent: u64,
    echoed: u64,
    /// Echoes of the frames of the channel's client.
    of_client: u64,
    others: u64,
    /// Frames that were not the next ones.
    faults: u64,
}

struct Application {
    port: Port,
    simulation: Simulation,
    traffic: Vec<Traffic>,
    statistics: CycleStatistics,
}

/// Runs until the end of standard input.
pub fn run(path: &Path) {
    let options = SimOptions { clock: Some(ClockKind::Real), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &options).unwrap();
    let mut gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000));
    gateway.tx_options = OptionFlags::TX_RESULT;
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1)).with_multiplier(8);
    let adapter = adapter.with_watchdog(LONGEST_STALL);
    let mut port = Port::open(&backend.ecrt, (adapter, PortConfig::uniform(1, gateway))).unwrap();
    let config = ServiceConfig::new(path).with_control(Control::Owner).with_name("cell", "1.0");
    let service = port.serve(config).unwrap();
    port.wait_ready().unwrap();
    let traffic = |channel| Traffic {
        channel: port.channel(0, channel).unwrap(),
        credit: 0,
        sent: 0,
        echoed: 0,
        of_client: 0,
        others: 0,
        faults: 0,
    };
    let traffic = (0..4).map(traffic).collect();
    let statistics = CycleStatistics::new(adapter.cycle_ns());
    let simulation = backend.simulation.unwrap();
    let commands = read_commands();
    if let Ok(priority) = std::env::var("CROWD_PRIORITY") {
        let priority = Some(priority.parse().unwrap());
        let config =
            RealTimeConfig { priority, priority_need: Need::Required, ..Default::default() };
        config.apply().unwrap();
    }
    Application { port, simulation, traffic, statistics }.run(&commands);
    drop(service);
}

fn read_commands() -> Receiver<String> {
    let (sender, commands) = channel();
    std::thread::spawn(move || {
        for line in std::io::stdin().lock().lines().map_while(Result::ok) {
            sender.send(line).unwrap();
        }
    });
    commands
}

impl Application {
    fn run(mut self, commands: &Receiver<String>) {
        use std::sync::mpsc::TryRecvError::Disconnected;
        self.answer(&json!("ready"));
        loop {
            match commands.try_recv() {
                Ok(command) => self.execute(&command),
                Err(Disconnected) => return,
                Err(_) => {}
            }
            self.cycle();
        }
    }

    /// `clear` begins another measurement, `report` ends it; `credit A B C D` are the numbers of frames
    /// to send.
    fn execute(&mut self, command: &str) {
        let mut words = command.split(' ');
        match words.next() {
            Some("clear") => self.statistics.clear(),
            Some("report") => {
                self.answer(&self.report());
                // The report is no part of the cycle.
                self.statistics.pause();
            }
            Some("credit") => {
                for (traffic, word) in self.traffic.iter_mut().zip(words) {
                    traffic.credit = word.parse().unwrap();
                }
            }
            _ => panic!("{command}"),
        }
    }

    fn cycle(&mut self) {
        let Self { port, traffic, statistics, .. } = self;
        let mut cycle = port.next_cycle();
        for item in cycle.received() {
            if let ReceivedView::Frame { packet, .. } = item {
                traffic[usize::from(packet.channel)].receive(&packet.frame.to_owned());
            }
        }
        for traffic in traffic.iter_mut() {
            let is_free = traffic.sent - traffic.echoed < WINDOW && traffic.sent < traffic.credit;
            let id = CanId::standard(APPLICATION).unwrap();
            let frame = CanFrame::classic(id, &traffic.sent.to_be_bytes()).unwrap();
            if is_free && cycle.send(traffic.channel, &frame).is_ok() {
                traffic.sent += 1;
            }
        }
        cycle.finish();
        statistics.begin(&port.adapter().cycle_start());
        statistics.end(port.adapter().clock().now_ns());
    }

    fn report(&self) -> Value {
        let each = |count: fn(&Traffic) -> u64| self.traffic.iter().map(count).collect::<Vec<_>>();
        let times = |times: Distribution| json!({ "p50_ns": times.p50_ns, "p99_ns": times.p99_ns });
        let statistics = self.port.statistics(self.port.gateway(0).unwrap());
        let simulated = self.simulation.with_world(|world| {
            let counters = world.counters(0).unwrap();
            let (to, from) = (counters.transmit_losses, counters.receive_losses);
            let frames = |channel: usize| world.bus_statistics(0, channel).unwrap().frames;
            json!({
                "frames": (0..4).map(frames).collect::<Vec<_>>(),
                "to_bus": counters.frames_on_bus,
                "from_bus": counters.frames_from_bus,
                "to_master": counters.frames_to_master,
                "results_lost": counters.results_lost,
                "has_losses": to != Default::default() || from != Default::default(),
            })
        });
        json!({
            "sent": each(|side| side.sent),
            "echoed": each(|side| side.echoed),
            "of_client": each(|side| side.of_client),
            "others": each(|side| side.others),
            "faults": each(|side| side.faults),
            "sessions_lost": statistics.sessions_lost,
            "simulated": simulated,
            "cycles": self.statistics.cycles(),
            "overruns": self.statistics.overruns(),
            "skipped": self.statistics.skipped(),
            "run_time": times(self.statistics.run_time()),
            "wake_up": times(self.statistics.wake_up()),
        })
    }

    fn answer(&self, value: &Value) {
        let mut out = std::io::stdout();
        writeln!(out, "{value}").unwrap();
    }
}

impl Traffic {
    fn receive(&mut self, frame: &CanFrame) {
        let counter = match frame.id().raw() as u16 {
            APPLICATION => &mut self.echoed,
            CLIENT => &mut self.of_client,
            _ => return self.others += 1,
        };
        let is_next = frame.data() == counter.to_be_bytes();
        *counter += 1;
        self.faults += u64::from(!is_next);
    }
}
