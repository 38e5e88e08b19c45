//! Methods of the service that change a simulated machine.

use ecan_service::{Extension, Permission};
use ecan_service_client::{INVALID_PARAMS, RpcError};
use ecan_sim::{FaultDescription, Simulation};
use serde_json::{Value, json};

/// Method that injects a fault, or schedules it. Its parameters are the keys of a `[[fault]]` of a
/// scenario file.
const FAULT: &str = "sim.fault";

#[derive(Debug)]
pub struct SimulationMethods {
    simulation: Simulation,
}

impl SimulationMethods {
    /// Methods for this simulation; prints each fault that takes effect.
    pub fn new(simulation: &Simulation) -> Self {
        Self { simulation: simulation.clone() }
    }
}

impl Extension for SimulationMethods {
    fn call(
        &self,
        method: &str,
        params: &Value,
        access: &Permission,
    ) -> Option<Result<Value, RpcError>> {
        (method == FAULT).then(|| {
            access.need_control(method)?;
            let invalid = |text: String| RpcError::new(INVALID_PARAMS, text);
            let fault: FaultDescription = serde_json::from_value(params.clone())
                .map_err(|error| invalid(format!("{FAULT}: {error}")))?;
            let fault = self.simulation.execute(&fault);
            let fault = fault.map_err(|error| invalid(format!("{FAULT}: {error}")))?;
            Ok(json!({ "fault": fault.to_string() }))
        })
    }
}
