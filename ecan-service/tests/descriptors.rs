//! A process without free file descriptors. Alone in its process.
#![allow(missing_docs)]

#[path = "server/common/mod.rs"]
#[allow(dead_code)]
mod common;

use std::fs::File;
use std::io::Read as _;

use common::{Fixture, PATIENCE, wait_for};
use ecan_service::client::Client;
use rustix::process::{Resource, Rlimit, setrlimit};

#[test]
fn client_without_descriptor_is_rejected_with_the_reason() {
    let fixture = Fixture::start(|_| ());
    let good = fixture.client();
    wait_for("the end of other clients", || good.service_stats().unwrap().clients.len() == 1);
    let before = rustix::process::getrlimit(Resource::Nofile);
    setrlimit(Resource::Nofile, Rlimit { current: Some(64), maximum: before.maximum }).unwrap();
    let mut files = Vec::new();
    while let Ok(file) = File::open("/dev/null") {
        files.push(file);
    }
    files.pop();
    let mut stream = fixture.stream();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    let answer = String::from_utf8_lossy(&answer);
    assert!(answer.contains("the service has no free file descriptor"), "{answer}");
    assert_eq!(good.service_stats().unwrap().clients_rejected, 1);
    drop(files);
    assert!(Client::connect(&fixture.path(), "later").is_ok());
}
