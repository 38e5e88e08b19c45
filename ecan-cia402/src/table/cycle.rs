//! The axes in the cycle: receive, then send.

use ecan_canopen::{Network, NodeAddress};
use ecan_host::QuickStop;
use ecan_mcan_port::{Cycle, Received, ReceivedFrame, SendError, SendOptions};
use ecan_protocol::can::{CanId, FrameKind, FrameRef};
use ecan_protocol::mapping::CHANNELS;

use super::cia402::Cia402;
use super::shared_node::AxisLookup;
use crate::axis::axis::{Axis, AxisCommand, StopKind};
use crate::axis::pdo_layout::RpdoBytes;
use crate::axis::target_path::TargetTurn;
use crate::guard::gateway_watch::GatewayWatch;
use crate::guard::terms::{Decision, WaitReason};
use crate::observation::AxesWriter;

/// Summary of the targets of one cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SendSummary {
    /// Axes that got a target of the application, or the step of the host.
    pub targets: usize,
    /// Axes that got their actual position as target, during activation.
    pub positions: usize,
    /// Active axes that got nothing in this cycle: their motion must not continue.
    pub waiting: usize,
    /// Axes whose target was rejected; [`decision`](crate::AxisRef::decision) has the reason.
    pub rejected: usize,
    /// Axes that are not active, hold, or have no target due in this cycle.
    pub closed: usize,
    /// SYNC messages.
    pub syncs: usize,
}

impl SendSummary {
    fn count(&mut self, decision: Decision) {
        match decision {
            Decision::Target(_) => self.targets += 1,
            Decision::Track(_) | Decision::First(_) => self.positions += 1,
            Decision::Wait(WaitReason::NotDue) => self.closed += 1,
            Decision::Wait(_) => self.waiting += 1,
            Decision::Reject(_) => self.rejected += 1,
            Decision::Closed => self.closed += 1,
        }
    }

    /// Returns whether every axis got a target of the application.
    pub fn all_moved(&self) -> bool {
        self.targets > 0 && self.positions + self.waiting + self.rejected + self.closed == 0
    }
}

impl Cia402 {
    /// Processes the received frames of the cycle and the next step of every axis: configuration,
    /// mode change, homing, enabling, holding.
    ///
    /// Call it first in the cycle. A further call in the same cycle of the Port does nothing. Real-time safe: no
    /// allocation, no lock, no call beyond the clock.
    pub fn process_rx(&mut self, cycle: &mut Cycle<'_>) {
        self.process_rx_with(cycle, |_| {});
    }

    /// As [`process_rx`](Self::process_rx), but passes everything that belongs neither to the network
    /// nor to an axis to `other`: frames of other nodes, other PDOs, transmit reports. Real-time safe
    /// if `other` is.
    pub fn process_rx_with(&mut self, cycle: &mut Cycle<'_>, mut other: impl FnMut(Received)) {
        let number = cycle.adapter().cycle_number();
        if std::mem::replace(&mut self.received_cycle, number) == number {
            return;
        }
        self.now_ns = cycle.adapter().clock().now_ns();
        let Self { network, axes, gateways, lookup, now_ns, .. } = self;
        axes.iter_mut().for_each(Axis::begin_cycle);
        network.receive(cycle, *now_ns, |item| {
            match &item {
                Received::Frame(frame) => {
                    if let Some((axis, nth)) = axis_of(axes, lookup, frame) {
                        if let Some(gateway) = gateways.get_mut(frame.slave) {
                            gateway.take_tpdo(frame.channel);
                        }
                        axis.on_tpdo(nth, frame.frame.data());
                        return;
                    }
                }
                Received::TransmitReport(report) => {
                    if let Some(gateway) = gateways.get_mut(report.slave) {
                        gateway.take_report(report);
                    }
                    for axis in axes.iter_mut() {
                        let address = axis.plan.config.address;
                        if (address.slave, address.channel) == (report.slave, report.channel) {
                            axis.on_report(report);
                        }
                    }
                }
            }
            other(item);
        });
        self.clock.begin_cycle(self.network.sync_period_begins());
        self.observe(cycle);
        let Self { shared_nodes, axes, network, now_ns, .. } = self;
        shared_nodes.iter_mut().for_each(|node| node.begin_cycle(axes, *now_ns));
        axes.iter_mut().for_each(|axis| axis.step(network, *now_ns));
        shared_nodes.iter().for_each(|node| node.end_cycle(axes, network, *now_ns));
        if self.is_paused {
            self.resume_channels();
        }
        let Self { axes, network, bus, ending, now_ns, .. } = self;
        ending.step(axes, network, bus.host.is_some(), *now_ns);
        for axis in &mut self.axes {
            axis.update_phase(self.now_ns);
        }
    }

    fn observe(&mut self, cycle: &mut Cycle<'_>) {
        let Self { network, axes, gateways, now_ns, .. } = self;
        for gateway in gateways.iter_mut() {
            gateway.observe(cycle);
        }
        for axis in axes.iter_mut() {
            if let Some(gateway) = gateways.get(axis.plan.config.address.slave) {
                axis.observe(gateway, network, *now_ns);
            }
        }
        for gateway in gateways.iter() {
            let slave = gateway.slave;
            let is_stale = |axis: &Axis| {
                axis.plan.config.address.slave == slave && axis.path.guard().wants_discard()
            };
            if axes.iter().any(is_stale) {
                // The counter of discarded images tells every axis of the gateway next cycle.
                if let Ok(gateway) = cycle.gateway(slave) {
                    cycle.discard_pending(gateway);
                }
            }
        }
    }

    /// Sends SYNC and heartbeats on the channels of which every axis had its first contact.
    fn resume_channels(&mut self) {
        self.is_paused = false;
        for axis in &self.axes {
            let NodeAddress { slave, channel, .. } = axis.plan.config.address;
            let is_waiting = |other: &Axis| {
                let address = other.plan.config.address;
                (address.slave, address.channel) == (slave, channel)
                    && other.link.contact().is_uninspected()
            };
            let is_paused = self.axes.iter().any(is_waiting);
            self.network.set_paused(slave, channel, is_paused);
            self.is_paused |= is_paused;
        }
    }

    /// Sends targets and commands of all axes, then SYNC, then the network's frames. Call it last in
    /// the cycle. In a cycle without [`process_rx`](Self::process_rx) it sends no targets, since
    /// their path is not known. A further call in the same cycle of the Port, of this function or of
    /// [`send_target_step`](Self::send_target_step), sends nothing and counts every axis as closed: targets and
    /// commands set since the first call are those of the next cycle. Real-time safe.
    pub fn send_targets_all(&mut self, cycle: &mut Cycle<'_>) -> SendSummary {
        self.send(cycle, false)
    }

    /// As [`send_targets_all`](Self::send_targets_all), but moves every CSP axis by its own
    /// [`target_step`](crate::AxisConfig::target_step) per target: it accelerates to that step by its
    /// ramp, and does not move in a cycle in which its target is not sent; after a pause of four target
    /// periods it starts from rest. Axes of other modes get their
    /// targets as there. Real-time safe.
    pub fn send_target_step(&mut self, cycle: &mut Cycle<'_>) -> SendSummary {
        self.send(cycle, true)
    }

    /// Executes one cycle for a loop that has no targets of its own: receives, keeps the axes at
    /// their last targets, sends. Real-time safe.
    pub fn serve(&mut self, cycle: &mut Cycle<'_>) {
        self.process_rx(cycle);
        self.send_targets_all(cycle);
    }

    fn send(&mut self, cycle: &mut Cycle<'_>, stepping: bool) -> SendSummary {
        let number = cycle.adapter().cycle_number();
        if std::mem::replace(&mut self.sent_cycle, number) == number {
            return SendSummary { closed: self.axes.len(), ..SendSummary::default() };
        }
        if self.quick_stops.is_pending() {
            self.execute_quick_stops();
        }
        let mut summary = SendSummary::default();
        self.gateways.iter_mut().for_each(|gateway| gateway.begin_send(cycle));
        if self.is_sync_first() {
            summary.syncs = self.send_sync(cycle, ChannelSet::default());
        }
        let is_sync_first = self.is_sync_first();
        let begins = self.clock.is_target_cycle();
        let Self { network, axes, gateways, .. } = self;
        let path_turn = self.path_group.begin_turn(axes, |axis| {
            let NodeAddress { slave, channel, .. } = axis.plan.config.address;
            let gateway = gateways.get(slave);
            let has_sync = || has_sync(network, cycle, (slave, channel), is_sync_first);
            match target_turn(gateway, begins, has_sync) {
                TargetTurn::NotDue => None,
                turn => Some(axis.path.is_due(turn) && gateway.is_some_and(GatewayWatch::is_open)),
            }
        });
        let mut full = ChannelSet::default();
        // A command that stops or resets takes effect with a SYNC, too.
        let mut commanded = ChannelSet::default();
        for axis in &mut self.axes {
            let NodeAddress { slave, channel, .. } = axis.plan.config.address;
            let gateway = self.gateways.get(slave);
            let has_sync = || has_sync(&self.network, cycle, (slave, channel), is_sync_first);
            let turn = target_turn(gateway, begins, has_sync);
            let repeats = self.network.sync_period_begins() || turn == TargetTurn::NotReceived;
            let outgoing = axis.prepare(stepping, turn, repeats, self.now_ns);
            if let Some(outgoing) = outgoing {
                if !gateway.is_some_and(GatewayWatch::is_open) || full.contains((slave, channel)) {
                    axis.skip();
                } else {
                    let sent = FrameRef::classic(axis.plan.rpdo, outgoing.rpdo.as_slice())
                        .map_err(Into::into)
                        .and_then(|frame| {
                            let to = cycle.channel(slave, channel)?;
                            cycle.send_with(to, frame, self.target_options)
                        });
                    match sent {
                        Ok(ticket) => {
                            axis.on_sent(&outgoing, ticket, self.now_ns);
                            if outgoing.command.is_some() {
                                commanded.insert((slave, channel));
                            }
                        }
                        Err(error) => {
                            if axis.on_rejected(&outgoing, &error) {
                                full.insert((slave, channel));
                            }
                        }
                    }
                }
            }
            axis.path.count_gap();
            if axis.plan.has_auxiliary {
                let can_send =
                    gateway.is_some_and(GatewayWatch::is_open) && !full.contains((slave, channel));
                let is_own_motion = outgoing.is_some_and(|frame| frame.ramp.is_some());
                let options = self.target_options;
                if !send_auxiliary(cycle, axis, (turn, is_own_motion, can_send), options) {
                    full.insert((slave, channel));
                }
            }
            summary.count(axis.path.decision());
        }
        self.path_group.end_turn(&mut self.axes, path_turn);
        summary.syncs += self.send_sync(cycle, commanded);
        self.network.send(cycle, self.now_ns);
        // A first target activates an axis.
        let now_ns = self.now_ns;
        let is_observed = self.quick_stops.is_observed();
        let axis_count = self.axes.len();
        if let Some(writer) = AxesWriter::new(cycle.adapter(), is_observed, now_ns, axis_count) {
            writer.update(&mut self.axes, &self.network);
        } else {
            for axis in &mut self.axes {
                axis.update_phase(now_ns);
            }
        }
        summary
    }

    /// Executes the commands of observers.
    #[cold]
    fn execute_quick_stops(&mut self) {
        let Self { quick_stops, axes, network, now_ns, .. } = self;
        let mut stop = |axis: &mut Axis| {
            // infallible: any axis can be stopped
            let _ = axis.execute(AxisCommand::Stop(StopKind::QuickStop), network, *now_ns);
        };
        quick_stops.execute(|command| match command {
            QuickStop::All => axes.iter_mut().for_each(&mut stop),
            QuickStop::Axis(axis) => axes.get_mut(axis).into_iter().for_each(&mut stop),
        });
    }

    /// Sends SYNC to the channels on which it is due, where it adds nothing to frames that wait or a command needs
    /// it. Returns their number.
    fn send_sync(&mut self, cycle: &mut Cycle<'_>, commanded: ChannelSet) -> usize {
        let Self { network, gateways, axes, .. } = self;
        let syncs = network.send_sync_where(cycle, |slave, channel| {
            commanded.contains((slave, channel)) || may_sync(gateways, axes, (slave, channel))
        });
        if syncs > 0 {
            self.note_sync();
        }
        syncs
    }

    /// A TPDO is due of every axis that is Operational and whose channel had a SYNC.
    fn note_sync(&mut self) {
        for axis in &mut self.axes {
            let gateway = self.gateways.get(axis.plan.config.address.slave);
            let is_ready = gateway.is_some_and(GatewayWatch::is_ready);
            let NodeAddress { slave, channel, .. } = axis.plan.config.address;
            let is_sent = self.network.has_sent_sync(slave, channel);
            axis.note_sync(is_sent, is_ready, self.now_ns);
        }
    }
}

/// Sends the RPDOs of an axis after the first, if they are due and can be sent, until the Port rejects
/// one; then it returns false.
#[inline(never)]
fn send_auxiliary(
    cycle: &mut Cycle<'_>,
    axis: &mut Axis,
    (turn, is_own_motion, can_send): (TargetTurn, bool, bool),
    options: SendOptions,
) -> bool {
    if !(axis.prepare_auxiliary(turn, is_own_motion) && can_send) {
        return true;
    }
    let NodeAddress { slave, channel, .. } = axis.plan.config.address;
    let mut send = |(id, rpdo): (CanId, RpdoBytes)| -> Result<(), SendError> {
        let frame = FrameRef::classic(id, rpdo.as_slice())?;
        let to = cycle.channel(slave, channel)?;
        cycle.send_with(to, frame, options).map(|_| ())
    };
    let is_complete = axis.data.frames(&axis.plan).all(|frame| send(frame).is_ok());
    axis.data.on_sent(is_complete);
    is_complete
}

/// Returns whether a channel has SYNC in this cycle: it is sent before the targets, or due after them.
fn has_sync(
    network: &Network,
    cycle: &Cycle<'_>,
    (slave, channel): (usize, u8),
    is_sync_first: bool,
) -> bool {
    if is_sync_first {
        network.has_sent_sync(slave, channel)
    } else {
        network.sync_is_due(cycle, slave, channel)
    }
}

/// Returns whether this cycle carries targets of running axes of a gateway; `begins` states whether a target
/// period begins in it.
fn target_turn(
    gateway: Option<&GatewayWatch>,
    begins: bool,
    has_sync: impl FnOnce() -> bool,
) -> TargetTurn {
    if !gateway.is_some_and(GatewayWatch::is_current) {
        TargetTurn::NotReceived
    } else if !begins {
        TargetTurn::NotDue
    } else if has_sync() {
        TargetTurn::Due
    } else {
        TargetTurn::NoSync
    }
}

/// Returns whether a SYNC on a channel adds nothing to frames that wait in the gateway.
fn may_sync(gateways: &[GatewayWatch], axes: &[Axis], (slave, channel): (usize, u8)) -> bool {
    let is_active = |axis: &Axis| {
        let address = axis.plan.config.address;
        (address.slave, address.channel) == (slave, channel) && axis.path.is_active()
    };
    let gateway = gateways.get(slave);
    !gateway.is_some_and(|gateway| gateway.withholds_sync(channel, axes.iter().any(is_active)))
}

fn axis_of<'a>(
    axes: &'a mut [Axis],
    lookup: &AxisLookup,
    frame: &ReceivedFrame,
) -> Option<(&'a mut Axis, usize)> {
    if frame.frame.kind() != FrameKind::Data {
        return None;
    }
    let (axis, nth) = lookup.tpdo(frame.slave, frame.channel, frame.frame.id())?;
    Some((axes.get_mut(axis)?, nth))
}

/// Set of channels; a bit each for the first 32 slaves, and all of the others together.
#[derive(Debug, Clone, Copy, Default)]
struct ChannelSet(u128);

impl ChannelSet {
    fn bit((slave, channel): (usize, u8)) -> u128 {
        1 << (slave.min(31) * CHANNELS + usize::from(channel) % CHANNELS)
    }

    fn insert(&mut self, address: (usize, u8)) {
        self.0 |= Self::bit(address);
    }

    fn contains(self, address: (usize, u8)) -> bool {
        self.0 & Self::bit(address) != 0
    }
}
