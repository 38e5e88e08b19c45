//! The start of raw mode on a busy bus.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::thread;
use std::time::Duration;

use ecan_bridge::{BridgeConfig, BridgeProtocol, BridgeServer};
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
