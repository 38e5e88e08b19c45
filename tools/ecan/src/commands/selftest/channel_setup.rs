//! Channel configuration of a gateway in operation.

use std::collections::BTreeMap;

use ecan_host::StartupStep;
use ecan_protocol::config::McanChannelConfig;
use ecan_protocol::mapping::CHANNELS;
use ecan_protocol::object::SdoWrite;

use super::steps::TestStep;

/// Values that the last configuration of the channels wrote.
#[derive(Clone, Debug)]
pub(super) struct ChannelSetup {
    values: BTreeMap<(u16, u8), u32>,
}

impl ChannelSetup {
    /// As after the start of the gateway.
    pub(super) fn started(channels: [Option<McanChannelConfig>; CHANNELS]) -> Self {
        let mut setup = Self { values: BTreeMap::new() };
        for (channel, config) in (0..).zip(&channels) {
            if let Some(config) = config {
                setup.note(config.needed_writes(channel));
            }
        }
        setup
    }

    /// Downloads that change the channels of a step and apply the changes, with the check of each
    /// status.
    pub(super) fn changes(&self, step: &TestStep<'_>) -> Vec<StartupStep> {
        let can = step.rate.channel(step.node_mode()).can;
        let mut changes = Vec::new();
        for channel in step.channels() {
            let differs = |write: &SdoWrite| {
                self.values.get(&(write.index, write.subindex)) != Some(&write.value)
            };
            let before = changes.len();
            let writes = can.needed_writes(channel).filter(differs);
            changes.extend(writes.map(StartupStep::Download));
            if changes.len() > before {
                let apply = McanChannelConfig::apply_write(channel);
                changes.push(StartupStep::Download(apply));
                changes.push(StartupStep::expect(apply.index, 2, 0));
            }
        }
        changes
    }

    /// Notes that the changes of a step are active.
    pub(super) fn set(&mut self, step: &TestStep<'_>) {
        let can = step.rate.channel(step.node_mode()).can;
        for channel in step.channels() {
            self.note(can.needed_writes(channel));
        }
    }

    fn note(&mut self, writes: impl Iterator<Item = SdoWrite>) {
        self.values.extend(writes.map(|write| ((write.index, write.subindex), write.value)));
    }
}

#[cfg(test)]
mod tests {
    use super::super::exchange::Route;
    use super::super::rates::Rate;
    use super::super::steps::TestPath;
    use super::*;

    #[test]
    fn only_changed_values_are_written() {
        let rates = Rate::usual();
        let routes = [0, 1].map(|channel| Route { from: channel, to: channel });
        let step = |rate, path| TestStep { path, rate, routes: &routes };
        let first = step(&rates[0], TestPath::Loopback);
        let can = first.rate.channel(first.node_mode()).can;
        let mut setup = ChannelSetup::started([Some(can), Some(can), None, None]);
        assert_eq!(setup.changes(&first), []);
        let wires = step(&rates[0], TestPath::Wire);
        let objects = |setup: &ChannelSetup, step| -> Vec<_> {
            setup.changes(step).iter().map(StartupStep::object).collect()
        };
        let expected =
            [(0x8001, 8), (0x8001, 1), (0x8001, 2), (0x8002, 8), (0x8002, 1), (0x8002, 2)];
        assert_eq!(objects(&setup, &wires), expected);
        setup.set(&wires);
        assert_eq!(setup.changes(&wires), []);
        let faster = objects(&setup, &step(&rates[1], TestPath::Wire));
        assert_eq!(faster[..3], [(0x8001, 19), (0x8001, 1), (0x8001, 2)]);
        assert_eq!(faster.len(), 6);
    }
}
