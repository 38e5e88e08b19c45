//! One CANopen node through a gateway.

use std::time::Duration;

use ecan_canopen::{NmtState, NodeId, Sdo, SdoDirection, SdoFault};
use ecan_protocol::mapping::Direction;

use crate::context::{Context, Failure, GlobalOptions, Result};
use crate::frames::{Channels, FrameOptions, GatewayRequirements, Prepared};

use super::node_link::{NodeLink, Observed, SdoRequest};
use super::node_target::{JsonTarget, NodeTarget, SelectedNode};

/// Answer of the node to an SDO request.
pub type Answer<T = Vec<u8>> = std::result::Result<T, SdoFault>;

const RETRIES: u8 = 1;

/// Requirements of commands that send to nodes.
pub fn requirements(channels: Channels, has_end: bool) -> GatewayRequirements {
    GatewayRequirements {
        directions: &[Direction::RxPdo, Direction::TxPdo],
        has_results: true,
        has_end,
        ..GatewayRequirements::on(channels)
    }
}

/// Starts the selected or only gateway; an error if the user stops.
pub fn start(
    options: &FrameOptions,
    channel: u8,
    has_end: bool,
    context: &Context,
) -> Result<NodeLink> {
    let prepared = Prepared::new(options, requirements(Channels::only(channel), has_end), context)?;
    match prepared.enter_ready()? {
        Some(service) => Ok(NodeLink::new(service)),
        None => Err(Failure::Incomplete("stopped before the gateway was ready".to_owned())),
    }
}

/// Starts the gateway of a node.
pub fn start_for(selected: &SelectedNode, has_end: bool, context: &Context) -> Result<NodeLink> {
    let slave = selected.slave.or(context.global.slave);
    let global = GlobalOptions { slave, ..context.global.clone() };
    let context = Context { global: &global, output: context.output };
    start(&selected.options, selected.target.channel, has_end, &context)
}

/// SDO client of one node, and its state by the frames that it sends.
#[derive(Debug)]
pub struct NodeClient {
    pub link: NodeLink,
    request: SdoRequest,
    /// Last reported state.
    state: Option<NmtState>,
}

impl NodeClient {
    pub fn new(link: NodeLink, target: NodeTarget, timeout: Duration) -> Self {
        Self { link, request: SdoRequest::new(0, target, timeout, RETRIES), state: None }
    }

    /// Does the work of a command, then ends the capture of the frames, also after an error.
    pub fn run<T>(mut self, work: impl FnOnce(&mut Self) -> Result<T>) -> Result<T> {
        let result = work(&mut self);
        let finished = self.link.service.finish();
        result.and_then(|value| finished.map(|()| value))
    }

    pub fn target(&self) -> NodeTarget {
        self.request.target
    }

    /// Selects another node of the channel for the next transfers.
    pub fn set_target(&mut self, target: NodeTarget) {
        self.request.target = target;
        self.state = None;
    }

    pub fn json(&self) -> JsonTarget {
        self.link.json(0, self.request.target)
    }

    /// Last state that the node reported to this command.
    pub fn state(&self) -> Option<NmtState> {
        self.state
    }

    pub fn forget_state(&mut self) {
        self.state = None;
    }

    /// Runs a cycle; `observe` gets the frames of the channel.
    pub fn cycle(&mut self, mut observe: impl FnMut(&Observed)) -> Result<u64> {
        let (target, state) = (self.request.target, &mut self.state);
        let requests = std::slice::from_mut(&mut self.request);
        self.link.cycle(requests, |observed| {
            if observed.is_from(0, target.channel) {
                note_state(observed, target.node, state);
                observe(observed);
            }
        })
    }

    /// Runs cycles for a time, or until `is_over` returns true.
    pub fn run_for(
        &mut self,
        time: Duration,
        mut is_over: impl FnMut(&Self) -> bool,
    ) -> Result<bool> {
        let start_ns = self.link.service.response_ns();
        let time_ns = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        loop {
            if is_over(self) {
                return Ok(true);
            }
            let now_ns = self.cycle(|_| ())?;
            if now_ns.saturating_sub(start_ns) >= time_ns {
                return Ok(is_over(self));
            }
        }
    }

    fn finish(&mut self) -> Result<Answer> {
        loop {
            match self.request.client.state() {
                Sdo::Busy => {
                    self.cycle(|_| ())?;
                    let place = (self.request.gateway, self.request.target.channel);
                    if self.link.is_stalled(place) {
                        return Err(self.link.stall_failure(place));
                    }
                }
                Sdo::Done { .. } => return Ok(Ok(self.request.client.data().to_vec())),
                Sdo::Failed(fault) => return Ok(Err(fault)),
                Sdo::Idle => return Ok(Err(SdoFault::Cancelled)),
            }
        }
    }

    /// Reads an object.
    ///
    /// # Errors
    /// The gateway is lost, or the user stops.
    pub fn try_upload(&mut self, index: u16, subindex: u8) -> Result<Answer> {
        // Never busy: each transfer is completed.
        let _ = self.request.client.start_upload(index, subindex);
        self.finish()
    }

    /// Reads an object.
    ///
    /// # Errors
    /// Also that of the node.
    pub fn upload(&mut self, index: u16, subindex: u8) -> Result<Vec<u8>> {
        match self.try_upload(index, subindex)? {
            Ok(data) => Ok(data),
            Err(fault) => Err(self.failure((SdoDirection::Upload, index, subindex), fault)),
        }
    }

    /// Reads an object; `None` if the node rejects that.
    ///
    /// # Errors
    /// The node does not answer.
    pub fn upload_optional(&mut self, index: u16, subindex: u8) -> Result<Option<Vec<u8>>> {
        match self.try_upload(index, subindex)? {
            Ok(data) => Ok(Some(data)),
            Err(SdoFault::Aborted(_)) => Ok(None),
            Err(fault) => Err(self.failure((SdoDirection::Upload, index, subindex), fault)),
        }
    }

    /// Reads a number of at most 8 bytes; `None` if the node rejects that.
    ///
    /// # Errors
    /// The node does not answer.
    pub fn number(&mut self, index: u16, subindex: u8) -> Result<Option<u64>> {
        Ok(self.upload_optional(index, subindex)?.map(|data| decode_unsigned(&data)))
    }

    /// Writes an object.
    ///
    /// # Errors
    /// The gateway is lost, the value is too long, or the user stops.
    pub fn try_download(&mut self, index: u16, subindex: u8, data: &[u8]) -> Result<Answer<()>> {
        let started = self.request.client.start_download(index, subindex, data);
        started.map_err(|error| Failure::Usage(error.to_string()))?;
        Ok(self.finish()?.map(drop))
    }

    /// Writes an object.
    ///
    /// # Errors
    /// Also that of the node.
    pub fn download(&mut self, index: u16, subindex: u8, data: &[u8]) -> Result {
        self.try_download(index, subindex, data)?
            .map_err(|fault| self.failure((SdoDirection::Download, index, subindex), fault))
    }

    /// Error of a transfer with the node, with what to do.
    pub fn failure(&mut self, object: (SdoDirection, u16, u8), fault: SdoFault) -> Failure {
        self.link.failure(&self.request, object, fault)
    }
}

/// Takes over the state that a frame of the node reports.
pub fn note_state(observed: &Observed, node: NodeId, state: &mut Option<NmtState>) {
    if let Some((sender, new)) = observed.state()
        && sender == node
    {
        *state = Some(new);
    }
}

/// The little-endian number of these bytes; those beyond 8 are left out.
pub fn decode_unsigned(data: &[u8]) -> u64 {
    data.iter().take(8).rev().fold(0, |number, byte| number << 8 | u64::from(*byte))
}
