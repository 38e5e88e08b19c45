//! SDO access to the objects of a gateway, single and complete, and the effects of writes.
//!
//! Complete Access transfers the entries of an object as one block (ETG.1000.6).
//! Subindex 0 takes 16 bits. The following entries have the size of their type, which is whole
//! bytes for every type of this dictionary, without gaps; a missing subindex takes no space. An
//! object of a single value is that value. A writable subindex 0 counts the entries in use, and an
//! upload ends with them.

use ecan_protocol::config::ApplyStatus;
use ecan_protocol::device::AlState;
use ecan_protocol::mapping::{Direction, UNIT_BYTES, buffer_offset, locate_data_object};
use ecan_protocol::object::{
    AbortCode, Entry, MAPPED_SUBINDEX, Object, ObjectType, object, pdo_mapping_entry,
};

use super::application::Application;
use super::channel_control::subindex::{APPLY_STATUS, FLASH_STATUS};
use super::config::{GatewayModelConfig, PowerSupply};
use super::configuration_store::{Completion, ConfigurationStore, Target};
use super::ethercat_side::EthercatSide;
use super::fault::PendingFaults;
use super::firmware_update::FirmwareUpdate;
use super::maintenance::{
    CYCLE_PERFORMANCE, Command, DIAGNOSTIC_TEST, FIRST_DATA_PATH, GLOBAL_DATA_PATH, MAINTENANCE,
    MAINTENANCE_COMMAND, MODE_TIMEOUT, Maintenance, PendingCommand,
};
use super::object_server::{ObjectServer, Payload, RegisterService, TEST_REJECT_REASON};
use super::profile_control::{COMMAND_CLEAR_ERRORS, COMMAND_RESET_SESSION};
use super::variant::{ChannelApplyInOp, GatewayVariant, MappedSubindex};

/// Name of the device: 0x1008, and in the SII.
pub(crate) const DEVICE_NAME: &str = "ECAN-Lite";

/// Subindex of the apply command of 0x8020..0x8024.
const DATA_PATH_COMMAND: u8 = 2;

const COUNT_BYTES: usize = 2;

fn open(index: u16, first: u8) -> Result<&'static Object, AbortCode> {
    let object = object(index).ok_or(AbortCode::NO_OBJECT)?;
    if first > 1 {
        return Err(AbortCode::UNSUPPORTED_ACCESS);
    }
    if first > object.highest_subindex() {
        return Err(AbortCode::NO_SUBINDEX);
    }
    if object.entries.iter().any(|entry| entry.ty.size_bytes().is_none()) {
        return Err(AbortCode::NO_COMPLETE_ACCESS);
    }
    Ok(object)
}

fn block_bytes(object: &Object, entry: &Entry) -> usize {
    if entry.subindex == 0 && object.highest_subindex() > 0 {
        COUNT_BYTES
    } else {
        entry.ty.size_bytes().unwrap_or(0)
    }
}

/// Access to the objects of a gateway at a time, with the parts on which writes have an effect.
pub(crate) struct ObjectAccess<'a> {
    pub(super) config: &'a GatewayModelConfig,
    pub(super) now: u64,
    pub(super) side: &'a mut EthercatSide,
    pub(super) power: &'a mut PowerSupply,
    pub(super) application: &'a mut Application,
    pub(super) maintenance: &'a mut Maintenance,
    pub(super) store: &'a mut ConfigurationStore,
    pub(super) firmware: &'a mut FirmwareUpdate,
    pub(super) faults: &'a mut PendingFaults,
}

impl ObjectAccess<'_> {
    /// SDO upload: replaces the contents of `out` by the bytes of the entry; empty after an error.
    ///
    /// # Errors
    /// The abort code: no such object or subindex, write-only, wrong state, an injected one, or a
    /// timeout while the mailbox does not respond (see [`mailbox_answers`](Self::mailbox_answers)).
    pub(crate) fn upload(
        &mut self,
        index: u16,
        subindex: u8,
        out: &mut Vec<u8>,
    ) -> Result<(), AbortCode> {
        out.clear();
        let (_, entry) = self.open_transfer(index, subindex)?;
        if !entry.access.can_read() {
            return Err(AbortCode::WRITE_ONLY);
        }
        match entry.ty {
            ObjectType::VisibleString => {
                out.extend_from_slice(text(index, self.config, self.firmware).as_bytes())
            }
            ObjectType::String16 => self.read_unit(index, out),
            _ => {
                let bytes = self.value(index, subindex).to_le_bytes();
                let size = entry.ty.size_bytes().unwrap_or(bytes.len());
                out.extend_from_slice(bytes.get(..size).unwrap_or(&bytes));
            }
        }
        Ok(())
    }

    /// SDO download.
    ///
    /// # Errors
    /// The abort code: no such object or subindex, read-only, wrong length, value out of range,
    /// wrong state, an illegal combination, an injected one, or a timeout while the mailbox does
    /// not respond. Nothing has changed then. Values of objects with an apply command are stored
    /// unchecked and checked when applied.
    pub(crate) fn download(
        &mut self,
        index: u16,
        subindex: u8,
        data: &[u8],
    ) -> Result<(), AbortCode> {
        let (object, entry) = self.open_transfer(index, subindex)?;
        let value = match ObjectServer::decode(entry, data)? {
            Payload::Unit => return self.write_unit(index, data),
            Payload::Value(value) => value,
        };
        // one command at a time; the master would wait in vain for a second one
        if (index, subindex) == (MAINTENANCE, MAINTENANCE_COMMAND) && self.store.is_busy() {
            return Err(AbortCode::DEVICE_STATE);
        }
        let state = self.side.al().state;
        self.application.objects.store((object, entry), index, value, state)?;
        self.execute(Command::of(index, subindex, value));
        Ok(())
    }

    /// Returns whether the mailbox responds: booted, not in INIT, and not silenced by a fault.
    fn mailbox_answers(&self) -> bool {
        self.side.al().state.has_mailbox() && !self.faults.is_mailbox_silent(self.now)
    }

    fn open_transfer(
        &mut self,
        index: u16,
        subindex: u8,
    ) -> Result<(&'static Object, &'static Entry), AbortCode> {
        if !self.mailbox_answers() {
            return Err(AbortCode::TIMEOUT);
        }
        if self.side.al().state == AlState::Boot {
            return Err(AbortCode::DEVICE_STATE);
        }
        match self.faults.begin_transfer(index, subindex) {
            Some(code) => Err(code),
            None => find_entry(&self.config.variant, index, subindex),
        }
    }

    /// The bytes of a 16-byte unit in the memory of its sync manager.
    fn read_unit(&self, index: u16, out: &mut Vec<u8>) {
        let unit = locate_data_object(index).and_then(|(direction, chunk, unit)| {
            let memory = self.side.process_data_memory(direction);
            let offset = buffer_offset(chunk, unit);
            memory.get(offset..offset + UNIT_BYTES)
        });
        out.extend_from_slice(unit.unwrap_or(&[0; UNIT_BYTES]));
    }

    /// Writes an output unit into the memory of SM2. Without a complete SM2 write this sends
    /// nothing. While process data is exchanged, SM2 owns the memory.
    fn write_unit(&mut self, index: u16, data: &[u8]) -> Result<(), AbortCode> {
        if self.side.exchanges_process_data() {
            return Err(AbortCode::DEVICE_STATE);
        }
        if let Some((Direction::RxPdo, chunk, unit)) = locate_data_object(index) {
            self.side.store_output(buffer_offset(chunk, unit), data);
        }
        Ok(())
    }

    fn value(&mut self, index: u16, subindex: u8) -> u32 {
        let channel = |first: u16| usize::from(index - first);
        let mapping = self.mapping_entry(index, subindex);
        let data_path = &mut self.application.data_path;
        let computed = match index {
            0x1018 => self.identity(subindex),
            0x1600..=0x1617 | 0x1A00..=0x1A17 => mapping,
            0x8010 => data_path.options.tx.readback(subindex),
            0x8011 => data_path.options.rx.readback(subindex),
            0x8021..=0x8024 if subindex == 20 => {
                Some(data_path.channels[channel(0x8021)].requested.active_word())
            }
            0x9000..=0x9003 => data_path.channel_information(channel(0x9000), subindex),
            CYCLE_PERFORMANCE => {
                data_path.performance.readback(subindex, self.now, self.side.pulses())
            }
            0x9020..=0x9023 => data_path.channels[channel(0x9020)].diagnostics(subindex),
            MAINTENANCE => self.maintenance_value(subindex),
            0xF000 => self.device_identity(subindex),
            _ => None,
        };
        computed.unwrap_or_else(|| self.application.objects.values.get(index, subindex))
    }

    /// As [`pdo_mapping_entry`], with the mapped subindex of the variant.
    fn mapping_entry(&self, index: u16, subindex: u8) -> Option<u32> {
        const SUBINDEX: u32 = 0xFF00;
        let entry = pdo_mapping_entry(index, subindex)?;
        Some(entry & !SUBINDEX | u32::from(self.config.variant.mapped_subindex.number()) << 8)
    }

    fn identity(&self, subindex: u8) -> Option<u32> {
        Some(match subindex {
            1 => self.config.vendor_id,
            2 => self.config.product_code,
            3 => self.config.revision,
            4 => self.config.serial as u32,
            _ => return None,
        })
    }

    fn device_identity(&self, subindex: u8) -> Option<u32> {
        let (major, minor) = self.firmware.version();
        Some(match subindex {
            1 => u32::from(self.firmware.header.device_type),
            4 => self.config.hardware_revision,
            5 => u32::from(major),
            6 => u32::from(minor),
            7 => self.config.serial as u32,
            8 => (self.config.serial >> 32) as u32,
            _ => return None,
        })
    }

    fn maintenance_value(&self, subindex: u8) -> Option<u32> {
        match subindex {
            6 => Some(u32::from(self.application.data_path.flags)),
            7 => Some(self.application.configuration().crc()),
            8 => Some(self.store.stored_crc()),
            9..=11 => self.firmware.readback(subindex),
            _ => self.maintenance.readback(subindex),
        }
    }

    fn execute(&mut self, command: Command) {
        let state = self.side.al().state;
        let application = &mut *self.application;
        match command {
            Command::Nothing => {}
            Command::Reboot => self.power.request_reboot(self.now),
            Command::RotatePins => application.note_rotation(state),
            Command::ApplyChannel(channel) => {
                let is_rejected = state == AlState::Op
                    && self.config.variant.channel_apply_in_op == ChannelApplyInOp::Rejected;
                let status = match is_rejected {
                    true => ApplyStatus::Fail,
                    false => application.apply_channel(channel, state),
                };
                application.objects.finish_channel_command(channel, APPLY_STATUS, status);
            }
            Command::ChannelFlash { channel, bits } => {
                let begun = self.store.begin_channel(self.now, channel, bits, application, state);
                if let Err(status) = begun {
                    self.finish_channel_flash(channel, status);
                }
            }
            Command::EditFilters { channel, extended, command } => {
                application.objects.edit_filters(channel, extended, command);
            }
            Command::ApplyProfile(direction) => application.apply_profile(direction, state),
            Command::ControlProfile { direction, bits } => {
                if bits & COMMAND_RESET_SESSION != 0 {
                    application.data_path.reset_session(direction);
                }
                if bits & COMMAND_CLEAR_ERRORS != 0 {
                    application.data_path.options.of_mut(direction).clear_errors();
                }
            }
            Command::ProfileRequested(direction) => application.note_profile_request(direction),
            Command::AssignmentWritten(direction) => {
                application.data_path.options.of_mut(direction).note_assignment();
            }
            Command::GlobalDataPath { apply } => {
                application.objects.values.set(GLOBAL_DATA_PATH, DATA_PATH_COMMAND, 0);
                if apply {
                    application.apply_global_data_path();
                }
            }
            Command::DataPath { channel, apply } => {
                let index = FIRST_DATA_PATH + channel as u16;
                application.objects.values.set(index, DATA_PATH_COMMAND, 0);
                if apply {
                    application.apply_data_path(channel);
                }
            }
            Command::TestPolicies { key } => {
                let test = application.objects.test_policies();
                if key {
                    application.objects.values.set(DIAGNOSTIC_TEST, TEST_REJECT_REASON, 0);
                }
                application.data_path.set_test(test);
            }
            Command::Performance { subindex, clear } => {
                application.objects.values.set(CYCLE_PERFORMANCE, subindex, 0);
                if clear {
                    application.data_path.clear_performance(self.now, self.side.pulses());
                }
            }
            Command::Register { channel } => RegisterService {
                number: channel,
                values: &mut application.objects.values,
                data_path: &mut application.data_path,
                is_engineering: self.maintenance.is_engineering(),
            }
            .execute(self.now),
            Command::AccessMode(mode) => {
                let timeout = application.objects.values.get_u16(MAINTENANCE, MODE_TIMEOUT);
                self.maintenance.request_mode(self.now, mode, timeout);
            }
            Command::Maintenance(bits) => self.begin_maintenance(bits),
        }
    }

    fn begin_maintenance(&mut self, bits: u32) {
        let is_receiving = self.firmware.is_receiving();
        match self.maintenance.command(bits, self.side.al().is_op(), is_receiving) {
            PendingCommand::Nothing => {}
            PendingCommand::ClearDiagnostics => {
                self.application.data_path.clear_diagnostics(self.now, self.side.pulses());
            }
            PendingCommand::Execute(bits) => {
                self.maintenance.begin();
                self.store.begin(self.now, bits, self.application.configuration());
            }
        }
    }

    /// Ends the command of the configuration store that is due. Returns whether the gateway reboots with a new
    /// EEPROM.
    pub(super) fn finish_store_command(&mut self) -> bool {
        let mut target = Target {
            application: self.application,
            firmware: self.firmware,
            faults: self.faults,
            state: self.side.al().state,
            now: self.now,
        };
        match self.store.finish(&mut target) {
            None => {}
            Some(Completion::Channel { number, status }) => {
                self.finish_channel_flash(number, status);
            }
            Some(Completion::Device { status, rebuilds_eeprom }) => {
                self.maintenance.finish(status);
                return rebuilds_eeprom;
            }
        }
        false
    }

    fn finish_channel_flash(&mut self, channel: usize, status: ApplyStatus) {
        self.application.objects.finish_channel_command(channel, FLASH_STATUS, status);
    }

    /// Uploads the entries from `first` on, 0 or 1. Write-only entries read as zeros.
    ///
    /// # Errors
    /// As [`upload`](Self::upload); without Complete Access 0x06010000.
    pub(crate) fn upload_complete(&mut self, index: u16, first: u8) -> Result<Vec<u8>, AbortCode> {
        check_complete_access(self.config)?;
        self.upload_block(index, first)
    }

    /// Downloads a block that begins with subindex `first`, 0 or 1, and can end after any entry. A
    /// count in subindex 0 is set to 0 before the entries are written, and to its value after them;
    /// a read-only one must match. The first rejected entry ends the download; entries written
    /// before it stay.
    ///
    /// # Errors
    /// As [`download`](Self::download); without Complete Access 0x06010000.
    pub(crate) fn download_complete(
        &mut self,
        index: u16,
        first: u8,
        data: &[u8],
    ) -> Result<(), AbortCode> {
        check_complete_access(self.config)?;
        self.download_block(index, first, data)
    }

    fn upload_block(&mut self, index: u16, first: u8) -> Result<Vec<u8>, AbortCode> {
        let object = open(index, first)?;
        let has_writable_count = object.highest_subindex() > 0
            && object.entry(0).is_some_and(|entry| entry.access.can_write());
        let last = match has_writable_count {
            true => self.read_entry(index, 0)?.first().copied().unwrap_or(0),
            false => object.highest_subindex(),
        };
        let mut block = Vec::new();
        for entry in object.entries {
            if !(first..=last).contains(&entry.subindex) {
                continue;
            }
            let end = block.len() + block_bytes(object, entry);
            if entry.access.can_read() {
                block.extend(self.read_entry(index, entry.subindex)?);
            }
            block.resize(end, 0);
        }
        Ok(block)
    }

    fn download_block(&mut self, index: u16, first: u8, data: &[u8]) -> Result<(), AbortCode> {
        let object = open(index, first)?;
        let parts = split(object, first, data)?;
        let mut count = None;
        for (entry, bytes) in parts {
            let subindex = entry.subindex;
            if subindex == 0 && object.highest_subindex() > 0 {
                let value = bytes.get(..1).unwrap_or_default();
                if entry.access.can_write() {
                    self.download(index, 0, &[0])?;
                    count = Some(value);
                } else if self.read_entry(index, 0)? != value {
                    return Err(AbortCode::READ_ONLY);
                }
            } else {
                self.download(index, subindex, bytes)?;
            }
        }
        match count {
            Some(count) => self.download(index, 0, count),
            None => Ok(()),
        }
    }

    fn read_entry(&mut self, index: u16, subindex: u8) -> Result<Vec<u8>, AbortCode> {
        let mut data = Vec::new();
        self.upload(index, subindex, &mut data).map(|()| data)
    }
}

/// An entry that the firmware of the variant has.
pub(crate) fn find_entry(
    variant: &GatewayVariant,
    index: u16,
    subindex: u8,
) -> Result<(&'static Object, &'static Entry), AbortCode> {
    if let Some(code) = variant.missing_entry(index, subindex) {
        return Err(code);
    }
    match variant.mapped_subindex {
        MappedSubindex::Zero if locate_data_object(index).is_some() => match subindex {
            0 => ObjectServer::find(index, MAPPED_SUBINDEX),
            _ => Err(AbortCode::NO_SUBINDEX),
        },
        _ => ObjectServer::find(index, subindex),
    }
}

pub(super) fn text(index: u16, config: &GatewayModelConfig, firmware: &FirmwareUpdate) -> String {
    let (major, minor) = firmware.version();
    match index {
        0x1008 => DEVICE_NAME.to_owned(),
        0x1009 => config.hardware_revision.to_string(),
        _ => format!("{}.{}.{minor}", major >> 8, major & 0xFF),
    }
}

pub(crate) fn check_complete_access(config: &GatewayModelConfig) -> Result<(), AbortCode> {
    if config.complete_access { Ok(()) } else { Err(AbortCode::UNSUPPORTED_ACCESS) }
}

fn split<'a>(
    object: &Object,
    first: u8,
    data: &'a [u8],
) -> Result<Vec<(&'static Entry, &'a [u8])>, AbortCode> {
    if data.is_empty() {
        return Err(AbortCode::LENGTH);
    }
    let mut rest = data;
    let mut parts = Vec::new();
    for entry in object.entries.iter().filter(|entry| entry.subindex >= first) {
        if rest.is_empty() {
            break;
        }
        let (part, remaining) =
            rest.split_at_checked(block_bytes(object, entry)).ok_or(AbortCode::TOO_SHORT)?;
        parts.push((entry, part));
        rest = remaining;
    }
    if rest.is_empty() { Ok(parts) } else { Err(AbortCode::TOO_LONG) }
}
