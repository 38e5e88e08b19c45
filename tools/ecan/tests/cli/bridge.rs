//! Tests of `ecan bridge` with clients.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use rustix::process::Signal;

use crate::support::client::Client;
use crate::support::timed_reader::{LIMIT, TimedReader};
use crate::support::{Running, Scenario, all_fail, json_of};

/// The next message of socketcand, in words.
fn next_message(client: &mut Client) -> Vec<String> {
    client.hear_through(b">").split(' ').map(str::to_owned).collect()
}

/// The next frame of socketcand after errors of the bus: CAN ID, time and data.
fn next_frame(client: &mut Client) -> [String; 3] {
    loop {
        let words = next_message(client);
        if words[1] != "error" {
            assert_eq!(words[1], "frame", "{words:?}");
            return [&words[2], &words[3], &words[4]].map(Clone::clone);
        }
    }
}

fn expect_frame(client: &mut Client, id: &str, data: &str) {
    let [found_id, _, found_data] = next_frame(client);
    assert_eq!((found_id.as_str(), found_data.as_str()), (id, data));
}

/// Receiving socketcand client.
fn socketcand_client(address: &str, bus: &str) -> Client {
    let mut client = Client::connect(address);
    client.expect("< hi >");
    client.say(&format!("< open {bus} >"));
    client.expect("< ok >");
    client.say("< rawmode >");
    client.expect("< ok >");
    client
}

/// Address in a line such as "slcan bridge at 127.0.0.1:1234 on can1".
fn address(line: &str, protocol: &str, channel: &str) -> String {
    let words: Vec<_> = line.split(' ').collect();
    assert_eq!((words[0], words[5]), (protocol, channel), "{line}");
    assert!(words[3].starts_with("127.0.0.1:"), "{line}");
    words[3].to_owned()
}

#[test]
fn clients_of_both_protocols_share_the_channel() {
    let mut bridge =
        Running::start(&["--ecrt", "sim", "bridge", "--channel", "1", "--slcan", "--socketcand"]);
    let slcan = address(&bridge.line(), "slcan", "can1");
    let socketcand = address(&bridge.line(), "socketcand", "can1");
    let mut slcan = Client::connect(&slcan);
    slcan.say("S6\rO\r");
    slcan.expect("\r\r");
    let mut socketcand = socketcand_client(&socketcand, "can1");

    // The sender receives the echo of the node, the others also its frame.
    slcan.say("t1232AABB\r");
    slcan.expect("z\rt1232AABB\r");
    expect_frame(&mut socketcand, "123", "AABB");
    expect_frame(&mut socketcand, "123", "AABB");
    socketcand.say("< send 00000045 1 7F >");
    expect_frame(&mut socketcand, "00000045", "7F");
    slcan.expect("T0000004517F\rT0000004517F\r");

    let errors = bridge.end();
    assert!(!errors.contains('#'), "{errors}");
}

#[test]
fn all_channels_have_separate_endpoints() {
    let directory = tempfile::tempdir().unwrap();
    let link = directory.path().join("can%c").display().to_string();
    let mut bridge =
        Running::start(&["--ecrt", "sim", "bridge", "--channel", "all", "--slcan", "--pty", &link]);
    let mut clients: Vec<_> = (0..4)
        .map(|channel| {
            let name = format!("can{channel}");
            let client = Client::connect(&address(&bridge.line(), "slcan", &name));
            let path = directory.path().join(&name);
            assert_eq!(bridge.line(), format!("slcan bridge at {} on {name}", path.display()));
            let port = std::fs::File::options().read(true).write(true).open(path).unwrap();
            (client, TimedReader::new(port.try_clone().unwrap()), port)
        })
        .collect();
    for (client, terminal, port) in &mut clients {
        client.say("S6\rO\r");
        client.expect("\r\r");
        port.write_all(b"S6\rO\r").unwrap();
        assert_eq!(terminal.bytes(2), b"\r\r");
    }
    // Each frame stays on its channel, in order; the node on it echoes the frame.
    for (channel, (client, ..)) in clients.iter_mut().enumerate() {
        let frames: String =
            (0..20).map(|number| format!("t{channel}232AA{number:02X}\r")).collect();
        client.say(&frames);
    }
    for (channel, (client, terminal, _)) in clients.iter_mut().enumerate() {
        let frame = |number| format!("t{channel}232AA{number:02X}\r");
        let mut echoed = Vec::new();
        while echoed.len() < 20 {
            let text = client.hear_through(b"\r");
            echoed.extend(text.starts_with('t').then_some(text));
        }
        assert_eq!(echoed, (0..20).map(frame).collect::<Vec<_>>());
        // The other endpoint receives the sent frames and their echoes.
        let bytes = terminal.bytes(40 * frame(0).len());
        let text = String::from_utf8(bytes).unwrap();
        let received: Vec<_> = text.split_inclusive('\r').collect();
        for number in 0..20 {
            assert_eq!(
                received.iter().filter(|other| **other == frame(number)).count(),
                2,
                "{text}"
            );
        }
    }
    let errors = bridge.end();
    assert!(!errors.contains('#'), "{errors}");
}

#[test]
fn channels_of_several_gateways_are_separate() {
    let bus = crate::support::two_gateways();
    let setting = crate::support::setting(&bus);
    let mut bridge = Running::start(&["--ecrt", &setting, "bridge", "--all", "--slcan"]);
    let first = address(&bridge.line(), "slcan", "can0");
    let line = bridge.line();
    assert!(line.ends_with(" on can0 of gateway 1"), "{line}");
    assert_ne!(address(&line, "slcan", "can0"), first);
    bridge.end();
}

#[test]
fn slcan_passes_can_fd_at_channel_bit_rates() {
    let mut bridge =
        Running::start(&["--ecrt", "sim", "bridge", "--data-bitrate", "2000000", "--json"]);
    let mut text = String::new();
    while !text.ends_with(']') {
        let line = bridge.line();
        assert_ne!(line, "", "{text}");
        text.push_str(&line);
    }
    let places = json_of(&text);
    assert_eq!((&places[0]["protocol"], &places[0]["channel"]), (&"slcan".into(), &0.into()));
    let address = places[0]["address"].as_str().unwrap();
    let mut client = Client::connect(address);
    client.say("S6\rY2\rO\r");
    client.expect("\r\r\r");
    client.say("b1239112233445566778899AABBCC\r");
    client.expect("z\rb1239112233445566778899AABBCC\r");
    // A client with another bit rate is rejected, at once and in the total at the end.
    let mut other = Client::connect(address);
    other.say("S8\rO\rt1230\r");
    other.expect("\x07\x07\x07");
    let text = "commands or frames rejected: another bit rate than that of the bus";
    bridge.wait_for_error(text);
    let errors = bridge.end();
    let total = format!("# slcan bridge at {address}: 2 {text}");
    assert!(errors.contains(&total), "{errors}");
}

#[test]
fn pseudo_terminal_acts_as_serial_adapter() {
    let directory = tempfile::tempdir().unwrap();
    let link = directory.path().join("can0");
    let path = link.display().to_string();
    let mut bridge = Running::start(&["--ecrt", "sim", "bridge", "--pty", &path]);
    assert_eq!(bridge.line(), format!("slcan bridge at {path} on can0"));
    // Two programs in turn use the terminal as a serial port.
    for id in ["123", "124"] {
        let mut port = std::fs::File::options().read(true).write(true).open(&link).unwrap();
        port.write_all(format!("C\rS6\rO\rt{id}2AABB\r").as_bytes()).unwrap();
        let expected = format!("\r\r\rz\rt{id}2AABB\r");
        let answer = TimedReader::new(port.try_clone().unwrap()).bytes(expected.len());
        assert_eq!(String::from_utf8_lossy(&answer), expected);
    }
    bridge.end();
    assert!(std::fs::symlink_metadata(&link).is_err(), "the link goes with the bridge");
}

/// A motor must not execute outdated commands.
#[test]
fn frames_during_outage_are_rejected_and_never_sent() {
    let fault = |length| format!("kind = \"power_cycle\"\ngateway = 0\noff_ms = {}", 500 * length);
    let late = rejects_during("kind = \"silent\"", fault, "gateway: ready");
    assert_eq!(late, [0; 0]);
}

#[test]
fn frames_during_bus_off_are_rejected() {
    let fault = |_| "kind = \"bus_off\"\ngateway = 0\nchannel = 0".to_owned();
    let late = rejects_during("kind = \"silent\"", fault, "can0: run");
    assert_eq!(late, [0; 0]);
}

/// Clients receive states of the bus in the form of their protocol.
#[test]
fn bus_off_and_recovery_reach_clients() {
    let bus = Scenario::new(
        "[[node]]\nkind = \"silent\"\nbus = \"0.0\"\n\
         [[fault]]\nat_ms = 3000\nkind = \"bus_off\"\ngateway = 0\nchannel = 0\n",
    );
    let mut bridge = bus.start(&["bridge", "--slcan", "--socketcand"]);
    let mut slcan = Client::connect(&address(&bridge.line(), "slcan", "can0"));
    slcan.say("O\rF\r");
    slcan.expect("\rF00\r");
    let mut socketcand = socketcand_client(&address(&bridge.line(), "socketcand", "can0"), "can0");
    // Off the bus, and restarted (`linux/can/error.h`).
    for class in ["040", "100"] {
        while next_message(&mut socketcand)[1..3] != ["error", class] {}
    }
    slcan.say("F\rF\r");
    let flags = slcan.hear_through(b"\r");
    assert_eq!(u8::from_str_radix(flags[1..].trim_end(), 16).unwrap() & 0x80, 0x80, "{flags}");
    slcan.expect("F00\r");
    bridge.end();
}

/// Only the frames in the gateway are sent when a node acknowledges again.
#[test]
fn frames_without_acknowledgement_are_rejected() {
    let node = "kind = \"drive\"\nname = \"partner\"\nnode_id = 1";
    let fault = |length| {
        format!("kind = \"drive_power_cycle\"\nnode = \"partner\"\noff_ms = {}", 3000 * length)
    };
    let late = rejects_during(node, fault, "can0: run");
    let queue_and_controller = 64 + 32;
    assert!(late.len() <= queue_and_controller, "{} frames came late", late.len());
}

/// A client sends during a fault, whose end is reported in a line that ends with `end`. Returns the
/// outdated frames received afterwards.
///
/// A client with little processor time sends too few frames for a rejection: then a fault of twice the length
/// follows.
fn rejects_during(node: &str, fault: impl Fn(u32) -> String, end: &str) -> Vec<usize> {
    let faults = [(9, 1), (29, 2), (59, 4), (99, 8), (149, 16)]
        .map(|(second, length)| format!("[[fault]]\nat_ms = {second}000\n{}\n", fault(length)));
    let bus = Scenario::new(&format!("[[node]]\nbus = \"0.0\"\n{node}\n{}", faults.concat()));
    let mut bridge = bus.start(&["bridge", "--slcan", "--socketcand"]);
    let mut sender = Client::connect(&address(&bridge.line(), "slcan", "can0"));
    let mut listener = socketcand_client(&address(&bridge.line(), "socketcand", "can0"), "can0");
    sender.say("O\r");
    sender.expect("\r");
    // Each frame waits for the response to the previous one, so that the queue never fills.
    let mut answers = Vec::new();
    let (mut is_back, mut late_bells) = (false, 0);
    let begun = std::time::Instant::now();
    while !is_back {
        assert!(begun.elapsed() < LIMIT, "the gateway does not come back");
        // The version ends the answer: a BELL may also report the loss of an earlier frame.
        sender.say(&format!("t1232{:04X}\rV\r", answers.len()));
        let (mut is_taken, mut bells) = (false, 0);
        loop {
            match sender.hear_through(b"\r\x07").as_str() {
                "z\r" => is_taken = true,
                "\x07" => bells += 1,
                "V1010\r" => break,
                // Frame of the node.
                frame => assert!(frame.starts_with('t'), "{frame}"),
            }
        }
        assert!(is_taken || bells > 0);
        late_bells += bells - usize::from(!is_taken);
        is_back = is_taken && answers.last() == Some(&false);
        answers.push(is_taken);
        // Slower than one frame per cycle.
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    let first_after = answers.len() - 1;
    let mut heard = Vec::new();
    while heard.last().is_none_or(|(_, number)| *number != first_after) {
        let [id, time, data] = next_frame(&mut listener);
        if id == "123" {
            heard.push((time.parse::<f64>().unwrap(), usize::from_str_radix(&data, 16).unwrap()));
        }
    }
    let errors = bridge.end();
    let rejected = answers.iter().filter(|is_taken| !**is_taken).count();
    // The total at the end; frames that waited are lost, too.
    let of_bridge =
        |line: &&str| line.contains("frames to the bus rejected: channel not available");
    let total = errors.lines().rfind(of_bridge).unwrap();
    let total = total.rsplit(": ").nth(1).and_then(|text| text.split(' ').next()).unwrap();
    assert!(total.parse::<usize>().unwrap() >= rejected, "{errors}");
    let back = errors.lines().rfind(|line| line.contains(end)).unwrap();
    let back: f64 = back["# (".len()..].split(')').next().unwrap().parse().unwrap();
    assert!(heard.iter().all(|(_, number)| answers[*number]), "a rejected frame was sent");
    // Each accepted frame was sent, or its loss was reported to its client.
    let accepted = answers.iter().filter(|is_taken| **is_taken).count();
    assert_eq!(accepted - heard.len(), late_bells, "{errors}");
    let is_late = |(time, number): &(f64, usize)| *time >= back && *number < first_after;
    heard.into_iter().filter(is_late).map(|(_, number)| number).collect()
}

#[test]
fn listen_only_bridge_rejects_frames() {
    let bus = Scenario::new(
        "[[node]]\nkind = \"faulty\"\nbus = \"0.0\"\nbabble_us = 50000\n\
         [[node]]\nkind = \"silent\"\nbus = \"0.0\"\n",
    );
    let mut bridge = bus.start(&["bridge", "--listen-only", "--slcan", "--socketcand"]);
    let mut slcan = Client::connect(&address(&bridge.line(), "slcan", "can0"));
    let mut socketcand = socketcand_client(&address(&bridge.line(), "socketcand", "can0"), "can0");
    slcan.say("O\rt7FF0\r");
    slcan.expect("\r");
    // Frames from the bus may precede the response.
    while slcan.hear_through(b"\r\x07") != "\x07" {}
    socketcand.say("< send 7FE 0 >");
    while next_message(&mut socketcand)[1..3] != ["error", "001"] {}
    bridge.wait_for_error("frames to the bus rejected: channel not available or listen-only");
    for _ in 0..10 {
        let [id, ..] = next_frame(&mut socketcand);
        assert!(id != "7FF" && id != "7FE", "{id} was sent");
    }
    bridge.end();
}

/// Counts two texts in what a raw connection receives until its end.
fn count_on(stream: &TcpStream, texts: [&'static [u8]; 2]) -> Arc<[AtomicUsize; 2]> {
    let (mut stream, counts) = (stream.try_clone().unwrap(), Arc::<[AtomicUsize; 2]>::default());
    let counted = counts.clone();
    std::thread::spawn(move || {
        let (mut received, mut bytes) = (Vec::new(), [0; 4096]);
        let mut next = [0; 2];
        while let Ok(length @ 1..) = stream.read(&mut bytes) {
            received.extend_from_slice(&bytes[..length]);
            for ((text, next), count) in texts.iter().zip(&mut next).zip(&*counted) {
                while let Some(at) =
                    received[*next..].windows(text.len()).position(|bytes| bytes == *text)
                {
                    *next += at + text.len();
                    count.fetch_add(1, Ordering::Relaxed);
                }
                // The end may be the first half of a text.
                *next = (*next).max((received.len() + 1).saturating_sub(text.len()));
            }
        }
    });
    counts
}

/// The bridge is stopped for longer than its time limits and the watchdog of the gateway. Each frame
/// is on the bus, or its client receives BELL for it, also if it was confirmed.
#[test]
fn paused_bridge_reports_every_lost_frame() {
    const FRAMES: usize = 3000;
    let bus = Scenario::new("[[node]]\nkind = \"silent\"\nbus = \"0.0\"\n");
    let mut bridge = bus.start(&["bridge", "--bitrate", "125000", "--slcan", "--socketcand"]);
    let mut sender = TcpStream::connect(address(&bridge.line(), "slcan", "can0")).unwrap();
    let mut listener = TcpStream::connect(address(&bridge.line(), "socketcand", "can0")).unwrap();
    let heard = count_on(&listener, [b"< frame 123 ", b"< ok >"]);
    let answered = count_on(&sender, [b"\x07", b"z"]);
    listener.write_all(b"< open can0 >< rawmode >").unwrap();
    let read = |count: &AtomicUsize| count.load(Ordering::Relaxed);
    let begun = Instant::now();
    let wait_until = |is_reached: &dyn Fn() -> bool| {
        while !is_reached() {
            assert!(begun.elapsed() < LIMIT, "on the bus: {heard:?}, BELL: {answered:?}");
            std::thread::yield_now();
        }
    };
    wait_until(&|| read(&heard[1]) == 2);
    sender.write_all(b"O\r").unwrap();
    for number in 0..FRAMES {
        sender.write_all(format!("t1234{number:08X}\r").as_bytes()).unwrap();
        if number == FRAMES / 2 {
            bridge.signal(Signal::STOP);
            // The pause is what is tested; nothing is waited for.
            std::thread::sleep(Duration::from_millis(1500));
            bridge.signal(Signal::CONT);
        }
    }
    let accounted = || read(&heard[0]) + read(&answered[0]);
    wait_until(&|| accounted() >= FRAMES);
    bridge.end();
    // The results of the frames in the gateway may be unknown.
    assert!(accounted() - FRAMES <= 96, "on the bus: {heard:?}, BELL: {answered:?}");
}

#[test]
fn silent_connections_lose_their_places_with_a_note() {
    let mut bridge = Running::start(&["--ecrt", "sim", "bridge", "--slcan", "--max-clients", "4"]);
    let address = address(&bridge.line(), "slcan", "can0");
    let _silent: Vec<_> = (0..4).map(|_| TcpStream::connect(&address).unwrap()).collect();
    let mut clients: Vec<_> = (0..4)
        .map(|_| {
            let mut client = Client::connect(&address);
            client.say("O\r");
            client.expect("\r");
            client
        })
        .collect();
    bridge.wait_for_error("connections closed: their clients did not open the bus");
    let mut fifth = Client::connect(&address);
    assert_eq!(fifth.hear_through(b"\r"), "");
    bridge.wait_for_error("connections rejected: too many clients; set --max-clients");
    for client in &mut clients {
        client.say("V\r");
        client.expect("V1010\r");
    }
    let errors = bridge.end();
    assert!(errors.contains(": 4 connections closed: their clients"), "{errors}");
    assert!(errors.contains(": 1 connections rejected: too many clients"), "{errors}");
}

/// One client sends more than the bus carries; each frame of the other one is sent.
#[test]
fn flooding_client_starves_no_other() {
    let bus = Scenario::new("[[node]]\nkind = \"silent\"\nbus = \"0.0\"\n");
    let mut bridge = bus.start(&["bridge", "--bitrate", "125000", "--slcan"]);
    let address = address(&bridge.line(), "slcan", "can0");
    let flooder = TcpStream::connect(&address).unwrap();
    let answered = count_on(&flooder, [b"\x07", b"z"]);
    let mut output = flooder.try_clone().unwrap();
    let flood = std::thread::spawn(move || {
        let _ = output.write_all(b"O\r");
        let frames = b"t1118AABBCCDDEEFF0011\r".repeat(100);
        while output.write_all(&frames).is_ok() {}
    });
    let begun = Instant::now();
    // As many as its queue holds.
    while answered[1].load(Ordering::Relaxed) < 4096 {
        assert!(begun.elapsed() < LIMIT, "the queue of the flooder is not full");
        std::thread::yield_now();
    }
    let mut other = Client::connect(&address);
    other.say("O\r");
    other.expect("\r");
    for _ in 0..9 {
        other.say("t2220\r");
        // Frames of the flooder precede the answer.
        let mut answer = other.hear_through(b"\r\x07");
        while answer.starts_with("t111") {
            answer = other.hear_through(b"\r\x07");
        }
        assert_eq!(answer, "z\r");
    }
    // The last one waits for some frames of the flooder only, not for its 4096.
    let mut observer = Client::connect(&address);
    observer.say("O\rt3330\r");
    let mut before = 0;
    while other.hear_through(b"\r") != "t3330\r" {
        before += 1;
    }
    assert!(before < 4096, "{before} frames before it");
    assert_eq!(answered[0].load(Ordering::Relaxed), 0, "the flooder waits and loses nothing");
    flooder.shutdown(std::net::Shutdown::Both).unwrap();
    flood.join().unwrap();
    bridge.end();
}

/// The port is global: use a separate address, so that tests do not interfere.
#[test]
fn beacon_announces_socketcand() {
    let listener = match std::net::UdpSocket::bind("127.42.0.1:42000") {
        Ok(listener) => listener,
        Err(error) => {
            println!("skipped: UDP port 42000: {error}");
            return;
        }
    };
    listener.set_read_timeout(Some(LIMIT)).unwrap();
    let options = ["--ecrt", "sim", "bridge", "--channel", "2", "--socketcand", "--beacon"];
    let mut bridge = Running::start(&[&options[..], &["127.42.0.1"]].concat());
    let address = address(&bridge.line(), "socketcand", "can2");
    let expected = format!(
        "<CANBeacon name=\"ecan\" type=\"adapter\" description=\"ECAN-Lite\">\n\
         <URL>can://{address}</URL><Bus name=\"can2\"/></CANBeacon>"
    );
    for _ in 0..2 {
        let mut bytes = [0; 1024];
        let length = listener.recv(&mut bytes).unwrap();
        assert_eq!(String::from_utf8_lossy(&bytes[..length]), expected);
    }
    bridge.end();
}

#[test]
fn invalid_use_has_message_and_status() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    all_fail(&[
        (2, &["bridge", "--beacon"], "--socketcand"),
        (2, &["bridge", "--slcan", "localhost"], "expected a port, an IP address"),
        (2, &["bridge", "--channel", "4"], "expected channels 0 to 3"),
        (2, &["bridge", "--channel", "0,1", "--socketcan", "can%d"], "expected only %g"),
        (
            2,
            &["--ecrt", "sim", "bridge", "--channel", "0,1", "--pty", "/tmp/can"],
            "--pty: several channels need several names; use %c",
        ),
        (
            2,
            &["--ecrt", "sim", "bridge", "--channel", "all", "--slcan", "65534"],
            "no ports after 127.0.0.1:65534",
        ),
        (2, &["bridge", "--max-clients", "0"], "0 is not in 1..=1000"),
        (6, &["--ecrt", "sim", "bridge", "--pty", "/dev/null"], "cannot create the link /dev/null"),
        (7, &["--ecrt", "sim", "bridge", "--slcan", &port], "cannot listen on 127.0.0.1:"),
    ]);
}
