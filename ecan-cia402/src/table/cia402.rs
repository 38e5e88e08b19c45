//! All axes of a bus: network, axis table and Port together.

use std::time::Duration;

use ecan_canopen::{Network, NmtCommand, NmtError, NodeConfig, SyncConfig};
use ecan_host::QuickStops;
use ecan_mcan_port::{NotSchedulable, Port, SendOptions};
use ecan_protocol::image::Schedule;

use super::load::{BusLoad, process_data};
use super::path_stop::{PathGroup, PathStop};
use super::shared_node::{AxisLookup, SharedNode};
use super::shutdown::{Ending, Shutdown};
use super::table_config::{Cia402Config, Cia402Error, ScheduleError, TargetClock, checked};
use crate::axis::axis::Axis;
use crate::axis::config::AxisConfig;
use crate::axis::error::CommandError;
use crate::axis::plan::AxisPlan;
use crate::axis::setup_steps::{self, BusConfig};
use crate::axis::status::AxisProgress;
use crate::axis::targets::interpolation_time;
use crate::guard::gateway_watch::GatewayWatch;
use crate::observation;

/// CiA 402 axes on the gateways of a Port (manual 15.4, 15.5.4).
///
/// In every cycle:
///
/// ```text
/// cia402.process_rx(cycle)                TPDOs, SDO answers, heartbeats; next step of every axis
/// cia402.axis_mut(index)?.set_target(..)  targets of the application
/// cia402.send_targets_all(cycle)          targets, then SYNC, then SDO, NMT and heartbeat frames
/// ```
///
/// [`send_target_step`](Self::send_target_step) in place of the last two moves every axis by its
/// own step. All calls are real-time safe unless they state otherwise.
///
/// # Startup
///
/// [`configure`](crate::AxisHandle::configure) brings a drive to Operational with its PDOs mapped,
/// [`read_position`](crate::AxisHandle::read_position) establishes the position of the axis,
/// [`enable`](crate::AxisHandle::enable) enables it there. Each call only starts an operation;
/// [`progress`](crate::AxisRef::progress) reports its phase, its time and its error. The calls of
/// [`blocking`](Self::blocking) wait and run the cycle themselves.
///
/// # Order on the bus
///
/// All targets of a cycle are sent before its SYNC, and a channel sends in the order in which it
/// received frames, so a SYNC makes the targets of its own cycle effective. While a gateway's last
/// image is unconfirmed, neither targets nor SYNC are sent to it; both continue in the cycle that
/// has a new image. With [`set_scheduled_tx`](Self::set_scheduled_tx) both are sent at a phase of
/// Sync0.
///
/// # If the host stops
///
/// Its heartbeat stops. A drive with 0x1016 detects this after
/// [`host_heartbeat_ms`](crate::DriveConfig::host_heartbeat_ms) and reacts by its 0x6007. One
/// without keeps its last target: it stops in CSP and runs on in other modes.
/// [`host_loss`](crate::AxisRef::host_loss) reports the reaction of each drive as read back,
/// [`host_loss_risks`](Self::host_loss_risks) the drives that would run on or coast.
///
/// # Targets
///
/// [`MotionGuard`](crate::MotionGuard) documents when an axis gets a target, waits or holds. In
/// addition:
///
/// - A target takes effect with a SYNC. A running axis gets one only once per
///   [target period](Cia402Config::target_cycles), in a cycle whose SYNC can be sent, and not before
///   the SYNC of its last target was sent. So step limit, ramp and target step apply to what the
///   drive executes, and its interpolation time 0x60C2 is the target period.
/// - Frames that wait in a gateway are released together. While frames of a channel that were sent
///   before the newest image wait there, its axes get no target and no SYNC
///   ([`WaitReason::Backlog`](crate::WaitReason::Backlog)); commands still go out, with SYNC. So after
///   an occupied bus at most three targets take effect together, four if it was occupied repeatedly
///   (and more by the cycles that a scheduled frame waits in the gateway), after a stall of the
///   gateway two: the drive follows at most as many step limits in one target period. A scheduled frame that is late is dropped, and the next target
///   makes its step, too.
/// - If a gateway's transmit queue rejects a frame of a channel, the later axes of the channel send
///   nothing in this cycle, and all axes of the channel hold from the next one on.
/// - If the working counter makes an axis hold while an image is unconfirmed, the frames of its
///   gateway that are still on the host are discarded ([`Port::discard_pending`]); then every axis
///   of that gateway holds, since a target of its own may be among them. Timeouts repeat the SDO
///   transfers and heartbeats that were among them.
/// - When an axis holds, the application's target is dropped. After its activation the axis stays
///   at its position until it gets a new target.
/// - An axis that is activated while its drive was enabled all the time, and that is further than
///   its step limit from its last target, is switched off and enabled again, because the drive
///   still holds that target. (Causes are a blocked motor, or targets that were lost.)
/// - An axis that holds in CSP keeps its last target: the drive is at standstill. In every other
///   mode the drive would continue to move, so it gets a quick stop as soon as a frame can be sent.
/// - While an image is unconfirmed no command is sent, either: it would only follow the repeated
///   image later, together with all others. Commands are repeated in every cycle until the drive
///   reports that it has executed them.
///
/// # Stops
///
/// A stop acts on an axis in every state, configured or not. Its command goes out in process data, and
/// by SDO where process data do not reach the drive: not configured, not verified, not Operational, or
/// silent. It is repeated until the drive reports that it is off, or at rest in Quick Stop Active. Only
/// that ends it; [`enable`](crate::AxisHandle::enable) and [`configure`](crate::AxisHandle::configure) wait for it. Voltage is
/// not disabled while a quick stop brakes. [`AxisPhase`](crate::AxisPhase) distinguishes `Stopping`,
/// `Stopped`, and `Uncontrolled`: a drive that may be moving and does not report.
#[derive(Debug)]
pub struct Cia402 {
    pub(super) network: Network,
    pub(super) axes: Vec<Axis>,
    pub(super) shared_nodes: Vec<SharedNode>,
    /// By slave.
    pub(super) gateways: Vec<GatewayWatch>,
    pub(super) lookup: AxisLookup,
    pub(super) bus: BusConfig,
    pub(super) sync: SyncConfig,
    pub(super) target_options: SendOptions,
    pub(super) clock: TargetClock,
    pub(super) now_ns: u64,
    /// Numbers of the cycles of the Adapter in which frames were received and targets sent last.
    pub(super) received_cycle: u64,
    pub(super) sent_cycle: u64,
    pub(super) ending: Ending,
    pub(super) path_group: PathGroup,
    /// A channel gets neither SYNC nor the host's heartbeat, because of an axis without a first
    /// contact.
    pub(super) is_paused: bool,
    /// Commands of observers.
    pub(super) quick_stops: QuickStops,
}

impl Cia402 {
    /// Checks the axis table as a whole and creates the axes. Sends nothing. Allocates.
    ///
    /// In the first cycles the state of every drive is read by SDO. A drive that is enabled, because
    /// another object or program left it so, is stopped or adopted
    /// ([`Cia402Config::takeover`]). SYNC and the host's heartbeat start on a channel when this is done
    /// for all its axes, so that no drive is kept running unseen.
    ///
    /// # Errors
    /// A [`Cia402Error`] that names every fault of the table, or a missing gateway or channel.
    pub fn new(
        port: &Port,
        axes: Vec<AxisConfig>,
        config: Cia402Config,
    ) -> Result<Self, Cia402Error> {
        let clock = TargetClock::new(port.adapter().config().cycle_ns(), &config);
        let axes = checked(port, axes, &config)?;
        let slaves = port.slave_count();
        let mut network = Network::new(config.network);
        network.set_sync(Some(config.sync))?;
        let mut lookup = AxisLookup::new(slaves);
        let bus = config.bus(&clock);
        let mut table = Vec::with_capacity(axes.len());
        for (index, (axis, ramp)) in axes.into_iter().enumerate() {
            let address = axis.address;
            let (slave, channel) = (address.slave, address.channel);
            // The heartbeat is watched once the drive has been told to produce one.
            let node = NodeConfig { heartbeat_timeout: Duration::ZERO, ..config.node };
            let handle = match network.find(address) {
                Some(handle) => handle,
                None => network.add_node(address, node)?,
            };
            // infallible: the network takes no more nodes than that
            let number = u16::try_from(index).unwrap_or(u16::MAX);
            let tpdos = axis.layout().tpdo_count();
            lookup.insert(address, (0..tpdos).map(|nth| axis.tpdo_id(nth)), number);
            // Until the state of the drive is known, nothing keeps it running.
            network.set_paused(slave, channel, true);
            let plan = AxisPlan::new(index, axis, handle, clock.sync(), config.takeover);
            table.push(Axis::new(plan, ramp, clock.target_period()));
        }
        let shared_nodes = SharedNode::find(&mut table);
        load_steps(&mut table, &mut network, &bus)?;
        observation::reserve(port.adapter(), table.iter().map(|axis| &axis.plan.config));
        Ok(Self {
            quick_stops: port.adapter().publisher().quick_stops(table.len()),
            network,
            axes: table,
            shared_nodes,
            gateways: (0..slaves)
                .map(|slave| GatewayWatch::new(slave, clock.sync().cycles))
                .collect(),
            lookup,
            bus,
            is_paused: true,
            sync: config.sync,
            target_options: SendOptions::default(),
            clock,
            now_ns: port.adapter().clock().now_ns(),
            received_cycle: 0,
            sent_cycle: 0,
            ending: Ending::new(),
            path_group: PathGroup::default(),
        })
    }

    // Stop of all axes

    /// Brings all axes to rest and keeps them enabled, the CSP axes together on their path; targets
    /// of the application are ignored until [`resume`](crate::AxisHandle::resume). Real-time safe.
    ///
    /// The running CSP axes continue straight in the direction of their last targets, also from a
    /// curve, and decelerate by one common profile: it has the acceleration and jerk at which no
    /// axis exceeds its [`ramp`](AxisConfig::ramp) or its
    /// [`limits`](AxisConfig::limits), and so takes as long as the axis that needs longest. It
    /// begins with the acceleration of that axis in the direction of the motion; acceleration across
    /// the direction ends at once. Each target is within an increment of the straight line.
    ///
    /// A target is only sent if every one of these axes can get one in the cycle; otherwise none
    /// moves. After more than two target periods without targets the drives are at rest, and the axes
    /// stay where they are on the path. A lost EtherCAT frame or an occupied bus can delay targets that
    /// were sent: an axis is then up to three steps behind, on the same line, until they arrive. If an
    /// axis holds, leaves Operation Enabled, is resumed or cannot move on (a bound, the end of its
    /// counter, a motor that does not follow), or if the frame of one is rejected, the others stop by
    /// their own ramps from their motion of that moment.
    ///
    /// All other axes stop as by [`halt`](crate::AxisHandle::halt). [`path_stop`](Self::path_stop) reports the
    /// state, [`AxisRef::is_at_rest`](crate::AxisRef::is_at_rest) when an axis is at rest. A call during the stop changes
    /// nothing for axes that are part of it.
    pub fn stop_together(&mut self) {
        self.path_group.stop(&mut self.axes);
    }

    /// State of the last [`stop_together`](Self::stop_together).
    pub fn path_stop(&self) -> PathStop {
        self.path_group.state()
    }

    /// Starts an orderly end: every axis comes to rest by its ramp, is switched off and released:
    /// it stops watching the host's heartbeat and goes to Pre-operational, so that no drive
    /// reports a fault when the host ends. Axes in every state are switched off; a drive that does not
    /// report this is not released, so that its own watch stops it.
    /// [`shutdown_state`](Self::shutdown_state) reports when it is complete. A stage that an axis
    /// cannot finish ends after five seconds: [`all_stopped`](Self::all_stopped) states whether the
    /// drives are off.
    ///
    /// Mode changes and homings are cancelled. The cycle continues as before.
    pub fn begin_shutdown(&mut self) {
        self.ending.begin(&mut self.axes, &mut self.network, self.now_ns);
    }

    /// State of the orderly end.
    pub fn shutdown_state(&self) -> Shutdown {
        self.ending.state()
    }

    /// Longest time for which the end of a program waits until the axes have stopped
    /// ([`stop_before_end`](Self::stop_before_end), [`AxisOwner`](crate::AxisOwner), the deinit functions of C); 10 s.
    pub fn stop_time(&self) -> Duration {
        self.ending.stop_time
    }

    /// Sets the time for which the end of a program waits. Zero leaves the axes as they are, for a program
    /// whose successor adopts them ([`Takeover::Adopt`](crate::Takeover::Adopt)).
    pub fn set_stop_time(&mut self, stop_time: Duration) {
        self.ending.stop_time = stop_time;
    }

    // Network and times

    /// The CANopen network, for its states and counters.
    pub fn network(&self) -> &Network {
        &self.network
    }

    /// The CANopen network, for transfers of the application. During configuration, mode change and
    /// homing of an axis, the SDO client of its node is in use.
    pub fn network_mut(&mut self) -> &mut Network {
        &mut self.network
    }

    /// Queues an NMT command to all nodes, sent by the next
    /// [`send_targets_all`](Self::send_targets_all). Any command but `Start` makes the axes hold.
    ///
    /// # Errors
    /// [`NmtError::QueueFull`].
    pub fn send_nmt_all(&mut self, command: NmtCommand) -> Result<(), NmtError> {
        self.network.nmt_all(command)
    }

    /// Changes [`Cia402Config::motion_div`], and with it the
    /// [target period](Cia402Config::target_cycles). Only while no axis is configured: the
    /// configuration writes the target period to the drives as interpolation time 0x60C2. Allocates.
    ///
    /// # Errors
    /// [`CommandError::Configured`], [`CommandError::TargetPeriod`], or [`CommandError::Limit`] of
    /// [`MotionLimits`](crate::MotionLimits); nothing is changed.
    pub fn set_motion_div(&mut self, motion_div: u32) -> Result<(), CommandError> {
        let is_in_use = |axis: &&Axis| axis.setup.is_complete() || axis.setup.state().is_pending();
        if let Some(axis) = self.axes.iter().find(is_in_use) {
            return Err(CommandError::Configured { axis: axis.plan.index });
        }
        let clock = self.clock.with_motion_div(motion_div);
        let period_ns = clock.period_ns();
        if interpolation_time(period_ns).is_none()
            && let Some(axis) =
                self.axes.iter().find(|axis| axis.plan.config.needs_interpolation_time())
        {
            return Err(CommandError::TargetPeriod { axis: axis.plan.index, period_ns });
        }
        let target_period = Duration::from_nanos(period_ns);
        for axis in &self.axes {
            let mut fault = None;
            axis.plan.config.at_period(target_period, &mut |found| fault = fault.or(Some(found)));
            if let Some(fault) = fault {
                return Err(CommandError::Limit { axis: axis.plan.index, fault });
            }
        }
        self.bus.target_period_ns = period_ns;
        self.clock = clock;
        for axis in &mut self.axes {
            let lead = axis.path.period().lead();
            axis.set_target_period(clock.target_period().with_lead(lead));
        }
        // infallible: the same objects were mapped when the axes were created
        let _ = load_steps(&mut self.axes, &mut self.network, &self.bus);
        Ok(())
    }

    /// Time from target to target: the one for which step limit, ramp and target step apply.
    pub fn target_period(&self) -> Duration {
        Duration::from_nanos(self.bus.target_period_ns)
    }

    /// Sends targets and SYNC at phases of the Sync0 period instead of at once, independently of each
    /// other: `None` sends at once (manual 8.4, 13.8). Requires distributed clocks.
    ///
    /// A gateway drops a scheduled frame that arrives after its phase, and the drive then keeps its
    /// previous target; leave a margin. The drain of old targets includes the gateway's schedule.
    ///
    /// Where SYNC leaves before the targets, at an earlier phase or at once, it makes the targets of the SYNC period
    /// before effective: motion, drains and stops take one SYNC period more. If only one of both is scheduled, its
    /// phase must not be a time at which frames that are sent at once are on the bus: a target would
    /// take effect with one or another SYNC (docs/SAFETY.md, residual risks).
    ///
    /// Only while no axis is active: an immediate target would overtake one that is still scheduled.
    ///
    /// # Errors
    /// A [`ScheduleError`]; nothing is changed.
    pub fn set_scheduled_tx(
        &mut self,
        port: &Port,
        target_offset_ns: Option<u32>,
        sync_offset_ns: Option<u32>,
    ) -> Result<(), ScheduleError> {
        if let Some(axis) = self.axes.iter().find(|axis| axis.path.is_active()) {
            return Err(ScheduleError::Active { axis: axis.plan.index });
        }
        for offset_ns in [target_offset_ns, sync_offset_ns].into_iter().flatten() {
            self.check_offset(port, offset_ns)?;
        }
        let at = |offset: Option<u32>| offset.map(|offset_ns| Schedule { tag: 0, offset_ns });
        self.target_options.schedule = at(target_offset_ns);
        self.sync.schedule = at(sync_offset_ns);
        // infallible: the counter, the only thing that is checked, is as it was
        let _ = self.network.set_sync(Some(self.sync));
        let waits = self.cycles_in_schedule(port, target_offset_ns);
        let longest = waits.max(self.cycles_in_schedule(port, sync_offset_ns));
        self.gateways.iter_mut().for_each(|gateway| gateway.schedule_images = longest);
        let lead = if self.is_sync_first() { self.sync.every_cycles.max(1) } else { 0 };
        for axis in &mut self.axes {
            axis.set_schedule(lead, waits);
        }
        Ok(())
    }

    /// Returns whether the SYNC of an image leaves before its targets, which take effect with the next SYNC.
    pub(super) fn is_sync_first(&self) -> bool {
        let phase = |schedule: Option<Schedule>| schedule.map(|schedule| schedule.offset_ns);
        // A frame without a phase leaves at once, before all others.
        phase(self.target_options.schedule) > phase(self.sync.schedule)
    }

    fn check_offset(&self, port: &Port, offset_ns: u32) -> Result<(), ScheduleError> {
        for axis in &self.axes {
            let slave = axis.plan.config.address.slave;
            port.gateway(slave)
                .map_err(|_| NotSchedulable::NotSupported)
                .and_then(|gateway| port.schedule_margin(gateway, offset_ns))
                .map_err(|reason| ScheduleError::NotSchedulable { slave, offset_ns, reason })?;
        }
        Ok(())
    }

    /// Most cycles that a frame waits in a gateway for its phase: two Sync0 periods.
    fn cycles_in_schedule(&self, port: &Port, offset_ns: Option<u32>) -> u16 {
        let config = port.adapter().config();
        match (offset_ns, config.dc) {
            (Some(_), Some(dc)) => {
                let cycles =
                    (2 * u64::from(dc.cycle_ns())).div_ceil(u64::from(config.cycle_ns()).max(1));
                u16::try_from(cycles).unwrap_or(u16::MAX)
            }
            _ => 0,
        }
    }

    pub(super) fn progress_of(&self, select: impl Fn(&Axis) -> bool) -> Vec<AxisProgress> {
        let selected = self.axes.iter().filter(|axis| select(axis));
        selected.map(|axis| axis.progress(self.now_ns)).collect()
    }

    /// Load of each channel that has axes by the process data, at the bit rates of the Port. Allocates.
    pub fn bus_load(&self, port: &Port) -> Vec<BusLoad> {
        let mut channels: Vec<(usize, u8)> = self
            .axes
            .iter()
            .map(|a| (a.plan.config.address.slave, a.plan.config.address.channel))
            .collect();
        channels.sort_unstable();
        channels.dedup();
        let axes = self.axes.iter().map(|axis| (&axis.plan.config, &axis.plan.layout));
        let offset_ns = self.target_options.schedule.map(|schedule| schedule.offset_ns);
        let streams = process_data(axes, &self.sync, self.clock.cycles(), offset_ns);
        let cycle_ns = self.clock.cycle_ns();
        let load = |address: (usize, u8)| {
            let gateway = port.config().gateways.get(address.0)?;
            let channel = gateway.channels.get(usize::from(address.1))?.as_ref()?;
            let is_here = |axis: &&Axis| {
                (axis.plan.config.address.slave, axis.plan.config.address.channel) == address
            };
            let axes = self.axes.iter().filter(is_here).count() as u32;
            Some(BusLoad::of(address, axes, &streams, &channel.can, cycle_ns))
        };
        channels.into_iter().filter_map(load).collect()
    }
}

/// Prepares the steps of the configuration of each node, in its first axis. Allocates.
fn load_steps(
    axes: &mut [Axis],
    network: &mut Network,
    bus: &BusConfig,
) -> Result<(), Cia402Error> {
    for index in 0..axes.len() {
        let Some(first) = axes.get(index).filter(|axis| axis.setup.node_share.is_first) else {
            continue;
        };
        let of_node: Vec<&AxisConfig> = axes
            .iter()
            .filter(|axis| axis.plan.node == first.plan.node)
            .map(|axis| &axis.plan.config)
            .collect();
        let steps = setup_steps::steps(&of_node, bus)
            .map_err(|error| Cia402Error::Mapping { axis: index, error })?;
        if let Some(axis) = axes.get_mut(index) {
            axis.setup.load_steps(&axis.plan, network, steps);
        }
    }
    Ok(())
}
