//! Stations of a bus by the CAN IDs that they read.

use ecan_protocol::can::CanId;

use crate::bus::StationSet;
use crate::drive::StandardIds;

/// The stations that may read a frame, by its CAN ID. A station reads all frames until
/// [`filter`](Self::filter) is called for it.
#[derive(Clone, Debug, Default)]
pub(super) struct Listeners {
    all: StationSet,
    /// By standard CAN ID.
    standard: Vec<StationSet>,
    /// What each station reads.
    filters: Vec<StandardIds>,
}

impl Listeners {
    pub(super) fn add(&mut self, station: usize) {
        let ids = StandardIds::all();
        self.standard.resize_with(ids.iter().count(), StationSet::default);
        self.all.insert(station);
        self.standard.iter_mut().for_each(|stations| stations.insert(station));
        self.filters.push(ids);
    }

    /// Sets the standard CAN IDs that a station reads. Frames with extended ones reach all stations.
    pub(super) fn filter(&mut self, station: usize, ids: &StandardIds) {
        let Some(filter) = self.filters.get_mut(station) else { return };
        let before = std::mem::replace(filter, *ids);
        for raw in before.differences(ids) {
            let Some(stations) = self.standard.get_mut(raw) else { continue };
            if ids.contains(raw) {
                stations.insert(station);
            } else {
                stations.remove(station);
            }
        }
    }

    pub(super) fn of(&self, id: CanId) -> &StationSet {
        match self.standard.get(id.raw() as usize) {
            Some(stations) if !id.is_extended() => stations,
            _ => &self.all,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filtered_station_gets_its_standard_and_all_extended_ids() {
        let mut listeners = Listeners::default();
        (0..3).for_each(|station| listeners.add(station));
        let mut ids = StandardIds::default();
        ids.insert(0x80);
        listeners.filter(1, &ids);
        let of = |id| listeners.of(id).iter().collect::<Vec<_>>();
        assert_eq!(of(CanId::standard(0x80).unwrap()), [0, 1, 2]);
        assert_eq!(of(CanId::standard(0x7FF).unwrap()), [0, 2]);
        assert_eq!(of(CanId::extended(0x81).unwrap()), [0, 1, 2]);
    }
}
