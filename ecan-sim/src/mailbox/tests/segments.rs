//! Transfers in mailboxes of every size give the same data.

use super::fixture::{Fixture, MAILBOX};

#[test]
fn every_mailbox_size_moves_the_same_data() {
    let data: Vec<u8> = (0..16).map(|byte| byte * 7 + 1).collect();
    let whole = Fixture::with_complete_access(MAILBOX).upload(0x8001, 0, true).unwrap();
    assert!(whole.len() > 120, "several segments even in a full mailbox");
    for mailbox in 16..=200 {
        let mut fixture = Fixture::with_complete_access(mailbox);
        fixture.download(0x7020, 1, false, &data).unwrap();
        assert_eq!(fixture.value(0x7020, 1), data, "down, {mailbox} bytes");
        assert_eq!(
            fixture.upload(0x7020, 1, false).as_deref(),
            Ok(&data[..]),
            "up, {mailbox} bytes"
        );
        assert_eq!(fixture.upload(0x8001, 0, true).as_deref(), Ok(&whole[..]), "{mailbox} bytes");
    }
}

#[test]
fn segmented_download_of_a_whole_object() {
    let mut fixture = Fixture::with_complete_access(20);
    let mut block = vec![24, 0];
    for chunk in 0..24_u16 {
        block.extend_from_slice(&(0x1A00 + chunk).to_le_bytes());
    }
    fixture.download(0x1C13, 0, true, &block).unwrap();
    assert_eq!(fixture.upload(0x1C13, 0, true), Ok(block));
}
