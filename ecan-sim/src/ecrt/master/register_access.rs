//! Register requests in parallel with the cycle.

use std::ops::Range;

use ecan_protocol::device::AlState;
use libc::c_int;

use super::{MasterModel, Phase};
use crate::ecrt::sdo_transfer::{Transfer, TransferOwner};
use crate::ecrt::slave_config::{RegRequest, RequestId, RequestProgress};
use crate::ecrt::slave_view::al_status;
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
    pub(crate) fn reg_request(&mut self, id: RequestId) -> Option<&mut RegRequest> {
        self.configs.get_mut(id.config)?.reg_requests.get_mut(id.request)
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
    ) -> Result<(), c_int> {
        let keeps_lost_requests = self.behaviour.keeps_lost_requests;
        let is_detached = self.configs.get(id.config).is_some_and(|config| config.slave.is_none());
        let entry = self.reg_request(id).ok_or(libc::ENOENT)?;
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
        let mailbox = self.begin_transfer(now);
        let access_ns = match self.phase {
            Phase::Active => REGISTER_NS,
            Phase::Idle | Phase::Reserved => IDLE_STEPS * self.idle_step_ns(),
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
        let Some(entry) = self.reg_request(id) else { return };
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
        world.with_gateway_in(slot, |gateway, now| gateway.restart_dc_control(now));
    }
}
