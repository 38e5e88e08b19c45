//! Result of an experiment.

use serde::Serialize;

/// Decision about an assumption.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// The gateway behaves as assumed.
    Holds,
    /// The gateway behaves otherwise.
    Differs,
    /// The experiment did not decide it.
    Undecided,
}

/// Verdict with the observation that led to it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// The decision.
    pub verdict: Verdict,
    /// What was measured, or why nothing was decided.
    pub detail: String,
    /// The behaviour found, in the form in which a scenario file of the simulator selects it; `None` for one that
    /// the simulator does not have.
    pub alternative: Option<String>,
}

impl Outcome {
    pub(crate) fn holds(detail: impl Into<String>) -> Self {
        Self { verdict: Verdict::Holds, detail: detail.into(), alternative: None }
    }

    pub(crate) fn differs(detail: impl Into<String>) -> Self {
        Self { verdict: Verdict::Differs, detail: detail.into(), alternative: None }
    }

    pub(crate) fn undecided(reason: impl Into<String>) -> Self {
        Self { verdict: Verdict::Undecided, detail: reason.into(), alternative: None }
    }

    /// Names the behaviour found.
    pub(crate) fn like(self, alternative: impl ToString) -> Self {
        Self { alternative: Some(alternative.to_string()), ..self }
    }

    /// Holds if `is_met`, else differs.
    pub(crate) fn decided(is_met: bool, detail: impl Into<String>) -> Self {
        if is_met { Self::holds(detail) } else { Self::differs(detail) }
    }
}
