//! PDO assignment and mapping of the slaves, as the master knows them.

use ecrt_sys::{Errno, ec_pdo_entry_info_t, ec_pdo_info_t, ec_sync_info_t};

use super::{Answer, Master};

/// A PDO that a sync manager has assigned.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AssignedPdo {
    /// Its mapping object.
    pub index: u16,
    /// Mapped objects.
    pub entries: Vec<PdoEntry>,
}

/// An object that a PDO maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PdoEntry {
    /// Object index.
    pub index: u16,
    /// Object subindex.
    pub subindex: u8,
    /// Length in bits.
    pub bits: u8,
}

impl Master {
    /// PDOs that a sync manager had assigned when the master scanned the slave, or was given by a
    /// configuration since; empty for a sync manager that the slave does not have. May block.
    pub(crate) fn assigned_pdos(&self, position: u16, sync: u8) -> Result<Vec<AssignedPdo>, Errno> {
        // The library writes to stderr when it is asked for what does not exist.
        if sync >= self.slave_info(position)?.sync_count {
            return Ok(Vec::new());
        }
        let (functions, master) = (self.ecrt.functions(), self.raw.as_ptr());
        let mut found = Answer::<ec_sync_info_t>::new();
        // SAFETY: the master is valid as long as `self`, and the target is writable.
        let status =
            unsafe { (functions.master_get_sync_manager)(master, position, sync, found.target()) };
        Errno::check(status)?;
        let pdo = |at| {
            let mut found = Answer::<ec_pdo_info_t>::new();
            // SAFETY: as above.
            let status =
                unsafe { (functions.master_get_pdo)(master, position, sync, at, found.target()) };
            Errno::check(status)?;
            let entry = |entry| {
                let mut found = Answer::<ec_pdo_entry_info_t>::new();
                // SAFETY: as above.
                let status = unsafe {
                    (functions.master_get_pdo_entry)(
                        master,
                        position,
                        sync,
                        at,
                        entry,
                        found.target(),
                    )
                };
                Errno::check(status)?;
                let ec_pdo_entry_info_t { index, subindex, bit_length } = found.value;
                Ok(PdoEntry { index, subindex, bits: bit_length })
            };
            let count = u16::try_from(found.value.n_entries).unwrap_or(u16::MAX);
            let entries = (0..count).map(entry).collect::<Result<_, Errno>>()?;
            Ok(AssignedPdo { index: found.value.index, entries })
        };
        (0..u16::try_from(found.value.n_pdos).unwrap_or(u16::MAX)).map(pdo).collect()
    }
}
