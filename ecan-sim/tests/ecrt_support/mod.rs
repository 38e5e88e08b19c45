//! A program on the simulated library: configures slaves as in the manual, and runs cycles.
#![allow(dead_code)]

use ecan_host::{
    DomainId, DomainState, Master, SlaveConfigId, SlaveConfigState, SyncDirection, WatchdogMode,
    WcState,
};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::config::{McanChannelConfig, assignment_writes};
use ecan_protocol::image::{
    CommitFields, HeaderFlags, ImageReader, ImageWriter, Packet, PdoProfile, Timestamp,
};
use ecan_protocol::mapping::{Direction, data_object_index, pdo_map_index, sync_manager};
use ecan_protocol::object::{MAPPED_SUBINDEX, SdoWrite};
use ecan_sim::{
    Backend, ClockKind, GatewayCounters, Scenario, SimOptions, Simulation, echo, open_scenario,
};

/// Cycle time of the program.
pub const CYCLE_NS: u64 = 1_000_000;
/// Longest wait for OP in cycles.
pub const PATIENCE: usize = 5_000;

/// A library on stepped time.
pub fn stepped(scenario: Scenario) -> Backend {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    open_scenario(scenario, &options).expect("the scenario is good")
}

/// The built-in scenario on stepped time.
pub fn stepped_echo(gateways: usize) -> Backend {
    stepped(echo(gateways))
}

pub fn frame(id: u16, data: &[u8]) -> CanFrame {
    CanFrame::classic(CanId::standard(id).unwrap(), data).unwrap()
}

/// One configured slave.
pub struct Slave {
    pub config: SlaveConfigId,
    pub domain: DomainId,
    pub bytes: usize,
    pub writer: ImageWriter,
    reader: ImageReader,
    last_sequence: Option<u16>,
}

/// The program.
pub struct Program {
    pub backend: Backend,
    pub master: Master,
    pub slaves: Vec<Slave>,
    /// Frames received so far: slave, channel, frame.
    pub received: Vec<(usize, u8, CanFrame)>,
    pub next: u64,
}

impl Program {
    /// Reserves the master and configures one slave per multiplier, classic CAN at 500 kbit/s on
    /// all channels.
    pub fn new(backend: Backend, multipliers: &[u8]) -> Self {
        Self::with_startup(backend, multipliers, |_| Vec::new())
    }

    /// The same, with further startup SDOs.
    pub fn with_startup(
        backend: Backend,
        multipliers: &[u8],
        extra: impl Fn(usize) -> Vec<SdoWrite>,
    ) -> Self {
        let mut master = Master::request(&backend.ecrt, 0).expect("the master is free");
        let slaves = (0..multipliers.len())
            .map(|position| {
                configure(&mut master, position, multipliers[position], &extra(position))
            })
            .collect();
        let next = backend.ecrt.clock().now_ns();
        Self { backend, master, slaves, received: Vec::new(), next }
    }

    /// Activates, and runs cycles until every slave is in OP and its domain complete.
    pub fn into_op(mut self) -> Self {
        self.activate();
        assert!(self.reaches_op(), "not in OP: {:#?}", self.simulation().kernel_log());
        self
    }

    /// A program in OP with one gateway per multiplier, some cycles later.
    pub fn operational(multipliers: &[u8]) -> Self {
        let mut program = Self::new(stepped_echo(multipliers.len()), multipliers).into_op();
        program.cycles(5);
        program
    }

    pub fn activate(&mut self) {
        self.master.set_send_interval(1000).expect("set_send_interval");
        self.master.activate().expect("activate");
        self.next = self.backend.ecrt.clock().now_ns();
    }

    pub fn simulation(&self) -> &Simulation {
        self.backend.simulation.as_ref().expect("it is simulated")
    }

    /// Runs cycles with empty images until OP.
    pub fn reaches_op(&mut self) -> bool {
        (0..PATIENCE).any(|_| {
            self.cycle();
            (0..self.slaves.len()).all(|slave| {
                self.state(slave).operational && self.domain(slave).wc_state == WcState::Complete
            })
        })
    }

    pub fn state(&self, slave: usize) -> SlaveConfigState {
        self.master.config_state(self.slaves[slave].config).expect("config_state")
    }

    pub fn counters(&self, gateway: usize) -> GatewayCounters {
        self.simulation().with_world(|world| world.counters(gateway)).expect("it is a gateway")
    }

    /// AL state, error flag and AL status code of a gateway.
    pub fn al_status(&self, gateway: usize) -> (u8, bool, u16) {
        self.simulation().with_world(|world| {
            let gateway = world.gateway(gateway).expect("it is a gateway");
            (gateway.al_state().raw(), gateway.al_error(), gateway.al_status_code())
        })
    }

    pub fn domain(&self, slave: usize) -> DomainState {
        self.master.domain_state(self.slaves[slave].domain).expect("domain_state")
    }

    /// One cycle without CAN frames.
    pub fn cycle(&mut self) {
        self.cycle_with(&[]);
    }

    pub fn cycles(&mut self, count: usize) {
        (0..count).for_each(|_| self.cycle());
    }

    /// One cycle: receive, parse, write an image with these frames, send, sleep.
    pub fn cycle_with(&mut self, frames: &[(usize, u8, CanFrame)]) {
        self.master.receive().expect("receive");
        for index in 0..self.slaves.len() {
            let slave = &mut self.slaves[index];
            self.master.domain_process(slave.domain).expect("process");
            let state = self.master.domain_state(slave.domain).expect("state");
            let data = self.master.domain_data_mut(slave.domain);
            let (outputs, inputs) = data.split_at_mut(slave.bytes);
            if state.wc_state == WcState::Complete
                && let Ok(image) = slave.reader.read(inputs)
                && slave.last_sequence != Some(image.sequence())
            {
                slave.last_sequence = Some(image.sequence());
                for packet in image.packets() {
                    match packet.expect("the image was checked") {
                        Packet::Frame(packet) => {
                            let frame = packet.frame.to_owned();
                            self.received.push((index, packet.channel, frame));
                        }
                        Packet::TxResult(_) => {}
                    }
                }
            }
            slave.writer.begin();
            for (_, channel, frame) in frames.iter().filter(|(slave, ..)| *slave == index) {
                let frame = frame.as_ref();
                slave.writer.push(outputs, *channel, 0, frame, Timestamp::None).expect("room");
            }
            let fields = CommitFields {
                flags: HeaderFlags::default(),
                overflow: 0,
                channel_status: Default::default(),
            };
            slave.writer.commit(outputs, fields);
            self.master.domain_queue(slave.domain).expect("queue");
        }
        self.exchange();
    }

    /// Sends the queue and sleeps to the next cycle.
    pub fn exchange(&mut self) {
        let clock = self.backend.ecrt.clock();
        self.master.application_time(clock.now_ns()).expect("application_time");
        self.master.send().expect("send");
        self.next += CYCLE_NS;
        clock.sleep_until_ns(self.next);
    }

    /// Runs cycles until `count` frames were received, at most 200.
    pub fn receive_frames(&mut self, count: usize) {
        for _ in 0..200 {
            if self.received.len() >= count {
                return;
            }
            self.cycle();
        }
    }
}

fn configure(master: &mut Master, position: usize, n: u8, extra: &[SdoWrite]) -> Slave {
    let position = position as u16;
    let info = master.slave_info(position).expect("the slave is there");
    let domain = master.create_domain().expect("create_domain");
    let config =
        master.slave_config(0, position, info.vendor_id, info.product_code).expect("slave_config");
    let profile = PdoProfile { multiplier: n, ..PdoProfile::default() };
    let mut list: Vec<SdoWrite> = Vec::new();
    for direction in [Direction::RxPdo, Direction::TxPdo] {
        let sync = sync_manager(direction);
        let sync_direction = match direction {
            Direction::RxPdo => SyncDirection::Output,
            Direction::TxPdo => SyncDirection::Input,
        };
        master
            .config_sync_manager(config, sync, sync_direction, WatchdogMode::Default)
            .expect("sync");
        master.config_pdo_assign_clear(config, sync).expect("assign_clear");
        for chunk in 0..n {
            let pdo = pdo_map_index(direction, chunk);
            master.config_pdo_assign_add(config, sync, pdo).expect("assign_add");
            master.config_pdo_mapping_clear(config, pdo).expect("mapping_clear");
            for unit in 0..8 {
                let object = data_object_index(direction, chunk, unit);
                master
                    .config_pdo_mapping_add(config, pdo, object, MAPPED_SUBINDEX, 128)
                    .expect("mapping_add");
            }
        }
        let first = data_object_index(direction, 0, 0);
        let offset = master
            .config_reg_pdo_entry(config, first, MAPPED_SUBINDEX, domain)
            .expect("reg_pdo_entry");
        let bytes = usize::from(n) * 128;
        assert_eq!(offset, if direction == Direction::RxPdo { 0 } else { bytes });
        list.extend(assignment_writes(direction, n));
    }
    for direction in [Direction::TxPdo, Direction::RxPdo] {
        list.extend(profile.writes(direction));
        list.push(PdoProfile::apply_write(direction));
    }
    for channel in 0..4 {
        list.extend(McanChannelConfig::classic(500_000).writes(channel));
        list.push(McanChannelConfig::apply_write(channel));
    }
    list.extend_from_slice(extra);
    for write in list {
        let (bytes, size) = write.bytes();
        master.config_sdo(config, write.index, write.subindex, &bytes[..size]).expect("config_sdo");
    }
    Slave {
        config,
        domain,
        bytes: usize::from(n) * 128,
        writer: ImageWriter::new(Direction::RxPdo, profile),
        reader: ImageReader::new(Direction::TxPdo, profile),
        last_sequence: None,
    }
}
