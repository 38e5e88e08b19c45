//! A gateway without EtherCAT frames or CAN bus: SDO shorthand, startup to OP, and cycles.
#![allow(dead_code)]

use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::config::{DataPathConfig, McanChannelConfig, assignment_writes};
use ecan_protocol::device::AlState;
use ecan_protocol::image::{
    CommitFields, Image, ImageReader, ImageWriter, Packet, PdoProfile, Timestamp, TxResult,
};
use ecan_protocol::mapping::{
    CHANNELS, Direction, sync_manager, sync_manager_address, sync_manager_control,
};
use ecan_protocol::object::{AbortCode, SdoWrite};
use ecan_sim::{Gateway, GatewayModelConfig, Sync0, SyncManagerConfig};

pub const MS: u64 = 1_000_000;
/// Time from an SM2 write to the end of its service.
pub const SERVICE: u64 = 30_000;

pub struct Fixture {
    pub gateway: Gateway,
    pub now: u64,
    pub writer: ImageWriter,
    pub reader: ImageReader,
    pub image: Vec<u8>,
    pub input: Vec<u8>,
}

/// The default profile with another number of chunks.
pub fn chunks(multiplier: u8) -> PdoProfile {
    PdoProfile { multiplier, ..PdoProfile::default() }
}

pub fn standard(id: u16, data: &[u8]) -> CanFrame {
    CanFrame::classic(CanId::standard(id).unwrap(), data).unwrap()
}

pub fn fd(id: u16, data: &[u8]) -> CanFrame {
    CanFrame::fd(CanId::standard(id).unwrap(), data, true, false).unwrap()
}

impl Fixture {
    /// Booted, in PREOP, nothing configured.
    pub fn preop() -> Self {
        Self::preop_with(GatewayModelConfig::default())
    }

    pub fn preop_with(config: GatewayModelConfig) -> Self {
        let profile = PdoProfile::default();
        let mut fixture = Self {
            gateway: Gateway::new(config, 1),
            now: 1_000 * MS,
            writer: ImageWriter::new(Direction::RxPdo, profile),
            reader: ImageReader::new(Direction::TxPdo, profile),
            image: vec![0; profile.pdo_bytes()],
            input: vec![0; profile.pdo_bytes()],
        };
        fixture.gateway.power(fixture.now, true);
        fixture.pass(1_000 * MS);
        fixture.set_up_mailboxes();
        fixture.gateway.request_al_state(fixture.now, AlState::PreOp);
        assert_eq!(fixture.gateway.al_state(), AlState::PreOp);
        fixture
    }

    /// As a master does in INIT.
    pub fn set_up_mailboxes(&mut self) {
        let sm = |start, control| SyncManagerConfig { start, length: 0x80, control };
        self.gateway.configure_sync_manager(0, Some(sm(0x1000, 0x26)));
        self.gateway.configure_sync_manager(1, Some(sm(0x1080, 0x22)));
    }

    /// In OP with these profiles and all channels at 1 and 5 Mbit/s.
    pub fn op(tx: PdoProfile, rx: PdoProfile) -> Self {
        let mut fixture = Self::configured(tx, rx);
        fixture.start();
        fixture
    }

    /// In PREOP with these profiles applied, sync managers configured and all channels running.
    pub fn configured(tx: PdoProfile, rx: PdoProfile) -> Self {
        Self::configured_with(GatewayModelConfig::default(), tx, rx)
    }

    pub fn configured_with(config: GatewayModelConfig, tx: PdoProfile, rx: PdoProfile) -> Self {
        let mut fixture = Self::preop_with(config);
        fixture.apply_profiles(tx, rx);
        for channel in 0..CHANNELS as u8 {
            fixture.apply_channel(channel, McanChannelConfig::fd(1_000_000, 5_000_000));
        }
        fixture
    }

    pub fn apply_profiles(&mut self, tx: PdoProfile, rx: PdoProfile) {
        for (direction, profile) in [(Direction::TxPdo, tx), (Direction::RxPdo, rx)] {
            for write in assignment_writes(direction, profile.multiplier) {
                self.send(write);
            }
            for write in profile.writes(direction) {
                self.send(write);
            }
            self.send(PdoProfile::apply_write(direction));
            assert_eq!(self.upload(direction.profile_object(), 2), 0, "{direction} not applied");
            self.set_up_sync_manager(direction, profile.pdo_bytes() as u16);
        }
        self.writer = ImageWriter::new(Direction::RxPdo, rx);
        self.reader = ImageReader::new(Direction::TxPdo, tx);
        self.image = vec![0; rx.pdo_bytes()];
        self.input = vec![0; tx.pdo_bytes()];
    }

    pub fn set_up_sync_manager(&mut self, direction: Direction, length: u16) {
        let config = SyncManagerConfig {
            start: sync_manager_address(direction),
            length,
            control: sync_manager_control(direction),
        };
        self.gateway.configure_sync_manager(sync_manager(direction), Some(config));
    }

    pub fn apply_channel(&mut self, channel: u8, config: McanChannelConfig) {
        for write in config.writes(channel) {
            self.send(write);
        }
        self.send(McanChannelConfig::apply_write(channel));
        assert_eq!(self.upload(0x8001 + u16::from(channel), 2), 0, "channel {channel} not applied");
    }

    pub fn apply_data_path(&mut self, channel: u8, config: DataPathConfig) {
        for write in config.writes(channel) {
            self.send(write);
        }
        self.send(DataPathConfig::apply_write(channel));
        assert_eq!(self.upload(0x8021 + u16::from(channel), 3), 0, "policy {channel} not applied");
    }

    /// From PREOP to OP; the first input image is read.
    pub fn start(&mut self) {
        self.gateway.request_al_state(self.now, AlState::SafeOp);
        assert_eq!(self.state(), (AlState::SafeOp, 0));
        self.gateway.request_al_state(self.now, AlState::Op);
        assert_eq!(self.state(), (AlState::Op, 0));
        assert!(self.read());
    }

    /// Starts Sync0: pulses at every whole millisecond from now on.
    pub fn start_sync0(&mut self) -> u64 {
        let start_ns = self.now.next_multiple_of(MS);
        self.gateway.set_dc_sync0(Some(Sync0 { start_ns, cycle_ns: MS as u32, shift_ns: 0 }));
        start_ns
    }

    pub fn state(&self) -> (AlState, u16) {
        (self.gateway.al_state(), self.gateway.al_status_code())
    }

    pub fn pass(&mut self, ns: u64) {
        self.now += ns;
        self.gateway.advance(self.now);
    }

    // SDO

    pub fn download(&mut self, index: u16, subindex: u8, data: &[u8]) -> Result<(), AbortCode> {
        self.gateway.sdo_download(self.now, index, subindex, data)
    }

    pub fn send(&mut self, write: SdoWrite) {
        let (bytes, size) = write.bytes();
        let result = self.download(write.index, write.subindex, &bytes[..size]);
        assert_eq!(result, Ok(()), "{write}");
    }

    pub fn write_u8(&mut self, index: u16, subindex: u8, value: u8) {
        let result = self.download(index, subindex, &[value]);
        assert_eq!(result, Ok(()), "{index:04X}:{subindex}");
    }

    pub fn try_upload(&mut self, index: u16, subindex: u8) -> Result<Vec<u8>, AbortCode> {
        let mut data = Vec::new();
        self.gateway.sdo_upload(self.now, index, subindex, &mut data).map(|()| data)
    }

    pub fn upload(&mut self, index: u16, subindex: u8) -> u32 {
        let data = self.try_upload(index, subindex).unwrap();
        let mut bytes = [0; 4];
        bytes[..data.len()].copy_from_slice(&data);
        u32::from_le_bytes(bytes)
    }

    // Process data

    /// Puts a frame into the next output image.
    pub fn push(&mut self, channel: u8, frame: CanFrame) {
        self.writer.push(&mut self.image, channel, 0, frame.as_ref(), Timestamp::None).unwrap();
    }

    /// Commits the output image, writes it to SM2 and runs the service.
    pub fn write(&mut self) -> bool {
        self.writer.commit(&mut self.image, CommitFields::default());
        self.write_again()
    }

    /// Writes the output image to SM2 unchanged and runs the service.
    pub fn write_again(&mut self) -> bool {
        let taken = self.gateway.write_outputs(self.now, &self.image);
        self.pass(SERVICE);
        taken
    }

    pub fn read(&mut self) -> bool {
        self.gateway.read_inputs(self.now, &mut self.input)
    }

    /// One cycle: writes the output image, and reads the next input image.
    pub fn cycle(&mut self) {
        assert!(self.write(), "SM2 rejected the image");
        assert!(self.read(), "SM3 is empty");
        self.pass(MS - SERVICE);
    }

    pub fn input(&self) -> Image<'_> {
        self.reader.read(&self.input).unwrap()
    }

    /// Frames of the last input image with their channels.
    pub fn received(&self) -> Vec<(u8, CanFrame)> {
        self.packets(|packet| match packet {
            Packet::Frame(frame) => Some((frame.channel, frame.frame.to_owned())),
            Packet::TxResult(_) => None,
        })
    }

    /// TX_RESULT packets of the last input image.
    pub fn results(&self) -> Vec<TxResult> {
        self.packets(|packet| match packet {
            Packet::Frame(_) => None,
            Packet::TxResult(result) => Some(result),
        })
    }

    pub fn packets<T>(&self, mut pick: impl FnMut(Packet<'_>) -> Option<T>) -> Vec<T> {
        self.input().packets().filter_map(|packet| pick(packet.unwrap())).collect()
    }

    // CAN side

    /// Takes all frames that a channel sends; each is confirmed at once.
    pub fn sent(&mut self, channel: usize) -> Vec<CanFrame> {
        let mut frames = Vec::new();
        while let Some(frame) = self.gateway.next_transmit(channel) {
            self.gateway.transmitted(self.now, channel, &frame);
            frames.push(frame);
        }
        frames
    }

    pub fn deliver(&mut self, channel: usize, frame: CanFrame) {
        self.gateway.received(self.now, channel, &frame, self.now);
    }

    pub fn identifiers(frames: &[CanFrame]) -> Vec<u32> {
        frames.iter().map(|frame| frame.id().raw()).collect()
    }
}
