//! A PDO image, from the service.

use ecan_protocol::image::{BudgetPolicy, EncapsulationProfile, OptionFlags, PdoProfile};
use ecan_protocol::mapping::Direction;

use crate::protocol::wire_frame::RecordError;

/// Bytes before the image.
pub const IMAGE_HEAD_BYTES: usize = 32;

/// A PDO image with its time and profile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageMessage<'a> {
    /// Start of the cycle, as in a frame record.
    pub time_ns: u64,
    /// Number of the cycle.
    pub cycle: u64,
    /// Images that this client lost before this one.
    pub lost: u32,
    /// Index of the gateway.
    pub gateway: u16,
    /// Direction of the image.
    pub direction: Direction,
    /// Profile of the image.
    pub profile: PdoProfile,
    /// The image: 128 bytes times the multiplier of the profile.
    pub image: &'a [u8],
}

impl<'a> ImageMessage<'a> {
    /// Appends the payload of the message.
    pub fn encode(&self, out: &mut Vec<u8>) {
        let PdoProfile { multiplier, channel_mask, profile, budget, options } = self.profile;
        let direction = match self.direction {
            Direction::TxPdo => 0,
            Direction::RxPdo => 1,
        };
        out.extend_from_slice(&self.time_ns.to_le_bytes());
        out.extend_from_slice(&self.cycle.to_le_bytes());
        out.extend_from_slice(&self.lost.to_le_bytes());
        out.extend_from_slice(&self.gateway.to_le_bytes());
        out.extend_from_slice(&[direction, multiplier, channel_mask]);
        out.extend_from_slice(&[profile.raw(), budget.raw(), options.bits(), 0, 0, 0, 0]);
        out.extend_from_slice(self.image);
    }

    /// Reads the payload of a message.
    ///
    /// # Errors
    /// [`RecordError`]: bytes are missing, or a field has a value that does not exist.
    pub fn decode(payload: &'a [u8]) -> Result<Self, RecordError> {
        let incomplete = RecordError::Incomplete(payload.len());
        let (times, rest) = payload.split_first_chunk::<16>().ok_or(incomplete)?;
        let (fields, image) = rest.split_first_chunk::<16>().ok_or(incomplete)?;
        let [time_ns, cycle] = *times.as_chunks::<8>().0 else { return Err(incomplete) };
        let [l0, l1, l2, l3, g0, g1, direction, multiplier, channel_mask, fields @ ..] = *fields;
        let [profile, budget, options, reserved @ ..] = fields;
        let direction = match direction {
            0 => Direction::TxPdo,
            1 => Direction::RxPdo,
            _ => return Err(RecordError::Reserved),
        };
        let profile = PdoProfile {
            multiplier,
            channel_mask,
            profile: EncapsulationProfile::from_raw(profile).ok_or(RecordError::Reserved)?,
            budget: BudgetPolicy::from_raw(budget).ok_or(RecordError::Reserved)?,
            options: OptionFlags::from_bits(options).ok_or(RecordError::Reserved)?,
        };
        if reserved != [0; 4] || profile.check(direction).is_err() {
            return Err(RecordError::Reserved);
        }
        if image.len() != profile.pdo_bytes() {
            return Err(incomplete);
        }
        Ok(Self {
            time_ns: u64::from_le_bytes(time_ns),
            cycle: u64::from_le_bytes(cycle),
            lost: u32::from_le_bytes([l0, l1, l2, l3]),
            gateway: u16::from_le_bytes([g0, g1]),
            direction,
            profile,
            image,
        })
    }
}
