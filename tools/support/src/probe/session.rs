//! A gateway in OP: its configuration, the images and SDO transfers of the probe, and the inputs of its cycles.

use std::sync::Arc;
use std::time::Duration;

use ecan_host::{
    Adapter, AdapterConfig, DcSync, Delivery, Ecrt, RegRequestId, RequestState, SdoRequestId,
    SlaveConfig, StartupPlan, StartupStep,
};
use ecan_protocol::can::CanFrame;
use ecan_protocol::config::{
    DataPathConfig, McanChannelConfig, SessionCommand, session_command_write,
};
use ecan_protocol::device::AlState;
use ecan_protocol::image::{
    CommitFields, Header, Image, ImageReader, ImageWriter, Packet, PdoProfile, SequenceTracker,
    Timestamp, TxResult,
};
use ecan_protocol::mapping::Direction;
use ecan_protocol::object::describe;

use super::outcome::{Interruption, Result, unavailable};
use super::sdo::size_of;

/// Function that decides whether to end the probe.
pub(crate) type Stop = Arc<dyn Fn() -> bool + Send + Sync>;

/// Cycles without any response that count as a lost link.
const SILENT_CYCLES: u32 = 100;
const SDO_TIMEOUT_MS: u32 = 3_000;
const REGISTER_BYTES: usize = 8;
/// AL status register; the AL status code follows 4 bytes later.
const AL_STATUS: u16 = 0x0130;
const REGISTER_CYCLES: u32 = 2_000;
const REGISTER_ATTEMPTS: u32 = 3;

/// Process data on the way from PREOP to OP.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct StartupWatch {
    pub(crate) cycles: u32,
    pub(crate) outputs_missed: u32,
    pub(crate) inputs_missed: u32,
    has_exchanged: bool,
}

impl StartupWatch {
    fn note(&mut self, adapter: &Adapter) {
        let report = adapter.domain_report(0);
        self.has_exchanged |= report.working_counter > 0;
        let is_op = adapter.slave_state(0).is_ok_and(|state| state.operational);
        if self.has_exchanged && !is_op {
            self.cycles += 1;
            self.outputs_missed += u32::from(report.outputs == Delivery::Missed);
            self.inputs_missed += u32::from(report.inputs == Delivery::Missed);
        }
    }
}

#[derive(Debug)]
pub(crate) struct Session {
    pub(crate) setup: Setup,
    pub(crate) adapter: Adapter,
    pub(crate) startup: StartupWatch,
    upload: SdoRequestId,
    registers: RegRequestId,
    /// Requests for downloads of 1, 2 and 4 bytes.
    downloads: [(usize, SdoRequestId); 3],
    writer: ImageWriter,
    reader: ImageReader,
    tracker: SequenceTracker,
    silent_cycles: u32,
    /// A gateway that leaves OP is expected not to respond.
    may_be_silent: bool,
    /// Time between receive and send, in ns.
    pub(crate) gap_ns: u64,
    /// Exchanges without response since the last [`Session::take_missed`].
    missed: u32,
    /// Next receptions that may have no response.
    uncounted: u32,
    /// Inputs of the cycles since the last [`Session::take`].
    received: Vec<Inputs>,
}

impl Session {
    pub(crate) fn open(
        ecrt: &Ecrt,
        master: u32,
        position: u16,
        setup: &Setup,
        stop: &Stop,
    ) -> Result<Self> {
        let mut adapter = Adapter::open(ecrt, setup.adapter(master, position), setup.startup())?;
        let should_stop = stop.clone();
        adapter.stop_waiting_when(Some(Box::new(move || should_stop())));
        let upload = adapter.requests().create_sdo(0, 4)?;
        let mut downloads = [(1, upload), (2, upload), (4, upload)];
        for (size, request) in &mut downloads {
            *request = adapter.requests().create_sdo(0, *size)?;
        }
        for request in downloads.iter().map(|download| download.1).chain([upload]) {
            adapter.requests().sdo_timeout(request, SDO_TIMEOUT_MS)?;
        }
        let registers = adapter.requests().create_register(0, REGISTER_BYTES)?;
        let mut session = Self {
            setup: setup.clone(),
            adapter,
            startup: StartupWatch::default(),
            upload,
            registers,
            downloads,
            writer: ImageWriter::new(Direction::RxPdo, setup.rx),
            reader: ImageReader::new(Direction::TxPdo, setup.tx),
            tracker: SequenceTracker::new(),
            silent_cycles: 0,
            may_be_silent: false,
            gap_ns: 0,
            missed: 0,
            uncounted: 0,
            received: Vec::new(),
        };
        session.reach_op()?;
        for direction in Direction::ALL {
            let reset = session_command_write(direction, SessionCommand::ResetAndClear);
            session.write(reset.index, reset.subindex, reset.value)?;
        }
        session.cycles(3)?;
        for channel in &setup.channels {
            let status = session.read(0x8001 + u16::from(channel.channel), 2)?;
            if status != 0 {
                let channel = channel.channel;
                return unavailable(format!("channel {channel}: apply status {status}"));
            }
        }
        session.take();
        Ok(session)
    }

    fn reach_op(&mut self) -> Result {
        let timeout = self.adapter.startup_timeout() * 2;
        let Self { adapter, writer, startup, .. } = self;
        adapter.wait_op_with(timeout, |adapter| {
            let received = adapter.receive();
            startup.note(adapter);
            let image = adapter.rx_pdo_mut(0);
            if !image.is_empty() {
                writer.commit(image, CommitFields::default());
            }
            adapter.send().and(received)
        })?;
        Ok(())
    }

    /// One cycle; `fill` adds frames to a new image.
    pub(crate) fn cycle(
        &mut self,
        fill: impl FnOnce(&mut ImageWriter, &mut [u8]),
    ) -> Result<&Inputs> {
        self.adapter.wait_next_cycle();
        self.exchange(fill, |_| ())
    }

    /// One cycle whose image `tamper` changes after its completion.
    pub(crate) fn cycle_tampered(&mut self, tamper: impl FnOnce(&mut [u8])) -> Result<&Inputs> {
        self.adapter.wait_next_cycle();
        self.exchange(|_, _| (), tamper)
    }

    /// One cycle that repeats the last image.
    pub(crate) fn cycle_repeated(&mut self) -> Result<&Inputs> {
        self.adapter.wait_next_cycle();
        self.receive()?;
        self.adapter.send()?;
        self.last()
    }

    /// Receives and sends at once, apart from the grid of cycles.
    pub(crate) fn exchange(
        &mut self,
        fill: impl FnOnce(&mut ImageWriter, &mut [u8]),
        tamper: impl FnOnce(&mut [u8]),
    ) -> Result<&Inputs> {
        self.receive()?;
        if self.gap_ns > 0 {
            let clock = self.adapter.clock();
            clock.sleep_until_ns(clock.now_ns() + self.gap_ns);
        }
        let image = self.adapter.rx_pdo_mut(0);
        if !image.is_empty() {
            fill(&mut self.writer, image);
            self.writer.commit(image, CommitFields::default());
            tamper(image);
        }
        let now_ns = self.adapter.clock().now_ns();
        let deadline_ns = self.adapter.cycle_start().deadline_ns;
        if let Some(inputs) = self.received.last_mut() {
            inputs.sent_ns = now_ns.saturating_sub(deadline_ns);
        }
        self.adapter.send()?;
        self.last()
    }

    fn last(&self) -> Result<&Inputs> {
        match self.received.last() {
            Some(inputs) => Ok(inputs),
            None => unavailable("no cycle yet"),
        }
    }

    fn receive(&mut self) -> Result {
        if self.adapter.should_stop() {
            return Err(Interruption::Stopped);
        }
        self.adapter.receive()?;
        let report = self.adapter.domain_report(0);
        let is_silent = report.working_counter == 0;
        self.silent_cycles = if is_silent { self.silent_cycles + 1 } else { 0 };
        self.missed += u32::from(is_silent && self.uncounted == 0);
        self.uncounted = self.uncounted.saturating_sub(1);
        if self.silent_cycles > SILENT_CYCLES && !self.may_be_silent {
            return Err(Interruption::LinkLost);
        }
        let mut inputs = Inputs {
            outputs: report.outputs,
            sent_ns: 0,
            header: None,
            frames: Vec::new(),
            results: Vec::new(),
        };
        if report.inputs != Delivery::Missed
            && let Ok(image) = self.reader.read(self.adapter.tx_pdo(0))
            && self.tracker.observe(image.sequence()).is_new()
        {
            inputs.take_packets(&image);
        }
        self.received.push(inputs);
        Ok(())
    }

    /// Cycles with empty images.
    pub(crate) fn cycles(&mut self, count: u32) -> Result {
        for _ in 0..count {
            self.cycle(|_, _| ())?;
        }
        Ok(())
    }

    /// The inputs since the last call.
    pub(crate) fn take(&mut self) -> Vec<Inputs> {
        std::mem::take(&mut self.received)
    }

    /// The next two receptions may find no response: an image is sent before the last one is back.
    pub(crate) fn expect_no_response(&mut self) {
        self.uncounted = 2;
    }

    /// Number of exchanges without response since the last call.
    pub(crate) fn take_missed(&mut self) -> u32 {
        std::mem::take(&mut self.missed)
    }

    /// Sequence of the last image.
    pub(crate) fn sequence(&self) -> u16 {
        self.writer.next_sequence().wrapping_sub(1)
    }

    pub(crate) fn read(&mut self, index: u16, subindex: u8) -> Result<u32> {
        self.adapter.requests().sdo_read(self.upload, index, subindex)?;
        self.finish(self.upload, "upload", index, subindex)?;
        let mut bytes = [0; 4];
        for (to, from) in bytes.iter_mut().zip(self.adapter.requests().sdo_data(self.upload)) {
            *to = *from;
        }
        Ok(u32::from_le_bytes(bytes))
    }

    /// The same while the gateway may be outside OP.
    pub(crate) fn read_while_silent(&mut self, index: u16, subindex: u8) -> Result<u32> {
        self.may_be_silent = true;
        let value = self.read(index, subindex);
        self.may_be_silent = false;
        value
    }

    pub(crate) fn write(&mut self, index: u16, subindex: u8, value: u32) -> Result {
        let size = size_of(index, subindex);
        let request = self
            .downloads
            .iter()
            .find(|download| download.0 == size)
            .map_or(self.upload, |download| download.1);
        let bytes = value.to_le_bytes();
        self.adapter.requests().sdo_write(request, index, subindex, &bytes[..size])?;
        self.finish(request, "download", index, subindex)
    }

    fn finish(&mut self, request: SdoRequestId, what: &str, index: u16, subindex: u8) -> Result {
        loop {
            self.cycle(|_, _| ())?;
            match self.adapter.requests().sdo_state(request)? {
                RequestState::Busy => {}
                RequestState::Success => return Ok(()),
                _ => return unavailable(format!("{what} of {} failed", describe(index, subindex))),
            }
        }
    }

    /// Reads 8 bytes of the slave controller's registers.
    pub(crate) fn read_registers(&mut self, address: u16) -> Result<[u8; REGISTER_BYTES]> {
        // A request fails if its datagram waited for too long, for example after a pause.
        for _ in 1..REGISTER_ATTEMPTS {
            match self.try_read_registers(address) {
                Err(Interruption::Unavailable(_)) => {}
                ended => return ended,
            }
        }
        self.try_read_registers(address)
    }

    fn try_read_registers(&mut self, address: u16) -> Result<[u8; REGISTER_BYTES]> {
        // Of `poll_al_status`.
        while self.adapter.requests().register_state(self.registers)? == RequestState::Busy {
            self.cycle(|_, _| ())?;
        }
        self.adapter.requests().register_read(self.registers, address, REGISTER_BYTES)?;
        for _ in 0..REGISTER_CYCLES {
            self.cycle(|_, _| ())?;
            if self.adapter.requests().register_state(self.registers)? != RequestState::Busy {
                break;
            }
        }
        if self.adapter.requests().register_state(self.registers)? != RequestState::Success {
            return unavailable(format!("register 0x{address:04X} was not read"));
        }
        let mut bytes = [0; REGISTER_BYTES];
        for (to, from) in
            bytes.iter_mut().zip(self.adapter.requests().register_data(self.registers))
        {
            *to = *from;
        }
        Ok(bytes)
    }

    /// AL state and AL status code of the slave controller.
    pub(crate) fn al_status(&mut self) -> Result<(Option<AlState>, u16)> {
        self.may_be_silent = true;
        let registers = self.read_registers(AL_STATUS);
        self.may_be_silent = false;
        let [state, _, _, _, low, high, ..] = registers?;
        Ok((AlState::from_status(state.into()), u16::from_le_bytes([low, high])))
    }

    /// AL status code if a reading of it has ended, else 0. Begins the next reading.
    pub(crate) fn poll_al_status(&mut self) -> Result<u16> {
        let code = match self.adapter.requests().register_state(self.registers)? {
            RequestState::Busy => return Ok(0),
            RequestState::Success => match self.adapter.requests().register_data(self.registers) {
                [_, _, _, _, low, high, ..] => u16::from_le_bytes([*low, *high]),
                _ => 0,
            },
            _ => 0,
        };
        self.adapter.requests().register_read(self.registers, AL_STATUS, REGISTER_BYTES)?;
        Ok(code)
    }

    /// Sends empty images until a condition is met, also without responses; returns whether it was.
    pub(crate) fn cycles_until(
        &mut self,
        limit: u32,
        is_met: impl Fn(&Adapter) -> bool,
    ) -> Result<bool> {
        for _ in 0..limit {
            self.adapter.wait_next_cycle();
            let received = self.adapter.receive();
            let image = self.adapter.rx_pdo_mut(0);
            if !image.is_empty() {
                self.writer.commit(image, CommitFields::default());
            }
            self.adapter.send().and(received)?;
            if self.adapter.should_stop() {
                return Err(Interruption::Stopped);
            }
            if is_met(&self.adapter) {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Clears the PDO errors of the RxPDO.
    pub(crate) fn clear_errors(&mut self) -> Result {
        let clear = session_command_write(Direction::RxPdo, SessionCommand::ClearErrors);
        self.write(clear.index, clear.subindex, clear.value)
    }
}

/// AssignActivate words: Sync0 alone, and with Sync1.
pub(crate) const SYNC0: u16 = 0x0300;
pub(crate) const SYNC0_AND_SYNC1: u16 = 0x0700;

/// Configuration of one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ChannelSetup {
    pub(crate) channel: u8,
    pub(crate) can: McanChannelConfig,
    pub(crate) data_path: DataPathConfig,
}

/// Configuration of a session.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Setup {
    pub(crate) rx: PdoProfile,
    pub(crate) tx: PdoProfile,
    pub(crate) cycle: Duration,
    pub(crate) sync0_shift: Option<Duration>,
    /// AssignActivate word with Sync0.
    pub(crate) assign_activate: u16,
    pub(crate) watchdog: Duration,
    pub(crate) channels: Vec<ChannelSetup>,
    pub(crate) is_applied: bool,
}

impl Setup {
    /// N = 1, 2 ms, without channels.
    pub(crate) fn plain() -> Self {
        let profile = PdoProfile { multiplier: 1, ..PdoProfile::default() };
        Self {
            rx: profile,
            tx: profile,
            cycle: Duration::from_millis(2),
            sync0_shift: None,
            assign_activate: SYNC0,
            watchdog: Duration::from_millis(100),
            channels: Vec::new(),
            is_applied: true,
        }
    }

    pub(crate) fn adapter(&self, master: u32, position: u16) -> AdapterConfig {
        let mut config = AdapterConfig::new(1)
            .with_multiplier(self.rx.multiplier)
            .with_cycle(self.cycle)
            .with_watchdog(self.watchdog);
        config.master_index = master;
        if let Some(slave) = config.slaves.iter_mut().next() {
            *slave = SlaveConfig {
                tx_multiplier: self.tx.multiplier,
                ..SlaveConfig::at(position, self.rx.multiplier)
            };
        }
        config.dc = self.sync0_shift.map(|shift| DcSync {
            assign_activate: self.assign_activate,
            ..DcSync::new(self.cycle, shift)
        });
        config
    }

    pub(crate) fn startup(&self) -> StartupPlan {
        let mut writes = Vec::new();
        writes.extend(self.tx.writes(Direction::TxPdo));
        writes.extend(self.rx.writes(Direction::RxPdo));
        if self.is_applied {
            writes.push(PdoProfile::apply_write(Direction::TxPdo));
            writes.push(PdoProfile::apply_write(Direction::RxPdo));
        }
        for ChannelSetup { channel, can, data_path } in &self.channels {
            writes.extend(can.needed_writes(*channel));
            writes.push(McanChannelConfig::apply_write(*channel));
            writes.extend(data_path.writes(*channel));
            writes.push(DataPathConfig::apply_write(*channel));
        }
        [writes.into_iter().map(StartupStep::Download).collect()].into_iter().collect()
    }
}

/// A received frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ReceivedFrame {
    pub(crate) channel: u8,
    pub(crate) frame: CanFrame,
    pub(crate) timestamp: Timestamp,
}

/// Inputs of one cycle.
#[derive(Clone, Debug)]
pub(crate) struct Inputs {
    /// Delivery of the last RxPDO image.
    pub(crate) outputs: Delivery,
    /// Time of the send of this cycle after its deadline, in ns.
    pub(crate) sent_ns: u64,
    /// Header of a new image.
    pub(crate) header: Option<Header>,
    pub(crate) frames: Vec<ReceivedFrame>,
    pub(crate) results: Vec<TxResult>,
}

impl Inputs {
    pub(crate) fn take_packets(&mut self, image: &Image<'_>) {
        self.header = Some(*image.header());
        for packet in image.packets().map_while(Result::ok) {
            match packet {
                Packet::Frame(packet) => self.frames.push(ReceivedFrame {
                    channel: packet.channel,
                    frame: packet.frame.to_owned(),
                    timestamp: packet.timestamp,
                }),
                Packet::TxResult(result) => self.results.push(result),
            }
        }
    }
}
