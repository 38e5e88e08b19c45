//! A client that observes a simulated bus.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::sync::{Arc, Mutex};

/// The frames of a simulated bus, as an slcan client receives them.
pub struct ObservedBus(Arc<Mutex<String>>);

impl ObservedBus {
    /// Connects to the bridge that the banner of the simulation names.
    pub fn connect(banner: &str) -> Self {
        let port = banner.split("127.0.0.1:").nth(1).unwrap();
        let port: u16 = port.split(' ').next().unwrap().parse().unwrap();
        let mut client = TcpStream::connect(("127.0.0.1", port)).unwrap();
        client.write_all(b"S6\rO\r").unwrap();
        let frames = Arc::new(Mutex::new(String::new()));
        let received = frames.clone();
        std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            // A reset of the connection ends it, too.
            while let Ok(length @ 1..) = client.read(&mut bytes) {
                received.lock().unwrap().push_str(&String::from_utf8_lossy(&bytes[..length]));
            }
        });
        Self(frames)
    }

    /// Data of the frames of a CAN ID, in their order.
    pub fn frames(&self, id: &str) -> Vec<String> {
        let (received, start) = (self.0.lock().unwrap().clone(), format!("t{id}"));
        let frames = received.split('\r').filter_map(|frame| frame.strip_prefix(&start));
        // The length, then the data.
        frames.filter_map(|frame| frame.get(1..).map(str::to_owned)).collect()
    }
}
