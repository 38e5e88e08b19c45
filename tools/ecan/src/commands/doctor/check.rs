use serde::Serialize;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    Good,
    /// The cycle has more jitter than necessary.
    Warning,
    /// EtherCAT cannot work.
    Bad,
    Skipped,
}

impl Verdict {
    pub fn word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Warning => "warning",
            Self::Bad => "bad",
            Self::Skipped => "skipped",
        }
    }
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Check {
    pub name: &'static str,
    pub verdict: Verdict,
    pub found: String,
    /// Remedy; empty without a problem.
    pub remedy: String,
}

impl Check {
    pub fn good(found: impl Into<String>) -> Self {
        Self { name: "", verdict: Verdict::Good, found: found.into(), remedy: String::new() }
    }

    pub fn skipped(found: impl Into<String>) -> Self {
        Self { verdict: Verdict::Skipped, ..Self::good(found) }
    }

    pub fn warning(found: impl Into<String>, remedy: &str) -> Self {
        Self { verdict: Verdict::Warning, remedy: remedy.to_owned(), ..Self::good(found) }
    }

    pub fn bad(found: impl Into<String>, remedy: &str) -> Self {
        Self { verdict: Verdict::Bad, ..Self::warning(found, remedy) }
    }

    pub fn named(self, name: &'static str) -> Self {
        Self { name, ..self }
    }

    pub fn has_problem(&self) -> bool {
        matches!(self.verdict, Verdict::Warning | Verdict::Bad)
    }
}
