use serde::Deserialize;

/// Pace and side activities of the simulated master.
///
/// [`IDEAL`](Self::IDEAL) answers as fast as a master can; [`IGH`](Self::IGH) has what was measured
/// on IgH 1.6.2 (Debian 6.1, `ec_generic`, 250 ticks per second).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(from = "RawBehaviour")]
pub struct MasterBehaviour {
    /// Microseconds of one step of an SDO transfer before activation; a transfer takes four.
    pub idle_step_us: u32,
    /// After activation the master's thread needs time between a receive and the next send to
    /// advance its state machines with that send. If both follow each other, only every second send
    /// advances them. False: each send does.
    pub needs_gap: bool,
    /// Internal SDO requests are served one after the other over all slaves, after a round of state
    /// polling, and not while a slave is configured. False: at once, slaves in parallel.
    pub serves_in_turn: bool,
    /// A scan in the operation phase takes its steps: SII, and the mapping of each assigned PDO.
    /// False: 200 ms per slave.
    pub scans_in_steps: bool,
    /// The object dictionary of each slave is fetched once after a scan, from 3 s after PREOP on.
    /// Transfers of other programs and blocking calls to that slave get no response during it.
    pub fetches_dictionary: bool,
    /// The bus is scanned again when the master is released.
    pub scans_after_release: bool,
    /// A register request whose configuration has lost its slave stays busy, also when it is started
    /// again. False: as in IgH, the start queues it again.
    pub keeps_lost_requests: bool,
}

impl MasterBehaviour {
    /// As fast as a master can be, without side activities.
    pub const IDEAL: Self = Self {
        idle_step_us: 500,
        needs_gap: false,
        serves_in_turn: false,
        scans_in_steps: false,
        fetches_dictionary: false,
        scans_after_release: false,
        keeps_lost_requests: false,
    };

    /// As IgH 1.6.2. It scans after a release only if a datagram gets lost at the change of its
    /// threads, so `scans_after_release` is false.
    pub const IGH: Self = Self {
        idle_step_us: 8_000,
        needs_gap: true,
        serves_in_turn: true,
        scans_in_steps: true,
        fetches_dictionary: true,
        scans_after_release: false,
        keeps_lost_requests: false,
    };
}

impl Default for MasterBehaviour {
    fn default() -> Self {
        Self::IDEAL
    }
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Model {
    #[default]
    Ideal,
    Igh,
}

/// The table `[master]` of a scenario file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawBehaviour {
    #[serde(default)]
    like: Model,
    idle_step_us: Option<u32>,
    needs_gap: Option<bool>,
    serves_in_turn: Option<bool>,
    scans_in_steps: Option<bool>,
    fetches_dictionary: Option<bool>,
    scans_after_release: Option<bool>,
    keeps_lost_requests: Option<bool>,
}

impl From<RawBehaviour> for MasterBehaviour {
    fn from(raw: RawBehaviour) -> Self {
        let base = match raw.like {
            Model::Ideal => Self::IDEAL,
            Model::Igh => Self::IGH,
        };
        let choose = |given: Option<bool>, default| given.unwrap_or(default);
        Self {
            idle_step_us: raw.idle_step_us.unwrap_or(base.idle_step_us),
            needs_gap: choose(raw.needs_gap, base.needs_gap),
            serves_in_turn: choose(raw.serves_in_turn, base.serves_in_turn),
            scans_in_steps: choose(raw.scans_in_steps, base.scans_in_steps),
            fetches_dictionary: choose(raw.fetches_dictionary, base.fetches_dictionary),
            scans_after_release: choose(raw.scans_after_release, base.scans_after_release),
            keeps_lost_requests: choose(raw.keeps_lost_requests, base.keeps_lost_requests),
        }
    }
}
