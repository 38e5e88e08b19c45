//! The bus as the sessions see it: what requests do on it, and the latest state.

use super::bus_calls::BusCall;
use super::frame_feed::Owner;
use super::job_queue::Requester;
use super::metrics::{CycleSample, MetricsSample, ObjectValues, SlaveSample, TimeHistogram};
use super::service::Attachment;
use super::session::{ClientId, Host, limit_error, no_such_method};
use super::workers::{Age, Job, Work, Workers, time_since_boot};
use super::workers::{Permission, result_value};
use crate::protocol::{
    Access, Axes, AxisState, CycleState, DEFAULT_MAX_AGE_MS, Empty, GatewayState, Hello,
    INVALID_PARAMS, METHODS, Method, NOT_AVAILABLE, NmtParams, RawRequest, RejectReason, RpcError,
    SampledTimes, ServiceStats, SessionState, State, TransmitRecord, methods,
};
use ecan_cia402::{AxesSnapshot, AxisStatus};
use ecan_host::{Clock, Observer, ObserverError, Snapshot};
use ecan_mcan_port::{PortSnapshot, SessionState as PortSession};
use ecan_protocol::can::{CanFrame, CanId};
use hdrhistogram::Histogram;
use serde_json::Value;
use std::sync::Arc;
use std::time::Duration;

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

/// Longest time in a distribution, in nanoseconds.
const MAX_TIME_NS: u64 = 10_000_000_000;

#[derive(Debug)]
pub(crate) struct BusView {
    snapshot: Snapshot,
    since_1970_ns: u64,
    /// Number of the last sampled cycle.
    sampled_cycle: u64,
    run_time: Histogram<u64>,
    late: Histogram<u64>,
    /// The same samples for metrics.
    buckets: Buckets,
}

#[derive(Debug, Clone, Copy, Default)]
struct Buckets {
    run_time: TimeHistogram,
    late: TimeHistogram,
}

fn histogram() -> Histogram<u64> {
    // infallible: the bounds are constants that the crate accepts
    let mut histogram = Histogram::new_with_bounds(1, MAX_TIME_NS, 3).unwrap();
    histogram.auto(false);
    histogram
}

fn times(histogram: &Histogram<u64>) -> SampledTimes {
    if histogram.is_empty() {
        return SampledTimes::default();
    }
    SampledTimes {
        samples: histogram.len(),
        min_ns: histogram.min(),
        p50_ns: histogram.value_at_quantile(0.5),
        p99_ns: histogram.value_at_quantile(0.99),
        max_ns: histogram.max(),
    }
}

impl BusView {
    pub(crate) fn new(observer: &Observer, since_1970_ns: u64) -> Self {
        Self {
            snapshot: observer.snapshot(),
            since_1970_ns,
            sampled_cycle: 0,
            run_time: histogram(),
            late: histogram(),
            buckets: Buckets::default(),
        }
    }

    /// Adds the last cycle to the distributions.
    pub(crate) fn sample(&mut self) {
        if self.snapshot.update().is_ok() && self.snapshot.cycle() != self.sampled_cycle {
            self.sampled_cycle = self.snapshot.cycle();
            self.run_time.saturating_record(self.snapshot.run_time_ns());
            self.buckets.run_time.record(self.snapshot.run_time_ns());
            if let Some(start) = self.snapshot.cycle_start() {
                self.late.saturating_record(start.late_ns);
                self.buckets.late.record(start.late_ns);
            }
        }
    }

    /// Number of the last cycle if the gateway is not ready in it.
    pub(crate) fn cycle_of_lost_session(&mut self, slave: usize) -> Option<u64> {
        self.update().ok()?;
        let session = PortSnapshot::of(&self.snapshot)?.session(slave)?;
        (session != PortSession::Ready).then(|| self.snapshot.cycle())
    }

    /// Reads the last cycle; returns whether the application has ended.
    fn update(&mut self) -> Result<bool, RpcError> {
        match self.snapshot.update() {
            Err(error @ ObserverError::NoCycle) => {
                Err(RpcError::new(NOT_AVAILABLE, error.to_string()))
            }
            result => Ok(result.is_err()),
        }
    }

    fn time_ns(&self) -> u64 {
        self.snapshot.time_ns().wrapping_add(self.since_1970_ns)
    }

    pub(crate) fn state(&mut self, cycle_ns: u64) -> Result<State, RpcError> {
        let is_closed = self.update()?;
        let cycle = self.cycle_state(cycle_ns, is_closed);
        let snapshot = &self.snapshot;
        let port = PortSnapshot::of(snapshot);
        let gateways = port.map_or(0, |port| port.slave_count());
        let gateways = (0..gateways).filter_map(|slave| gateway(snapshot, port?, slave)).collect();
        Ok(State { cycle, run_time: times(&self.run_time), late: times(&self.late), gateways })
    }

    fn cycle_state(&self, cycle_ns: u64, is_closed: bool) -> CycleState {
        let snapshot = &self.snapshot;
        CycleState {
            cycle: snapshot.cycle(),
            time_ns: self.time_ns(),
            cycle_ns,
            run_time_ns: snapshot.run_time_ns(),
            late_ns: snapshot.cycle_start().map(|start| start.late_ns),
            overruns: snapshot.overruns(),
            skipped: snapshot.skipped(),
            is_stop_requested: snapshot.is_stop_requested(),
            is_closed,
        }
    }

    /// The last cycle for metrics; `None` before the first.
    pub(crate) fn cycle_sample(&mut self, cycle_ns: u64) -> Option<CycleSample> {
        let is_closed = self.update().ok()?;
        let snapshot = &self.snapshot;
        let port = PortSnapshot::of(snapshot);
        let slaves = (0..port.map_or(0, |port| port.slave_count())).filter_map(|slave| {
            let port = port?;
            let status = |channel| port.channel_status(slave, channel);
            Some(SlaveSample {
                session: port.session(slave)?,
                report: snapshot.domain_report(slave).unwrap_or_default(),
                statistics: port.statistics(slave)?,
                channels: [status(0), status(1), status(2), status(3)],
            })
        });
        Some(CycleSample {
            state: self.cycle_state(cycle_ns, is_closed),
            run_time: self.buckets.run_time,
            late: self.buckets.late,
            slaves: slaves.collect(),
            axes: AxesSnapshot::of(snapshot).iter().flat_map(|axes| axes.axes()).collect(),
        })
    }

    pub(crate) fn axes(&mut self) -> Result<Axes, RpcError> {
        self.update()?;
        let axes = AxesSnapshot::of(&self.snapshot);
        let axes = axes.iter().flat_map(|axes| axes.axes()).map(|status| axis(&status)).collect();
        Ok(Axes { cycle: self.snapshot.cycle(), time_ns: self.time_ns(), axes })
    }
}

fn gateway(snapshot: &Snapshot, port: PortSnapshot<'_>, slave: usize) -> Option<GatewayState> {
    let report = snapshot.domain_report(slave).unwrap_or_default();
    let status = |channel| port.channel_status(slave, channel).map(|status| status.raw());
    let statistics = match serde_json::to_value(port.statistics(slave)?) {
        Ok(Value::Object(counters)) => counters,
        _ => return None,
    };
    Some(GatewayState {
        session: match port.session(slave)? {
            PortSession::Waiting => SessionState::Waiting,
            PortSession::Verifying => SessionState::Verifying,
            PortSession::Ready => SessionState::Ready,
            PortSession::Failed => SessionState::Failed,
        },
        waiting_for: text(port.waiting_for(slave)),
        working_counter: report.working_counter,
        expected_working_counter: report.expected_working_counter,
        channel_status: [status(0), status(1), status(2), status(3)],
        statistics,
    })
}

fn text(value: Option<impl ToString>) -> Option<String> {
    value.map(|value| value.to_string())
}

fn axis(status: &AxisStatus) -> AxisState {
    AxisState {
        gateway: status.address.slave as u16,
        channel: status.address.channel,
        node_id: status.address.node.get(),
        phase: status.phase.to_string(),
        elapsed_ns: nanoseconds(status.elapsed),
        error: text(status.error),
        mode: status.mode.to_string(),
        statusword: status.statusword.map(|word| word.0),
        drive_state: text(status.drive_state()),
        error_code: status.error_code,
        nmt_state: text(status.nmt_state),
        heartbeat: status.heartbeat.to_string(),
        actual: status.actual,
        actual_age: status.actual_age,
        actual_degrees: status.actual_degrees(),
        target: status.target,
        following_error: status.following_error(),
        hold_reason: text(status.hold_reason),
        stop_cause: text(status.stop_cause),
        is_configured: status.is_configured,
        is_running: status.is_running,
        is_at_rest: status.is_at_rest,
        is_target_reached: status.is_target_reached,
        is_stopped: status.is_stopped,
        is_recovering: status.is_recovering,
    }
}

pub(crate) fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}
