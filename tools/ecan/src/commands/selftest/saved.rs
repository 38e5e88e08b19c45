//! What a gateway has before a test, and putting it back afterwards.

use std::collections::BTreeMap;

use ecan_config_file::apply;
use ecan_host::{AdapterConfig, StartupStep};
use ecan_mcan_port::PortConfig;
use ecan_protocol::{AlState, DataPathConfig, Direction, McanChannelConfig, PdoProfile, SdoWrite};

use crate::bus::Bus;
use crate::failure::Failure;

/// How often the state of a slave is looked at, in nanoseconds.
const LOOK_EVERY_NS: u64 = 50_000_000;
/// How long a slave may take to be there, or in PREOP again, in nanoseconds.
const STATE_NS: u64 = 10_000_000_000;
/// Commands, and the editing window of the filters, which hold no configuration.
const CHANNEL_COMMANDS: [u8; 2] = [1, 3];
const FILTER_WINDOW: [u8; 14] = [43, 44, 45, 46, 47, 48, 50, 51, 52, 53, 54, 56, 57, 58];

/// Values of configuration objects of a gateway.
#[derive(Debug)]
pub(super) struct Saved {
    slave: usize,
    values: BTreeMap<(u16, u8), SdoWrite>,
    /// The commands that put them into force.
    commands: BTreeMap<u16, SdoWrite>,
}

impl Saved {
    /// Reads every object that bringing one of these configurations into service writes.
    pub(super) fn read(
        bus: &Bus,
        slave: usize,
        configurations: &[(AdapterConfig, PortConfig)],
    ) -> Result<Self, Failure> {
        let mut saved = Self { slave, values: BTreeMap::new(), commands: BTreeMap::new() };
        for (adapter, port) in configurations {
            let mut adapter = adapter.clone();
            port.apply(&mut adapter);
            for step in adapter.slaves.iter().flat_map(|slave| &slave.base_startup) {
                let StartupStep::Download(write) = step else { continue };
                saved.add(bus, *write)?;
            }
        }
        Ok(saved)
    }

    fn add(&mut self, bus: &Bus, write: SdoWrite) -> Result<(), Failure> {
        let SdoWrite { index, subindex, ty, .. } = write;
        if is_command(index, subindex) {
            // A profile that was never in force cannot be put into force.
            let is_in_force =
                !matches!(index, 0x8010 | 0x8011) || bus.read(self.slave, index, 9)? != 0;
            if is_in_force {
                self.commands.insert(index, write);
            }
            return Ok(());
        }
        let is_window = (0x8001..=0x8004).contains(&index) && FILTER_WINDOW.contains(&subindex);
        if !is_window && !self.values.contains_key(&(index, subindex)) {
            let value = bus.read(self.slave, index, subindex)?;
            self.values.insert((index, subindex), SdoWrite::new(index, subindex, ty, value));
        }
        Ok(())
    }

    /// Waits until the master has let go of the gateway, writes the values and puts them into
    /// force. Says what could not be put back.
    pub(super) fn restore(&self, bus: &Bus) -> Result<(), String> {
        wait(bus, self.slave, |state| state == Some(AlState::PreOp))?;
        let mut steps: Vec<_> = self.values.values().copied().map(StartupStep::Download).collect();
        for (index, command) in &self.commands {
            steps.push(StartupStep::Download(*command));
            let status = if (0x8021..=0x8024).contains(index) { 3 } else { 2 };
            steps.push(StartupStep::expect(*index, status, 0));
        }
        apply(bus.diagnostics(), self.slave, &steps, &mut |_| {}).map_err(|it| it.to_string())?;
        for ((index, subindex), write) in &self.values {
            let found = bus.read(self.slave, *index, *subindex).map_err(|it| it.to_string())?;
            if found != write.value {
                let object = ecan_protocol::describe(*index, *subindex);
                return Err(format!("{object} was {} and now is {found}", write.value));
            }
        }
        Ok(())
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

fn is_command(index: u16, subindex: u8) -> bool {
    let is_apply = |write: SdoWrite| (write.index, write.subindex) == (index, subindex);
    let is_channel = (0x8001..=0x8004).contains(&index) && CHANNEL_COMMANDS.contains(&subindex);
    is_channel
        || (0..4).any(|channel| is_apply(McanChannelConfig::apply_write(channel)))
        || (0..4).any(|channel| is_apply(DataPathConfig::apply_write(channel)))
        || Direction::ALL.into_iter().any(|it| is_apply(PdoProfile::apply_write(it)))
}
