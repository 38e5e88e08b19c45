//! A client and the reference server on a wire that loses and delays what the test says.

use std::collections::VecDeque;
use std::time::Duration;

use ecan_canopen::{BlockTransferConfig, Sdo, SdoClient, SdoConfig};

use crate::reference::{Frame, Server};

pub const MS: u64 = 1_000_000;
pub const TIMEOUT_MS: u64 = 20;

/// Which way a frame goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    ToServer,
    ToClient,
}

pub struct Link {
    pub client: SdoClient,
    pub server: Server,
    pub now_ns: u64,
    /// Every frame put on the wire, the lost ones included.
    pub wire: Vec<(Way, Frame)>,
    /// Frames that get lost, by their number on the wire from 0.
    pub lost: Vec<usize>,
    /// Delay in milliseconds of each frame, by its number; behind the end none.
    pub delays: Vec<u64>,
    /// After this silence the server nudges, in milliseconds.
    pub patience_ms: Option<u64>,
    quiet_ms: u64,
    to_server: VecDeque<(u64, Frame)>,
    to_client: VecDeque<(u64, Frame)>,
}

pub fn settings() -> SdoConfig {
    SdoConfig { timeout: Duration::from_millis(TIMEOUT_MS), retries: 2, ..SdoConfig::default() }
}

pub fn block_settings() -> SdoConfig {
    let block = BlockTransferConfig { download_from: Some(5), upload: true, segments: 16 };
    SdoConfig { block, ..settings() }
}

impl Link {
    pub fn new(server: Server, settings: SdoConfig) -> Self {
        Self {
            client: SdoClient::new(settings),
            server,
            now_ns: 0,
            wire: Vec::new(),
            lost: Vec::new(),
            delays: Vec::new(),
            patience_ms: None,
            quiet_ms: 0,
            to_server: VecDeque::new(),
            to_client: VecDeque::new(),
        }
    }

    /// Puts a frame on the wire. Frames of one direction never overtake each other.
    pub fn post(&mut self, way: Way, frame: Frame) {
        let number = self.wire.len();
        self.wire.push((way, frame));
        self.quiet_ms = 0;
        if self.lost.contains(&number) {
            return;
        }
        let due = self.now_ns + self.delays.get(number).copied().unwrap_or(0) * MS;
        let queue = match way {
            Way::ToServer => &mut self.to_server,
            Way::ToClient => &mut self.to_client,
        };
        let due = queue.back().map_or(due, |(before, _)| due.max(*before));
        queue.push_back((due, frame));
    }

    fn arrived(&mut self, way: Way) -> Option<Frame> {
        let queue = match way {
            Way::ToServer => &mut self.to_server,
            Way::ToClient => &mut self.to_client,
        };
        queue
            .front()
            .is_some_and(|(due, _)| *due <= self.now_ns)
            .then(|| queue.pop_front())?
            .map(|(_, frame)| frame)
    }

    /// One millisecond: one frame of the client goes out, what has arrived is dealt with.
    pub fn step(&mut self) {
        self.now_ns += MS;
        if let Some(frame) = self.client.frame() {
            self.client.sent(self.now_ns);
            self.post(Way::ToServer, frame);
        }
        self.quiet_ms += 1;
        if self.patience_ms == Some(self.quiet_ms) {
            for answer in self.server.nudge() {
                self.post(Way::ToClient, answer);
            }
        }
        while let Some(frame) = self.arrived(Way::ToServer) {
            for answer in self.server.request(frame) {
                self.post(Way::ToClient, answer);
            }
        }
        while let Some(frame) = self.arrived(Way::ToClient) {
            self.client.receive(&frame, self.now_ns);
        }
        self.client.tick(self.now_ns);
    }

    /// Until the transfer is over and nothing is left to say.
    pub fn run(&mut self) -> Sdo {
        for _ in 0..100_000 {
            if self.client.state() != Sdo::Busy && self.client.frame().is_none() {
                return self.client.state();
            }
            self.step();
        }
        panic!("the transfer never ends: {:?}", self.wire.last());
    }

    /// Lets everything arrive that is still under way.
    pub fn settle(&mut self) {
        while !self.to_server.is_empty() || !self.to_client.is_empty() {
            self.step();
        }
    }

    pub fn upload(&mut self, index: u16, subindex: u8) -> Sdo {
        self.client.start_upload(index, subindex).unwrap();
        self.run()
    }

    pub fn download(&mut self, index: u16, subindex: u8, value: &[u8]) -> Sdo {
        self.client.start_download(index, subindex, value).unwrap();
        self.run()
    }

    pub fn sent(&self) -> Vec<Frame> {
        self.wire.iter().filter(|(way, _)| *way == Way::ToServer).map(|(_, f)| *f).collect()
    }
}

/// A value of so many bytes that repeats late.
pub fn value(length: usize) -> Vec<u8> {
    (0..length).map(|at| (at * 31 + at / 7 + 1) as u8).collect()
}
