//! Method `reconfigure`: checks a configuration file on a worker of the service and hands it over to
//! the thread of the cycle.

use std::path::PathBuf;
use std::sync::mpsc::{Sender, sync_channel};
use std::sync::{Mutex, TryLockError};

use ecan_mcan_port::Config;
use ecan_service::client::{Access, BUSY, INVALID_PARAMS, NOT_AVAILABLE, RpcError};
use ecan_service::server::{Extension, Permission, parse_params, result_value};
use ecan_sim::Backend;
use serde_json::{Value, json};

use crate::context::{Bus, Failure, GlobalOptions, Result};
use crate::frames::{GatewayRequirements, Planned, of_whole_file};
use crate::reconfiguration::{ConfigText, METHOD, ReadyGateway, Report};

use super::command::{Command, Request};

impl Planned {
    /// Report of gateways that are ready with this configuration.
    pub fn report(&self, former: &Config, warnings: Vec<String>) -> Report {
        let config = Config::from((self.adapter, self.config));
        let ready =
            |(gateway, position): (usize, &usize)| ReadyGateway { position: *position, gateway };
        Report {
            gateways: self.positions.iter().enumerate().map(ready).collect(),
            changes: crate::config_changes::changes(former, &config),
            warnings,
        }
    }
}

#[derive(Debug)]
pub struct ReconfigureMethod {
    backend: Backend,
    master: u32,
    global: GlobalOptions,
    /// Locked during a call: there is one at a time.
    commands: Mutex<Sender<Command>>,
}

impl ReconfigureMethod {
    /// The method, which sends its commands to the thread of the cycle.
    pub fn new(
        backend: &Backend,
        master: u32,
        global: &GlobalOptions,
        commands: Sender<Command>,
    ) -> Self {
        let (backend, global) = (backend.clone(), global.clone());
        Self { backend, master, global, commands: Mutex::new(commands) }
    }

    fn reconfigure(&self, config: &ConfigText) -> Result<Report, RpcError> {
        let commands = match self.commands.try_lock() {
            Ok(commands) => commands,
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(TryLockError::WouldBlock) => {
                let text = "another reconfiguration is in progress; call again when it has ended";
                return Err(RpcError::new(BUSY, text));
            }
        };
        let file = config.parse().map_err(|faults| {
            let listed = faults.0.iter();
            let listed = listed
                .map(|it| json!({ "line": it.line, "column": it.column, "reason": it.reason }));
            let data = json!({ "kind": "faults", "faults": listed.collect::<Vec<_>>() });
            let message = format!("{}: {faults}; nothing was changed", config.name);
            RpcError { data, ..RpcError::new(INVALID_PARAMS, message) }
        })?;
        let path = PathBuf::from(&config.name);
        let planned = self.plan(&path, &file).map_err(|error| {
            let message = format!("{}: {error}; nothing was changed", config.name);
            RpcError::new(INVALID_PARAMS, message)
        })?;
        let ends = |_| RpcError::new(NOT_AVAILABLE, "the service ends; nothing is configured");
        let (reply, result) = sync_channel(1);
        let request = Request { path, file, planned, reply };
        let command = Command::Reconfigure(Box::new(request));
        commands.send(command).map_err(|_| ends(()))?;
        result.recv().map_err(|_| ends(()))?
    }

    /// Finds the gateways of the file and checks the whole configuration.
    fn plan(&self, path: &std::path::Path, file: &Config) -> Result<Planned> {
        let bus = Bus::of(&self.backend, self.master, None)?;
        let planned =
            of_whole_file(path, file, &bus, GatewayRequirements::of_service(), &self.global)?;
        let found = planned.adapter.master_index;
        if found != self.master {
            return Err(Failure::Usage(format!(
                "the file selects master {found}; this service holds master {}",
                self.master
            )));
        }
        let checked = Config::from((planned.adapter, planned.config)).check();
        checked.map_err(|faults| Failure::Usage(faults.to_string()))?;
        Ok(planned)
    }
}

impl Extension for ReconfigureMethod {
    fn access(&self, method: &str) -> Option<Access> {
        (method == METHOD).then_some(Access::Control)
    }

    fn call(
        &self,
        method: &str,
        params: &Value,
        access: &Permission,
    ) -> Option<Result<Value, RpcError>> {
        (method == METHOD).then(|| {
            access.need_control(method)?;
            let config: ConfigText = parse_params(METHOD, params)?;
            result_value(&self.reconfigure(&config)?)
        })
    }
}
