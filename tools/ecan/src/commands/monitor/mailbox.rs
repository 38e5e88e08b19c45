//! Error counters of the channels, through the mailbox.

use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;

use ecan_host::Diagnostics;
use ecan_protocol::mapping::CHANNELS;
use ecan_tool_support::diagnosis::registers::ErrorCounters;

use super::snapshot::Errors;
use crate::context::{Failure, Result};

/// Error counters of one gateway; `None` if it does not respond.
pub type GatewayErrors = Option<[Errors; CHANNELS]>;

const PAUSE: Duration = Duration::from_millis(1000);

/// Objects of a channel (manual 13.5).
const INFORMATION: u16 = 0x9000;
const ERROR_COUNTERS: u8 = 1;
const DROPPED: u8 = 13;
const BUS_OFFS: u8 = 15;

/// Reads the error counters of a gateway's channels; `None` without a response. Blocks.
pub fn read_errors(diagnostics: &Diagnostics, slave: usize) -> GatewayErrors {
    let mut errors = [Errors::default(); CHANNELS];
    for (channel, index) in errors.iter_mut().zip(INFORMATION..) {
        let read = |subindex| diagnostics.sdo_upload_u32(slave, index, subindex).ok();
        let counters = ErrorCounters::from_raw(read(ERROR_COUNTERS)?);
        *channel = Errors {
            transmit: counters.transmit,
            receive: if counters.is_receive_passive { 128 } else { counters.receive },
            dropped: read(DROPPED)?.into(),
            bus_offs: read(BUS_OFFS)?.into(),
        };
    }
    Some(errors)
}

/// Reads the error counters of some gateways.
#[derive(Debug)]
pub struct ErrorReader {
    pub diagnostics: Diagnostics,
    /// Slave index of the handle and position of each gateway.
    pub slaves: Vec<(usize, usize)>,
}

impl ErrorReader {
    pub fn read(&self) -> impl Iterator<Item = (usize, GatewayErrors)> {
        let read = |(slave, position): &(usize, usize)| {
            (*position, read_errors(&self.diagnostics, *slave))
        };
        self.slaves.iter().map(read)
    }
}

/// Reads the error counters periodically. Not joined at the end: a lost slave may block the master.
pub struct Mailbox {
    _stop: Sender<()>,
}

impl Mailbox {
    pub fn start(reader: ErrorReader, errors: Sender<(usize, GatewayErrors)>) -> Result<Self> {
        let (stop, stopped) = channel::<()>();
        std::thread::Builder::new()
            .name("mailbox".to_owned())
            .spawn(move || {
                while stopped.recv_timeout(PAUSE) == Err(RecvTimeoutError::Timeout) {
                    if reader.read().any(|read| errors.send(read).is_err()) {
                        return;
                    }
                }
            })
            .map_err(Failure::of_thread)?;
        Ok(Self { _stop: stop })
    }
}
