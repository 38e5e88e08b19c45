//! Attachment of a device to the kernel's virtual host controller, and its network interface.

use std::fs;
use std::os::fd::{AsRawFd as _, BorrowedFd};
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use crate::command::run;
use crate::rates::BusRates;

const CONTROLLER: &str = "/sys/devices/platform/vhci_hcd.0";
const INTERFACES: &str = "/sys/class/net";
/// Status of a free port.
const FREE: &str = "004";
const HIGH_SPEED: u32 = 3;
/// Maximum time until the driver has created the interface.
const LIMIT: Duration = Duration::from_secs(10);
const LOOK: Duration = Duration::from_millis(20);

/// Loads the modules if they are not loaded.
pub(super) fn load_modules() -> Result<(), String> {
    if !Path::new(CONTROLLER).exists() || !Path::new("/sys/module/gs_usb").exists() {
        run("modprobe", &["-a", "vhci-hcd", "gs_usb", "can-raw"])?;
    }
    match Path::new(CONTROLLER).exists() {
        true => Ok(()),
        false => Err(format!("{CONTROLLER} does not exist")),
    }
}

/// Connects a device to a free port. The kernel keeps the socket until its other end is closed.
pub(super) fn attach(kernel: BorrowedFd<'_>, device: u32) -> Result<(), String> {
    let path = format!("{CONTROLLER}/status");
    let status = fs::read_to_string(&path).map_err(|error| format!("{path}: {error}"))?;
    let free = status.lines().filter_map(|line| {
        let mut fields = line.split_whitespace();
        let is_high_speed = fields.next()? == "hs";
        let port: u32 = fields.next()?.parse().ok()?;
        (is_high_speed && fields.next()? == FREE).then_some(port)
    });
    let path = format!("{CONTROLLER}/attach");
    let mut message = format!("{path}: no free port");
    // Another process may take a port first.
    for port in free {
        let text = format!("{port} {} {device} {HIGH_SPEED}", kernel.as_raw_fd());
        match fs::write(&path, text) {
            Ok(()) => return Ok(()),
            Err(error) => message = format!("{path}: {error}"),
        }
    }
    Err(message)
}

/// Waits for the interface of the device with this serial number.
pub(super) fn interface_of(serial: &str) -> Result<String, String> {
    let start = Instant::now();
    while start.elapsed() < LIMIT {
        let entries = fs::read_dir(INTERFACES).map_err(|error| error.to_string())?;
        for entry in entries.flatten() {
            let found = fs::read_to_string(entry.path().join("device/../serial"));
            if found.is_ok_and(|text| text.trim_end() == serial) {
                return Ok(entry.file_name().to_string_lossy().into_owned());
            }
        }
        thread::sleep(LOOK);
    }
    Err("the driver gs_usb created no interface".to_owned())
}

/// Names the interface, sets its bit rates and sets it up.
pub(super) fn set_up(found: &str, name: &str, rates: BusRates) -> Result<(), String> {
    if found != name {
        run("ip", &["link", "set", "dev", found, "name", name])?;
    }
    let (nominal, data) = (rates.nominal_bitrate.to_string(), rates.data_bitrate.to_string());
    let mut arguments = vec!["link", "set", "dev", name, "up", "type", "can", "bitrate", &nominal];
    if rates.fd {
        arguments.extend(["dbitrate", &data, "fd", "on"]);
    }
    run("ip", &arguments)
}
