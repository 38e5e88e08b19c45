//! The application of a trial, in Rust or C.

use ecan_mcan_port::{Config, Port, SlaveStatistics};

use crate::c_application::CApplication;
use crate::master_owner::Connection;

/// The application that has the Port.
pub enum Application {
    Rust(Box<Connection>),
    C(CApplication),
}

impl Application {
    /// Waits until all gateways are ready.
    pub fn wait_ready(&mut self) -> Result<(), String> {
        match self {
            Self::Rust(connection) => connection.wait_ready(),
            Self::C(application) => application.wait_ready(),
        }
    }

    /// The Port of a Rust application.
    pub fn port(&mut self) -> Option<&mut Port> {
        match self {
            Self::Rust(connection) => Some(&mut connection.port),
            Self::C(_) => None,
        }
    }

    /// Configures the master again, and waits until all gateways are ready.
    pub fn reconfigure(&mut self, config: Config) -> Result<(), String> {
        match self {
            Self::Rust(connection) => connection
                .port
                .reconfigure(config)
                .and_then(|()| connection.port.wait_ready())
                .map_err(|error| error.to_string()),
            Self::C(application) => application.reconfigure(&config),
        }
    }

    pub fn discard_pending(&mut self, slave: usize) -> Result<(), String> {
        match self {
            Self::Rust(connection) => {
                let gateway = connection.port.gateway(slave).map_err(|error| error.to_string())?;
                connection.port.discard_pending(gateway);
                Ok(())
            }
            Self::C(application) => application.discard_pending(slave),
        }
    }

    /// Returns whether all slaves are in operation.
    pub fn is_ready(&mut self) -> bool {
        match self {
            Self::Rust(connection) => connection.port.is_ready() && connection.has_io(),
            Self::C(application) => application.is_ready(),
        }
    }

    /// State of the gateways.
    pub fn status(&mut self) -> String {
        match self {
            Self::Rust(connection) => connection.status(),
            Self::C(application) => application.status(),
        }
    }

    /// Returns whether a gateway waits for another attempt of its startup.
    pub fn waits_for_startup(&mut self) -> bool {
        match self {
            Self::Rust(connection) => connection.waits_for_startup(),
            Self::C(application) => application.waits_for_startup(),
        }
    }

    /// Requests the startup of all slaves that are not in OP.
    pub fn retry_startup(&mut self) {
        match self {
            Self::Rust(connection) => connection.retry_startup(),
            Self::C(application) => application.retry_startup(),
        }
    }

    pub fn statistics(&mut self, slave: usize) -> Result<SlaveStatistics, String> {
        match self {
            Self::Rust(connection) => {
                let gateway = connection.port.gateway(slave).map_err(|error| error.to_string())?;
                Ok(connection.port.statistics(gateway))
            }
            Self::C(application) => application.statistics(slave),
        }
    }
}
