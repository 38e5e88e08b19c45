//! Configurations: downloads of a DCF, and concise DCF.
#![no_main]

use ecan_canopen::{DeviceFile, DownloadScope, NodeId, decode_concise_dcf, encode_concise_dcf};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    // The first byte selects one of the two formats.
    let Some((format, data)) = data.split_first() else { return };
    if format.is_multiple_of(4) {
        if let Ok(downloads) = decode_concise_dcf(data)
            && !data.is_empty()
        {
            assert_eq!(encode_concise_dcf(&downloads), data);
        }
        return;
    }
    let Ok(mut file) = DeviceFile::parse(data) else { return };
    for id in [1, 127] {
        let Some(node) = NodeId::from_raw(id) else { continue };
        for scope in [DownloadScope::Changed, DownloadScope::All] {
            let downloads = file.downloads(node, scope).expect("values that were read");
            let bytes = encode_concise_dcf(&downloads);
            assert_eq!(decode_concise_dcf(&bytes).as_ref(), Ok(&downloads));
            // Values that a node returns are kept.
            for download in downloads {
                let (index, subindex) = (download.index, download.subindex);
                assert_eq!(file.set_parameter(index, subindex, &download.data), Ok(true));
            }
        }
    }
    let written = file.write();
    assert!(DeviceFile::parse(written.as_bytes()).is_ok(), "{written}");
});
