//! The clients of the service in a trial.

use super::{Check, Trial};
use crate::application::Application;
use crate::finding::Rule;
use crate::service_client::Turn;

/// Cycles between two attempts to settle.
const SETTLE_CYCLES: u32 = 64;
/// Longest time until each frame of a client has a result.
const RESULT_NS: u64 = 20_000_000_000;

impl Trial {
    /// Between two cycles.
    pub(super) fn serve_clients(&mut self, sends: bool) -> Check {
        let Self { clients, application, accounts, random, cycle, .. } = self;
        let port = application.as_mut().and_then(Application::port);
        let Some(port) = port else { return Ok(()) };
        if clients.is_due(*cycle) {
            clients.attach(port);
        }
        let mut turn = Turn { sides: accounts, random, cycle: *cycle, sends, is_settled: false };
        clients.act(&mut turn).map_err(|text| (Rule::Service, text))
    }

    /// Runs until each frame of a client has a result.
    pub(super) fn settle_clients(&mut self) -> Check {
        let begin = self.now_ns();
        loop {
            let is_settled = self.clients.settle(&mut self.accounts);
            if is_settled.map_err(|text| (Rule::Service, text))? {
                return Ok(());
            }
            if self.now_ns() - begin > RESULT_NS {
                let text = "frames of a client without result".to_owned();
                return Err((Rule::Service, text));
            }
            for _ in 0..SETTLE_CYCLES {
                self.cycle(false)?;
                self.cycle += 1;
            }
        }
    }
}
