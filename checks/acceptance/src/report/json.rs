use super::Report;

impl Report {
    pub(super) fn json(&self) -> String {
        // The report has no map with other keys than strings and no other cause of an error.
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }
}
