//! `ecan sim`: the simulated machine of a running service.

mod duration;
mod fault_report;
mod fault_request;
mod status;

use clap::{Args, Subcommand, ValueEnum};
use ecan_service_client::{INVALID_PARAMS, METHOD_NOT_FOUND};
use ecan_sim::FaultKind;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::context::{Context, Failure, Result};
use crate::service_access::ServiceConnection;
use crate::via;

use fault_request::FaultRequest;

pub use fault_report::{FaultList, FaultReport};
pub use status::SimulationStatus;

/// Method that injects or schedules a fault. Its parameters are the keys of a `[[fault]]` of a scenario
/// file.
pub const FAULT_METHOD: &str = "sim.fault";
/// Method that returns a [`FaultList`].
pub const FAULTS_METHOD: &str = "sim.faults";
/// Method that returns a [`SimulationStatus`].
pub const STATUS_METHOD: &str = "sim.status";

pub const EXAMPLES: &str = "\
Examples:
  ecan --ecrt sim:drives serve &               a simulated machine that stays alive
  ecan sim status
  ecan sim power 0 cycle                       gateway 0 loses its supply for a second
  ecan sim fault link-loss --for 300ms         at once
  ecan sim fault bus-off --channel 1 --after 2s
  ecan sim faults

The kinds of faults are those of scenario files, docs/SIMULATION.md.";

#[derive(Debug, Args)]
pub struct SimArguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Switch the supply of a gateway
    Power {
        /// Index of the gateway in the scenario
        gateway: usize,
        /// State of the supply; cycle: off, then on
        supply: Supply,
        /// Time without supply of `cycle` [default: 1s]
        #[arg(long, value_name = "TIME", value_parser = duration::parse)]
        off: Option<Value>,
    },
    /// Inject a fault, now or at a time
    #[command(after_help = "\
Times have a unit: 300ms, 2s, 1.5s, 1min. --gateway is not needed with one gateway.")]
    Fault {
        #[command(subcommand)]
        fault: FaultRequest,
    },
    /// List the last faults that took effect, and the scheduled ones
    Faults,
    /// Show the simulated machine: time, supply, cable and state of the gateways, nodes
    Status,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Supply {
    Off,
    On,
    Cycle,
}

impl Supply {
    fn fault(self) -> FaultKind {
        match self {
            Self::Off => FaultKind::PowerOff,
            Self::On => FaultKind::PowerOn,
            Self::Cycle => FaultKind::PowerCycle,
        }
    }
}

pub fn run(arguments: &SimArguments, context: &Context) -> Result {
    context.global.without_slave("gateways have their index in the scenario here")?;
    let output = &context.output;
    match &arguments.action {
        Action::Power { supply, off: Some(_), .. } if *supply != Supply::Cycle => {
            Err(Failure::Usage("--off belongs to `cycle`".to_owned()))
        }
        Action::Power { gateway, supply, off } => {
            let gateway = ("gateway", Value::from(*gateway));
            let off = off.as_ref().map(|off| ("off_ms", off.clone()));
            let keys = std::iter::once(gateway).chain(off);
            inject(FaultRequest::new(supply.fault(), keys), context)
        }
        Action::Fault { fault } => inject(fault.clone(), context),
        Action::Faults => {
            let faults: FaultList = call(FAULTS_METHOD, Value::Null, context)?;
            output.data(&faults, |out| faults.print(out))
        }
        Action::Status => {
            let status: SimulationStatus = call(STATUS_METHOD, Value::Null, context)?;
            output.data(&status, |out| status.print(out))
        }
    }
}

fn inject(fault: FaultRequest, context: &Context) -> Result {
    let report: FaultReport = call(FAULT_METHOD, fault.into_params(), context)?;
    context.output.data(&report, |out| writeln!(out, "{}", report.text))
}

fn call<T: DeserializeOwned>(method: &str, params: Value, context: &Context) -> Result<T> {
    let connection = connect(context)?;
    let program = connection.program();
    let result = connection.client().call(method, params).map_err(|error| match error.rpc() {
        Some(rpc) if rpc.code == INVALID_PARAMS => Failure::Usage(rpc.message.clone()),
        Some(rpc) if rpc.code == METHOD_NOT_FOUND => Failure::Master(format!(
            "{program} does not offer its simulation; use a machine of `ecan --ecrt sim serve`"
        )),
        _ => Failure::Device(connection.error("service", &error)),
    })?;
    let unreadable = |error| Failure::Master(format!("{program}: {method}: {error}"));
    serde_json::from_value(result).map_err(unreadable)
}

fn connect(context: &Context) -> Result<ServiceConnection> {
    let connection = via::connect(context.global, context.global.master())?.ok_or_else(|| {
        Failure::Master(
            "no service with a simulated machine; start `ecan --ecrt sim serve` (a simulation of \
             another command ends with it), or select its socket with --via"
                .to_owned(),
        )
    })?;
    match connection.hello().is_simulated {
        true => Ok(connection),
        false => Err(Failure::Master(format!(
            "{} holds a real bus; `ecan sim` changes simulated machines only",
            connection.program()
        ))),
    }
}
