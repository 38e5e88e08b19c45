//! Check that every exported function is documented, follows the conventions for texts and predicates,
//! and is listed in a version script.

use std::collections::BTreeSet;
use std::path::Path;

use crate::manifest::{HEADERS, LIBRARIES};
use crate::{read, sources};

/// Returns true if every buffer for a text has the parameters of all texts.
fn stores_text_by_convention(signature: &str) -> bool {
    let mut buffers = signature.split("*mut c_char").skip(1);
    buffers.all(|rest| rest.starts_with(", size: usize, needed: *mut usize"))
}

/// Adds the missing tags and names to `faults`.
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
    for library in LIBRARIES {
        let map = read(&root.join("capi").join(library.map))?;
        let listed: BTreeSet<&str> = map
            .lines()
            .filter_map(|line| line.trim().strip_suffix(';'))
            .filter(|name| name.starts_with("ecan_") || name.starts_with("igh_"))
            // In no header: for the other library of the same version.
            .filter(|name| !name.starts_with("ecan_private_"))
            .collect();
        let private = map.lines().filter_map(|line| line.strip_prefix("ECAN_PRIVATE_"));
        for node in private.filter(|node| *node != concat!(env!("CARGO_PKG_VERSION"), " {")) {
            faults.push(format!(
                "capi/{}: the node ECAN_PRIVATE_{node} names another version than {}",
                library.map,
                env!("CARGO_PKG_VERSION")
            ));
        }
        let mut exported = BTreeSet::new();
        for header in HEADERS.iter().filter(|header| library.headers.contains(&header.name)) {
            for function in sources::functions(root, header)? {
                exported.insert(function.name);
            }
        }
        for name in exported.iter().filter(|name| !listed.contains(name.as_str())) {
            faults.push(format!(
                "capi/{}: {name} is not listed: add it to the newest node, and to the change log of \
                 its header in checks/headers/changes",
                library.map
            ));
        }
        for name in listed.iter().filter(|name| !exported.contains(**name)) {
            faults.push(format!("capi/{}: {name} is listed but does not exist", library.map));
        }
    }
    Ok(())
}
