//! Multiplexed PDOs (CiA 301, 7.2.2.4)
//!
//! One object per frame, addressed in the frame. Send the bytes by igh_mcan_port_send_can() with the COB-ID
//! of the RPDO, and read those of igh_cia402_process_rx_ex() or igh_mcan_port_receive().

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, mirror, pointers};
use ecan_c_export::export;
use ecan_canopen::{Mpdo, MpdoAddress, NodeId};

/// Bytes of an MPDO.
pub const IGH_CANOPEN_MPDO_BYTES: usize = 8;

mirror! {
    /// A multiplexed PDO.
    #[derive(PartialEq, Eq)]
    pub struct igh_canopen_mpdo_t from rust: Mpdo {
        /// Index of the object.
        index: u16,
        /// Subindex of the object.
        subindex: u8,
        /// 1: source address mode, an object of the producer `node_id`. 0: destination address mode,
        /// an object of the consumer.
        is_source: u8 = matches!(rust.address, MpdoAddress::Source(_)).into(),
        /// Node-ID, 1 to 127; 0 in destination address mode for all consumers.
        node_id: u8 = match rust.address {
            MpdoAddress::Source(node) | MpdoAddress::Destination(Some(node)) => node.get(),
            MpdoAddress::Destination(None) => 0,
        },
        /// Must be 0; for fields of later versions.
        reserved: [u8; 7] = [0; 7],
        /// Value, little endian; bytes beyond the length of the object have no meaning.
        data: [u8; 4],
    }
}

impl igh_canopen_mpdo_t {
    fn to_rust(self, call: Call) -> Result<Mpdo, ecan_result_t> {
        call.reserved("mpdo", &self.reserved)?;
        let node = NodeId::new(self.node_id);
        let address = match (self.is_source, node) {
            (0, None) if self.node_id == 0 => MpdoAddress::Destination(None),
            (0, Some(node)) => MpdoAddress::Destination(Some(node)),
            (1, Some(node)) => MpdoAddress::Source(node),
            (0 | 1, None) => {
                let text = format_args!(
                    "{} is out of range; allowed: 1 to 127, or 0 with is_source 0",
                    self.node_id
                );
                return Err(call.argument("node_id", text));
            }
            (value, _) => {
                let text = format_args!("{value} is out of range; allowed: 0, 1");
                return Err(call.argument("is_source", text));
            }
        };
        Ok(Mpdo { address, index: self.index, subindex: self.subindex, data: self.data })
    }
}

/// Encodes an MPDO.
///
/// @param mpdo  The MPDO.
/// @param data  Gets IGH_CANOPEN_MPDO_BYTES bytes, the data of the CAN frame.
///
/// @usage   rt, any thread, any time
/// @return  ECAN_OK; ECAN_ERR_ARGUMENT for a node-ID out of range.
#[export(call)]
pub fn igh_canopen_mpdo_encode(mpdo: *const igh_canopen_mpdo_t, data: *mut u8) {
    pointers!(call, read(mpdo));
    let data: *mut [u8; IGH_CANOPEN_MPDO_BYTES] = data.cast();
    pointers!(call, out(data));
    data.set(mpdo.to_rust(call)?.to_bytes());
}

/// Decodes an MPDO.
///
/// @param mpdo    Gets the MPDO.
/// @param data    Data of a CAN frame.
/// @param length  Its bytes.
///
/// @usage   rt, any thread, any time
/// @return  ECAN_OK; ECAN_ERR_FRAME for data that are not an MPDO.
#[export(call)]
pub fn igh_canopen_mpdo_decode(mpdo: *mut igh_canopen_mpdo_t, data: *const u8, length: usize) {
    pointers!(call, out(mpdo), items(data, length));
    let found = Mpdo::parse(data)
        .map_err(|error| call.fail(ecan_result_t::ECAN_ERR_FRAME, format_args!("{error}")))?;
    mpdo.set(found.into());
}
