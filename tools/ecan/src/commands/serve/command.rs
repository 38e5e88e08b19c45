//! Commands to the thread of the cycle.

use std::path::PathBuf;
use std::sync::mpsc::SyncSender;

use ecan_mcan_port::{Config, PortConfig};
use ecan_protocol::text::Printable;
use ecan_service::client::{BUS_ERROR, RpcError};
use serde_json::json;

use crate::context::{Failure, Result};
use crate::frames::Planned;
use crate::reconfiguration::Report;

/// Command to the thread of the cycle.
#[derive(Debug)]
pub enum Command {
    Reconfigure(Box<Request>),
    /// Host settings of the same gateways.
    Limits(Box<PortConfig>),
}

/// A configuration for the thread of the cycle, checked and with its gateways on the bus.
#[derive(Debug)]
pub struct Request {
    pub path: PathBuf,
    pub file: Config,
    pub planned: Planned,
    pub reply: SyncSender<Result<Report, RpcError>>,
}

/// Error of a configuration that failed on the gateways.
#[derive(Debug)]
pub struct NotConfigured {
    pub cause: Failure,
    /// Result of the return to the former configuration.
    pub restored: Result,
}

impl Request {
    /// Ends the call.
    pub fn reply(self, result: Result<Report, &NotConfigured>) {
        let result = result.map_err(|NotConfigured { cause, restored }| {
            let end = match restored {
                Ok(()) => "the former configuration is active again".to_owned(),
                Err(error) => format!(
                    "the former configuration is not active again: {error}; the service tries again"
                ),
            };
            let data = json!({ "kind": "reconfiguration", "is_restored": restored.is_ok() });
            let message = format!("{}: {cause}; {end}", Printable(self.path.display()));
            RpcError { data, ..RpcError::new(BUS_ERROR, message) }
        });
        // The client may have gone.
        let _ = self.reply.send(result);
    }
}
