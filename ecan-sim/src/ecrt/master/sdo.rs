//! SDO transfers: blocking ones, and requests in parallel with the cycle.

use super::{MasterModel, Phase};
use crate::ecrt::sdo_transfer::{
    Payload, Progress, Receiver, SdoFailure, SdoObject, Transfer, TransferOwner, proceed,
};
use crate::ecrt::slave_config::{RequestId, RequestProgress, SdoRequest};
use crate::world::World;

/// A transfer that a blocking call waits for.
#[derive(Debug)]
pub(crate) struct BlockingSdo {
    pub(crate) id: u64,
    pub(crate) position: usize,
    pub(crate) object: SdoObject,
    /// Data to write; `None` reads.
    pub(crate) download: Option<Vec<u8>>,
    /// Data read.
    pub(crate) upload: Vec<u8>,
    pub(crate) taken: bool,
    pub(crate) result: Option<Result<(), SdoFailure>>,
}

impl MasterModel {
    /// Queues a transfer for the slave at a position; returns its ID.
    pub(crate) fn queue_blocking(
        &mut self,
        position: usize,
        object: SdoObject,
        download: Option<Vec<u8>>,
        now: u64,
    ) -> Result<u64, SdoFailure> {
        let slave = self.slaves.get_mut(position).ok_or(SdoFailure::NO_SLAVE)?;
        slave.due = slave.due.min(now);
        self.next_blocking += 1;
        let id = self.next_blocking;
        self.blocking.push(BlockingSdo {
            id,
            position,
            object,
            download,
            upload: Vec::new(),
            taken: false,
            result: None,
        });
        Ok(id)
    }

    pub(crate) fn take_blocking(&mut self, id: u64) -> Option<Result<Vec<u8>, SdoFailure>> {
        let index = self.blocking.iter().position(|sdo| sdo.id == id)?;
        if self.blocking.get(index).is_some_and(|sdo| sdo.result.is_none()) {
            return None;
        }
        let BlockingSdo { result, upload, .. } = self.blocking.swap_remove(index);
        result.map(|result| result.map(|()| upload))
    }

    pub(crate) fn cancel_blocking(&mut self, id: u64) {
        self.blocking.retain(|sdo| sdo.id != id);
    }

    /// Fails the running transfers of all slaves and waiting blocking transfers: the slave list
    /// will be cleared. Waiting requests belong to a configuration and stay. A register request that
    /// is being executed stays busy: as in IgH, the state machine of the slave is the only one that
    /// ends it, and a configuration that loses its slave takes the request from that state machine.
    pub(crate) fn fail_transfers(&mut self) {
        for sdo in &mut self.blocking {
            sdo.result.get_or_insert(Err(SdoFailure::UNANSWERED));
        }
        for index in 0..self.slaves.len() {
            let transfer = self.slaves.get_mut(index).and_then(|slave| slave.transfer.take());
            match transfer.map(|transfer| transfer.owner) {
                Some(TransferOwner::Request(id)) => {
                    if let Some(entry) = self.request(id) {
                        entry.progress = RequestProgress::Failure;
                    }
                }
                Some(TransferOwner::Register(_) | TransferOwner::Blocking(_)) | None => {}
            }
        }
        if self.behaviour.keeps_lost_requests {
            let requests = self.configs.iter_mut().flat_map(|config| &mut config.reg_requests);
            for entry in requests.filter(|entry| entry.progress == RequestProgress::Queued) {
                entry.progress = RequestProgress::Busy;
            }
        }
    }

    pub(crate) fn choose_transfer(&mut self, index: usize, world: &World) {
        let now = world.now_ns();
        let held_until = world.fault_schedule().requests_held_until(world.now_ns());
        let mailbox = self.begin_transfer(now);
        let Some(slave) = self.slaves.get_mut(index) else { return };
        slave.due = u64::MAX;
        let (has_mailbox, has_coe) = (slave.has_mailbox(), slave.description.has_coe);
        let mut chosen = None;
        for sdo in &mut self.blocking {
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
        let follows = self.last_request_ended.is_some_and(|ended| self.steps - ended <= 1);
        !serves_one && !self.is_busy() && self.scan.is_none() && (follows || now >= self.round_ends)
    }

    /// Tries again later if an internal request of the slave is queued.
    fn wait_for_turn(&mut self, index: usize, now: u64) {
        let step_ns = self.idle_step_ns();
        let Some(slave) = self.slaves.get_mut(index).filter(|slave| slave.is_idle()) else {
            return;
        };
        let config = slave.config.and_then(|config| self.configs.get(config));
        let is_queued = config.is_some_and(|config| {
            config.requests.iter().any(|entry| entry.progress == RequestProgress::Queued)
        });
        if is_queued {
            slave.due = now + if self.phase == Phase::Active { 0 } else { step_ns };
        }
    }

    pub(crate) fn run_transfer(&mut self, index: usize, world: &mut World) {
        let now = world.now_ns();
        let Some(slave) = self.slaves.get_mut(index) else { return };
        let Some(mut transfer) = slave.transfer else { return };
        let receiver = Receiver { slot: slave.slot, is_present: slave.is_present(world) };
        let (pace, mailbox) = (self.pace(), &mut transfer.mailbox);
        let progress = match transfer.owner {
            TransferOwner::Register(id) => {
                self.finish_reg_request(id, receiver.slot, receiver.is_present, world);
                return self.end_transfer(index, now);
            }
            TransferOwner::Blocking(id) => {
                self.blocking.iter_mut().find(|sdo| sdo.id == id).map(|sdo| {
                    let payload = match &sdo.download {
                        Some(data) => Payload::Download(data),
                        None => Payload::Upload(&mut sdo.upload),
                    };
                    proceed(world, receiver, mailbox, pace, sdo.object, payload)
                })
            }
            TransferOwner::Request(id) => self.request(id).map(|entry| {
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
                let result = match is_external && self.collides(index, now) {
                    true => {
                        self.log(index, "reception of an SDO response failed: no response");
                        Err(SdoFailure::UNANSWERED)
                    }
                    false => result,
                };
                if !is_external {
                    self.last_request_ended = Some(self.steps);
                    self.wake_others(now);
                }
                self.finish_transfer(transfer.owner, result);
                self.end_transfer(index, now);
                if !is_external && self.behaviour.serves_in_turn {
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

    fn finish_transfer(&mut self, owner: TransferOwner, result: Result<(), SdoFailure>) {
        match owner {
            TransferOwner::Register(_) => {}
            TransferOwner::Blocking(id) => {
                if let Some(sdo) = self.blocking.iter_mut().find(|sdo| sdo.id == id) {
                    sdo.result = Some(result);
                }
            }
            TransferOwner::Request(id) => {
                if let Some(entry) = self.request(id) {
                    entry.unfetched = result.is_ok() && !entry.writes;
                    entry.progress = if result.is_ok() {
                        RequestProgress::Success
                    } else {
                        RequestProgress::Failure
                    };
                }
            }
        }
    }

    pub(crate) fn request(&mut self, id: RequestId) -> Option<&mut SdoRequest> {
        self.configs.get_mut(id.config)?.requests.get_mut(id.request)
    }

    pub(crate) fn start_request(
        &mut self,
        id: RequestId,
        writes: bool,
        now: u64,
    ) -> Result<(), i32> {
        let entry = self.request(id).ok_or(libc::EINVAL)?;
        if writes && entry.data_size == 0 {
            return Err(libc::EINVAL);
        }
        entry.start(writes, now);
        self.wake(id.config, now);
        if self.round_ends < now {
            self.round_ends = now + self.polling_round_ns();
        }
        Ok(())
    }
}
