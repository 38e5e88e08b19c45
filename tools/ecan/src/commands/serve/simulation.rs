//! Methods of the service for a simulated machine.

use ecan_service::client::{Access, INVALID_PARAMS, RpcError};
use ecan_service::server::{Extension, Permission, parse_params, result_value};
use ecan_sim::Simulation;
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
