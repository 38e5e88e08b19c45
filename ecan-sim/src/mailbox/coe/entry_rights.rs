//! Access field of SDO information: permitted access by state, PDO mapping, and whether the entry
//! is a device setting (ETG.1000.6).

use ecan_protocol::object::{Access, Entry, Object, object};

pub(super) mod rights {
    /// Readable in PREOP, SAFEOP and OP.
    pub(in crate::mailbox::coe) const READ: u16 = 0x0007;
    pub(in crate::mailbox::coe) const WRITE_PREOP: u16 = 0x0008;
    pub(in crate::mailbox::coe) const WRITE_SAFEOP: u16 = 0x0010;
    /// Writable in PREOP, SAFEOP and OP.
    pub(in crate::mailbox::coe) const WRITE: u16 = 0x0038;
    pub(in crate::mailbox::coe) const RX_MAPPABLE: u16 = 0x0040;
    pub(in crate::mailbox::coe) const TX_MAPPABLE: u16 = 0x0080;
    pub(in crate::mailbox::coe) const BACKUP: u16 = 0x0100;
    /// A startup parameter.
    pub(in crate::mailbox::coe) const SETTING: u16 = 0x0200;
}

pub(super) fn entry_rights(index: u16, entry: &Entry) -> u16 {
    let mut field = 0;
    if entry.access.can_read() {
        field |= rights::READ;
    }
    if entry.access.can_write() {
        field |= match index {
            // assignments are writable in PREOP and SAFEOP
            0x1C12 | 0x1C13 => rights::WRITE_PREOP | rights::WRITE_SAFEOP,
            // the sync manager owns the memory while process data is exchanged
            0x7000..=0x7FFF => rights::WRITE_PREOP,
            _ => rights::WRITE,
        };
    }
    if entry.subindex == ecan_protocol::object::MAPPED_SUBINDEX {
        field |= match index {
            0x6000..=0x6FFF => rights::TX_MAPPABLE,
            0x7000..=0x7FFF => rights::RX_MAPPABLE,
            _ => 0,
        };
    }
    match index {
        0x1C12 | 0x1C13 => field |= rights::SETTING,
        _ if is_saved(index) && entry.access == Access::Rw && !is_command(entry) => {
            field |= rights::BACKUP | rights::SETTING;
        }
        _ => {}
    }
    field
}

pub(super) fn object_rights(index: u16, object: &Object) -> u16 {
    object.entries.iter().fold(0, |field, entry| field | entry_rights(index, entry))
}

fn is_saved(index: u16) -> bool {
    object(index).is_some_and(|object| object.is_saved)
}

fn is_command(entry: &Entry) -> bool {
    entry.name.ends_with("ommand") || entry.meaning(0) == Some("no-op")
}
