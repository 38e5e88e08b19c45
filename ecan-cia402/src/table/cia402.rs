//! The axes of a bus: network, axis table and Port brought together.

use std::time::Duration;

use ecan_canopen::{Network, NmtCommand, NmtError, NodeConfig, SyncConfig};
use ecan_mcan_port::{NotSchedulable, Port, SendOptions};
use ecan_protocol::config::TxMode;
use ecan_protocol::image::Schedule;

use super::error::{AxisFaults, Cia402Error, ScheduleError};
use super::load::{BusLoad, process_data};
use super::lookup::AxisLookup;
use super::shutdown::Shutdown;
use super::table_config::Cia402Config;
use crate::axis::axis::Axis;
use crate::axis::config::AxisConfig;
use crate::axis::setup_steps::BusConfig;
use crate::guard::gateway_watch::GatewayWatch;

/// CiA 402 axes behind the gateways of a Port (manual 15.4, 15.5.4).
///
/// In every cycle, between `cycle_begin` and `cycle_end`:
///
/// ```text
/// cia402.process_rx(port)         TPDOs, SDO answers, heartbeats; what every axis does next
/// cia402.set_target(axis, ..)     where the application wants them
/// cia402.send_targets_all(port)   targets, then SYNC, then SDO, NMT and heartbeat frames
/// ```
///
/// [`send_target_step`](Self::send_target_step) in place of the last two moves every axis by its
/// own step. Both are real-time safe, as is everything that does not say otherwise.
///
/// # Start-up
///
/// [`configure_all`](Self::configure_all) brings the drives to Operational with their PDOs mapped,
/// [`read_position_all`](Self::read_position_all) establishes where the axes are,
/// [`enable_all`](Self::enable_all) enables them there. Each only begins something;
/// [`progress`](Self::progress) says what an axis is doing, for how long, and what hinders it. The
/// calls that end in `_timeout` wait and run the cycle meanwhile.
///
/// # Order on the bus
///
/// All targets of a cycle are handed over ahead of its SYNC, and a channel sends in the order in
/// which it was given frames, so that a SYNC makes the targets of its own cycle effective. While a
/// gateway's last image is repeated, neither targets nor SYNC are handed to it; both go on with the
/// cycle that has a new image. With [`set_scheduled_tx`](Self::set_scheduled_tx) both go out at a
/// phase of Sync0.
///
/// # When the host dies
///
/// Its heartbeat stops. A drive with 0x1016 notices after
/// [`host_heartbeat_ms`](super::DriveConfig::host_heartbeat_ms) and does what its 0x6007 says;
/// one without keeps its last target: SYNC without a new target moves nothing.
///
/// # What happens to targets
///
/// [`MotionGuard`](super::MotionGuard) says in which case an axis gets a target, waits or holds.
/// On top of that:
///
/// - When a gateway's transmit queue refuses a frame of a channel, the axes of the channel that
///   come after it get nothing in this cycle, and all axes of the channel hold from the next one on.
/// - When the working counter makes an axis hold while an image is repeated, the frames of its
///   gateway that are still on the host are given up ([`Port::discard_pending`]); every axis of
///   that gateway then holds, since a target of its own may be among them. SDO transfers and
///   heartbeats that were among them are repeated by their own timeouts.
/// - The application's target is forgotten when an axis holds. Once taken up again it stays where
///   it is until it gets a new one.
/// - An axis that is taken up again while its drive was enabled all the time, and that stands further
///   than its step limit from its last target, is switched off and enabled anew: the drive still
///   holds that target. (Blocked motors do that, and targets that were lost on the way.)
/// - An axis that holds in CSP keeps its last target: the drive stands. In every other mode the
///   drive would go on by itself, so it gets a quick stop, as soon as a frame can be sent.
/// - While an image is repeated no command goes out, either: it would only follow the repeated
///   image later, together with all the others. Commands are sent again in every cycle until the
///   drive shows that it obeyed.
#[derive(Debug)]
pub struct Cia402 {
    pub(super) network: Network,
    pub(super) axes: Vec<Axis>,
    /// By slave.
    pub(super) gateways: Vec<GatewayWatch>,
    pub(super) lookup: AxisLookup,
    pub(super) bus: BusConfig,
    pub(super) sync: SyncConfig,
    pub(super) target_options: SendOptions,
    pub(super) motion_div: u32,
    pub(super) cycles_to_target: u32,
    pub(super) now_ns: u64,
    pub(super) shutdown: Shutdown,
}

impl Cia402 {
    /// Checks the axis table as a whole and sets everything up. Nothing is sent; SYNC and the
    /// host's heartbeat begin with the first cycle. Allocates.
    ///
    /// # Errors
    /// A [`Cia402Error`] that names every fault of the table, or what the Port does not have.
    pub fn new(
        port: &Port,
        axes: Vec<AxisConfig>,
        settings: Cia402Config,
    ) -> Result<Self, Cia402Error> {
        check(&axes)?;
        let slaves = port.slave_count();
        let mut network = Network::new(settings.network);
        network.set_sync(Some(settings.sync))?;
        let mut lookup = AxisLookup::new(slaves);
        let cycles_per_sync = settings.sync.every_cycles.max(1);
        let mut table = Vec::with_capacity(axes.len());
        for (index, axis) in axes.into_iter().enumerate() {
            let address = axis.address;
            let gateway = port
                .config()
                .gateways
                .get(address.slave)
                .ok_or(Cia402Error::NoSuchSlave { axis: index, slave: address.slave, slaves })?;
            let (slave, channel) = (address.slave, address.channel);
            let enabled = gateway.channels.get(usize::from(channel)).and_then(Option::as_ref);
            match enabled.map(|enabled| enabled.can.ram.tx_mode) {
                None => {
                    return Err(Cia402Error::ChannelNotEnabled { axis: index, slave, channel });
                }
                Some(TxMode::Queue) => {
                    return Err(Cia402Error::TransmitQueue { axis: index, slave, channel });
                }
                Some(TxMode::Fifo) => {}
            }
            // The heartbeat is watched once the drive has been told to produce one.
            let node = NodeConfig { heartbeat_timeout: Duration::ZERO, ..settings.node };
            let handle = network.add_node(address, node)?;
            // infallible: the network takes no more nodes than that
            lookup.insert(address, axis.pdo_number, u16::try_from(index).unwrap_or(u16::MAX));
            table.push(Axis::new(index, axis, handle, cycles_per_sync));
        }
        network.set_sync(Some(settings.sync))?;
        let cycle_ns = u64::from(port.adapter().config().cycle_ns());
        let sync_period_ns = cycle_ns * u64::from(cycles_per_sync);
        Ok(Self {
            network,
            axes: table,
            gateways: (0..slaves).map(GatewayWatch::new).collect(),
            lookup,
            bus: BusConfig { sync_period_ns, host: settings.network.host_heartbeat },
            sync: settings.sync,
            target_options: SendOptions::default(),
            motion_div: settings.motion_div.max(1),
            cycles_to_target: 0,
            now_ns: port.adapter().clock().now_ns(),
            shutdown: Shutdown::None,
        })
    }

    /// Number of axes.
    pub fn axis_count(&self) -> usize {
        self.axes.len()
    }

    /// The CANopen network below, for its states and counters.
    pub fn network(&self) -> &Network {
        &self.network
    }

    /// The CANopen network below, for transfers of the application's own. While an axis is being
    /// configured, changes its mode or is homing, the SDO client of its node is taken.
    pub fn network_mut(&mut self) -> &mut Network {
        &mut self.network
    }

    /// Queues an NMT command to all nodes; it goes out with the next
    /// [`send_targets_all`](Self::send_targets_all). Anything but `Start` makes the axes hold.
    ///
    /// # Errors
    /// [`NmtError::QueueFull`].
    pub fn send_nmt_all(&mut self, command: NmtCommand) -> Result<(), NmtError> {
        self.network.nmt_all(command)
    }

    /// Sends targets only in every n-th cycle; 0 counts as 1. The step limit is one per target.
    pub fn set_motion_div(&mut self, motion_div: u32) {
        self.motion_div = motion_div.max(1);
        self.cycles_to_target = 0;
    }

    /// Sends targets and SYNC at phases of the Sync0 period instead of at once, each by itself:
    /// `None` sends at once (manual 8.4, 13.8). Needs distributed clocks.
    ///
    /// A gateway drops a scheduled frame that reaches it behind its phase, and the drive then keeps
    /// the target before it; leave a margin. The gateway's schedule is waited out, too, while stale
    /// targets are drained.
    ///
    /// Only while no axis is taken up: a target at once would overtake one that is still scheduled.
    ///
    /// # Errors
    /// A [`ScheduleError`]; nothing was changed.
    pub fn set_scheduled_tx(
        &mut self,
        port: &Port,
        target_offset_ns: Option<u32>,
        sync_offset_ns: Option<u32>,
    ) -> Result<(), ScheduleError> {
        if let Some(axis) = self.axes.iter().find(|axis| axis.is_active()) {
            return Err(ScheduleError::Active { axis: axis.index });
        }
        for offset_ns in [target_offset_ns, sync_offset_ns].into_iter().flatten() {
            self.check_offset(port, offset_ns)?;
        }
        if let (Some(target_offset_ns), Some(sync_offset_ns)) = (target_offset_ns, sync_offset_ns)
            && sync_offset_ns < target_offset_ns
        {
            return Err(ScheduleError::SyncFirst { target_offset_ns, sync_offset_ns });
        }
        let at = |offset: Option<u32>| offset.map(|offset_ns| Schedule { tag: 0, offset_ns });
        self.target_options.schedule = at(target_offset_ns);
        self.sync.schedule = at(sync_offset_ns);
        // infallible: the counter, the only thing that is checked, is as it was
        let _ = self.network.set_sync(Some(self.sync));
        let waits = self.cycles_in_schedule(port, target_offset_ns);
        for axis in &mut self.axes {
            axis.schedule_images = waits;
            axis.set_mode(axis.mode);
        }
        Ok(())
    }

    fn check_offset(&self, port: &Port, offset_ns: u32) -> Result<(), ScheduleError> {
        for axis in &self.axes {
            let slave = axis.settings.address.slave;
            port.gateway(slave)
                .map_err(|_| NotSchedulable::NotSupported)
                .and_then(|gateway| port.schedule_margin(gateway, offset_ns))
                .map_err(|reason| ScheduleError::NotSchedulable { slave, offset_ns, reason })?;
        }
        Ok(())
    }

    /// Cycles that a frame may wait in a gateway for its phase: two Sync0 periods.
    fn cycles_in_schedule(&self, port: &Port, offset_ns: Option<u32>) -> u16 {
        let config = port.adapter().config();
        match (offset_ns, config.dc) {
            (Some(_), Some(dc)) => {
                let cycles =
                    (2 * u64::from(dc.cycle_ns)).div_ceil(u64::from(config.cycle_ns()).max(1));
                u16::try_from(cycles).unwrap_or(u16::MAX)
            }
            _ => 0,
        }
    }

    /// How much of each CAN bus the process data take, by the bit rates of the Port; a channel that
    /// has axes each. Allocates.
    pub fn bus_load(&self, port: &Port) -> Vec<BusLoad> {
        let mut channels: Vec<(usize, u8)> = self
            .axes
            .iter()
            .map(|a| (a.settings.address.slave, a.settings.address.channel))
            .collect();
        channels.sort_unstable();
        channels.dedup();
        let axes = self.axes.iter().map(|a| (a.settings.address, a.settings.pdo_number, a.layout));
        let offset_ns = self.target_options.schedule.map(|schedule| schedule.offset_ns);
        let streams = process_data(axes, &self.sync, self.motion_div, offset_ns);
        let cycle_ns = port.adapter().config().cycle_ns();
        let load = |place: (usize, u8)| {
            let gateway = port.config().gateways.get(place.0)?;
            let channel = gateway.channels.get(usize::from(place.1))?.as_ref()?;
            Some(BusLoad::of(place, &streams, &channel.can, cycle_ns))
        };
        channels.into_iter().filter_map(load).collect()
    }
}

fn check(axes: &[AxisConfig]) -> Result<(), AxisFaults> {
    let mut faults = Vec::new();
    for (index, axis) in axes.iter().enumerate() {
        axis.check(&mut |fault| faults.push((index, fault)));
    }
    if faults.is_empty() { Ok(()) } else { Err(AxisFaults { faults }) }
}
