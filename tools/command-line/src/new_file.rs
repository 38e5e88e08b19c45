//! Output files that do not overwrite existing data unless requested.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

/// Policy for an existing file that is not empty.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Existing {
    /// Keep it and return an error.
    Keep,
    /// Truncate it.
    Replace,
}

impl Existing {
    /// Policy of an option `--force`.
    pub fn forced(is_forced: bool) -> Self {
        if is_forced { Self::Replace } else { Self::Keep }
    }
}

/// Returns whether a path is `-`, standard input or output.
pub fn is_standard_stream(path: &Path) -> bool {
    path == Path::new("-")
}

/// Opens a file for writing; `-` is standard output. Pipes, devices and empty files are never
/// rejected.
///
/// # Errors
/// The file cannot be written, or it exists and is to be kept.
pub fn create(path: &Path, existing: Existing) -> io::Result<Box<dyn Write + Send>> {
    if is_standard_stream(path) {
        return Ok(Box::new(io::stdout()));
    }
    let has_content = std::fs::metadata(path).is_ok_and(|found| found.is_file() && found.len() > 0);
    if existing == Existing::Keep && has_content {
        let text = "file exists; use --force to overwrite it";
        return Err(io::Error::new(io::ErrorKind::AlreadyExists, text));
    }
    Ok(Box::new(File::create(path)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn existing_file_is_kept_unless_forced() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.log");
        let write = |existing, text: &[u8]| {
            create(&path, existing).and_then(|mut file| file.write_all(text))
        };
        write(Existing::Keep, b"").unwrap();
        write(Existing::Keep, b"first").unwrap();
        let error = write(Existing::Keep, b"second").unwrap_err();
        assert_eq!(error.to_string(), "file exists; use --force to overwrite it");
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
        write(Existing::Replace, b"third").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"third");
        // A device is never rejected.
        drop(create(Path::new("/dev/null"), Existing::Keep).unwrap());
    }
}
