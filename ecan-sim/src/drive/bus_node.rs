//! The drive as a node on a bus, and as a test sees it.

use ecan_canopen::{
    CobId, DriveState, Emcy, ErrorRegister, NmtRequest, NmtState, NodeId, OperatingMode, Service,
    Statusword,
};
use ecan_protocol::can::{CanFrame, FrameKind};

use super::device::Device;
use super::eds::{self, EdsError};
use super::history::TargetHistory;
use super::sdo_server::SdoServer;
use super::settings::DriveConfig;
use crate::earliest::earliest;
use crate::node::{Node, NodeOutput};

/// A simulated CiA 402 drive: CANopen slave, state machine, motor.
///
/// Everything that it says about itself here is its own truth, not what it sent. It is as of the
/// last instant at which something happened to the drive; with power on or a turning motor that is
/// at most a period of its controller ago.
#[derive(Clone, Debug)]
pub struct Drive {
    device: Device,
    sdo: SdoServer,
    /// A segment of a block upload is on its way to the bus.
    segment_waits: bool,
    /// When something is due by the clock that others may notice at once. Kept, for it is asked for
    /// after every frame on the bus.
    next: Option<u64>,
}

impl Drive {
    /// A drive with the built-in object dictionary: all that CiA 402 asks of a servo drive with the
    /// modes PP, PV, HM, CSP, CSV and CST, four PDOs each way of up to eight objects, and a scratch
    /// domain (0x2000) and text (0x2001) to try transfers on.
    #[must_use]
    pub fn new(settings: &DriveConfig) -> Self {
        Self::with_device(Device::new(settings, None))
    }

    /// A drive with the objects of an EDS (CiA 306). Parameters of motion that the EDS leaves at 0
    /// and no drive has at 0 are as in the built-in dictionary.
    ///
    /// # Errors
    /// The first fault of the text, with its line.
    pub fn from_eds(settings: &DriveConfig, text: &str) -> Result<Self, EdsError> {
        let objects = eds::parse(text, settings.node.get())?;
        Ok(Self::with_device(Device::new(settings, Some(objects))))
    }

    fn with_device(device: Device) -> Self {
        let sdo = SdoServer::new(device.block_support());
        Self { device, sdo, segment_waits: false, next: None }
    }

    /// What the drive is like.
    #[must_use]
    pub const fn settings(&self) -> &DriveConfig {
        &self.device.settings
    }

    /// Node id.
    #[must_use]
    pub const fn node_id(&self) -> NodeId {
        self.device.settings.node
    }

    /// Whether it has its supply.
    #[must_use]
    pub const fn is_powered(&self) -> bool {
        self.device.is_powered()
    }

    /// NMT state. Without supply it is [`NmtState::Initialising`].
    #[must_use]
    pub const fn nmt_state(&self) -> NmtState {
        self.device.network.state()
    }

    /// State of the power stage.
    #[must_use]
    pub const fn state(&self) -> DriveState {
        self.device.axis.state()
    }

    /// The statusword as it is now.
    #[must_use]
    pub fn statusword(&self) -> Statusword {
        self.device.statusword()
    }

    /// Mode of operation in force; `None` is none.
    #[must_use]
    pub const fn mode(&self) -> Option<OperatingMode> {
        self.device.axis.mode()
    }

    /// Actual position (0x6064) in increments.
    #[must_use]
    pub fn position(&self) -> i32 {
        self.device.axis.position()
    }

    /// Where the motor stands, from a zero that neither homing nor a loss of supply moves.
    #[must_use]
    pub fn mechanical_position(&self) -> f64 {
        self.device.axis.motor().position()
    }

    /// Speed in increments per second.
    #[must_use]
    pub fn velocity(&self) -> f64 {
        self.device.axis.motor().velocity()
    }

    /// Torque in thousandths of the rated torque.
    #[must_use]
    pub fn torque(&self) -> f64 {
        self.device.axis.motor().torque()
    }

    /// Position that the controller follows (0x6062), in increments.
    #[must_use]
    pub fn demand(&self) -> i32 {
        self.device.axis.demand()
    }

    /// Demand less actual position (0x60F4), in increments; 0 where no position is controlled.
    #[must_use]
    pub fn following_error(&self) -> i32 {
        self.device.axis.following_error()
    }

    /// The targets that it has received.
    #[must_use]
    pub const fn targets(&self) -> &TargetHistory {
        &self.device.axis.history
    }

    /// Error code of the present fault or warning (0x603F); 0 without.
    #[must_use]
    pub const fn error_code(&self) -> u16 {
        self.device.emergency.code()
    }

    /// Error register (0x1001).
    #[must_use]
    pub const fn error_register(&self) -> ErrorRegister {
        self.device.emergency.register()
    }

    /// Emergency messages sent so far.
    #[must_use]
    pub const fn emergencies_sent(&self) -> u64 {
        self.device.emergency.sent()
    }

    /// SYNCs heard so far.
    #[must_use]
    pub const fn syncs(&self) -> u64 {
        self.device.syncs
    }

    /// PDOs received so far that were long enough and came in OPERATIONAL.
    #[must_use]
    pub const fn received_pdos(&self) -> u64 {
        self.device.received_pdos
    }

    /// The number that an object holds; `None` for one that does not exist or holds bytes. Objects
    /// that the drive keeps up to date are as of the last frame that asked for them.
    #[must_use]
    pub fn object(&self, index: u16, subindex: u8) -> Option<i64> {
        self.device.objects.number(index, subindex)
    }

    /// A fault strikes inside the drive. `code` is that of the emergency message. A drive without
    /// supply, or in a fault already, takes no notice.
    pub fn fail(&mut self, now: u64, code: u16, out: &mut NodeOutput) {
        self.act(now, out, |drive, _| drive.device.fault(code));
    }

    /// The drive sends an emergency message about an error that has come and gone; its state does
    /// not change.
    pub fn warn(&mut self, now: u64, emcy: Emcy, out: &mut NodeOutput) {
        self.act(now, out, |drive, _| {
            let Device { emergency, objects, .. } = &mut drive.device;
            emergency.mention(emcy.code, emcy.register, objects);
        });
    }

    /// The machine is jammed until `until`.
    pub fn block(&mut self, now: u64, until: u64, out: &mut NodeOutput) {
        self.act(now, out, |drive, _| drive.device.axis.block(until));
    }

    /// The supply goes at `now` and comes back at `on_at`. The motor coasts meanwhile.
    pub fn power_cycle(&mut self, now: u64, on_at: u64) {
        self.sdo.restart();
        self.segment_waits = false;
        self.device.switch_off(now, on_at);
        self.next = self.device.next_event();
    }

    /// Does something at `now`, and all that follows from it.
    fn act(
        &mut self,
        now: u64,
        out: &mut NodeOutput,
        action: impl FnOnce(&mut Self, &mut NodeOutput),
    ) {
        if self.device.is_powered() {
            self.device.run_to(now);
            action(self, out);
            self.settle(out);
        }
    }

    fn settle(&mut self, out: &mut NodeOutput) {
        if self.device.network.state() == NmtState::Initialising {
            self.sdo.restart();
        }
        self.device.settle(out);
        self.pump(out);
        self.next = self.device.next_event();
    }

    /// Sends the next segment of a block upload when the one before is on the bus.
    fn pump(&mut self, out: &mut NodeOutput) {
        if self.segment_waits || self.device.is_answering() {
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
        if self.device.sync_id == Some(id) {
            return self.device.on_sync(data, out);
        }
        match CobId::classify(id) {
            Some(Service::Nmt) => {
                if let Some(request) = NmtRequest::parse(data).filter(|nmt| nmt.concerns(node)) {
                    self.device.nmt(request.command);
                }
            }
            Some(Service::SdoClient(server)) if server == node => {
                if self.device.network.communicates() {
                    self.segment_waits = false;
                    if let Some(answer) = self.sdo.receive(data, &mut self.device) {
                        self.device.answer(answer);
                    }
                }
            }
            Some(Service::Heartbeat(producer)) => self.device.heartbeat(producer),
            _ => self.device.on_pdo(id, data),
        }
    }

    /// When the drive has to act by itself at the latest. Until then its controller may tick without
    /// being called, if [`catch_up`](Self::catch_up) follows before anyone looks at the drive.
    pub(crate) const fn next_due(&self) -> Option<u64> {
        self.next
    }

    /// Brings the drive to where the last tick of its controller up to `now` has left it.
    pub(crate) fn catch_up(&mut self, now: u64) {
        self.device.catch_up(now);
    }

    /// A frame has been received; false if it means nothing to this drive, and nothing changed.
    pub(crate) fn takes(&mut self, now: u64, frame: &CanFrame, out: &mut NodeOutput) -> bool {
        let concerns = self.concerns(frame);
        if concerns {
            self.act(now, out, |drive, out| drive.frame(frame, out));
        }
        concerns
    }

    /// Whether a frame means anything to this drive.
    fn concerns(&self, frame: &CanFrame) -> bool {
        self.device.heard.contains(frame.id())
            && frame.kind() == FrameKind::Data
            && self.device.network.state() != NmtState::Initialising
    }
}

impl Node for Drive {
    fn started(&mut self, now: u64, _out: &mut NodeOutput) {
        self.device.switch_on(now);
        self.next = self.device.next_event();
    }

    fn received(&mut self, now: u64, frame: &CanFrame, out: &mut NodeOutput) {
        self.takes(now, frame, out);
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
        self.device.is_on_bus()
    }
}
