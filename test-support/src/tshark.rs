//! tshark on a capture.

use std::path::Path;
use std::process::Command;

/// The fields of each packet that a display filter passes, with `|` between and commas between those
/// of one name; `None` without tshark.
pub fn fields_of(
    capture: &Path,
    dissector: &str,
    filter: &str,
    names: &[&str],
) -> Option<Vec<String>> {
    let mut command = Command::new("tshark");
    command.args(["-X", &format!("lua_script:{dissector}"), "-r"]).arg(capture);
    command.args(["-Y", filter, "-T", "fields", "-E", "separator=|"]);
    command.args(names.iter().flat_map(|name| ["-e", name]));
    // No preferences or plug-ins of whoever runs the test.
    let home = capture.parent().unwrap();
    command.env("HOME", home).env("XDG_CONFIG_HOME", home);
    let output = match command.output() {
        Ok(output) => output,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            eprintln!("skipped: there is no tshark");
            return None;
        }
        Err(error) => panic!("tshark: {error}"),
    };
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && !errors.contains("Lua"), "{errors}");
    // From 4.2 on tshark has words for flags.
    let text = String::from_utf8(output.stdout).unwrap();
    let text = text.replace("True", "1").replace("False", "0");
    Some(text.lines().map(str::to_owned).collect())
}
