//! Description of a network by device files, and its check before anything is sent.

mod cob_id_check;
mod load_check;
mod network_check;
mod network_description;
mod network_fault;
mod node_description;
mod parameter_check;
mod pdo_check;

pub use network_description::{ChannelDescription, NetworkDescription};
pub use network_fault::{NetworkFault, NetworkFaultKind, PdoName};
pub use node_description::{DescriptionError, NodeDescription};
