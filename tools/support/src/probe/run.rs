//! The gateway under experiment: its bus, its session in OP, and what was measured.

use std::sync::Arc;

use ecan_host::{Clock, CycleTiming, Diagnostics, Ecrt, Error};
use ecan_lite::config::DeviceProfile;
use ecan_protocol::device::AlState;
use ecan_protocol::image::ChannelState;
use ecan_protocol::mapping::CHANNELS;

use super::outcome::{Interruption, Result, Stage, unavailable};
use super::sdo::Sdo;
use super::session::{SYNC0, Session, Setup};

/// Time for a gateway to return after a lost link or a restart, in ns.
const RETURN_NS: u64 = 30_000_000_000;
const POLL_NS: u64 = 20_000_000;

/// Limits of a probe.
#[derive(Clone)]
pub struct ProbeOptions {
    /// Two channels that are wired to each other, for the last stage.
    pub wired: Option<(u8, u8)>,
    /// The last stage to run; later ones stay undecided for the given reason.
    pub last_stage: Stage,
    /// Reason for the stages that are not run.
    pub reason: String,
    /// Timing of the cycle.
    pub timing: CycleTiming,
    /// Function that ends the probe when it returns true.
    pub stop: Arc<dyn Fn() -> bool + Send + Sync>,
}

impl Default for ProbeOptions {
    fn default() -> Self {
        let reason = "the stage was not run".to_owned();
        Self {
            wired: None,
            last_stage: Stage::Wired,
            reason,
            timing: CycleTiming::default(),
            stop: Arc::new(|| false),
        }
    }
}

impl std::fmt::Debug for ProbeOptions {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ProbeOptions").field("wired", &self.wired).finish_non_exhaustive()
    }
}

/// Experiments on the gateway at one position of a bus.
#[derive(Debug)]
pub struct Probe {
    pub(crate) ecrt: Ecrt,
    pub(crate) master: u32,
    pub(crate) slave: usize,
    pub(crate) diagnostics: Diagnostics,
    pub(crate) options: ProbeOptions,
    pub(crate) profile: DeviceProfile,
    pub(crate) session: Option<Session>,
    /// Reason for which the plainest configuration does not reach OP.
    op_failure: Option<Interruption>,
    pub(crate) has_changed: bool,
    /// The gateway did not return after a lost link.
    pub(crate) is_lost: bool,
    pub(crate) restart: Option<Restart>,
    pub(crate) service: Option<ServiceTime>,
    pub(crate) samples: Option<Vec<Sample>>,
    pub(crate) missed: Option<MissedImages>,
    /// The word with which Sync0 ran.
    pub(crate) assign_activate: u16,
    /// delta16 timestamps do not count microseconds.
    pub(crate) has_other_delta16: bool,
}

impl Probe {
    /// Opens the bus of a master without reserving it.
    ///
    /// # Errors
    /// The master does not respond.
    pub fn open(
        ecrt: &Ecrt,
        master: u32,
        slave: usize,
        options: ProbeOptions,
    ) -> Result<Self, Error> {
        Ok(Self {
            ecrt: ecrt.clone(),
            master,
            slave,
            diagnostics: Diagnostics::of_bus(ecrt, master)?,
            options,
            profile: DeviceProfile::default(),
            session: None,
            op_failure: None,
            has_changed: false,
            is_lost: false,
            restart: None,
            service: None,
            samples: None,
            missed: None,
            assign_activate: SYNC0,
            has_other_delta16: false,
        })
    }

    /// Measured values.
    pub fn device_profile(&self) -> &DeviceProfile {
        &self.profile
    }

    /// Returns whether a stage ran that changes the configuration of the gateway.
    pub fn has_changed(&self) -> bool {
        self.has_changed
    }

    /// Returns whether the probe was stopped by [`ProbeOptions::stop`].
    pub fn is_stopped(&self) -> bool {
        (self.options.stop)()
    }

    pub(crate) fn sdo(&self) -> Sdo<'_> {
        Sdo { diagnostics: &self.diagnostics, slave: self.slave }
    }

    pub(crate) fn clock(&self) -> &dyn Clock {
        self.ecrt.clock().as_ref()
    }

    pub(crate) fn sleep_ns(&self, duration_ns: u64) {
        self.clock().sleep_until_ns(self.clock().now_ns().saturating_add(duration_ns));
    }

    /// Waits until the gateway responds in PREOP, as it does after a program has released the master.
    pub(crate) fn wait_preop(&mut self) -> Result {
        // A gateway that stays away is not waited for again.
        let wait_ns = if self.is_lost { POLL_NS } else { RETURN_NS };
        let end_ns = self.clock().now_ns().saturating_add(wait_ns);
        loop {
            if self.is_stopped() {
                return Err(Interruption::Stopped);
            }
            // The state that the master shows may be old.
            if let Ok(Some(AlState::PreOp)) = self.diagnostics.al_state(self.slave)
                && self.sdo().try_read(0x1018, 1).is_ok()
            {
                self.is_lost = false;
                return Ok(());
            }
            if self.clock().now_ns() >= end_ns {
                return Err(Interruption::LinkLost);
            }
            self.sleep_ns(POLL_NS);
            // The number of slaves may have changed.
            if let Ok(diagnostics) = Diagnostics::of_bus(&self.ecrt, self.master)
                && diagnostics.slave_count() > self.slave
            {
                self.diagnostics = diagnostics;
            }
        }
    }

    /// A session in OP with this setup: the present one, or a new one.
    pub(crate) fn session(&mut self, setup: &Setup) -> Result<&mut Session> {
        if let Some(reason) = &self.op_failure {
            return Err(reason.clone());
        }
        let setup = &Setup { assign_activate: self.assign_activate, ..setup.clone() };
        if self.session.as_ref().is_none_or(|session| session.setup != *setup) {
            self.session = None;
            self.wait_preop()?;
            let position = u16::try_from(self.slave).unwrap_or(u16::MAX);
            let opened =
                Session::open(&self.ecrt, self.master, position, setup, &self.options.stop);
            if let Err(reason @ Interruption::NotInOp { .. }) = &opened
                && *setup == Setup::plain()
            {
                self.op_failure = Some(reason.clone());
            }
            let mut session = opened?;
            session.adapter.set_cycle_timing(self.options.timing);
            self.session = Some(session);
        }
        self.session.as_mut().map_or_else(|| unavailable("no session"), Ok)
    }

    /// Ends the session, whose frames would disturb the next experiment.
    pub(crate) fn end_session(&mut self) -> Result {
        match self.session.take().map_or(0, |mut session| session.take_missed()) {
            0 => Ok(()),
            _ => Err(Interruption::LinkLost),
        }
    }
}

/// A restart and the state of the gateway after it.
#[derive(Clone, Debug)]
pub(crate) struct Restart {
    pub(crate) is_answered: bool,
    /// From the command to the first transfer without response, and from there to the first response.
    pub(crate) vanished_ns: u64,
    pub(crate) boot_ns: u64,
    pub(crate) mark: u32,
    pub(crate) chunks: [u32; 2],
    pub(crate) channels: [Option<ChannelState>; CHANNELS],
}

/// A scheduled frame: the time of its image before the pulse, whether it came back, and its result codes.
#[derive(Clone, Debug)]
pub(crate) struct Sample {
    pub(crate) before_us: u64,
    /// The firmware read the image only after the pulse (`sync0_window`).
    pub(crate) is_missed: bool,
    pub(crate) is_sent: bool,
    pub(crate) codes: Vec<u8>,
}

/// Time from an SM2 write until SM2 can be written again.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ServiceTime {
    /// Smallest distance of two images that the host reached, in us.
    pub(crate) least_us: u32,
    /// Largest distance up to which no second image was taken.
    pub(crate) never_us: u32,
    /// Largest distance at which a second image was missed, and smallest from which all were taken: the longest
    /// wait is between them.
    pub(crate) last_missed_us: u32,
    pub(crate) always_us: u32,
    pub(crate) mean_us: u32,
    /// Time in which the host sends an image, in us: the distances are not more exact.
    pub(crate) resolution_us: u32,
}

/// Distances before a Sync0 pulse at which images are missed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MissedImages {
    /// First and last distance, in us; `None` without any.
    pub(crate) range_us: Option<(i64, i64)>,
    /// Usual deviation of a send from its time, in us.
    pub(crate) resolution_us: i64,
}
