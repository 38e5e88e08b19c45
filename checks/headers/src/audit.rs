//! Check that every exported function is documented and follows the conventions for texts and predicates.

use std::path::Path;

use crate::manifest::HEADERS;
use crate::sources;

/// Returns true if every buffer for a text has the parameters of all texts.
fn stores_text_by_convention(signature: &str) -> bool {
    let mut buffers = signature.split("*mut c_char").skip(1);
    buffers.all(|rest| rest.starts_with(", size: usize, needed: *mut usize"))
}

/// Adds the missing tags and the faulty signatures to `faults`.
pub fn audit(root: &Path, faults: &mut Vec<String>) -> Result<(), String> {
    for header in HEADERS {
        for function in sources::functions(root, header)? {
            let (name, location) = (&function.name, &function.location);
            if function.tag("@usage").is_none() {
                faults.push(format!("{location}: the comment of {name} has no @usage"));
            }
            if !stores_text_by_convention(&function.signature) {
                faults.push(format!(
                    "{location}: a text of {name} must be followed by size: usize, needed: *mut usize"
                ));
            }
            let is_predicate = function.summary().starts_with("Returns 1 ");
            if is_predicate
                && function.export.as_ref().is_some_and(|attribute| !attribute.contains("or 0"))
            {
                faults.push(format!("{location}: {name} answers yes or no: export it with `or 0`"));
            }
        }
    }
    Ok(())
}
