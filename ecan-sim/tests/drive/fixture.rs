//! A drive without a bus: frames go in and come out directly.
use ecan_canopen::{
    Command, Controlword, DeviceFile, DriveState, NmtCommand, NmtRequest, NodeId, OperatingMode,
};
use ecan_protocol::can::{CanFrame, CanId, Dlc};
use ecan_sim::{Drive, DriveConfig, DriveQuirks, MotorConfig, Node, NodeOutput};

/// Node-ID of the drive.
pub const NODE: u16 = 5;
pub const MS: u64 = 1_000_000;

/// A frame in the notation of the tests.
pub type Line = (u16, Vec<u8>);

/// A drive under test.
pub struct Fixture {
    pub drive: Drive,
    pub now: u64,
    out: NodeOutput,
    /// Sent frames that the test has not read.
    pub sent: Vec<(u64, Line)>,
}

/// Configuration of a drive that responds at once and starts at position 1000.
pub fn config() -> DriveConfig {
    DriveConfig {
        sdo_delay_us: 0,
        motor: MotorConfig { start_position: 1000, ..MotorConfig::default() },
        ..DriveConfig::new(NodeId::new(NODE as u8).unwrap())
    }
}

/// A device file whose sections have a line each: `[section] key=value, key=value`.
pub fn expand(text: &str) -> String {
    text.replace("] ", "]\n").replace(", ", "\n")
}

pub fn parse_file(text: &str) -> DeviceFile {
    DeviceFile::parse(expand(text).as_bytes()).unwrap_or_else(|faults| panic!("{faults}"))
}

impl Fixture {
    /// A booted drive with the built-in objects.
    pub fn booted() -> Self {
        Self::with(&config())
    }

    pub fn with(config: &DriveConfig) -> Self {
        let mut fixture = Self::cold(Drive::new(config));
        fixture.pass_ms(u64::from(config.boot_ms) + 1);
        fixture.sent.clear();
        fixture
    }

    pub fn with_quirks(quirks: DriveQuirks) -> Self {
        Self::with(&DriveConfig { quirks, ..config() })
    }

    /// A node from a device file in the notation of [`expand`], 50 ms after power-on.
    pub fn from_file(text: &str) -> Self {
        let mut fixture = Self::cold(Drive::from_device_file(&config(), &parse_file(text)));
        fixture.pass_ms(50);
        fixture
    }

    /// A drive just after power-on.
    pub fn cold(drive: Drive) -> Self {
        let mut fixture = Self { drive, now: 10 * MS, out: NodeOutput::new(), sent: Vec::new() };
        fixture.drive.started(fixture.now, &mut fixture.out);
        fixture.collect();
        fixture
    }

    fn collect(&mut self) {
        while let Some(frame) = self.out.pop() {
            self.sent.push((self.now, (frame.id().raw() as u16, frame.data().to_vec())));
            self.drive.transmitted(self.now, &frame, &mut self.out);
        }
    }

    /// Advances time and runs the drive.
    pub fn pass(&mut self, ns: u64) {
        let end = self.now + ns;
        while let Some(at) = self.drive.next_event().filter(|at| *at <= end) {
            self.now = at.max(self.now);
            self.drive.advance(self.now, &mut self.out);
            self.collect();
            let next = self.drive.next_event();
            assert!(next.is_none_or(|next| next > self.now), "time does not advance");
        }
        self.now = end;
    }

    pub fn pass_ms(&mut self, ms: u64) {
        self.pass(ms * MS);
    }

    /// Passes a remote frame for one byte to the drive; returns the frames sent at the same instant.
    pub fn remote(&mut self, id: u16) -> Vec<Line> {
        let id = CanId::standard(id).unwrap();
        self.receive(CanFrame::remote(id, Dlc::new(1).unwrap()).unwrap())
    }

    /// Passes a received frame to the drive; returns the frames sent at the same instant.
    pub fn frame(&mut self, id: u16, data: &[u8]) -> Vec<Line> {
        self.receive(CanFrame::classic(CanId::standard(id).unwrap(), data).unwrap())
    }

    fn receive(&mut self, frame: CanFrame) -> Vec<Line> {
        let before = self.sent.len();
        self.drive.received(self.now, &frame, &mut self.out);
        self.collect();
        self.sent.split_off(before).into_iter().map(|(_, line)| line).collect()
    }

    /// Changes an object as the process does.
    pub fn set_object(&mut self, key: (u16, u8), value: i64) -> bool {
        let is_set = self.drive.set_object(self.now, key, value, &mut self.out);
        self.collect();
        is_set
    }

    /// Returns and clears the frames sent so far.
    pub fn lines(&mut self) -> Vec<Line> {
        self.sent.drain(..).map(|(_, line)| line).collect()
    }

    pub fn nmt(&mut self, command: NmtCommand) -> Vec<Line> {
        let node = NodeId::from_raw(NODE as u8);
        self.frame(0, &NmtRequest { command, node }.to_bytes())
    }

    /// Sends one SDO request and expects one response.
    pub fn sdo(&mut self, request: [u8; 8]) -> [u8; 8] {
        let lines: Vec<_> = self.sdo_all(request);
        assert_eq!(lines.len(), 1, "{lines:02X?}");
        lines[0]
    }

    /// Sends one SDO request and returns all responses.
    pub fn sdo_all(&mut self, request: [u8; 8]) -> Vec<[u8; 8]> {
        self.frame(0x600 + NODE, &request)
            .into_iter()
            .filter(|(id, _)| *id == 0x580 + NODE)
            .map(|(_, data)| data.try_into().unwrap())
            .collect()
    }

    /// Writes that must succeed: index, subindex, value, bytes.
    pub fn writes(&mut self, values: &[(u16, u8, i64, u8)]) {
        for (index, sub, value, bytes) in values {
            let written = self.write(*index, *sub, *value, *bytes);
            written.unwrap_or_else(|code| panic!("{index:04X}:{sub}: {code:08X}"));
        }
    }

    /// Writes a number with an expedited download; returns the abort code on failure.
    pub fn write(&mut self, index: u16, sub: u8, value: i64, bytes: u8) -> Result<(), u32> {
        let [low, high] = index.to_le_bytes();
        let [a, b, c, d, ..] = value.to_le_bytes();
        let mut data = [0; 4];
        data[..usize::from(bytes)].copy_from_slice(&[a, b, c, d][..usize::from(bytes)]);
        let [a, b, c, d] = data;
        let response = self.sdo([0x23 | (4 - bytes) << 2, low, high, sub, a, b, c, d]);
        match response[0] {
            0x60 => Ok(()),
            0x80 => Err(u32::from_le_bytes(response[4..].try_into().unwrap())),
            other => panic!("response {other:02X}"),
        }
    }

    /// Reads a number with an expedited upload.
    pub fn read(&mut self, index: u16, sub: u8) -> Result<u32, u32> {
        let [low, high] = index.to_le_bytes();
        let response = self.sdo([0x40, low, high, sub, 0, 0, 0, 0]);
        let value = u32::from_le_bytes(response[4..].try_into().unwrap());
        match response[0] {
            0x80 => Err(value),
            command if command & 0xE3 == 0x43 => Ok(value),
            other => panic!("response {other:02X}"),
        }
    }

    pub fn controlword(&mut self, word: u16) {
        self.write(0x6040, 0, i64::from(word), 2).unwrap();
    }

    pub fn command(&mut self, command: Command) {
        self.controlword(Controlword::of(command).0);
    }

    pub fn mode(&mut self, mode: OperatingMode) {
        self.write(0x6060, 0, i64::from(mode.raw()), 1).unwrap();
    }

    /// Enables the drive by SDO.
    pub fn enable(&mut self, mode: OperatingMode) {
        self.mode(mode);
        for command in [Command::Shutdown, Command::SwitchOn, Command::EnableOperation] {
            self.command(command);
        }
        assert_eq!(self.drive.state(), DriveState::OperationEnabled);
    }

    /// Maps controlword and target position to RPDO 1, statusword and actual position to TPDO 1,
    /// both with every SYNC, in the order that drives accept.
    pub fn map_csp(&mut self) {
        let pdos = [
            (0x1400, 0x1600, 0x200 + NODE, 0x6040_0010, 0x607A_0020),
            (0x1800, 0x1A00, 0x180 + NODE, 0x6041_0010, 0x6064_0020),
        ];
        for (communication, mapping, id, first, second) in pdos {
            let id = i64::from(id);
            self.write(communication, 1, id | 0xC000_0000, 4).unwrap();
            self.write(communication, 2, 1, 1).unwrap();
            self.write(mapping, 0, 0, 1).unwrap();
            self.write(mapping, 1, first, 4).unwrap();
            self.write(mapping, 2, second, 4).unwrap();
            self.write(mapping, 0, 2, 1).unwrap();
            self.write(communication, 1, id | 0x4000_0000, 4).unwrap();
        }
        self.mode(OperatingMode::CyclicPosition);
    }

    /// Maps both PDOs, starts the node and enables the drive in CSP at this target.
    pub fn start_csp(&mut self, target: i32) {
        self.map_csp();
        self.nmt(NmtCommand::Start);
        for word in [0x06, 0x07, 0x0F] {
            self.cycle(word, target);
        }
    }

    /// One host cycle: RPDO 1, SYNC; returns statusword and actual position of TPDO 1.
    pub fn cycle(&mut self, word: u16, target: i32) -> (u16, i32) {
        let mut data = word.to_le_bytes().to_vec();
        data.extend(target.to_le_bytes());
        self.frame(0x200 + NODE, &data);
        let lines = self.frame(0x80, &[]);
        let (id, data) = &lines[0];
        assert_eq!(*id, 0x180 + NODE);
        self.pass_ms(1);
        let position = i32::from_le_bytes(data[2..6].try_into().unwrap());
        (u16::from_le_bytes([data[0], data[1]]), position)
    }
}
