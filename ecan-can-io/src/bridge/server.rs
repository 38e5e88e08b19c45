//! TCP server of a bridge: one thread accepts, and each client has two threads.

use super::client_queue::ClientQueue;
use super::clients::{BridgeStatistics, BusRates, ClientFrame, ClientId, Clients, count};
use super::serial::TerminalLine;
use super::session::Session;
use super::session::Uplink;
use super::writer::Writer;
use ecan_protocol::can::CanFrame;
use rustix::net::sockopt;
use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{IpAddr, Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use std::{fmt, io, thread};

/// Interval of polling for a new client. Stopping does not wait for it.
const ACCEPT_INTERVAL: Duration = Duration::from_millis(10);

/// Reason why a bridge cannot start.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The address is not available.
    #[error("bridge cannot listen on {0}: {1}")]
    Listen(SocketAddr, io::Error),
    /// The thread cannot be started.
    #[error("no thread for the bridge on {0}: {1}")]
    Thread(SocketAddr, io::Error),
}

/// A listening bridge. Dropping it closes every connection and waits for its threads.
#[derive(Debug)]
pub struct BridgeServer {
    info: BridgeInfo,
    clients: Arc<Clients>,
    stop: Arc<AtomicBool>,
    acceptor: Option<JoinHandle<()>>,
}

impl BridgeServer {
    /// Starts to listen; clients may connect at once.
    ///
    /// # Errors
    /// The address is not available, or the thread cannot be started.
    pub fn listen(config: &BridgeConfig) -> Result<Self, ServerError> {
        let clients = Arc::new(Clients::new(config.queue, config.max_clients));
        let address = config.address;
        let listen = || {
            let listener = TcpListener::bind(address)?;
            listener.set_nonblocking(true)?;
            let address = listener.local_addr()?;
            Ok((listener, address))
        };
        let (listener, bound) = listen().map_err(|error| ServerError::Listen(address, error))?;
        let stop = Arc::new(AtomicBool::new(false));
        let acceptor = Acceptor {
            listener,
            protocol: config.protocol,
            handshake: (config.protocol == BridgeProtocol::Socketcand).then_some(config.handshake),
            clients: clients.clone(),
            stop: stop.clone(),
        };
        let acceptor = thread::Builder::new()
            .name(format!("bridge {}", bound.port()))
            .spawn(move || acceptor.run())
            .map_err(|error| ServerError::Thread(bound, error))?;
        let info =
            BridgeInfo { protocol: config.protocol, address: bound, clients: clients.clone() };
        Ok(Self { info, clients, stop, acceptor: Some(acceptor) })
    }

    /// Address and counters; remains valid after the server is dropped.
    pub fn info(&self) -> &BridgeInfo {
        &self.info
    }

    /// The clients.
    pub fn clients(&self) -> &Arc<Clients> {
        &self.clients
    }
}

impl Drop for BridgeServer {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        self.clients.close();
        if let Some(acceptor) = self.acceptor.take() {
            acceptor.thread().unpark();
            // A panic in it has been reported on stderr already.
            let _ = acceptor.join();
        }
    }
}

struct Acceptor {
    listener: TcpListener,
    protocol: BridgeProtocol,
    handshake: Option<Duration>,
    clients: Arc<Clients>,
    stop: Arc<AtomicBool>,
}

impl Acceptor {
    fn run(self) {
        let mut clients: Vec<JoinHandle<()>> = Vec::new();
        while !self.stop.load(Ordering::Acquire) {
            clients.retain(|client| !client.is_finished());
            match self.listener.accept() {
                Ok((stream, _)) => clients.extend(self.admit(stream)),
                // No client, or one that has already left.
                Err(_) => thread::park_timeout(ACCEPT_INTERVAL),
            }
        }
        for client in clients {
            let _ = client.join();
        }
    }

    /// Starts the threads of a client. If there are too many clients or no thread is available, its
    /// connection is closed.
    fn admit(&self, stream: TcpStream) -> Option<JoinHandle<()>> {
        let queue = Arc::new(ClientQueue::new(self.clients.queue()));
        let admit = || -> io::Result<Option<(Connection, ClientId)>> {
            stream.set_nonblocking(false)?;
            stream.set_nodelay(true)?;
            watch(&stream)?;
            let connection = Connection::Tcp(stream);
            let peer = connection.peer();
            let id = self.clients.join(connection.try_clone()?, peer, queue.clone());
            Ok(id.map(|id| (connection, id)))
        };
        let (connection, id) = admit().ok()??;
        let clients = self.clients.clone();
        let session = Session::new(self.protocol);
        let handshake = self.handshake;
        let serve = move || serve(&clients, id, &connection, session, &queue, handshake);
        let started = thread::Builder::new().name(format!("bridge client {id}")).spawn(serve);
        if started.is_err() {
            self.clients.leave(id);
        }
        started.ok()
    }
}

/// Serves a client until it leaves; with `handshake`, it has this time to open the bus.
pub(crate) fn serve(
    clients: &Clients,
    id: ClientId,
    stream: &Connection,
    session: Session,
    queue: &ClientQueue,
    handshake: Option<Duration>,
) {
    let mut greeting = Vec::new();
    session.greet(&mut greeting);
    let writer = Writer::new(session.receive_settings());
    thread::scope(|scope| {
        let writer = thread::Builder::new().spawn_scoped(scope, move || {
            write_all(clients, stream, writer, queue, &greeting);
            // Closes the queue, so that the reader does not wait for space in it.
            clients.leave(id);
        });
        if writer.is_ok() {
            Reader { uplink: ClientUplink { clients, id, queue }, stream, session }
                .read_all(handshake);
        }
        clients.leave(id);
    });
}

struct ClientUplink<'a> {
    clients: &'a Clients,
    id: ClientId,
    queue: &'a ClientQueue,
}

impl ClientUplink<'_> {
    fn untagged(&self, frame: CanFrame) -> ClientFrame {
        ClientFrame { client: self.id, frame, tag: 0 }
    }
}

impl Uplink for ClientUplink<'_> {
    fn bus(&self) -> Option<BusRates> {
        self.clients.bus()
    }

    fn send(&mut self, frame: CanFrame) -> bool {
        self.clients.submit(self.untagged(frame))
    }

    fn send_when_possible(&mut self, frame: CanFrame) {
        self.clients.submit_when_possible(self.untagged(frame));
    }

    fn take_lost(&mut self) -> bool {
        self.queue.take_lost()
    }

    fn count_rejected(&mut self) {
        count(&self.clients.counters.rejected);
    }

    fn count_mismatched(&mut self) {
        count(&self.clients.counters.mismatched);
    }
}

struct Reader<'a> {
    uplink: ClientUplink<'a>,
    stream: &'a Connection,
    session: Session,
}

impl Reader<'_> {
    fn read_all(mut self, handshake: Option<Duration>) {
        if let Some(limit) = handshake {
            let deadline = Instant::now() + limit;
            let has_opened = self.read_while(Some(deadline), |session| !session.is_open());
            if !has_opened || self.stream.set_read_limit(None).is_err() {
                return;
            }
        }
        self.read_while(None, |_| true);
    }

    /// Processes input while a condition holds; returns false if the client has left or the time is
    /// over.
    fn read_while(&mut self, deadline: Option<Instant>, condition: fn(&Session) -> bool) -> bool {
        let mut bytes = [0; 2048];
        while condition(&self.session) {
            if let Some(deadline) = deadline {
                let left = deadline.saturating_duration_since(Instant::now());
                // A limit of zero would be none.
                if left.is_zero() || self.stream.set_read_limit(Some(left)).is_err() {
                    count(&self.uplink.clients.counters.silent_clients);
                    return false;
                }
            }
            let read = match self.stream.read(&mut bytes) {
                Ok(0) => return false,
                Ok(read) => read,
                Err(error) => match error.kind() {
                    ErrorKind::Interrupted | ErrorKind::WouldBlock | ErrorKind::TimedOut => {
                        continue;
                    }
                    _ => return false,
                },
            };
            if !self.feed(bytes.get(..read).unwrap_or_default()) {
                return false;
            }
        }
        true
    }

    fn feed(&mut self, bytes: &[u8]) -> bool {
        let Self { uplink, session, .. } = self;
        let was_open = session.is_open();
        let mut answer = Vec::new();
        session.feed(bytes, uplink, &mut answer);
        // Before the answer: a client that has received it keeps its place.
        if session.is_open() && !was_open {
            uplink.clients.keep(uplink.id);
        }
        // A client that does not read its answers is not read either. Its receive settings change
        // only with an answer.
        answer.is_empty() || uplink.queue.answer(answer, session.receive_settings())
    }
}

fn write_all(
    clients: &Clients,
    stream: &Connection,
    mut writer: Writer,
    queue: &ClientQueue,
    greeting: &[u8],
) {
    let mut is_written = stream.write_all(greeting).is_ok();
    while is_written && let Some(chunk) = writer.next_chunk(queue, || clients.bus()) {
        is_written = stream.write_all(&chunk.text).is_ok();
        if !chunk.pause.is_zero() {
            thread::sleep(chunk.pause);
        }
    }
}

/// Protocol between a bridge and its clients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BridgeProtocol {
    /// ASCII protocol of Lawicel's serial adapters with the CAN FD commands of CANable 2:
    /// python-can's interface `slcan` on the channel `socket://127.0.0.1:PORT`.
    #[default]
    Slcan,
    /// Raw mode of socketcand: python-can's interface `socketcand`. Classic CAN only.
    Socketcand,
}

impl BridgeProtocol {
    /// Name of the protocol.
    pub fn name(self) -> &'static str {
        match self {
            Self::Slcan => "slcan",
            Self::Socketcand => "socketcand",
        }
    }
}

/// Configuration of a bridge. Plain data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BridgeConfig {
    /// Protocol.
    pub protocol: BridgeProtocol,
    /// Address on which it listens. Port 0 takes any free one. Everyone who can reach this address
    /// can send on the bus.
    pub address: SocketAddr,
    /// Maximum number of clients; more are rejected. A client that has not opened the bus loses its
    /// place if another one needs it.
    pub max_clients: usize,
    /// Capacity in frames of the queue from each client to the bus, and of the queue to each client.
    pub queue: usize,
    /// Time in which a client of socketcand opens the bus; then its connection is closed. A client of
    /// slcan may be silent for as long as no other one needs its place: a terminal program has the
    /// connection open while its user types.
    pub handshake: Duration,
}

impl Default for BridgeConfig {
    /// slcan on a free port of the loopback interface, 8 clients, 4096 frames, 10 s to open the bus.
    fn default() -> Self {
        Self {
            protocol: BridgeProtocol::Slcan,
            address: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 0),
            max_clients: 8,
            queue: 4096,
            handshake: Duration::from_secs(10),
        }
    }
}

impl BridgeConfig {
    /// The default configuration with another protocol.
    #[must_use]
    pub fn with_protocol(protocol: BridgeProtocol) -> Self {
        Self { protocol, ..Self::default() }
    }
}

/// Address and counters of a bridge. Does not keep it alive.
#[derive(Clone, Debug)]
pub struct BridgeInfo {
    pub(crate) protocol: BridgeProtocol,
    pub(crate) address: SocketAddr,
    pub(crate) clients: Arc<Clients>,
}

impl BridgeInfo {
    /// Protocol of the bridge.
    pub fn protocol(&self) -> BridgeProtocol {
        self.protocol
    }

    /// Address on which it listens, with the actual port.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Counters of the bridge.
    pub fn statistics(&self) -> BridgeStatistics {
        self.clients.statistics()
    }
}

impl fmt::Display for BridgeInfo {
    /// Protocol and address, for example "slcan bridge at 127.0.0.1:29536".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} bridge at {}", self.protocol.name(), self.address)
    }
}

/// Time without acknowledgement after which a client's machine counts as lost. The same applies to
/// a client that does not read, once the buffers of both machines are full.
const SILENCE_MS: u32 = 60_000;
const KEEP_ALIVE_INTERVAL: Duration = Duration::from_secs(10);

/// Ends a connection whose peer machine vanished; otherwise it would occupy the place of another
/// client forever.
pub(crate) fn watch(stream: &TcpStream) -> io::Result<()> {
    sockopt::set_socket_keepalive(stream, true)?;
    sockopt::set_tcp_keepidle(stream, KEEP_ALIVE_INTERVAL)?;
    sockopt::set_tcp_keepintvl(stream, KEEP_ALIVE_INTERVAL)?;
    // Also ends it while data are in transit, and replaces the number of probes.
    Ok(sockopt::set_tcp_user_timeout(stream, SILENCE_MS)?)
}

/// Handle that ends a client's connection.
pub(crate) trait Close: std::fmt::Debug + Send {
    /// Ends the connection; all of its threads notice. No effect if it has already ended.
    fn close(&self);
}

/// A connection; a clone refers to the same one.
#[derive(Debug)]
pub(crate) enum Connection {
    Tcp(TcpStream),
    Terminal(Arc<TerminalLine>),
}

impl Connection {
    pub(crate) fn try_clone(&self) -> io::Result<Self> {
        Ok(match self {
            Self::Tcp(stream) => Self::Tcp(stream.try_clone()?),
            Self::Terminal(line) => Self::Terminal(line.clone()),
        })
    }

    /// Waits for bytes; returns 0 at the end.
    pub(crate) fn read(&self, bytes: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => (&*stream).read(bytes),
            Self::Terminal(line) => line.read(bytes),
        }
    }

    /// Limits the time of the following calls of [`read`](Self::read). A terminal has no limit.
    pub(crate) fn set_read_limit(&self, limit: Option<Duration>) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => stream.set_read_timeout(limit),
            Self::Terminal(_) => Ok(()),
        }
    }

    /// Address of the client's machine.
    pub(crate) fn peer(&self) -> Option<IpAddr> {
        match self {
            Self::Tcp(stream) => stream.peer_addr().ok().map(|address| address.ip()),
            Self::Terminal(_) => None,
        }
    }

    pub(crate) fn write_all(&self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => (&*stream).write_all(bytes),
            Self::Terminal(line) => line.write_all(bytes),
        }
    }
}

impl Close for Connection {
    fn close(&self) {
        match self {
            Self::Tcp(stream) => {
                let _ = stream.shutdown(Shutdown::Both);
            }
            Self::Terminal(line) => line.close(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;

    /// A vanished machine cannot be simulated here; the socket options can be read back.
    #[test]
    fn connection_has_keep_alive() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let _client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (stream, _) = listener.accept().unwrap();
        watch(&stream).unwrap();
        assert!(sockopt::socket_keepalive(&stream).unwrap());
        assert_eq!(sockopt::tcp_keepidle(&stream).unwrap(), KEEP_ALIVE_INTERVAL);
        assert_eq!(sockopt::tcp_user_timeout(&stream).unwrap(), SILENCE_MS);
    }
}
