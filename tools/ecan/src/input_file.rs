//! Input files; `-` is standard input.

use std::path::Path;

use crate::failure::{Failure, Result};

pub fn read(path: &Path) -> Result<Vec<u8>> {
    ecan_lite::config::read_bytes(path).map_err(|error| Failure::file("read", path, error))
}

pub fn read_text(path: &Path) -> Result<String> {
    let not_utf_8 = |error| Failure::file("read", path, error);
    String::from_utf8(read(path)?).map_err(not_utf_8)
}
