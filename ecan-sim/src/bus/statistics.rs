//! Counters of the bus and of its stations.

/// Counters of a bus up to an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BusStatistics {
    /// The instant, in nanoseconds of the simulation.
    pub at_ns: u64,
    /// Frames that were acknowledged or looped back by way of the bus.
    pub frames: u64,
    /// Transmissions that ended in an error frame.
    pub error_frames: u64,
    /// Starts at which two stations had the very same arbitration field. A real bus answers
    /// different data under one identifier with bit errors; here the station with the lower
    /// number goes first.
    pub identifier_collisions: u64,
    /// Time taken by frames and error frames, each with the intermission behind it.
    pub busy_ns: u64,
}

impl BusStatistics {
    /// Share of the time since an earlier snapshot in which the bus was busy, 0 to 1.
    ///
    /// A bus that never waits has load 1, since the intermission counts as busy.
    #[must_use]
    pub fn load_since(&self, earlier: &Self) -> f64 {
        let span = self.at_ns.saturating_sub(earlier.at_ns);
        if span == 0 {
            return 0.0;
        }
        self.busy_ns.saturating_sub(earlier.busy_ns) as f64 / span as f64
    }
}

/// Counters of one station.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StationStatistics {
    /// Frames sent with success.
    pub transmitted: u64,
    /// Frames received, its own looped-back ones included.
    pub received: u64,
    /// Own transmissions that ended in an error.
    pub transmit_errors: u64,
    /// Frames of others that the station saw fail.
    pub receive_errors: u64,
    /// Starts at which another station had the higher priority.
    pub arbitrations_lost: u64,
    /// How often the station went bus-off.
    pub bus_offs: u64,
}
