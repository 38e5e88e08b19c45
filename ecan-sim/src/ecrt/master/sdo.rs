//! SDO transfers: blocking ones, and requests in parallel with the cycle.

use super::MasterModel;
use crate::ecrt::mailbox::{Transfer, TransferOwner};
use crate::ecrt::sdo_transfer::{Attempt, Payload, SdoFailure, SdoObject, attempt};
use crate::ecrt::slave_config::{RequestId, RequestProgress, SdoRequest};
use crate::ecrt::timing::STATE_POLL_NS;
use crate::world::World;

/// A transfer that a blocking call waits for.
#[derive(Debug)]
pub(crate) struct BlockingSdo {
    pub(crate) id: u64,
    pub(crate) position: usize,
    pub(crate) object: SdoObject,
    /// Data to write; `None` reads.
    pub(crate) download: Option<Vec<u8>>,
    pub(crate) taken: bool,
    /// Result, with the data of an upload.
    pub(crate) result: Option<Result<Vec<u8>, SdoFailure>>,
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
        self.blocking.swap_remove(index).result
    }

    pub(crate) fn cancel_blocking(&mut self, id: u64) {
        self.blocking.retain(|sdo| sdo.id != id);
    }

    /// Fails the running transfers of all slaves and waiting blocking transfers: the slave list
    /// will be cleared. Waiting requests belong to a configuration and stay.
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
                Some(TransferOwner::Register(id)) => {
                    if let Some(entry) = self.reg_request(id) {
                        entry.progress = RequestProgress::Failure;
                    }
                }
                Some(TransferOwner::Blocking(_)) | None => {}
            }
        }
    }

    pub(crate) fn choose_transfer(&mut self, index: usize, world: &World) {
        let now = world.now_ns();
        let held_until = world.requests_held_until();
        let mailbox = self.begin_transfer(now);
        let Some(slave) = self.slaves.get_mut(index) else { return };
        slave.due = u64::MAX;
        let has_mailbox = slave.has_mailbox();
        let mut chosen = None;
        for sdo in &mut self.blocking {
            if sdo.position != index || sdo.taken || sdo.result.is_some() {
                continue;
            }
            if !has_mailbox {
                sdo.result = Some(Err(SdoFailure::UNANSWERED));
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
        if chosen.is_none()
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
        }
    }

    pub(crate) fn run_transfer(&mut self, index: usize, world: &mut World) {
        let now = world.now_ns();
        let Some(slave) = self.slaves.get_mut(index) else { return };
        let Some(mut transfer) = slave.transfer else { return };
        let (slot, present, since) = (slave.slot, slave.is_present(world), transfer.mailbox.since);
        if let TransferOwner::Register(id) = transfer.owner {
            self.finish_reg_request(id, slot, present, world);
            return self.end_transfer(index, now);
        }
        if let Err(delay) = self.poll_mailbox(&mut transfer.mailbox, now) {
            if let Some(slave) = self.slaves.get_mut(index) {
                slave.transfer = Some(transfer);
                slave.due = now + delay;
            }
            return;
        }
        let mut upload = std::mem::take(&mut self.scratch);
        let attempt = match transfer.owner {
            TransferOwner::Register(_) => None,
            TransferOwner::Blocking(id) => {
                self.blocking.iter_mut().find(|sdo| sdo.id == id).map(|sdo| {
                    let payload = match &sdo.download {
                        Some(data) => Payload::Download(data),
                        None => Payload::Upload(&mut upload),
                    };
                    attempt(world, slot, present, since, sdo.object, payload)
                })
            }
            TransferOwner::Request(id) => self.request(id).map(|entry| {
                let object = SdoObject::entry(entry.index, entry.subindex);
                let payload = if entry.writes {
                    Payload::Download(&entry.data)
                } else {
                    Payload::Upload(&mut entry.data)
                };
                attempt(world, slot, present, since, object, payload)
            }),
        };
        match attempt {
            Some(Attempt::Waiting) => {
                if let Some(slave) = self.slaves.get_mut(index) {
                    slave.due = now + STATE_POLL_NS;
                }
            }
            Some(Attempt::Done(result)) => {
                self.finish_transfer(transfer.owner, result, &upload);
                self.end_transfer(index, now);
            }
            // the caller no longer waits
            None => self.end_transfer(index, now),
        }
        self.scratch = upload;
    }

    fn end_transfer(&mut self, index: usize, now: u64) {
        if let Some(slave) = self.slaves.get_mut(index) {
            slave.transfer = None;
            slave.due = now;
        }
    }

    fn finish_transfer(
        &mut self,
        owner: TransferOwner,
        result: Result<(), SdoFailure>,
        upload: &[u8],
    ) {
        match owner {
            TransferOwner::Register(_) => {}
            TransferOwner::Blocking(id) => {
                if let Some(sdo) = self.blocking.iter_mut().find(|sdo| sdo.id == id) {
                    sdo.result = Some(result.map(|()| upload.to_vec()));
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
        Ok(())
    }
}
