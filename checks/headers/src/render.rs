//! Rendering of a C header from its template and its sections, and of the codes in the C++ header.

use std::fmt::{Display, Write};
use std::path::Path;

use cbindgen::{
    Builder, Config, DocumentationStyle, ExportConfig, FunctionConfig, Language, Style,
};

use crate::manifest::Header;
use crate::sources::Section;
use crate::{expand, read, sources};

/// Renders a header. A section is the output of cbindgen for its part of a source file, after its
/// heading. Sections in a row with the same title have one heading.
pub fn header(root: &Path, header: &Header) -> Result<String, String> {
    let template = read(&root.join("checks/headers/templates").join(header.template))?;
    let mut sections = String::new();
    let mut last = String::new();
    for entry in header.sections {
        for section in sources::sections(root, entry)? {
            if last != section.title() {
                heading(&mut sections, &section);
                last = section.title().to_owned();
            }
            sections.push_str(tidy(&declarations(&section)?).trim_end());
            sections.push_str("\n\n");
        }
    }
    let guard = header.name.to_uppercase().replace('.', "_");
    let lines = |prefix: &str, lines: &[&str], suffix: &str| {
        lines.iter().map(|line| format!("{prefix}{line}{suffix}\n")).collect::<String>()
    };
    let changes = changes(root, header)?;
    Ok(template
        .replace("@LICENSE@", &license(root)?)
        .replace("@CHANGES@", &lines(" *   ", &changes.lines().collect::<Vec<_>>(), ""))
        .replace("@TITLE@", header.title)
        .replace("@INTRO@", &lines(" * ", header.intro, ""))
        .replace("@INCLUDES@", &lines("#include \"", header.includes, "\""))
        .replace("@GUARD@", &guard)
        .replace("@MAJOR@", env!("CARGO_PKG_VERSION_MAJOR"))
        .replace("@MINOR@", env!("CARGO_PKG_VERSION_MINOR"))
        .replace("@PATCH@", env!("CARGO_PKG_VERSION_PATCH"))
        .replace("@SECTIONS@\n", &sections))
}

/// The change log of a header. Its first entry is that of the present version.
fn changes(root: &Path, header: &Header) -> Result<String, String> {
    let path = root.join("checks/headers/changes").join(header.name.replace(".h", ".txt"));
    let text = read(&path)?;
    let version = env!("CARGO_PKG_VERSION");
    if text.split_whitespace().next() != Some(version) {
        return Err(format!("{}: the first entry is not that of {version}", path.display()));
    }
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    for function in sources::functions(root, header)? {
        if let Some(since) = function.since() {
            add_change(&mut lines, since, &function.name)
                .ok_or_else(|| format!("{}: no entry of {since}", path.display()))?;
        }
    }
    Ok(lines.join("\n"))
}

/// Adds a function at the end of the entry of a version.
fn add_change(lines: &mut Vec<String>, version: &str, function: &str) -> Option<()> {
    let entry = lines.iter().position(|line| line.split_whitespace().next() == Some(version))?;
    let length = lines[entry + 1..].iter().take_while(|line| line.starts_with(' ')).count();
    lines.insert(entry + 1 + length, format!("       Added: {function}()."));
    Some(())
}

/// SPDX line and copyright line.
fn license(root: &Path) -> Result<String, String> {
    let text = read(&root.join("LICENSE-MIT"))?;
    let copyright = text.lines().find(|line| line.starts_with("Copyright"));
    let copyright = copyright.ok_or("LICENSE-MIT has no copyright line")?;
    let license = env!("CARGO_PKG_LICENSE");
    Ok(format!("/* SPDX-License-Identifier: {license} */\n/* {copyright} */\n"))
}

fn heading(out: &mut String, section: &Section) {
    let rule = "-".repeat(75);
    let _ = writeln!(out, "/* {rule}");
    for line in &section.heading {
        let _ = writeln!(out, " *{line}");
    }
    let _ = writeln!(out, " * {rule} */\n");
}

/// Puts a comment of one line on one line, and removes commas that C90 lacks.
fn tidy(text: &str) -> String {
    let lines: Vec<&str> = text.lines().collect();
    let mut out = String::new();
    let mut at = 0;
    while let Some(line) = lines.get(at) {
        let text = match lines.get(at..at + 3) {
            Some([open, text, end]) if open.trim() == "/**" && end.trim() == "*/" => {
                text.trim().strip_prefix("* ")
            }
            _ => None,
        };
        match text {
            Some(text) => {
                let indent = &line[..line.len() - line.trim_start().len()];
                let _ = writeln!(out, "{indent}/** {text} */");
                at += 3;
            }
            None => {
                // C90 has no comma after the last value of an enumeration.
                let is_last = lines.get(at + 1).is_some_and(|next| next.starts_with('}'));
                let line = if is_last { line.trim_end_matches(',') } else { line };
                let _ = writeln!(out, "{line}");
                at += 1;
            }
        }
    }
    out
}

fn declarations(section: &Section) -> Result<String, String> {
    let fault = |error: &dyn Display| format!("capi/{}: {error}", section.file);
    let source = expand::expand(&section.text).map_err(|error| fault(&error))?;
    let config = Config {
        // Types are exported whether a function takes them or not.
        export: ExportConfig { include: expand::types(&source), ..ExportConfig::default() },
        language: Language::C,
        style: Style::Type,
        documentation_style: DocumentationStyle::Doxy,
        function: FunctionConfig {
            must_use: Some("ECAN_MUST_CHECK".into()),
            ..FunctionConfig::default()
        },
        no_includes: true,
        usize_is_size_t: true,
        line_length: 100,
        tab_width: 4,
        ..Config::default()
    };
    // cbindgen reads files only.
    let file = tempfile::Builder::new().suffix(".rs").tempfile().map_err(|error| fault(&error))?;
    std::fs::write(file.path(), expand::text(&source)).map_err(|error| fault(&error))?;
    let bindings = Builder::new().with_src(file.path()).with_config(config).generate();
    let mut text = Vec::new();
    bindings.map_err(|error| fault(&error))?.write(&mut text);
    String::from_utf8(text).map_err(|error| fault(&error))
}

pub const CPP_HEADER: &str = "include/ecan_lite/error.hpp";
const CODES: &str = "capi/boundary/src/result.rs";
const ENUMERATION: &str = "enum class errc : int {\n";

/// Renders the C++ header, of which only the enumeration of the codes is generated.
pub fn cpp_header(root: &Path) -> Result<String, String> {
    let header = read(&root.join(CPP_HEADER))?;
    let parts = header.split_once(ENUMERATION);
    let parts = parts.and_then(|(before, rest)| Some((before, &rest[rest.find("};")?..])));
    let (before, after) = parts.ok_or_else(|| format!("{CPP_HEADER}: no enumeration `errc`"))?;
    let mut values = String::new();
    for line in read(&root.join(CODES))?.lines() {
        let Some((code, _)) = line.trim().split_once(" = ").filter(|(_, rest)| rest.contains("=>"))
        else {
            continue;
        };
        let name = match code.strip_prefix("ECAN_ERR_").or(code.strip_prefix("ECAN_")) {
            // C defines NULL as a macro, and a variable may be called null.
            Some("NULL") => "null_pointer".to_owned(),
            Some(name) => name.to_lowercase(),
            None => continue,
        };
        let _ = writeln!(values, "    {name} = {code},");
    }
    Ok(format!("{before}{ENUMERATION}{values}{after}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn added_function_is_in_the_entry_of_its_version() {
        let mut lines =
            ["0.2.1  Text.", "       More.", "0.2.0  First version."].map(str::to_owned).to_vec();
        assert_eq!(add_change(&mut lines, "0.2.1", "f"), Some(()));
        assert_eq!(lines[2], "       Added: f().");
        assert_eq!(add_change(&mut lines, "0.3.0", "f"), None);
    }
}
