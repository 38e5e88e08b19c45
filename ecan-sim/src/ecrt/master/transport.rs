//! Send queue: frames, losses, and blocking by an oversized datagram.

use super::MasterModel;
use crate::ecrt::datagram::{DatagramState, Queued};
use crate::ecrt::timing::{BYTE_NS, DATAGRAM_TIMEOUT_NS, HOST_LATENCY_NS, SLAVE_LATENCY_NS};
use crate::fault::{CycleFaults, LossDirection};
use crate::world::{LogicalCommand, World};

/// Payload of an Ethernet frame.
const FRAME_BYTES: usize = 1500;
const FRAME_HEADER_BYTES: usize = 2;
/// Header and working counter of a datagram.
const DATAGRAM_OVERHEAD: usize = 12;
/// Data of a datagram that sets or carries the reference clock.
const CLOCK_BYTES: usize = 4;

/// Time from the send to the arrival in the slaves: half of the host's latency belongs to the return.
fn outward_ns(delay_ns: u64) -> u64 {
    delay_ns.saturating_sub(HOST_LATENCY_NS / 2)
}

impl MasterModel {
    /// Queues a datagram; a queued one keeps its position and is sent once.
    pub(crate) fn enqueue(&mut self, item: Queued) {
        if !self.queue.contains(&item) {
            self.queue.push(item);
        }
        if let Some(state) = self.datagram_state(item) {
            *state = DatagramState::Queued;
        }
    }

    fn datagram_state(&mut self, item: Queued) -> Option<&mut DatagramState> {
        Some(match item {
            Queued::Domain { domain, datagram } => {
                &mut self.domains.get_mut(domain)?.datagrams.get_mut(datagram)?.state
            }
            Queued::ReferenceClock => &mut self.clocks.reference,
            Queued::SlaveClocks => &mut self.clocks.slaves,
            Queued::ClockMonitor => &mut self.clocks.monitor,
        })
    }

    fn pending_bytes(&mut self, item: Queued) -> Option<usize> {
        if *self.datagram_state(item)? != DatagramState::Queued {
            return None;
        }
        Some(match item {
            Queued::Domain { domain, datagram } => {
                self.domains.get(domain)?.datagrams.get(datagram)?.wire.len()
            }
            _ => CLOCK_BYTES,
        })
    }

    /// Sends the queue in frames. A datagram larger than a frame blocks all datagrams after it, now
    /// and at each later send. Without a link nothing is sent.
    pub(crate) fn send(&mut self, world: &mut World) {
        self.sends = self.sends.wrapping_add(1);
        self.blocked = false;
        if !world.link_is_up() {
            while let Some(item) = self.queue.pop() {
                if let Some(state) = self.datagram_state(item) {
                    *state = DatagramState::Lost;
                }
            }
            return;
        }
        let queue = std::mem::take(&mut self.queue);
        let carries_process_data = queue.iter().any(|item| {
            matches!(item, Queued::Domain { .. }) && self.pending_bytes(*item).is_some()
        });
        let faults = match carries_process_data {
            true => world.begin_cycle(),
            false => world.fault_schedule().faults_between_cycles(),
        };
        let passed = world.reached().count();
        let mut delay_ns = HOST_LATENCY_NS + passed as u64 * SLAVE_LATENCY_NS;
        let mut frame = FRAME_HEADER_BYTES;
        for &item in &queue {
            let Some(bytes) = self.pending_bytes(item) else { continue };
            let bytes = bytes + DATAGRAM_OVERHEAD;
            if frame + bytes > FRAME_BYTES {
                frame = FRAME_HEADER_BYTES;
            }
            if frame + bytes > FRAME_BYTES && !self.carries_large_pdos {
                self.blocked = true;
                break;
            }
            frame += bytes;
            delay_ns += bytes as u64 * BYTE_NS;
            self.transmit(item, world, faults, delay_ns);
        }
        self.queue = queue;
    }

    fn transmit(&mut self, item: Queued, world: &mut World, faults: CycleFaults, delay_ns: u64) {
        let at_ns = world.now_ns();
        let arrives_ns = faults.lost.is_none().then_some(at_ns + delay_ns);
        let Queued::Domain { domain, datagram } = item else {
            self.exchange_clock(item, world, faults.lost);
            let arrives_ns = arrives_ns.filter(|_| self.reference_clock().is_some());
            if let Some(state) = self.datagram_state(item) {
                *state = DatagramState::Sent { at_ns, arrives_ns };
            }
            return;
        };
        let Some(domain) = self.domains.get_mut(domain) else { return };
        let base = domain.logical_base;
        let (Some(datagram), Some(memory)) =
            (domain.datagrams.get_mut(datagram), domain.memory.as_ref())
        else {
            return;
        };
        memory.read(datagram.offset, &mut datagram.wire);
        let counter = if faults.lost == Some(LossDirection::Outward) {
            0
        } else {
            let logical = base.wrapping_add(datagram.offset as u32);
            world.exchange(datagram.command, logical, &mut datagram.wire, outward_ns(delay_ns))
        };
        let counter = i32::from(counter).saturating_add(faults.counter_offset);
        datagram.working_counter = u16::try_from(counter.max(0)).unwrap_or(u16::MAX);
        datagram.state = DatagramState::Sent { at_ns, arrives_ns };
    }

    /// Receives the returned datagrams and times out the overdue ones.
    pub(crate) fn receive(&mut self, now: u64) {
        self.received_at = now;
        let mut queue = std::mem::take(&mut self.queue);
        queue.retain(|item| !self.receive_one(*item, now));
        self.queue = queue;
    }

    fn receive_one(&mut self, item: Queued, now: u64) -> bool {
        let Some(state) = self.datagram_state(item) else { return true };
        let DatagramState::Sent { at_ns, arrives_ns } = *state else { return false };
        let has_arrived = arrives_ns.is_some_and(|at| at <= now);
        if !has_arrived && now.saturating_sub(at_ns) <= DATAGRAM_TIMEOUT_NS {
            return false;
        }
        *state = if has_arrived { DatagramState::Received } else { DatagramState::Lost };
        if has_arrived
            && let Queued::Domain { domain, datagram } = item
            && let Some(domain) = self.domains.get(domain)
            && let Some(datagram) = domain.datagrams.get(datagram)
            && let Some(memory) = &domain.memory
            && datagram.command != LogicalCommand::Write
        {
            memory.write(datagram.offset, &datagram.wire);
        }
        true
    }
}
