//! Configuration of a gateway for a session in OP.

use std::time::Duration;

use ecan_host::{AdapterConfig, DcSync, SlaveConfig, StartupPlan, StartupStep};
use ecan_protocol::config::{DataPathConfig, McanChannelConfig};
use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::Direction;

/// AssignActivate words: Sync0 alone, and with Sync1.
pub(crate) const SYNC0: u16 = 0x0300;
pub(crate) const SYNC0_AND_SYNC1: u16 = 0x0700;

/// Configuration of one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ChannelSetup {
    pub(crate) channel: u8,
    pub(crate) can: McanChannelConfig,
    pub(crate) data_path: DataPathConfig,
}

/// Configuration of a session.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Setup {
    pub(crate) rx: PdoProfile,
    pub(crate) tx: PdoProfile,
    pub(crate) cycle: Duration,
    pub(crate) sync0_shift: Option<Duration>,
    /// AssignActivate word with Sync0.
    pub(crate) assign_activate: u16,
    pub(crate) watchdog: Duration,
    pub(crate) channels: Vec<ChannelSetup>,
    pub(crate) is_applied: bool,
}

impl Setup {
    /// N = 1, 2 ms, without channels.
    pub(crate) fn plain() -> Self {
        let profile = PdoProfile { multiplier: 1, ..PdoProfile::default() };
        Self {
            rx: profile,
            tx: profile,
            cycle: Duration::from_millis(2),
            sync0_shift: None,
            assign_activate: SYNC0,
            watchdog: Duration::from_millis(100),
            channels: Vec::new(),
            is_applied: true,
        }
    }

    pub(crate) fn adapter(&self, master: u32, position: u16) -> AdapterConfig {
        let mut config = AdapterConfig::new(1)
            .with_multiplier(self.rx.multiplier)
            .with_cycle(self.cycle)
            .with_watchdog(self.watchdog);
        config.master_index = master;
        if let Some(slave) = config.slaves.iter_mut().next() {
            *slave = SlaveConfig {
                tx_multiplier: self.tx.multiplier,
                ..SlaveConfig::at(position, self.rx.multiplier)
            };
        }
        config.dc = self.sync0_shift.map(|shift| DcSync {
            assign_activate: self.assign_activate,
            ..DcSync::new(self.cycle, shift)
        });
        config
    }

    pub(crate) fn startup(&self) -> StartupPlan {
        let mut writes = Vec::new();
        writes.extend(self.tx.writes(Direction::TxPdo));
        writes.extend(self.rx.writes(Direction::RxPdo));
        if self.is_applied {
            writes.push(PdoProfile::apply_write(Direction::TxPdo));
            writes.push(PdoProfile::apply_write(Direction::RxPdo));
        }
        for ChannelSetup { channel, can, data_path } in &self.channels {
            writes.extend(can.needed_writes(*channel));
            writes.push(McanChannelConfig::apply_write(*channel));
            writes.extend(data_path.writes(*channel));
            writes.push(DataPathConfig::apply_write(*channel));
        }
        [writes.into_iter().map(StartupStep::Download).collect()].into_iter().collect()
    }
}
