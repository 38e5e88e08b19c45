//! slcan on a pseudo-terminal.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::Duration;

use crate::bridge::client_queue::ClientQueue;
use crate::bridge::clients::Clients;
use crate::bridge::config::BridgeProtocol;
use crate::bridge::connection::Connection;
use crate::bridge::server::serve;
use crate::bridge::session::Session;
use crate::bridge::terminal::{Terminal, TerminalLine};

/// Interval of polling for a program. Stopping does not wait for it.
const LOOK_INTERVAL: Duration = Duration::from_millis(10);

/// A pseudo-terminal that behaves as an slcan adapter with one client: the program that has it
/// open. The next program gets a new session. Dropping it ends its thread.
#[derive(Debug)]
pub struct SerialBridge {
    terminal: Arc<Terminal>,
    clients: Arc<Clients>,
    thread: Option<JoinHandle<()>>,
}

impl SerialBridge {
    /// Creates the terminal; `queue` is the capacity in frames of the queue to the bus and of the
    /// queue to the client.
    ///
    /// # Errors
    /// No pseudo-terminal or no thread is available.
    pub fn open(queue: usize) -> io::Result<Self> {
        let terminal = Arc::new(Terminal::open()?);
        let clients = Arc::new(Clients::new(queue, 1));
        let (line, served) = (terminal.clone(), clients.clone());
        let thread = thread::Builder::new()
            .name("bridge terminal".to_owned())
            .spawn(move || serve_programs(&served, &line))?;
        Ok(Self { terminal, clients, thread: Some(thread) })
    }

    /// Path that other programs open.
    pub fn path(&self) -> &Path {
        self.terminal.path()
    }

    /// The client.
    pub fn clients(&self) -> &Arc<Clients> {
        &self.clients
    }
}

impl Drop for SerialBridge {
    fn drop(&mut self) {
        self.clients.close();
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // A panic in it has been reported on stderr already.
            let _ = thread.join();
        }
    }
}

/// Serves one program after the other until the bridge is closed.
fn serve_programs(clients: &Clients, terminal: &Arc<Terminal>) {
    while !clients.is_closed() {
        // A terminal that cannot be polled counts as unused.
        if !terminal.is_in_use().unwrap_or(false) {
            thread::park_timeout(LOOK_INTERVAL);
            continue;
        }
        let line = Arc::new(TerminalLine::new(terminal.clone()));
        let queue = Arc::new(ClientQueue::new(clients.queue()));
        // If the client is not admitted, the bridge was closed just now.
        let connection = Connection::Terminal(line.clone());
        let Some(id) = clients.join(connection, None, queue.clone()) else {
            return;
        };
        let session = Session::new(BridgeProtocol::Slcan);
        serve(clients, id, &Connection::Terminal(line), session, &queue, None);
    }
}
