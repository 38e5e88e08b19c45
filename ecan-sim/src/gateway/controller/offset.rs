//! Register offsets of the Bosch M_CAN core.

pub(super) const ENDIAN: u16 = 0x004;
pub(super) const DBTP: u16 = 0x00C;
pub(super) const TEST: u16 = 0x010;
pub(super) const RWD: u16 = 0x014;
pub(super) const CCCR: u16 = 0x018;
pub(super) const NBTP: u16 = 0x01C;
pub(super) const ECR: u16 = 0x040;
pub(super) const PSR: u16 = 0x044;
pub(super) const TDCR: u16 = 0x048;
pub(super) const IR: u16 = 0x050;
pub(super) const IE: u16 = 0x054;
pub(super) const ILS: u16 = 0x058;
pub(super) const ILE: u16 = 0x05C;
pub(super) const GFC: u16 = 0x080;
pub(super) const XIDAM: u16 = 0x090;
pub(super) const HPMS: u16 = 0x094;
pub(super) const RXF0S: u16 = 0x0A4;
pub(super) const RXF0A: u16 = 0x0A8;
pub(super) const RXF1S: u16 = 0x0B4;
pub(super) const RXF1A: u16 = 0x0B8;
pub(super) const TXFQS: u16 = 0x0C4;
pub(super) const TXBCR: u16 = 0x0D4;
pub(super) const TXEFS: u16 = 0x0F4;
pub(super) const TXEFA: u16 = 0x0F8;
