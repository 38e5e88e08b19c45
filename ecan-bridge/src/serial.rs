//! slcan on a pseudo-terminal.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::thread::{self, JoinHandle};

use crate::clients::Clients;
use crate::connection::Connection;
use crate::hub::Hub;
use crate::outbox::Outbox;
use crate::server::serve;
use crate::session::Session;
use crate::settings::BridgeProtocol;
use crate::terminal::Terminal;

/// A pseudo-terminal behind which there seems to be an slcan adapter: one client, whichever program
/// opens it. Dropping it ends its thread.
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
        let connection = Connection::Terminal(terminal.clone());
        let outbox = Arc::new(Outbox::new(hub.queue()));
        let id = hub.join(connection.try_clone()?, outbox.clone());
        let clients = Clients(hub.clone());
        // A new hub has room for one.
        let id = id.ok_or(io::ErrorKind::ConnectionRefused)?;
        let session = Session::new(BridgeProtocol::Slcan);
        let thread = thread::Builder::new()
            .name("bridge terminal".to_owned())
            .spawn(move || serve(&hub, id, &connection, session, &outbox))?;
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
            // A panic in it has been reported on stderr already.
            let _ = thread.join();
        }
    }
}
