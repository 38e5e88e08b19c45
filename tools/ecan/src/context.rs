//! Options and output of a command, and its way to the bus: the library, or the service of a program that holds
//! the master.

use std::io::ErrorKind;
use std::path::PathBuf;
use std::sync::Once;

use ecan_lite::EcrtOptions;
use ecan_service::client::ClientError;
use ecan_sim::{Backend, BackendError, ClockKind, EcrtSetting, SimOptions};

pub use crate::bus::Bus;
pub use crate::failure::{Failure, Result};
pub use crate::global::GlobalOptions;
use crate::global::Via;
use crate::output::set_simulated;
pub use crate::output::{FullScreen, Output, Tone, note};
use crate::service_access::{ServiceAddress, ServiceConnection};

#[derive(Clone, Copy, Debug)]
pub struct Context<'a> {
    pub global: &'a GlobalOptions,
    pub output: Output,
}

impl Context<'_> {
    /// Opens the bus through a service, or the library and the master; reports a service or a
    /// simulation on standard error.
    pub fn bus(&self) -> Result<Bus> {
        self.bus_of_master(self.global.master(), ClockKind::Stepped, EcrtOptions::default())
    }

    /// As [`bus`](Self::bus), with the default clock of a simulation, and what a plain `sim` has.
    pub fn bus_of_master(
        &self,
        master: u32,
        clock: ClockKind,
        options: EcrtOptions,
    ) -> Result<Bus> {
        if let Some(connection) = connect(self.global, master)? {
            return Bus::of_service(connection, self.global.slave);
        }
        let backend = self.backend_with(&self.setting()?, clock, options)?;
        Bus::of(&backend, master, self.global.slave)
    }

    /// Redirects the output to standard error if standard output is in use.
    pub fn on_stderr(&self, is_stdout_used: bool) -> Self {
        Self { output: self.output.on_stderr(is_stdout_used), ..*self }
    }

    pub fn setting(&self) -> Result<EcrtSetting> {
        let setting = EcrtSetting::resolve(self.global.ecrt.as_deref());
        setting.map_err(|error| BackendError::from(error).into())
    }

    /// Loads the library, with the clock of a scenario that names none; reports a simulation.
    pub fn backend(
        &self,
        setting: &EcrtSetting,
        clock: ClockKind,
    ) -> Result<Backend, BackendError> {
        self.backend_with(setting, clock, EcrtOptions::default())
    }

    /// As [`backend`](Self::backend), with what a plain `sim` has.
    pub fn backend_with(
        &self,
        setting: &EcrtSetting,
        clock: ClockKind,
        EcrtOptions { simulation, .. }: EcrtOptions,
    ) -> Result<Backend, BackendError> {
        let bridges = Some(ecan_sim::bridge::make as ecan_sim::BridgeFactory);
        let options = SimOptions { clock: Some(clock), bridges, ..simulation };
        let backend = ecan_sim::open(setting, &options)?;
        set_simulated(backend.ecrt.is_simulated());
        if let Some(simulation) = &backend.simulation {
            // A search for bit rates opens a simulation for each of them.
            static BANNER: Once = Once::new();
            BANNER.call_once(|| note(simulation.banner()));
            simulation.observe_faults(|record| note(record));
        }
        if let Some(warning) = backend.ecrt.release_warning() {
            static WARNING: Once = Once::new();
            WARNING.call_once(|| note(warning));
        }
        Ok(backend)
    }
}

/// Connects to the service of a master; `None` for the library. Reports the service on standard
/// error.
pub fn connect(global: &GlobalOptions, master: u32) -> Result<Option<ServiceConnection>> {
    let connection = open(global, master)?;
    connection.iter().for_each(note);
    Ok(connection)
}

/// As [`connect`], without a report.
pub fn open(global: &GlobalOptions, master: u32) -> Result<Option<ServiceConnection>> {
    if global.via.is_service() && global.ecrt.is_some() {
        let message = "--ecrt and a service exclude each other; use --via direct";
        return Err(Failure::Usage(message.to_owned()));
    }
    let address = match &global.via {
        Via::Service(path) => Some(ServiceAddress::Socket(path.clone())),
        #[cfg(feature = "zenoh")]
        Via::Remote(keys) => Some(crate::service_access::remote_service(keys)?),
        Via::Auto | Via::Direct => None,
    };
    let connection = match address {
        Some(address) => {
            let client = address.connect("ecan").map_err(|error| failure(&address, &error))?;
            Some(ServiceConnection::new(client, address))
        }
        None if global.via == Via::Auto && global.ecrt.is_none() => find(&default_paths(master)),
        None => None,
    };
    let Some(connection) = connection else { return Ok(None) };
    set_simulated(connection.hello().is_simulated);
    let found = connection.hello().master;
    if found != master && (global.master.is_some() || global.via == Via::Auto) {
        let address = connection.address();
        return Err(Failure::Usage(format!(
            "{address} serves master {found}, not master {master}; set --master or --via"
        )));
    }
    global.given.check_with_service(&connection.program())?;
    Ok(Some(connection))
}

/// Default sockets of a service of this master: of the system, and of the user if it has a directory.
pub fn default_paths(master: u32) -> Vec<PathBuf> {
    let name = format!("ecan/master{master}.sock");
    let user = std::env::var_os("XDG_RUNTIME_DIR").filter(|directory| !directory.is_empty());
    std::iter::once(PathBuf::from("/run"))
        .chain(user.map(PathBuf::from))
        .map(|directory| directory.join(&name))
        .collect()
}

/// The first service that responds. One that exists and cannot be used is reported.
fn find(paths: &[PathBuf]) -> Option<ServiceConnection> {
    paths.iter().find_map(|path| {
        let address = ServiceAddress::Socket(path.clone());
        match address.connect("ecan") {
            Ok(client) => Some(ServiceConnection::new(client, address)),
            Err(error) => {
                match kind(&error) {
                    Some(ErrorKind::NotFound | ErrorKind::ConnectionRefused) => {}
                    _ => note(format_args!("service not used: {}", failure(&address, &error))),
                }
                None
            }
        }
    })
}

fn kind(error: &ClientError) -> Option<ErrorKind> {
    match error {
        ClientError::Connect { source, .. } => Some(source.kind()),
        _ => None,
    }
}

fn failure(address: &ServiceAddress, error: &ClientError) -> Failure {
    let action = match kind(error) {
        Some(ErrorKind::NotFound) => "start the service (ecan serve), or use --via direct",
        Some(ErrorKind::ConnectionRefused) => {
            "no program listens there; start the service (ecan serve), or use --via direct"
        }
        Some(ErrorKind::PermissionDenied) => "add the user to the group of the socket (ls -l)",
        Some(ErrorKind::InvalidInput) => "allowed: at most 107 bytes",
        // The error names the address.
        Some(_) => return Failure::master(error),
        None => return Failure::Master(format!("service at {address}: {error}")),
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
            let address = ServiceAddress::Socket(path);
            let error = address.connect("test").unwrap_err();
            let failure = failure(&address, &error);
            let text = failure.to_string();
            assert!(text.contains(words) && text.contains("--via direct"), "{text}");
            assert_eq!(failure.status(), 3);
        }
    }
}
