//! Queues of client frames to the bus.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use ecan_bridge::{BridgeConfig, BridgeProtocol, BridgeServer};

const TIMEOUT: Duration = Duration::from_secs(60);

fn server(protocol: BridgeProtocol) -> BridgeServer {
    let settings = BridgeConfig { queue: 2, ..BridgeConfig::with_protocol(protocol) };
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
    assert_eq!(server.clients().set_accepting(false), 1);
    exchange(&mut client, "t1240\r", "\x07");
    assert_eq!(server.clients().next_for_bus(), None);
    assert_eq!(server.clients().set_accepting(true), 0);
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
    server.clients().set_accepting(false);
    exchange(&mut client, "", "< echo >");
    assert_eq!(server.info().statistics().discarded, 100);
}
