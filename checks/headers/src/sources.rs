//! Functions and headings in the sources of a header.

use std::path::Path;

use crate::manifest::Header;
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

pub fn section(root: &Path, section: &str) -> Result<String, String> {
    read(&root.join("capi").join(section))
}

pub fn functions(root: &Path, header: &Header) -> Result<Vec<Function>, String> {
    let sections = header.sections.iter().map(|name| functions_of(root, name));
    Ok(sections.collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect())
}

fn functions_of(root: &Path, name: &str) -> Result<Vec<Function>, String> {
    let mut found = Vec::new();
    let text = section(root, name)?;
    let mut comment = Vec::new();
    let mut is_exported = false;
    let mut export = None;
    for (line, number) in text.lines().zip(1..) {
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
                signature: signature(text.lines().skip(number - 1)),
                location: format!("capi/{name}:{number}"),
            });
        } else if let Some(text) = line.strip_prefix("///") {
            comment.push(text.trim().to_owned());
        } else if !line.starts_with("#[") {
            comment.clear();
        }
    }
    Ok(found)
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

    pub fn tag(&self, tag: &str) -> Option<&str> {
        self.comment.iter().find_map(|line| line.strip_prefix(tag)).map(str::trim)
    }
}

/// The heading of a section: the first line of its source.
pub fn heading(root: &Path, name: &str) -> Result<String, String> {
    let text = section(root, name)?;
    Ok(text.lines().next().unwrap_or_default().trim_start_matches("//!").trim().to_owned())
}
