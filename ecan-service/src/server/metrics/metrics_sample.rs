//! Everything that one response to a scrape contains.

use std::collections::BTreeMap;

use ecan_host::AdapterConfig;

use super::cycle_sample::CycleSample;
use crate::protocol::{BusState, Hello, ServiceStats};

/// Values by slave, channel, index of channel 0 and subindex.
pub(crate) type ObjectValues = BTreeMap<(usize, u8, u16, u8), u32>;

#[derive(Debug)]
pub(crate) struct MetricsSample {
    pub(crate) hello: Hello,
    /// Without the list of clients.
    pub(crate) stats: ServiceStats,
    /// Connected clients.
    pub(crate) clients: usize,
    /// `None` without a cycle.
    pub(crate) cycle: Option<CycleSample>,
    /// `None` if the master did not answer.
    pub(crate) bus: Option<BusState>,
    /// Configuration of the slaves of the cycle.
    pub(crate) adapter: Option<AdapterConfig>,
    /// Objects of the gateways that were read.
    pub(crate) objects: ObjectValues,
}
