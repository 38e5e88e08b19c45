//! Functions and headings in the sources of a header, and the rules that they follow.

use std::path::Path;

use crate::manifest::{HEADERS, Header};
use crate::read;

#[derive(Debug)]
pub struct Function {
    pub name: String,
    /// Its doc comment, line by line.
    pub comment: Vec<String>,
    /// Its attribute `export`, if it has one.
    pub export: Option<String>,
    /// Its parameters and its return type, on one line.
    pub signature: String,
    pub location: String,
}

/// A section of a header: a part of a source file.
#[derive(Debug)]
pub struct Section {
    /// Path of the source below `capi/`.
    pub file: String,
    /// Number of the first line.
    pub line: usize,
    /// Heading and introduction, without the marks of comments.
    pub heading: Vec<String>,
    pub text: String,
}

impl Section {
    /// The first line of the heading.
    pub fn title(&self) -> &str {
        self.heading.first().map_or("", |title| title.trim())
    }

    fn new(file: &str, line: usize, mark: &str, text: String) -> Self {
        let heading = text.lines().map_while(|line| line.strip_prefix(mark));
        let heading = heading.map(|line| line.trim_end().replace(SECTION, ""));
        let heading = heading.filter(|line| !line.trim_start().starts_with("```")).collect();
        Self { file: file.to_owned(), line, heading, text }
    }
}

/// Begins the comment that is the heading of a section in a file with several sections.
const SECTION: &str = "Section: ";

/// Reads the sections of an entry of the manifest. A file without marked sections is one section, with
/// the file's doc comment as heading.
pub fn sections(root: &Path, entry: &str) -> Result<Vec<Section>, String> {
    let (file, title) = entry.split_once(": ").map_or((entry, None), |(f, t)| (f, Some(t)));
    let text = read(&root.join("capi").join(file))?;
    let lines: Vec<&str> = text.lines().collect();
    let is_start =
        |line: &&str| line.strip_prefix("// ").is_some_and(|comment| comment.starts_with(SECTION));
    let mut starts: Vec<usize> = (0..lines.len()).filter(|at| is_start(&lines[*at])).collect();
    if starts.is_empty() {
        return Ok(vec![Section::new(file, 1, "//!", text)]);
    }
    starts.push(lines.len());
    let sections = starts
        .windows(2)
        .map(|range| Section::new(file, range[0] + 1, "//", lines[range[0]..range[1]].join("\n")));
    let sections: Vec<_> =
        sections.filter(|section| title.is_none_or(|title| section.title() == title)).collect();
    if sections.is_empty() { Err(format!("capi/{entry}: no such section")) } else { Ok(sections) }
}

pub fn functions(root: &Path, header: &Header) -> Result<Vec<Function>, String> {
    let mut found = Vec::new();
    for entry in header.sections {
        found.extend(sections(root, entry)?.iter().flat_map(functions_of));
    }
    Ok(found)
}

fn functions_of(section: &Section) -> Vec<Function> {
    let mut found = Vec::new();
    let mut comment = Vec::new();
    let mut is_exported = false;
    let mut export = None;
    for (line, number) in section.text.lines().zip(0..) {
        is_exported |= line.starts_with("#[export(") || line == "#[unsafe(no_mangle)]";
        if line.starts_with("#[export(") {
            export = Some(line.to_owned());
        }
        let declared =
            line.strip_prefix("pub fn ").or_else(|| line.strip_prefix("pub extern \"C\" fn "));
        if let Some(declared) = declared.filter(|_| is_exported) {
            is_exported = false;
            let end = declared.find('(').unwrap_or(declared.len());
            found.push(Function {
                name: declared[..end].to_owned(),
                comment: std::mem::take(&mut comment),
                export: export.take(),
                signature: signature(section.text.lines().skip(number)),
                location: format!("capi/{}:{}", section.file, section.line + number),
            });
        } else if let Some(text) = line.strip_prefix("///") {
            comment.push(text.trim().to_owned());
        } else if !line.starts_with("#[") {
            comment.clear();
        }
    }
    found
}

/// Lines from the declaration of a function to its body.
fn signature<'a>(lines: impl Iterator<Item = &'a str>) -> String {
    let mut signature = String::new();
    for line in lines {
        signature.push_str(line.trim());
        signature.push(' ');
        if line.ends_with('{') {
            break;
        }
    }
    signature
}

impl Function {
    /// The first sentence of its comment.
    pub fn summary(&self) -> String {
        let paragraph = self.comment.iter().take_while(|line| !line.is_empty());
        let text = paragraph.map(String::as_str).collect::<Vec<_>>().join(" ");
        match text.find(". ") {
            Some(end) => text[..end].to_owned(),
            None => text.trim_end_matches('.').to_owned(),
        }
    }

    /// The version that added it, if that is not the first one with the present soname.
    pub fn since(&self) -> Option<&str> {
        let (_, since) = self.export.as_ref()?.split_once("since \"")?;
        since.split_once('"').map(|(since, _)| since)
    }

    pub fn tag(&self, tag: &str) -> Option<&str> {
        self.comment.iter().find_map(|line| line.strip_prefix(tag)).map(str::trim)
    }
}

/// Returns true if every buffer for a text has the parameters of all texts.
fn stores_text_by_convention(signature: &str) -> bool {
    let mut buffers = signature.split("*mut c_char").skip(1);
    buffers.all(|rest| rest.starts_with(", size: usize, needed: *mut usize"))
}

/// Adds the missing tags and the faulty signatures to `faults`.
pub fn audit(root: &Path, faults: &mut Vec<String>) -> Result<(), String> {
    for header in HEADERS {
        for function in functions(root, header)? {
            let (name, location) = (&function.name, &function.location);
            if function.tag("@usage").is_none() {
                faults.push(format!("{location}: the comment of {name} has no @usage"));
            }
            if !stores_text_by_convention(&function.signature) {
                faults.push(format!(
                    "{location}: a text of {name} must be followed by size: usize, needed: *mut usize"
                ));
            }
            let is_predicate = function.summary().starts_with("Returns 1 ");
            if is_predicate
                && function.export.as_ref().is_some_and(|attribute| !attribute.contains("or 0"))
            {
                faults.push(format!("{location}: {name} answers yes or no: export it with `or 0`"));
            }
        }
    }
    Ok(())
}
