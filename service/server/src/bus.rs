//! The bus as the sessions see it.

use std::sync::Arc;

use ecan_host::Clock;
use ecan_protocol::can::{CanFrame, CanId};
use ecan_service_protocol::{
    Empty, Hello, INVALID_PARAMS, Method, NOT_AVAILABLE, NmtParams, RejectReason, Request,
    RpcError, ServiceStats, TransmitRecord, methods,
};
use serde_json::Value;

use crate::attachment::Attachment;
use crate::extension::{Permission, result_value};
use crate::frame_feed::Owner;
use crate::metrics::{MetricsSample, ObjectValues};
use crate::session::{ClientId, Host, parameters};
use crate::workers::{Job, Workers};

/// Owner of frames that the service queues; no client has this number.
const SERVICE_OWNER: Owner = (0, 0);

/// Bus, cycle and workers of a service.
pub(crate) struct Bus {
    /// Response to `hello`.
    pub(crate) hello: Hello,
    pub(crate) cycle: Option<Box<Attachment>>,
    pub(crate) clock: Arc<dyn Clock>,
    pub(crate) workers: Workers,
    /// As of the start of the requests that are executed now.
    pub(crate) stats: ServiceStats,
}

impl Bus {
    pub(crate) fn set_cycle(&mut self, cycle: Option<Box<Attachment>>) {
        self.hello.cycle_ns = cycle.as_ref().map(|cycle| cycle.cycle_ns);
        self.hello.gateways = cycle.as_ref().map_or_else(Vec::new, |it| it.gateways.clone());
        self.cycle = cycle;
    }

    /// Values of the metrics, except those that are read from the EtherCAT bus.
    pub(crate) fn metrics_sample(&mut self, stats: ServiceStats, clients: usize) -> MetricsSample {
        let attached = self.cycle.as_deref_mut();
        let adapter = attached.as_ref().map(|cycle| cycle.adapter);
        let cycle = attached.and_then(|cycle| cycle.view.cycle_sample(cycle.cycle_ns));
        let (hello, objects) = (self.hello.clone(), ObjectValues::new());
        MetricsSample { hello, stats, clients, cycle, bus: None, adapter, objects }
    }

    fn attached(&mut self) -> Result<&mut Attachment, RpcError> {
        self.cycle.as_deref_mut().ok_or_else(|| {
            let text = "the service has no cycle; start one, for example with a configuration";
            RpcError::new(NOT_AVAILABLE, text)
        })
    }

    fn nmt(&mut self, request: &Request) -> Result<Value, RpcError> {
        let NmtParams { gateway, channel, node, command } = parameters(request)?;
        if node > 127 {
            let text =
                format!("node-ID {node} is out of range; allowed: 1 to 127, 0 for all nodes");
            return Err(RpcError::new(INVALID_PARAMS, text));
        }
        let frame = CanId::standard(0)
            .and_then(|id| CanFrame::classic(id, &[command.specifier(), node]))
            .map_err(|error| RpcError::new(INVALID_PARAMS, error.to_string()))?;
        let feed = &mut self.attached()?.feed;
        feed.transmit(SERVICE_OWNER, gateway, channel, &frame).map_err(|reason| {
            let text = format!(
                "NMT command for gateway {gateway} channel {channel} was rejected: {reason}"
            );
            RpcError::new(NOT_AVAILABLE, text)
        })?;
        result_value(&Empty {})
    }
}

impl Host for Bus {
    fn hello(&self) -> Hello {
        self.hello.clone()
    }

    fn call(
        &mut self,
        client: ClientId,
        permission: &Permission,
        request: &Request,
    ) -> Option<Result<Value, RpcError>> {
        Some(match request.method.as_str() {
            methods::ReadState::NAME => self.attached().and_then(|cycle| {
                let cycle_ns = cycle.cycle_ns;
                result_value(&cycle.view.state(cycle_ns)?)
            }),
            methods::ReadAxes::NAME => {
                self.attached().and_then(|cycle| result_value(&cycle.view.axes()?))
            }
            methods::ReadConfig::NAME => {
                self.attached().and_then(|cycle| result_value(&cycle.config))
            }
            methods::ReadServiceStats::NAME => result_value(&self.stats),
            methods::SendNmt::NAME => self.nmt(request),
            _ => {
                let (permission, request) = (permission.clone(), request.clone());
                self.workers.submit(Job { client, permission, request });
                return None;
            }
        })
    }

    fn transmit(&mut self, client: ClientId, record: &TransmitRecord) -> Result<(), RejectReason> {
        let TransmitRecord { gateway, channel, tag, ref frame } = *record;
        let Some(cycle) = &mut self.cycle else { return Err(RejectReason::NoSuchChannel) };
        cycle.feed.transmit((client, tag), gateway, channel, frame)
    }

    fn begin_stream(&mut self) {
        if let Some(cycle) = &mut self.cycle {
            cycle.feed.activate();
        }
    }
}
