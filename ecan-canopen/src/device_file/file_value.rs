use crate::NodeId;

use super::data_type::DataType;
use super::data_value::DataValue;

/// Value in a device file, which may depend on the node-ID (CiA 306-1, `$NODEID`).
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FileValue {
    /// The same value for every node.
    Fixed(DataValue),
    /// The node-ID plus a number, for integer types.
    NodeId {
        /// Number that is added to the node-ID.
        offset: i64,
    },
}

impl FileValue {
    /// The value for a node; excess bits of a sum are cut off.
    #[must_use]
    pub fn resolve(&self, data_type: DataType, node: NodeId) -> DataValue {
        match self {
            Self::Fixed(value) => value.clone(),
            Self::NodeId { offset } => {
                let sum = i128::from(*offset) + i128::from(node.get());
                data_type.integer(sum).unwrap_or(DataValue::Unsigned(sum as u64))
            }
        }
    }
}

impl From<DataValue> for FileValue {
    fn from(value: DataValue) -> Self {
        Self::Fixed(value)
    }
}
