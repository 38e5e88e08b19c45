//! The page: its tables are replaced between their marks, the pictures of all sections are written to their folder.

use std::fs;
use std::path::{Path, PathBuf};

use ecan_tool_support::command_line::new_file;
use ecan_tool_support::plot::{
    AxisKind, CurveFigure, CurvePanel, CurveStack, Heading, Series, Tone,
};

use crate::Fallible;

/// A table and its picture.
pub struct Section {
    /// Name of its marks, and part of the name of the picture.
    pub name: &'static str,
    pub title: &'static str,
    pub x_label: &'static str,
    pub panels: Vec<CurvePanel>,
    /// Whether the values come from the simulator.
    pub is_simulated: bool,
    pub header: Vec<String>,
    pub rows: Vec<Vec<String>>,
}

pub struct Page {
    directory: PathBuf,
    text: String,
}

impl Page {
    pub fn open(directory: &Path) -> Fallible<Self> {
        let path = directory.join("PERFORMANCE.md");
        let text = fs::read_to_string(&path)
            .map_err(|error| format!("cannot read {}: {error}", path.display()))?;
        Ok(Self { directory: directory.to_owned(), text })
    }

    pub fn put(&mut self, section: Section) -> Fallible<()> {
        let Section { name, title, x_label, panels, is_simulated, header, rows } = section;
        let (begin, end) = (format!("<!-- {name} -->\n"), format!("<!-- end of {name} -->"));
        let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        let rule = line(&vec!["---".to_owned(); header.len()]);
        let table: String = rows.iter().map(|row| line(row)).collect();
        // The page has tables of some sections only.
        if let Some(begin_at) = self.text.find(&begin) {
            let from = begin_at + begin.len();
            let to = self.text.find(&end).ok_or(format!("PERFORMANCE.md has no {end}"))?;
            self.text.replace_range(from..to, &format!("{}{rule}{table}", line(&header)));
        }
        let stack = CurveStack {
            x_label: x_label.to_owned(),
            x_kind: AxisKind::Count,
            panels: panels.into_iter().map(|panel| (panel, 260)).collect(),
        };
        let heading = Heading::new(title).simulated(is_simulated);
        let figure = CurveFigure { heading, stacks: vec![stack] };
        figure.write(&self.directory.join(format!("pictures/scale-{name}.svg")))?;
        Ok(())
    }

    pub fn write(&self) -> Fallible<()> {
        Ok(new_file::write(&self.directory.join("PERFORMANCE.md"), &self.text)?)
    }
}

/// A panel with the curve of the formula and that of the run.
pub fn compared(
    title: impl Into<String>,
    y_label: &str,
    formula: Vec<(f64, f64)>,
    run: (&str, Vec<(f64, f64)>),
) -> CurvePanel {
    let series = |name: &str, tone, points: Vec<(f64, f64)>| Series {
        name: name.to_owned(),
        tone,
        points: points.into_iter().map(|(x, y)| (x, Some(y))).collect(),
    };
    CurvePanel {
        title: title.into(),
        y_label: y_label.to_owned(),
        series: vec![series("planner", Tone::Target, formula), series(run.0, Tone::Actual, run.1)],
        ..CurvePanel::default()
    }
}
