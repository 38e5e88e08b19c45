//! Settings of the CANopen network of a file.

use std::time::Duration;

use ecan_canopen::{
    HostHeartbeat, NodeDescription, NodeId, Step, TimeConfig, TimeReference, object,
};
use ecan_cia402::{Cia402Config, Takeover};

use super::document::{Table, store};
use super::fault::Located;

/// Settings of the CANopen network of a configuration.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NetworkSettings {
    /// Network, SYNC and takeover, for `Cia402::new`; without axes `network` is for `Network::new`,
    /// and `sync` for `Network::set_sync`.
    pub cia402: Cia402Config,
    /// Time between two TIME messages; `None` sends none.
    pub time_period: Option<Duration>,
}

impl NetworkSettings {
    /// TIME by the system clock, for `Network::set_time` at the time `bus_ns` of the bus clock. Makes a
    /// system call: call it outside the cycle.
    pub fn time(&self, bus_ns: u64) -> Option<TimeConfig> {
        let reference = || TimeReference::from_system_clock(bus_ns);
        self.time_period.map(|period| TimeConfig { period, reference: reference() })
    }

    /// The node with the SYNC counter of the network (0x1019), if it has one.
    pub(crate) fn complete(&self, mut node: NodeDescription) -> NodeDescription {
        let sync = self.cia402.sync;
        if sync.counter_overflow.is_some() {
            // The counter can change only while SYNC has no period.
            let stop = Step::write(object::COMMUNICATION_CYCLE, 0, 0_u32).named("no SYNC period");
            node.boot.steps.extend([stop.if_accepted(), sync.counter_step()]);
        }
        node
    }
}

const TAKEOVERS: [(&str, Takeover); 2] = [("stop", Takeover::Stop), ("adopt", Takeover::Adopt)];

/// The settings while the file is read.
#[derive(Debug, Default)]
pub(crate) struct NetworkTable {
    pub(crate) settings: NetworkSettings,
    /// Keys that the master of a `bus.yml` does not change.
    has_sync: bool,
    has_counter: bool,
    has_host: bool,
    has_host_heartbeat: bool,
}

impl NetworkTable {
    pub(crate) fn read(mut table: Table<'_, '_>) -> Self {
        let mut settings = NetworkSettings::default();
        let config = &mut settings.cia402;
        store(&mut config.sync.every_cycles, table.unsigned("sync_cycles", (1, 0xFFFF)));
        let counter: Option<u8> = table.unsigned("sync_counter", (0, 240));
        if counter == Some(1) {
            table.fault("sync_counter", COUNTER);
        }
        config.sync.counter_overflow = counter.filter(|counter| *counter > 1);
        store(&mut config.motion_div, table.unsigned("target_cycles", (1, 0xFFFF)));
        store(&mut config.takeover, table.word("takeover", &TAKEOVERS));
        let time_ms = table.unsigned("time_ms", (0, 3_600_000)).filter(|ms| *ms > 0);
        settings.time_period = time_ms.map(Duration::from_millis);
        let host = table.unsigned("host_node", (1, 127)).and_then(NodeId::from_raw);
        let heartbeat_ms: Option<u64> = table.unsigned("host_heartbeat_ms", (0, 0xFFFF));
        let network = &mut config.network;
        network.host_heartbeat = host_heartbeat(network.host_heartbeat, host, heartbeat_ms);
        store(
            &mut network.service_frames_per_cycle,
            table.unsigned("service_frames_per_cycle", (1, 8)),
        );
        store(&mut network.sdo_pending_limit, table.unsigned("sdo_pending_limit", (1, 7)));
        store(&mut network.reserved_image_bytes, table.unsigned("reserved_image_bytes", (0, 3072)));
        store(&mut network.nmt_queue, table.unsigned("nmt_queue", (1, 1024)));
        let sdo = &mut config.node.sdo;
        let mut time = |key| table.unsigned(key, (1, 3_600_000)).map(Duration::from_millis);
        store(&mut sdo.timeout, time("sdo_timeout_ms"));
        store(&mut sdo.storage_timeout, time("sdo_storage_timeout_ms"));
        store(&mut sdo.retries, table.unsigned("sdo_retries", (0, 255)));
        store(&mut sdo.buffer_bytes, table.unsigned("sdo_buffer_bytes", (8, 1 << 24)));
        Self {
            has_sync: table.has("sync_cycles"),
            has_counter: table.has("sync_counter"),
            has_host: table.has("host_node"),
            has_host_heartbeat: table.has("host_heartbeat_ms"),
            settings,
        }
    }

    /// Takes over the values of the master of a bus that the table does not have. `cycle_ns` is the
    /// cycle, if it is known.
    pub(crate) fn add_master(
        &mut self,
        master: &MasterSource,
        cycle_ns: Option<u32>,
        report: &mut dyn FnMut(usize, String),
    ) {
        let config = &mut self.settings.cia402;
        let period =
            master.sync_period_us.as_ref().filter(|period| period.value > 0 && !self.has_sync);
        if let (Some(period), Some(cycle_ns)) = (period, cycle_ns.filter(|cycle_ns| *cycle_ns > 0))
        {
            let period_ns = u64::from(period.value) * 1_000;
            match period_ns % u64::from(cycle_ns) {
                0 => {
                    let cycles = u32::try_from(period_ns / u64::from(cycle_ns)).unwrap_or(u32::MAX);
                    config.sync.every_cycles = cycles;
                    // Another bus must have the same.
                    self.has_sync = true;
                }
                _ => report(
                    period.at,
                    format!(
                        "`sync_period` = {} must be a multiple of the cycle, {} us; change the cycle, or \
                         set `sync_cycles` in [network]",
                        period.value,
                        cycle_ns / 1_000
                    ),
                ),
            }
        }
        if let Some(overflow) = master.sync_overflow.as_ref().filter(|_| !self.has_counter) {
            if overflow.value == 1 {
                report(overflow.at, COUNTER.replace("sync_counter", "sync_overflow"));
            }
            config.sync.counter_overflow = Some(overflow.value).filter(|overflow| *overflow > 1);
            self.has_counter = true;
        }
        let host = master.node.filter(|_| !self.has_host);
        let ms = master.heartbeat_ms.filter(|ms| *ms > 0 && !self.has_host_heartbeat);
        self.has_host |= host.is_some();
        self.has_host_heartbeat |= ms.is_some();
        let network = &mut config.network;
        network.host_heartbeat = host_heartbeat(network.host_heartbeat, host, ms.map(u64::from));
    }
}

const COUNTER: &str = "`sync_counter` = 1 is out of range; allowed: 0 for none, 2 to 240";

/// The heartbeat with another node-ID or period; 0 is none.
fn host_heartbeat(
    before: Option<HostHeartbeat>,
    node: Option<NodeId>,
    period_ms: Option<u64>,
) -> Option<HostHeartbeat> {
    let before = before?;
    let period = period_ms.map_or(before.period, Duration::from_millis);
    let heartbeat = HostHeartbeat { node: node.unwrap_or(before.node), period };
    (!period.is_zero()).then_some(heartbeat)
}

/// Values of the master of a bus.
#[derive(Clone, Debug, Default)]
pub(crate) struct MasterSource {
    pub(crate) node: Option<NodeId>,
    pub(crate) sync_period_us: Option<Located<u32>>,
    pub(crate) sync_overflow: Option<Located<u8>>,
    pub(crate) heartbeat_ms: Option<u16>,
    /// Consumer heartbeat time of nodes that watch it, in periods.
    pub(crate) heartbeat_multiplier: Option<f64>,
}
