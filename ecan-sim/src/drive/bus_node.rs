//! The drive as a node on a bus, and its interface for tests.

use std::sync::Arc;

use ecan_canopen::{
    CobId, DeviceFile, DriveState, Emcy, ErrorRegister, NmtRequest, NmtState, NodeId,
    OperatingMode, Service, Statusword, TimeOfDay,
};
use ecan_protocol::can::{CanFrame, FrameKind};

use super::config::DriveConfig;
use super::device::Device;
use super::model::{AxisUnit, ObjectModel};
use super::objects::ObjectSource;
use super::pdo::StandardIds;
use super::sdo_server::SdoServer;
use super::trace::{DriveTrace, TargetHistory};
use crate::event_queue::earliest;
use crate::node::{Node, NodeOutput};

/// A simulated CiA 402 drive: CANopen node, state machine, motor.
///
/// The getters return the actual state, not what the drive sent, as of the last event of the drive;
/// with the power stage on or a turning motor that is at most one controller period ago.
#[derive(Clone, Debug)]
pub struct Drive {
    device: Device,
    sdo: SdoServer,
    /// A segment of a block upload is queued for the bus.
    segment_waits: bool,
    /// Time of the next event that others can observe. Cached because it is read after every frame
    /// on the bus.
    next: Option<u64>,
}

impl Drive {
    /// A drive with the built-in object dictionary: the objects of a CiA 402 servo drive with the
    /// modes PP, PV, HM, CSP, CSV and CST, four PDOs in each direction with up to eight objects,
    /// and a scratch domain (0x2000) and text (0x2001) for transfer tests.
    #[must_use]
    pub fn new(config: &DriveConfig) -> Self {
        Self::with_device(Device::new(config, ObjectSource::BuiltIn))
    }

    /// A node with the objects of an EDS or a DCF.
    ///
    /// It is a drive if its device type (0x1000) states CiA 402, or if it has a controlword and a
    /// statusword; otherwise its objects have values, but no function, as those of an I/O module.
    /// A `ParameterValue` counts as a saved value. Objects of the profile without a default, and motion parameters
    /// that are 0 in the file and must not be 0, have the values of the built-in dictionary; a serial number that is
    /// 0 is that of the configuration.
    #[must_use]
    pub fn from_device_file(config: &DriveConfig, file: &DeviceFile) -> Self {
        Self::with_device(Device::new(config, ObjectSource::File(Arc::new(file.clone()))))
    }

    fn with_device(device: Device) -> Self {
        let sdo = SdoServer::new(&device.config.quirks);
        Self { device, sdo, segment_waits: false, next: None }
    }

    /// Configuration of the drive, with its present node-ID.
    #[must_use]
    pub const fn config(&self) -> &DriveConfig {
        &self.device.config
    }

    /// Node-ID; of a drive that has none, the last or the configured one.
    #[must_use]
    pub const fn node_id(&self) -> NodeId {
        self.device.config.node
    }

    /// Active node-ID; `None` before LSS has configured one.
    #[must_use]
    pub fn active_node_id(&self) -> Option<NodeId> {
        self.device.lss.node()
    }

    /// Last time that the drive received by TIME; `None` before the first, or if it does not consume TIME.
    #[must_use]
    pub const fn time_of_day(&self) -> Option<TimeOfDay> {
        self.device.pdos.time_of_day()
    }

    /// Returns whether the node is a drive (CiA 402). The getters of motion have no meaning for
    /// another node.
    #[must_use]
    pub const fn is_drive(&self) -> bool {
        self.device.model.is_drive
    }

    /// Returns whether the drive has its supply.
    #[must_use]
    pub const fn is_powered(&self) -> bool {
        self.device.powered
    }

    /// NMT state; [`NmtState::Initialising`] without supply.
    #[must_use]
    pub const fn nmt_state(&self) -> NmtState {
        self.device.network.state
    }

    /// Number of axes. The getters of motion without a number are those of the first one.
    #[must_use]
    pub fn axis_count(&self) -> usize {
        self.device.model.units.count()
    }

    /// State of an axis; `None` if the drive does not have it.
    #[must_use]
    pub fn axis(&self, number: usize) -> Option<DriveAxis<'_>> {
        self.device.model.units.get(number).map(|unit| DriveAxis::new(&self.device, unit))
    }

    /// State of the power stage.
    #[must_use]
    pub const fn state(&self) -> DriveState {
        self.device.model.units.first.axis.power.state
    }

    /// Present statusword.
    #[must_use]
    pub fn statusword(&self) -> Statusword {
        self.device.statusword(&self.device.model.units.first)
    }

    /// Active mode of operation; `None` is no mode.
    #[must_use]
    pub const fn mode(&self) -> Option<OperatingMode> {
        self.device.model.units.first.axis.mode
    }

    /// Actual position (0x6064) in increments.
    #[must_use]
    pub fn position(&self) -> i32 {
        self.device.model.units.first.axis.position()
    }

    /// Mechanical position in increments, from a zero that neither homing nor loss of supply
    /// changes.
    #[must_use]
    pub fn mechanical_position(&self) -> f64 {
        self.device.model.units.first.axis.motor.position
    }

    /// Velocity in increments per second.
    #[must_use]
    pub fn velocity(&self) -> f64 {
        self.device.model.units.first.axis.motor.velocity
    }

    /// Torque in thousandths of the rated torque.
    #[must_use]
    pub fn torque(&self) -> f64 {
        self.device.model.units.first.axis.motor.torque
    }

    /// Position demand value (0x6062) in increments.
    #[must_use]
    pub fn demand(&self) -> i32 {
        self.device.model.units.first.axis.demand()
    }

    /// Position demand minus actual position (0x60F4) in increments; 0 if no position is
    /// controlled.
    #[must_use]
    pub fn following_error(&self) -> i32 {
        self.device.model.units.first.axis.following_error()
    }

    /// The received targets.
    #[must_use]
    pub const fn targets(&self) -> &TargetHistory {
        &self.device.model.units.first.axis.history
    }

    /// The last events.
    #[must_use]
    pub const fn trace(&self) -> &DriveTrace {
        &self.device.model.units.first.axis.trace
    }

    /// Error code of the present fault or warning (0x603F); 0 if none.
    #[must_use]
    pub const fn error_code(&self) -> u16 {
        self.device.model.emergency.code
    }

    /// Error register (0x1001).
    #[must_use]
    pub const fn error_register(&self) -> ErrorRegister {
        ErrorRegister(self.device.model.emergency.register)
    }

    /// Number of sent emergency messages.
    #[must_use]
    pub const fn emergencies_sent(&self) -> u64 {
        self.device.model.emergency.sent
    }

    /// Number of received SYNC messages.
    #[must_use]
    pub const fn syncs(&self) -> u64 {
        self.device.pdos.syncs()
    }

    /// Number of PDOs received in NMT state Operational that were long enough.
    #[must_use]
    pub const fn received_pdos(&self) -> u64 {
        self.device.pdos.received()
    }

    /// Value of a numeric object; `None` if the object does not exist or holds bytes. Objects that
    /// the drive updates have the value of the last frame that read them.
    #[must_use]
    pub fn object(&self, index: u16, subindex: u8) -> Option<i64> {
        self.device.model.objects.number(index, subindex)
    }

    /// Sets a numeric object, as the process of an I/O module changes an input; excess bits are cut
    /// off. Returns `false` if the object does not exist, holds bytes or is updated by the drive, or
    /// without supply.
    pub fn set_object(
        &mut self,
        now: u64,
        (index, subindex): (u16, u8),
        value: i64,
        out: &mut NodeOutput,
    ) -> bool {
        let device = &self.device;
        let slot = device.model.objects.find((index, subindex)).ok();
        let is_updated = device
            .model
            .units
            .iter()
            .flat_map(|unit| &unit.slots)
            .any(|(updated, _)| Some(*updated) == slot);
        if !device.powered || is_updated || device.model.objects.number(index, subindex).is_none() {
            return false;
        }
        self.act(now, out, |drive, _| drive.device.model.objects.set(index, subindex, value));
        true
    }

    /// Injects a fault; `code` is the error code of the emergency message. Has no effect without
    /// supply or in a fault.
    pub fn fail(&mut self, now: u64, code: u16, out: &mut NodeOutput) {
        self.fail_axis(now, 0, code, out);
    }

    /// Injects a fault of an axis, as [`fail`](Self::fail) does of the first one.
    pub fn fail_axis(&mut self, now: u64, axis: usize, code: u16, out: &mut NodeOutput) {
        self.act(now, out, |drive, _| {
            if let Some(unit) = drive.device.model.units.get_mut(axis) {
                unit.axis.fault(code, &unit.parameters);
            }
        });
    }

    /// Sends an emergency message about an error that has already gone; the state does not change.
    pub fn warn(&mut self, now: u64, emcy: Emcy, out: &mut NodeOutput) {
        self.act(now, out, |drive, _| {
            let ObjectModel { emergency, objects, .. } = &mut drive.device.model;
            emergency.report(emcy.code, emcy.register, objects);
        });
    }

    /// Blocks the motor until `until`.
    pub fn block(&mut self, now: u64, until: u64, out: &mut NodeOutput) {
        self.act(now, out, |drive, _| drive.device.model.units.first.axis.block(until));
    }

    /// The drive's CAN controller is bus-off until `until`: the drive reacts as to a loss of the
    /// host, and neither receives nor sends. Has no effect without supply.
    pub fn bus_off(&mut self, now: u64, until: u64, out: &mut NodeOutput) {
        self.act(now, out, |drive, _| drive.device.bus_off(until));
    }

    /// Switches the supply off at `now` and on at `on_at`. The motor coasts in between.
    pub fn power_cycle(&mut self, now: u64, on_at: u64) {
        self.sdo.restart();
        self.segment_waits = false;
        self.device.switch_off(now, on_at);
        self.next = self.device.next_event();
    }

    /// Executes an action at `now` and everything that follows from it.
    fn act(
        &mut self,
        now: u64,
        out: &mut NodeOutput,
        action: impl FnOnce(&mut Self, &mut NodeOutput),
    ) {
        if self.device.powered {
            self.device.run_to(now);
            action(self, out);
            self.settle(out);
        }
    }

    fn settle(&mut self, out: &mut NodeOutput) {
        if self.device.network.state == NmtState::Initialising {
            self.sdo.restart();
        }
        self.device.settle(out);
        self.pump(out);
        self.next = self.device.next_event();
    }

    /// Sends the next segment of a block upload after the previous one was sent.
    fn pump(&mut self, out: &mut NodeOutput) {
        if self.segment_waits || self.device.has_responses() {
            return;
        }
        if let Some(segment) = self.sdo.next_segment() {
            self.segment_waits = true;
            self.device.send(out, CobId::sdo_server(self.node_id()), &segment);
        }
    }

    fn frame(&mut self, frame: &CanFrame, out: &mut NodeOutput) {
        let (id, data) = (frame.id(), frame.data());
        let node = self.node_id();
        if self.device.pdos.sync_id() == Some(id) {
            return self.device.on_sync(data, out);
        }
        if self.device.pdos.time_id() == Some(id) {
            return self.device.on_time(data);
        }
        match CobId::classify(id) {
            Some(Service::LssRequest) => self.device.on_lss(data, out),
            _ if self.device.lss.node().is_none() => {}
            Some(Service::Heartbeat(own)) if own == node && frame.is_remote() => {
                self.device.guarding_request(out);
            }
            Some(Service::Nmt) => {
                if let Some(request) = NmtRequest::parse(data).filter(|nmt| nmt.concerns(node)) {
                    self.device.nmt(request.command);
                }
            }
            Some(Service::SdoClient(server)) if server == node => {
                if self.device.network.communicates() {
                    self.segment_waits = false;
                    if let Some(response) = self.sdo.receive(data, &mut self.device) {
                        self.device.queue_response(response);
                    }
                }
            }
            Some(Service::Heartbeat(producer)) => self.device.heartbeat(producer),
            _ => self.device.on_pdo(id, data),
        }
    }

    /// Time at which the drive must run at the latest. Until then its controller may skip ticks, if
    /// [`catch_up`](Self::catch_up) is called before the drive is read.
    pub(crate) const fn next_due(&self) -> Option<u64> {
        self.next
    }

    /// Executes the controller ticks up to `now`.
    pub(crate) fn catch_up(&mut self, now: u64) {
        self.device.catch_up(now);
    }

    /// Changes with the [standard CAN IDs](Self::standard_ids); 0 at first.
    pub(crate) const fn filter_version(&self) -> u32 {
        self.device.pdos.received_ids().version()
    }

    /// The standard CAN IDs that the drive may read.
    pub(crate) const fn standard_ids(&self) -> &StandardIds {
        &self.device.pdos.received_ids().standard
    }

    /// Receives a frame; returns false if the drive has nothing to do then: it ignores the frame, or stores it
    /// until SYNC.
    pub(crate) fn receive(&mut self, now: u64, frame: &CanFrame, out: &mut NodeOutput) -> bool {
        let has_booted = self.device.network.state != NmtState::Initialising;
        let is_read = match frame.kind() {
            FrameKind::Data => has_booted || self.device.lss.node().is_none() && self.device.on_bus,
            // Only guarding requests.
            FrameKind::Remote => {
                has_booted && frame.id() == CobId::heartbeat(self.node_id()).can_id()
            }
            FrameKind::Fd { .. } => false,
        };
        if !is_read || !self.device.pdos.received_ids().contains(frame.id()) {
            return false;
        }
        let is_data = frame.kind() == FrameKind::Data;
        if is_data && self.device.store_pdo(frame.id(), frame.data()) {
            return false;
        }
        self.act(now, out, |drive, out| drive.frame(frame, out));
        true
    }
}

impl Node for Drive {
    fn started(&mut self, now: u64, _out: &mut NodeOutput) {
        self.device.switch_on(now);
        self.next = self.device.next_event();
    }

    fn received(&mut self, now: u64, frame: &CanFrame, out: &mut NodeOutput) {
        self.receive(now, frame, out);
    }

    fn transmitted(&mut self, _now: u64, frame: &CanFrame, out: &mut NodeOutput) {
        if frame.id() == CobId::sdo_server(self.node_id()).can_id() {
            self.segment_waits = false;
            self.pump(out);
        }
    }

    fn next_event(&self) -> Option<u64> {
        earliest([self.next, self.device.next_tick()])
    }

    fn advance(&mut self, now: u64, out: &mut NodeOutput) {
        self.device.tick(now, out);
        self.settle(out);
    }

    fn is_on_bus(&self) -> bool {
        self.device.on_bus
    }

    fn bit_rate(&self) -> Option<u32> {
        self.device.lss.bit_per_s()
    }
}

/// State of one axis of a [`Drive`](super::Drive): the actual state, not what the drive sent.
#[derive(Clone, Copy, Debug)]
pub struct DriveAxis<'a> {
    device: &'a Device,
    unit: &'a AxisUnit,
}

impl<'a> DriveAxis<'a> {
    pub(super) const fn new(device: &'a Device, unit: &'a AxisUnit) -> Self {
        Self { device, unit }
    }

    /// State of the power stage.
    #[must_use]
    pub const fn state(&self) -> DriveState {
        self.unit.axis.power.state
    }

    /// Present statusword.
    #[must_use]
    pub fn statusword(&self) -> Statusword {
        self.device.statusword(self.unit)
    }

    /// Active mode of operation; `None` is no mode.
    #[must_use]
    pub const fn mode(&self) -> Option<OperatingMode> {
        self.unit.axis.mode
    }

    /// Actual position (0x6064) in increments.
    #[must_use]
    pub fn position(&self) -> i32 {
        self.unit.axis.position()
    }

    /// Velocity in increments per second.
    #[must_use]
    pub const fn velocity(&self) -> f64 {
        self.unit.axis.motor.velocity
    }

    /// The received targets.
    #[must_use]
    pub const fn targets(&self) -> &'a TargetHistory {
        &self.unit.axis.history
    }

    /// The last events.
    #[must_use]
    pub const fn trace(&self) -> &'a DriveTrace {
        &self.unit.axis.trace
    }
}
