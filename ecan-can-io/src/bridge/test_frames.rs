//! Frames for property tests.

use ecan_protocol::can::{CanFrame, CanId, Dlc};
use proptest::prelude::*;

fn any_id() -> impl Strategy<Value = CanId> {
    prop_oneof![
        (0..=0x7FFu16).prop_map(|id| CanId::standard(id).unwrap()),
        (0..=0x1FFF_FFFFu32).prop_map(|id| CanId::extended(id).unwrap()),
    ]
}

/// Any frame of a classic or CAN FD bus; with the error state indicator only if requested, because
/// slcan has none.
pub(crate) fn any_frame(has_esi: bool) -> impl Strategy<Value = CanFrame> {
    let classic = (any_id(), prop::collection::vec(any::<u8>(), 0..=8))
        .prop_map(|(id, data)| CanFrame::classic(id, &data).unwrap());
    let remote = (any_id(), 0..=8u8)
        .prop_map(|(id, dlc)| CanFrame::remote(id, Dlc::new(dlc).unwrap()).unwrap());
    let fd = (any_id(), 0..16u8, any::<[u8; 32]>(), any::<(bool, bool)>()).prop_map(move |parts| {
        let (id, dlc, half, (brs, esi)) = parts;
        let data = [half, half].concat();
        let length = Dlc::new(dlc).unwrap().fd_len();
        CanFrame::fd(id, &data[..length], brs, esi && has_esi).unwrap()
    });
    prop_oneof![classic, remote, fd]
}
