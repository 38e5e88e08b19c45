//! The motion guard over a model of the way to a drive and back, judged by what the drive gets.
//!
//! The model has what the real way has: images that arrive late or twice, a transmit queue that
//! stands still and goes on, a bus that is off, received frames that pile up, a drive that is
//! disabled, pushed and enabled again. Every target has the number of the span in which it was
//! sent, so that the judge knows a stale one when it sees it.

use std::collections::VecDeque;

use ecan_canopen::DriveState;
use proptest::prelude::*;

use super::motion_guard::MotionGuard;
use super::terms::PositionRange;
use super::terms::{Actual, ChannelView, DriveView, GuardInput, PathStatus, PositionUnavailable};
use super::terms::{Decision, GuardLimits, GuardState, TargetKind};

const STEP: i32 = 50;
const WINDOW: i32 = 600;
/// How far a drive moves in a cycle at most.
const SPEED: i32 = 60;
/// How far an axis that rests is off by noise.
const NOISE: i32 = 2;

/// The controlword, as far as it matters: a drive enables only from Switched On.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Command {
    SwitchOn,
    Enable,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Power {
    #[default]
    Off,
    On,
    Enabled,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Frame {
    Target { span: u32, target: i32, command: Command },
    Sync,
}

/// What one cycle does to the model.
#[derive(Debug, Clone, Copy)]
struct CycleConditions {
    /// The image does not reach the gateway.
    lost_out: bool,
    /// The reply does not reach the host.
    lost_back: bool,
    /// Number of cycles from now on in which the bus carries nothing.
    blocked: u8,
    /// The channel is bus-off while blocked, and says so.
    bus_off: bool,
    /// The drive falls out of Operation Enabled.
    fault: bool,
    /// A hand pushes the axis while the drive is disabled.
    push: i32,
    /// Received frames of this cycle stay in the gateway.
    backlog: bool,
    /// What the application does to its target.
    advance: i32,
}

fn conditions() -> impl Strategy<Value = CycleConditions> {
    let rare = || prop::bool::weighted(0.03);
    let blocked = prop_oneof![40 => Just(0_u8), 1 => 1..12_u8];
    let push = prop_oneof![30 => Just(0), 1 => -3000..3000_i32];
    (rare(), rare(), blocked, any::<bool>(), rare(), push, rare(), -STEP..=STEP).prop_map(
        |(lost_out, lost_back, blocked, bus_off, fault, push, backlog, advance)| CycleConditions {
            lost_out,
            lost_back,
            blocked,
            bus_off,
            fault,
            push,
            backlog,
            advance,
        },
    )
}

#[derive(Debug, Default)]
struct Drive {
    position: i32,
    /// Received, effective with the next SYNC.
    received: Option<(u32, i32, Command)>,
    target: Option<(u32, i32)>,
    power: Power,
}

#[derive(Debug, Default)]
struct Gateway {
    /// In the sync manager, not served yet.
    arrived: Vec<Frame>,
    ring: VecDeque<Frame>,
    received: VecDeque<(Power, i32)>,
    /// The image that the next exchange fetches.
    published: Option<Published>,
    blocked: u8,
    bus_off: bool,
}

#[derive(Debug, Clone)]
struct Published {
    tpdos: Vec<(Power, i32)>,
    waits_to_send: usize,
    waits_to_be_read: usize,
    bus_off: bool,
}

struct Model {
    guard: MotionGuard,
    gateway: Gateway,
    drive: Drive,
    span: u32,
    /// Frames of the image that may not have arrived, and whether the gateway has it.
    held: Option<(Vec<Frame>, bool)>,
    confirmed: u64,
    covered: [u64; 3],
    /// State of the drive by the last TPDO that was read.
    seen: Power,
    /// Cycles in a row in which everything came that there was.
    steady: u32,
    firsts: u32,
    targets: u32,
}

impl Model {
    fn new() -> Self {
        let limits = GuardLimits {
            kind: TargetKind::Position,
            range: PositionRange::Linear,
            step: STEP as u32,
            window: WINDOW as u32,
            bounds: None,
            standstill: 2 * NOISE as u32,
            tpdo_timeout: 4,
            wc_misses: 2,
            drain_images: 3,
        };
        Self {
            guard: MotionGuard::new(limits),
            gateway: Gateway::default(),
            drive: Drive::default(),
            span: 0,
            held: None,
            confirmed: 0,
            covered: [0; 3],
            seen: Power::Off,
            steady: 0,
            firsts: 0,
            targets: 0,
        }
    }

    /// Returns whether a target of an older span than the present one is anywhere on its way.
    fn has_stale(&self) -> bool {
        let of_old =
            |frame: &Frame| matches!(frame, Frame::Target { span, .. } if *span < self.span);
        let held = self.held.iter().flat_map(|(frames, _)| frames);
        held.chain(&self.gateway.arrived).chain(&self.gateway.ring).any(of_old)
    }

    fn cycle(&mut self, n: usize, conditions: CycleConditions) -> Result<(), TestCaseError> {
        // The exchange that the last cycle started: the host hears of it now.
        let (complete, image) = self.exchange(conditions);
        let input = self.input(complete, image);
        if self.guard.observe(&input).is_some() {
            self.span += 1;
        }
        self.guard.activate();
        if self.guard.wants_discard() {
            // Discarded by the host; the gateway may have it all the same.
            self.held = None;
        }
        let requested = match self.guard.state() {
            GuardState::Running { target } => Some(target.saturating_add(conditions.advance)),
            _ => None,
        };
        let mut frames = Vec::new();
        let command = if self.seen == Power::Off { Command::SwitchOn } else { Command::Enable };
        match self.guard.decide(requested) {
            Decision::Track(target) => {
                prop_assert!(!self.has_stale(), "at {}: enabling over a stale target", n);
                frames.push(Frame::Target { span: self.span, target, command });
                self.guard.sent();
            }
            Decision::First(target) => {
                prop_assert!(!self.has_stale(), "at {}: a stale target is under way", n);
                frames.push(Frame::Target { span: self.span, target, command });
                self.guard.sent();
                self.firsts += 1;
            }
            Decision::Target(target) => {
                frames.push(Frame::Target { span: self.span, target, command });
                self.guard.sent();
            }
            _ => {}
        }
        if self.held.is_none() {
            frames.push(Frame::Sync);
            self.held = Some((frames, false));
        }
        self.world(n, conditions)
    }

    /// Returns whether the working counter was complete, and the image that came.
    fn exchange(&mut self, conditions: CycleConditions) -> (bool, Option<Published>) {
        if conditions.lost_out {
            return (false, None);
        }
        if let Some((frames, has_arrived)) = &mut self.held
            && !*has_arrived
        {
            self.gateway.arrived.append(&mut frames.clone());
            *has_arrived = true;
        }
        let image = self.gateway.published.take();
        if conditions.lost_back {
            return (false, None);
        }
        if let Some((frames, _)) = self.held.take() {
            self.confirmed += frames.len() as u64;
        }
        (true, image)
    }

    fn input(&mut self, complete: bool, image: Option<Published>) -> GuardInput {
        let flows = complete && self.held.is_none();
        let is_clear = flows && image.as_ref().is_some_and(|image| image.waits_to_be_read == 0);
        self.steady = if is_clear { self.steady + 1 } else { 0 };
        let (actual, channel) = match image {
            None => (Actual::None(PositionUnavailable::NoImage), ChannelView::NotSeen),
            Some(image) => {
                self.covered = [self.confirmed, self.covered[0], self.covered[1]];
                let channel = if image.bus_off {
                    ChannelView::BusOff
                } else {
                    let pending = image.waits_to_send.min(7) as u8;
                    ChannelView::Running { pending, pressure: image.waits_to_send > 30 }
                };
                self.seen = image.tpdos.last().map_or(self.seen, |(power, _)| *power);
                let actual = match (image.tpdos.last(), image.waits_to_be_read) {
                    (None, _) => Actual::None(PositionUnavailable::NoTpdo),
                    (Some((_, position)), 0) if self.steady >= 3 => Actual::Fresh(*position),
                    (Some((_, position)), 0..7) => Actual::Late(*position),
                    (Some(_), _) => Actual::None(PositionUnavailable::Backlog),
                };
                (actual, channel)
            }
        };
        let state = match self.seen {
            Power::Off => DriveState::SwitchOnDisabled,
            Power::On => DriveState::SwitchedOn,
            Power::Enabled => DriveState::OperationEnabled,
        };
        GuardInput {
            path: PathStatus {
                is_complete: complete,
                is_unconfirmed: self.held.is_some(),
                channel,
                confirmed: self.confirmed,
                covered: self.covered[2],
                ..PathStatus::CLEAR
            },
            drive: DriveView {
                state: Some(state),
                heartbeat_lost: false,
                not_operational: false,
                unverified: false,
                follows: true,
                following_error: false,
            },
            actual,
        }
    }

    /// Gateway, bus and drive, until the next exchange.
    fn world(&mut self, n: usize, conditions: CycleConditions) -> Result<(), TestCaseError> {
        let gateway = &mut self.gateway;
        gateway.ring.extend(gateway.arrived.drain(..));
        if gateway.blocked > 0 {
            gateway.blocked -= 1;
            gateway.bus_off &= gateway.blocked > 0;
        } else if conditions.blocked > 0 {
            gateway.blocked = conditions.blocked;
            gateway.bus_off = conditions.bus_off;
        }
        // Nobody pushes an axis in the few milliseconds between reading its position and enabling.
        let is_quiet =
            gateway.ring.iter().all(|frame| *frame == Frame::Sync) && self.drive.received.is_none();
        if is_quiet
            && self.held.iter().all(|(frames, _)| frames.len() == 1)
            && self.drive.power != Power::Enabled
        {
            self.drive.position += conditions.push;
        }
        if conditions.fault {
            self.drive.power = Power::Off;
        }
        for _ in 0..4 {
            if self.gateway.blocked > 0 {
                break;
            }
            let Some(frame) = self.gateway.ring.pop_front() else { break };
            self.on_bus(n, frame)?;
        }
        let drive = &mut self.drive;
        if let Some((_, target)) = drive.target
            && drive.power == Power::Enabled
        {
            drive.position += (target - drive.position).clamp(-SPEED, SPEED);
        }
        let gateway = &mut self.gateway;
        if gateway.published.is_none() {
            let stays = if conditions.backlog { gateway.received.len().min(2) } else { 0 };
            let tpdos = gateway.received.drain(..gateway.received.len() - stays).collect();
            gateway.published = Some(Published {
                tpdos,
                waits_to_send: gateway.ring.len(),
                waits_to_be_read: stays,
                bus_off: gateway.bus_off,
            });
        }
        Ok(())
    }

    /// A frame reaches the drive.
    fn on_bus(&mut self, n: usize, frame: Frame) -> Result<(), TestCaseError> {
        match frame {
            Frame::Target { span, target, command } => {
                self.drive.received = Some((span, target, command));
            }
            Frame::Sync => {
                if let Some((span, target, command)) = self.drive.received.take() {
                    self.apply(n, span, target, command)?;
                }
                let noise = (n as i32 * 7) % (NOISE + 1);
                let sample = (self.drive.power, self.drive.position + noise);
                self.gateway.received.push_back(sample);
            }
        }
        Ok(())
    }

    /// The judge: the drive takes a target.
    fn apply(
        &mut self,
        n: usize,
        span: u32,
        target: i32,
        command: Command,
    ) -> Result<(), TestCaseError> {
        let drive = &mut self.drive;
        let off = (target - drive.position).abs();
        if command == Command::SwitchOn && drive.power == Power::Off {
            drive.power = Power::On;
        } else if command == Command::Enable && drive.power == Power::On {
            prop_assert!(off <= 4 * NOISE, "at {n}: enabled {off} off its position");
            drive.power = Power::Enabled;
        } else if drive.power == Power::Enabled {
            prop_assert!(off <= WINDOW, "at {n}: target {off} from the axis");
            if let Some((before_span, before)) = drive.target {
                if before_span == span {
                    let step = (target - before).abs();
                    prop_assert!(step <= STEP, "at {n}: step of {step}");
                } else {
                    prop_assert!(off <= 4 * NOISE, "at {n}: first target {off} off");
                }
            }
            self.targets += 1;
        }
        drive.target = Some((span, target));
        Ok(())
    }
}

proptest! {
    #[test]
    fn no_drive_gets_a_stale_or_a_far_target(
        conditions in prop::collection::vec(conditions(), 20..400),
    ) {
        let mut model = Model::new();
        for (n, conditions) in conditions.into_iter().enumerate() {
            model.cycle(n, conditions)?;
        }
    }
}

#[test]
fn in_fair_conditions_the_drive_follows() {
    let mut model = Model::new();
    let fair = CycleConditions {
        lost_out: false,
        lost_back: false,
        blocked: 0,
        bus_off: false,
        fault: false,
        push: 0,
        backlog: false,
        advance: 10,
    };
    for n in 0..100 {
        model.cycle(n, fair).unwrap();
    }
    assert_eq!(model.firsts, 1);
    assert!(model.targets > 80 && model.drive.position > 800, "{}", model.drive.position);
    // A storm, and back again.
    model.cycle(100, CycleConditions { blocked: 10, bus_off: true, ..fair }).unwrap();
    for n in 101..200 {
        model.cycle(n, fair).unwrap();
    }
    assert_eq!(model.firsts, 2);
}
