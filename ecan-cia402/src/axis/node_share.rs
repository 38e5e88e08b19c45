//! Part of an axis in its node.

/// Part of an axis in its node, which several axes may share: the node is configured once for all of them,
/// and one of them uses its SDO client to stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct NodeShare {
    /// Axes of the node in the table.
    pub(crate) count: usize,
    /// The axis is the first of its node in the table: it has the steps of the configuration.
    pub(crate) is_first: bool,
    /// All axes of the node are ready for its configuration.
    pub(crate) may_begin: bool,
    /// The axis wants its node to be configured.
    pub(crate) is_setup_wanted: bool,
    /// The axis may begin SDO transfers to read the state of its drive and to stop it.
    pub(crate) may_poll: bool,
    /// An axis of the node has a fresh status.
    pub(crate) is_heard: bool,
}

impl Default for NodeShare {
    /// The only axis of its node.
    fn default() -> Self {
        Self {
            count: 1,
            is_first: true,
            may_begin: true,
            is_setup_wanted: false,
            may_poll: true,
            is_heard: false,
        }
    }
}
