//! Report of a probe as text.

use std::io::Write;

use ecan_tool_support::probe::{Finding, Stage, Verdict};

use crate::context::{Output, Tone};

use super::Report;

pub(super) fn print(report: &Report, output: &Output, out: &mut dyn Write) -> std::io::Result<()> {
    match report.profile.serial {
        Some(serial) => writeln!(out, "gateway {serial} at position {}", report.position)?,
        None => writeln!(out, "gateway without a serial number at position {}", report.position)?,
    }
    for stage in Stage::ALL.into_iter().map(Some).chain([None]) {
        let mut of_stage = report.findings.iter().filter(|it| it.stage == stage).peekable();
        if of_stage.peek().is_some() {
            writeln!(out, "\n{}", stage.map_or("without an experiment", Stage::text))?;
        }
        for finding in of_stage {
            print_finding(finding, output, out)?;
        }
    }
    let count = |verdict| report.findings.iter().filter(|it| it.verdict == verdict).count();
    writeln!(
        out,
        "\n{} assumptions: {} hold, {} differ, {} undecided",
        report.findings.len(),
        count(Verdict::Holds),
        count(Verdict::Differs),
        count(Verdict::Undecided)
    )?;
    writeln!(out, "configuration: {}", report.configuration)
}

fn print_finding(finding: &Finding, output: &Output, out: &mut dyn Write) -> std::io::Result<()> {
    let verdict = match finding.verdict {
        Verdict::Holds => output.toned(Tone::Good, "holds    "),
        Verdict::Differs => output.toned(Tone::Bad, "DIFFERS  "),
        Verdict::Undecided => output.toned(Tone::Warning, "undecided"),
    };
    let rows = finding.rows.join(", ");
    writeln!(out, "  {verdict}  {rows:<8}  {}", finding.assumption)?;
    writeln!(out, "                       {}", finding.detail)
}
