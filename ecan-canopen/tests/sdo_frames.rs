//! SDO frames: golden bytes, and back again.

use ecan_canopen::{ClientFrame, Initiate, SdoDecodeError, Segment, ServerFrame};
use ecan_protocol::object::AbortCode;
use proptest::prelude::*;

fn client(frame: ClientFrame, bytes: [u8; 8]) {
    assert_eq!(frame.to_bytes(), bytes);
    assert_eq!(ClientFrame::parse(&bytes), Ok(frame));
}

fn server(frame: ServerFrame, bytes: [u8; 8]) {
    assert_eq!(frame.to_bytes(), bytes);
    assert_eq!(ServerFrame::parse(&bytes), Ok(frame));
}

#[test]
fn expedited_upload() {
    let (index, subindex) = (0x1018, 1);
    client(ClientFrame::Upload { index, subindex }, [0x40, 0x18, 0x10, 0x01, 0, 0, 0, 0]);
    let initiate = Initiate::expedited(&[0x55, 0x05, 0, 0]).unwrap();
    let answer = ServerFrame::Upload { index, subindex, initiate };
    server(answer, [0x43, 0x18, 0x10, 0x01, 0x55, 0x05, 0, 0]);
}

#[test]
fn expedited_downloads_of_each_length() {
    let (index, subindex) = (0x6060, 0);
    for (value, command) in
        [(&[8][..], 0x2F), (&[8, 1], 0x2B), (&[8, 1, 2], 0x27), (&[8, 1, 2, 3], 0x23)]
    {
        let initiate = Initiate::expedited(value).unwrap();
        let bytes = ClientFrame::Download { index, subindex, initiate }.to_bytes();
        assert_eq!((bytes[0], &bytes[4..4 + value.len()]), (command, value));
    }
    server(ServerFrame::Download { index, subindex }, [0x60, 0x60, 0x60, 0, 0, 0, 0, 0]);
    let unsized_value = Initiate::Expedited { data: [1, 2, 3, 4], length: None };
    let frame = ClientFrame::Download { index, subindex, initiate: unsized_value };
    client(frame, [0x22, 0x60, 0x60, 0, 1, 2, 3, 4]);
    assert_eq!(Initiate::expedited(&[]), None);
    assert_eq!(Initiate::expedited(&[0; 5]), None);
}

#[test]
fn segments_toggle_and_tell_their_length() {
    let initiate = Initiate::Segmented { size: Some(9) };
    let answer = ServerFrame::Upload { index: 0x1008, subindex: 0, initiate };
    server(answer, [0x41, 0x08, 0x10, 0, 9, 0, 0, 0]);
    client(ClientFrame::UploadSegment { toggle: false }, [0x60, 0, 0, 0, 0, 0, 0, 0]);
    client(ClientFrame::UploadSegment { toggle: true }, [0x70, 0, 0, 0, 0, 0, 0, 0]);
    let first = Segment::new(false, b"ECAN dr", false);
    server(ServerFrame::UploadSegment(first), [0, b'E', b'C', b'A', b'N', b' ', b'd', b'r']);
    let last = Segment::new(true, b"iv", true);
    server(ServerFrame::UploadSegment(last), [0x1B, b'i', b'v', 0, 0, 0, 0, 0]);
    assert_eq!(last.bytes(), b"iv");
    client(ClientFrame::DownloadSegment(last), [0x1B, b'i', b'v', 0, 0, 0, 0, 0]);
    server(ServerFrame::DownloadSegment { toggle: true }, [0x30, 0, 0, 0, 0, 0, 0, 0]);
}

#[test]
fn block_transfer() {
    let (index, subindex) = (0x1F50, 1);
    let upload = ClientFrame::BlockUpload {
        index,
        subindex,
        block_size: 127,
        switch_threshold: 0,
        crc: true,
    };
    client(upload, [0xA4, 0x50, 0x1F, 1, 127, 0, 0, 0]);
    let answer = ServerFrame::BlockUpload { index, subindex, size: Some(100), crc: true };
    server(answer, [0xC6, 0x50, 0x1F, 1, 100, 0, 0, 0]);
    client(ClientFrame::BlockUploadStart, [0xA3, 0, 0, 0, 0, 0, 0, 0]);
    let ack = ClientFrame::BlockUploadAck { received: 15, block_size: 100 };
    client(ack, [0xA2, 15, 100, 0, 0, 0, 0, 0]);
    server(
        ServerFrame::BlockUploadEnd { unused: 5, crc: 0x31C3 },
        [0xD5, 0xC3, 0x31, 0, 0, 0, 0, 0],
    );
    client(ClientFrame::BlockUploadEnd, [0xA1, 0, 0, 0, 0, 0, 0, 0]);
    let download = ClientFrame::BlockDownload { index, subindex, size: Some(7), crc: true };
    client(download, [0xC6, 0x50, 0x1F, 1, 7, 0, 0, 0]);
    let accept = ServerFrame::BlockDownload { index, subindex, block_size: 64, crc: true };
    server(accept, [0xA4, 0x50, 0x1F, 1, 64, 0, 0, 0]);
    server(
        ServerFrame::BlockDownloadAck { received: 1, block_size: 64 },
        [0xA2, 1, 64, 0, 0, 0, 0, 0],
    );
    client(
        ClientFrame::BlockDownloadEnd { unused: 0, crc: 0x1234 },
        [0xC1, 0x34, 0x12, 0, 0, 0, 0, 0],
    );
    server(ServerFrame::BlockDownloadEnd, [0xA1, 0, 0, 0, 0, 0, 0, 0]);
}

#[test]
fn aborts() {
    let code = AbortCode::NO_OBJECT;
    let bytes = [0x80, 0x34, 0x12, 2, 0, 0, 0x02, 0x06];
    client(ClientFrame::Abort { index: 0x1234, subindex: 2, code }, bytes);
    server(ServerFrame::Abort { index: 0x1234, subindex: 2, code }, bytes);
}

#[test]
fn invalid_sdo_frames_are_rejected() {
    assert_eq!(ClientFrame::parse(&[0x40; 7]), Err(SdoDecodeError::Length { length: 7 }));
    assert_eq!(ServerFrame::parse(&[]), Err(SdoDecodeError::Length { length: 0 }));
    let command = 0xE0;
    let unknown = Err(SdoDecodeError::Command { command });
    assert_eq!(ClientFrame::parse(&[command, 0, 0, 0, 0, 0, 0, 0]), unknown);
}

proptest! {
    #[test]
    fn any_bytes_are_a_frame_or_an_error_and_frames_come_back(
        data in proptest::collection::vec(any::<u8>(), 0..10),
    ) {
        if let Ok(frame) = ClientFrame::parse(&data) {
            prop_assert_eq!(ClientFrame::parse(&frame.to_bytes()), Ok(frame));
        }
        if let Ok(frame) = ServerFrame::parse(&data) {
            prop_assert_eq!(ServerFrame::parse(&frame.to_bytes()), Ok(frame));
        }
    }

    #[test]
    fn segments_keep_their_bytes(
        value in proptest::collection::vec(any::<u8>(), 0..=7),
        toggle: bool,
        last: bool,
    ) {
        let segment = Segment::new(toggle, &value, last);
        let frame = ClientFrame::DownloadSegment(segment);
        let Ok(ClientFrame::DownloadSegment(back)) = ClientFrame::parse(&frame.to_bytes()) else {
            return Err(TestCaseError::fail("no segment"));
        };
        prop_assert_eq!(back.bytes(), &value[..]);
        prop_assert_eq!((back.toggle, back.last), (toggle, last));
    }
}
