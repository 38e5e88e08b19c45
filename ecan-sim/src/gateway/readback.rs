//! What uploads show of the running firmware: states, counters and register snapshots
//! (manual 13.2 to 13.8).

use ecan_protocol::mapping::Direction;
use ecan_protocol::object::pdo_mapping_entry;

use super::Gateway;

impl Gateway {
    /// The value of an integer entry: computed where it changes by itself, else as stored.
    pub(super) fn value(&mut self, index: u16, subindex: u8) -> u32 {
        let computed = match index {
            0x1018 => self.identity(subindex),
            0x1600..=0x1617 | 0x1A00..=0x1A17 => pdo_mapping_entry(index, subindex),
            0x8010 => self.profile(Direction::TxPdo).readback(subindex),
            0x8011 => self.profile(Direction::RxPdo).readback(subindex),
            0x8021..=0x8024 if subindex == 20 => self.active_word(index),
            0x9000..=0x9003 => self.channel_information(usize::from(index - 0x9000), subindex),
            0x9011 => self.performance.readback(subindex, self.now, self.pulses),
            0x9020..=0x9023 => self.data_path_diagnostics(usize::from(index - 0x9020), subindex),
            0xB000 => self.maintenance_value(subindex),
            0xF000 => self.device_identity(subindex),
            _ => None,
        };
        computed.unwrap_or_else(|| self.values.get(index, subindex))
    }

    fn identity(&self, subindex: u8) -> Option<u32> {
        Some(match subindex {
            1 => self.settings.vendor_id,
            2 => self.settings.product_code,
            3 => self.settings.revision,
            4 => self.settings.serial as u32,
            _ => return None,
        })
    }

    fn device_identity(&self, subindex: u8) -> Option<u32> {
        let (major, minor) = self.firmware.version();
        Some(match subindex {
            1 => u32::from(self.firmware.device_type()),
            4 => self.settings.hardware_revision,
            5 => u32::from(major),
            6 => u32::from(minor),
            7 => self.settings.serial as u32,
            8 => (self.settings.serial >> 32) as u32,
            _ => return None,
        })
    }

    fn maintenance_value(&self, subindex: u8) -> Option<u32> {
        match subindex {
            7 => Some(self.configuration().crc()),
            8 => Some(self.flash.stored_crc()),
            9..=11 => self.firmware.readback(subindex),
            _ => self.maintenance.readback(subindex),
        }
    }

    fn active_word(&self, index: u16) -> Option<u32> {
        let channel = self.channels.get(usize::from(index - 0x8021))?;
        Some(channel.requested_policy().active_word())
    }

    /// 0x9000..0x9003. Reading the latched events acknowledges them.
    fn channel_information(&mut self, number: usize, subindex: u8) -> Option<u32> {
        let scheduled = self.schedule.waiting(number);
        let channel = self.channels.get_mut(number)?;
        let controller = &channel.controller;
        Some(match subindex {
            1 => controller.error_counter_register(),
            2 => controller.protocol_status_register(),
            3 => controller.interrupt_register(),
            4 => controller.fifo0_register(),
            5 => controller.fifo1_register(),
            6 => controller.transmit_register(),
            7 => controller.event_register(),
            8 => controller.high_priority_register(),
            9 => u32::from(channel.status(scheduled).raw()),
            10 => channel.rx_pending() as u32,
            11 => channel.tx_pending(scheduled) as u32,
            12 => {
                let events = u32::from(channel.events);
                channel.acknowledge_details();
                events
            }
            13 => channel.receive.dropped_total,
            14 => channel.transmit.backpressure,
            15 => channel.bus_off_count,
            16 => channel.detail_sequence,
            _ => return None,
        })
    }

    fn data_path_diagnostics(&self, number: usize, subindex: u8) -> Option<u32> {
        let channel = self.channels.get(number)?;
        let (receive, transmit) = (&channel.receive, &channel.transmit);
        Some(match subindex {
            1 => receive.waiting() as u32,
            2 => u32::from(receive.high_watermark),
            3 => u32::from(receive.drained_last),
            4 => u32::from(receive.drained_max),
            5 => receive.dropped_total,
            6 => receive.dropped_old,
            7 => receive.dropped_new,
            8 => receive.dropped_critical,
            9 => u32::from(receive.consumed_last),
            10 => u32::from(receive.consumed_max),
            11 => transmit.fifo_full,
            12 => transmit.stale_dropped,
            13 => channel.bus_off_count,
            14 => u32::from(channel.recovery_attempts),
            15 => u32::from(channel.degraded_state()),
            16 => channel.last_error,
            17 => channel.service_cycles_max,
            18 => channel.service_cycles_last,
            _ => return None,
        })
    }
}
