//! Queues of client frames to the bus.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use ecan_can_io::bridge::{BridgeConfig, BridgeProtocol, BridgeServer};

const TIMEOUT: Duration = Duration::from_secs(60);

fn server(protocol: BridgeProtocol) -> BridgeServer {
    server_with(protocol, 2)
}

fn server_with(protocol: BridgeProtocol, queue: usize) -> BridgeServer {
    let settings = BridgeConfig { queue, ..BridgeConfig::with_protocol(protocol) };
    BridgeServer::listen(&settings).unwrap()
}

fn connect(server: &BridgeServer) -> TcpStream {
    let stream = TcpStream::connect(server.info().address()).unwrap();
    stream.set_read_timeout(Some(TIMEOUT)).unwrap();
    stream
}

fn exchange(stream: &mut TcpStream, text: &str, answer: &str) {
    stream.write_all(text.as_bytes()).unwrap();
    let mut bytes = vec![0; answer.len()];
    stream.read_exact(&mut bytes).unwrap();
    assert_eq!(String::from_utf8_lossy(&bytes), answer);
}

fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let begun = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(begun.elapsed() < TIMEOUT, "{what}");
        std::thread::yield_now();
    }
}

/// Frames of a socketcand client are independent of the speed of the bus.
#[test]
fn full_queue_blocks_socketcand_client() {
    let server = server(BridgeProtocol::Socketcand);
    let mut client = connect(&server);
    exchange(&mut client, "", "< hi >");
    exchange(&mut client, "< open can0 >", "< ok >");
    let text: String = (0..100).map(|number| format!("< send 123 1 {number:x} >")).collect();
    client.write_all(text.as_bytes()).unwrap();
    for number in 0..100 {
        let next = || server.clients().next_for_bus();
        let next = wait_for("a frame for the bus", next);
        assert_eq!(next.frame.data(), [number]);
    }
    let statistics = server.info().statistics();
    assert_eq!((statistics.dropped_to_bus, statistics.rejected), (0, 0));
}

#[test]
fn blocked_client_and_server_can_end() {
    for has_end in [false, true] {
        let server = server(BridgeProtocol::Socketcand);
        let mut client = connect(&server);
        exchange(&mut client, "< open can0 >", "< hi >");
        client.write_all("< send 123 0 >".repeat(100).as_bytes()).unwrap();
        let frame = wait_for("a frame for the bus", || server.clients().next_for_bus());
        assert!(frame.frame.data().is_empty());
        if has_end {
            drop(client);
            wait_for("the client is gone", || {
                server.clients().next_for_bus();
                (server.info().statistics().clients == 0).then_some(())
            });
        }
    }
}

#[test]
fn closed_bus_drops_waiting_and_rejects_new_frames() {
    let server = server(BridgeProtocol::Slcan);
    let mut client = connect(&server);
    exchange(&mut client, "O\rt1230\r", "\rz\r");
    assert_eq!(server.clients().set_accepting(false, 0), 1);
    exchange(&mut client, "t1240\r", "\x07\x07");
    assert_eq!(server.clients().next_for_bus(), None);
    assert_eq!(server.clients().set_accepting(true, 0), 0);
    exchange(&mut client, "t1250\r", "z\r");
    let next = server.clients().next_for_bus().unwrap();
    assert_eq!(next.frame.id().raw(), 0x125);
    let statistics = server.info().statistics();
    assert_eq!((statistics.discarded, statistics.dropped_to_bus), (2, 0));
}

#[test]
fn blocked_client_continues_when_bus_is_closed() {
    let server = server(BridgeProtocol::Socketcand);
    let mut client = connect(&server);
    exchange(&mut client, "", "< hi >");
    exchange(&mut client, "< open can0 >", "< ok >");
    client.write_all(("< send 123 0 >".repeat(100) + "< echo >").as_bytes()).unwrap();
    server.clients().set_accepting(false, 0);
    // The report of lost frames comes before or after the answer, or never if no frame waited.
    let mut answers = String::new();
    while !answers.contains("< echo >") {
        let mut byte = [0];
        client.read_exact(&mut byte).unwrap();
        answers.push(char::from(byte[0]));
    }
    assert_eq!(server.info().statistics().discarded, 100);
}

fn slcan(server: &BridgeServer) -> TcpStream {
    let mut client = connect(server);
    exchange(&mut client, "O\r", "\r");
    client
}

/// A client that sends more than the bus carries waits, and has its own turn.
#[test]
fn flooding_client_leaves_turns_to_others_and_loses_nothing() {
    let server = server_with(BridgeProtocol::Slcan, 64);
    let (mut flooder, mut other) = (slcan(&server), slcan(&server));
    let order: Vec<_> = std::thread::scope(|scope| {
        let flood = || exchange(&mut flooder, &"t1110\r".repeat(8000), &"z\r".repeat(8000));
        let flooding = scope.spawn(flood);
        exchange(&mut other, &"t2220\r".repeat(9), &"z\r".repeat(9));
        let next = || wait_for("a frame for the bus", || server.clients().next_for_bus());
        let order = (0..8009).map(|_| next().frame.id().raw()).collect();
        flooding.join().unwrap();
        order
    });
    let of_other = order.iter().enumerate().filter(|(_, id)| **id == 0x222);
    let places: Vec<_> = of_other.map(|(place, _)| place).collect();
    assert_eq!(places.len(), 9);
    assert!((0..).zip(&places).all(|(nth, place)| *place <= 2 * nth + 1), "{places:?}");
    let statistics = server.info().statistics();
    assert_eq!((statistics.dropped_to_bus, statistics.rejected), (0, 0));
}

/// The frames of a program that sends and ends are sent, but programs that repeat this lose frames.
#[test]
fn frames_of_clients_that_left_are_bounded() {
    let settings = BridgeConfig { queue: 4, max_clients: 2, ..BridgeConfig::default() };
    let server = BridgeServer::listen(&settings).unwrap();
    let leave = |text: &str, answer: &str| {
        let mut client = slcan(&server);
        exchange(&mut client, text, answer);
        drop(client);
        wait_for("the client is gone", || (server.info().statistics().clients == 0).then_some(()));
    };
    leave("t1110\r", "z\r");
    for _ in 0..20 {
        leave(&"t2220\r".repeat(4), &"z\r".repeat(4));
    }
    let order: Vec<_> = std::iter::from_fn(|| server.clients().next_for_bus())
        .map(|sent| sent.frame.id().raw())
        .collect();
    assert_eq!(order, [0x111, 0x222, 0x222, 0x222, 0x222]);
    assert_eq!(server.info().statistics().dropped_to_bus, 19 * 4);
}

#[test]
fn lost_frames_are_reported_to_their_client() {
    let server = server_with(BridgeProtocol::Slcan, 64);
    let (mut sender, mut other) = (slcan(&server), slcan(&server));
    exchange(&mut sender, &"t1110\r".repeat(5), &"z\r".repeat(5));
    let passed = server.clients().next_for_bus().unwrap();
    let failed = server.clients().next_for_bus().unwrap();
    server.clients().confirm(&passed, 1);
    server.clients().fail(&failed, 2);
    exchange(&mut sender, "", "\x07");
    assert_eq!(server.clients().set_accepting(false, 3), 3);
    exchange(&mut sender, "", "\x07\x07\x07");
    // Bus error; it is reset when it is read.
    exchange(&mut sender, "F\rF\r", "F80\rF00\r");
    exchange(&mut other, "F\r", "t1110\rF00\r");
    let statistics = server.info().statistics();
    assert_eq!((statistics.sent, statistics.failed, statistics.discarded), (1, 1, 3));
}

#[test]
fn lost_frames_are_error_frames_for_socketcand() {
    let server = server(BridgeProtocol::Socketcand);
    let mut client = connect(&server);
    exchange(&mut client, "< open can0 >", "< hi >< ok >");
    exchange(&mut client, "< rawmode >", "< ok >");
    exchange(&mut client, "< send 123 0 >< send 123 0 >< echo >", "< echo >");
    assert_eq!(server.clients().set_accepting(false, 1_500_000_000), 2);
    exchange(&mut client, "", "< error 001 1.500000 >< error 001 1.500000 >");
}
