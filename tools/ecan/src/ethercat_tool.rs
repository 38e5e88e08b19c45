//! Runs IgH's command line tool `ethercat` and parses its output.
//!
//! Supports the output of 1.5 and 1.6. Uses long options only: `-p` is the position of a slave in
//! IgH's tool, but the password in manual 15.3.1.

use std::ffi::OsStr;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread;
use std::time::Duration;

use ecan_host::denies_object;
use ecan_protocol::device::AlState;
use ecan_protocol::object::{AbortCode, ObjectType, lookup};
use ecan_protocol::text::Printable;
use thiserror::Error;

use crate::failure::Failure;
use crate::program::{self, RunError};

/// Default paths of the tool, for a PATH without it.
const DEFAULT_PATHS: [&str; 4] = [
    "/opt/etherlab/bin/ethercat",
    "/usr/local/etherlab/bin/ethercat",
    "/usr/local/bin/ethercat",
    "/usr/bin/ethercat",
];

/// Time limit of a command; the master itself waits some seconds for a mailbox.
pub const LIMIT: Duration = Duration::from_secs(5);
pub const WRITE_LIMIT: Duration = Duration::from_secs(600);
/// Messages of transfers that can succeed when they are repeated: while the master reads the SDO
/// dictionary, about a second per slave after a scan, it takes the responses of other transfers, and
/// they take those about the dictionary.
const SDO_COLLISION: &str = "Input/output error";
const FOE_COLLISION: &str = "FOE_MBOX_PROT_ERROR";
/// Pause before the repetition, and number of attempts.
const COLLISION_PAUSE: Duration = Duration::from_millis(250);
const ATTEMPTS: u32 = 20;

#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum ToolError {
    #[error(
        "IgH's tool ethercat not found on the PATH or as {}; set --ethercat",
        DEFAULT_PATHS.join(", ")
    )]
    NotFound,
    #[error("cannot start {}: {reason}", Printable(program.display()))]
    NotStarted { program: PathBuf, reason: String },
    #[error("ethercat {command}: {message}")]
    Failed { command: &'static str, message: String },
    #[error("ethercat {command} did not exit within {} s and was killed", limit.as_secs())]
    TimedOut { command: &'static str, limit: Duration },
    #[error("ethercat {command} was terminated by a signal")]
    Killed { command: &'static str },
    #[error("ethercat {command} printed \"{text}\", which is not output of IgH's tool")]
    Unreadable { command: &'static str, text: String },
    #[error(
        "foe_write of this ethercat tool has no option --position; use IgH's tool (see foe_write \
         --help)"
    )]
    NoPosition,
}

impl ToolError {
    fn is_collision(&self, collision: &str) -> bool {
        matches!(self, Self::Failed { message, .. } if message.contains(collision))
    }

    /// Returns whether other calls fail too: no tool, or no master for it.
    pub fn is_about_host(&self) -> bool {
        match self {
            Self::NotFound | Self::NotStarted { .. } | Self::NoPosition => true,
            Self::Failed { message, .. } => {
                ["master device", "version magic", "module information", "master information"]
                    .iter()
                    .any(|text| message.contains(text))
            }
            Self::TimedOut { .. } | Self::Killed { .. } | Self::Unreadable { .. } => false,
        }
    }

    /// Message with a remedy, if it needs one.
    pub fn text(&self) -> String {
        match self.remedy() {
            "" => self.to_string(),
            remedy => format!("{self}; {remedy}"),
        }
    }

    fn remedy(&self) -> &'static str {
        let Self::Failed { message, .. } = self else { return "" };
        let remedies = [
            ("Permission denied", "run with sudo, or get access to /dev/EtherCAT*"),
            (
                "No such file or directory",
                "check that the master's module is loaded: systemctl start ethercat",
            ),
            (
                "version magic",
                "tool and kernel module are of different versions: use the tool that \
                               was installed with the module",
            ),
        ];
        let fits = |pair: &&(&str, &str)| self.is_about_host() && message.contains(pair.0);
        remedies.iter().find(fits).map_or("", |(_, remedy)| remedy)
    }
}

impl From<ToolError> for Failure {
    fn from(error: ToolError) -> Self {
        match error.is_about_host() {
            true => Self::Master(error.text()),
            false => Self::Rejected(error.text()),
        }
    }
}

/// Slave in the output of `ethercat slaves`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SlaveEntry {
    pub position: usize,
    /// Alias, if it is set on this slave and not on one before it.
    pub alias: Option<u16>,
    pub state: String,
    /// `None` for other text, for example during a scan.
    pub al_state: Option<AlState>,
}

/// Arguments listed by `foe_write --help`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct FoeArguments {
    has_password_argument: bool,
    has_password_option: bool,
}

impl FoeArguments {
    fn read(help: &str) -> Result<Self, ToolError> {
        if !help.contains("--position") {
            return Err(ToolError::NoPosition);
        }
        Ok(Self {
            has_password_argument: help.contains("[<PASSWORD>]"),
            has_password_option: help.contains("--password"),
        })
    }
}

#[derive(Clone, Debug)]
pub struct EthercatTool {
    program: PathBuf,
    master: u32,
    is_shielded: bool,
}

impl EthercatTool {
    /// Finds the tool: the given path, else the first on the PATH, else a default path.
    pub fn find(named: Option<&Path>, master: u32) -> Result<Self, ToolError> {
        let program = match named {
            Some(path) => path.to_owned(),
            None => {
                let path = std::env::var_os("PATH").unwrap_or_default();
                let on_path =
                    std::env::split_paths(&path).map(|directory| directory.join("ethercat"));
                let mut paths = on_path.chain(DEFAULT_PATHS.map(PathBuf::from));
                paths.find(|path| path.is_file()).ok_or(ToolError::NotFound)?
            }
        };
        Ok(Self { program, master, is_shielded: false })
    }

    /// Returns the tool in a process group of its own, so that Ctrl-C does not reach it.
    pub fn shielded(self) -> Self {
        Self { is_shielded: true, ..self }
    }

    fn run<S: AsRef<OsStr>>(
        &self,
        command: &'static str,
        arguments: impl IntoIterator<Item = S>,
    ) -> Result<String, ToolError> {
        let printed = self.run_for_bytes(command, arguments, LIMIT)?;
        Ok(String::from_utf8_lossy(&printed).into_owned())
    }

    fn run_for_bytes<S: AsRef<OsStr>>(
        &self,
        command: &'static str,
        arguments: impl IntoIterator<Item = S>,
        limit: Duration,
    ) -> Result<Vec<u8>, ToolError> {
        let mut tool = Command::new(&self.program);
        tool.arg(command).arg("--master").arg(self.master.to_string()).args(arguments);
        tool.env("LC_ALL", "C");
        if self.is_shielded {
            tool.process_group(0);
        }
        let output = program::run(&mut tool, limit).map_err(|error| match error {
            RunError::TimedOut(limit) => ToolError::TimedOut { command, limit },
            RunError::System(error) => {
                ToolError::NotStarted { program: self.program.clone(), reason: error.to_string() }
            }
        })?;
        if output.status.success() {
            return Ok(output.stdout);
        }
        let Some(status) = output.status.code() else {
            return Err(ToolError::Killed { command });
        };
        let errors = String::from_utf8_lossy(&output.stderr);
        let first = errors.lines().map(str::trim).find(|line| !line.is_empty());
        let message = first.map_or_else(|| format!("ended with status {status}"), str::to_owned);
        Err(ToolError::Failed { command, message })
    }

    pub fn slaves(&self) -> Result<Vec<SlaveEntry>, ToolError> {
        let listed = self.run("slaves", [""; 0])?;
        // With a backup device, a line marks the place of a broken ring.
        let is_slave = |line: &&str| !line.trim().is_empty() && !line.contains("LINK FAILURE");
        listed.lines().filter(is_slave).map(read_slave).collect()
    }

    /// Address of the network interface that the master uses.
    pub fn main_device(&self) -> Result<String, ToolError> {
        const COMMAND: &str = "master";
        let printed = self.run(COMMAND, [""; 0])?;
        read_main_device(&printed).ok_or_else(|| unreadable(COMMAND, &printed))
    }

    /// Vendor ID and product code of a slave, from its SII.
    pub fn identity(&self, slave: usize) -> Result<(u32, u32), ToolError> {
        const COMMAND: &str = "slaves";
        let printed = self.run(COMMAND, ["--position", &slave.to_string(), "--verbose"])?;
        let number = |name: &str| {
            let found = printed.lines().find_map(|line| line.trim().strip_prefix(name));
            read_number(COMMAND, found.ok_or_else(|| unreadable(COMMAND, &printed))?)
        };
        Ok((number("Vendor Id:")?, number("Product code:")?))
    }

    fn upload(
        &self,
        slave: usize,
        index: u16,
        subindex: u8,
        kind: &str,
    ) -> Result<String, ToolError> {
        let (index, subindex) = (format!("{index:#06x}"), subindex.to_string());
        self.upload_from(&slave.to_string(), [&index, &subindex], kind)
    }

    fn upload_from(
        &self,
        slave: &str,
        [index, subindex]: [&str; 2],
        kind: &str,
    ) -> Result<String, ToolError> {
        let arguments = ["--position", slave, "--type", kind, index, subindex];
        repeat_after(SDO_COLLISION, || self.run("upload", arguments))
    }

    /// Reads a number of the object dictionary; the tool rejects data of another length.
    pub fn upload_number(&self, slave: usize, index: u16, subindex: u8) -> Result<u32, ToolError> {
        let kind = match lookup(index, subindex).map(|(_, entry)| entry.ty) {
            Some(ObjectType::U8) => "uint8",
            Some(ObjectType::U16) => "uint16",
            _ => "uint32",
        };
        read_number("upload", &self.upload(slave, index, subindex, kind)?)
    }

    pub fn register(&self, slave: usize, address: u16) -> Result<u16, ToolError> {
        const COMMAND: &str = "reg_read";
        let (slave, address) = (slave.to_string(), format!("{address:#06x}"));
        let printed = self.run(COMMAND, ["--position", &slave, "--type", "uint16", &address])?;
        u16::try_from(read_number(COMMAND, &printed)?).map_err(|_| unreadable(COMMAND, &printed))
    }

    pub fn upload_text(&self, slave: usize, index: u16) -> Result<String, ToolError> {
        let printed = self.upload(slave, index, 0, "string")?;
        Ok(printed.trim_end_matches(['\n', '\0']).to_owned())
    }

    /// Writes the alias into the SII of a slave. The master knows it at once.
    pub fn write_alias(&self, slave: usize, alias: u16) -> Result<(), ToolError> {
        let arguments = ["--position", &slave.to_string(), &alias.to_string()];
        self.run_for_bytes("alias", arguments, LIMIT).map(drop)
    }

    /// Reads the SII up to the end of its categories.
    pub fn sii(&self, slave: usize) -> Result<Vec<u8>, ToolError> {
        self.run_for_bytes("sii_read", ["--position", &slave.to_string()], LIMIT)
    }

    /// Writes a file to a slave, with password 0. Returns when the slave has accepted or rejected
    /// the whole file.
    pub fn foe_write(&self, slave: usize, name: &str, file: &Path) -> Result<(), ToolError> {
        let known = FoeArguments::read(&self.run("foe_write", ["--help"])?)?;
        let slave = slave.to_string();
        let mut arguments = ["--position", &slave, "--output-file", name].map(OsStr::new).to_vec();
        if known.has_password_option {
            arguments.extend(["--password", "0"].map(OsStr::new));
        }
        arguments.push(file.as_os_str());
        if known.has_password_argument {
            arguments.push(OsStr::new("0"));
        }
        repeat_after(FOE_COLLISION, || {
            let written = self.run_for_bytes("foe_write", &arguments, WRITE_LIMIT);
            if written.as_ref().is_err_and(|error| error.is_collision(FOE_COLLISION)) {
                self.fetch_old_responses(&slave);
            }
            written
        })?;
        Ok(())
    }

    /// Empties the mailbox of a slave. IgH takes the oldest response for that to its request, and
    /// skips only those to uploads of other objects: the first upload succeeds when all others have
    /// been fetched, the second one skips what the attempts of the first one have left.
    fn fetch_old_responses(&self, slave: &str) {
        for object in [["0x1000", "0"], ["0x1018", "1"]] {
            // The next file reports what fails.
            let _ = self.upload_from(slave, object, "uint32");
        }
    }
}

fn repeat_after<R>(
    collision: &str,
    mut transfer: impl FnMut() -> Result<R, ToolError>,
) -> Result<R, ToolError> {
    for _ in 1..ATTEMPTS {
        match transfer() {
            Err(error) if error.is_collision(collision) => thread::sleep(COLLISION_PAUSE),
            result => return result,
        }
    }
    transfer()
}

/// Returns whether the message of the tool means that the slave does not have the object in the
/// requested form: an abort code, data of another size, or no CoE in its SII.
pub fn is_denial(message: &str) -> bool {
    let code = message.split_once("aborted with code 0x").and_then(|(_, rest)| rest.get(..8));
    let code = code.and_then(|digits| u32::from_str_radix(digits, 16).ok());
    let others =
        ["Data type mismatch", "Value too large for defined data type", "Protocol not supported"];
    code.is_some_and(|code| denies_object(AbortCode(code)))
        || others.iter().any(|text| message.contains(text))
}

/// Parses a number such as `0x0202 514`.
fn read_number(command: &'static str, printed: &str) -> Result<u32, ToolError> {
    let number = printed.split_whitespace().next().and_then(crate::value::parse_unsigned);
    let number = number.and_then(|number| u32::try_from(number).ok());
    number.ok_or_else(|| unreadable(command, printed))
}

fn unreadable(command: &'static str, printed: &str) -> ToolError {
    let text = printed.lines().next().unwrap_or_default().to_owned();
    ToolError::Unreadable { command, text }
}

/// Parses an AL state; the tool appends `+ERROR` if the error flag of the state is set.
fn al_state(text: &str) -> Option<AlState> {
    use AlState::{Boot, Init, Op, PreOp, SafeOp};
    let name = text.split('+').next().unwrap_or_default();
    [Init, PreOp, Boot, SafeOp, Op].into_iter().find(|state| state.to_string() == name)
}

/// Parses the line `Main: 00:1b:21:00:00:01 (attached)`; `None` while the master waits for the
/// interface.
fn read_main_device(printed: &str) -> Option<String> {
    let line = printed.lines().find_map(|line| line.trim().strip_prefix("Main:"))?;
    let (address, state) = line.trim().split_once(' ')?;
    state.contains("attached").then(|| address.to_owned())
}

/// Parses a line such as `1  5:0  PREOP  +  ECAN-Lite`.
fn read_slave(line: &str) -> Result<SlaveEntry, ToolError> {
    let mut cells = line.split_whitespace();
    let mut read = || {
        let position = cells.next()?.parse().ok()?;
        let (alias, offset) = cells.next()?.split_once(':')?;
        let (alias, offset): (u16, u16) = (alias.parse().ok()?, offset.parse().ok()?);
        let alias = (alias != 0 && offset == 0).then_some(alias);
        let state = cells.next()?.to_owned();
        Some(SlaveEntry { position, alias, al_state: al_state(&state), state })
    };
    read().ok_or_else(|| ToolError::Unreadable { command: "slaves", text: line.to_owned() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slave_list_is_parsed_with_aliases() {
        let read =
            |line: &str| read_slave(line).map(|slave| (slave.position, slave.alias, slave.state));
        assert_eq!(read("0     0:0  PREOP  +  ECAN-Lite"), Ok((0, None, "PREOP".to_owned())));
        assert_eq!(read("11  5:0   OP      +  a name"), Ok((11, Some(5), "OP".to_owned())));
        assert_eq!(read("12  5:1   SAFEOP  E  a name"), Ok((12, None, "SAFEOP".to_owned())));
        assert!(matches!(read("Usage: ethercat"), Err(ToolError::Unreadable { .. })));
    }

    #[test]
    fn main_device_is_read_only_if_attached() {
        let text =
            "Master0\n  Phase: Idle\n  Ethernet devices:\n    Main: 02:ec:00:00:00:01 (attached)\n";
        assert_eq!(read_main_device(text).as_deref(), Some("02:ec:00:00:00:01"));
        assert_eq!(read_main_device(&text.replace("attached", "waiting...")), None);
        assert_eq!(read_main_device("Usage: ethercat"), None);
    }

    #[test]
    fn al_state_ignores_error_suffix() {
        assert_eq!(al_state("INIT"), Some(AlState::Init));
        assert_eq!(al_state("PREOP"), Some(AlState::PreOp));
        assert_eq!(al_state("SAFEOP+ERROR"), Some(AlState::SafeOp));
        assert_eq!(al_state("???"), None);
    }

    #[test]
    fn missing_object_differs_from_no_response() {
        for said in [
            "SDO transfer aborted with code 0x06020000: This object does not exist",
            "SDO transfer aborted with code 0x06090011",
            "Data type mismatch. Expected uint16 with 2 bytes, but got 4 byte.",
            "Failed to upload SDO: Value too large for defined data type",
            "Failed to upload SDO: Protocol not supported",
        ] {
            assert!(is_denial(said), "{said}");
        }
        for said in [
            "SDO transfer aborted with code 0x08000022: cannot be transferred",
            "Failed to upload SDO: Input/output error",
            "Failed to upload SDO: Connection timed out",
        ] {
            assert!(!is_denial(said), "{said}");
        }
    }

    #[test]
    fn foe_write_without_position_option_is_rejected() {
        let of_1_6 = "foe_write [OPTIONS] <FILENAME> [<PASSWORD>]\n  --position    -p <pos>";
        let of_1_5 = "foe_write [OPTIONS] <FILENAME>\n  --position    -p <pos>";
        let read = |help| FoeArguments::read(help).map(|arguments| arguments.has_password_argument);
        assert_eq!((read(of_1_6), read(of_1_5)), (Ok(true), Ok(false)));
        assert_eq!(read("foe_write FILE\n  -p <password>"), Err(ToolError::NoPosition));
    }

    #[test]
    fn host_errors_differ_from_slave_errors() {
        let failed =
            |message: &str| ToolError::Failed { command: "slaves", message: message.to_owned() };
        let host = failed("Failed to open master device /dev/EtherCAT0: Permission denied");
        assert!(host.is_about_host());
        assert!(host.remedy().contains("sudo"));
        let module = failed("ioctl() version magic is differing: /dev/EtherCAT0: 31, tool: 33");
        assert!(module.remedy().contains("different versions"));
        let slave = failed("Failed to open '/tmp/x.bin'! Permission denied");
        assert!(!slave.is_about_host());
        assert_eq!(slave.remedy(), "");
    }
}
