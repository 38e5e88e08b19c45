//! The TCP server: one thread that accepts, two per client.

use std::io::{self, ErrorKind};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use ecan_protocol::can::CanFrame;

use crate::clients::Clients;
use crate::connection::{self, Connection};
use crate::hub::{ClientId, Hub};
use crate::info::BridgeInfo;
use crate::outbox::ClientQueue;
use crate::rates::BusRates;
use crate::session::{Session, Uplink};
use crate::settings::{BridgeConfig, BridgeProtocol};
use crate::statistics::count;
use crate::writer::Writer;

/// Between two looks for a new client. Stopping does not wait for it.
const ACCEPT_INTERVAL: Duration = Duration::from_millis(10);

/// Why a bridge cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The address is not to be had.
    #[error("bridge cannot listen on {address}: {error}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// Why.
        error: io::Error,
    },
    /// No thread for it.
    #[error("no thread for the bridge on {address}: {error}")]
    Thread {
        /// The address.
        address: SocketAddr,
        /// Why.
        error: io::Error,
    },
}

/// A listening bridge. Dropping it closes every connection and waits for its threads.
#[derive(Debug)]
pub struct BridgeServer {
    info: BridgeInfo,
    clients: Clients,
    stop: Arc<AtomicBool>,
    acceptor: Option<JoinHandle<()>>,
}

impl BridgeServer {
    /// Starts to listen; clients may connect at once.
    ///
    /// # Errors
    /// The address cannot be had, or no thread.
    pub fn listen(settings: &BridgeConfig) -> Result<Self, ServerError> {
        let hub = Arc::new(Hub::new(settings.queue, settings.max_clients));
        let address = settings.address;
        let listen = || {
            let listener = TcpListener::bind(address)?;
            listener.set_nonblocking(true)?;
            let address = listener.local_addr()?;
            Ok((listener, address))
        };
        let (listener, bound) = listen().map_err(|error| ServerError::Listen { address, error })?;
        let stop = Arc::new(AtomicBool::new(false));
        let acceptor = Acceptor {
            listener,
            protocol: settings.protocol,
            hub: hub.clone(),
            stop: stop.clone(),
        };
        let acceptor = thread::Builder::new()
            .name(format!("bridge {}", bound.port()))
            .spawn(move || acceptor.run())
            .map_err(|error| ServerError::Thread { address: bound, error })?;
        let info = BridgeInfo::new(settings.protocol, bound, hub.clone());
        Ok(Self { info, clients: Clients(hub), stop, acceptor: Some(acceptor) })
    }

    /// Where it listens and what it has done; stays valid after the server has gone.
    pub fn info(&self) -> &BridgeInfo {
        &self.info
    }

    /// Its clients.
    pub fn clients(&self) -> &Clients {
        &self.clients
    }
}

impl Drop for BridgeServer {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        self.clients.0.close();
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
    hub: Arc<Hub>,
    stop: Arc<AtomicBool>,
}

impl Acceptor {
    fn run(self) {
        let mut clients: Vec<JoinHandle<()>> = Vec::new();
        while !self.stop.load(Ordering::Acquire) {
            clients.retain(|client| !client.is_finished());
            match self.listener.accept() {
                Ok((stream, _)) => clients.extend(self.admit(stream)),
                // Nobody there, or someone who left again at once.
                Err(_) => thread::park_timeout(ACCEPT_INTERVAL),
            }
        }
        for client in clients {
            let _ = client.join();
        }
    }

    /// Starts the threads of a client. One for whom there is no room, or no thread, finds its
    /// connection closed.
    fn admit(&self, stream: TcpStream) -> Option<JoinHandle<()>> {
        let outbox = Arc::new(ClientQueue::new(self.hub.queue()));
        let admit = || -> io::Result<Option<(Connection, ClientId)>> {
            stream.set_nonblocking(false)?;
            stream.set_nodelay(true)?;
            connection::watch(&stream)?;
            let connection = Connection::Tcp(stream);
            let id = self.hub.join(connection.try_clone()?, outbox.clone());
            Ok(id.map(|id| (connection, id)))
        };
        let (connection, id) = admit().ok()??;
        let hub = self.hub.clone();
        let session = Session::new(self.protocol);
        let serve = move || serve(&hub, id, &connection, session, &outbox);
        let started = thread::Builder::new().name(format!("bridge client {id}")).spawn(serve);
        if started.is_err() {
            self.hub.leave(id);
        }
        started.ok()
    }
}

/// The life of a client.
pub(crate) fn serve(
    hub: &Hub,
    id: ClientId,
    stream: &Connection,
    mut session: Session,
    outbox: &ClientQueue,
) {
    let mut greeting = Vec::new();
    session.greet(&mut greeting);
    let writer = Writer::new(session.hearing());
    thread::scope(|scope| {
        let writer = thread::Builder::new().spawn_scoped(scope, move || {
            write_all(hub, stream, writer, outbox, &greeting);
            // Closes the outbox, so that the reader does not wait for room in it.
            hub.leave(id);
        });
        if writer.is_ok() {
            read_all(hub, id, stream, &mut session, outbox);
        }
        hub.leave(id);
    });
}

/// A client's way to the bus.
struct ClientUplink<'a> {
    hub: &'a Hub,
    id: ClientId,
}

impl Uplink for ClientUplink<'_> {
    fn bus(&self) -> Option<BusRates> {
        self.hub.bus()
    }

    fn send(&mut self, frame: CanFrame) -> bool {
        self.hub.submit(self.id, frame)
    }

    fn send_when_possible(&mut self, frame: CanFrame) {
        self.hub.submit_when_possible(self.id, frame);
    }

    fn count_refused(&mut self) {
        count(&self.hub.counters.refused);
    }

    fn count_mismatched(&mut self) {
        count(&self.hub.counters.mismatched);
    }
}

fn read_all(
    hub: &Hub,
    id: ClientId,
    stream: &Connection,
    session: &mut Session,
    outbox: &ClientQueue,
) {
    let mut uplink = ClientUplink { hub, id };
    let mut bytes = [0; 2048];
    loop {
        let read = match stream.read(&mut bytes) {
            Ok(0) => return,
            Ok(read) => read,
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            Err(_) => return,
        };
        let mut answer = Vec::new();
        session.feed(bytes.get(..read).unwrap_or_default(), &mut uplink, &mut answer);
        // A client that does not read its answers is not read from either. What it hears changes
        // with an answer only.
        if !answer.is_empty() && !outbox.answer(answer, session.hearing()) {
            return;
        }
    }
}

fn write_all(
    hub: &Hub,
    stream: &Connection,
    mut writer: Writer,
    outbox: &ClientQueue,
    greeting: &[u8],
) {
    let mut is_written = stream.write_all(greeting).is_ok();
    while is_written && let Some(piece) = writer.next_piece(outbox, || hub.bus()) {
        is_written = stream.write_all(&piece.text).is_ok();
        if !piece.pause.is_zero() {
            thread::sleep(piece.pause);
        }
    }
}
