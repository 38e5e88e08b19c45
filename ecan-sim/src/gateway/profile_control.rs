//! 0x8010 and 0x8011: requested and active PDO profile of one direction, its status and its
//! error counters (manual 13.2).

use ecan_protocol::config::{CrcTest, DiagnosticTest, ProfileStatus, RxBypass, Sides, TxBypass};
use ecan_protocol::device::AlState;
use ecan_protocol::image::{BudgetPolicy, EncapsulationProfile, OptionFlags, PdoError, PdoProfile};
use ecan_protocol::mapping::{Direction, MAX_MULTIPLIER};

use super::dictionary_values::DictionaryValues;
use super::firmware_update::crc32;
use super::variant::{
    AssignmentRewritten, EmptyMask, GatewayVariant, LayoutCrc, ProfileErrors, RejectedBudget,
    SequenceReadback,
};

/// Subindices of 0x8010 and 0x8011.
pub(super) mod subindex {
    pub(in crate::gateway) const APPLY: u8 = 1;
    pub(in crate::gateway) const MULTIPLIER: u8 = 3;
    pub(in crate::gateway) const CHANNEL_MASK: u8 = 4;
    pub(in crate::gateway) const PROFILE: u8 = 5;
    pub(in crate::gateway) const BUDGET: u8 = 6;
    pub(in crate::gateway) const OPTIONS: u8 = 7;
    pub(in crate::gateway) const COMMAND: u8 = 8;
}

pub(super) const COMMAND_RESET_SESSION: u32 = 1 << 0;
pub(super) const COMMAND_CLEAR_ERRORS: u32 = 1 << 1;

const EXISTING_CHANNELS: u8 = 0x0F;

/// Status and, if one fits, last PDO error of a rejected profile.
type Rejection = (ProfileStatus, Option<PdoError>);

#[derive(Clone, Debug)]
pub(super) struct ProfileControl {
    direction: Direction,
    pub(super) active: Option<PdoProfile>,
    status: ProfileStatus,
    pub(super) sequence: u16,
    last_error: PdoError,
    error_counter: u32,
    overflow_counter: u32,
    /// The PDO assignment was written after the profile was applied.
    assignment_is_newer: bool,
    assignment_rewritten: AssignmentRewritten,
    errors: ProfileErrors,
    layout_crc: LayoutCrc,
    sequence_readback: SequenceReadback,
    rejected_budget: RejectedBudget,
    empty_mask: EmptyMask,
}

impl ProfileControl {
    pub(super) fn new(direction: Direction, variant: &GatewayVariant) -> Self {
        Self {
            direction,
            active: None,
            status: ProfileStatus::Ok,
            sequence: 0,
            last_error: PdoError::Ok,
            error_counter: 0,
            overflow_counter: 0,
            assignment_is_newer: false,
            assignment_rewritten: variant.assignment_rewritten,
            errors: variant.profile_errors,
            layout_crc: variant.layout_crc,
            sequence_readback: variant.sequence_readback,
            rejected_budget: variant.rejected_budget,
            empty_mask: variant.empty_mask,
        }
    }

    pub(super) fn active_bytes(&self) -> usize {
        self.active.map_or(0, |profile| profile.pdo_bytes())
    }

    /// Apply command: checks the requested profile and activates it. `assigned` is the number of
    /// assigned chunks, `None` if they are not the first ones in order. Returns whether the active
    /// profile changed.
    pub(super) fn apply(
        &mut self,
        values: &DictionaryValues,
        state: AlState,
        assigned: Option<u8>,
    ) -> bool {
        match self.check(values, state, assigned) {
            Ok(profile) => {
                self.status = ProfileStatus::Ok;
                self.assignment_is_newer = false;
                let changed = self.active != Some(profile);
                self.active = Some(profile);
                changed
            }
            Err((status, error)) => {
                self.status = status;
                self.last_error = error.unwrap_or(self.last_error);
                false
            }
        }
    }

    fn check(
        &self,
        values: &DictionaryValues,
        state: AlState,
        assigned: Option<u8>,
    ) -> Result<PdoProfile, Rejection> {
        let requested = self.requested(values);
        if state == AlState::Op {
            // applying the active profile again changes no layout
            return match requested {
                Ok(profile) if self.active == Some(profile) => Ok(profile),
                _ => Err((ProfileStatus::InvalidState, None)),
            };
        }
        let requested = requested?;
        if assigned != Some(requested.multiplier) {
            return Err((ProfileStatus::MappingReloadRequired, Some(PdoError::ActiveArea)));
        }
        Ok(requested)
    }

    fn requested(&self, values: &DictionaryValues) -> Result<PdoProfile, Rejection> {
        let value = |subindex| values.get_u8(self.direction.profile_object(), subindex);
        let multiplier = value(subindex::MULTIPLIER);
        if !(1..=MAX_MULTIPLIER).contains(&multiplier) {
            return Err((ProfileStatus::InvalidMultiplier, None));
        }
        let channel_mask = value(subindex::CHANNEL_MASK);
        let is_empty = channel_mask == 0 && self.empty_mask == EmptyMask::Rejected;
        if is_empty || channel_mask & !EXISTING_CHANNELS != 0 {
            return Err((ProfileStatus::InvalidChannelMask, None));
        }
        let profile = EncapsulationProfile::from_raw(value(subindex::PROFILE))
            .ok_or((ProfileStatus::InvalidProfile, Some(PdoError::UnsupportedProfile)))?;
        // The manual has no status for the budget policy; this is the nearest one.
        let unsupported = (ProfileStatus::UnsupportedOption, Some(PdoError::UnsupportedOption));
        let rejection = match self.rejected_budget {
            RejectedBudget::UnsupportedOption => unsupported,
            RejectedBudget::InvalidProfile => (ProfileStatus::InvalidProfile, unsupported.1),
        };
        let budget = BudgetPolicy::from_raw(value(subindex::BUDGET)).ok_or(rejection)?;
        let options = OptionFlags::from_bits(value(subindex::OPTIONS)).ok_or(unsupported)?;
        Ok(PdoProfile { multiplier, channel_mask, profile, budget, options })
    }

    /// A requested field was written: apply is pending while the request differs from the active
    /// profile.
    pub(super) fn note_request(&mut self, values: &DictionaryValues) {
        if self.active.is_none() || self.requested(values).ok() != self.active {
            self.status = ProfileStatus::PendingApply;
        } else if self.status == ProfileStatus::PendingApply {
            self.status = ProfileStatus::Ok;
        }
    }

    /// An entry of the PDO assignment was written.
    pub(super) fn note_assignment(&mut self) {
        self.assignment_is_newer = self.active.is_some();
    }

    /// Process data starts. Returns whether the profile is lost, by the variant.
    pub(super) fn lose_rewritten(&mut self) -> bool {
        let is_lost = self.assignment_is_newer
            && self.assignment_rewritten == AssignmentRewritten::DroppedAtSafeOp;
        if is_lost {
            self.active = None;
            self.status = ProfileStatus::MappingReloadRequired;
        }
        is_lost
    }

    fn status(&self) -> ProfileStatus {
        if self.assignment_is_newer
            && self.assignment_rewritten == AssignmentRewritten::ReloadRequired
        {
            ProfileStatus::MappingReloadRequired
        } else {
            self.status
        }
    }

    fn show(&mut self, status: ProfileStatus) {
        if self.errors == ProfileErrors::InStatus {
            self.status = status;
        }
    }

    pub(super) fn note_error(&mut self, error: PdoError) {
        self.last_error = error;
        self.error_counter = self.error_counter.saturating_add(1);
        self.show(ProfileStatus::EncapsulationError);
    }

    /// Frames did not fit or were dropped under backpressure.
    pub(super) fn note_overflow(&mut self, frames: u32, error: Option<PdoError>) {
        if frames == 0 {
            return;
        }
        self.overflow_counter = self.overflow_counter.saturating_add(frames);
        self.show(ProfileStatus::Overflow);
        self.last_error = error.unwrap_or(self.last_error);
    }

    pub(super) fn clear_errors(&mut self) {
        self.error_counter = 0;
        self.overflow_counter = 0;
        self.clear_last_error();
    }

    pub(super) fn reset_session(&mut self) {
        self.sequence = 0;
        self.clear_last_error();
    }

    fn clear_last_error(&mut self) {
        self.last_error = PdoError::Ok;
        if matches!(self.status, ProfileStatus::EncapsulationError | ProfileStatus::Overflow) {
            self.status = ProfileStatus::Ok;
        }
    }

    /// Value of a computed subindex; `None` for stored ones.
    pub(super) fn readback(&self, subindex: u8) -> Option<u32> {
        let active = self.active;
        Some(match subindex {
            subindex::APPLY | subindex::COMMAND => 0,
            2 => u32::from(self.status().raw()),
            9 => self.active_bytes() as u32,
            10 => active.map_or(0, |p| p.frame_area_bytes() as u32),
            11 => active.map_or(0, |p| self.layout_crc(p)),
            12 => active.map_or(0, |p| p.word()),
            13 => self.recent_sequence(),
            14 => u32::from(self.last_error.raw()),
            15 => self.error_counter,
            16 => self.overflow_counter,
            _ => return None,
        })
    }

    fn recent_sequence(&self) -> u32 {
        let is_reported =
            self.direction == Direction::TxPdo || self.sequence_readback == SequenceReadback::Last;
        if is_reported { u32::from(self.sequence) } else { 0 }
    }

    /// The layout contract CRC, whose algorithm the manual does not specify.
    fn layout_crc(&self, profile: PdoProfile) -> u32 {
        let word = profile.word().to_le_bytes();
        match self.layout_crc {
            LayoutCrc::Object => {
                let mut contract = self.direction.profile_object().to_le_bytes().to_vec();
                contract.extend((profile.pdo_bytes() as u32).to_le_bytes());
                contract.extend(word);
                crc32(&contract)
            }
            LayoutCrc::ProfileWord => crc32(&word),
            LayoutCrc::Zero => 0,
        }
    }
}

/// Profiles of 0x8010 and 0x8011 and test policies of 0x8030.
#[derive(Clone, Debug)]
pub(super) struct ActiveOptions {
    pub(super) tx: ProfileControl,
    pub(super) rx: ProfileControl,
    pub(super) test: DiagnosticTest,
}

impl ActiveOptions {
    pub(super) fn new(variant: &GatewayVariant) -> Self {
        let [tx, rx] = [Direction::TxPdo, Direction::RxPdo]
            .map(|direction| ProfileControl::new(direction, variant));
        Self { tx, rx, test: DiagnosticTest::OFF }
    }

    pub(super) fn of(&self, direction: Direction) -> &ProfileControl {
        match direction {
            Direction::TxPdo => &self.tx,
            Direction::RxPdo => &self.rx,
        }
    }

    pub(super) fn of_mut(&mut self, direction: Direction) -> &mut ProfileControl {
        match direction {
            Direction::TxPdo => &mut self.tx,
            Direction::RxPdo => &mut self.rx,
        }
    }

    pub(super) fn has(&self, direction: Direction, option: OptionFlags) -> bool {
        self.of(direction).active.is_some_and(|profile| profile.options.contains(option))
    }

    pub(super) fn uses_crc(&self, direction: Direction) -> bool {
        match self.test.crc {
            CrcTest::Follow => !self.has(direction, OptionFlags::NO_CRC16),
            CrcTest::Force => true,
            CrcTest::Suppress => false,
        }
    }

    pub(super) fn is_payload_only(&self, direction: Direction) -> bool {
        self.has(direction, OptionFlags::PAYLOAD_ONLY)
            || includes(self.test.payload_only, direction)
    }

    /// Returns whether the CAN side of a direction is disconnected.
    pub(super) fn is_app_bypassed(&self, direction: Direction) -> bool {
        self.has(direction, OptionFlags::APP_BYPASS)
            || includes(self.test.app_link_bypass, direction)
    }

    pub(super) fn bypasses_rx(&self, bypass: RxBypass) -> bool {
        self.test.rx_bypass.0 & bypass.0 != 0
    }

    pub(super) fn bypasses_tx(&self, bypass: TxBypass) -> bool {
        self.test.tx_bypass.0 & bypass.0 != 0
    }
}

fn includes(sides: Sides, direction: Direction) -> bool {
    match sides {
        Sides::Off => false,
        Sides::Tx => direction == Direction::TxPdo,
        Sides::Rx => direction == Direction::RxPdo,
        Sides::Both => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn test_policies_override_the_profile() {
        let mut options = ActiveOptions::new(&GatewayVariant::default());
        assert!(options.uses_crc(Direction::TxPdo));
        options.test.crc = CrcTest::Suppress;
        assert!(!options.uses_crc(Direction::TxPdo));
        options.test.payload_only = Sides::Tx;
        let payload_only = Direction::ALL.map(|direction| options.is_payload_only(direction));
        let expected = Direction::ALL.map(|direction| direction == Direction::TxPdo);
        assert_eq!(payload_only, expected);
        options.test.rx_bypass = RxBypass::STAGE;
        assert!(options.bypasses_rx(RxBypass::STAGE));
        assert!(!options.bypasses_rx(RxBypass::PARSE));
    }
}
