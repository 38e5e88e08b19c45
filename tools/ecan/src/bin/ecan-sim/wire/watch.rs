use std::fmt::Write;

use ecan_protocol::device::{AlState, AlStatusCode};
use ecan_sim::World;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct View {
    is_responding: bool,
    is_reachable: bool,
    state: AlState,
    error: Option<AlStatusCode>,
}

impl View {
    fn of(world: &World, index: usize) -> Option<Self> {
        let gateway = world.gateway(index)?;
        Some(Self {
            is_responding: gateway.is_responding(),
            is_reachable: world.is_reachable(index),
            state: gateway.al_state(),
            error: gateway.al_error().then(|| AlStatusCode(gateway.al_status_code())),
        })
    }

    /// Describes the change since `before`; `None` if it is not relevant.
    fn changes_since(&self, before: &Self) -> Option<String> {
        match (before.is_responding, self.is_responding) {
            (true, false) => return Some("off or restarting".to_owned()),
            (false, false) => return None,
            (false, true) => return Some(format!("booted, {}", self.state)),
            (true, true) => {}
        }
        let mut parts = Vec::new();
        if before.is_reachable != self.is_reachable {
            let text = if self.is_reachable { "link restored" } else { "link lost" };
            parts.push(text.to_owned());
        }
        if before.state != self.state {
            parts.push(format!("{} -> {}", before.state, self.state));
        }
        match self.error {
            Some(code) if before.error != Some(code) => {
                let mut text = String::new();
                if before.state == self.state {
                    let _ = write!(text, "{}, ", self.state);
                }
                let _ = write!(text, "AL error {code}");
                parts.push(text);
            }
            None if before.error.is_some() && before.state == self.state => {
                parts.push(format!("{}, AL error acknowledged", self.state));
            }
            _ => {}
        }
        (!parts.is_empty()).then(|| parts.join(", "))
    }
}

#[derive(Debug, Clone)]
pub struct Watch {
    views: Vec<View>,
}

impl Watch {
    pub fn new(world: &World) -> Self {
        Self { views: (0..world.gateway_count()).filter_map(|i| View::of(world, i)).collect() }
    }

    /// Reports each change since the last call: the gateway and a description.
    pub fn poll(&mut self, world: &World, mut report: impl FnMut(usize, String)) {
        for (index, before) in self.views.iter_mut().enumerate() {
            let Some(now) = View::of(world, index) else { continue };
            if now == *before {
                continue;
            }
            if let Some(text) = now.changes_since(before) {
                report(index, text);
            }
            *before = now;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_are_described() {
        let off =
            View { is_responding: false, is_reachable: false, state: AlState::Init, error: None };
        let op = View { is_responding: true, is_reachable: true, state: AlState::Op, error: None };
        let init = View { state: AlState::Init, ..op };
        let watchdog = Some(AlStatusCode::SM_WATCHDOG);
        let fallen = View { state: AlState::SafeOp, error: watchdog, ..op };
        let rejected = View { error: Some(AlStatusCode::MAILBOX_CONFIGURATION), ..init };
        let cases = [
            (off, init, Some("booted, INIT")),
            (op, off, Some("off or restarting")),
            (off, View { state: AlState::PreOp, ..off }, None),
            (init, View { state: AlState::PreOp, ..init }, Some("INIT -> PREOP")),
            (
                op,
                fallen,
                Some(
                    "OP -> SAFEOP, AL error 0x001B sync manager watchdog: outputs did not arrive \
                     in time",
                ),
            ),
            (fallen, View { error: None, ..fallen }, Some("SAFEOP, AL error acknowledged")),
            (init, rejected, Some("INIT, AL error 0x0016 invalid mailbox configuration for PREOP")),
            (op, View { is_reachable: false, ..op }, Some("link lost")),
        ];
        for (before, now, text) in cases {
            assert_eq!(now.changes_since(&before).as_deref(), text, "{before:?} {now:?}");
        }
    }
}
