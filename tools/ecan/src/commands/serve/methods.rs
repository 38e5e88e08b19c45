//! Methods that `ecan serve` adds to its service: `reconfigure`, which checks a configuration on a worker of
//! the service and hands it over to the thread of the cycle, and those of a simulated machine.

use std::path::PathBuf;
use std::sync::mpsc::{Sender, SyncSender, sync_channel};
use std::sync::{Mutex, TryLockError};

use ecan_mcan_port::{Config, PortConfig};
use ecan_protocol::text::Printable;
use ecan_service::client::{Access, BUS_ERROR, BUSY, INVALID_PARAMS, NOT_AVAILABLE, RpcError};
use ecan_service::server::{Extension, Permission, parse_params, result_value};
use ecan_sim::{Backend, Simulation};
use serde_json::{Value, json};

use crate::commands::sim::{
    FAULT_METHOD, FAULTS_METHOD, FaultList, FaultReport, STATUS_METHOD, SimulationStatus,
};
use crate::config_changes::{ConfigText, METHOD, ReadyGateway, Report};
use crate::context::{Bus, Failure, GlobalOptions, Result};
use crate::frames::{GatewayRequirements, Planned, of_whole_file};

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
                .map(|fault| json!({ "line": fault.line, "column": fault.column, "reason": fault.reason }));
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

#[derive(Debug)]
pub struct SimulationMethods {
    simulation: Simulation,
}

impl SimulationMethods {
    pub fn new(simulation: &Simulation) -> Self {
        Self { simulation: simulation.clone() }
    }

    fn inject(&self, params: &Value, access: &Permission) -> Result<Value, RpcError> {
        access.need_control(FAULT_METHOD)?;
        let fault = parse_params(FAULT_METHOD, params)?;
        let effect = self.simulation.execute(&fault);
        let effect = effect.map_err(|error| RpcError::new(INVALID_PARAMS, error.to_string()))?;
        result_value(&FaultReport::from(&effect))
    }
}

impl Extension for SimulationMethods {
    fn access(&self, method: &str) -> Option<Access> {
        match method {
            FAULT_METHOD => Some(Access::Control),
            FAULTS_METHOD | STATUS_METHOD => Some(Access::Read),
            _ => None,
        }
    }

    fn call(
        &self,
        method: &str,
        params: &Value,
        access: &Permission,
    ) -> Option<Result<Value, RpcError>> {
        match method {
            FAULT_METHOD => Some(self.inject(params, access)),
            FAULTS_METHOD => Some(result_value(&FaultList::of(&self.simulation))),
            STATUS_METHOD => Some(result_value(&SimulationStatus::of(&self.simulation))),
            _ => None,
        }
    }
}
