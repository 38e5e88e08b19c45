//! A run with many features is equal, to the nanosecond and the last bit, to the one whose digests
//! are stored here. A change for speed must not change them; a change of the simulated behaviour
//! needs new ones.

use crate::ecrt_support::{Program, frame, stepped};
use ecan_canopen::{NmtState, NodeId};
use ecan_protocol::can::{CanFrame, CanId, FrameKind};
use ecan_protocol::config::DataPathConfig;
use ecan_sim::{
    BusEvent, BusFault, BusFrame, CanBus, DriveFault, Fault, FaultyConfig, GatewayFault,
    LossDirection, NodeKind, NodeSpec, Scenario, ScriptedFault, StationConfig, StationMode, When,
    drives,
};

/// FNV-1a over 64 bits.
#[derive(Clone, Copy)]
struct Digest(u64);

impl Digest {
    const fn new() -> Self {
        Self(0xCBF2_9CE4_8422_2325)
    }

    fn bytes(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01B3);
        }
    }

    fn number(&mut self, number: u64) {
        self.bytes(&number.to_le_bytes());
    }

    fn numbers(&mut self, numbers: &[u64]) {
        numbers.iter().for_each(|number| self.number(*number));
    }

    fn frame(&mut self, frame: &CanFrame) {
        let kind = match frame.kind() {
            FrameKind::Data => 0,
            FrameKind::Remote => 1,
            FrameKind::Fd { brs, esi } => 2 + u64::from(brs) + 2 * u64::from(esi),
        };
        let id = frame.id();
        self.numbers(&[id.raw().into(), id.is_extended().into(), kind]);
        self.numbers(&[frame.dlc().value().into()]);
        self.bytes(frame.data());
    }

    fn event(&mut self, event: &BusEvent) {
        match event {
            BusEvent::Transmitted { station, frame, start_ns, at_ns } => {
                self.numbers(&[0, station.index() as u64, *start_ns, *at_ns]);
                self.frame(frame);
            }
            BusEvent::Received { station, frame, start_ns, at_ns } => {
                self.numbers(&[1, station.index() as u64, *start_ns, *at_ns]);
                self.frame(frame);
            }
            BusEvent::ErrorFrame { transmitter, at_ns } => {
                self.numbers(&[2, transmitter.index() as u64, *at_ns]);
            }
            BusEvent::Abandoned { station, frame, at_ns } => {
                self.numbers(&[3, station.index() as u64, *at_ns]);
                self.frame(frame);
            }
            BusEvent::StateChanged { station, state, at_ns } => {
                self.numbers(&[4, station.index() as u64, *state as u64, *at_ns]);
            }
        }
    }
}

/// SplitMix64.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        (z ^ z >> 31) % limit
    }
}

/// Any frame: each format, runs of equal bits as often as noise.
fn any_frame(random: &mut Random) -> CanFrame {
    let id = if random.below(3) == 0 {
        CanId::extended(random.below(1 << 29) as u32).unwrap()
    } else {
        CanId::standard(random.below(1 << 11) as u16).unwrap()
    };
    let fill = [0x00, 0xFF, 0x0F, 0x80][random.below(4) as usize];
    let mut data = [fill; 64];
    if random.below(2) == 0 {
        data.iter_mut().for_each(|byte| *byte = random.below(256) as u8);
    }
    match random.below(4) {
        0 => {
            let length = [0, 1, 8, 12, 16, 20, 24, 32, 48, 64][random.below(10) as usize];
            let (brs, esi) = (random.below(2) == 0, random.below(4) == 0);
            CanFrame::fd(id, &data[..length], brs, esi).unwrap()
        }
        _ => CanFrame::classic(id, &data[..random.below(9) as usize]).unwrap(),
    }
}

#[test]
fn bus_with_faults_keeps_its_digest() {
    let mut random = Random(1);
    let mut bus = CanBus::new("golden");
    let stations: [_; 7] = std::array::from_fn(|_| bus.attach());
    let fd = StationConfig::fd(1_000_000, 5_000_000);
    let odd = StationConfig::fd(1_000_000, 4_000_000);
    let configs = [
        fd,
        fd,
        StationConfig { auto_retransmit: false, ..fd },
        StationConfig { mode: StationMode::Listen, ..fd },
        StationConfig { mode: StationMode::InternalLoopback, ..fd },
        StationConfig { mode: StationMode::ExternalLoopback, ..fd },
        StationConfig::classic(1_000_000),
    ];
    for (station, config) in stations.iter().zip(configs) {
        bus.configure(0, *station, Some(config));
    }
    let mut digest = Digest::new();
    let (mut now, mut count) = (0, 0);
    let mut events = Vec::new();
    for round in 0..30_000u64 {
        let index = random.below(7) as usize;
        match random.below(200) {
            0 => bus.inject(BusFault::ErrorFrames { station: stations[index], count: 20 }),
            1 => bus.inject(BusFault::BusOff(stations[index])),
            2 => bus.configure(now, stations[index], None),
            3..=6 => bus.configure(now, stations[index], Some(configs[index])),
            7 => bus.configure(now, stations[6], Some(odd)),
            8..=11 => bus.withdraw(stations[index]),
            _ => {
                let frame = any_frame(&mut random);
                // without other stations the classic one would destroy most of its frames
                let frame = match frame.kind() {
                    FrameKind::Fd { .. } if round % 7 != 0 => {
                        let data = frame.data();
                        CanFrame::classic(frame.id(), &data[..data.len().min(8)]).unwrap()
                    }
                    _ => frame,
                };
                bus.offer(now, stations[index], frame);
            }
        }
        now += random.below(200_000);
        loop {
            events.clear();
            let reached = bus.advance(now, &mut events);
            for event in &events {
                digest.event(event);
                count += 1;
                if let BusEvent::StateChanged { station, .. } = event
                    && random.below(2) == 0
                {
                    bus.recover(reached, *station);
                }
            }
            if events.is_empty() && bus.next_event().is_none_or(|next| next > now) {
                break;
            }
        }
        let statistics = bus.statistics();
        digest.numbers(&[statistics.at_ns, statistics.frames, statistics.busy_ns]);
    }
    for station in stations {
        let (tec, rec) = bus.error_counters(station);
        let sums = bus.station_statistics(station);
        digest.numbers(&[tec.into(), rec.into(), sums.transmitted, sums.received]);
        digest.numbers(&[sums.transmit_errors, sums.receive_errors, sums.arbitrations_lost]);
        digest.number(sums.bus_offs);
    }
    assert!(count > 20_000, "{count} events");
    assert_eq!(digest.0, BUS_DIGEST, "{:#018X} after {count} events", digest.0);
}

const CHANNELS: usize = 4;
const CYCLES: u64 = 1_800;

/// Drives of all kinds at the first gateway; echo, faulty and more drive nodes at the second, whose
/// services have jitter.
fn scenario() -> Scenario {
    let mut scenario = drives(2, 3);
    scenario.seed = 0x601D;
    scenario.nodes.retain(|node| !matches!(node.bus.as_str(), "1.2" | "1.3"));
    for (index, node) in scenario.nodes.iter_mut().enumerate() {
        if let NodeKind::Drive(drive) = &mut node.kind {
            let config = &mut drive.config;
            config.motor.period_us = [1_000, 250, 1_000, 700][index % 4];
            config.enable_ms = [0, 0, 35][index % 3];
            config.motor.absolute_encoder = index % 5 != 0;
        }
    }
    let node = |name: &str, bus: &str, kind| NodeSpec {
        name: name.to_owned(),
        bus: bus.to_owned(),
        kind,
        bitrate: None,
        data_bitrate: None,
        physical_layer: None,
    };
    scenario.nodes.push(node("echo", "1.3", NodeKind::Echo));
    let bad = FaultyConfig {
        drop_permille: 100,
        corrupt_permille: 200,
        repeat_permille: 150,
        babble_us: 2_700,
    };
    scenario.nodes.push(node("bad", "1.2", NodeKind::Faulty(bad)));
    scenario.nodes.push(node("silent", "1.2", NodeKind::Silent));
    scenario.gateways[1].config.service_jitter_ns = 40_000;
    let drive = |node: &str, fault| Fault::Drive { node: node.to_owned(), fault };
    let faults = [
        (300, Fault::LostFrame { direction: LossDirection::Outward, cycles: 2 }),
        (310, Fault::LostFrame { direction: LossDirection::Return, cycles: 3 }),
        (330, Fault::WorkingCounterOffset { offset: -1, cycles: 2 }),
        (350, Fault::ErrorFrames { gateway: 0, channel: 1, frames: 9 }),
        (400, drive("drive 0.0/2", DriveFault::Error { code: 0x2310 })),
        (420, drive("drive 0.1/1", DriveFault::Emcy { code: 0x4310, register: 8 })),
        (440, drive("drive 0.2/3", DriveFault::Blocked { for_ms: 60 })),
        (460, drive("drive 0.3/1", DriveFault::PowerCycle { off_ms: 90 })),
        (500, Fault::BusOff { gateway: 0, channel: 2 }),
        (560, Fault::NodeSilent { node: "drive 0.3/2".to_owned(), for_ms: 40 }),
        (600, Fault::Gateway { gateway: 0, fault: GatewayFault::TornTxPdo { images: 2 } }),
        (620, Fault::Gateway { gateway: 0, fault: GatewayFault::CrcErrorTxPdo { images: 2 } }),
        (640, Fault::Gateway { gateway: 1, fault: GatewayFault::ServiceStall { ms: 12 } }),
        (700, Fault::LinkLoss { gateway: 1, for_ms: 30 }),
    ];
    scenario.faults.extend(
        faults.map(|(ms, fault)| ScriptedFault { when: When::At(5_000_000_000 + ms * MS), fault }),
    );
    scenario
}

const MS: u64 = 1_000_000;

/// An expedited download.
fn download(node: u8, index: u16, subindex: u8, size: u8, value: u32) -> CanFrame {
    let [low, high] = index.to_le_bytes();
    let mut bytes = [0x23 | (4 - size) << 2, low, high, subindex, 0, 0, 0, 0];
    bytes[4..].copy_from_slice(&value.to_le_bytes());
    frame(0x600 + u16::from(node), &bytes)
}

/// Commands of the drive with this number.
const MODES: [u8; 6] = [8, 3, 1, 6, 9, 10];

fn set_up(number: usize, node: u8) -> Vec<CanFrame> {
    let mode = MODES[number % MODES.len()];
    let target = match mode {
        3 | 9 => 0x60FF_0020,
        10 => 0x6071_0010,
        _ => 0x607A_0020,
    };
    let node16 = u32::from(node);
    vec![
        download(node, 0x1402, 1, 4, 0x8000_0400 + node16),
        download(node, 0x1402, 2, 1, 1),
        download(node, 0x1602, 0, 1, 0),
        download(node, 0x1602, 2, 4, target),
        download(node, 0x1602, 0, 1, 2),
        download(node, 0x1402, 1, 4, 0x400 + node16),
        download(node, 0x1802, 1, 4, 0x380 + node16),
        download(node, 0x1801, 2, 1, 254),
        download(node, 0x1801, 3, 2, 150),
        download(node, 0x1801, 1, 4, 0x280 + node16),
        download(node, 0x1017, 0, 2, 20 + node16),
        download(node, 0x6098, 0, 1, [35, 1, 17][number % 3]),
        download(node, 0x6060, 0, 1, mode.into()),
        // a read of a missing object, and a text in segments
        frame(0x600 + u16::from(node), &[0x40, 0x99, 0x99, 0, 0, 0, 0, 0]),
        frame(0x600 + u16::from(node), &[0x40, 0x08, 0x10, 0, 0, 0, 0, 0]),
        frame(0x600 + u16::from(node), &[0x60, 0, 0, 0, 0, 0, 0, 0]),
        frame(0x600 + u16::from(node), &[0x70, 0, 0, 0, 0, 0, 0, 0]),
    ]
}

/// Controlword and target at a cycle.
fn command(number: usize, cycle: u64) -> [u8; 6] {
    let controlword: u16 = match cycle {
        0..=110 => 0x06,
        111..=120 => 0x07,
        121..=150 => 0x0F,
        // sometimes a fault reset, a halt, a disable, a quick stop
        1_000..=1_004 | 1_300..=1_304 => 0x80,
        1_005..=1_020 | 1_305..=1_320 | 1_421..=1_440 => 0x06,
        1_021..=1_030 | 1_321..=1_330 | 1_441..=1_450 => 0x07,
        1_200..=1_230 => 0x10F,
        1_400..=1_420 => 0x02,
        _ if (cycle / 64).is_multiple_of(2) => 0x1F,
        _ => 0x0F,
    };
    let wave = |period: u64, height: i64| {
        let phase = (cycle % period) as i64;
        let period = period as i64;
        (if phase < period / 2 { phase } else { period - phase }) * 2 * height / period
    };
    let value = match MODES[number % MODES.len()] {
        3 | 9 => wave(500, 90_000) - 30_000,
        10 => wave(300, 400) - 150,
        1 => (cycle / 128 * 7_000) as i64 + 1_000 * number as i64,
        _ => 1_007 + 10_000 * (number as i64 / 3) + 1_000 * (number as i64 % 3) + wave(400, 3_000),
    } as i32;
    let mut bytes = [0; 6];
    bytes[..2].copy_from_slice(&controlword.to_le_bytes());
    bytes[2..].copy_from_slice(&value.to_le_bytes());
    bytes
}

/// Frames of the program in a cycle.
fn frames(cycle: u64, random: &mut Random) -> Vec<(usize, u8, CanFrame)> {
    let mut frames = Vec::new();
    for index in 0..6 {
        let (slave, channel) = (index / CHANNELS, (index % CHANNELS) as u8);
        if matches!(cycle, 106 | 900) {
            frames.push((slave, channel, frame(0, &[1, 0])));
        }
        for drive in 0..3u8 {
            let (number, node) = (3 * index + usize::from(drive), drive + 1);
            // some cycles apart, so that the responses have space
            if cycle >= 35 && (cycle - 35) % 4 == u64::from(drive) {
                let step = (cycle - 35) as usize / 4;
                frames.extend(set_up(number, node).get(step).map(|frame| (slave, channel, *frame)));
            }
            if cycle > 105 && cycle.is_multiple_of(2) {
                let bytes = command(number, cycle);
                let length = if MODES[number % MODES.len()] == 10 { 4 } else { 6 };
                let rpdo = frame(0x400 + u16::from(node), &bytes[..length]);
                frames.push((slave, channel, rpdo));
            }
        }
        if cycle > 20 && cycle.is_multiple_of(2) {
            frames.push((slave, channel, frame(0x080, &[])));
        }
        if cycle == 1_700 {
            frames.push((slave, channel, frame(0, &[0x81, 2])));
            frames.push((slave, channel, frame(0, &[0x80, 3])));
        }
    }
    for channel in [2, 3] {
        if random.below(3) == 0 {
            let bytes: [u8; 8] = std::array::from_fn(|_| random.below(256) as u8);
            let length = random.below(9) as usize;
            let raw = 0x100 + random.below(0x400) as u16;
            frames.push((1, channel, frame(raw, &bytes[..length])));
        }
    }
    frames
}

fn state(program: &Program, digest: &mut Digest) {
    program.simulation().with_world(|world| {
        digest.number(world.now_ns());
        for (_, drive) in world.drives() {
            digest.numbers(&[drive.position() as u64, drive.mechanical_position().to_bits()]);
            digest.numbers(&[drive.velocity().to_bits(), drive.torque().to_bits()]);
            let nmt_state = NmtState::ALL.iter().position(|state| *state == drive.nmt_state());
            digest.numbers(&[drive.statusword().0.into(), nmt_state.unwrap() as u64]);
            digest.numbers(&[drive.syncs(), drive.received_pdos(), drive.emergencies_sent()]);
            digest.numbers(&[drive.demand() as u64, drive.following_error() as u64]);
            digest.number(drive.error_code().into());
        }
        for gateway in 0..2 {
            let counters = world.counters(gateway).unwrap();
            digest.numbers(&[
                counters.images_parsed,
                counters.images_repeated,
                counters.images_faulty,
            ]);
            digest.numbers(&[
                counters.frames_on_bus,
                counters.frames_from_bus,
                counters.frames_to_master,
            ]);
            digest.numbers(&[counters.images_published, counters.images_read, counters.services]);
            for channel in 0..CHANNELS {
                let bus = world.bus_statistics(gateway, channel).unwrap();
                digest.numbers(&[bus.frames, bus.error_frames, bus.busy_ns]);
                digest.number(bus.identifier_collisions);
            }
        }
    });
}

struct Run {
    /// Every frame on one bus, with its times.
    recorded: Vec<BusFrame>,
    /// Everything else.
    state: u64,
    followed: u64,
}

fn run(gateway: usize, channel: usize) -> Run {
    let budgets = |_| {
        let config = DataPathConfig::for_traffic(8, 8);
        let write = |channel| config.writes(channel).chain([DataPathConfig::apply_write(channel)]);
        (0..CHANNELS as u8).flat_map(write).collect()
    };
    let mut program = Program::with_startup(stepped(scenario()), &[5, 5], budgets).into_op();
    program.simulation().with_world(|world| assert!(world.record_bus_of(gateway, channel)));
    // from here on the run has a fixed distance from the scripted faults
    let start = program.simulation().with_world(|world| world.start_ns());
    while program.next < start + 4_700 * MS {
        program.cycle();
    }
    let mut digest = Digest::new();
    let mut random = Random(7);
    for cycle in 0..CYCLES {
        if cycle == 900 {
            program.simulation().inject(Fault::PowerCycle { gateway: 1, off_ms: 30 });
        }
        program.cycle_with(&frames(cycle, &mut random));
        if cycle.is_multiple_of(16) {
            state(&program, &mut digest);
        }
    }
    for (slave, channel, frame) in &program.received {
        digest.numbers(&[*slave as u64, u64::from(*channel)]);
        digest.frame(frame);
    }
    let mut followed = 0;
    let recorded = program.simulation().with_world(|world| {
        for (_, drive) in world.drives() {
            followed += u64::from(drive.targets().sums().followed > 100);
            for record in drive.targets().iter() {
                digest.numbers(&[record.time_ns, record.target as u64, record.actual as u64]);
                digest.numbers(&[u64::from(record.followed), record.state as u64]);
            }
        }
        world.take_recorded()
    });
    Run { recorded, state: digest.0, followed }
}

#[test]
fn two_gateways_with_drives_keep_their_digest() {
    let mut digests = [0; 2 * CHANNELS];
    let mut counts = [0; 2 * CHANNELS];
    let mut states = [0; 2 * CHANNELS];
    for (index, digest) in digests.iter_mut().enumerate() {
        let run = run(index / CHANNELS, index % CHANNELS);
        let mut frames = Digest::new();
        for recorded in &run.recorded {
            frames.numbers(&[recorded.start_ns, recorded.end_ns]);
            frames.number(recorded.is_from_channel.into());
            frames.frame(&recorded.frame);
        }
        *digest = frames.0;
        counts[index] = run.recorded.len();
        assert!(run.followed >= 9, "{} drives followed targets", run.followed);
        states[index] = run.state;
    }
    assert!(counts.iter().all(|count| *count > 300), "{counts:?} frames");
    assert_eq!(states, [STATE_DIGEST; 2 * CHANNELS], "{states:#018X?}");
    assert_eq!(digests, FRAME_DIGESTS, "{digests:#018X?} of {counts:?} frames");
}

/// The node IDs are part of the digests.
#[test]
fn scenario_drives_are_found_at_their_nodes() {
    let simulation = stepped(scenario()).simulation.unwrap();
    simulation.with_world(|world| {
        for index in 0..6 {
            for node in 1..=3 {
                let id = NodeId::new(node).unwrap();
                assert!(world.drive_at(index / CHANNELS, index % CHANNELS, id).is_some());
            }
        }
    });
}

const BUS_DIGEST: u64 = 0xA374_26CA_8245_EDFE;
const STATE_DIGEST: u64 = 0x76FB_752C_92A3_3A2A;
const FRAME_DIGESTS: [u64; 2 * CHANNELS] = [
    0x6DB8_C169_881A_A39A,
    0x54BC_DFBA_314E_C958,
    0x613A_C99D_973A_FDDA,
    0x6178_AF7D_DF52_A572,
    0xCD38_F8A9_6A6E_E881,
    0x1B24_E034_6BFB_C2B6,
    0xF9C6_C75C_3A77_F67C,
    0x5267_BECF_A6F6_E7AC,
];
