//! PDO chunks of a slave: reading what it really maps, and registering it with the master.

use ecan_protocol::mapping::{
    Direction, UNIT_BYTES, UNITS_PER_CHUNK, data_object_index, map_subindex, pdo_map_index,
    sync_manager,
};

use super::diagnostics::Diagnostics;
use crate::error::Error;
use crate::master::{DomainId, Master, PdoEntry, SlaveConfigId, SyncDirection, WatchdogMode};

const UNIT_BITS: u8 = (UNIT_BYTES * 8) as u8;

/// One mapped 16-byte object, with the subindex that the slave has for it: the manual leaves it
/// open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Unit {
    pdo: u16,
    index: u16,
    subindex: u8,
}

/// Mapping of the first `multiplier` chunks, checked against manual 5.1.1: as the master read it
/// when it scanned the bus, by SDO for chunks that were not assigned then.
pub(crate) fn read_mapping(
    diagnostics: &Diagnostics,
    slave: usize,
    direction: Direction,
    multiplier: u8,
) -> Result<Vec<Unit>, Error> {
    let assigned = diagnostics.assigned_pdos(slave, sync_manager(direction))?;
    let mut units = Vec::with_capacity(usize::from(multiplier) * UNITS_PER_CHUNK);
    for chunk in 0..multiplier {
        let pdo = pdo_map_index(direction, chunk);
        let known = assigned.iter().find(|assigned| assigned.index == pdo);
        let known = known.and_then(|known| units_of(slave, direction, chunk, &known.entries).ok());
        let of_chunk = match known {
            Some(of_chunk) => of_chunk,
            None => {
                let entries = upload_entries(diagnostics, slave, direction, chunk)?;
                units_of(slave, direction, chunk, &entries)?
            }
        };
        units.extend(of_chunk);
    }
    Ok(units)
}

/// The entries of a chunk by the first of them: the others have the next object each (manual 5.1.1),
/// and are taken to have the same subindex and length.
fn upload_entries(
    diagnostics: &Diagnostics,
    slave: usize,
    direction: Direction,
    chunk: u8,
) -> Result<Vec<PdoEntry>, Error> {
    let pdo = pdo_map_index(direction, chunk);
    let found = diagnostics.sdo_upload_u32(slave, pdo, 0)?;
    if found != UNITS_PER_CHUNK as u32 {
        return Err(Error::MappingCount { slave, pdo, found });
    }
    let [high, low, subindex, bits] =
        diagnostics.sdo_upload_u32(slave, pdo, map_subindex(0))?.to_be_bytes();
    let first = u16::from_be_bytes([high, low]);
    let of_first = data_object_index(direction, chunk, 0);
    let entry = |unit| {
        let index = data_object_index(direction, chunk, unit);
        PdoEntry { index: index.wrapping_sub(of_first).wrapping_add(first), subindex, bits }
    };
    Ok((0..UNITS_PER_CHUNK as u8).map(entry).collect())
}

fn units_of(
    slave: usize,
    direction: Direction,
    chunk: u8,
    entries: &[PdoEntry],
) -> Result<Vec<Unit>, Error> {
    let pdo = pdo_map_index(direction, chunk);
    if entries.len() != UNITS_PER_CHUNK {
        return Err(Error::MappingCount { slave, pdo, found: entries.len() as u32 });
    }
    let unit = |(unit, entry): (u8, &PdoEntry)| {
        let expected_index = data_object_index(direction, chunk, unit);
        if (entry.index, entry.bits) == (expected_index, UNIT_BITS) {
            return Ok(Unit { pdo, index: entry.index, subindex: entry.subindex });
        }
        Err(Error::Mapping {
            slave,
            pdo,
            entry: map_subindex(unit),
            found_index: entry.index,
            found_bits: entry.bits,
            expected_index,
        })
    };
    (0..).zip(entries).map(unit).collect()
}

/// Gives the master a direction's sync manager with its assignment and mapping.
pub(crate) fn configure(
    master: &mut Master,
    slave: usize,
    config: SlaveConfigId,
    direction: Direction,
    units: &[Unit],
) -> Result<(), Error> {
    let sm = sync_manager(direction);
    let (sync_direction, watchdog) = match direction {
        Direction::RxPdo => (SyncDirection::Output, WatchdogMode::Enable),
        Direction::TxPdo => (SyncDirection::Input, WatchdogMode::Disable),
    };
    let fail = |call| move |errno| Error::library(call, Some(slave), errno);
    master
        .config_sync_manager(config, sm, sync_direction, watchdog)
        .map_err(fail("ecrt_slave_config_sync_manager"))?;
    master
        .config_pdo_assign_clear(config, sm)
        .map_err(fail("ecrt_slave_config_pdo_assign_clear"))?;
    for chunk in units.chunk_by(|a, b| a.pdo == b.pdo) {
        let Some(first) = chunk.first() else { continue };
        master
            .config_pdo_assign_add(config, sm, first.pdo)
            .map_err(fail("ecrt_slave_config_pdo_assign_add"))?;
        master
            .config_pdo_mapping_clear(config, first.pdo)
            .map_err(fail("ecrt_slave_config_pdo_mapping_clear"))?;
        for unit in chunk {
            master
                .config_pdo_mapping_add(config, unit.pdo, unit.index, unit.subindex, UNIT_BITS)
                .map_err(fail("ecrt_slave_config_pdo_mapping_add"))?;
        }
    }
    Ok(())
}

/// Registers every unit in the domain and gives the offset of the continuous buffer.
pub(crate) fn register(
    master: &mut Master,
    slave: usize,
    config: SlaveConfigId,
    domain: DomainId,
    units: &[Unit],
) -> Result<usize, Error> {
    let mut start = None;
    for (nth, unit) in units.iter().enumerate() {
        let found = master
            .config_reg_pdo_entry(config, unit.index, unit.subindex, domain)
            .map_err(|e| Error::library("ecrt_slave_config_reg_pdo_entry", Some(slave), e))?;
        let base = *start.get_or_insert(found);
        let expected = base + nth * UNIT_BYTES;
        if found != expected {
            return Err(Error::Layout { slave, index: unit.index, found, expected });
        }
    }
    Ok(start.unwrap_or(0))
}
