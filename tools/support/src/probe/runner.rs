//! Runs the experiments in their order.

use super::run::Probe;
use crate::probe::experiment::Experiment;
use crate::probe::experiments::experiments;
use crate::probe::finding::Finding;
use crate::probe::interruption::{Interruption, Result, unavailable};
use crate::probe::outcome::Outcome;
use crate::probe::session::Session;
use crate::probe::stage::Stage;
use crate::probe::undecidable::UNDECIDABLE;

impl Probe {
    /// Runs every experiment in order and adds the assumptions without one. `progress` gets each experiment
    /// before it begins.
    pub fn run(&mut self, mut progress: impl FnMut(&Experiment)) -> Vec<Finding> {
        let mut findings = Vec::new();
        for experiment in experiments() {
            progress(experiment);
            findings.push(Finding::new(experiment, self.decide(experiment)));
        }
        self.session = None;
        findings.extend(UNDECIDABLE.iter().map(|it| it.finding()));
        findings
    }

    fn decide(&mut self, experiment: &Experiment) -> Outcome {
        match self.attempt(experiment) {
            Err(Interruption::LinkLost) => {
                self.session = None;
                let again = self.wait_preop().and_then(|()| self.attempt(experiment));
                self.is_lost = matches!(again, Err(Interruption::LinkLost));
                again.unwrap_or_else(|reason| self.not_run(&reason))
            }
            result => result.unwrap_or_else(|reason| self.not_run(&reason)),
        }
    }

    fn not_run(&mut self, reason: &Interruption) -> Outcome {
        self.session = None;
        Outcome::undecided(reason.to_string())
    }

    fn attempt(&mut self, experiment: &Experiment) -> Result<Outcome> {
        if self.is_stopped() {
            return Err(Interruption::Stopped);
        }
        if experiment.stage > self.options.last_stage {
            return unavailable(self.options.reason.clone());
        }
        if experiment.stage == Stage::Wired && self.options.wired.is_none() {
            return unavailable("no wired channels are given (--wired)");
        }
        self.has_changed |= experiment.stage != Stage::Reading;
        if experiment.stage == Stage::PreOp {
            self.session = None;
            self.wait_preop()?;
        }
        if let Some(session) = &mut self.session {
            session.take_missed();
        }
        let outcome = (experiment.run)(self)?;
        // Missing responses can look like another behaviour.
        match self.session.as_mut().map_or(0, Session::take_missed) {
            0 => Ok(outcome),
            _ => Err(Interruption::LinkLost),
        }
    }
}
