//! Transfers of slaves one at a time: SDOs of blocking calls, SDO requests and register requests.

use std::ops::Range;

use ecan_protocol::device::AlState;

use super::MasterModel;
use super::activity::polling_round_ns;
use crate::ecrt::sdo_transfer::{
    Payload, Progress, Receiver, RequestId, SdoFailure, SdoObject, Transfer, TransferOwner, proceed,
};
use crate::ecrt::slaves::{RequestProgress, al_status, is_any_configured};
use crate::ecrt::timing::REGISTER_NS;
use crate::gateway::Gateway;
use crate::world::{Slot, World};

const AL_CONTROL: u16 = 0x0120;
const AL_STATUS: u16 = 0x0130;
const AL_STATUS_CODE: u16 = 0x0134;
/// SM0 to SM3.
const SYNC_MANAGERS: Range<u16> = 0x0800..0x0820;
const SYNC_MANAGER_BYTES: u16 = 8;
const SPEED_COUNTER_START: u16 = 0x0930;
/// Steps of an access before activation: datagram, result.
const IDLE_STEPS: u64 = 2;

impl MasterModel {
    pub(crate) fn choose_transfer(&mut self, index: usize, world: &World) {
        let now = world.now_ns();
        let held_until = world.fault_schedule().requests_held_until(world.now_ns());
        let mailbox = self.pacing.begin_transfer(now);
        let Some(slave) = self.slaves.get_mut(index) else { return };
        slave.due = u64::MAX;
        let (has_mailbox, has_coe) = (slave.has_mailbox(), slave.description.has_coe);
        let mut chosen = None;
        for sdo in &mut self.requests.blocking {
            if sdo.position != index || sdo.taken || sdo.result.is_some() {
                continue;
            }
            if !has_mailbox {
                let failure = if has_coe { SdoFailure::UNANSWERED } else { SdoFailure::NO_COE };
                sdo.result = Some(Err(failure));
                continue;
            }
            sdo.taken = true;
            chosen = Some(TransferOwner::Blocking(sdo.id));
            break;
        }
        if chosen.is_none()
            && let Some(until) = held_until
        {
            slave.due = until;
            return;
        }
        // internal requests wait for the master's one state machine
        let is_in_turn = !self.behaviour.serves_in_turn || self.serves_requests(now);
        let Some(slave) = self.slaves.get_mut(index) else { return };
        if chosen.is_none()
            && is_in_turn
            && let Some(config) = slave.config
            && let Some(known) = self.configs.get_mut(config)
        {
            for (request, entry) in known.requests.iter_mut().enumerate() {
                if entry.progress != RequestProgress::Queued {
                    continue;
                }
                if !has_mailbox || entry.is_overdue(now) {
                    entry.progress = RequestProgress::Failure;
                    continue;
                }
                entry.progress = RequestProgress::Busy;
                chosen = Some(TransferOwner::Request(RequestId { config, request }));
                break;
            }
        }
        if let Some(owner) = chosen {
            slave.transfer = Some(Transfer { owner, mailbox });
            slave.due = now;
        } else {
            self.choose_reg_request(index, now);
            self.wait_for_turn(index, now);
        }
    }

    /// Returns whether the master can serve an internal request now: a round of polling after it has
    /// ended another activity, or at the end of another request.
    fn serves_requests(&self, now: u64) -> bool {
        let serves_one = self.slaves.iter().any(|slave| {
            matches!(slave.transfer, Some(Transfer { owner: TransferOwner::Request(_), .. }))
        });
        let follows =
            self.requests.last_ended.is_some_and(|ended| self.pacing.steps() - ended <= 1);
        !serves_one
            && !self.dictionary.is_running()
            && !is_any_configured(&self.slaves)
            && !self.scan.is_running()
            && (follows || now >= self.requests.round_ends)
    }

    /// Tries again later if an internal request of the slave is queued.
    fn wait_for_turn(&mut self, index: usize, now: u64) {
        let step_ns = self.pacing.idle_step_ns();
        let Some(slave) = self.slaves.get_mut(index).filter(|slave| slave.is_idle()) else {
            return;
        };
        let config = slave.config.and_then(|config| self.configs.get(config));
        let is_queued = config.is_some_and(|config| {
            config.requests.iter().any(|entry| entry.progress == RequestProgress::Queued)
        });
        if is_queued {
            slave.due = now + if self.reservation.is_active() { 0 } else { step_ns };
        }
    }

    pub(crate) fn run_transfer(&mut self, index: usize, world: &mut World) {
        let now = world.now_ns();
        let Some(slave) = self.slaves.get_mut(index) else { return };
        let Some(mut transfer) = slave.transfer else { return };
        let receiver = Receiver { slot: slave.slot, is_present: slave.is_present(world) };
        let (pace, mailbox) = (self.pacing.pace(self.reservation.phase()), &mut transfer.mailbox);
        let progress = match transfer.owner {
            TransferOwner::Register(id) => {
                self.finish_reg_request(id, receiver.slot, receiver.is_present, world);
                return self.end_transfer(index, now);
            }
            TransferOwner::Blocking(id) => {
                self.requests.blocking.iter_mut().find(|sdo| sdo.id == id).map(|sdo| {
                    let payload = match &sdo.download {
                        Some(data) => Payload::Download(data),
                        None => Payload::Upload(&mut sdo.upload),
                    };
                    proceed(world, receiver, mailbox, pace, sdo.object, payload)
                })
            }
            TransferOwner::Request(id) => self.configs.request(id).map(|entry| {
                let object = SdoObject::entry(entry.index, entry.subindex);
                let payload = if entry.writes {
                    Payload::Download(&entry.data)
                } else {
                    Payload::Upload(&mut entry.data)
                };
                proceed(world, receiver, mailbox, pace, object, payload)
            }),
        };
        match progress {
            Some(Progress::Waiting(delay)) => {
                if let Some(slave) = self.slaves.get_mut(index) {
                    slave.transfer = Some(transfer);
                    slave.due = now + delay;
                }
            }
            Some(Progress::Done(result)) => {
                let is_external = matches!(transfer.owner, TransferOwner::Blocking(_));
                let result = match is_external && self.dictionary.collides(index, now) {
                    true => {
                        self.log
                            .push_slave(index, "reception of an SDO response failed: no response");
                        Err(SdoFailure::UNANSWERED)
                    }
                    false => result,
                };
                if !is_external {
                    self.requests.last_ended = Some(self.pacing.steps());
                    self.wake_others(now);
                }
                self.requests.finish(transfer.owner, result, &mut self.configs);
                self.end_transfer(index, now);
                // A configuration that waited for the transfer comes first.
                let may_go_on = self.slaves.get(index).is_some_and(|slave| slave.is_idle());
                if !is_external && self.behaviour.serves_in_turn && may_go_on {
                    self.choose_transfer(index, world);
                }
            }
            // the caller no longer waits
            None => self.end_transfer(index, now),
        }
    }

    /// Lets the slaves with a queued request choose it.
    fn wake_others(&mut self, now: u64) {
        for slave in self.slaves.iter_mut().filter(|slave| slave.is_idle()) {
            slave.due = slave.due.min(now);
        }
    }

    fn end_transfer(&mut self, index: usize, now: u64) {
        if let Some(slave) = self.slaves.get_mut(index) {
            slave.transfer = None;
            slave.due = now;
        }
    }

    pub(crate) fn start_request(
        &mut self,
        id: RequestId,
        writes: bool,
        now: u64,
    ) -> Result<(), i32> {
        let entry = self.configs.request(id).ok_or(libc::EINVAL)?;
        if writes && entry.data_size == 0 {
            return Err(libc::EINVAL);
        }
        entry.start(writes, now);
        self.wake(id.config, now);
        if self.requests.round_ends < now {
            self.requests.round_ends = now + polling_round_ns(self.slaves.len());
        }
        Ok(())
    }

    /// Queues an access. A write copies the caller's data. As in IgH, a request that is busy is queued
    /// again.
    pub(crate) fn start_reg_request(
        &mut self,
        id: RequestId,
        writes: bool,
        address: u16,
        size: usize,
        now: u64,
    ) -> Result<(), i32> {
        let keeps_lost_requests = self.behaviour.keeps_lost_requests;
        let is_detached = self.configs.get(id.config).is_some_and(|config| config.slave.is_none());
        let entry = self.configs.reg_request(id).ok_or(libc::ENOENT)?;
        if size == 0 || size > entry.memory.len() {
            return Err(libc::ENOBUFS);
        }
        (entry.writes, entry.address, entry.size) = (writes, address, size);
        if writes {
            entry.data.resize(size, 0);
            entry.memory.read(0, &mut entry.data);
        }
        if keeps_lost_requests && (is_detached || entry.progress == RequestProgress::Busy) {
            entry.progress = RequestProgress::Busy;
            return Ok(());
        }
        entry.progress = RequestProgress::Queued;
        self.wake(id.config, now);
        Ok(())
    }

    pub(crate) fn choose_reg_request(&mut self, index: usize, now: u64) -> bool {
        let mailbox = self.pacing.begin_transfer(now);
        let access_ns = match self.reservation.is_active() {
            true => REGISTER_NS,
            false => IDLE_STEPS * self.pacing.idle_step_ns(),
        };
        let Some(slave) = self.slaves.get_mut(index) else { return false };
        let Some(config) = slave.config else { return false };
        let Some(known) = self.configs.get_mut(config) else { return false };
        let queued = known
            .reg_requests
            .iter_mut()
            .enumerate()
            .find(|(_, entry)| entry.progress == RequestProgress::Queued);
        let Some((request, entry)) = queued else { return false };
        entry.progress = RequestProgress::Busy;
        let owner = TransferOwner::Register(RequestId { config, request });
        slave.transfer = Some(Transfer { owner, mailbox });
        slave.due = now + access_ns;
        true
    }

    pub(crate) fn finish_reg_request(
        &mut self,
        id: RequestId,
        slot: Slot,
        present: bool,
        world: &mut World,
    ) {
        let Some(entry) = self.configs.reg_request(id) else { return };
        if !present {
            entry.progress = RequestProgress::Failure;
            return;
        }
        entry.progress = RequestProgress::Success;
        if entry.writes {
            write_registers(world, slot, entry.address, &entry.data);
            return;
        }
        entry.data.clear();
        for offset in 0..entry.size {
            let address = entry.address.wrapping_add(offset as u16);
            entry.data.push(register(world, slot, address));
        }
    }

    /// Lets the slave of a configuration choose its next transfer.
    fn wake(&mut self, config: usize, now: u64) {
        let slave = self.configs.get(config).and_then(|config| config.slave);
        if let Some(slave) = slave.and_then(|slave| self.slaves.get_mut(slave)) {
            slave.due = slave.due.min(now);
        }
    }
}

/// Reads a register byte. Only AL status, its code and the sync managers are modelled, the others
/// read as 0.
fn register(world: &World, slot: Slot, address: u16) -> u8 {
    let [low, high] = world.line().al_status_code(slot).to_le_bytes();
    match address {
        AL_STATUS => al_status(world, slot),
        AL_STATUS_CODE => low,
        a if a == AL_STATUS_CODE + 1 => high,
        a if SYNC_MANAGERS.contains(&a) => world
            .line()
            .gateway_in(slot)
            .map_or(0, |gateway| sync_manager_register(gateway, a - SYNC_MANAGERS.start)),
        _ => 0,
    }
}

fn sync_manager_register(gateway: &Gateway, offset: u16) -> u8 {
    let Some(config) = gateway.sync_manager((offset / SYNC_MANAGER_BYTES) as u8) else { return 0 };
    let ([s0, s1], [l0, l1]) = (config.start.to_le_bytes(), config.length.to_le_bytes());
    let bytes = [s0, s1, l0, l1, config.control, 0, 1, 0];
    bytes.get(usize::from(offset % SYNC_MANAGER_BYTES)).copied().unwrap_or(0)
}

/// Writes registers. AL control, and the speed counter start that restarts the control of the
/// distributed clock, are modelled; others are ignored.
fn write_registers(world: &mut World, slot: Slot, address: u16, data: &[u8]) {
    let control = AL_CONTROL.checked_sub(address).and_then(|at| data.get(usize::from(at)));
    if let Some(state) = control.and_then(|control| AlState::from_raw(control & 0x0F)) {
        world.request_al_state(slot, state);
    }
    let start = SPEED_COUNTER_START.checked_sub(address).and_then(|at| data.get(usize::from(at)));
    if start.is_some() {
        world.with_gateway_in(slot, |gateway, now| gateway.parts().0.restart_dc_control(now));
    }
}
