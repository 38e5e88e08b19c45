//! Waiting for a gateway, with a clock that only the gateway's responses advance.

use std::cell::Cell;
use std::path::PathBuf;
use std::time::Duration;

use ecan_host::Identity;
use ecan_protocol::device::AlState;

use super::access::{Gateways, POLL_INTERVAL};
use super::package::{FirmwareFile, Rejection};
use super::update::{Outcome, Update};
use crate::ethercat_tool::SlaveEntry;
use crate::failure::{Failure, Result};

/// Gateway that is unreachable for a while after the update.
struct Slow {
    now: Cell<Duration>,
    /// Duration of a response.
    answer: Duration,
    boot: Duration,
    written: Cell<Option<Duration>>,
}

impl Slow {
    fn new(answer: Duration, boot: Duration) -> Self {
        Self { now: Cell::default(), answer, boot, written: Cell::default() }
    }

    fn pass(&self, time: Duration) {
        self.now.set(self.now.get() + time);
    }

    /// Returns whether the new firmware runs.
    fn is_new(&self) -> Result<bool> {
        self.pass(self.answer);
        match self.written.get() {
            None => Ok(false),
            Some(at) if self.now.get() < at + self.boot => {
                Err(Failure::Rejected("no response".to_owned()))
            }
            Some(_) => Ok(true),
        }
    }
}

impl Gateways for Slow {
    fn present(&self) -> Result<Vec<SlaveEntry>> {
        Ok(vec![slave()])
    }

    fn identity(&self, _: usize) -> Result<Identity> {
        Ok(Identity { vendor_id: 1, product_code: 1 })
    }

    fn number(&self, _: usize, index: u16, subindex: u8) -> Result<u32> {
        if index != 0xF000 {
            return Ok(0);
        }
        let is_new = self.is_new()?;
        Ok(match subindex {
            5 => 0x0202 + u32::from(is_new),
            9 => 2,
            17 => 128,
            18 => 24,
            _ => 1,
        })
    }

    fn is_denial(&self, _: &Failure) -> bool {
        false
    }

    fn software_version(&self, _: usize) -> Result<String> {
        self.is_new().map(|is_new| if is_new { "2.3.1" } else { "2.2.1" }.to_owned())
    }

    fn write(&self, _: usize, _: &FirmwareFile, _: &dyn Fn(u64)) -> Result<(), Rejection> {
        self.written.set(Some(self.now.get()));
        Ok(())
    }

    fn pause(&self) {
        self.pass(POLL_INTERVAL);
    }

    fn now(&self) -> Duration {
        self.now.get()
    }
}

fn slave() -> SlaveEntry {
    let (state, al_state) = ("PREOP".to_owned(), Some(AlState::PreOp));
    SlaveEntry { position: 0, alias: None, state, al_state }
}

/// Result of the update and the waiting time.
fn update(gateway: &Slow, time_limit: Duration) -> (Outcome, Duration) {
    let file = FirmwareFile { path: PathBuf::new(), bytes: vec![0; 256] };
    let update = Update { gateways: gateway, file: &file, expected: None, time_limit };
    let outcome = update.run(&slave(), true).outcome;
    (outcome, gateway.now.get() - gateway.written.get().unwrap())
}

const SECOND: Duration = Duration::from_secs(1);

#[test]
fn time_limit_follows_the_clock_not_the_polls() {
    let (outcome, waited) = update(&Slow::new(3 * SECOND, 1000 * SECOND), 3 * SECOND);
    assert!(matches!(outcome, Outcome::NotBack { .. }), "{outcome:?}");
    assert_eq!(waited, 3 * SECOND);
    let (outcome, waited) = update(&Slow::new(SECOND / 100, 1000 * SECOND), 60 * SECOND);
    assert!(matches!(outcome, Outcome::NotBack { .. }), "{outcome:?}");
    assert!((60 * SECOND..61 * SECOND).contains(&waited), "{waited:?}");
}

#[test]
fn responding_gateway_is_updated() {
    let (outcome, _) = update(&Slow::new(SECOND, 20 * SECOND), 30 * SECOND);
    assert_eq!(outcome, Outcome::Updated);
}
