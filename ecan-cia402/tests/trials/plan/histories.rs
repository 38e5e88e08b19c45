//! All short histories of one axis: every sequence of a few events, one per step.

use ecan_canopen::{NodeAddress, NodeId};
use ecan_cia402::{AxisConfig, Cia402Config};
use ecan_sim::{DriveConfig, DriveFault, Fault, GatewayFault, LossDirection, Topology};

use super::{Action, AppPlan, AxisPlan, Command, End, Event, MS, Plan, Style};

/// What can happen in a step; the first one is an undisturbed cycle.
fn events() -> [Option<Action>; 16] {
    let gateway = |fault| Action::Fault(Fault::Gateway { gateway: 0, fault });
    [
        None,
        Some(Action::Skip { cycles: 1, rx: true, send: true }),
        Some(Action::Twice),
        Some(Action::Command(0, Command::Target(i32::MAX))),
        Some(Action::Silent(0, 2)),
        Some(Action::Fault(Fault::ErrorFrames { gateway: 0, channel: 0, frames: 2 })),
        Some(Action::Fault(Fault::LostFrame { direction: LossDirection::Return, cycles: 1 })),
        Some(Action::Fault(Fault::LinkLoss { gateway: 0, for_ms: 10 })),
        Some(Action::DriveFault(0, DriveFault::PowerCycle { off_ms: 1 })),
        Some(Action::DriveFault(0, DriveFault::Error { code: 0x2310 })),
        Some(Action::DriveFault(0, DriveFault::Emcy { code: 0x4210, register: 9 })),
        Some(Action::Command(0, Command::QuickStop)),
        Some(Action::Command(0, Command::Enable)),
        Some(Action::Command(0, Command::Disable)),
        Some(Action::Replace { idle_cycles: 0 }),
        Some(gateway(GatewayFault::ClockJump { ns: 1_000_000 })),
    ]
}

/// Number of histories with this many steps.
pub fn count(steps: u32) -> u64 {
    (events().len() as u64).pow(steps)
}

impl Plan {
    /// The history with a number, of all with this many steps, each of some cycles: an axis in CSP moves at its
    /// limit when it begins.
    pub fn history(number: u64, steps: u32, cycles: u64) -> Self {
        let address =
            NodeAddress { slave: 0, channel: 0, node: NodeId::new(1).expect("below 127") };
        let mut config = AxisConfig::new(address);
        config.step_limit = 200;
        config.ramp = 20;
        config.following_window = 3_000;
        let mut drive = DriveConfig::new(address.node);
        drive.serial = 1;
        let cycle_ns = 2 * MS;
        let kinds = events();
        let step = |step: u32| {
            let kind = number / count(step) % count(1);
            let action = kinds.get(kind as usize).cloned().flatten()?;
            Some(Event { at_ns: u64::from(step) * cycles * cycle_ns, action })
        };
        Self {
            seed: number,
            gateways: 1,
            topology: Topology::Line,
            has_aliases: false,
            variants: Vec::new(),
            clock: None,
            cycle_ns,
            table: Cia402Config::default(),
            axes: vec![AxisPlan { config, drive, style: Style::Climb }],
            app: AppPlan {
                starts_undisturbed: true,
                operator_ns: None,
                recovers: true,
                steps: false,
                skips_rx: 0,
                skips_send: 0,
                commands_first: false,
                end: End::QuickStop,
            },
            events: (0..steps).filter_map(step).collect(),
            duration_ns: (u64::from(steps) * cycles + 25) * cycle_ns,
        }
    }
}
