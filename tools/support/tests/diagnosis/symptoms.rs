//! Symptoms of manual 5.4.6 and 16.1 to 16.3, each provoked on a simulated gateway, and the finding that
//! leads to the check of the manual.

use std::path::Path;
use std::time::Duration;

use crate::diagnosis::gateway_snapshot::snapshot_of;
use ecan_host::{AdapterConfig, DcSync, Diagnostics, Ecrt};
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::config::{DataSize, NodeMode, NonMatch};
use ecan_protocol::image::{BudgetPolicy, PdoProfile};
use ecan_protocol::mapping::Direction;
use ecan_protocol::object::lookup;
use ecan_sim::{ClockKind, Fault, Gateway, GatewayFault, Scenario, SimOptions, Simulation};
use ecan_tool_support::diagnosis::{Finding, findings};

const ECHO: &str = "[[node]]\nkind = \"echo\"\nbus = \"0.0\"\n";

struct Bench {
    ecrt: Ecrt,
    simulation: Simulation,
    port: Option<Port>,
}

impl Bench {
    /// A gateway in PREOP with these keys and nodes.
    fn new(keys: &str) -> Self {
        let text = format!("[[gateway]]\n{keys}");
        let scenario = Scenario::from_toml(&text, "symptom", Path::new(".")).unwrap();
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(scenario, &options).unwrap();
        Self { ecrt: backend.ecrt, simulation: backend.simulation.unwrap(), port: None }
    }

    /// Configures and starts the gateway, which may fail.
    fn start(mut self, adapter: AdapterConfig, gateway: GatewayConfig) -> Self {
        let config = (adapter, PortConfig::uniform(1, gateway));
        let mut port = Port::open(&self.ecrt, config).unwrap();
        let _ = port.wait_ready_timeout(Duration::from_secs(5));
        self.port = Some(port);
        self
    }

    /// In OP, with an echo node on channel 0.
    fn with(channel: ChannelConfig) -> Self {
        let bench = Self::new(ECHO).start(adapter(), GatewayConfig::on_channel(0, channel));
        assert!(bench.port.as_ref().unwrap().is_ready());
        bench
    }

    /// Cycles in which channel 0 sends frames, as many as it can.
    fn send(mut self, cycles: usize) -> Self {
        let id = CanId::standard(0x123).unwrap();
        let frame = CanFrame::classic(id, &[0x5A; 8]).unwrap();
        for _ in 0..cycles {
            let mut cycle = self.port.as_mut().unwrap().next_cycle();
            cycle.received().for_each(drop);
            let channel = cycle.channel(0, 0).unwrap();
            while cycle.send(channel, &frame).is_ok() {}
            cycle.finish();
        }
        self
    }

    /// Cycles without frames of the application.
    fn pause(mut self, cycles: usize) -> Self {
        for _ in 0..cycles {
            let mut cycle = self.port.as_mut().unwrap().next_cycle();
            cycle.received().for_each(drop);
            cycle.finish();
        }
        self
    }

    fn gateway<R>(&self, look: impl FnOnce(&mut Gateway, u64) -> R) -> R {
        self.simulation.with_world(|world| world.with_gateway(0, look)).unwrap()
    }

    fn inject(self, fault: GatewayFault) -> Self {
        self.simulation.inject(Fault::Gateway { gateway: 0, fault });
        self
    }

    /// Writes objects, as another master might.
    fn write(self, values: &[(u16, u8, u32)]) -> Self {
        for &(index, subindex, value) in values {
            let entry = lookup(index, subindex).map(|(_, entry)| entry.ty.size_bytes());
            let size = entry.flatten().unwrap_or(2);
            let bytes = value.to_le_bytes();
            let write = |gateway: &mut Gateway, now| {
                gateway.sdo_download(now, index, subindex, &bytes[..size])
            };
            self.gateway(write).unwrap_or_else(|e| panic!("0x{index:04X}:{subindex}: {e}"));
        }
        self
    }

    /// Writes images into SM2, as a master without this SDK might; the last one stays.
    fn images(self, images: &[Vec<u8>]) -> Self {
        for image in images {
            self.simulation.pass_ns(300_000);
            assert!(self.gateway(|gateway, now| gateway.write_outputs(now, image)));
        }
        self.simulation.pass_ns(300_000);
        self
    }

    fn findings(&self) -> Vec<Finding> {
        let info = Diagnostics::of_bus(&self.ecrt, 0).unwrap().slave_info(0).unwrap();
        let mut snapshot = self.gateway(|gateway, now| {
            let mut snapshot = snapshot_of(gateway, now);
            let registers = |number| {
                let mut bytes = [0; 8];
                if let Some(manager) = gateway.sync_manager(number) {
                    bytes[..2].copy_from_slice(&manager.start.to_le_bytes());
                    bytes[2..4].copy_from_slice(&manager.length.to_le_bytes());
                    bytes[4] = manager.control;
                }
                bytes
            };
            snapshot.sync_managers = Some([registers(2), registers(3)]);
            snapshot
        });
        snapshot.has_error_flag = info.error_flag;
        findings(&snapshot)
    }
}

fn adapter() -> AdapterConfig {
    AdapterConfig::new(1).with_multiplier(3).with_cycle(Duration::from_millis(1))
}

fn classic() -> ChannelConfig {
    ChannelConfig::classic(500_000)
}

fn fd() -> ChannelConfig {
    ChannelConfig::fd(1_000_000, 2_000_000)
}

/// A gateway with a Sync0 shift among the arrivals of the outputs.
fn small_shift(keys: &str) -> Bench {
    let mut adapter = adapter();
    adapter.dc = Some(DcSync::new(adapter.cycle, Duration::from_micros(90)));
    Bench::new(&format!("{keys}\n{ECHO}"))
        .start(adapter, GatewayConfig::on_channel(0, classic()))
        .send(50)
}

/// CRC-16/CCITT-FALSE.
fn crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte) << 8, |crc, _| {
            if crc & 0x8000 != 0 { crc << 1 ^ 0x1021 } else { crc << 1 }
        })
    })
}

/// An RxPDO image for N = 3 and channel 0.
fn image(sequence: u16, payload: &[u8]) -> Vec<u8> {
    let profile = PdoProfile { multiplier: 3, channel_mask: 0x01, ..PdoProfile::default() };
    image_of(profile, sequence, payload)
}

/// An RxPDO image of any profile with N = 3, written byte by byte (manual 5.4.4).
fn image_of(profile: PdoProfile, sequence: u16, payload: &[u8]) -> Vec<u8> {
    let word = profile.word();
    let layout_id = (word ^ word >> 16) as u16;
    let mut image = vec![0; 384];
    let words = [sequence, sequence, payload.len() as u16, crc(payload), layout_id];
    image[0] = 0x16;
    for (to, word) in image[2..12].chunks_mut(2).zip(words) {
        to.copy_from_slice(&word.to_le_bytes());
    }
    (image[12], image[13], image[15]) = (profile.channel_mask, 1, 1);
    image[24..24 + payload.len()].copy_from_slice(payload);
    image
}

/// A frame packet of channel 0 with CAN ID 0x123 and 8 bytes.
const PACKET: [u8; 12] = [0x40, 0x00, 0x23, 0x01, 1, 2, 3, 4, 5, 6, 7, 8];

fn packet(change: impl FnOnce(&mut [u8; 12])) -> Vec<u8> {
    let mut packet = PACKET;
    change(&mut packet);
    packet.to_vec()
}

fn parsed(images: &[Vec<u8>]) -> Bench {
    Bench::with(classic()).images(images)
}

fn changed(change: impl FnOnce(&mut Vec<u8>)) -> Bench {
    let mut image = image(9, &PACKET);
    change(&mut image);
    parsed(&[image])
}

/// Profile values of one direction in PREOP, applied.
fn profile(values: &[(u8, u32)]) -> Bench {
    let writes: Vec<_> =
        values.iter().map(|(subindex, value)| (0x8011, *subindex, *value)).collect();
    Bench::new("").write(&writes)
}

/// The assignment of the first N chunks, then the profiles with masks per direction, then channel 0.
fn configured(chunks: u8, [tx_mask, rx_mask]: [u32; 2]) -> Bench {
    let mut values = Vec::new();
    for (assignment, first, direction, mask) in
        [(0x1C13, 0x1A00, Direction::TxPdo, tx_mask), (0x1C12, 0x1600, Direction::RxPdo, rx_mask)]
    {
        values.push((assignment, 0, 0));
        values.extend((0..chunks).map(|at| (assignment, at + 1, first + u32::from(at))));
        values.push((assignment, 0, chunks.into()));
        let object = direction.profile_object();
        values.extend([(object, 3, chunks.into()), (object, 4, mask), (object, 1, 1)]);
    }
    Bench::new("").write(&values)
}

/// Symptom, chapter of the manual, finding, text of its first cause, and how it is provoked.
type Symptom = (&'static str, &'static str, &'static str, &'static str, fn() -> Bench);

const SYMPTOMS: &[Symptom] = &[
    (
        "SM2 of the SII starts elsewhere: no SAFEOP",
        "16.1",
        "sync-manager-layout",
        "the SII has a wrong layout",
        || {
            Bench::new("sii_sm2.start = 0x1180")
                .start(adapter(), GatewayConfig::on_channel(0, classic()))
        },
    ),
    (
        "SM3 of the SII has another control byte: no SAFEOP",
        "16.1",
        "sync-manager-layout",
        "the SII has a wrong layout",
        || {
            Bench::new("sii_sm3.control = 0x20")
                .start(adapter(), GatewayConfig::on_channel(0, classic()))
        },
    ),
    (
        "0x1C12 or 0x1C13 assigns another number of chunks than N",
        "16.1",
        "assignment-differs",
        "selects another number of chunks",
        || configured(3, [0x01; 2]).write(&[(0x1C12, 0, 0), (0x1C12, 0, 2)]),
    ),
    (
        "the profile was applied before the assignment: 0x8010/0x8011:02 = 5",
        "5.4.6",
        "profile-mapping-reload",
        "",
        || profile(&[(3, 3), (1, 1)]),
    ),
    (
        "N is larger than the master sends in one datagram",
        "16.1",
        "images-large",
        "does not split process data",
        || configured(12, [0x01; 2]),
    ),
    (
        "the DC shift is too small: incomplete working counters",
        "16.1",
        "sync-shift-small",
        "the DC shift is too small",
        || small_shift("sync0_window.missed_limit = 0"),
    ),
    (
        "the DC shift is too small: OP is lost",
        "16.1",
        "al-sync",
        "the DC shift is too small",
        || small_shift(""),
    ),
    (
        "the application stops sending process data",
        "16.1",
        "al-watchdog",
        "the application stopped",
        || {
            let bench = Bench::with(classic()).send(10);
            bench.simulation.pass_ns(200_000_000);
            bench
        },
    ),
    (
        "the DC shift is too small: the watchdog runs out",
        "16.1",
        "al-watchdog",
        "the DC shift is too small",
        || {
            small_shift("sync0_window.missed_limit = 0")
                .inject(GatewayFault::AlError { code: 0x1B })
        },
    ),
    (
        "FMMUs or domains do not cover the process data",
        "16.1",
        "al-sync-manager",
        "the FMMUs do not",
        || Bench::with(classic()).send(10).inject(GatewayFault::AlError { code: 0x1E }),
    ),
    ("a startup SDO is aborted", "16.1", "state-error", "a startup SDO was aborted", || {
        let abort =
            GatewayFault::SdoAbort { index: 0x8001, subindex: 19, code: 0x0609_0030, times: 1000 };
        Bench::new("").inject(abort).start(adapter(), GatewayConfig::on_channel(0, classic()))
    }),
    ("the layout is changed in OP: 0x8010/0x8011:02 = 1", "5.4.2", "profile-state", "", || {
        Bench::with(classic()).write(&[(0x8011, 3, 4), (0x8011, 1, 1)])
    }),
    ("the channel mask is 0: 0x8010/0x8011:02 = 3", "13.2", "profile-mask", "", || {
        profile(&[(4, 0), (1, 1)])
    }),
    (
        "the encapsulation profile does not exist: 0x8010/0x8011:02 = 4",
        "9",
        "profile-encapsulation",
        "",
        || profile(&[(5, 2), (1, 1)]),
    ),
    (
        "the profile was written and not applied: 0x8010/0x8011:02 = 9",
        "13.2",
        "profile-pending",
        "",
        || profile(&[(3, 4)]),
    ),
    ("an option flag is not supported: 0x8010/0x8011:02 = 10", "9.1", "profile-option", "", || {
        profile(&[(7, 0x80), (1, 1)])
    }),
    (
        "fixed 64-byte window outside profiles 4 and 5: PDO error 2",
        "16.2",
        "pdo-frame-overrun",
        "longer than the profile supports",
        || {
            let mut payload = packet(|bytes| (bytes[0], bytes[1]) = (0x40, 0x81));
            payload.resize(68, 0);
            parsed(&[image(9, &payload)])
        },
    ),
    (
        "a packet ends beyond the frame area: PDO error 3",
        "16.2",
        "pdo-packet-overrun",
        "more packets were written",
        || {
            let mut payload = PACKET.repeat(29);
            payload.extend([0x78, 0x01, 0x23, 0x01, 0, 0, 0, 0, 0, 0, 0, 0]);
            let mut image = image(9, &payload);
            image[13] = 30;
            parsed(&[image])
        },
    ),
    (
        "a packet has an unknown kind: PDO error 4",
        "16.2",
        "pdo-unknown-kind",
        "starts at the wrong byte",
        || parsed(&[image(9, &packet(|bytes| bytes[1] = 0x60))]),
    ),
    ("a classic frame has DLC 9: PDO error 5", "16.2", "pdo-invalid-dlc", "a DLC above 8", || {
        parsed(&[image(9, &packet(|bytes| bytes[0] = 9 << 3))])
    }),
    (
        "a frame is for a channel outside the mask: PDO error 6",
        "16.2",
        "pdo-invalid-channel",
        "not in the mask 0x8011:04",
        || parsed(&[image(9, &packet(|bytes| bytes[0] |= 2))]),
    ),
    (
        "a timestamp is not in the profile: PDO error 7",
        "16.2",
        "pdo-invalid-timestamp",
        "a timestamp format",
        || parsed(&[image(9, &packet(|bytes| bytes[1] = 1 << 3))]),
    ),
    (
        "payload_len ends inside a packet: PDO error 8",
        "16.2",
        "pdo-truncated",
        "payload_len ends inside a packet",
        || parsed(&[image(9, &PACKET[..8])]),
    ),
    (
        "the sequence does not change with the image: PDO error 10",
        "16.2",
        "pdo-duplicate",
        "does not increment seq_begin",
        || parsed(&[image(9, &PACKET), image(9, &packet(|bytes| bytes[4] = 9))]),
    ),
    (
        "layout_id is that of another profile: PDO error 12",
        "16.2",
        "pdo-active-area",
        "layout_id in the header",
        || changed(|image| image[10] ^= 1),
    ),
    (
        "a reserved bit is set: PDO error 13",
        "16.2",
        "pdo-reserved-bit",
        "a bit that must be 0",
        || parsed(&[image(9, &packet(|bytes| bytes[3] |= 0x40))]),
    ),
    (
        "the image is all zero, without a header: PDO error 14",
        "16.2",
        "pdo-bad-header",
        "no complete header is written",
        || parsed(&[vec![0; 384]]),
    ),
    (
        "seq_begin and seq_end differ: PDO error 14",
        "16.2",
        "pdo-bad-header",
        "no complete header is written",
        || changed(|image| image[4] ^= 1),
    ),
    (
        "payload_crc16 is wrong: PDO error 15",
        "16.2",
        "pdo-bad-crc",
        "does not cover exactly the bytes",
        || changed(|image| image[8] ^= 1),
    ),
    (
        "a frame is scheduled without Sync0: PDO error 16",
        "16.2",
        "pdo-bad-schedule",
        "Sync0 is not active",
        || {
            let mut payload = vec![0x40, 3 << 3, 0x23, 0x01, 1, 0, 0, 0];
            payload.extend(100_000_u32.to_le_bytes());
            payload.extend([0; 8]);
            parsed(&[image(9, &payload)])
        },
    ),
    (
        "a channel has more frames in an image than its share of the RxPDO",
        "16.2",
        "pdo-overflow",
        "0x8011:06 is 2 (Deterministic)",
        || {
            let mut gateway = GatewayConfig::on_all_channels(classic());
            gateway.rx_budget = BudgetPolicy::Deterministic;
            let profile =
                PdoProfile { multiplier: 3, budget: gateway.rx_budget, ..PdoProfile::default() };
            let mut image = image_of(profile, 9, &PACKET.repeat(12));
            image[13] = 12;
            let keys = format!("[gateway.variant]\nrx_budget = \"applied\"\n{ECHO}");
            Bench::new(&keys).start(adapter(), gateway).images(&[image])
        },
    ),
    (
        "more frames arrive than the TxPDO carries: error of 0x8010:14",
        "16.2",
        "pdo-packet-overrun",
        "a received frame does not fit",
        || {
            let mut gateway = GatewayConfig::on_all_channels(classic());
            gateway.tx_budget = BudgetPolicy::Deterministic;
            gateway.rx_budget = BudgetPolicy::SharedOnly;
            Bench::new(ECHO).start(adapter().with_multiplier(1), gateway).send(50)
        },
    ),
    ("APP_BYPASS is active: CAN is not sent or received", "9.1", "app-bypass", "", || {
        configured(3, [0x01; 2]).write(&[(0x8011, 7, 0x08), (0x8011, 1, 1)])
    }),
    (
        "a test of 0x8030 is active: CAN is not sent or received",
        "13.2.3",
        "diagnostic-test",
        "",
        || Bench::new("").write(&[(0x8030, 1, 0x4543_414E), (0x8030, 3, 0x20)]),
    ),
    ("the channel mask excludes sending: CAN is not sent", "5.4.6", "cannot-send", "", || {
        configured(3, [0x01, 0x02]).write(&[(0x8001, 1, 1)])
    }),
    (
        "the channel mask excludes receiving: CAN cannot be received",
        "5.4.6",
        "cannot-receive",
        "",
        || configured(3, [0x02, 0x01]).write(&[(0x8001, 1, 1)]),
    ),
    (
        "the channel was not applied: CAN is not sent or received",
        "5.4.6",
        "channel-off",
        "",
        || configured(3, [0x01; 2]),
    ),
    (
        "the configuration of the channel is impossible: CAN is not sent or received",
        "13.4",
        "apply-failed",
        "Message RAM layout needs ",
        || configured(3, [0x01; 2]).write(&[(0x8001, 62, 64), (0x8001, 64, 64), (0x8001, 1, 1)]),
    ),
    ("no filter accepts a frame: CAN cannot be received", "5.4.6", "rejects-all", "", || {
        let mut channel = classic();
        (channel.can.non_match_standard, channel.can.non_match_extended) =
            (NonMatch::Reject, NonMatch::Reject);
        Bench::with(channel).send(20)
    }),
    (
        "FD frames come into elements of 8 bytes: their data are truncated",
        "13.4",
        "short-elements",
        "",
        || {
            let mut channel = fd();
            channel.can.ram.rx_fifo0.data_size = DataSize::B8;
            Bench::with(channel)
        },
    ),
    (
        "the data path of the channel is disabled (0x8021:01 = 0)",
        "13.2.2",
        "data-path-off",
        "",
        || Bench::with(classic()).write(&[(0x8021, 1, 0), (0x8021, 2, 1)]),
    ),
    (
        "the channel listens only: no acknowledgement, nothing is sent",
        "13.4",
        "node-mode",
        "",
        || {
            let mut channel = classic();
            channel.can.node_mode = NodeMode::Listen;
            Bench::with(channel)
        },
    ),
    ("no other node is on the bus", "16.3", "no-acknowledge", "no other active node", || {
        Bench::new("").start(adapter(), GatewayConfig::on_channel(0, classic())).send(300)
    }),
    ("a node has another bit rate", "16.3", "no-acknowledge", "or with another rate", || {
        let node = format!("{ECHO}bitrate = 250000\n");
        Bench::new(&node).start(adapter(), GatewayConfig::on_channel(0, classic())).send(300)
    }),
    (
        "the channel is in Non-ISO mode",
        "16.3",
        "error-passive",
        "in Non-ISO mode (0x8001:09 = 1)",
        || {
            let (mut channel, directory) = (fd(), tempfile::tempdir().unwrap());
            channel.can.non_iso = true;
            let log = directory.path().join("fd.log");
            let line = |n| format!("({}.{:02}0000) can0 123##0112233\n", n / 100, n % 100);
            std::fs::write(&log, (0..2_000).map(line).collect::<String>()).unwrap();
            let node = format!(
                "[[node]]\nkind = \"replay\"\nbus = \"0.0\"\nfile = {log:?}\n\
             bitrate = 1000000\ndata_bitrate = 2000000\n"
            );
            Bench::new(&node).start(adapter(), GatewayConfig::on_channel(0, channel)).pause(50)
        },
    ),
    ("bus-off", "16.3", "bus-off", "short-circuited or swapped", || {
        let bench = Bench::with(classic());
        bench.simulation.inject(Fault::BusOff { gateway: 0, channel: 0 });
        bench
    }),
    ("bus-off in the past", "16.3", "bus-off-past", "a loose contact", || {
        let bench = Bench::with(classic());
        bench.simulation.inject(Fault::BusOff { gateway: 0, channel: 0 });
        bench.send(500)
    }),
    (
        "frames arrive faster than the gateway passes them on",
        "16.3",
        "receive-loss",
        "than the drain budget",
        || {
            Bench::with(ChannelConfig::classic(1_000_000))
                .write(&[(0x8021, 5, 1), (0x8021, 2, 1)])
                .send(500)
        },
    ),
    ("the range of the sample point is wide", "5.4.3", "sample-point-range", "", || {
        configured(3, [0x01; 2]).write(&[(0x8001, 1, 1)])
    }),
    ("TDC offset without filter, or filter without offset", "13.4", "tdc-unpaired", "", || {
        let mut channel = ChannelConfig::fd(1_000_000, 5_000_000);
        channel.can.tdc_filter = 4;
        Bench::with(channel)
    }),
];

#[test]
fn each_symptom_leads_to_the_check_of_the_manual() {
    let mut failed = Vec::new();
    for (symptom, chapter, id, cause, provoke) in SYMPTOMS {
        let found = provoke().findings();
        let finding = found.iter().find(|finding| finding.id == *id);
        let ids: Vec<_> = found.iter().map(|finding| (finding.id, finding.chapter)).collect();
        match finding {
            Some(finding) if finding.chapter.split(", ").any(|part| part == *chapter) => {
                assert!(!finding.causes.is_empty() && !finding.next.is_empty(), "{finding:#?}");
                if !finding.causes[0].contains(cause) {
                    failed.push(format!("{symptom}: {cause}, found {:?}", finding.causes));
                }
            }
            _ => failed.push(format!("{symptom}: {id} ({chapter}), found {ids:?}")),
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}
