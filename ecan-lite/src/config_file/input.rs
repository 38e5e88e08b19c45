//! Bytes of files, and of standard input.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use crate::config_file::fault::{ConfigFileError, FileFaults};

/// No configuration is larger; the path may be a device, or a log by mistake.
const MAX_BYTES: u64 = 16 << 20;

/// Standard input: it can be read once, and a configuration is read in parts.
static STANDARD_INPUT: Mutex<Option<Vec<u8>>> = Mutex::new(None);

/// Reads the bytes of a file of at most 16 MiB; `-` is standard input, which is kept for later calls of
/// the process.
///
/// # Errors
/// The file cannot be read or is larger.
pub fn read_bytes(path: impl AsRef<Path>) -> io::Result<Vec<u8>> {
    let path = path.as_ref();
    if path != Path::new("-") {
        return limited(File::open(path)?);
    }
    let mut kept = STANDARD_INPUT.lock().unwrap_or_else(PoisonError::into_inner);
    match &*kept {
        Some(bytes) => Ok(bytes.clone()),
        None => Ok(kept.insert(limited(io::stdin())?).clone()),
    }
}

fn limited(input: impl Read) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    input.take(MAX_BYTES + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MAX_BYTES {
        let reason = "larger than 16 MiB; not a configuration file";
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, reason));
    }
    Ok(bytes)
}

/// Reads a file and parses its bytes.
pub(crate) fn load_by<T>(
    path: &Path,
    parse: impl FnOnce(&[u8]) -> Result<T, FileFaults>,
) -> Result<T, ConfigFileError> {
    let bytes = read_bytes(path)
        .map_err(|reason| ConfigFileError::Read { path: path.to_owned(), reason })?;
    parse(&bytes).map_err(|faults| ConfigFileError::Faults { path: path.to_owned(), faults })
}
