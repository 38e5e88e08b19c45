//! Device files that a configuration names; each is read once.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ecan_canopen::DeviceFile;
use ecan_protocol::text::Printable;

/// Returns the bytes of a file with this path in the configuration, or a reason.
pub(crate) type ReadFile<'r> = dyn FnMut(&Path) -> Result<Vec<u8>, String> + 'r;

pub(crate) struct DeviceFiles<'r> {
    read: Box<ReadFile<'r>>,
    /// `None` for one that cannot be used; its faults are reported once.
    devices: BTreeMap<PathBuf, Option<Arc<DeviceFile>>>,
}

impl<'r> DeviceFiles<'r> {
    pub(crate) fn new(read: Box<ReadFile<'r>>) -> Self {
        Self { read, devices: BTreeMap::new() }
    }

    /// The device file with this path in the configuration.
    pub(crate) fn device(&mut self, path: &Path) -> Result<Arc<DeviceFile>, String> {
        if let Some(known) = self.devices.get(path) {
            return known
                .clone()
                .ok_or_else(|| format!("{}: see above", Printable(path.display())));
        }
        let read = (self.read)(path).and_then(|bytes| {
            DeviceFile::parse(&bytes)
                .map_err(|faults| format!("{}: {faults}", Printable(path.display())))
        });
        let device = read.map(Arc::new);
        self.devices.insert(path.to_owned(), device.as_ref().ok().cloned());
        device
    }

    /// The text with this path in the configuration.
    pub(crate) fn text(&mut self, path: &Path) -> Result<String, String> {
        let bytes = (self.read)(path)?;
        String::from_utf8(bytes)
            .map_err(|error| format!("{}: not UTF-8: {error}", Printable(path.display())))
    }
}
