//! Slave controller: addressing of datagrams, logical mapping, and working counters; and the line of slave controllers
//! through which Ethernet frames pass.

use std::ops::Range;

use ecan_protocol::device::AlState;

use super::Context;
use super::frame::{Datagram, FrameFault, for_each_datagram, mark_as_processed};
use super::registers::Registers;
use super::sync_manager::{Area, Buffers, Part, REGISTER_BYTES, copy_bits};
use crate::backend_error::BackendError;
use crate::fault::{CycleFaults, LossDirection};
use crate::node::BridgeFactory;
use crate::scenario::{Scenario, Topology};
use crate::world::World;

/// Longest data of a datagram: its length has 11 bits.
const DATAGRAM_BYTES: usize = 0x7FF;

/// Kind of access at an addressed slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Access {
    Read,
    Write,
    /// The memory is read before it is written.
    Exchange,
}

impl Access {
    fn reads(self) -> bool {
        self != Self::Write
    }

    fn writes(self) -> bool {
        self != Self::Read
    }
}

/// A slave controller. EtherCAT state, clock and process data buffers belong to the gateway.
#[derive(Clone)]
pub(super) struct SlaveController {
    registers: Registers,
    buffers: Buffers,
    scratch: Box<[u8]>,
    /// Number of gateway boots at the last reset of this controller.
    boots: Option<u32>,
    /// AL state and error indication in the last frame.
    last_state: (AlState, bool),
    has_next: bool,
}

impl SlaveController {
    pub(super) fn new() -> Self {
        Self {
            registers: Registers::new(),
            buffers: Buffers::new(),
            scratch: vec![0; DATAGRAM_BYTES].into_boxed_slice(),
            boots: None,
            last_state: (AlState::Init, false),
            has_next: false,
        }
    }

    pub(super) fn pass(&mut self, frame: &mut [u8], context: &mut Context<'_>) {
        self.catch_up(context);
        match for_each_datagram(frame, |datagram| self.serve(datagram, context)) {
            Ok(()) | Err(FrameFault::NotEtherCat) => {}
            Err(_) => self.registers.count_processing_error(),
        }
    }

    fn catch_up(&mut self, context: &mut Context<'_>) {
        let boots = context.gateway.supply().boots;
        if self.boots != Some(boots) {
            *self = Self { boots: Some(boots), has_next: self.has_next, ..Self::new() };
            // local time starts at power-on
            let side = context.gateway.side();
            let boot = side.dc_time(context.gateway.supply().booted_at);
            let since_boot = side.dc_time(context.now).saturating_sub(boot);
            context.gateway.write_dc_system_time(context.now, since_boot);
            self.buffers.begin(context);
            self.registers.load_configuration(context.gateway.eeprom());
        }
        let has_next = context.return_ns.is_some();
        if std::mem::replace(&mut self.has_next, has_next) != has_next {
            self.registers.note_link(has_next);
        }
        let state = (context.gateway.al_state(), context.gateway.al_error());
        if std::mem::replace(&mut self.last_state, state) != state {
            self.registers.note_al_status();
        }
        self.buffers.check_stops(context);
        self.buffers.check_buffers(context);
        self.buffers.serve_mailbox(context);
    }

    fn serve(&mut self, mut datagram: Datagram<'_>, context: &mut Context<'_>) {
        let (command, address) = (datagram.command(), datagram.slave_address());
        let is_addressed = match command {
            // APRD, APWR, APRW, ARMW: the slave that finds the address 0; each one counts it up
            1..=3 | 13 => address == 0,
            // FPRD, FPWR, FPRW, FRMW
            4..=6 | 14 => self.registers.is_addressed(address),
            // BRD, BWR, BRW; LRD, LWR, LRW
            7..=12 => true,
            // NOP and undefined commands pass unchanged
            _ => return,
        };
        let is_broadcast = matches!(command, 7..=9);
        if is_broadcast || matches!(command, 1..=3 | 13) {
            datagram.count_slave_address_up();
        }
        let access = match command {
            // the addressed slave is read, all others are written
            13 | 14 if is_addressed => Access::Read,
            13 | 14 => Access::Write,
            _ => [Access::Read, Access::Write, Access::Exchange][usize::from(command - 1) % 3],
        };
        if matches!(command, 10..=12) {
            self.map(access, &mut datagram, context);
        } else if is_addressed || command >= 13 {
            self.access(access, is_broadcast, &mut datagram, context);
        }
        if let Some(events) = self.registers.unmasked_events(&self.buffers) {
            datagram.add_events(events);
        }
    }

    /// Accesses the memory; with a broadcast what is read is combined by OR.
    fn access(
        &mut self,
        access: Access,
        is_broadcast: bool,
        datagram: &mut Datagram<'_>,
        context: &mut Context<'_>,
    ) {
        let offset = datagram.offset();
        let mut scratch = std::mem::take(&mut self.scratch);
        let own = &mut scratch[..datagram.data().len()];
        // a rejected part of the memory leaves the datagram as it is
        own.copy_from_slice(datagram.data());
        if is_broadcast {
            own.fill(0);
        }
        let is_read = access.reads() && self.read(offset, own, context);
        if access.writes() && self.write(offset, datagram.data(), context) {
            datagram.count(if access == Access::Exchange { 2 } else { 1 });
        }
        if is_read {
            datagram.count(1);
            for (to, from) in datagram.data().iter_mut().zip(&*own) {
                *to = if is_broadcast { *to | from } else { *from };
            }
        }
        self.scratch = scratch;
    }

    /// Processes a logical datagram. The received data is written before the inputs of this slave
    /// are inserted.
    fn map(&mut self, access: Access, datagram: &mut Datagram<'_>, context: &mut Context<'_>) {
        let logical = datagram.logical_address();
        let bytes = datagram.data().len();
        let mut is_done = [false; 2];
        for (is_write, is_done) in [true, false].into_iter().zip(&mut is_done) {
            for fmmu in self.registers.fmmus().into_iter().flatten() {
                let maps = match is_write {
                    true => fmmu.writes && access.writes(),
                    false => fmmu.reads && access.reads(),
                };
                if let Some(part) = fmmu.part(logical, bytes).filter(|_| maps) {
                    *is_done |= self.map_part(part, is_write, datagram.data(), context);
                }
            }
        }
        let [is_written, is_read] = is_done;
        let weight = if access == Access::Exchange { 2 } else { 1 };
        datagram.count(u16::from(is_read) + if is_written { weight } else { 0 });
    }

    fn map_part(
        &mut self,
        part: Part,
        is_write: bool,
        data: &mut [u8],
        context: &mut Context<'_>,
    ) -> bool {
        let (at, length, physical) = match part {
            Part::Bytes { at, length, physical } => {
                let bytes = data.get_mut(at..at + length).unwrap_or_default();
                return match is_write {
                    true => self.write(physical, bytes, context),
                    false => self.read(physical, bytes, context),
                };
            }
            Part::Bits { at, length, physical } => (at, length, physical),
        };
        let (first, bytes) = byte_range(physical, length);
        let Ok(address) = u16::try_from(first) else { return false };
        let mut scratch = std::mem::take(&mut self.scratch);
        let own = &mut scratch[..bytes.min(DATAGRAM_BYTES)];
        let is_done = if is_write {
            // the other bits keep their value
            let stored = if first < REGISTER_BYTES {
                self.registers.stored_bytes(first, own.len())
            } else {
                self.buffers.memory_at(first, own.len())
            };
            own[..stored.len()].copy_from_slice(stored);
            copy_bits(data, at, own, physical % 8, length);
            self.write(address, own, context)
        } else {
            let is_read = self.read(address, own, context);
            if is_read {
                copy_bits(own, physical % 8, data, at, length);
            }
            is_read
        };
        self.scratch = scratch;
        is_done
    }

    /// Passes each area of an access to `part`, with its address and its range in the data.
    fn visit(
        &mut self,
        at: u16,
        bytes: usize,
        mut part: impl FnMut(&mut Self, Area, usize, Range<usize>) -> bool,
    ) -> bool {
        let (mut done, mut is_accepted) = (0, false);
        while done < bytes {
            let at = usize::from(at) + done;
            let (area, end) = self.buffers.area(at);
            let length = (end - at).min(bytes - done);
            is_accepted |= part(self, area, at, done..done + length);
            done += length;
        }
        is_accepted
    }

    /// Reads for the master. A rejected part leaves `out` unchanged.
    fn read(&mut self, at: u16, out: &mut [u8], context: &mut Context<'_>) -> bool {
        self.visit(at, out.len(), |this, area, at, range| {
            let part = &mut out[range];
            match area {
                Area::Registers => this.registers.read(at, part, &this.buffers, context),
                Area::Buffer(number) => return this.buffers.read_buffer(number, at, part, context),
                Area::Memory => part.copy_from_slice(this.buffers.memory_at(at, part.len())),
                Area::Nothing => return false,
            }
            true
        })
    }

    fn write(&mut self, at: u16, data: &[u8], context: &mut Context<'_>) -> bool {
        self.visit(at, data.len(), |this, area, at, range| {
            let part = &data[range];
            match area {
                Area::Registers => this.registers.write(at, part, &mut this.buffers, context),
                Area::Buffer(number) => this.buffers.write_buffer(number, at, part, context),
                Area::Memory => {
                    this.buffers.memory_mut(at, part.len()).copy_from_slice(part);
                    true
                }
                Area::Nothing => false,
            }
        })
    }
}

/// First byte of a bit range, and number of bytes.
fn byte_range(first_bit: usize, bits: usize) -> (usize, usize) {
    let first = first_bit / 8;
    (first, (first_bit + bits).div_ceil(8) - first)
}

/// Time that a frame takes from one slave to the next, ns: processing and cable.
const HOP_NS: u64 = 600;

/// Counters of a [`Wire`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WireStatistics {
    /// EtherCAT frames.
    pub frames: u64,
    /// Invalid frames: processed up to the fault, and returned.
    pub faulty: u64,
    /// Frames of other protocols: dropped, as slave controllers do.
    pub foreign: u64,
    /// Frames that did not return: a fault of the scenario, or no slave.
    pub lost: u64,
}

/// Gateways on an Ethernet wire, for any EtherCAT master: frames go in and return as the last slave
/// of the line has left them.
///
/// The world is that of the simulated libethercat: the same firmware, buses, nodes and faults. The
/// caller passes the time, in simulated nanoseconds; it must not run backwards or before the
/// creation of the `Wire`, when the gateways boot.
pub struct Wire {
    world: World,
    controllers: Vec<SlaveController>,
    reached: Vec<usize>,
    /// Lowest logical address so far, and the faults of the present cycle.
    lowest_logical: u32,
    faults: CycleFaults,
    statistics: WireStatistics,
}

impl Wire {
    /// Builds the world of a scenario at `now`, with the gateways switched on; they respond after
    /// their boot.
    ///
    /// # Errors
    /// A recording or an EDS cannot be read; the scenario has a bridge or an I/O slave.
    pub fn new(scenario: &Scenario, now: u64) -> Result<Self, BackendError> {
        Self::with_bridges(scenario, now, None)
    }

    /// As [`new`](Self::new), for a scenario that may have bridges.
    ///
    /// # Errors
    /// A recording or an EDS cannot be read, a bridge cannot be made, or the scenario has an I/O slave.
    pub fn with_bridges(
        scenario: &Scenario,
        now: u64,
        bridges: Option<BridgeFactory>,
    ) -> Result<Self, BackendError> {
        if let Some(io) = scenario.ios.first() {
            return Err(BackendError::IoOnWire(io.name.clone()));
        }
        let mut world = World::new(scenario, now, bridges)?;
        world.begin(&scenario.faults);
        let controllers = (0..world.gateway_count()).map(|_| SlaveController::new()).collect();
        Ok(Self {
            world,
            controllers,
            reached: Vec::new(),
            lowest_logical: u32::MAX,
            faults: CycleFaults::default(),
            statistics: WireStatistics::default(),
        })
    }

    /// A copy of the line in its present state, without the observer of faults; `None` if a node of
    /// the scenario cannot be copied, for example a bridge.
    ///
    /// A copy is much cheaper than a line that a master brings to OP again.
    pub fn try_clone(&self) -> Option<Self> {
        Some(Self {
            world: self.world.try_clone()?,
            controllers: self.controllers.clone(),
            reached: self.reached.clone(),
            ..*self
        })
    }

    /// The simulated world.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The simulated world, for faults and tests.
    pub fn world_mut(&mut self) -> &mut World {
        &mut self.world
    }

    /// What has come by so far.
    pub fn statistics(&self) -> WireStatistics {
        self.statistics
    }

    /// Advances time without a frame.
    pub fn advance(&mut self, now: u64) {
        self.world.advance(now);
    }

    /// Time of the next event without a frame, if any; [`advance`](Self::advance) is not needed
    /// before it.
    pub fn next_event(&self) -> Option<u64> {
        Some(self.world.next_event()).filter(|at| *at < u64::MAX)
    }

    /// Passes an Ethernet frame, without its checksum, down the line at `now`; returns whether it
    /// returns. Its bytes are then those that the master receives.
    pub fn pass(&mut self, now: u64, frame: &mut [u8]) -> bool {
        self.world.advance(now);
        let mut first_logical = None;
        let checked = for_each_datagram(frame, |datagram| {
            if datagram.is_logical() {
                let address = datagram.logical_address();
                first_logical =
                    Some(first_logical.map_or(address, |first: u32| first.min(address)));
            }
        });
        match checked {
            Ok(()) => {}
            Err(FrameFault::NotEtherCat) => {
                self.statistics.foreign += 1;
                return false;
            }
            Err(_) => self.statistics.faulty += 1,
        }
        self.statistics.frames += 1;
        let faults =
            first_logical.map_or_else(CycleFaults::default, |address| self.faults_of(address));
        self.find_reached();
        if faults.lost == Some(LossDirection::Outward) || self.reached.is_empty() {
            self.statistics.lost += 1;
            return false;
        }
        let hops = self.reached.len() as u64 - 1;
        for (position, index) in (0..).zip(&self.reached) {
            let Some(controller) = self.controllers.get_mut(*index) else { continue };
            let return_ns = (position < hops).then(|| 2 * (hops - position) * HOP_NS);
            self.world.with_gateway(*index, |gateway, now| {
                let delay_ns = position * HOP_NS;
                controller.pass(frame, &mut Context { gateway, now, delay_ns, return_ns });
            });
        }
        if faults.counter_offset != 0 {
            let shift = |mut datagram: super::frame::Datagram<'_>| {
                if datagram.is_logical() {
                    datagram.shift_counter(faults.counter_offset);
                }
            };
            // faults were counted above
            let _ = for_each_datagram(frame, shift);
        }
        mark_as_processed(frame);
        if faults.lost == Some(LossDirection::Return) {
            self.statistics.lost += 1;
            return false;
        }
        true
    }

    /// Faults of a frame with process data. A cycle may have several frames: it begins with the
    /// lowest logical address, and all its frames have the same faults.
    fn faults_of(&mut self, address: u32) -> CycleFaults {
        if address <= self.lowest_logical {
            self.lowest_logical = address;
            self.faults = self.world.begin_cycle();
        }
        self.faults
    }

    fn find_reached(&mut self) {
        self.reached.clear();
        if !self.world.link_is_up() {
            return;
        }
        for index in 0..self.world.gateway_count() {
            if self.world.is_reachable(index) {
                self.reached.push(index);
            } else if self.world.line().topology() == Topology::Line {
                break;
            }
        }
    }
}
