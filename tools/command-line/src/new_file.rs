//! Files that a program makes: none of an earlier run is destroyed unasked.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

/// What becomes of a file that is there already and not empty.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Existing {
    /// It stays, and the new one is refused.
    Keep,
    /// It is emptied.
    Replace,
}

impl Existing {
    /// What an option `--force` asks for.
    pub fn forced(is_forced: bool) -> Self {
        if is_forced { Self::Replace } else { Self::Keep }
    }
}

/// Whether a path means standard input or output: `-`.
pub fn is_standard_stream(path: &Path) -> bool {
    path == Path::new("-")
}

/// Opens a file for writing; `-` is standard output. Pipes and devices are not files that could be
/// destroyed, and an empty file holds nothing.
///
/// # Errors
/// It cannot be written, or it is there and to be kept.
pub fn create(path: &Path, existing: Existing) -> io::Result<Box<dyn Write + Send>> {
    if is_standard_stream(path) {
        return Ok(Box::new(io::stdout()));
    }
    let holds_something =
        std::fs::metadata(path).is_ok_and(|found| found.is_file() && found.len() > 0);
    if existing == Existing::Keep && holds_something {
        let words = "it exists; --force overwrites it";
        return Err(io::Error::new(io::ErrorKind::AlreadyExists, words));
    }
    Ok(Box::new(File::create(path)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_holds_something_is_kept_unless_it_may_be_replaced() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.log");
        let write = |existing, text: &[u8]| {
            create(&path, existing).and_then(|mut file| file.write_all(text))
        };
        write(Existing::Keep, b"").unwrap();
        write(Existing::Keep, b"first").unwrap();
        let error = write(Existing::Keep, b"second").unwrap_err();
        assert_eq!(error.to_string(), "it exists; --force overwrites it");
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
        write(Existing::Replace, b"third").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"third");
        // A device is no file.
        drop(create(Path::new("/dev/null"), Existing::Keep).unwrap());
    }
}
