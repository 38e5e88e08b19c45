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
    pub fn good(name: &'static str, found: impl Into<String>) -> Self {
        Self { name, verdict: Verdict::Good, found: found.into(), remedy: String::new() }
    }

    pub fn skipped(name: &'static str, found: impl Into<String>) -> Self {
        Self { verdict: Verdict::Skipped, ..Self::good(name, found) }
    }

    pub fn warning(name: &'static str, found: impl Into<String>, remedy: &str) -> Self {
        Self { verdict: Verdict::Warning, remedy: remedy.to_owned(), ..Self::good(name, found) }
    }

    pub fn bad(name: &'static str, found: impl Into<String>, remedy: &str) -> Self {
        Self { verdict: Verdict::Bad, ..Self::warning(name, found, remedy) }
    }

    pub fn has_problem(&self) -> bool {
        matches!(self.verdict, Verdict::Warning | Verdict::Bad)
    }
}
