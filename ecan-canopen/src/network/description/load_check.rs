//! Check of the bus load of each channel.

use ecan_mcan_port::{ChannelLoad, FrameRate, FrameStream};
use ecan_protocol::can::{CanFrame, CanId};

use super::network_description::{ChannelDescription, NetworkDescription};
use super::network_fault::{NetworkFault, NetworkFaultKind};
use crate::network::pdo_mapping::{PdoDirection, PdoMapping};
use crate::{CobId, TransmissionType};

pub(super) fn check(network: &NetworkDescription, faults: &mut Vec<NetworkFault>) {
    for channel in &network.channels {
        let streams = network.streams(channel);
        let load = ChannelLoad::of(&streams, &channel.can, network.cycle_ns);
        if load.most > 1.0 {
            let ChannelDescription { slave, channel, .. } = *channel;
            let kind = NetworkFaultKind::Load { slave, channel, share: load.most };
            faults.push(NetworkFault { nodes: Vec::new(), kind });
        }
    }
}

impl NetworkDescription {
    /// The periodic frames of a channel: SYNC, described PDOs, heartbeats. An event-driven PDO counts
    /// with its event timer, or with its inhibit time if it has no event timer.
    pub fn streams(&self, channel: &ChannelDescription) -> Vec<FrameStream> {
        let ChannelDescription { slave, channel, .. } = *channel;
        let per_sync = self.sync.map_or(1, |sync| sync.every_cycles.max(1));
        let to_bus = |frame, rate| FrameStream::to_bus(slave, channel, frame, rate);
        let from_bus = |frame, rate| FrameStream::from_bus(slave, channel, frame, rate);
        let mut streams = Vec::new();
        if let Some(sync) = &self.sync {
            let length = usize::from(sync.counter_overflow.is_some());
            let rate = FrameRate::EveryCycles(per_sync);
            streams.extend(frame(CobId::SYNC.can_id(), length).map(|it| to_bus(it, rate)));
        }
        if let Some(host) = &self.host_heartbeat {
            let rate = FrameRate::PerSecond(1.0 / host.period.as_secs_f64().max(1e-3));
            let id = CobId::heartbeat(host.node).can_id();
            streams.extend(frame(id, 1).map(|it| to_bus(it, rate)));
        }
        let here = self
            .nodes
            .iter()
            .filter(|it| (it.address.slave, it.address.channel) == (slave, channel));
        for node in here {
            let life_sign_ms = match node.boot.guarding {
                Some(guarding) => guarding.guard_time.as_secs_f64() * 1e3,
                None => node.boot.heartbeat_ms.into(),
            };
            if life_sign_ms > 0.0 {
                let rate = FrameRate::PerSecond(1e3 / life_sign_ms);
                let id = CobId::heartbeat(node.address.node).can_id();
                streams.extend(frame(id, 1).map(|it| from_bus(it, rate)));
            }
            for pdo in &node.pdos {
                let Some(frame) = frame(pdo.cob_id, pdo.length()) else { continue };
                let Some(rate) = rate(pdo, per_sync) else { continue };
                streams.push(match pdo.direction {
                    PdoDirection::Receive => to_bus(frame, rate),
                    PdoDirection::Transmit => from_bus(frame, rate),
                });
            }
        }
        streams
    }
}

/// Rate of a PDO; `None` if only events of the device decide it.
fn rate(pdo: &PdoMapping, cycles_per_sync: u32) -> Option<FrameRate> {
    match pdo.transmission {
        TransmissionType::Synchronous(nth) => {
            Some(FrameRate::EveryCycles(cycles_per_sync.saturating_mul(u32::from(nth.max(1)))))
        }
        TransmissionType::SynchronousAcyclic => Some(FrameRate::EveryCycles(cycles_per_sync)),
        _ => match (pdo.event_timer_ms, pdo.inhibit_time) {
            (Some(ms @ 1..), _) => Some(FrameRate::PerSecond(1e3 / f64::from(ms))),
            (_, Some(time @ 1..)) => Some(FrameRate::PerSecond(1e4 / f64::from(time))),
            _ => None,
        },
    }
}

/// A frame of zeros; none beyond eight bytes, which `pdo_check` reports.
fn frame(id: CanId, length: usize) -> Option<CanFrame> {
    CanFrame::classic(id, [0; 8].get(..length)?).ok()
}
