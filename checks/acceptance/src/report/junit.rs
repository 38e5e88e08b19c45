use std::fmt::Write;

use super::{Report, StepReport};
use crate::step::Status;

/// Text and attribute values of XML.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\n' => escaped.push_str("&#10;"),
            '\t' => escaped.push(character),
            // XML 1.0 has no other control characters.
            other if other.is_control() => escaped.push('\u{FFFD}'),
            other => escaped.push(other),
        }
    }
    escaped
}

fn case(step: &StepReport) -> String {
    let mut text = format!(
        "    <testcase classname=\"{}\" name=\"{}\" time=\"{:.3}\">\n",
        escaped(step.group),
        escaped(step.name),
        step.seconds
    );
    let reason = escaped(step.reason.as_deref().unwrap_or_default());
    match step.status {
        Status::Passed => {}
        Status::Skipped => {
            let _ = writeln!(text, "      <skipped message=\"{reason}\"/>");
        }
        Status::Failed => {
            let _ = writeln!(text, "      <failure message=\"{reason}\"/>");
        }
        Status::Interrupted => {
            let _ = writeln!(text, "      <error message=\"{reason}\"/>");
        }
    }
    let mut output = format!("proves: {}\n", step.proves);
    for (name, value) in &step.figures {
        let _ = writeln!(output, "{name} = {value}");
    }
    for line in &step.kernel_log {
        let _ = writeln!(output, "kernel: {line}");
    }
    let _ = writeln!(text, "      <system-out>{}</system-out>", escaped(&output));
    text.push_str("    </testcase>\n");
    text
}

impl Report {
    pub(super) fn junit(&self) -> String {
        let seconds: f64 = self.steps.iter().map(|step| step.seconds).sum();
        let mut text = format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites>\n  <testsuite \
             name=\"ecan-acceptance\" tests=\"{}\" failures=\"{}\" errors=\"{}\" skipped=\"{}\" \
             time=\"{seconds:.3}\">\n    <properties>\n",
            self.steps.len(),
            self.count(Status::Failed),
            self.count(Status::Interrupted),
            self.count(Status::Skipped),
        );
        for (name, value) in self.versions.rows() {
            let (name, value) = (escaped(name), escaped(&value));
            let _ = writeln!(text, "      <property name=\"{name}\" value=\"{value}\"/>");
        }
        text.push_str("    </properties>\n");
        text.extend(self.steps.iter().map(case));
        text.push_str("  </testsuite>\n</testsuites>\n");
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn special_characters_are_escaped() {
        let text = "a < b & \"c\"\n\u{1b}[31m";
        assert_eq!(escaped(text), "a &lt; b &amp; &quot;c&quot;&#10;\u{FFFD}[31m");
    }
}
