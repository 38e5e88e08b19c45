//! Description of a network by device files, and its check before anything is sent.

mod network_check;
mod node_description;

pub use node_description::{
    ChannelDescription, DescriptionError, NetworkDescription, NetworkFault, NetworkFaultKind,
    NodeDescription, PdoName,
};
