//! A published service as a service of this host: each connection speaks the protocol of the socket.

use std::io;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use ecan_service::client::{Client, ClientError};
use zenoh::query::{ConsolidationMode, QueryTarget, Reply};
use zenoh::{Config, Session, Wait as _};

use crate::keys::{Keys, PublisherClock, PublisherInfo};
use crate::publication::{PublicationError, read};
use crate::remote_connection::RemoteConnection;
use crate::remote_request::check_name;

/// Time for the publishers to answer.
const FIND: Duration = Duration::from_secs(5);
/// Without a configuration: the router of this host, at the port of Zenoh.
const LOCAL_ROUTER: &str = "{ mode: 'client', connect: { endpoints: ['tcp/127.0.0.1:7447'] }, \
                            scouting: { multicast: { enabled: false } } }";

/// A service that [`Publication`](crate::Publication) publishes on another host.
///
/// A [`Client`] of it works as one of the socket, with these differences: images are not available; a request
/// that acts, and a frame, is late after 10 s; the publisher limits what remote clients may do. When the publisher
/// ends, or its service does not respond, the connection ends.
#[derive(Debug)]
pub struct RemoteService {
    session: Session,
    keys: Keys,
    client: String,
}

impl RemoteService {
    /// Opens a session with a configuration file of Zenoh, as
    /// [`Publication::open`](crate::Publication::open); without one with the router of this host. The publisher
    /// knows this program by the name `client`: 1 to 64 letters, digits and `-_.@`.
    ///
    /// # Errors
    /// The file or the name is wrong, or the session does not open.
    pub fn open(file: Option<&Path>, keys: Keys, client: &str) -> Result<Self, PublicationError> {
        check_name("client", client)
            .map_err(|error| PublicationError::ClientName { reason: error.message })?;
        let opening = |error: zenoh::Error| PublicationError::open(&error);
        let config = match file {
            Some(file) => read(file)?.0,
            None => Config::from_json5(LOCAL_ROUTER).map_err(opening)?,
        };
        let session = zenoh::open(config).wait().map_err(opening)?;
        Ok(Self { session, keys, client: client.to_owned() })
    }

    /// Connects to the publisher and introduces the client under `name`.
    ///
    /// # Errors
    /// [`ClientError::Connect`] if not exactly one publisher answers; as [`Client::connect`].
    pub fn connect(&self, name: &str) -> Result<Client, ClientError> {
        let failed = |source: io::Error| ClientError::Connect {
            path: format!("zenoh:{}", self.keys.prefix()).into(),
            source: Arc::new(source),
        };
        let (info, clock) = self.find_publisher().map_err(failed)?;
        let (near, far) = UnixStream::pair()?;
        let (session, keys, client) =
            (self.session.clone(), self.keys.clone(), self.client.clone());
        let connection = RemoteConnection::new((session, keys, client), info, clock, &far)
            .map_err(|error| failed(io::Error::other(error.to_string())))?;
        let thread = thread::Builder::new().name("ecan remote".into());
        thread.spawn(move || connection.serve(far))?;
        Client::on(near, name)
    }

    fn find_publisher(&self) -> io::Result<(PublisherInfo, PublisherClock)> {
        let get = self.session.get(self.keys.publisher("*"));
        let get = get.target(QueryTarget::All).consolidation(ConsolidationMode::None).timeout(FIND);
        let replies = get.wait().map_err(|error| io::Error::other(error.to_string()))?;
        let info = |reply: Reply| {
            let sample = reply.into_result().ok()?;
            serde_json::from_slice::<PublisherInfo>(&sample.payload().to_bytes()).ok()
        };
        let mut found = replies.into_iter().filter_map(info);
        let text = match (found.next(), found.next()) {
            (Some(info), None) => {
                let clock = PublisherClock::new(&info, Instant::now());
                return Ok((info, clock));
            }
            (None, _) => {
                "no publisher answers; start ecan zenoh on its host, check the prefix and the \
                 configuration of Zenoh"
            }
            _ => "several publishers use the prefix; give each one a --prefix of its own",
        };
        Err(io::Error::other(text))
    }
}
