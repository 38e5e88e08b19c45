//! PDO profiles

use std::ffi::c_int;

use ecan_protocol::image::{
    BudgetPolicy, EncapsulationProfile, OptionFlags, PdoProfile, ProfileError,
};
use ecan_protocol::mapping::Direction;

use crate::result::ecan_result_t;
use crate::{Call, ToResult};

/// Direction of an image, as the slave sees it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_mcan_direction_t {
    /// Master to slave.
    IGH_MCAN_RXPDO = 0,
    /// Slave to master.
    IGH_MCAN_TXPDO = 1,
}

/// Encapsulation profile: the format of the packets (manual 9).
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_mcan_encapsulation_t {
    /// Data length by DLC, no timestamp. The device default.
    IGH_MCAN_ENCAPSULATION_COMPACT = 0,
    /// Data length by DLC, timestamps allowed.
    IGH_MCAN_ENCAPSULATION_COMPACT_TIMESTAMPED = 1,
    /// 64-byte data windows allowed, no timestamp.
    IGH_MCAN_ENCAPSULATION_WINDOW64 = 4,
    /// 64-byte data windows and timestamps allowed.
    IGH_MCAN_ENCAPSULATION_WINDOW64_TIMESTAMPED = 5,
}

/// Budget policy: how channels share an image (manual 12).
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_mcan_budget_t {
    /// A small reserve for each channel, the rest shared. The device default.
    IGH_MCAN_BUDGET_BALANCED = 0,
    /// No reserve, everything shared.
    IGH_MCAN_BUDGET_SHARED_ONLY = 1,
    /// Equal parts for each enabled channel, without borrowing.
    IGH_MCAN_BUDGET_DETERMINISTIC = 2,
}

/// Option: the gateway reports the result of each transmission (manual 9.1, 10). TxPDO only.
pub const IGH_MCAN_OPTION_TX_RESULT: u8 = 0x01;
/// Option: packets are padded to 4 bytes.
pub const IGH_MCAN_OPTION_ALIGN4: u8 = 0x02;
/// Option: no CRC. For performance tests.
pub const IGH_MCAN_OPTION_NO_CRC16: u8 = 0x04;
/// Option: the CAN side is disconnected. For tests.
pub const IGH_MCAN_OPTION_APP_BYPASS: u8 = 0x08;
/// Option: bytes after the payload keep their old content.
pub const IGH_MCAN_OPTION_PAYLOAD_ONLY: u8 = 0x10;

/// The PDO profile of one direction, 0x8010:03..07 or 0x8011:03..07 (manual 13.2).
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct igh_mcan_pdo_profile_t {
    /// An igh_mcan_direction_t.
    pub direction: u8,
    /// PDO size multiplier N, 1 to 24: the image has 128 times as many bytes.
    pub multiplier: u8,
    /// Enabled channels, bit 0 for channel 0.
    pub channel_mask: u8,
    /// An igh_mcan_encapsulation_t.
    pub encapsulation: u8,
    /// An igh_mcan_budget_t.
    pub budget: u8,
    /// IGH_MCAN_OPTION_ values.
    pub options: u8,
    /// Must be 0; for fields of later versions.
    pub reserved: [u8; 10],
}

impl ToResult for ProfileError {
    fn result(&self) -> ecan_result_t {
        ecan_result_t::ECAN_ERR_CONFIG
    }
}

/// Encapsulation profile of a number, or `ECAN_ERR_ARGUMENT`.
pub fn encapsulation(call: Call, raw: c_int) -> Result<EncapsulationProfile, ecan_result_t> {
    let profile = u8::try_from(raw).ok().and_then(EncapsulationProfile::from_raw);
    profile.ok_or_else(|| {
        call.argument("encapsulation", format_args!("{raw} is invalid; allowed: 0, 1, 4, 5"))
    })
}

/// Budget policy of a number, or `ECAN_ERR_ARGUMENT`.
pub fn budget(call: Call, raw: c_int) -> Result<BudgetPolicy, ecan_result_t> {
    let policy = u8::try_from(raw).ok().and_then(BudgetPolicy::from_raw);
    policy.ok_or_else(|| {
        call.argument("budget", format_args!("{raw} is out of range; allowed: 0 to 2"))
    })
}

/// Options of their bits, or `ECAN_ERR_ARGUMENT`.
pub fn options(call: Call, bits: u8) -> Result<OptionFlags, ecan_result_t> {
    OptionFlags::from_bits(bits)
        .ok_or_else(|| call.argument("options", format_args!("0x{bits:02X} has reserved bits")))
}

impl igh_mcan_pdo_profile_t {
    /// Profile that C describes, or the first fault.
    pub fn checked(&self, call: Call) -> Result<(Direction, PdoProfile), ecan_result_t> {
        call.reserved("profile", &self.reserved)?;
        let direction = match self.direction {
            0 => Direction::RxPdo,
            1 => Direction::TxPdo,
            other => {
                return Err(
                    call.argument("direction", format_args!("{other} is invalid; allowed: 0, 1"))
                );
            }
        };
        let profile = PdoProfile {
            multiplier: self.multiplier,
            channel_mask: self.channel_mask,
            profile: encapsulation(call, self.encapsulation.into())?,
            budget: budget(call, self.budget.into())?,
            options: options(call, self.options)?,
        };
        profile.check(direction).map_err(|error| call.error(&error))?;
        Ok((direction, profile))
    }

    /// Converts a profile for C.
    pub fn new(direction: Direction, profile: &PdoProfile) -> Self {
        Self {
            direction: u8::from(direction == Direction::TxPdo),
            multiplier: profile.multiplier,
            channel_mask: profile.channel_mask,
            encapsulation: profile.profile.raw(),
            budget: profile.budget.raw(),
            options: profile.options.bits(),
            reserved: [0; 10],
        }
    }
}
