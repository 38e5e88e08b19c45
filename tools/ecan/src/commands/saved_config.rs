//! Saves and restores the configuration of a gateway, for commands that change it for a test.

use std::collections::{BTreeMap, BTreeSet};

use ecan_protocol::config::{DataPathConfig, McanChannelConfig};
use ecan_protocol::device::AlState;
use ecan_protocol::image::{ChannelState, ChannelStatus, PdoProfile};
use ecan_protocol::mapping::{CHANNELS, Direction, assignment_index};
use ecan_protocol::object::{SdoWrite, objects};

use super::filter::{ChannelFilters, FilterKind, RawFilter};
use super::reboot;
use crate::context::{Bus, Failure, Result};

const POLL_NS: u64 = 50_000_000;
/// Interval of attempts with SDO transfers. The library prints a line for each that fails.
const RETRY_NS: u64 = 500_000_000;
/// Time limit for a slave to respond or to reach PREOP, in nanoseconds.
const STATE_NS: u64 = 10_000_000_000;
const RESTART_NS: u64 = 30_000_000_000;

/// Filters of a channel: standard and extended.
type Filters = [Vec<RawFilter>; 2];

/// Changes of a test.
pub(super) struct Changes<'a> {
    /// Channels that were used.
    pub(super) tested: [bool; CHANNELS],
    /// Objects that were written.
    pub(super) written: &'a BTreeSet<(u16, u8)>,
    /// The gateway may have restarted, so that other values may differ too.
    pub(super) is_unknown: bool,
}

#[derive(Debug)]
pub(super) struct Saved {
    slave: usize,
    serial: u64,
    /// Every writable value that is not a command.
    values: BTreeMap<(u16, u8), u32>,
    filters: [Filters; CHANNELS],
    /// Entries of 0x1C12 and 0x1C13.
    assignments: [Vec<u32>; 2],
    active_config: ActiveConfig,
    /// Restart the gateway instead of restoring anything.
    is_restarted_only: bool,
}

impl Saved {
    /// Restores by a restart, which loads the settings in the Flash.
    pub(super) fn by_restart(bus: &Bus, slave: usize) -> Result<Self> {
        Ok(Self {
            slave,
            serial: bus.serial(slave)?,
            values: BTreeMap::new(),
            filters: Default::default(),
            assignments: Default::default(),
            active_config: ActiveConfig::default(),
            is_restarted_only: true,
        })
    }

    pub(super) fn read(bus: &Bus, slave: usize) -> Result<Self> {
        let serial = bus.serial(slave)?;
        let mut values = BTreeMap::new();
        for (index, subindex) in entries() {
            values.insert((index, subindex), bus.read(slave, index, subindex)?);
        }
        let mut filters: [Filters; CHANNELS] = Default::default();
        for (channel, filters) in (0..).zip(&mut filters) {
            *filters = read_filters(bus, slave, channel)?;
        }
        let mut assignments: [Vec<u32>; 2] = Default::default();
        for (direction, entries) in Direction::ALL.into_iter().zip(&mut assignments) {
            *entries = read_assignment(bus, slave, direction)?;
        }
        let active_config = ActiveConfig::read(bus, slave)?;
        let is_restarted_only = false;
        Ok(Self { slave, serial, values, filters, assignments, active_config, is_restarted_only })
    }

    /// Waits until the master has released the gateway, and restores everything that the test has
    /// changed; returns whether this needed a restart. A lost gateway gets some time to respond.
    ///
    /// No command deactivates a profile or a channel (manual 13.2, 13.4): the gateway is restarted
    /// for that.
    pub(super) fn restore(&self, bus: &Bus, changes: &Changes<'_>) -> Result<bool> {
        let mut deadline = bus.clock().now_ns() + STATE_NS;
        let mut is_restarted = false;
        loop {
            let was_restarted = is_restarted;
            let outcome = self.try_restore(bus, changes, &mut is_restarted);
            if is_restarted && !was_restarted {
                deadline = bus.clock().now_ns() + STATE_NS;
            }
            match outcome {
                Ok(()) => return Ok(is_restarted),
                Err(failure) if bus.clock().now_ns() >= deadline => return Err(failure),
                Err(_) => bus.sleep_ns(RETRY_NS),
            }
        }
    }

    fn try_restore(&self, bus: &Bus, changes: &Changes<'_>, is_restarted: &mut bool) -> Result {
        self.wait_own_position(bus)?;
        let is_needed = match self.is_restarted_only {
            true => !*is_restarted,
            false => ActiveConfig::read(bus, self.slave)?.has_more_than(&self.active_config),
        };
        if is_needed {
            let restarted = reboot::restart(bus, self.slave, RESTART_NS);
            restarted.map_err(|error| Failure::Rejected(format!("restart failed: {error}")))?;
            *is_restarted = true;
            self.wait_own_position(bus)?;
        }
        if self.is_restarted_only {
            return Ok(());
        }
        self.write(bus, changes, changes.is_unknown || *is_restarted)
    }

    /// Waits for PREOP. Another gateway may be at the position of an unreachable one.
    fn wait_own_position(&self, bus: &Bus) -> Result {
        wait(bus, self.slave, |state| state == Some(AlState::PreOp))?;
        match bus.serial(self.slave)? {
            serial if serial == self.serial => Ok(()),
            serial => Err(Failure::Rejected(format!("gateway {serial} is at its position"))),
        }
    }

    /// Writes what differs and reads it back. `all`: not only what the test has changed.
    fn write(&self, bus: &Bus, changes: &Changes<'_>, all: bool) -> Result {
        let slave = self.slave;
        let is_concerned = |object: (u16, u8)| all || changes.written.contains(&object);
        for (direction, entries) in Direction::ALL.into_iter().zip(&self.assignments) {
            if read_assignment(bus, slave, direction)? != *entries {
                write_assignment(bus, slave, direction, entries)?;
                if read_assignment(bus, slave, direction)? != *entries {
                    let object = assignment_index(direction);
                    let text = format!("the PDO assignment (0x{object:04X}) differs");
                    return Err(Failure::Rejected(text));
                }
            }
        }
        let mut is_global_changed = false;
        for (&(index, subindex), &value) in
            self.values.iter().filter(|entry| is_concerned(*entry.0))
        {
            if bus.read(slave, index, subindex)? != value {
                bus.write(slave, index, subindex, value)?;
                let found = bus.read(slave, index, subindex)?;
                if found != value {
                    let object = ecan_protocol::object::describe(index, subindex);
                    return Err(Failure::Rejected(format!("{object} was {value} and is {found}")));
                }
                is_global_changed |= index == 0x8020;
            }
        }
        let before = ActiveConfig::read(bus, slave)?;
        for (channel, (filters, is_tested)) in (0..).zip(self.filters.iter().zip(changes.tested)) {
            if (all || is_tested) && read_filters(bus, slave, channel)? != *filters {
                let of_channel = ChannelFilters { bus, slave, channel };
                for (kind, filters) in FilterKind::ALL.into_iter().zip(filters) {
                    of_channel.replace(kind, filters)?;
                }
                if read_filters(bus, slave, channel)? != *filters {
                    let text = format!("the filters of channel {channel} differ");
                    return Err(Failure::Rejected(text));
                }
            }
            let has_left = !before.is_on_bus(channel);
            if self.active_config.is_on_bus(channel) && (is_tested || has_left) {
                let command = McanChannelConfig::apply_write(channel);
                apply(bus, slave, command, 2)?;
            }
        }
        if is_global_changed {
            bus.write(slave, 0x8020, 2, 1)?;
        }
        let mut now = ActiveConfig::read(bus, slave)?;
        for channel in (0..).take(CHANNELS) {
            if !now.has_data_path_of(&self.active_config, channel) {
                let command = DataPathConfig::apply_write(channel);
                apply(bus, slave, command, 3)?;
            }
        }
        for direction in Direction::ALL {
            if !now.has_profile_of(&self.active_config, direction) {
                apply(bus, slave, PdoProfile::apply_write(direction), 2)?;
            }
        }
        if now != self.active_config {
            now = ActiveConfig::read(bus, slave)?;
        }
        let difference = now.difference(&self.active_config);
        difference.map_or(Ok(()), |text| Err(Failure::Rejected(text)))
    }
}

/// Entries of the configuration.
fn entries() -> impl Iterator<Item = (u16, u8)> {
    objects().iter().flat_map(|object| {
        object
            .indices()
            .flat_map(|index| object.saved_entries().map(move |entry| (index, entry.subindex)))
    })
}

fn read_filters(bus: &Bus, slave: usize, channel: u8) -> Result<Filters> {
    let of_channel = ChannelFilters { bus, slave, channel };
    Ok([of_channel.read(FilterKind::Standard)?, of_channel.read(FilterKind::Extended)?])
}

fn read_assignment(bus: &Bus, slave: usize, direction: Direction) -> Result<Vec<u32>> {
    let index = assignment_index(direction);
    let count = u8::try_from(bus.read(slave, index, 0)?).unwrap_or(u8::MAX);
    (1..=count).map(|subindex| bus.read(slave, index, subindex)).collect()
}

/// Writes count 0, the entries, then the count.
fn write_assignment(bus: &Bus, slave: usize, direction: Direction, entries: &[u32]) -> Result {
    let index = assignment_index(direction);
    bus.write(slave, index, 0, 0)?;
    for (subindex, entry) in (1..).zip(entries) {
        bus.write(slave, index, subindex, *entry)?;
    }
    bus.write(slave, index, 0, u32::try_from(entries.len()).unwrap_or_default())
}

fn apply(bus: &Bus, slave: usize, command: SdoWrite, status: u8) -> Result {
    let SdoWrite { index, subindex, value, .. } = command;
    bus.write(slave, index, subindex, value)?;
    match bus.read(slave, index, status)? {
        0 => Ok(()),
        found => {
            let object = ecan_protocol::object::describe(index, subindex);
            Err(Failure::Rejected(format!("{object}: status {found}")))
        }
    }
}

/// Waits until the master lists a slave. During a rescan of the bus it lists none.
pub(super) fn wait_present(bus: &Bus, slave: usize) -> Result {
    wait(bus, slave, |_| true)
}

fn wait(bus: &Bus, slave: usize, is_fit: fn(Option<AlState>) -> bool) -> Result {
    bus.retry(POLL_NS, STATE_NS, || match bus.diagnostics().al_state(slave)? {
        state if is_fit(state) => Ok(()),
        Some(state) => Err(Failure::Rejected(format!("the slave stays in {state}"))),
        None => Err(Failure::Rejected("the state of the slave is unknown".to_owned())),
    })
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct ActiveConfig {
    /// Per direction: image size in bytes, 0 without a profile, and the profile word (0x8010,
    /// 0x8011:09, :12).
    profiles: [(u32, u32); 2],
    /// Which channels are active on their bus (0x9000:09).
    on_bus: [bool; CHANNELS],
    /// Active control words (0x8021:20).
    data_paths: [u32; CHANNELS],
}

impl ActiveConfig {
    fn read(bus: &Bus, slave: usize) -> Result<Self> {
        let mut profiles = [(0, 0); 2];
        for (direction, profile) in Direction::ALL.into_iter().zip(&mut profiles) {
            let read = |subindex| bus.read(slave, direction.profile_object(), subindex);
            *profile = (read(9)?, read(12)?);
        }
        let (mut on_bus, mut data_paths) = ([false; CHANNELS], [0; CHANNELS]);
        for (index, is_on_bus) in (0x9000..).zip(&mut on_bus) {
            let status = ChannelStatus::from_raw(bus.read(slave, index, 9)? as u16);
            let is_off = matches!(status.state(), ChannelState::Disabled | ChannelState::Init);
            *is_on_bus = !is_off || status.bus_off();
        }
        for (index, word) in (0x8021..).zip(&mut data_paths) {
            *word = bus.read(slave, index, 20)?;
        }
        Ok(Self { profiles, on_bus, data_paths })
    }

    /// Returns whether a profile or channel is active that was not active `before`.
    fn has_more_than(&self, before: &Self) -> bool {
        let profiles = before.profiles.iter().zip(&self.profiles);
        let channels = before.on_bus.iter().zip(&self.on_bus);
        profiles.into_iter().any(|(before, now)| before.0 == 0 && now.0 != 0)
            || channels.into_iter().any(|(before, now)| !before && *now)
    }

    fn is_on_bus(&self, channel: u8) -> bool {
        self.on_bus.get(usize::from(channel)).is_some_and(|is_on_bus| *is_on_bus)
    }

    fn has_data_path_of(&self, other: &Self, channel: u8) -> bool {
        let of = |config: &Self| config.data_paths.get(usize::from(channel)).copied();
        of(self) == of(other)
    }

    fn has_profile_of(&self, other: &Self, direction: Direction) -> bool {
        let at = Direction::ALL.iter().position(|known| *known == direction);
        let of = |config: &Self| at.and_then(|at| config.profiles.get(at).copied());
        of(self) == of(other)
    }

    fn difference(&self, before: &Self) -> Option<String> {
        for direction in Direction::ALL {
            if !self.has_profile_of(before, direction) {
                let object = direction.profile_object();
                return Some(format!("0x{object:04X}: another profile is active"));
            }
        }
        for channel in (0..).take(CHANNELS) {
            let message = match (before.is_on_bus(channel), self.is_on_bus(channel)) {
                (false, true) => "is active and was not before",
                (true, false) => "is not active any more",
                _ if !self.has_data_path_of(before, channel) => {
                    "has another data path configuration"
                }
                _ => continue,
            };
            return Some(format!("channel {channel} {message}"));
        }
        None
    }
}
