//! What a gateway has before a test, and putting it back afterwards.

use std::collections::BTreeMap;

use ecan_protocol::config::{DataPathConfig, FilterWindow, McanChannelConfig};
use ecan_protocol::device::AlState;
use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::{CHANNELS, Direction, assignment_index};
use ecan_protocol::object::{Access, SdoWrite};

use crate::bus::Bus;
use crate::commands::filter::{ChannelFilters, FilterKind, RawFilter};
use crate::commands::reboot;
use crate::failure::Failure;

use super::active_config::ActiveConfig;

/// How often the state of a slave is looked at, in nanoseconds.
const LOOK_EVERY_NS: u64 = 50_000_000;
/// How long a slave may take to be there, or in PREOP again, in nanoseconds.
const STATE_NS: u64 = 10_000_000_000;
/// How long a restart may take, in nanoseconds.
const RESTART_NS: u64 = 30_000_000_000;
/// Objects that hold configuration.
const OBJECTS: [u16; 12] = [
    0x8000, 0x8001, 0x8002, 0x8003, 0x8004, 0x8010, 0x8011, 0x8020, 0x8021, 0x8022, 0x8023, 0x8024,
];

/// The filters of a channel: standard and extended ones.
type Filters = [Vec<RawFilter>; 2];

/// The configuration of a gateway.
#[derive(Debug)]
pub(super) struct Saved {
    slave: usize,
    serial: u64,
    /// Every value that can be written and is no command.
    values: BTreeMap<(u16, u8), u32>,
    filters: [Filters; CHANNELS],
    /// The entries of 0x1C12 and 0x1C13.
    assignments: [Vec<u32>; 2],
    active_config: ActiveConfig,
}

/// How the configuration was put back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Restored {
    /// By writing it.
    Written,
    /// The gateway was restarted first.
    Restarted,
}

impl Saved {
    pub(super) fn read(bus: &Bus, slave: usize) -> Result<Self, Failure> {
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
        Ok(Self { slave, serial, values, filters, assignments, active_config })
    }

    /// Waits until the master has let go of the gateway, and puts everything back that the test has
    /// changed on the channels `tested`. Says what could not be put back. A gateway that was lost
    /// has some time to come back.
    ///
    /// No command takes a profile out of force again, nor a channel off its bus (manual 13.2, 13.4):
    /// where that is needed the gateway restarts.
    pub(super) fn restore(&self, bus: &Bus, tested: [bool; CHANNELS]) -> Result<Restored, String> {
        let mut deadline = bus.clock().now_ns() + STATE_NS;
        let mut is_restarted = false;
        loop {
            let was_restarted = is_restarted;
            let outcome = self.try_restore(bus, tested, &mut is_restarted);
            if is_restarted && !was_restarted {
                deadline = bus.clock().now_ns() + STATE_NS;
            }
            match outcome {
                Ok(()) if is_restarted => return Ok(Restored::Restarted),
                Ok(()) => return Ok(Restored::Written),
                Err(why) if bus.clock().now_ns() >= deadline => return Err(why),
                Err(_) => bus.clock().sleep_until_ns(bus.clock().now_ns() + LOOK_EVERY_NS),
            }
        }
    }

    fn try_restore(
        &self,
        bus: &Bus,
        tested: [bool; CHANNELS],
        is_restarted: &mut bool,
    ) -> Result<(), String> {
        let words = |failure: Failure| failure.to_string();
        self.wait_own_place(bus)?;
        let now = ActiveConfig::read(bus, self.slave).map_err(words)?;
        if now.has_more_than(&self.active_config) {
            let restarted = reboot::restart(bus, self.slave, RESTART_NS);
            restarted.map_err(|failure| format!("it was to restart, but {failure}"))?;
            *is_restarted = true;
            self.wait_own_place(bus)?;
        }
        self.write(bus, tested).map_err(words)?;
        self.compare(bus)
    }

    /// Waits for PREOP. In a ring another gateway may stand in the place of one that is away.
    fn wait_own_place(&self, bus: &Bus) -> Result<(), String> {
        wait(bus, self.slave, |state| state == Some(AlState::PreOp))?;
        match bus.serial(self.slave) {
            Ok(serial) if serial == self.serial => Ok(()),
            Ok(serial) => Err(format!("gateway {serial} stands in its place")),
            Err(failure) => Err(failure.to_string()),
        }
    }

    fn write(&self, bus: &Bus, tested: [bool; CHANNELS]) -> Result<(), Failure> {
        let slave = self.slave;
        let now = ActiveConfig::read(bus, slave)?;
        for (direction, entries) in Direction::ALL.into_iter().zip(&self.assignments) {
            if read_assignment(bus, slave, direction)? != *entries {
                write_assignment(bus, slave, direction, entries)?;
            }
        }
        let mut is_global_changed = false;
        for (&(index, subindex), &value) in &self.values {
            if bus.read(slave, index, subindex)? != value {
                bus.write(slave, index, subindex, value)?;
                is_global_changed |= index == 0x8020;
            }
        }
        for (channel, (filters, is_tested)) in (0..).zip(self.filters.iter().zip(tested)) {
            if read_filters(bus, slave, channel)? != *filters {
                let of_channel = ChannelFilters { bus, slave, channel };
                for (kind, filters) in FilterKind::ALL.into_iter().zip(filters) {
                    of_channel.replace(kind, filters)?;
                }
            }
            let has_left = !now.is_on_bus(channel);
            if self.active_config.is_on_bus(channel) && (is_tested || has_left) {
                let command = McanChannelConfig::apply_write(channel);
                apply(bus, slave, command, 2)?;
            }
        }
        if is_global_changed {
            bus.write(slave, 0x8020, 2, 1)?;
        }
        let now = ActiveConfig::read(bus, slave)?;
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
        Ok(())
    }

    /// What is not as it was.
    fn compare(&self, bus: &Bus) -> Result<(), String> {
        let now = Self::read(bus, self.slave).map_err(|failure| failure.to_string())?;
        for ((index, subindex), value) in &self.values {
            let found = now.values.get(&(*index, *subindex));
            if let Some(found) = found.filter(|found| *found != value) {
                let object = ecan_protocol::object::describe(*index, *subindex);
                return Err(format!("{object} was {value} and now is {found}"));
            }
        }
        if let Some(channel) =
            (0..CHANNELS).find(|at| now.filters.get(*at) != self.filters.get(*at))
        {
            return Err(format!("the filters of channel {channel} are others"));
        }
        if now.assignments != self.assignments {
            return Err("0x1C12 or 0x1C13 assigns other PDOs".to_owned());
        }
        match now.active_config.difference(&self.active_config) {
            Some(words) => Err(words),
            None => Ok(()),
        }
    }
}

/// Configuration: what can be written, but no commands and no editing windows.
fn entries() -> impl Iterator<Item = (u16, u8)> {
    let is_value = |index: u16, subindex: u8| match index {
        0x8001..=0x8004 => !FilterWindow::BOTH.iter().any(|window| {
            [window.index, window.command].contains(&subindex)
                || window.fields().contains(&subindex)
        }),
        0x8010 | 0x8011 => !matches!(subindex, 1 | 8),
        0x8020..=0x8024 => subindex != 2,
        _ => true,
    };
    OBJECTS.into_iter().flat_map(move |index| {
        let entries = ecan_protocol::object::object(index).map_or(&[][..], |object| object.entries);
        entries
            .iter()
            .filter(|entry| entry.access == Access::Rw && entry.ty.is_integer())
            .map(|entry| entry.subindex)
            .filter(move |subindex| is_value(index, *subindex))
            .map(move |subindex| (index, subindex))
    })
}

fn read_filters(bus: &Bus, slave: usize, channel: u8) -> Result<Filters, Failure> {
    let of_channel = ChannelFilters { bus, slave, channel };
    Ok([of_channel.read(FilterKind::Standard)?, of_channel.read(FilterKind::Extended)?])
}

fn read_assignment(bus: &Bus, slave: usize, direction: Direction) -> Result<Vec<u32>, Failure> {
    let index = assignment_index(direction);
    let count = u8::try_from(bus.read(slave, index, 0)?).unwrap_or(u8::MAX);
    (1..=count).map(|subindex| bus.read(slave, index, subindex)).collect()
}

/// Count 0, the entries, the count.
fn write_assignment(
    bus: &Bus,
    slave: usize,
    direction: Direction,
    entries: &[u32],
) -> Result<(), Failure> {
    let index = assignment_index(direction);
    bus.write(slave, index, 0, 0)?;
    for (subindex, entry) in (1..).zip(entries) {
        bus.write(slave, index, subindex, *entry)?;
    }
    bus.write(slave, index, 0, u32::try_from(entries.len()).unwrap_or_default())
}

/// A command that puts values into force; its status tells whether it did.
fn apply(bus: &Bus, slave: usize, command: SdoWrite, status: u8) -> Result<(), Failure> {
    let SdoWrite { index, subindex, value, .. } = command;
    bus.write(slave, index, subindex, value)?;
    match bus.read(slave, index, status)? {
        0 => Ok(()),
        found => {
            let object = ecan_protocol::object::describe(index, subindex);
            Err(Failure::Refused(format!("{object} ends with status {found}")))
        }
    }
}

/// Reads from a slave that may be away for some time.
pub(super) fn read_patiently(
    bus: &Bus,
    slave: usize,
    index: u16,
    subindex: u8,
) -> Result<u32, Failure> {
    let deadline = bus.clock().now_ns() + STATE_NS;
    loop {
        match bus.read(slave, index, subindex) {
            Err(_) if bus.clock().now_ns() < deadline => {
                bus.clock().sleep_until_ns(bus.clock().now_ns() + LOOK_EVERY_NS);
            }
            read => return read,
        }
    }
}

/// Waits until the master knows a slave. While it looks at the bus again, since some slave came or
/// went, it knows none.
pub(super) fn wait_present(bus: &Bus, slave: usize) -> Result<(), String> {
    wait(bus, slave, |_| true)
}

fn wait(bus: &Bus, slave: usize, is_fit: fn(Option<AlState>) -> bool) -> Result<(), String> {
    let deadline = bus.clock().now_ns() + STATE_NS;
    loop {
        let state = bus.diagnostics().al_state(slave);
        if matches!(state, Ok(state) if is_fit(state)) {
            return Ok(());
        }
        if bus.clock().now_ns() >= deadline {
            return Err(match state {
                Err(error) => error.to_string(),
                Ok(Some(state)) => format!("it stays in {state}"),
                Ok(None) => "it stays in no known state".to_owned(),
            });
        }
        bus.clock().sleep_until_ns(bus.clock().now_ns() + LOOK_EVERY_NS);
    }
}
