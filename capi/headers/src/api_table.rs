//! The table of all functions in API.md.

use std::fmt::Write;
use std::path::Path;

use crate::manifest::HEADERS;
use crate::{read, sources};

const BEGIN: &str = "<!-- begin of the functions, made by scripts/regenerate-headers.sh -->\n";
const END: &str = "<!-- end of the functions -->\n";

/// Returns API.md with a new table.
pub fn api(root: &Path) -> Result<String, String> {
    let text = read(&root.join("API.md"))?;
    let parts = text.split_once(BEGIN).and_then(|(before, rest)| {
        let (_, after) = rest.split_once(END)?;
        Some((before, after))
    });
    let (before, after) = parts.ok_or("API.md has no markers for the table of functions")?;
    Ok(format!("{before}{BEGIN}{}{END}{after}", table(root)?))
}

fn table(root: &Path) -> Result<String, String> {
    let mut out = String::new();
    for header in HEADERS {
        let _ = writeln!(out, "\n### `{}`", header.name);
        for section in header.sections {
            let functions = sources::functions_of(root, section)?;
            if functions.is_empty() {
                continue;
            }
            let heading = sources::heading(root, section)?;
            let _ = writeln!(out, "\n{heading}\n\n| function | purpose | when |");
            let _ = writeln!(out, "| --- | --- | --- |");
            for function in functions {
                let (name, summary) = (&function.name, function.summary());
                let usage = function.tag("@usage").unwrap_or_default();
                let _ = writeln!(out, "| `{name}` | {summary} | {usage} |");
            }
        }
    }
    out.push('\n');
    Ok(out)
}
