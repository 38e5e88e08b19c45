//! Methods of the service for a simulated machine.

use ecan_service::{Extension, Permission};
use ecan_service_client::{INTERNAL_ERROR, INVALID_PARAMS, RpcError};
use ecan_sim::Simulation;
use serde::Serialize;
use serde_json::Value;

use crate::commands::sim::{
    FAULT_METHOD, FAULTS_METHOD, FaultList, FaultReport, STATUS_METHOD, SimulationStatus,
};

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
        let invalid = |text: String| RpcError::new(INVALID_PARAMS, text);
        let fault = serde_json::from_value(params.clone());
        let fault = fault.map_err(|error| invalid(format!("{FAULT_METHOD}: {error}")))?;
        let effect = self.simulation.execute(&fault);
        let effect = effect.map_err(|error| invalid(error.to_string()))?;
        json(&FaultReport::from(&effect))
    }
}

impl Extension for SimulationMethods {
    fn call(
        &self,
        method: &str,
        params: &Value,
        access: &Permission,
    ) -> Option<Result<Value, RpcError>> {
        match method {
            FAULT_METHOD => Some(self.inject(params, access)),
            FAULTS_METHOD => Some(json(&FaultList::of(&self.simulation))),
            STATUS_METHOD => Some(json(&SimulationStatus::of(&self.simulation))),
            _ => None,
        }
    }
}

fn json(result: &impl Serialize) -> Result<Value, RpcError> {
    serde_json::to_value(result).map_err(|error| RpcError::new(INTERNAL_ERROR, error.to_string()))
}
