//! A node that only acknowledges.

use super::Node;

/// Sends nothing by itself; its controller acknowledges what others send.
#[derive(Clone, Copy, Debug, Default)]
pub struct SilentNode;

impl Node for SilentNode {}
