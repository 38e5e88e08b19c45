//! An application with a cycle on a simulated bus in real time, and its service.

use std::path::PathBuf;
use std::sync::mpsc::{Sender, TryRecvError, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use ecan_cia402::{AxisConfig, Cia402, Cia402Config};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, Cycle, GatewayConfig, Port, PortConfig};
use ecan_protocol::image::OptionFlags;
use ecan_service::server::{Control, ServePort as _, Service, ServiceConfig};
use ecan_sim::{ClockKind, Scenario, SimOptions};

/// Command to the thread of the cycle.
type Command = Box<dyn FnOnce(&mut Port, &Service) + Send>;

pub struct Application {
    directory: tempfile::TempDir,
    commands: Option<Sender<Command>>,
    thread: Option<JoinHandle<()>>,
}

fn port(scenario: Scenario) -> Port {
    let options = SimOptions { clock: Some(ClockKind::Real), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(scenario, &options).unwrap();
    let mut gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000));
    gateway.tx_options = OptionFlags::TX_RESULT;
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(5));
    let adapter = adapter.with_watchdog(Duration::from_secs(5));
    Port::open(&backend.ecrt, (adapter, PortConfig::uniform(1, gateway))).unwrap()
}

fn path(directory: &tempfile::TempDir) -> PathBuf {
    directory.path().join("master0.sock")
}

impl Application {
    /// Runs `work` in each cycle. Returns after a cycle with a ready gateway.
    pub fn start(mut work: impl FnMut(&mut Cycle<'_>) + Send + 'static) -> Self {
        Self::run(
            ecan_sim::echo(1),
            |_| (),
            move |&mut (), cycle| {
                let _ = cycle.received().count();
                work(cycle);
            },
        )
    }

    /// Runs axes that hold their position; on a busy computer they may stop later.
    pub fn start_axes(axes: Vec<AxisConfig>) -> Self {
        let start = move |port: &mut Port| loop {
            let mut cia402 = Cia402::new(port, axes.clone(), Cia402Config::default()).unwrap();
            if cia402.blocking(port, Duration::from_secs(10)).start_up().is_ok() {
                return cia402;
            }
        };
        Self::run(ecan_sim::drives(1, 4), start, |cia402, cycle| {
            cia402.process_rx(cycle);
            cia402.send_target_step(cycle);
        })
    }

    fn run<T>(
        scenario: Scenario,
        start: impl FnOnce(&mut Port) -> T + Send + 'static,
        mut work: impl FnMut(&mut T, &mut Cycle<'_>) + Send + 'static,
    ) -> Self {
        let directory = tempfile::tempdir().unwrap();
        let (commands, receiver) = channel::<Command>();
        let (ready, is_ready) = channel();
        let config = ServiceConfig::new(path(&directory));
        let config = config.with_control(Control::Owner).with_name("cell", "1.0");
        let thread = std::thread::spawn(move || {
            let mut port = port(scenario);
            port.wait_ready().unwrap();
            let service = port.serve(config).unwrap();
            let mut state = start(&mut port);
            // The service has a state after the first cycle.
            let mut before_first = Some(ready);
            loop {
                match receiver.try_recv() {
                    Ok(command) => command(&mut port, &service),
                    Err(TryRecvError::Empty) => {}
                    Err(TryRecvError::Disconnected) => break,
                }
                let mut cycle = port.next_cycle();
                work(&mut state, &mut cycle);
                cycle.finish();
                if let Some(ready) = before_first.take() {
                    ready.send(()).unwrap();
                }
            }
        });
        is_ready.recv().unwrap();
        Self { directory, commands: Some(commands), thread: Some(thread) }
    }

    /// Path of the socket.
    pub fn path(&self) -> String {
        path(&self.directory).to_str().unwrap().to_owned()
    }

    /// Executes a command between two cycles.
    pub fn execute(&self, command: impl FnOnce(&mut Port, &Service) + Send + 'static) {
        self.commands.as_ref().unwrap().send(Box::new(command)).unwrap();
    }
}

impl Drop for Application {
    fn drop(&mut self) {
        self.commands = None;
        let _ = self.thread.take().map(JoinHandle::join);
    }
}
