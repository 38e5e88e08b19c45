//! Methods of SDO transfers. Data are hexadecimal text.

use serde::{Deserialize, Serialize};

use crate::protocol::rpc::{INVALID_PARAMS, RpcError};

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

impl UploadParams {
    /// Largest length of the object in bytes.
    ///
    /// # Errors
    /// `max_bytes` is out of range.
    pub fn checked_max_bytes(&self) -> Result<usize, RpcError> {
        let max_bytes = self.max_bytes.unwrap_or(MAX_SDO_BYTES);
        if !(1..=MAX_SDO_BYTES).contains(&max_bytes) {
            let text =
                format!("max_bytes {max_bytes} is out of range; allowed: 1 to {MAX_SDO_BYTES}");
            return Err(RpcError::new(INVALID_PARAMS, text));
        }
        Ok(max_bytes as usize)
    }
}

/// Result of `sdo.upload`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Upload {
    /// The object.
    #[serde(with = "hex::serde")]
    pub data: Vec<u8>,
}

impl DownloadParams {
    /// Checks length and subindex.
    ///
    /// # Errors
    /// The object is too long, or Complete Access does not begin at subindex 0.
    pub fn check(&self) -> Result<(), RpcError> {
        let (bytes, subindex) = (self.data.len(), self.subindex);
        if bytes > MAX_SDO_BYTES as usize {
            let text =
                format!("object of {bytes} bytes is too long; allowed: at most {MAX_SDO_BYTES}");
            return Err(RpcError::new(INVALID_PARAMS, text));
        }
        if self.complete && subindex != 0 {
            let text =
                format!("subindex {subindex} with complete access is out of range; allowed: 0");
            return Err(RpcError::new(INVALID_PARAMS, text));
        }
        Ok(())
    }
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
