/// Counters of a bus up to an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BusStatistics {
    /// The instant, simulated ns.
    pub at_ns: u64,
    /// Frames acknowledged or looped back over the bus.
    pub frames: u64,
    /// Transmissions that ended in an error frame.
    pub error_frames: u64,
    /// Starts at which two stations had the same arbitration field. On a real bus different data
    /// then cause bit errors; here the station with the lower number is first.
    pub identifier_collisions: u64,
    /// Time occupied by frames and error frames, each with its intermission.
    pub busy_ns: u64,
}

impl BusStatistics {
    /// Share of the time since an earlier snapshot in which the bus was busy, 0 to 1.
    ///
    /// A bus without pauses has load 1, since the intermission counts as busy.
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
    /// Frames sent successfully.
    pub transmitted: u64,
    /// Frames received, including looped-back ones.
    pub received: u64,
    /// Own transmissions that failed.
    pub transmit_errors: u64,
    /// Frames of others that failed.
    pub receive_errors: u64,
    /// Errors that raised an error counter.
    pub counted_errors: u64,
    /// Starts at which another station won arbitration.
    pub arbitrations_lost: u64,
    /// Number of bus-off events.
    pub bus_offs: u64,
}
