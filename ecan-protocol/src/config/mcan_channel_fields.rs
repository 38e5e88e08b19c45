//! The fields of [`McanChannelConfig`] by subindex: what is written, and what raw values mean.

use super::mcan_channel::{BitTimingMode, McanChannelConfig, NodeMode, NonMatch, channel_index};
use super::message_ram::{DataSize, FifoMode, TxMode};
use crate::object::SdoWrite;
use crate::object::{MCAN_CHANNEL, ObjectType, describe_field, writable_fields};

/// Number of downloads of [`McanChannelConfig::writes`].
pub const MCAN_CHANNEL_CONFIG_WRITES: usize = 58;

/// Number of downloads of [`McanChannelConfig::bring_up_writes`].
pub const MCAN_CHANNEL_BRING_UP_WRITES: usize = 30;

const FIELDS: [(u8, ObjectType); MCAN_CHANNEL_CONFIG_WRITES] =
    writable_fields(&MCAN_CHANNEL, [(7, 40), (61, 87)]);

/// The fields of the manual's phase E.
const BRING_UP: [u8; MCAN_CHANNEL_BRING_UP_WRITES] = [
    7, 8, 9, 15, 16, 19, 20, 21, 22, 23, 24, 33, 34, 36, 37, 38, 39, 61, 62, 63, 64, 65, 66, 67,
    68, 69, 70, 71, 72, 73,
];

/// A value that a field of 0x8001..0x8004 cannot have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{value} is no value for {}", describe_field(0x8001, *.subindex))]
pub struct InvalidValue {
    /// The subindex.
    pub subindex: u8,
    /// The value.
    pub value: u32,
}

impl McanChannelConfig {
    /// The downloads of the whole configuration to a channel (0..3), in ascending order of
    /// subindex. A device may have loaded others from its flash, so all are needed.
    /// They take effect with [`apply_write`](Self::apply_write).
    pub fn writes(&self, channel: u8) -> [SdoWrite; MCAN_CHANNEL_CONFIG_WRITES] {
        FIELDS.map(|(subindex, ty)| self.field_write(channel, subindex, ty))
    }

    /// Those of [`writes`](Self::writes) that have an effect in this configuration: without manual
    /// timing in automatic mode, without the data phase in classic CAN (manual 5.4.3), without the
    /// parameters of a timestamp unit or timeout that is off.
    pub fn needed_writes(&self, channel: u8) -> impl Iterator<Item = SdoWrite> + use<> {
        let (is_manual, fd) = (self.bit_timing_mode == BitTimingMode::Manual, self.fd);
        let (tsu, timeout) = (self.tsu, self.timeout);
        self.writes(channel).into_iter().filter(move |write| match write.subindex {
            16 | 20 | 23 | 24 | 33 | 34 => fd,
            25..=28 => is_manual,
            29..=32 => is_manual && fd,
            77..=79 | 81..=83 => tsu,
            85 | 87 => timeout,
            _ => true,
        })
    }

    /// The shorter list of the manual's example (5.4.3 E1..E30), which leaves the rest of the
    /// configuration as the device has it.
    pub fn bring_up_writes(&self, channel: u8) -> [SdoWrite; MCAN_CHANNEL_BRING_UP_WRITES] {
        BRING_UP.map(|subindex| {
            let ty = MCAN_CHANNEL.entry(subindex).map_or(ObjectType::U8, |entry| entry.ty);
            self.field_write(channel, subindex, ty)
        })
    }

    fn field_write(&self, channel: u8, subindex: u8, ty: ObjectType) -> SdoWrite {
        // infallible: both lists hold configuration fields only, which the tests prove
        let value = self.value(subindex).unwrap_or_default();
        SdoWrite::new(channel_index(channel), subindex, ty, value)
    }

    /// The raw value of a configuration field, `None` for a subindex that is not one.
    pub fn value(&self, subindex: u8) -> Option<u32> {
        let ram = &self.ram;
        Some(match subindex {
            7 => self.bit_timing_mode.raw().into(),
            8 => self.node_mode.raw().into(),
            9 => self.non_iso.into(),
            10 => self.transmit_pause.into(),
            11 => self.edge_filter.into(),
            12 => self.protocol_exception_disable.into(),
            13 => self.wide_message_marker.into(),
            14 => self.external_timestamp.into(),
            15 => self.fd.into(),
            16 => self.tdc.into(),
            17 => self.restricted_mode_disable.into(),
            18 => self.disable_auto_retransmission.into(),
            19 => self.nominal_bitrate,
            20 => self.data_bitrate,
            21 => self.nominal_sample_point.min.into(),
            22 => self.nominal_sample_point.max.into(),
            23 => self.data_sample_point.min.into(),
            24 => self.data_sample_point.max.into(),
            25 => self.manual_nominal.brp.into(),
            26 => self.manual_nominal.tseg1.into(),
            27 => self.manual_nominal.tseg2.into(),
            28 => self.manual_nominal.sjw.into(),
            29 => self.manual_data.brp.into(),
            30 => self.manual_data.tseg1.into(),
            31 => self.manual_data.tseg2.into(),
            32 => self.manual_data.sjw.into(),
            33 => self.tdc_offset.into(),
            34 => self.tdc_filter.into(),
            36 => self.non_match_standard.raw().into(),
            37 => self.non_match_extended.raw().into(),
            38 => self.reject_remote_standard.into(),
            39 => self.reject_remote_extended.into(),
            40 => self.extended_id_mask,
            61 => ram.rx_fifo0.mode.raw().into(),
            62 => ram.rx_fifo0.size.into(),
            63 => ram.rx_fifo1.mode.raw().into(),
            64 => ram.rx_fifo1.size.into(),
            65 => ram.rx_fifo0.data_size.raw().into(),
            66 => ram.rx_fifo1.data_size.raw().into(),
            67 => ram.rx_buffer_count.into(),
            68 => ram.rx_buffer_data_size.raw().into(),
            69 => ram.tx_mode.raw().into(),
            70 => ram.tx_fifo_size.into(),
            71 => ram.tx_dedicated_count.into(),
            72 => ram.tx_data_size.raw().into(),
            73 => ram.tx_event_size.into(),
            74 => self.timestamp_selection.into(),
            75 => self.timestamp_prescaler.into(),
            76 => self.tsu.into(),
            77 => self.tsu_external_timebase.into(),
            78 => self.tsu_capture_sof.into(),
            79 => self.tsu_64_bit.into(),
            81 => self.tsu_prescaler.into(),
            82 => self.tsu_timebase_source.into(),
            83 => self.tsu_tbsel.into(),
            84 => self.timeout.into(),
            85 => self.timeout_select.into(),
            87 => self.timeout_period.into(),
            _ => return None,
        })
    }

    /// Sets a configuration field from its raw value, as a device or a project file has it.
    ///
    /// # Errors
    /// [`InvalidValue`] when the subindex is no configuration field, or its type or enumeration
    /// has no such value; the configuration stays as it was. Ranges are the matter of
    /// [`check`](Self::check).
    pub fn set_value(&mut self, subindex: u8, value: u32) -> Result<(), InvalidValue> {
        let invalid = InvalidValue { subindex, value };
        let byte = || u8::try_from(value).map_err(|_| invalid);
        let word = || u16::try_from(value).map_err(|_| invalid);
        let flag = || match value {
            0 => Ok(false),
            1 => Ok(true),
            _ => Err(invalid),
        };
        let data_size = || DataSize::from_raw(byte()?).ok_or(invalid);
        let fifo_mode = || FifoMode::from_raw(byte()?).ok_or(invalid);
        let non_match = || NonMatch::from_raw(byte()?).ok_or(invalid);
        let ram = &mut self.ram;
        match subindex {
            7 => self.bit_timing_mode = BitTimingMode::from_raw(byte()?).ok_or(invalid)?,
            8 => self.node_mode = NodeMode::from_raw(byte()?).ok_or(invalid)?,
            9 => self.non_iso = flag()?,
            10 => self.transmit_pause = flag()?,
            11 => self.edge_filter = flag()?,
            12 => self.protocol_exception_disable = flag()?,
            13 => self.wide_message_marker = flag()?,
            14 => self.external_timestamp = flag()?,
            15 => self.fd = flag()?,
            16 => self.tdc = flag()?,
            17 => self.restricted_mode_disable = flag()?,
            18 => self.disable_auto_retransmission = flag()?,
            19 => self.nominal_bitrate = value,
            20 => self.data_bitrate = value,
            21 => self.nominal_sample_point.min = word()?,
            22 => self.nominal_sample_point.max = word()?,
            23 => self.data_sample_point.min = word()?,
            24 => self.data_sample_point.max = word()?,
            25 => self.manual_nominal.brp = word()?,
            26 => self.manual_nominal.tseg1 = byte()?.into(),
            27 => self.manual_nominal.tseg2 = byte()?.into(),
            28 => self.manual_nominal.sjw = byte()?.into(),
            29 => self.manual_data.brp = word()?,
            30 => self.manual_data.tseg1 = byte()?.into(),
            31 => self.manual_data.tseg2 = byte()?.into(),
            32 => self.manual_data.sjw = byte()?.into(),
            33 => self.tdc_offset = byte()?,
            34 => self.tdc_filter = byte()?,
            36 => self.non_match_standard = non_match()?,
            37 => self.non_match_extended = non_match()?,
            38 => self.reject_remote_standard = flag()?,
            39 => self.reject_remote_extended = flag()?,
            40 => self.extended_id_mask = value,
            61 => ram.rx_fifo0.mode = fifo_mode()?,
            62 => ram.rx_fifo0.size = byte()?,
            63 => ram.rx_fifo1.mode = fifo_mode()?,
            64 => ram.rx_fifo1.size = byte()?,
            65 => ram.rx_fifo0.data_size = data_size()?,
            66 => ram.rx_fifo1.data_size = data_size()?,
            67 => ram.rx_buffer_count = byte()?,
            68 => ram.rx_buffer_data_size = data_size()?,
            69 => ram.tx_mode = TxMode::from_raw(byte()?).ok_or(invalid)?,
            70 => ram.tx_fifo_size = byte()?,
            71 => ram.tx_dedicated_count = byte()?,
            72 => ram.tx_data_size = data_size()?,
            73 => ram.tx_event_size = byte()?,
            74 => self.timestamp_selection = byte()?,
            75 => self.timestamp_prescaler = byte()?,
            76 => self.tsu = flag()?,
            77 => self.tsu_external_timebase = flag()?,
            78 => self.tsu_capture_sof = flag()?,
            79 => self.tsu_64_bit = flag()?,
            81 => self.tsu_prescaler = word()?,
            82 => self.tsu_timebase_source = byte()?,
            83 => self.tsu_tbsel = byte()?,
            84 => self.timeout = flag()?,
            85 => self.timeout_select = byte()?,
            87 => self.timeout_period = word()?,
            _ => return Err(invalid),
        }
        Ok(())
    }
}
