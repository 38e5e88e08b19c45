//! Downloads of a DCF, in the order of a device.

use ecan_canopen::{
    DataType, DataValue, DeviceFile, Download, DownloadScope, FileValue, decode_concise_dcf,
    encode_concise_dcf,
};
use proptest::prelude::*;

use super::{everything, node};

fn list(file: &DeviceFile, scope: DownloadScope) -> Vec<(u16, u8, u32)> {
    let downloads = file.downloads(node(5), scope).unwrap();
    let number = |download: Download| {
        let raw = download.data.iter().rev().fold(0, |raw, byte| raw << 8 | u32::from(*byte));
        (download.index, download.subindex, raw)
    };
    downloads.into_iter().map(number).collect()
}

fn set(file: &mut DeviceFile, index: u16, subindex: u8, value: u64) {
    file.entry_mut(index, subindex).unwrap().parameter =
        Some(FileValue::Fixed(DataValue::Unsigned(value)));
}

#[test]
fn changed_pdo_is_disabled_while_it_changes() {
    let mut file = everything();
    // The number of entries of the compact mapping is constant: the mapping is fixed.
    assert_eq!(
        list(&file, DownloadScope::Changed),
        [(0x1017, 0, 100), (0x1400, 1, 0x8000_0305), (0x1400, 2, 1), (0x1400, 1, 0x305)]
    );
    let count = file.entry_mut(0x1600, 0).unwrap();
    count.access = ecan_canopen::AccessType::ReadWrite;
    set(&mut file, 0x1600, 0, 2);
    assert_eq!(
        list(&file, DownloadScope::Changed),
        [
            (0x1017, 0, 100),
            (0x1400, 1, 0x8000_0305),
            (0x1400, 2, 1),
            (0x1600, 0, 0),
            (0x1600, 1, 0x6000_0108),
            (0x1600, 2, 0x6000_0208),
            (0x1600, 0, 2),
            (0x1400, 1, 0x305),
        ]
    );
}

/// The EDS of a simple device leaves the COB-IDs open.
#[test]
fn pdo_without_cob_id_has_that_of_predefined_set() {
    let mut file = everything();
    let cob_id = file.entry_mut(0x1400, 1).unwrap();
    (cob_id.default, cob_id.parameter) = (None, None);
    assert_eq!(
        list(&file, DownloadScope::Changed),
        [(0x1017, 0, 100), (0x1400, 1, 0x8000_0205), (0x1400, 2, 1), (0x1400, 1, 0x205)]
    );
}

#[test]
fn disabled_pdo_stays_disabled() {
    let mut file = everything();
    set(&mut file, 0x1400, 1, 0x8000_0205);
    assert_eq!(
        list(&file, DownloadScope::Changed),
        [(0x1017, 0, 100), (0x1400, 1, 0x8000_0205), (0x1400, 2, 1)]
    );
}

#[test]
fn scope_decides_on_unchanged_values() {
    let mut file = everything();
    set(&mut file, 0x2009, 0, 0xFFFF);
    assert!(!list(&file, DownloadScope::Changed).contains(&(0x2009, 0, 0xFFFF)));
    assert!(list(&file, DownloadScope::All).contains(&(0x2009, 0, 0xFFFF)));
}

#[test]
fn cob_ids_are_invalid_while_they_change() {
    let mut file = everything();
    set(&mut file, 0x1014, 0, 0x123);
    set(&mut file, 0x1005, 0, 0x4000_0081);
    let downloads = list(&file, DownloadScope::Changed);
    assert_eq!(
        downloads[..5],
        [
            (0x1005, 0, 0x81),
            (0x1005, 0, 0x4000_0081),
            (0x1014, 0, 0x8000_0123),
            (0x1014, 0, 0x123),
            (0x1017, 0, 100),
        ]
    );
}

#[test]
fn sdo_parameters_are_invalid_while_they_change() {
    let text = "\
[1000]
DataType=7
AccessType=ro
ParameterName=a
[1280]
ObjectType=9
SubNumber=4
ParameterName=SDO client
[1280sub0]
ParameterName=a
DataType=5
AccessType=ro
[1280sub1]
ParameterName=b
DataType=7
AccessType=rw
ParameterValue=0x605
[1280sub2]
ParameterName=c
DataType=7
AccessType=rw
ParameterValue=0x585
[1280sub3]
ParameterName=d
DataType=5
AccessType=rw
ParameterValue=5
";
    let file = DeviceFile::parse(text.as_bytes()).unwrap();
    assert_eq!(
        list(&file, DownloadScope::Changed),
        [
            (0x1280, 1, 0x8000_0605),
            (0x1280, 2, 0x8000_0585),
            (0x1280, 3, 5),
            (0x1280, 1, 0x605),
            (0x1280, 2, 0x585),
        ]
    );
}

/// A file may describe a COB-ID with a type that has no bit for "invalid".
#[test]
fn cob_id_of_another_type_is_downloaded_once() {
    let mut file = everything();
    for (index, subindex) in [(0x1400, 1), (0x1014, 0), (0x1005, 0)] {
        let entry = file.entry_mut(index, subindex).unwrap();
        entry.data_type = DataType::Unsigned16;
        entry.default = None;
        entry.parameter = Some(FileValue::Fixed(DataValue::Unsigned(0x123)));
    }
    assert_eq!(
        list(&file, DownloadScope::Changed),
        [
            (0x1005, 0, 0x123),
            (0x1014, 0, 0x123),
            (0x1017, 0, 100),
            (0x1400, 1, 0x123),
            (0x1400, 2, 1),
        ]
    );
}

#[test]
fn objects_that_refuse_downloads_are_left_out() {
    let mut file = everything();
    file.entry_mut(0x1017, 0).unwrap().flags.0 = 1;
    // read-only
    set(&mut file, 0x1018, 1, 7);
    let downloads = list(&file, DownloadScope::All);
    assert!(downloads.iter().all(|(index, ..)| *index != 0x1017 && *index != 0x1018));
}

#[test]
fn value_of_another_type_is_reported_with_its_object() {
    let mut file = everything();
    set(&mut file, 0x1017, 0, 70_000);
    let error = file.downloads(node(5), DownloadScope::Changed).unwrap_err();
    assert_eq!(
        error.to_string(),
        "object 0x1017:00: 70000 is out of range for UNSIGNED16; allowed: 0 to 65535"
    );
}

proptest! {
    #[test]
    fn concise_dcf_is_decoded_as_encoded(
        downloads in prop::collection::vec(
            (any::<u16>(), any::<u8>(), prop::collection::vec(any::<u8>(), 0..20)),
            0..20,
        ),
    ) {
        let download = |(index, subindex, data)| Download { index, subindex, data };
        let downloads: Vec<_> = downloads.into_iter().map(download).collect();
        let bytes = encode_concise_dcf(&downloads);
        prop_assert_eq!(decode_concise_dcf(&bytes), Ok(downloads));
    }

    #[test]
    fn any_concise_dcf_is_decoded_or_rejected(
        bytes in prop::collection::vec(any::<u8>(), 0..60),
    ) {
        if let Ok(downloads) = decode_concise_dcf(&bytes)
            && !bytes.is_empty()
        {
            prop_assert_eq!(encode_concise_dcf(&downloads), bytes);
        }
    }
}
