//! Device files: what is read is written and read again, and gives a node.
#![no_main]

use ecan_canopen::{DeviceFile, NodeId};
use ecan_sim::{Drive, DriveConfig, Node, NodeOutput};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let file = match DeviceFile::parse(data) {
        Ok(file) => file,
        Err(faults) => return assert!(!faults.faults.is_empty()),
    };
    let written = file.write();
    assert_eq!(DeviceFile::parse(written.as_bytes()).as_ref(), Ok(&file), "{written}");
    for entry in file.entries().take(2) {
        assert_eq!(file.find(&file.label(entry)), Ok(entry));
    }
    // A node takes longer than all of the above.
    let Some(node) = NodeId::from_raw(5).filter(|_| data.len().is_multiple_of(8)) else { return };
    let mut drive = Drive::from_device_file(&DriveConfig::new(node), &file);
    let mut out = NodeOutput::new();
    drive.started(0, &mut out);
    let boot_ns = 50_000_000;
    drive.advance(boot_ns, &mut out);
    while out.pop().is_some() {}
});
