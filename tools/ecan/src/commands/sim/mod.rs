//! `ecan sim`: the simulated machine of a running service.

mod fault;

use std::thread::sleep;
use std::time::{Duration, Instant};

use clap::{Args, Subcommand, ValueEnum};
use ecan_service::client::{INVALID_PARAMS, METHOD_NOT_FOUND};
use ecan_sim::{EcrtSetting, FaultKind};
use fault::FaultRequest;
pub use fault::{FaultList, FaultReport, SimulationStatus};
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::context;
use crate::context::{Context, Failure, Result};
use crate::service_access::ServiceConnection;

/// Method that injects or schedules a fault. Its parameters are the keys of a `[[fault]]` of a scenario
/// file.
pub const FAULT_METHOD: &str = "sim.fault";
/// Method that returns a [`FaultList`].
pub const FAULTS_METHOD: &str = "sim.faults";
/// Method that returns a [`SimulationStatus`].
pub const STATUS_METHOD: &str = "sim.status";

/// Longest wait for a gateway after its supply returns, and interval of its states.
const WAIT: Duration = Duration::from_secs(60);
const POLL: Duration = Duration::from_millis(20);

pub const EXAMPLES: &str = "\
Examples:
  ecan --ecrt sim:drives serve &               a simulated machine that stays alive
  ecan sim status
  ecan sim power cycle                         the gateway loses its supply for a second
  ecan sim power off --gateway 1               of several gateways
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
    #[command(allow_missing_positional = true)]
    Power {
        /// The index as the first argument.
        #[arg(value_name = "GATEWAY", hide = true, conflicts_with = "gateway")]
        index: Option<usize>,
        /// State of the supply; cycle: off, then on
        supply: Supply,
        /// Index of the gateway in the scenario [default: the only one]
        #[arg(long, value_name = "N")]
        gateway: Option<usize>,
        /// Time without supply of `cycle` [default: 1s]
        #[arg(long, value_name = "TIME", value_parser = fault::parse_time)]
        off: Option<Value>,
        /// Wait until the gateway is in OP again, or in PREOP if the service runs no cycle
        #[arg(long)]
        wait: bool,
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
        Action::Power { supply: Supply::Off, wait: true, .. } => {
            Err(Failure::Usage("--wait belongs to `on` and `cycle`".to_owned()))
        }
        Action::Power { index, gateway, supply, off, wait } => {
            let gateway = gateway.or(*index);
            let gateway_key = gateway.map(|gateway| ("gateway", Value::from(gateway)));
            let off = off.as_ref().map(|off| ("off_ms", off.clone()));
            let keys = gateway_key.into_iter().chain(off);
            let connection = connect(context)?;
            let report = inject(FaultRequest::new(supply.fault(), keys), &connection)?;
            if *wait {
                wait_for(gateway.unwrap_or(0), &connection)?;
            }
            output.data(&report, |out| report.print(out))
        }
        Action::Fault { fault } => {
            let report = inject(fault.clone(), &connect(context)?)?;
            output.data(&report, |out| report.print(out))
        }
        Action::Faults => {
            let faults: FaultList = call(FAULTS_METHOD, Value::Null, &connect(context)?)?;
            output.data(&faults, |out| faults.print(out))
        }
        Action::Status => {
            let status: SimulationStatus = call(STATUS_METHOD, Value::Null, &connect(context)?)?;
            output.data(&status, |out| status.print(out))
        }
    }
}

fn inject(fault: FaultRequest, connection: &ServiceConnection) -> Result<FaultReport> {
    call(FAULT_METHOD, fault.into_params(), connection)
}

/// Waits until a gateway is started.
fn wait_for(gateway: usize, connection: &ServiceConnection) -> Result {
    let has_cycle = connection.hello().cycle_ns.is_some();
    let end = Instant::now() + WAIT;
    loop {
        let status: SimulationStatus = call(STATUS_METHOD, Value::Null, connection)?;
        let Some(status) = status.gateways.get(gateway) else { return Ok(()) };
        if status.is_started(has_cycle) {
            return Ok(());
        }
        if Instant::now() > end {
            return Err(Failure::Rejected(format!(
                "gateway {gateway} has not started within {} s: {}; see `ecan diag`",
                WAIT.as_secs(),
                status.state()
            )));
        }
        sleep(POLL);
    }
}

fn call<T: DeserializeOwned>(
    method: &str,
    params: Value,
    connection: &ServiceConnection,
) -> Result<T> {
    let program = connection.program();
    let result = connection.client().call(method, params).map_err(|error| match error.rpc() {
        Some(rpc) if rpc.code == INVALID_PARAMS => Failure::Usage(rpc.to_string()),
        Some(rpc) if rpc.code == METHOD_NOT_FOUND => Failure::Master(format!(
            "{program} does not offer its simulation; use a machine of `ecan --ecrt sim serve`"
        )),
        _ => Failure::Device(connection.error("service", &error)),
    })?;
    let unreadable = |error| Failure::Master(format!("{program}: {method}: {error}"));
    serde_json::from_value(result).map_err(unreadable)
}

/// Connects to the service. `--ecrt sim` states what these commands require anyway.
fn connect(context: &Context) -> Result<ServiceConnection> {
    let mut global = context.global.clone();
    let is_library =
        |setting: &String| matches!(EcrtSetting::parse(setting), EcrtSetting::Library(_));
    global.ecrt = global.ecrt.filter(is_library);
    let connection = context::connect(&global, global.master())?.ok_or_else(|| {
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
