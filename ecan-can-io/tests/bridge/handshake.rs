//! The start of sessions: raw mode on a busy bus, and clients that are silent.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::thread;
use std::time::{Duration, Instant};

use ecan_can_io::bridge::{BridgeConfig, BridgeProtocol, BridgeServer};
use ecan_protocol::can::{CanFrame, CanId};

const TIMEOUT: Duration = Duration::from_secs(60);
const ROUNDS: usize = 50;

fn expect(stream: &mut TcpStream, text: &str) {
    let mut bytes = vec![0; text.len()];
    stream.read_exact(&mut bytes).unwrap();
    assert_eq!(String::from_utf8_lossy(&bytes), text);
}

#[test]
fn rawmode_answer_precedes_frames() {
    let settings = BridgeConfig::with_protocol(BridgeProtocol::Socketcand);
    let server = BridgeServer::listen(&settings).unwrap();
    let clients = server.clients();
    let frame = CanFrame::classic(CanId::standard(0x123).unwrap(), &[1, 2]).unwrap();
    let address = server.info().address();
    let client = thread::spawn(move || {
        for _ in 0..ROUNDS {
            let mut stream = TcpStream::connect(address).unwrap();
            stream.set_read_timeout(Some(TIMEOUT)).unwrap();
            expect(&mut stream, "< hi >");
            stream.write_all(b"< open can0 >").unwrap();
            expect(&mut stream, "< ok >");
            stream.write_all(b"< rawmode >").unwrap();
            expect(&mut stream, "< ok >");
            expect(&mut stream, "< frame 123 0.000000 0102 >");
        }
    });
    while !client.is_finished() {
        clients.deliver(&frame, 0, None);
        thread::yield_now();
    }
    client.join().unwrap();
}

/// Returns whether the server has closed the connection; waits for it.
fn is_closed(stream: &mut TcpStream) -> bool {
    stream.set_read_timeout(Some(TIMEOUT)).unwrap();
    let mut rest = Vec::new();
    match stream.read_to_end(&mut rest) {
        Ok(_) => true,
        Err(error) => error.kind() == std::io::ErrorKind::ConnectionReset,
    }
}

/// Also a client that sends a byte from time to time.
#[test]
fn socketcand_client_without_open_is_closed() {
    let settings = BridgeConfig {
        handshake: Duration::from_millis(50),
        ..BridgeConfig::with_protocol(BridgeProtocol::Socketcand)
    };
    let server = BridgeServer::listen(&settings).unwrap();
    let address = server.info().address();
    let mut opened = TcpStream::connect(address).unwrap();
    opened.set_read_timeout(Some(TIMEOUT)).unwrap();
    expect(&mut opened, "< hi >");
    opened.write_all(b"< open can0 >").unwrap();
    let mut answer = [0; 6];
    // On a busy machine even this client may be late.
    let is_in_time = opened.read_exact(&mut answer).is_ok();
    let mut silent = TcpStream::connect(address).unwrap();
    assert!(is_closed(&mut silent));
    let mut slow = TcpStream::connect(address).unwrap();
    let begun = Instant::now();
    while slow.write_all(b"x").is_ok() {
        assert!(begun.elapsed() < TIMEOUT, "it is not closed");
        thread::yield_now();
    }
    assert!(server.info().statistics().silent_clients >= 2);
    if is_in_time {
        opened.write_all(b"< echo >").unwrap();
        expect(&mut opened, "< echo >");
    }
}

#[test]
fn silent_clients_leave_their_places_to_others() {
    let server = BridgeServer::listen(&BridgeConfig::default()).unwrap();
    let connect = || {
        let stream = TcpStream::connect(server.info().address()).unwrap();
        stream.set_read_timeout(Some(TIMEOUT)).unwrap();
        stream
    };
    let mut silent: Vec<_> = (0..8).map(|_| connect()).collect();
    let mut open: Vec<_> = (0..8)
        .map(|_| {
            let mut client = connect();
            client.write_all(b"O\r").unwrap();
            expect(&mut client, "\r");
            client
        })
        .collect();
    assert!(silent.iter_mut().all(is_closed));
    // All that are left have opened the channel: no client loses its place.
    assert!(is_closed(&mut connect()));
    for client in &mut open {
        client.write_all(b"V\r").unwrap();
        expect(client, "V1010\r");
    }
    let statistics = server.info().statistics();
    assert_eq!((statistics.silent_clients, statistics.rejected_clients), (8, 1));
}
