//! Plan of a trial, drawn from its seed: the machine, the application and what happens to them.

use std::time::Duration;

use ecan_canopen::{
    HostHeartbeat, NodeAddress, NodeId, OperatingMode, QuickStopOption, SyncConfig,
};
use ecan_cia402::{
    AxisConfig, Cia402Config, FeedForwardLimits, HomingConfig, OutputObject, Takeover,
};
use ecan_sim::variant::Choice;
use ecan_sim::{
    DriveConfig, DriveFault, Fault, GatewayFault, LibraryCall, LossDirection, Topology,
};

use crate::random::Random;
use crate::variants;

pub mod histories;
mod scheduled;
mod shared_nodes;
mod text;

pub const MS: u64 = 1_000_000;

/// Increments per second of the fastest CSP axis. The motor changes its velocity by 200,000/s in a
/// controller period, so it follows a reversal at this speed within one.
const FASTEST_CSP: i64 = 100_000;
const FASTEST_CSV: i64 = 250_000;
/// The same in revolutions per minute of the simulated motor.
const FASTEST_VL: i64 = FASTEST_CSV * 60 / 65_536;
/// Most RPDOs of a channel: with SYNC, more than six frames per cycle cannot be paced.
const MOST_RPDOS: usize = 5;
/// The least friction: a motor without current comes to rest while the trial lasts.
const FRICTION: [u32; 3] = [3_000_000, 5_000_000, 15_000_000];
/// Acceleration per thousandth of the rated torque, by the default motor.
const PER_MILLE: u32 = 200_000_000 / 3_000;

fn on_channel(axes: &[AxisPlan], slave: usize, channel: u8) -> impl Iterator<Item = &AxisPlan> {
    axes.iter().filter(move |axis| {
        (axis.config.address.slave, axis.config.address.channel) == (slave, channel)
    })
}

/// RPDOs of the axes on a channel.
pub fn rpdos_on(axes: &[AxisPlan], slave: usize, channel: u8) -> usize {
    on_channel(axes, slave, channel).map(|axis| axis.config.layout().rpdo_count()).sum()
}

pub struct Plan {
    pub seed: u64,
    pub gateways: usize,
    pub topology: Topology,
    /// The gateways have aliases.
    pub has_aliases: bool,
    /// What the gateways do differently.
    pub variants: Vec<Choice>,
    /// Distributed clocks, and the phases of targets and SYNC, ns.
    pub clock: Option<(Option<u32>, Option<u32>)>,
    pub cycle_ns: u64,
    pub table: Cia402Config,
    pub axes: Vec<AxisPlan>,
    pub app: AppPlan,
    /// In the order of their times.
    pub events: Vec<Event>,
    /// Duration of the part with events, ns.
    pub duration_ns: u64,
}

pub struct AxisPlan {
    pub config: AxisConfig,
    pub drive: DriveConfig,
    pub style: Style,
}

/// Behaviour of the application apart from the events.
pub struct AppPlan {
    /// The events never begin before all axes run; otherwise mostly.
    pub starts_undisturbed: bool,
    /// An operator brings axes back during the events, too, with this period.
    pub operator_ns: Option<u64>,
    /// The operator uses `recover`.
    pub recovers: bool,
    /// CSP axes move by `send_target_step`.
    pub steps: bool,
    /// Thousandths of the cycles without `process_rx`, and without a send.
    pub skips_rx: u32,
    pub skips_send: u32,
    /// Commands are given before `process_rx`.
    pub commands_first: bool,
    pub end: End,
}

#[derive(Debug, Clone, Copy)]
pub enum End {
    QuickStop,
    Disable,
    Shutdown,
    StopAll,
}

/// Targets of an axis.
#[derive(Debug, Clone, Copy)]
pub enum Style {
    Rest,
    /// By the limit, always in one direction.
    Climb,
    /// By the limit, reversed after this many ms.
    Reverse(u64),
    /// An own trajectory with this period in ms that does not wait for the axis.
    Sine(u64),
    /// Jumps, often beyond the limits.
    Wild,
}

#[derive(Debug, Clone)]
pub struct Event {
    pub at_ns: u64,
    pub action: Action,
}

#[derive(Debug, Clone)]
pub enum Action {
    Fault(Fault),
    /// A fault of the drive of an axis.
    DriveFault(usize, DriveFault),
    Silent(usize, u32),
    /// The process is suspended: time passes without cycles.
    Pause(u32),
    /// The process or the machine stops for this time, in us: between two cycles, or inside the next one,
    /// after its status was processed. Nothing else is wrong.
    LoseTime {
        us: u64,
        inside: bool,
    },
    Command(usize, Command),
    /// To every axis.
    CommandAll(Command),
    /// Cycles without `process_rx`, or without a send, or without both.
    Skip {
        cycles: u32,
        rx: bool,
        send: bool,
    },
    /// A cycle in which the application makes each call twice.
    Twice,
    /// A new `Cia402` on the same Port; it may wait some cycles.
    Replace {
        idle_cycles: u32,
    },
    /// The process ends without any stop, and starts again after this many ms.
    Restart(u32),
    /// `Port::reconfigure` with the same configuration.
    Reconfigure,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    Enable,
    Disable,
    QuickStop,
    Halt,
    Resume,
    ResetFault,
    Configure,
    Recover,
    ReadPosition,
    ChangeMode(OperatingMode),
    Home(HomingConfig),
    /// To the target of the axis, or of all.
    Target(i32),
    StopAll,
}

impl Plan {
    pub fn draw(seed: u64) -> Self {
        let mut random = Random::new(seed);
        let r = &mut random;
        let gateways = if r.chance(30) { 2 } else { 1 };
        let topology = if r.chance(30) { Topology::Star } else { Topology::Line };
        let has_aliases = r.chance(30);
        let clock = r.chance(12).then(|| {
            r.pick(&[
                (None, None),
                (Some(100_000), Some(100_000)),
                (Some(100_000), None),
                (None, Some(300_000)),
            ])
        });
        let count = r.below(4) + 1;
        let cycle_ms = r.pick(&[1, 2, 2, 4]);
        let every_cycles = r.weighted(&[(6, 1), (2, 2), (1, 3)]);
        let motion_div = r.weighted(&[(6, 1), (2, 2), (1, 3), (2, 4)]);
        let cycle_ns = cycle_ms * MS;
        let mut table = Cia402Config {
            sync: SyncConfig { every_cycles, ..SyncConfig::default() },
            motion_div,
            ..Cia402Config::default()
        };
        if r.chance(15) {
            table.takeover = Takeover::Adopt;
        }
        table.network.host_heartbeat = r.chance(75).then(|| HostHeartbeat {
            node: NodeId::MAX,
            period: Duration::from_millis(r.pick(&[20, 50])),
        });
        let target_ms = target_period_cycles(motion_div, every_cycles) * cycle_ms;
        // At 1 ms a channel carries two axes with reserve.
        let per_channel = if cycle_ms == 1 { 2 } else { 4 };
        let mut axes: Vec<AxisPlan> = Vec::new();
        while axes.len() < count {
            let slave = r.below(gateways);
            let channel = r.below(2) as u8;
            let used = on_channel(&axes, slave, channel).count();
            let rpdos = rpdos_on(&axes, slave, channel);
            if used < per_channel && rpdos < MOST_RPDOS {
                let node = NodeId::new(used as u8 + 1).expect("below 127");
                let address = NodeAddress { slave, channel, node };
                let mut axis = AxisPlan::draw(r, axes.len(), address, target_ms);
                let most = if cycle_ms == 1 { 3 } else { MOST_RPDOS };
                if rpdos + axis.config.layout().rpdo_count() > most {
                    axis.config.pdos.outputs.clear();
                }
                axes.push(axis);
            }
        }
        let duration_ns = r.range(1_000, 3_500) as u64 * MS;
        let app = AppPlan {
            starts_undisturbed: false,
            operator_ns: r.chance(65).then(|| r.range(20, 400) as u64 * MS),
            recovers: r.chance(65),
            steps: r.chance(30),
            skips_rx: r.weighted(&[(7, 0), (1, 3), (1, 30), (1, 200)]),
            skips_send: r.weighted(&[(7, 0), (1, 3), (1, 30), (1, 200)]),
            commands_first: r.chance(30),
            end: r.pick(&[End::QuickStop, End::Disable, End::Shutdown, End::StopAll]),
        };
        let mut events = Vec::new();
        for _ in 0..r.range(2, 9) {
            let mut at_ns = r.range(0, duration_ns as i64) as u64;
            events.push(Event { at_ns, action: Action::draw(r, gateways, &axes) });
            // Two and more within 200 ms, often in one cycle.
            while r.chance(45) {
                at_ns += r.pick(&[0, 0, cycle_ns, 5 * MS, 20 * MS, 80 * MS, 190 * MS]);
                events.push(Event { at_ns, action: Action::draw(r, gateways, &axes) });
            }
        }
        events.sort_by_key(|event| event.at_ns);
        let timing = variants::Timing {
            clock,
            target_cycles: target_period_cycles(motion_div, every_cycles),
            sync_cycles: every_cycles.into(),
        };
        let variants = variants::draw(r, &axes, &timing);
        // At 1 ms the frames of two images are in the gateway, whose count must not saturate.
        let keeps_count = cycle_ms > 1
            || axes
                .iter()
                .map(|axis| axis.config.address)
                .all(|a| rpdos_on(&axes, a.slave, a.channel) < 3);
        // Drawn last: everything else of a seed stays.
        let clock = match clock {
            Some((Some(_), Some(sync_ns))) if r.chance(50) && keeps_count => {
                Some((Some(300_000), Some(sync_ns)))
            }
            other => other,
        };
        Self {
            seed,
            gateways,
            topology,
            has_aliases,
            variants,
            clock,
            cycle_ns,
            table,
            axes,
            app,
            events,
            duration_ns,
        }
    }

    /// Time from target to target, ns.
    pub fn target_ns(&self) -> u64 {
        target_period_cycles(self.table.motion_div, self.table.sync.every_cycles) * self.cycle_ns
    }

    /// Returns whether the gateway sends frames at a time after Sync0.
    pub fn schedules_frames(&self) -> bool {
        !matches!(self.clock, None | Some((None, None)))
    }

    /// Returns whether SYNC leaves before the targets of its image.
    pub fn has_sync_first(&self) -> bool {
        self.clock.is_some_and(|(target, sync)| target > sync)
    }

    pub fn sync_ns(&self) -> u64 {
        u64::from(self.table.sync.every_cycles.max(1)) * self.cycle_ns
    }
}

/// Cycles from one effective target to the next: a multiple of the SYNC period, since a target takes
/// effect at SYNC.
fn target_period_cycles(motion_div: u32, every_cycles: u32) -> u64 {
    let every = u64::from(every_cycles.max(1));
    u64::from(motion_div.max(1)).next_multiple_of(every)
}

impl AxisPlan {
    fn draw(r: &mut Random, index: usize, address: NodeAddress, target_ms: u64) -> Self {
        let mode = r.weighted(&[
            (8, OperatingMode::CyclicPosition),
            (4, OperatingMode::CyclicVelocity),
            (2, OperatingMode::CyclicTorque),
            (2, OperatingMode::ProfilePosition),
            (3, OperatingMode::ProfileVelocity),
            (3, OperatingMode::InterpolatedPosition),
            (1, OperatingMode::ProfileTorque),
            (1, OperatingMode::Velocity),
        ]);
        let friction = r.pick(&FRICTION);
        let start = 10_000 * (index as i32 + 1) + r.range(-3_000, 3_000) as i32;
        let mut config = AxisConfig::new(address).with_mode(mode);
        let per_target = |per_second: i64| (per_second * target_ms as i64 / 1_000).max(2) as u32;
        match mode {
            OperatingMode::CyclicVelocity | OperatingMode::ProfileVelocity => {
                let bound = r.range(20_000, FASTEST_CSV) as i32;
                config.bounds = Some((-bound, bound));
                config.step_limit = (bound / r.range(4, 40) as i32).max(1) as u32;
            }
            OperatingMode::Velocity => {
                let bound = r.range(FASTEST_VL / 10, FASTEST_VL) as i32;
                config.bounds = Some((-bound, bound));
            }
            OperatingMode::CyclicTorque | OperatingMode::ProfileTorque => {
                let bound = (friction / PER_MILLE) as i32 + r.range(4, 15) as i32;
                config.bounds = Some((-bound, bound));
                config.step_limit = r.range(1, 40) as u32;
            }
            OperatingMode::ProfilePosition => {
                config.step_limit = per_target(r.range(10_000, FASTEST_CSP));
                config.bounds = Some((start - 150_000, start + 150_000));
            }
            _ => {
                config.step_limit = per_target(r.range(10_000, FASTEST_CSP));
                let reach = r.pick(&[20_000, 100_000, 400_000]);
                config.bounds = r.chance(50).then(|| (start - reach, start + reach));
            }
        }
        config.standstill = config.standstill.min(config.step_limit);
        config.target_step = match mode {
            OperatingMode::CyclicPosition | OperatingMode::InterpolatedPosition => {
                let limit = i64::from(config.step_limit);
                r.pick(&[limit, -limit, limit / 2]) as i32
            }
            _ => 0,
        };
        config.ramp = (config.step_limit / r.range(2, 20) as u32).max(1);
        config.following_window = config.step_limit.saturating_mul(8).max(r.pick(&[3_000, 10_000]));
        config.auto_resume = r.chance(30);
        config.enable_timeout = Duration::from_secs(2);
        config.drive.quick_stop = r.pick(&[
            None,
            Some(QuickStopOption::SlowDown),
            Some(QuickStopOption::QuickStop),
            Some(QuickStopOption::SlowDownAndStay),
            Some(QuickStopOption::QuickStopAndStay),
        ]);
        if mode == OperatingMode::CyclicPosition && r.chance(50) {
            config.drive.following_error = Some((config.following_window, 20));
        }
        if mode == OperatingMode::InterpolatedPosition {
            config.drive.interpolation_buffer = r.pick(&[None, Some(1), Some(2), Some(4)]);
        }
        if mode == OperatingMode::ProfileTorque {
            config.drive.torque_slope = Some(r.range(100, 2_000) as u32);
        }
        if r.chance(40) {
            draw_feed_forward(r, &mut config, target_ms);
        }
        config.drive.host_heartbeat_ms = r.pick(&[250, 250, 120]);
        let mut drive = DriveConfig::new(address.node);
        drive.serial = index as u32 + 1;
        drive.boot_ms = r.pick(&[20, 40, 120]);
        drive.sdo_delay_us = r.pick(&[100, 200, 800, 3_000]);
        drive.enable_ms = r.weighted(&[(5, 0), (2, 15), (1, 120)]);
        drive.motor.start_position = start;
        drive.motor.friction = friction;
        drive.motor.absolute_encoder = r.chance(70);
        drive.quirks.follows_old_target = r.chance(25);
        drive.quirks.needs_mode = r.chance(30);
        drive.quirks.ignores_quick_stop = r.chance(4);
        drive.quirks.mode_delay_ms = r.weighted(&[(6, 0), (1, 5), (1, 30)]);
        if r.chance(15) {
            drive.quirks.missing.push(0x1016);
        }
        if r.chance(10) {
            drive.quirks.missing.push(0x6007);
        }
        let style = match r.below(8) {
            0 => Style::Rest,
            1 | 2 => Style::Climb,
            3 | 4 => Style::Reverse(r.range(20, 600) as u64),
            5 | 6 => Style::Sine(r.range(200, 2_000) as u64),
            _ => Style::Wild,
        };
        Self { config, drive, style }
    }

    pub fn node_name(&self) -> String {
        let NodeAddress { slave, channel, node } = self.config.address;
        format!("drive {slave}.{channel}/{node}")
    }
}

/// Velocity offsets up to the velocity limit of the axis, torque offsets below its friction.
fn draw_feed_forward(r: &mut Random, config: &mut AxisConfig, target_ms: u64) {
    let objects = match config.mode {
        OperatingMode::CyclicPosition => r.pick(&[
            &[OutputObject::VelocityOffset, OutputObject::TorqueOffset][..],
            &[OutputObject::VelocityOffset],
            &[OutputObject::TorqueOffset],
        ]),
        OperatingMode::CyclicVelocity => &[OutputObject::TorqueOffset],
        _ => return,
    };
    config.pdos.outputs = objects.to_vec();
    let velocity = config.step_limit.saturating_mul(1_000) / target_ms as u32;
    let torque = r.range(5, 20) as u16;
    config.feed_forward = FeedForwardLimits {
        velocity,
        velocity_change: (velocity / r.range(4, 40) as u32).max(1),
        torque,
        torque_change: r.range(1, torque.into()) as u16,
    };
}

impl Action {
    fn draw(r: &mut Random, gateways: usize, axes: &[AxisPlan]) -> Self {
        match r.below(100) {
            0..45 => Self::draw_fault(r, gateways, axes),
            45..82 => {
                let command = Command::draw(r, axes);
                let axis = r.below(axes.len());
                let is_for_one = matches!(
                    command,
                    Command::ChangeMode(_) | Command::Home(_) | Command::Target(_)
                );
                if r.chance(15) && !is_for_one {
                    Self::CommandAll(command)
                } else {
                    Self::Command(axis, command)
                }
            }
            82..90 => {
                let cycles = r.pick(&[1, 1, 2, 3, 8, 40]);
                let (rx, send) =
                    r.weighted(&[(3, (true, false)), (2, (false, true)), (2, (true, true))]);
                Self::Skip { cycles, rx, send }
            }
            90..94 => Self::Pause(r.pick(&[3, 10, 40, 150, 400])),
            94..98 => Self::Replace { idle_cycles: r.pick(&[0, 0, 1, 20]) },
            98 => Self::Restart(r.pick(&[0, 20, 100, 600])),
            _ => Self::Reconfigure,
        }
    }

    fn draw_fault(r: &mut Random, gateways: usize, axes: &[AxisPlan]) -> Self {
        let axis = r.below(axes.len());
        let address = axes[axis].config.address;
        let gateway = if r.chance(70) { address.slave } else { r.below(gateways) };
        let channel = usize::from(address.channel);
        let inside = |fault| Self::Fault(Fault::Gateway { gateway, fault });
        match r.below(29) {
            0..=3 => {
                let direction = r.pick(&[LossDirection::Outward, LossDirection::Return]);
                let cycles = r.range(1, 10) as u32;
                Self::Fault(Fault::LostFrame { direction, cycles })
            }
            4 => {
                let cycles = r.range(1, 8) as u32;
                Self::Fault(Fault::WorkingCounterOffset { offset: r.pick(&[-1, -3, 1]), cycles })
            }
            5 | 6 => Self::Fault(Fault::BusOff { gateway, channel }),
            7 => {
                let frames = r.range(1, 25) as u32;
                Self::Fault(Fault::ErrorFrames { gateway, channel, frames })
            }
            8..=10 => Self::Silent(axis, r.pick(&[2, 15, 60, 300, 1_500])),
            11 | 12 => Self::DriveFault(axis, DriveFault::Error { code: 0x2310 }),
            13 => Self::DriveFault(axis, DriveFault::Emcy { code: 0x4210, register: 9 }),
            14 | 15 => {
                let off_ms = r.pick(&[1, 30, 300]);
                Self::DriveFault(axis, DriveFault::PowerCycle { off_ms })
            }
            16 => {
                let for_ms = r.pick(&[5, 40, 300]);
                Self::DriveFault(axis, DriveFault::Blocked { for_ms })
            }
            17 | 18 => Self::Fault(Fault::PowerCycle { gateway, off_ms: r.pick(&[5, 50, 300]) }),
            19 => Self::Fault(Fault::LinkLoss { gateway, for_ms: r.pick(&[2, 10, 60, 300]) }),
            20 => inside(GatewayFault::TornTxPdo { images: r.range(1, 6) as u32 }),
            21 => inside(GatewayFault::CrcErrorTxPdo { images: r.range(1, 6) as u32 }),
            22 | 23 => inside(GatewayFault::ServiceStall { ms: r.range(1, 25) as u32 }),
            24 => inside(GatewayFault::AlError { code: 0x001B }),
            27 => inside(GatewayFault::ClockJump { ns: r.range(-2_000_000, 2_000_000) }),
            25 => {
                let times = r.range(1, 3) as u32;
                Self::Fault(Fault::LibraryError {
                    call: r.pick(&LibraryCall::ALL),
                    errno: 4,
                    times,
                })
            }
            26 => Self::Fault(Fault::RequestsHeld { for_ms: r.pick(&[100, 1_500]) }),
            _ => inside(GatewayFault::MailboxSilent { ms: r.pick(&[50, 500, 1_500]) }),
        }
    }
}

impl Command {
    fn draw(r: &mut Random, axes: &[AxisPlan]) -> Self {
        match r.below(32) {
            0..=5 => Self::Enable,
            6..=9 => Self::Disable,
            10..=14 => Self::QuickStop,
            15 | 16 => Self::Halt,
            17 | 18 => Self::Resume,
            19 | 20 => Self::ResetFault,
            21 | 22 => Self::Configure,
            23 => Self::Recover,
            24 => Self::ReadPosition,
            25 => {
                let modes = [
                    OperatingMode::CyclicPosition,
                    OperatingMode::ProfilePosition,
                    OperatingMode::CyclicVelocity,
                    OperatingMode::ProfileVelocity,
                ];
                Self::ChangeMode(r.pick(&modes))
            }
            26 => {
                let method = r.pick(&[35, 37, 33, 19]);
                let timeout = Duration::from_millis(r.pick(&[200, 3_000]));
                Self::Home(HomingConfig {
                    switch_speed: Some(40_000),
                    zero_speed: Some(20_000),
                    timeout,
                    ..HomingConfig::new(method)
                })
            }
            27..=29 => {
                let bounds = axes[r.below(axes.len())].config.bounds.unwrap_or((-1_000, 1_000));
                let far = [i32::MIN, i32::MAX, 0, bounds.0, bounds.1, bounds.1.wrapping_mul(2)];
                Self::Target(r.pick(&far))
            }
            _ => Self::StopAll,
        }
    }
}
