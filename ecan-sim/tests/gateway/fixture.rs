//! A gateway without EtherCAT frames or CAN bus: SDO shorthand, startup to OP, and cycles.
#![allow(dead_code)]

use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::config::{DataPathConfig, McanChannelConfig, assignment_writes};
use ecan_protocol::device::AlState;
use ecan_protocol::image::{
    CommitFields, Image, ImageReader, ImageWriter, Packet, PdoProfile, ResultCode, Schedule,
    Timestamp, TxResult,
};
use ecan_protocol::mapping::{
    CHANNELS, Direction, sync_manager, sync_manager_address, sync_manager_control,
};
use ecan_protocol::object::{AbortCode, SdoWrite};
use ecan_sim::variant::GatewayVariant;
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

pub fn extended(id: u32) -> CanFrame {
    CanFrame::classic(CanId::extended(id).unwrap(), &[]).unwrap()
}

pub fn fd(id: u16, data: &[u8]) -> CanFrame {
    CanFrame::fd(CanId::standard(id).unwrap(), data, true, false).unwrap()
}

/// A device with this behaviour.
pub fn with_variant(variant: GatewayVariant) -> GatewayModelConfig {
    GatewayModelConfig { variant, ..GatewayModelConfig::default() }
}

/// A device with this behaviour, in PREOP.
pub fn preop(variant: GatewayVariant) -> Fixture {
    Fixture::preop_with(with_variant(variant))
}

/// A device with this behaviour, as of [`Fixture::configured`] with the smallest images.
pub fn configured(variant: GatewayVariant) -> Fixture {
    Fixture::configured_with(with_variant(variant), chunks(1), chunks(1))
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
        fixture.enter_preop();
        assert_eq!(fixture.gateway.al_state(), AlState::PreOp);
        fixture
    }

    /// Starts Sync0, and goes to OP after its second pulse; returns the time of the first one.
    pub fn start_with_sync0(&mut self, after_pulse_ns: u64) -> u64 {
        let first = self.start_sync0();
        self.pass(MS + after_pulse_ns);
        self.start();
        first
    }

    /// Requests an AL state; returns the present one with its code.
    pub fn request(&mut self, state: AlState) -> (AlState, u16) {
        self.gateway.request_al_state(self.now, state);
        self.state()
    }

    pub fn power_cycle(&mut self) {
        self.gateway.power(self.now, false);
        self.pass(MS);
        assert!((0..4).all(|connector| self.gateway.station_config(connector).is_none()), "off");
        self.gateway.power(self.now, true);
        self.boot();
    }

    /// Waits for the boot and goes to PREOP.
    pub fn boot(&mut self) {
        assert!(!self.gateway.is_responding());
        self.pass(1_000 * MS);
        self.enter_preop();
    }

    /// Goes from INIT to PREOP as a master does.
    pub fn enter_preop(&mut self) {
        self.set_up_mailboxes();
        self.request(AlState::PreOp);
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
            self.send(assignment_writes(direction, profile.multiplier));
            self.send(profile.writes(direction));
            self.send([PdoProfile::apply_write(direction)]);
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
        assert_eq!(self.try_apply_channel(channel, config), 0, "channel {channel} not applied");
    }

    /// Writes a configuration and the apply command; returns the apply status.
    pub fn try_apply_channel(&mut self, channel: u8, config: McanChannelConfig) -> u32 {
        self.send(config.writes(channel));
        self.send([McanChannelConfig::apply_write(channel)]);
        self.upload(0x8001 + u16::from(channel), 2)
    }

    pub fn apply_data_path(&mut self, channel: u8, config: DataPathConfig) {
        self.send(config.writes(channel));
        self.send([DataPathConfig::apply_write(channel)]);
        assert_eq!(self.upload(0x8021 + u16::from(channel), 3), 0, "policy {channel} not applied");
    }

    /// From PREOP to OP; the first input image is read.
    pub fn start(&mut self) {
        for state in [AlState::SafeOp, AlState::Op] {
            assert_eq!(self.request(state), (state, 0));
        }
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

    pub fn send(&mut self, writes: impl IntoIterator<Item = SdoWrite>) {
        for write in writes {
            let (bytes, size) = write.bytes();
            let result = self.download(write.index, write.subindex, &bytes[..size]);
            assert_eq!(result, Ok(()), "{write}");
        }
    }

    /// Executes a command of the register service; returns its status and the value that was read.
    pub fn register(&mut self, offset: u32, command: u8) -> (u32, u32) {
        self.download(0xA000, 1, &offset.to_le_bytes()).unwrap();
        self.write_u8(0xA000, 2, command);
        (self.upload(0xA000, 3), self.upload(0xA000, 5))
    }

    pub fn write_u8(&mut self, index: u16, subindex: u8, value: u8) {
        let result = self.download(index, subindex, &[value]);
        assert_eq!(result, Ok(()), "{index:04X}:{subindex}");
    }

    pub fn try_upload(&mut self, index: u16, subindex: u8) -> Result<Vec<u8>, AbortCode> {
        let mut data = Vec::new();
        self.gateway.sdo_upload(self.now, index, subindex, &mut data).map(|()| data)
    }

    /// Reads objects in this order: index, subindex, expected value.
    #[track_caller]
    pub fn has(&mut self, values: &[(u16, u8, u32)]) {
        for (index, subindex, expected) in values {
            assert_eq!(self.upload(*index, *subindex), *expected, "{index:04X}:{subindex}");
        }
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

    /// Puts a frame without data for each identifier into the next output image.
    pub fn push_ids(&mut self, channel: u8, ids: impl IntoIterator<Item = u16>) {
        ids.into_iter().for_each(|id| self.push(channel, standard(id, &[])));
    }

    /// Puts a scheduled frame into the next output image.
    pub fn push_scheduled(&mut self, channel: u8, frame: CanFrame, schedule: Schedule) {
        let Self { writer, image, .. } = self;
        writer.push_scheduled(image, channel, 0, frame.as_ref(), schedule).unwrap();
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

    /// Identifiers of the frames of the last input image.
    pub fn received_ids(&self) -> Vec<u32> {
        self.received().iter().map(|(_, frame)| frame.id().raw()).collect()
    }

    /// Timestamps of the frames of the last input image.
    pub fn timestamps(&self) -> Vec<Timestamp> {
        self.packets(|packet| match packet {
            Packet::Frame(frame) => Some(frame.timestamp),
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

    /// Codes of the TX_RESULT packets of the last input image.
    pub fn result_codes(&self) -> Vec<ResultCode> {
        self.results().iter().map(|result| result.code).collect()
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

    /// Delivers a frame without data for each identifier.
    pub fn deliver_ids(&mut self, channel: usize, ids: impl IntoIterator<Item = u16>) {
        ids.into_iter().for_each(|id| self.deliver(channel, standard(id, &[])));
    }

    pub fn identifiers(frames: &[CanFrame]) -> Vec<u32> {
        frames.iter().map(|frame| frame.id().raw()).collect()
    }
}
