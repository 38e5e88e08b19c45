//! Fetch of a slave's object dictionary, by SDO information.
//!
//! The master does nothing else during it: it polls no states, configures no slave and serves no
//! internal request. Transfers of blocking calls to the slave collide with it in the mailbox.

use ecan_protocol::device::AlState;
use ecan_protocol::object::objects;

use crate::ecrt::slaves::{Configs, RequestProgress, SlaveView, is_any_configured};
use crate::ecrt::timing::{DICTIONARY_STEP_NS, DICTIONARY_TIMEOUT_NS, DICTIONARY_WAIT_NS};
use crate::random::Random;
use crate::world::World;

/// Steps of one request: request, mailbox check, fetch.
const STEPS_PER_REQUEST: u64 = 3;
/// One of this number of colliding transfers takes the response of the fetch.
const COLLISIONS_PER_FAILURE: u64 = 20;

#[derive(Clone, Copy, Debug)]
struct Fetch {
    slave: usize,
    /// Steps that were left at this time, and at this step of the master.
    left: u64,
    at_ns: u64,
    at_step: u64,
    /// A response was lost: the fetch fails at this time.
    fails_at: Option<u64>,
}

/// Number of objects of a gateway.
pub(crate) fn object_count() -> u16 {
    objects().iter().map(|object| object.count).sum()
}

/// Steps of a fetch: the list, the objects, and every subindex, gaps included.
fn dictionary_steps() -> u64 {
    let described = |subindices: u8| 2 + u64::from(subindices);
    let requests = objects()
        .iter()
        .map(|object| u64::from(object.count) * described(object.highest_subindex()));
    STEPS_PER_REQUEST * requests.sum::<u64>()
}

/// Longest time of a fetch before activation, for `slaves`.
pub(crate) fn dictionary_ns(slaves: u64) -> u64 {
    slaves * dictionary_steps() * DICTIONARY_STEP_NS
}

/// The fetch of a dictionary, of one slave at a time.
#[derive(Debug, Default)]
pub(super) struct DictionaryReader {
    fetch: Option<Fetch>,
    random: Random,
}

impl DictionaryReader {
    pub(super) fn new(seed: u64) -> Self {
        Self { fetch: None, random: Random::new(seed) }
    }

    pub(super) fn is_running(&self) -> bool {
        self.fetch.is_some()
    }

    /// Starts the next fetch that is due, when the master has nothing else to do.
    pub(super) fn choose(
        &mut self,
        now: u64,
        step: u64,
        slaves: &mut [SlaveView],
        configs: &Configs,
    ) {
        let is_open =
            |progress| matches!(progress, RequestProgress::Queued | RequestProgress::Busy);
        let mut requests = configs.iter().flat_map(|config| &config.requests);
        if self.is_running()
            || is_any_configured(slaves)
            || requests.any(|request| is_open(request.progress))
        {
            return;
        }
        let due = slaves.iter_mut().enumerate().find(|(_, slave)| {
            // A state of 0 means that the slave did not respond.
            let is_awake = slave.current & 0x0F != 0 && slave.current != AlState::Init.raw();
            let has_waited =
                slave.preop_at.is_none_or(|since| now.saturating_sub(since) >= DICTIONARY_WAIT_NS);
            let is_offered = slave.description.has_information;
            is_awake && has_waited && is_offered && !slave.has_dictionary
        });
        let Some((index, slave)) = due else { return };
        slave.has_dictionary = true;
        self.fetch = Some(Fetch {
            slave: index,
            left: dictionary_steps(),
            at_ns: now,
            at_step: step,
            fails_at: None,
        });
    }

    /// Counts the steps since the last call; the pace changes with the phase. Returns whether a fetch ends.
    pub(super) fn advance(
        &mut self,
        step: u64,
        is_active: bool,
        slaves: &[SlaveView],
        world: &World,
    ) -> bool {
        let now = world.now_ns();
        let Some(fetch) = &mut self.fetch else { return false };
        let done = match is_active {
            true => step.wrapping_sub(fetch.at_step),
            false => now.saturating_sub(fetch.at_ns) / DICTIONARY_STEP_NS,
        };
        fetch.left = fetch.left.saturating_sub(done);
        fetch.at_step = step;
        fetch.at_ns = if is_active { now } else { fetch.at_ns + done * DICTIONARY_STEP_NS };
        let has_ended = match fetch.fails_at {
            Some(at) => now >= at,
            None => fetch.left == 0,
        };
        let slave = slaves.get(fetch.slave);
        let ends = has_ended || !slave.is_some_and(|slave| slave.is_present(world));
        if ends {
            self.fetch = None;
        }
        ends
    }

    /// When the fetch ends if the phase does not change.
    pub(super) fn due(&self) -> Option<u64> {
        let fetch = self.fetch.as_ref()?;
        Some(fetch.fails_at.unwrap_or(fetch.at_ns + fetch.left * DICTIONARY_STEP_NS))
    }

    /// Returns whether the response of a transfer of this slave is lost to the fetch.
    pub(super) fn collides(&mut self, slave: usize, now: u64) -> bool {
        let Some(fetch) = self.fetch.as_mut().filter(|fetch| fetch.slave == slave) else {
            return false;
        };
        if fetch.fails_at.is_none() && self.random.below(COLLISIONS_PER_FAILURE) == 0 {
            fetch.fails_at = Some(now + DICTIONARY_TIMEOUT_NS);
        }
        true
    }
}
