//! The bus of a service, and the connection of the service to the cycle of a Port.

use std::sync::Arc;
use std::time::{Duration, SystemTime};

use ecan_host::{AdapterConfig, Clock};
use ecan_mcan_port::{GatewayConfig, Port};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::image::OptionFlags;
use ecan_protocol::mapping::Direction;
use serde_json::Value;

use super::bus_calls::BusCall;
use super::bus_view::{BusView, EventLog, nanoseconds};
use super::config::{Permission, result_value};
use super::frame_feed::{FrameFeed, Owner};
use super::job_queue::{ClientId, Requester};
use super::metrics::{MetricsSample, ObjectValues};
use super::session::{Host, limit_error, no_such_method};
use super::workers::{Age, Job, Work, Workers, time_since_boot};
use crate::protocol::{
    Access, ActiveConfig, Channel, DEFAULT_MAX_AGE_MS, Empty, Gateway, Hello, INVALID_PARAMS,
    METHODS, Method, NOT_AVAILABLE, NmtParams, RawRequest, RecordedEvent, RecordedKind,
    RejectReason, RpcError, ServiceStats, TransmitRecord, methods,
};

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
    pub(crate) events: EventLog,
}

impl Bus {
    pub(crate) fn set_cycle(&mut self, cycle: Option<Box<Attachment>>) {
        self.hello.cycle_ns = cycle.as_ref().map(|cycle| cycle.cycle_ns);
        self.hello.gateways = cycle.as_ref().map_or_else(Vec::new, |cycle| cycle.gateways.clone());
        self.cycle = cycle;
    }

    /// Records an event of the service at the present time.
    pub(crate) fn record(&mut self, kind: RecordedKind, text: String) {
        let time_ns = self.clock.now_ns().wrapping_add(since_1970_ns(&*self.clock));
        self.events.push(RecordedEvent { time_ns, kind, text, ..Default::default() });
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

    fn nmt(&mut self, request: &RawRequest, age: Age) -> Result<Value, RpcError> {
        let NmtParams { gateway, channel, node, command } = request.params()?;
        if node > 127 {
            let text =
                format!("node-ID {node} is out of range; allowed: 1 to 127, 0 for all nodes");
            return Err(RpcError::new(INVALID_PARAMS, text));
        }
        let frame = CanId::standard(0)
            .and_then(|id| CanFrame::classic(id, &[command.specifier(), node]))
            .map_err(|error| RpcError::new(INVALID_PARAMS, error.to_string()))?;
        let expires_ns = self.expiry_ns(age.left().unwrap_or(Duration::MAX));
        let feed = &mut self.attached()?.feed;
        feed.transmit(SERVICE_OWNER, gateway, channel, &frame, expires_ns).map_err(|reason| {
            let text = format!(
                "NMT command for gateway {gateway} channel {channel} was rejected: {reason}"
            );
            RpcError::new(NOT_AVAILABLE, text)
        })?;
        result_value(&Empty {})
    }

    /// End of a time from now, on the clock of the cycle.
    fn expiry_ns(&self, left: Duration) -> u64 {
        self.clock.now_ns().saturating_add(nanoseconds(left))
    }

    /// Reads a request for a worker and checks it; a wrong one takes no place in a queue.
    fn work(&self, permission: &Permission, request: &RawRequest) -> Result<Work, RpcError> {
        let method = request.method.as_str();
        if let Some((extension, access)) = self.workers.extension(method) {
            if access == Access::Control {
                permission.need_control(method)?;
            }
            return Ok(Work::Extension(extension, request.clone()));
        }
        BusCall::read(request).unwrap_or_else(|| Err(no_such_method(method))).map(Work::Bus)
    }

    /// Access that a method needs.
    fn access(&self, method: &str) -> Access {
        let own = METHODS.iter().find(|(name, _)| *name == method).map(|(_, access)| *access);
        let of_program = || self.workers.extension(method).map(|(_, access)| access);
        own.or_else(of_program).unwrap_or_default()
    }
}

impl Host for Bus {
    fn hello(&self) -> Hello {
        self.hello.clone()
    }

    fn call(
        &mut self,
        requester: Requester,
        permission: &Permission,
        request: &RawRequest,
        arrival: Duration,
    ) -> Option<Result<Value, RpcError>> {
        let method = request.method.as_str();
        let age = Age::of(request, self.access(method), arrival);
        if let Err(error) = age.check(method) {
            return Some(Err(error));
        }
        Some(match method {
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
            methods::ReadServiceStats::NAME => {
                self.stats.requests_pending = self.workers.pending();
                result_value(&self.stats)
            }
            methods::ReadEvents::NAME => result_value(&self.events.recorded()),
            methods::SendNmt::NAME => self.nmt(request, age),
            _ => {
                let work = match self.work(permission, request) {
                    Ok(work) => work,
                    Err(error) => return Some(Err(error)),
                };
                let (permission, id) = (permission.clone(), request.id.clone());
                let job = Job { permission, id, method: method.into(), age, work };
                match self.workers.submit(requester, job) {
                    Ok(()) => return None,
                    Err(limit) => Err(limit_error(limit)),
                }
            }
        })
    }

    fn transmit(
        &mut self,
        client: ClientId,
        record: &TransmitRecord,
        arrival: Duration,
    ) -> Result<(), RejectReason> {
        let TransmitRecord { gateway, channel, tag, max_age_ms, ref frame } = *record;
        let max_age_ms = if max_age_ms == 0 { DEFAULT_MAX_AGE_MS } else { max_age_ms.into() };
        let age = time_since_boot().saturating_sub(arrival);
        let left = Duration::from_millis(max_age_ms.into()).saturating_sub(age);
        if left.is_zero() {
            return Err(RejectReason::Expired);
        }
        let expires_ns = self.expiry_ns(left);
        let Some(cycle) = &mut self.cycle else { return Err(RejectReason::NoSuchChannel) };
        cycle.feed.transmit((client, tag), gateway, channel, frame, expires_ns)
    }

    fn begin_stream(&mut self) {
        if let Some(cycle) = &mut self.cycle {
            cycle.feed.activate();
        }
    }
}

/// Parts of a service that belong to one configuration of a Port.
#[derive(Debug)]
pub(crate) struct Attachment {
    pub(crate) feed: FrameFeed,
    pub(crate) view: BusView,
    pub(crate) cycle_ns: u64,
    pub(crate) gateways: Vec<Gateway>,
    pub(crate) config: ActiveConfig,
    pub(crate) adapter: AdapterConfig,
}

impl Attachment {
    pub(crate) fn new(port: &mut Port, ring_bytes: usize, queue_depth: usize) -> Self {
        let stream = port.image_stream(ring_bytes);
        let queues = port.transmit_queues(queue_depth);
        let since_1970_ns = since_1970_ns(port.adapter().clock());
        let gateways = gateways(port.adapter().config(), &port.config().gateways);
        let has_results = gateways.iter().map(|gateway| gateway.has_results);
        let feed = FrameFeed::new(stream, queues, has_results, since_1970_ns);
        let view = BusView::new(&port.adapter().observer(), since_1970_ns);
        // infallible: plain data
        let config = ActiveConfig {
            adapter: serde_json::to_value(port.adapter().config()).unwrap_or_default(),
            port: serde_json::to_value(port.config()).unwrap_or_default(),
        };
        let cycle_ns = nanoseconds(port.adapter().config().cycle);
        let adapter = *port.adapter().config();
        Self { feed, view, cycle_ns, gateways, config, adapter }
    }
}

/// Offset of a clock to the time since 1970; 0 for stepped time.
fn since_1970_ns(clock: &dyn Clock) -> u64 {
    if !clock.is_free_running() {
        return 0;
    }
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    nanoseconds(since).wrapping_sub(clock.now_ns())
}

fn gateways<'a>(
    adapter: &AdapterConfig,
    gateways: impl IntoIterator<Item = &'a GatewayConfig>,
) -> Vec<Gateway> {
    let gateway = |(slave, config): (&ecan_host::SlaveConfig, &GatewayConfig)| Gateway {
        alias: slave.alias,
        position: slave.position,
        has_results: config.tx_options.contains(OptionFlags::TX_RESULT),
        channels: (0_u8..)
            .zip(&config.channels)
            .filter_map(|(channel, found)| {
                let can = &found.as_ref()?.can;
                Some(Channel {
                    channel,
                    bitrate: can.nominal_bitrate,
                    data_bitrate: can.fd.then_some(can.data_bitrate),
                    receives: config.carries(Direction::TxPdo, channel),
                    sends: config.carries(Direction::RxPdo, channel),
                })
            })
            .collect(),
    };
    adapter.slaves.iter().zip(gateways).map(gateway).collect()
}
