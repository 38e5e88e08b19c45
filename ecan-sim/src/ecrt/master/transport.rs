//! Send queue: frames, losses, and blocking by an oversized datagram.

use crate::ecrt::clocks::Clocks;
use crate::ecrt::domain::{DatagramState, DomainDatagram, Queued};
use crate::ecrt::slaves::{Configs, SlaveView};
use crate::ecrt::timing::{BYTE_NS, DATAGRAM_TIMEOUT_NS, HOST_LATENCY_NS, SLAVE_LATENCY_NS};
use crate::fault::{CycleFaults, LossDirection};
use crate::world::{LogicalCommand, Slot, World};

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

/// What the datagrams of a queue exchange: domains and clocks.
pub(super) struct Contents<'a> {
    pub(super) configs: &'a mut Configs,
    pub(super) clocks: &'a mut Clocks,
    pub(super) slaves: &'a [SlaveView],
    /// The slave of the reference clock.
    pub(super) reference: Option<Slot>,
}

impl Contents<'_> {
    fn datagram(&mut self, domain: usize, datagram: usize) -> Option<&mut DomainDatagram> {
        self.configs.domain(domain).ok()?.datagrams.get_mut(datagram)
    }

    fn state(&mut self, item: Queued) -> Option<&mut DatagramState> {
        match item {
            Queued::Domain { domain, datagram } => {
                self.datagram(domain, datagram).map(|datagram| &mut datagram.state)
            }
            _ => self.clocks.datagram_state(item),
        }
    }

    fn pending_bytes(&mut self, item: Queued) -> Option<usize> {
        if *self.state(item)? != DatagramState::Queued {
            return None;
        }
        Some(match item {
            Queued::Domain { domain, datagram } => self.datagram(domain, datagram)?.wire.len(),
            _ => CLOCK_BYTES,
        })
    }

    fn transmit(&mut self, item: Queued, world: &mut World, faults: CycleFaults, delay_ns: u64) {
        let at_ns = world.now_ns();
        let arrives_ns = faults.lost.is_none().then_some(at_ns + delay_ns);
        let Queued::Domain { domain, datagram } = item else {
            self.clocks.exchange(item, self.reference, self.slaves, world, faults.lost);
            let arrives_ns = arrives_ns.filter(|_| self.reference.is_some());
            if let Some(state) = self.state(item) {
                *state = DatagramState::Sent { at_ns, arrives_ns };
            }
            return;
        };
        let Ok(domain) = self.configs.domain(domain) else { return };
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

    /// Receives a datagram or times it out. Returns whether it leaves the queue.
    fn receive(&mut self, item: Queued, now: u64) -> bool {
        let Some(state) = self.state(item) else { return true };
        let DatagramState::Sent { at_ns, arrives_ns } = *state else { return false };
        let has_arrived = arrives_ns.is_some_and(|at| at <= now);
        if !has_arrived && now.saturating_sub(at_ns) <= DATAGRAM_TIMEOUT_NS {
            return false;
        }
        *state = if has_arrived { DatagramState::Received } else { DatagramState::Lost };
        if has_arrived
            && let Queued::Domain { domain, datagram } = item
            && let Ok(domain) = self.configs.domain(domain)
            && let Some(datagram) = domain.datagrams.get(datagram)
            && let Some(memory) = &domain.memory
            && datagram.command != LogicalCommand::Write
        {
            memory.write(datagram.offset, &datagram.wire);
        }
        true
    }
}

/// The send queue.
#[derive(Debug, Default)]
pub(crate) struct Transport {
    carries_large_pdos: bool,
    queue: Vec<Queued>,
    /// The last send stopped at a datagram that fits no frame.
    is_blocked: bool,
    sends: u64,
}

impl Transport {
    pub(super) fn new(carries_large_pdos: bool) -> Self {
        Self { carries_large_pdos, queue: Vec::with_capacity(16), ..Self::default() }
    }

    /// Returns whether the last send stopped at a datagram that fits no frame.
    pub(crate) fn is_blocked(&self) -> bool {
        self.is_blocked
    }

    /// Number of sends.
    pub(crate) fn sends(&self) -> u64 {
        self.sends
    }

    /// Makes room for the datagrams of the domains and of the clocks.
    pub(super) fn reserve(&mut self, datagrams: usize) {
        self.queue.reserve(datagrams);
    }

    pub(super) fn clear(&mut self) {
        self.queue.clear();
        self.is_blocked = false;
    }

    /// Queues a datagram; a queued one keeps its position and is sent once.
    pub(super) fn enqueue(&mut self, item: Queued, contents: &mut Contents<'_>) {
        if !self.queue.contains(&item) {
            self.queue.push(item);
        }
        if let Some(state) = contents.state(item) {
            *state = DatagramState::Queued;
        }
    }

    /// Sends the queue in frames. A datagram larger than a frame blocks all datagrams after it, now
    /// and at each later send. Without a link nothing is sent.
    pub(super) fn send(&mut self, world: &mut World, contents: &mut Contents<'_>) {
        self.sends = self.sends.wrapping_add(1);
        self.is_blocked = false;
        if !world.link_is_up() {
            while let Some(item) = self.queue.pop() {
                if let Some(state) = contents.state(item) {
                    *state = DatagramState::Lost;
                }
            }
            return;
        }
        let carries_process_data = self.queue.iter().any(|item| {
            matches!(item, Queued::Domain { .. }) && contents.pending_bytes(*item).is_some()
        });
        let faults = match carries_process_data {
            true => world.begin_cycle(),
            false => world.fault_schedule().faults_between_cycles(),
        };
        let passed = world.reached().count();
        let mut delay_ns = HOST_LATENCY_NS + passed as u64 * SLAVE_LATENCY_NS;
        let mut frame = FRAME_HEADER_BYTES;
        for &item in &self.queue {
            let Some(bytes) = contents.pending_bytes(item) else { continue };
            let bytes = bytes + DATAGRAM_OVERHEAD;
            if frame + bytes > FRAME_BYTES {
                frame = FRAME_HEADER_BYTES;
            }
            if frame + bytes > FRAME_BYTES && !self.carries_large_pdos {
                self.is_blocked = true;
                break;
            }
            frame += bytes;
            delay_ns += bytes as u64 * BYTE_NS;
            contents.transmit(item, world, faults, delay_ns);
        }
    }

    /// Receives the returned datagrams and times out the overdue ones.
    pub(super) fn receive(&mut self, now: u64, contents: &mut Contents<'_>) {
        self.queue.retain(|item| !contents.receive(*item, now));
    }
}
