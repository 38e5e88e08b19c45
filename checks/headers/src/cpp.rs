//! The codes in the C++ header: an enumeration with a value for each `ecan_result_t`.

use std::fmt::Write;
use std::path::Path;

use crate::read;

pub const HEADER: &str = "include/ecan_lite/error.hpp";
const SOURCE: &str = "capi/boundary/src/result.rs";
const START: &str = "enum class errc : int {\n";

/// Renders the C++ header, which has only this generated part.
pub fn error_header(root: &Path) -> Result<String, String> {
    let header = read(&root.join(HEADER))?;
    let parts = header.split_once(START);
    let parts = parts.and_then(|(before, rest)| Some((before, &rest[rest.find("};")?..])));
    let (before, after) = parts.ok_or_else(|| format!("{HEADER}: no enumeration `errc`"))?;
    let mut values = String::new();
    for line in read(&root.join(SOURCE))?.lines() {
        let Some((code, _)) = line.trim().split_once(" = ").filter(|(_, rest)| rest.contains("=>"))
        else {
            continue;
        };
        let name = match code.strip_prefix("ECAN_ERR_").or(code.strip_prefix("ECAN_")) {
            // C defines NULL as a macro, and a variable may be called null.
            Some("NULL") => "null_pointer".to_owned(),
            Some(name) => name.to_lowercase(),
            None => continue,
        };
        let _ = writeln!(values, "    {name} = {code},");
    }
    Ok(format!("{before}{START}{values}{after}"))
}
