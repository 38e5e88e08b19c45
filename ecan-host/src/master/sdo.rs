//! SDO transfers that wait for the slave's answer.

use std::fmt;

use ecrt_sys::Errno;

use super::Master;

/// Contents of the target before an upload, and before its repetition. IgH 1.6.2 reports success if
/// the slave answers with a mailbox error; then the target is unchanged and the size undefined.
const FILLS: [u8; 2] = [0xA5, 0x5A];

/// Error of an SDO transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SdoError {
    /// The library's error: `EIO` aborted or failed on the bus, `EINVAL` no such slave,
    /// `EOVERFLOW` or `ENOBUFS` answer larger than the target.
    pub errno: Errno,
    /// Abort code of the slave.
    pub abort_code: Option<u32>,
}

impl SdoError {
    fn new(errno: Errno, abort_code: u32) -> Self {
        // The library sets the code with EIO only, and 0 is no code: the transfer failed
        // without an answer.
        let aborted = errno == Errno::EIO && abort_code != 0;
        Self { errno, abort_code: aborted.then_some(abort_code) }
    }
}

impl fmt::Display for SdoError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.abort_code {
            Some(code) => write!(f, "aborted by the slave with code 0x{code:08x}"),
            None => self.errno.fmt(f),
        }
    }
}

impl std::error::Error for SdoError {}

impl Master {
    /// Reads an object of the slave at a ring position into `target` and returns how many bytes
    /// it has; the bytes after it become 0. Blocks until the slave answers.
    ///
    /// # Errors
    /// The slave aborts, does not answer or is not there, or the object does not fit.
    pub fn sdo_upload(
        &self,
        position: u16,
        index: u16,
        subindex: u8,
        target: &mut [u8],
    ) -> Result<usize, SdoError> {
        for fill in FILLS {
            target.fill(fill);
            let (mut size, mut abort_code) = (0, 0);
            // SAFETY: the master is valid as long as `self`; target and its length belong together,
            // the two results are writable.
            let status = unsafe {
                (self.ecrt.functions().master_sdo_upload)(
                    self.raw.as_ptr(),
                    position,
                    index,
                    subindex,
                    target.as_mut_ptr(),
                    target.len(),
                    &mut size,
                    &mut abort_code,
                )
            };
            Errno::check(status).map_err(|errno| SdoError::new(errno, abort_code))?;
            let is_changed = target.iter().any(|byte| *byte != fill);
            match target.get_mut(size..) {
                Some(rest) if is_changed || size == 0 => {
                    rest.fill(0);
                    return Ok(size);
                }
                None if is_changed => return Err(SdoError::new(Errno::EOVERFLOW, 0)),
                _ => {}
            }
        }
        Err(SdoError::new(Errno::EIO, 0))
    }

    /// Writes an object of the slave at a ring position. Blocks until the slave answers.
    ///
    /// # Errors
    /// The slave aborts, does not answer or is not there.
    pub fn sdo_download(
        &self,
        position: u16,
        index: u16,
        subindex: u8,
        data: &[u8],
    ) -> Result<(), SdoError> {
        let mut abort_code = 0;
        // SAFETY: the master is valid as long as `self`; data and its length belong together,
        // the result is writable.
        let status = unsafe {
            (self.ecrt.functions().master_sdo_download)(
                self.raw.as_ptr(),
                position,
                index,
                subindex,
                data.as_ptr(),
                data.len(),
                &mut abort_code,
            )
        };
        Errno::check(status).map_err(|errno| SdoError::new(errno, abort_code))
    }
}

impl Master {
    /// Writes an object of the slave at a ring position by Complete Access, from subindex 0 on. Blocks until the
    /// slave answers.
    ///
    /// # Errors
    /// As [`sdo_download`](Self::sdo_download); `ENOSYS` if the library lacks the function.
    pub fn sdo_download_complete(
        &self,
        position: u16,
        index: u16,
        data: &[u8],
    ) -> Result<(), SdoError> {
        let function = self.ecrt.functions().master_sdo_download_complete;
        let function = function.ok_or(SdoError::new(Errno::ENOSYS, 0))?;
        let mut abort_code = 0;
        // SAFETY: as in `sdo_download`.
        let status = unsafe {
            function(self.raw.as_ptr(), position, index, data.as_ptr(), data.len(), &mut abort_code)
        };
        Errno::check(status).map_err(|errno| SdoError::new(errno, abort_code))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn abort_code_is_valid_with_eio_only() {
        let abort = |errno, code| SdoError::new(errno, code).abort_code;
        assert_eq!(abort(Errno::EIO, 0x0602_0000), Some(0x0602_0000));
        assert_eq!(abort(Errno::EIO, 0), None);
        assert_eq!(abort(Errno::EINVAL, 0x0602_0000), None);
    }
}
