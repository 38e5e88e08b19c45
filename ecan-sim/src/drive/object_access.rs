//! The dictionary as SDO clients see it: rules, and what a write leads to.

use ecan_canopen::{HeartbeatConsumer, OperatingMode, SupportedModes, object};
use ecan_protocol::object::AbortCode;

use super::axis_commands::ReceivedCommands;
use super::device::Device;
use super::dictionary::{Access, Object, Slot, Value};
use super::emergency::forget;
use super::homing;
use super::motion;
use super::network::Network;
use super::pdo::{ReceivePdo, TransmitPdo};
use super::pdo_rules::PdoObject;
use super::sdo_server::{Objects, Refusal};
use super::settings::{SdoDirection, SdoEffect, SdoRule};

/// "save" and "load", little-endian.
const SAVE: u32 = 0x6576_6173;
const LOAD: u32 = 0x6461_6F6C;

impl Objects for Device {
    fn upload(&mut self, index: u16, subindex: u8, out: &mut Vec<u8>) -> Result<(), Refusal> {
        self.strike(index, subindex, SdoDirection::Read)?;
        self.publish();
        let slot = self.objects.find(index, subindex)?;
        Ok(self.objects.read(slot, out)?)
    }

    fn begin_download(
        &mut self,
        index: u16,
        subindex: u8,
        length: Option<usize>,
    ) -> Result<(), Refusal> {
        self.strike(index, subindex, SdoDirection::Write)?;
        let slot = self.objects.find(index, subindex)?;
        Ok(self.objects.check_write(slot, length)?)
    }

    fn download(&mut self, index: u16, subindex: u8, value: &[u8]) -> Result<(), Refusal> {
        let slot = self.objects.find(index, subindex)?;
        match self.objects.decode(slot, value)? {
            Some(number) => Ok(self.write(slot, (index, subindex), number)?),
            None => {
                self.objects.put_bytes(slot, value);
                Ok(())
            }
        }
    }

    fn size(&self, index: u16, subindex: u8) -> Option<usize> {
        let slot = self.objects.find(index, subindex).ok()?;
        self.objects.object(slot)?.data_type.size()
    }
}

impl Device {
    /// Lets a rule about this transfer strike.
    fn strike(&mut self, index: u16, subindex: u8, way: SdoDirection) -> Result<(), Refusal> {
        let concerns = |rule: &SdoRule| {
            rule.index == index
                && rule.subindex.is_none_or(|only| only == subindex)
                && (rule.direction == way || rule.direction == SdoDirection::Both)
        };
        let found = self.rules.iter_mut().find(|(rule, left)| concerns(rule) && *left != Some(0));
        let Some((rule, left)) = found else { return Ok(()) };
        if let Some(left) = left {
            *left -= 1;
        }
        Err(match rule.effect {
            SdoEffect::Abort(code) => Refusal::Abort(code),
            SdoEffect::Silence => Refusal::Silence,
        })
    }

    /// Whether the drive has a mode of operation; no mode (0) is one.
    pub(super) fn has_mode(&self, raw: i8) -> bool {
        let modes = self.objects.number(object::SUPPORTED_MODES, 0).unwrap_or(0);
        match OperatingMode::from_raw(raw) {
            Some(mode) => motion::is_supported(mode) && SupportedModes(modes as u32).contains(mode),
            None => raw == 0,
        }
    }

    fn write(&mut self, slot: Slot, key: (u16, u8), number: i64) -> Result<(), AbortCode> {
        self.check(key, number)?;
        match key {
            (object::STORE_PARAMETERS, _) => return self.store(number as u32),
            (object::RESTORE_PARAMETERS, _) => return self.restore(number as u32),
            (object::ERROR_HISTORY, 0) => {
                forget(&mut self.objects);
                return Ok(());
            }
            _ => {}
        }
        self.objects.put(slot, number as u64);
        self.follow_up(key, number);
        Ok(())
    }

    /// What the type and limits of an object do not tell.
    fn check(&self, (index, subindex): (u16, u8), number: i64) -> Result<(), AbortCode> {
        if let Some(pdo) = PdoObject::of(index) {
            return pdo.check(
                &self.objects,
                self.network.state(),
                &self.settings.quirks,
                (index, subindex),
                number as u32,
            );
        }
        match (index, subindex) {
            (object::MODE_OF_OPERATION, _) if !self.has_mode(number as i8) => Err(AbortCode::RANGE),
            (object::HOMING_METHOD, _) if number != 0 && !homing::is_supported(number as i8) => {
                Err(AbortCode::RANGE)
            }
            // No producer of SYNC, and 11 bits.
            (object::SYNC_COB_ID, _) if number as u32 & !0x7FF != 0 => Err(AbortCode::RANGE),
            (object::CONSUMER_HEARTBEAT, 1..) => match HeartbeatConsumer::from_raw(number as u32) {
                Some(entry) if Network::is_watched(&self.objects, entry.producer, subindex) => {
                    Err(AbortCode::PARAMETER_INCOMPATIBLE)
                }
                _ => Ok(()),
            },
            _ => Ok(()),
        }
    }

    /// What a new number leads to.
    fn follow_up(&mut self, (index, subindex): (u16, u8), number: i64) {
        if let Some(pdo) = PdoObject::of(index) {
            return self.load_pdo(pdo);
        }
        match index {
            object::PRODUCER_HEARTBEAT => self.network.load(self.now, &self.objects),
            object::CONSUMER_HEARTBEAT if subindex > 0 => {
                self.network.load_watches(&self.objects);
            }
            object::SYNC_COB_ID => self.load_sync(),
            _ => {
                let mut brought = ReceivedCommands::default();
                if self.axis.note(index, number, &mut brought) {
                    self.axis.take(&brought, &self.parameters);
                } else if index >= 0x6000 {
                    self.load_parameters();
                }
            }
        }
    }

    fn load_pdo(&mut self, pdo: PdoObject) {
        match pdo {
            PdoObject::ReceiveCommunication(number) | PdoObject::ReceiveMapping(number) => {
                if let Some(pdo) = self.receive.iter_mut().find(|pdo| pdo.number == number) {
                    *pdo = ReceivePdo::load(&self.objects, number);
                }
            }
            PdoObject::TransmitCommunication(number) | PdoObject::TransmitMapping(number) => {
                if let Some(pdo) = self.transmit.iter_mut().find(|pdo| pdo.number == number) {
                    *pdo = TransmitPdo::load(&self.objects, number);
                }
            }
        }
        self.note_pdos();
    }

    /// Saves parameters, not commands.
    fn store(&mut self, signature: u32) -> Result<(), AbortCode> {
        if signature != SAVE {
            return Err(AbortCode::NOT_STORED);
        }
        for object in self.objects.iter_mut().filter(|object| is_parameter(object)) {
            object.saved = Some(object.value.clone());
        }
        Ok(())
    }

    /// Forgets what was saved; the defaults come with the next reset.
    fn restore(&mut self, signature: u32) -> Result<(), AbortCode> {
        if signature != LOAD {
            return Err(AbortCode::NOT_STORED);
        }
        for object in self.objects.iter_mut() {
            object.saved = None;
        }
        Ok(())
    }
}

fn is_parameter(object: &Object) -> bool {
    let kept = !matches!(
        object.index,
        object::ERROR_HISTORY | object::STORE_PARAMETERS | object::RESTORE_PARAMETERS
    );
    kept && object.access == Access::ReadWrite && matches!(object.value, Value::Number(_))
}
