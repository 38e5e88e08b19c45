//! Every register access in the trace of a real master is answered in its AL state.

use std::path::Path;

use crate::wire_support::{Datagram, Line, command::*};

/// A line such as `4 AL1 FPRD 0x0130 len    2 x90`.
struct Access {
    state: u8,
    command: u8,
    offset: u16,
    length: usize,
    may_be_rejected: bool,
}

fn parse(line: &str) -> Option<Access> {
    let mut fields = line.split_whitespace().skip(1);
    let state = fields.next()?.strip_prefix("AL")?.parse().ok()?;
    let command = match fields.next()? {
        "APWR" => APWR,
        "FPRD" => FPRD,
        "FPWR" => FPWR,
        "BRD" => BRD,
        "BWR" => BWR,
        "LRW" => LRW,
        "FRMW" => FRMW,
        other => panic!("{other}"),
    };
    let offset = u16::from_str_radix(fields.next()?.strip_prefix("0x")?, 16).ok()?;
    assert_eq!(fields.next(), Some("len"));
    let length = fields.next()?.parse().ok()?;
    Some(Access { state, command, offset, length, may_be_rejected: line.contains("wkc0") })
}

/// A gateway in an AL state, mapped for N = 3 if possible.
fn in_state(state: u8) -> Line {
    match state {
        1 | 3 => {
            let mut line = Line::addressed(1);
            if state == 3 {
                line.set_up_mailboxes(0x1001);
                line.request(0x1001, 3);
            }
            line
        }
        2 => Line::preop(1),
        4 => {
            let mut line = Line::op();
            line.request(0x1001, 4);
            line
        }
        _ => Line::op(),
    }
}

/// The mailboxes of the slave in the trace differ in length and address from the gateway's.
fn mailbox_access(line: &mut Line, access: &Access) -> bool {
    match (access.offset, access.length) {
        (0x1000, 512) => {
            let counter = line.write(FPWR, 0x1001, 0x1000, &[0; 128]);
            assert_eq!(counter, 1, "the write mailbox");
            true
        }
        (0x1200, 512) => {
            line.read(FPRD, 0x1001, 0x1080, 128);
            true
        }
        _ => false,
    }
}

#[test]
fn recorded_master_accesses_are_answered() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/igh");
    let Ok(trace) = std::fs::read_to_string(path.join("register-trace-1.6.2.txt")) else {
        println!("skipped: the trace is not there");
        return;
    };
    let accesses: Vec<_> = trace.lines().filter(|line| !line.trim().is_empty()).collect();
    assert!(accesses.len() > 50, "{}", accesses.len());
    for text in accesses {
        let access = parse(text).unwrap_or_else(|| panic!("{text}"));
        let mut line = in_state(access.state);
        let state = line.state(0x1001).0;
        assert_eq!(state, access.state, "{text}");
        if mailbox_access(&mut line, &access) {
            continue;
        }
        let slave = match access.command {
            APWR | BRD | BWR => 0,
            _ => 0x1001,
        };
        // a write puts back the present value
        let mut data = line.read(FPRD, 0x1001, access.offset, access.length).0;
        if access.offset == 0x0120 {
            data = vec![state, 0];
        }
        let datagram = match access.command {
            LRW => Datagram::logical(LRW, 0, &vec![0; access.length]),
            BRD | FPRD => Datagram::new(access.command, slave, access.offset, &vec![0; data.len()]),
            _ => Datagram::new(access.command, slave, access.offset, &data),
        };
        let counter = line.one(datagram).counter;
        assert!(counter >= 1 || access.may_be_rejected, "{text}");
        assert_eq!(line.state(0x1001), (state, 0), "{text}");
    }
}
