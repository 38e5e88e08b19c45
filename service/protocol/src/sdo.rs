//! Methods of SDO transfers. Data are hexadecimal text.

use serde::{Deserialize, Serialize};

/// Largest object of a transfer, in bytes.
pub const MAX_SDO_BYTES: u32 = 16 << 10;

/// Parameters of `sdo.upload`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UploadParams {
    /// Position of the slave.
    pub slave: u16,
    /// Object index.
    pub index: u16,
    /// Object subindex.
    pub subindex: u8,
    /// Largest length in bytes; default and maximum [`MAX_SDO_BYTES`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_bytes: Option<u32>,
    /// One attempt. By default a transfer without response is repeated for up to 5 s.
    #[serde(default)]
    pub once: bool,
}

/// Result of `sdo.upload`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Upload {
    /// The object.
    #[serde(with = "hex::serde")]
    pub data: Vec<u8>,
}

/// Parameters of `sdo.download`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DownloadParams {
    /// Position of the slave.
    pub slave: u16,
    /// Object index.
    pub index: u16,
    /// Object subindex; 0 with `complete`.
    pub subindex: u8,
    /// The object.
    #[serde(with = "hex::serde")]
    pub data: Vec<u8>,
    /// One attempt. By default a transfer without response is repeated for up to 5 s.
    #[serde(default)]
    pub once: bool,
    /// Complete Access from subindex 0, whose entry has 16 bits; always one attempt.
    #[serde(default)]
    pub complete: bool,
}
