//! Fake `ethercat` tool in front of simulated gateways on a wire.
//!
//! The tested program runs a script that passes its arguments to this test. The test holds the
//! gateways and does on the wire what the master does: scan, mailboxes, PREOP, SDO uploads, FoE.
//! The gateways live on between the calls, and the test can inspect them.

use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::Command;
use std::sync::{Arc, Mutex, MutexGuard};

use ecan_sim::Fault;

#[path = "../../../../../ecan-sim/tests/wire_support/mod.rs"]
pub mod wire_support;
use wire_support::command::*;
use wire_support::{Datagram, Line, MS};

/// Simulated time per call.
const CALL_NS: u64 = 300 * MS;
/// Data bytes of a full FoE packet, without the mailbox and FoE headers.
const PACKET: usize = 128 - 6 - 6;

/// Product code of the gateways.
pub const PRODUCT_CODE: u32 = 0x4C49_5445;

const HELP: &str = "\
ethercat foe_write [OPTIONS] <FILENAME> [<PASSWORD>]
  --output-file -o <file>   name on the slave
  --position    -p <pos>    slave";
/// Also of 1.6.2.
const HELP_OF_1_5: &str = "\
ethercat foe_write [OPTIONS] <FILENAME>
  --output-file -o <file>   name on the slave
  --position    -p <pos>    slave";
const HELP_WITH_PASSWORD: &str = "\
ethercat foe_write [OPTIONS] <FILENAME>
  -o <file>      name on the slave
  -p <password>  password";

/// Deviation from a correct tool.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Behaviour {
    Good,
    /// `foe_write` has no password, and the master does not report FoE errors.
    Of15,
    /// `-p` is the password.
    TakesPositionForPassword,
    /// Every command fails with this message.
    Fails(&'static str),
    /// `foe_write` fails with this message and writes nothing.
    WriteFails(&'static str),
    /// `foe_write` succeeds but writes nothing.
    Lies,
    /// The gateway loses power after this number of packets.
    SupplyFails {
        packets: usize,
        off_ms: u32,
    },
    /// `foe_write` fails after the last packet, because the gateway restarts before its answer is
    /// fetched.
    AnswerLost,
    /// As `SupplyFails`, after the last packet and permanently.
    NeverBack,
    /// The mailbox of the slave at this position does not respond; its SII has this product code.
    Silent {
        position: u16,
        product_code: u32,
    },
    /// The slaves have another object 0xF000.
    Foreign,
    /// Prints an unexpected text.
    Babbles,
}

/// A response in the mailbox of a slave that the master has not fetched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Unfetched {
    Dictionary,
    Upload(u16, u8),
    File,
}

/// Gateways and the tool.
pub struct Master {
    pub line: Line,
    pub behaviour: Behaviour,
    gateways: u16,
    /// Process group that gets SIGINT during the next file.
    pub interrupts: Option<u32>,
    /// Responses about the dictionary that are in the mailbox when the next file begins.
    pub dictionary_responses: usize,
    unfetched: VecDeque<Unfetched>,
    /// Recorded calls.
    pub calls: Vec<Vec<String>>,
}

/// Script of the tool; removed when dropped.
pub struct FakeEthercat {
    pub program: PathBuf,
    master: Arc<Mutex<Master>>,
    _directory: tempfile::TempDir,
}

impl FakeEthercat {
    pub fn new(gateways: u16, behaviour: Behaviour) -> Self {
        let line = Line::preop(gateways.into());
        let master = Master {
            line,
            behaviour,
            gateways,
            interrupts: None,
            dictionary_responses: 0,
            unfetched: VecDeque::new(),
            calls: Vec::new(),
        };
        let master = Arc::new(Mutex::new(master));
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let served = master.clone();
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                serve(stream.unwrap(), &mut served.lock().unwrap());
            }
        });
        let directory = tempfile::tempdir().unwrap();
        let program = directory.path().join("ethercat");
        let script = format!(
            "#!/usr/bin/env bash\n\
             exec 3<>/dev/tcp/127.0.0.1/{port} || exit 99\n\
             printf '%s\\n' \"$@\" '' >&3\n\
             while IFS= read -r line <&3; do\n\
             case $line in\n\
             o*) printf '%s\\n' \"${{line:1}}\" ;;\n\
             e*) printf '%s\\n' \"${{line:1}}\" >&2 ;;\n\
             x*) exit \"${{line:1}}\" ;;\n\
             esac\n\
             done\n\
             exit 98\n"
        );
        crate::support::write_program(&program, &script);
        Self { program, master, _directory: directory }
    }

    pub fn master(&self) -> MutexGuard<'_, Master> {
        self.master.lock().unwrap()
    }

    /// Number of `foe_write` calls with a file.
    pub fn writes(&self) -> Vec<Vec<String>> {
        let is_write = |call: &&Vec<String>| {
            call.iter().any(|word| word == "foe_write") && !call.iter().any(|word| word == "--help")
        };
        self.master().calls.iter().filter(is_write).cloned().collect()
    }
}

fn serve(stream: TcpStream, master: &mut Master) {
    let mut arguments = Vec::new();
    for line in BufReader::new(&stream).lines() {
        match line.unwrap() {
            empty if empty.is_empty() => break,
            argument => arguments.push(argument),
        }
    }
    let (mark, text, status) = match master.call(&arguments) {
        Ok(printed) => ('o', printed, 0),
        Err(message) => ('e', message, 1),
    };
    master.calls.push(arguments);
    let mut answer: String = text.lines().map(|line| format!("{mark}{line}\n")).collect();
    answer.push_str(&format!("x{status}\n"));
    (&stream).write_all(answer.as_bytes()).unwrap();
}

/// Value of an option.
fn option<'a>(arguments: &'a [String], name: &str) -> Option<&'a str> {
    let at = arguments.iter().position(|argument| argument == name)?;
    arguments.get(at + 1).map(String::as_str)
}

impl Master {
    fn call(&mut self, arguments: &[String]) -> Result<String, String> {
        self.line.pass(CALL_NS);
        match self.behaviour {
            Behaviour::Fails(message) => return Err(message.to_owned()),
            Behaviour::Babbles => return Ok("Good morning!".to_owned()),
            _ => {}
        }
        self.scan();
        match arguments.first().map(String::as_str) {
            Some("slaves") if option(arguments, "--position").is_some() => {
                self.station(arguments).map(|station| self.identity(station - 0x1001))
            }
            Some("slaves") => Ok(self.slaves()),
            Some("upload") => self.upload(arguments),
            Some("foe_write") if arguments.iter().any(|argument| argument == "--help") => {
                Ok(match self.behaviour {
                    Behaviour::TakesPositionForPassword => HELP_WITH_PASSWORD,
                    Behaviour::Of15 => HELP_OF_1_5,
                    _ => HELP,
                }
                .to_owned())
            }
            Some("foe_write") => self.foe_write(arguments).map(|()| String::new()),
            other => Err(format!("Unknown command {other:?}!")),
        }
    }

    /// Configures addresses, mailboxes and PREOP of restarted gateways.
    fn scan(&mut self) {
        for position in 0..self.gateways {
            let station = 0x1001 + position;
            if self.is_there(position) {
                continue;
            }
            let address = station.to_le_bytes();
            let by_position = 0u16.wrapping_sub(position);
            let setting = Datagram::new(APWR, by_position, 0x0010, &address);
            if self.ask(setting).is_some() {
                self.line.set_up_mailboxes(station);
                self.line.request(station, 2);
            }
        }
    }

    /// Response, if any.
    fn ask(&mut self, datagram: Datagram) -> Option<Datagram> {
        self.line.exchange(&[datagram])?.pop().filter(|back| back.counter == 1)
    }

    /// Returns whether the slave responds, above INIT.
    fn is_there(&mut self, position: u16) -> bool {
        let asked = Datagram::new(FPRD, 0x1001 + position, 0x0130, &[0; 2]);
        self.ask(asked).is_some_and(|back| back.data[0] & 0x0F != 1)
    }

    fn slaves(&mut self) -> String {
        let there: Vec<_> = (0..self.gateways).filter(|slave| self.is_there(*slave)).collect();
        there.iter().map(|slave| format!("{slave}  0:{slave}  PREOP  +  ECAN-Lite\n")).collect()
    }

    /// Output of --verbose.
    fn identity(&self, position: u16) -> String {
        let product = match self.behaviour {
            Behaviour::Silent { position: silent, product_code } if silent == position => {
                product_code
            }
            _ => PRODUCT_CODE,
        };
        format!(
            "=== Master 0, Slave {position} ===\nState: PREOP\nFlag: +\nIdentity:\n  \
             Vendor Id:       0x00004543\n  Product code:    0x{product:08x}\n  \
             Revision number: 0x00020002\n"
        )
    }

    fn station(&mut self, arguments: &[String]) -> Result<u16, String> {
        let position: u16 = option(arguments, "--position").unwrap().parse().unwrap();
        if position >= self.gateways || !self.is_there(position) {
            return Err(format!("Failed to get slave: Slave {position} does not exist!"));
        }
        Ok(0x1001 + position)
    }

    fn upload(&mut self, arguments: &[String]) -> Result<String, String> {
        let station = self.station(arguments)?;
        let [.., index, subindex] = arguments else { panic!("{arguments:?}") };
        let index = u16::from_str_radix(index.strip_prefix("0x").unwrap(), 16).unwrap();
        let subindex: u8 = subindex.parse().unwrap();
        let is_silent = matches!(self.behaviour, Behaviour::Silent { position, .. } if position == station - 0x1001);
        if is_silent || !self.finds_response(Unfetched::Upload(index, subindex)) {
            return Err("Failed to upload SDO: Input/output error".to_owned());
        }
        if self.behaviour == Behaviour::Foreign && (index, subindex) == (0xF000, 17) {
            return Ok(number(8, 4));
        }
        let [low, high] = index.to_le_bytes();
        let request = [0x00, 0x20, 0x40, low, high, subindex, 0, 0, 0, 0];
        let answer = self.line.mailbox(station, 3, 0, &request);
        let data = match answer[2] {
            0x80 => return Err("SDO transfer aborted with code 0x06020000".to_owned()),
            expedited if expedited & 2 != 0 => &answer[6..10 - usize::from(expedited >> 2 & 3)],
            _ => &answer[10..],
        };
        match (option(arguments, "--type").unwrap(), data) {
            ("string", text) => Ok(String::from_utf8_lossy(text).into_owned()),
            ("uint16", &[a, b]) => Ok(number(u16::from_le_bytes([a, b]).into(), 4)),
            ("uint32", &[a, b, c, d]) => Ok(number(u32::from_le_bytes([a, b, c, d]), 8)),
            (kind, data) => Err(format!("Data type mismatch: {kind}, {} bytes", data.len())),
        }
    }

    /// Returns whether a transfer fetches a response to such a request, as IgH does: it skips those to
    /// uploads of other objects, and ends at any other response.
    fn finds_response(&mut self, own: Unfetched) -> bool {
        if self.unfetched.is_empty() {
            return true;
        }
        self.unfetched.push_back(own);
        let mut first = || self.unfetched.pop_front().unwrap();
        loop {
            match (first(), own) {
                (first, own) if first == own => return true,
                (Unfetched::Upload(..), Unfetched::Upload(..)) => {}
                _ => return false,
            }
        }
    }

    fn foe(&mut self, station: u16, opcode: u8, number: u32, data: &[u8]) -> Vec<u8> {
        let mut message = vec![opcode, 0];
        message.extend(number.to_le_bytes());
        message.extend(data);
        self.line.mailbox(station, 4, 0, &message)
    }

    fn foe_write(&mut self, arguments: &[String]) -> Result<(), String> {
        match self.behaviour {
            Behaviour::WriteFails(message) => return Err(message.to_owned()),
            Behaviour::Lies => return Ok(()),
            _ => {}
        }
        let station = self.station(arguments)?;
        let dictionary = std::mem::take(&mut self.dictionary_responses);
        self.unfetched.extend(vec![Unfetched::Dictionary; dictionary]);
        let is_behind = !self.unfetched.is_empty();
        if !self.finds_response(Unfetched::File) {
            return Err("Failed to write via FoE: FOE_MBOX_PROT_ERROR".to_owned());
        }
        assert!(!is_behind, "a response to an earlier file is taken for one to this");
        if let Some(group) = self.interrupts.take() {
            let group = format!("-{group}");
            let sent = Command::new("kill").args(["-INT", "--", &group]).status().unwrap();
            assert!(sent.success());
        }
        let gateway = usize::from(station - 0x1001);
        let name = option(arguments, "--output-file").unwrap();
        // "foe_write --master M --position P --output-file NAME FILE [PASSWORD]"
        let [path, password @ ..] = &arguments[7..] else { panic!("{arguments:?}") };
        let password = password.first().map_or(0, |text| text.parse().unwrap());
        let file = std::fs::read(path).unwrap();
        let is_of_1_5 = self.behaviour == Behaviour::Of15;
        let fault = |answer: &[u8]| {
            if is_of_1_5 {
                return Err("Failed to write via FoE: FOE_ACK_ERROR".to_owned());
            }
            let code = u32::from_le_bytes(answer[2..6].try_into().unwrap());
            Err(format!("FoE write aborted with error code {code:#010x}: {}", words(code)))
        };
        let answer = self.foe(station, 2, password, name.as_bytes());
        if answer[0] == 5 {
            return fault(&answer);
        }
        let mut packets: Vec<_> = file.chunks(PACKET).collect();
        if file.len().is_multiple_of(PACKET) {
            packets.push(&[]);
        }
        for (nth, packet) in packets.into_iter().enumerate() {
            if let Behaviour::SupplyFails { packets, off_ms } = self.behaviour
                && nth == packets
            {
                self.line.wire.world_mut().inject(Fault::PowerCycle { gateway, off_ms });
                self.line.pass(MS);
                return Err("Failed to write via FoE: FOE_WC_ERROR".to_owned());
            }
            loop {
                let answer = self.foe(station, 3, nth as u32 + 1, packet);
                match answer[0] {
                    4 => break,
                    6 => self.line.pass(10 * MS),
                    _ => return fault(&answer),
                }
            }
        }
        if self.behaviour == Behaviour::AnswerLost {
            return Err("Failed to write via FoE: FOE_TIMEOUT_ERROR".to_owned());
        }
        if self.behaviour == Behaviour::NeverBack {
            self.line.wire.world_mut().inject(Fault::PowerOff { gateway });
        }
        Ok(())
    }
}

fn number(value: u32, digits: usize) -> String {
    format!("0x{value:0digits$x} {value}")
}

/// IgH's tool knows the error numbers of the first standard and does not print the text of the
/// device.
fn words(code: u32) -> &'static str {
    match code {
        0x8001 => "Not found.",
        0x8002 => "Access denied.",
        0x8003 => "Disk full.",
        0x8004 => "Illegal.",
        0x800A => "No rights.",
        _ => "Unknown error code",
    }
}
