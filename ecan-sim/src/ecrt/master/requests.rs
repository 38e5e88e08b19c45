//! SDO transfers of blocking calls, and the turn of the requests of configurations.

use crate::ecrt::sdo_transfer::{SdoFailure, SdoObject, TransferOwner};
use crate::ecrt::slave_config::{Configs, RequestProgress};
use crate::ecrt::slave_view::SlaveView;

/// A transfer that a blocking call waits for.
#[derive(Debug)]
pub(super) struct BlockingSdo {
    pub(super) id: u64,
    pub(super) position: usize,
    pub(super) object: SdoObject,
    /// Data to write; `None` reads.
    pub(super) download: Option<Vec<u8>>,
    /// Data read.
    pub(super) upload: Vec<u8>,
    pub(super) taken: bool,
    pub(super) result: Option<Result<(), SdoFailure>>,
}

/// Transfers of blocking calls, and the turn of the requests of configurations.
#[derive(Debug, Default)]
pub(crate) struct Requests {
    pub(super) blocking: Vec<BlockingSdo>,
    pub(super) next_blocking: u64,
    /// When the present round of state polling ends, after which internal requests are served.
    pub(super) round_ends: u64,
    /// The step in which the last internal request ended: the next one follows in the same.
    pub(super) last_ended: Option<u64>,
}

impl Requests {
    /// Queues a transfer for the slave at a position; returns its ID.
    pub(crate) fn queue_blocking(
        &mut self,
        slaves: &mut [SlaveView],
        position: usize,
        object: SdoObject,
        download: Option<Vec<u8>>,
        now: u64,
    ) -> Result<u64, SdoFailure> {
        let slave = slaves.get_mut(position).ok_or(SdoFailure::NO_SLAVE)?;
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

    /// Lets the waiting transfers of blocking calls begin again.
    pub(super) fn restart(&mut self) {
        for sdo in &mut self.blocking {
            sdo.taken = false;
        }
    }

    /// Fails the running transfers of all slaves and waiting blocking transfers: the slave list
    /// will be cleared. Waiting requests belong to a configuration and stay. A register request that
    /// is being executed stays busy: as in IgH, the state machine of the slave is the only one that
    /// ends it, and a configuration that loses its slave takes the request from that state machine.
    pub(super) fn fail_all(
        &mut self,
        slaves: &mut [SlaveView],
        configs: &mut Configs,
        keeps_lost_requests: bool,
    ) {
        for sdo in &mut self.blocking {
            sdo.result.get_or_insert(Err(SdoFailure::UNANSWERED));
        }
        for slave in slaves {
            match slave.transfer.take().map(|transfer| transfer.owner) {
                Some(TransferOwner::Request(id)) => {
                    if let Some(entry) = configs.request(id) {
                        entry.progress = RequestProgress::Failure;
                    }
                }
                Some(TransferOwner::Register(_) | TransferOwner::Blocking(_)) | None => {}
            }
        }
        if keeps_lost_requests {
            let requests = configs.iter_mut().flat_map(|config| &mut config.reg_requests);
            for entry in requests.filter(|entry| entry.progress == RequestProgress::Queued) {
                entry.progress = RequestProgress::Busy;
            }
        }
    }

    pub(super) fn finish(
        &mut self,
        owner: TransferOwner,
        result: Result<(), SdoFailure>,
        configs: &mut Configs,
    ) {
        match owner {
            TransferOwner::Register(_) => {}
            TransferOwner::Blocking(id) => {
                if let Some(sdo) = self.blocking.iter_mut().find(|sdo| sdo.id == id) {
                    sdo.result = Some(result);
                }
            }
            TransferOwner::Request(id) => {
                if let Some(entry) = configs.request(id) {
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
}
