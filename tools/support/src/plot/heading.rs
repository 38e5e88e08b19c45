use crate::command_line::run_info::RunInfo;

/// Title of a picture, and the circumstances of the run.
#[derive(Debug, Clone, Default)]
pub struct Heading {
    /// Title.
    pub title: String,
    /// Second line: the settings of the measurement. Empty for none.
    pub subtitle: String,
    /// The run was simulated: the picture is marked.
    pub is_simulated: bool,
    /// Date, program, kernel and command line, below the picture.
    pub run: Option<RunInfo>,
}

impl Heading {
    /// A heading of a run on real hardware.
    pub fn new(title: impl Into<String>) -> Self {
        Self { title: title.into(), ..Self::default() }
    }

    /// The same with a second line.
    #[must_use]
    pub fn with_subtitle(self, subtitle: impl Into<String>) -> Self {
        Self { subtitle: subtitle.into(), ..self }
    }

    /// The same with the mark of a simulated run.
    #[must_use]
    pub fn simulated(self, is_simulated: bool) -> Self {
        Self { is_simulated, ..self }
    }

    /// The same with the circumstances of the run.
    #[must_use]
    pub fn with_run(self, run: RunInfo) -> Self {
        Self { run: Some(run), ..self }
    }
}
