//! Source of the objects of a drive.

use std::sync::Arc;

use super::config::DriveConfig;
use super::default_objects::{default_objects, fill_in};
use super::dictionary::Dictionary;
use super::eds;
use super::eds_error::EdsError;

/// Source of the objects of a drive, whose defaults depend on the node-ID.
#[derive(Clone, Debug)]
pub(super) enum ObjectSource {
    BuiltIn,
    Eds(Arc<str>),
}

impl ObjectSource {
    pub(super) fn objects(&self, config: &DriveConfig) -> Result<Dictionary, EdsError> {
        let motor = &config.motor;
        let mut list = match self {
            Self::BuiltIn => default_objects(config.node, config.serial, motor),
            Self::Eds(text) => {
                let mut objects = eds::parse(text, config.node.get())?;
                fill_in(&mut objects, motor);
                objects
            }
        };
        list.retain(|object| !config.quirks.missing.contains(&object.index));
        Ok(Dictionary::new(list))
    }
}
