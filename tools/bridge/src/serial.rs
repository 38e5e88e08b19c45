//! slcan on a pseudo-terminal.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::Duration;

use crate::clients::Clients;
use crate::connection::Connection;
use crate::hub::Hub;
use crate::outbox::ClientQueue;
use crate::server::serve;
use crate::session::Session;
use crate::settings::BridgeProtocol;
use crate::terminal::{Terminal, TerminalLine};

/// Between two looks for a program. Stopping does not wait for it.
const LOOK_INTERVAL: Duration = Duration::from_millis(10);

/// A pseudo-terminal behind which there seems to be an slcan adapter: one client at a time, whichever
/// program has it open. The next one finds it as new. Dropping it ends its thread.
#[derive(Debug)]
pub struct SerialBridge {
    terminal: Arc<Terminal>,
    clients: Clients,
    thread: Option<JoinHandle<()>>,
}

impl SerialBridge {
    /// Makes the terminal; `queue` frames may wait for the bus, and for the client.
    ///
    /// # Errors
    /// The system has none, or no thread.
    pub fn open(queue: usize) -> io::Result<Self> {
        let terminal = Arc::new(Terminal::open()?);
        let hub = Arc::new(Hub::new(queue, 1));
        let clients = Clients(hub.clone());
        let line = terminal.clone();
        let thread = thread::Builder::new()
            .name("bridge terminal".to_owned())
            .spawn(move || serve_programs(&hub, &line))?;
        Ok(Self { terminal, clients, thread: Some(thread) })
    }

    /// What other programs open.
    pub fn path(&self) -> &Path {
        self.terminal.path()
    }

    /// Its client.
    pub fn clients(&self) -> &Clients {
        &self.clients
    }
}

impl Drop for SerialBridge {
    fn drop(&mut self) {
        self.clients.0.close();
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // A panic in it has been reported on stderr already.
            let _ = thread.join();
        }
    }
}

/// One program after the other, until the hub is closed.
fn serve_programs(hub: &Hub, terminal: &Arc<Terminal>) {
    while !hub.is_closed() {
        // A terminal that cannot be asked is as one that nobody uses.
        if !terminal.is_in_use().unwrap_or(false) {
            thread::park_timeout(LOOK_INTERVAL);
            continue;
        }
        let line = Arc::new(TerminalLine::new(terminal.clone()));
        let outbox = Arc::new(ClientQueue::new(hub.queue()));
        // It has been closed just now where there is no room.
        let Some(id) = hub.join(Connection::Terminal(line.clone()), outbox.clone()) else { return };
        let session = Session::new(BridgeProtocol::Slcan);
        serve(hub, id, &Connection::Terminal(line), session, &outbox);
    }
}
