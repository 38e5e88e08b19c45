//! A Port on a simulated bus with a service, on a thread of its own.

use std::io::{Read as _, Write as _};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig, SlaveStatistics};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::image::OptionFlags;
use ecan_service::client::{
    Client, Event, HEADER_BYTES, MessageKind, Response, Sender, header, read_header,
};
use ecan_service::server::{Control, ServePort as _, Service, ServiceConfig};
use ecan_sim::{ClockKind, SimOptions, Simulation};
use serde_json::{Value, json};

/// Limit of all waits.
pub const PATIENCE: Duration = Duration::from_secs(300);

/// Command to the thread of the cycle.
pub type Command = Box<dyn FnOnce(&mut Port, &Service) + Send>;

pub struct Fixture {
    pub directory: tempfile::TempDir,
    pub simulation: Simulation,
    stop: Arc<AtomicBool>,
    /// Frames that the application sends in each cycle on channel 0.
    pub frames_per_cycle: Arc<AtomicU64>,
    commands: std::sync::mpsc::Sender<Command>,
    thread: Option<JoinHandle<()>>,
}

/// Channel 0 classic with results, channel 1 CAN FD.
pub fn gateway() -> GatewayConfig {
    let mut gateway = GatewayConfig::on_channel(0, ChannelConfig::classic(1_000_000))
        .with_channel(1, ChannelConfig::fd(1_000_000, 5_000_000));
    gateway.tx_options = OptionFlags::TX_RESULT;
    gateway
}

impl Fixture {
    pub fn start(change: impl FnOnce(&mut ServiceConfig)) -> Self {
        Self::with_gateway(gateway(), change)
    }

    pub fn with_gateway(gateway: GatewayConfig, change: impl FnOnce(&mut ServiceConfig)) -> Self {
        Self::with_clock(ClockKind::Real, gateway, change)
    }

    pub fn with_clock(
        clock: ClockKind,
        gateway: GatewayConfig,
        change: impl FnOnce(&mut ServiceConfig),
    ) -> Self {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("master0.sock");
        let mut config = ServiceConfig::new(path).with_control(Control::Owner);
        change(&mut config);
        let options = SimOptions { clock: Some(clock), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &options).unwrap();
        let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
        let mut port =
            Port::open(&backend.ecrt, (adapter, PortConfig::uniform(1, gateway))).unwrap();
        let service = port.serve(config).unwrap_or_else(|error| panic!("{error}"));
        let stop = Arc::new(AtomicBool::new(false));
        let frames_per_cycle = Arc::new(AtomicU64::new(0));
        let (commands, receiver) = std::sync::mpsc::channel::<Command>();
        let (is_stopped, count) = (stop.clone(), frames_per_cycle.clone());
        let thread = std::thread::spawn(move || {
            port.wait_ready().unwrap();
            while !is_stopped.load(Ordering::Acquire) {
                while let Ok(command) = receiver.try_recv() {
                    command(&mut port, &service);
                }
                let mut cycle = port.next_cycle();
                let _ = cycle.received().count();
                let channel = cycle.channel(0, 0).unwrap();
                for number in 0..count.load(Ordering::Acquire) {
                    let _ = cycle.send(channel, &frame(0x100 + number as u16, &[1; 8]));
                }
                cycle.finish();
            }
            drop(service);
        });
        let simulation = backend.simulation.unwrap();
        let fixture =
            Self { directory, simulation, stop, frames_per_cycle, commands, thread: Some(thread) };
        let client = fixture.client();
        wait_for("a ready gateway", || {
            client.state().is_ok_and(|state| {
                let is_ready = |gateway: &ecan_service::client::GatewayState| {
                    gateway.session == ecan_service::client::SessionState::Ready
                };
                !state.gateways.is_empty() && state.gateways.iter().all(is_ready)
            })
        });
        fixture
    }

    pub fn path(&self) -> PathBuf {
        self.directory.path().join("master0.sock")
    }

    pub fn client(&self) -> Client {
        Client::connect(&self.path(), "test").unwrap_or_else(|error| panic!("{error}"))
    }

    pub fn stream(&self) -> UnixStream {
        UnixStream::connect(self.path()).unwrap()
    }

    /// Executes a command between two cycles.
    pub fn execute<R: Send + 'static>(
        &self,
        command: impl FnOnce(&mut Port, &Service) -> R + Send + 'static,
    ) -> R {
        let (sender, receiver) = std::sync::mpsc::channel();
        let command = move |port: &mut Port, service: &Service| {
            sender.send(command(port, service)).unwrap();
        };
        self.commands.send(Box::new(command)).unwrap();
        receiver.recv_timeout(PATIENCE).unwrap()
    }

    /// Runs cycles in which the application sends nothing.
    pub fn run_cycles(&self, count: usize) {
        self.execute(move |port, _| {
            for _ in 0..count {
                let mut cycle = port.next_cycle();
                cycle.received().for_each(drop);
                cycle.finish();
            }
        });
    }

    pub fn statistics(&self) -> SlaveStatistics {
        self.execute(|port, _| port.statistics(port.gateway(0).unwrap()))
    }

    /// Ends the application.
    pub fn stop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
    }
}

impl Drop for Fixture {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Bounds a loop that waits.
pub struct Limit(Instant);

impl Limit {
    pub fn start() -> Self {
        Self(Instant::now())
    }

    pub fn check(&self, what: &str) {
        assert!(self.0.elapsed() < PATIENCE, "waited for {what}");
    }
}

pub fn wait_for(what: &str, mut condition: impl FnMut() -> bool) {
    let limit = Limit::start();
    while !condition() {
        limit.check(what);
        std::thread::sleep(Duration::from_millis(2));
    }
}

pub fn frame(id: u16, data: &[u8]) -> CanFrame {
    CanFrame::classic(CanId::standard(id).unwrap(), data).unwrap()
}

/// The next event.
pub fn next(client: &Client) -> Event {
    client.poll(PATIENCE).unwrap_or_else(|error| panic!("{error}")).expect("an event")
}

pub fn exists(path: &Path) -> bool {
    path.symlink_metadata().is_ok()
}

/// Writes a message as a client that is not the project's.
pub fn write(stream: &mut UnixStream, kind: MessageKind, payload: &[u8]) {
    stream.write_all(&header(kind, payload.len())).unwrap();
    stream.write_all(payload).unwrap();
}

/// The next message; `None` at the end.
pub fn read(stream: &mut UnixStream) -> Option<(MessageKind, Vec<u8>)> {
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let mut head = [0; HEADER_BYTES];
    stream.read_exact(&mut head).ok()?;
    let (kind, length) = read_header(head, Sender::Service).unwrap();
    let mut payload = vec![0; length];
    stream.read_exact(&mut payload).unwrap();
    Some((kind, payload))
}

pub fn call(stream: &mut UnixStream, request: &Value) -> Response {
    write(stream, MessageKind::Rpc, request.to_string().as_bytes());
    serde_json::from_slice(&read(stream).unwrap().1).unwrap()
}

pub fn say_hello(stream: &mut UnixStream) {
    let params = json!({"version": 1, "client": "raw"});
    let hello = json!({"jsonrpc": "2.0", "id": 1, "method": "hello", "params": params});
    assert!(call(stream, &hello).result.is_some());
}
