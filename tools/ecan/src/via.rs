//! Connection to the service of a program that holds the master.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use ecan_protocol::text::Printable;
use ecan_service::client::{Client, ClientError};

use crate::failure::{Failure, Result};
use crate::global::GlobalOptions;
use crate::output::note;
use crate::service_access::ServiceConnection;
use crate::via_option::Via;

/// Connects to the service of a master; `None` for the library. Reports the service on standard
/// error.
pub fn connect(global: &GlobalOptions, master: u32) -> Result<Option<ServiceConnection>> {
    let connection = open(global, master)?;
    connection.iter().for_each(note);
    Ok(connection)
}

/// As [`connect`], without a report.
pub fn open(global: &GlobalOptions, master: u32) -> Result<Option<ServiceConnection>> {
    let connection = match &global.via {
        Via::Service(_) if global.ecrt.is_some() => {
            let message = "--ecrt and a service exclude each other; use --via direct";
            return Err(Failure::Usage(message.to_owned()));
        }
        Via::Service(path) => {
            let client = Client::connect(path, "ecan").map_err(|error| failure(path, &error))?;
            Some(ServiceConnection::new(client, path))
        }
        Via::Auto if global.ecrt.is_none() => find(&default_paths(master)),
        Via::Auto | Via::Direct => None,
    };
    let Some(connection) = connection else { return Ok(None) };
    let found = connection.hello().master;
    if found != master && (global.master.is_some() || global.via == Via::Auto) {
        let path = Printable(connection.path().display());
        return Err(Failure::Usage(format!(
            "{path} serves master {found}, not master {master}; set --master or --via"
        )));
    }
    global.given.check_with_service(&connection.program())?;
    Ok(Some(connection))
}

/// Default sockets of a service of this master: of the system, and of the user if it has a directory.
pub fn default_paths(master: u32) -> Vec<PathBuf> {
    let name = format!("ecan/master{master}.sock");
    let user = std::env::var_os("XDG_RUNTIME_DIR").filter(|it| !it.is_empty());
    std::iter::once(PathBuf::from("/run"))
        .chain(user.map(PathBuf::from))
        .map(|directory| directory.join(&name))
        .collect()
}

/// The first service that responds. One that exists and cannot be used is reported.
fn find(paths: &[PathBuf]) -> Option<ServiceConnection> {
    paths.iter().find_map(|path| match Client::connect(path, "ecan") {
        Ok(client) => Some(ServiceConnection::new(client, path)),
        Err(error) => {
            match kind(&error) {
                Some(ErrorKind::NotFound | ErrorKind::ConnectionRefused) => {}
                _ => note(format_args!("service not used: {}", failure(path, &error))),
            }
            None
        }
    })
}

fn kind(error: &ClientError) -> Option<ErrorKind> {
    match error {
        ClientError::Connect { source, .. } => Some(source.kind()),
        _ => None,
    }
}

fn failure(path: &Path, error: &ClientError) -> Failure {
    let path = Printable(path.display());
    let action = match kind(error) {
        Some(ErrorKind::NotFound) => "start the service (ecan serve), or use --via direct",
        Some(ErrorKind::ConnectionRefused) => {
            "no program listens there; start the service (ecan serve), or use --via direct"
        }
        Some(ErrorKind::PermissionDenied) => "add the user to the group of the socket (ls -l)",
        Some(ErrorKind::InvalidInput) => "allowed: at most 107 bytes",
        _ => return Failure::Master(format!("service at {path}: {error}")),
    };
    Failure::Master(format!("{error}; {action}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_and_dead_sockets_are_not_services() {
        let directory = tempfile::tempdir().unwrap();
        let (missing, dead) = (directory.path().join("none"), directory.path().join("dead"));
        drop(std::os::unix::net::UnixListener::bind(&dead).unwrap());
        assert!(find(&[missing.clone(), dead.clone()]).is_none());
        for (path, words) in [(missing, "start the service"), (dead, "no program listens")] {
            let error = Client::connect(&path, "test").unwrap_err();
            let failure = failure(&path, &error);
            let text = failure.to_string();
            assert!(text.contains(words) && text.contains("--via direct"), "{text}");
            assert_eq!(failure.status(), 3);
        }
    }
}
