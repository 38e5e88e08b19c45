//! Makes a plan smaller while it repeats its finding.

use crate::channel::Partner;
use crate::finding::{Outcome, Rule};
use crate::plan::Plan;

/// Most trials of one search.
const ATTEMPTS: u32 = 200;

struct Search<'a> {
    trial: &'a dyn Fn(&Plan) -> Outcome,
    plan: Plan,
    outcome: Outcome,
    rule: Rule,
    attempts: u32,
}

/// The smallest plan that was found whose trial violates the same rule, with its outcome.
pub fn shrink(plan: &Plan, outcome: &Outcome, trial: &dyn Fn(&Plan) -> Outcome) -> (Plan, Outcome) {
    let Some(finding) = &outcome.finding else { return (plan.clone(), outcome.clone()) };
    let rule = finding.rule;
    let mut search =
        Search { trial, plan: plan.clone(), outcome: outcome.clone(), rule, attempts: 0 };
    search.events();
    search.machine();
    search.events();
    search.cycles();
    (search.plan, search.outcome)
}

impl Search<'_> {
    /// Takes over a changed plan if it repeats the finding.
    fn attempt(&mut self, change: impl FnOnce(&mut Plan)) -> bool {
        let mut plan = self.plan.clone();
        change(&mut plan);
        if plan == self.plan || self.attempts == ATTEMPTS {
            return false;
        }
        self.attempts += 1;
        let outcome = (self.trial)(&plan);
        let repeats = outcome.finding.as_ref().is_some_and(|finding| finding.rule == self.rule);
        if repeats {
            (self.plan, self.outcome) = (plan, outcome);
        }
        repeats
    }

    /// Without halves of the events, then without single ones.
    fn events(&mut self) {
        let mut length = self.plan.event.len() / 2;
        while length > 0 {
            let mut first = 0;
            while first < self.plan.event.len() {
                let is_without = self.attempt(|plan| {
                    let end = plan.event.len().min(first + length);
                    plan.event.drain(first..end);
                });
                if !is_without {
                    first += length;
                }
            }
            length /= 2;
        }
        if self.plan.event.len() == 1 {
            self.attempt(|plan| plan.event.clear());
        }
    }

    fn machine(&mut self) {
        self.attempt(|plan| plan.machine.uses_c = false);
        self.attempt(|plan| plan.machine.service = None);
        self.attempt(|plan| plan.machine.service.iter_mut().for_each(|client| client.clients = 1));
        self.attempt(|plan| plan.machine.variants.clear());
        self.attempt(|plan| plan.machine.gateway_keys.clear());
        self.attempt(|plan| plan.machine.sync0_shift_us = None);
        self.attempt(|plan| plan.machine.like = "ideal".to_owned());
        self.attempt(|plan| plan.machine.topology = "line".to_owned());
        for slave in 0..self.plan.machine.gateway.len() {
            for channel in (0..4).rev() {
                self.attempt(|plan| {
                    let channels = &mut plan.machine.gateway[slave].channel;
                    if channels.len() > 1 && channel < channels.len() {
                        channels.remove(channel);
                        channels[0].sends = true;
                        channels[0].receives = true;
                    }
                });
                self.attempt(|plan| {
                    if let Some(channel) = plan.machine.gateway[slave].channel.get_mut(channel) {
                        channel.partner = Partner::Silent;
                    }
                });
                self.attempt(|plan| {
                    if let Some(channel) = plan.machine.gateway[slave].channel.get_mut(channel) {
                        channel.frames = 0;
                    }
                });
                self.attempt(|plan| {
                    if let Some(channel) = plan.machine.gateway[slave].channel.get_mut(channel) {
                        channel.bus = None;
                    }
                });
            }
        }
        while self.plan.machine.gateway.len() > 1 {
            let is_without = self.attempt(|plan| {
                plan.machine.gateway.pop();
            });
            if !is_without {
                return;
            }
        }
    }

    /// Ends soon after the last event.
    fn cycles(&mut self) {
        let last = self.plan.event.last().map_or(1, |event| event.cycle + 1);
        self.attempt(|plan| plan.cycles = last.min(plan.cycles));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::Action;
    use crate::finding::Finding;

    /// A finding of plans with a restart after a discard, of at least two gateways.
    fn outcome(plan: &Plan) -> Outcome {
        let mut events = plan.event.iter().map(|event| &event.action);
        let has = events.any(|action| matches!(action, Action::Discard(_)))
            && events.any(|action| matches!(action, Action::Restart(_)));
        let finding = Finding { rule: Rule::Recovery, cycle: 7, text: String::new() };
        let is_found = has && plan.machine.gateway.len() > 1;
        Outcome { finding: is_found.then_some(finding), ..Outcome::default() }
    }

    #[test]
    fn smallest_plan_has_only_what_the_finding_needs() {
        let plans = (0..).map(|seed| Plan::draw(seed, 10_000));
        let plans = plans.filter(|plan| plan.event.len() > 8 && outcome(plan).finding.is_some());
        for plan in plans.take(5) {
            let (small, found) = shrink(&plan, &outcome(&plan), &outcome);
            assert!(found.finding.is_some());
            let kinds: Vec<_> = small.event.iter().map(|event| &event.action).collect();
            assert!(
                matches!(kinds[..], [Action::Discard(_), Action::Restart(_)]),
                "{} became {kinds:?}",
                plan.event.len()
            );
            assert_eq!(small.machine.gateway.len(), 2);
            assert!(small.machine.variants.is_empty() && small.machine.sync0_shift_us.is_none());
            assert!(small.cycles <= plan.cycles);
        }
    }
}
