//! Parameters of the nodes of a network.

use std::sync::Arc;

use super::address::NodeHandle;
use super::boot::{ParameterDownload, ParameterError, ParameterSet, ParameterState};
use super::network::Network;
use super::step_failure::NodeAccessError;

impl Network {
    /// Parameters that [`NodeAction::WriteParameters`](crate::NodeAction::WriteParameters) writes to
    /// a node; none if the set is empty. Allocates.
    pub fn set_parameters(&mut self, handle: NodeHandle, set: Arc<ParameterSet>) {
        if let Some(node) = self.node_mut(handle) {
            let is_empty = *set == ParameterSet::default();
            node.parameters = (!is_empty).then(|| ParameterDownload::new(set));
        }
    }

    /// Writes the parameters of a node, as far as possible in a cycle. Returns whether that is
    /// complete.
    pub(super) fn write_parameters(
        &mut self,
        handle: NodeHandle,
        starts_over: bool,
    ) -> Result<bool, NodeAccessError> {
        let Some(mut download) = self.node_mut(handle).and_then(|node| node.parameters.take())
        else {
            return Ok(true);
        };
        if starts_over {
            download.restart();
        }
        let state = download.advance(self, handle);
        if let Some(node) = self.node_mut(handle) {
            node.parameters = Some(download);
        }
        match state {
            ParameterState::Running => Ok(false),
            ParameterState::Written | ParameterState::Unchanged => Ok(true),
            ParameterState::Failed(error) => Err(access_error(error)),
        }
    }
}

fn access_error(error: ParameterError) -> NodeAccessError {
    match error {
        ParameterError::Transfer { subject: Some(subject), fault } => {
            NodeAccessError::Parameter { index: subject.index, subindex: subject.subindex, fault }
        }
        ParameterError::Transfer { subject: None, fault } => fault.into(),
        ParameterError::Start { error, .. } => error.into(),
        ParameterError::Mismatch { subject, found, expected } => {
            let (index, subindex) = (subject.index, subject.subindex);
            NodeAccessError::ParameterMismatch { index, subindex, found, expected }
        }
    }
}
