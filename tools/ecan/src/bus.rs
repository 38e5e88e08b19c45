//! The slaves of a bus, read in parallel, with their firmware version and serial number (manual 13.8).

use std::panic::resume_unwind;
use std::thread::ScopedJoinHandle;
use std::{fmt, thread};

use ecan_host::{
    Clock, Diagnostics, Ecrt, Error, IdentificationError, SlaveInfo, SlaveKind, SlaveQuery as _,
};
use ecan_protocol::device::Capabilities;
use ecan_sim::Backend;
use serde::Serialize;

use crate::failure::{Failure, Result};
use crate::output;
use crate::service_access::ServiceConnection;
use crate::slave_choice::{Candidates, Recognised, SlaveChoice, choose, every_gateway, one_or_all};

/// Time to wait for the end of a scan, in ns: several seconds with many slaves.
const SCAN_NS: u64 = 30_000_000_000;
const POLL_NS: u64 = 50_000_000;

/// Way to a bus.
#[derive(Clone, Debug)]
enum Path {
    Library(Ecrt),
    Service(ServiceConnection),
}

/// A bus, opened without reserving the master.
#[derive(Debug)]
pub struct Bus {
    path: Path,
    master: u32,
    diagnostics: Diagnostics,
    choice: Option<SlaveChoice>,
}

impl Bus {
    /// Opens a master of a loaded library, for the slave of `--slave` if given. Waits while the
    /// master scans the bus.
    pub fn of(backend: &Backend, master: u32, choice: Option<SlaveChoice>) -> Result<Self> {
        Self::of_until(backend, master, choice, &|| false)
    }

    /// As [`of`](Self::of); `is_stopped` ends the wait.
    pub fn of_until(
        backend: &Backend,
        master: u32,
        choice: Option<SlaveChoice>,
        is_stopped: &dyn Fn() -> bool,
    ) -> Result<Self> {
        Self::open(&Path::Library(backend.ecrt.clone()), master, choice, is_stopped)
    }

    /// As [`of`](Self::of), through a service.
    pub fn of_service(connection: ServiceConnection, choice: Option<SlaveChoice>) -> Result<Self> {
        let master = connection.hello().master;
        Self::open(&Path::Service(connection), master, choice, &|| false)
    }

    fn open(
        path: &Path,
        master: u32,
        choice: Option<SlaveChoice>,
        is_stopped: &dyn Fn() -> bool,
    ) -> Result<Self> {
        let mut bus = Self::on(path, master, choice)?;
        let end_ns = bus.clock().now_ns().saturating_add(SCAN_NS);
        while bus.is_scanning() && bus.clock().now_ns() < end_ns && !is_stopped() {
            bus.sleep_ns(POLL_NS);
            bus = Self::on(path, master, choice)?;
        }
        tracing::debug!(master, slaves = bus.diagnostics.slave_count(), "bus opened");
        bus.diagnostics.require_link().map_err(Failure::master)?;
        Ok(bus)
    }

    /// Opens the bus again, with its present slaves.
    pub fn again(&self) -> Result<Self> {
        Self::on(&self.path, self.master, self.choice)
    }

    /// The same, through another connection to the service.
    pub fn through(&self, connection: ServiceConnection) -> Result<Self> {
        Self::on(&Path::Service(connection), self.master, self.choice)
    }

    /// Returns whether the master is still scanning the bus.
    fn is_scanning(&self) -> bool {
        let first = self.diagnostics.slave_info(0);
        matches!(first, Err(Error::NoSuchSlave { is_scanning: true, .. }))
    }

    fn on(path: &Path, master: u32, choice: Option<SlaveChoice>) -> Result<Self> {
        let diagnostics = match path {
            Path::Library(ecrt) => Diagnostics::of_bus(ecrt, master),
            Path::Service(connection) => Diagnostics::of_access(Box::new(connection.clone())),
        };
        let diagnostics = diagnostics.map_err(Failure::master)?;
        Ok(Self { path: path.clone(), master, diagnostics, choice })
    }

    /// Runs `work` for each slave and returns the results in this order. Each slave has a thread and
    /// a handle of its own, because the master serves the mailboxes of several slaves at the same
    /// time; in stepped time they run in turn, so that every run is the same.
    pub fn in_parallel<T: Send>(
        &self,
        slaves: &[usize],
        work: impl Fn(&Self, usize) -> Result<T> + Sync,
    ) -> Vec<Result<T>> {
        if slaves.len() < 2 || !self.clock().is_free_running() {
            return slaves.iter().map(|slave| work(self, *slave)).collect();
        }
        let work = &work;
        thread::scope(|scope| {
            let start = |slave: &usize| {
                let (path, master, choice, slave) =
                    (self.path.clone(), self.master, self.choice, *slave);
                let run = move || work(&Self::on(&path, master, choice)?, slave);
                let builder = thread::Builder::new().name(format!("slave {slave}"));
                builder.spawn_scoped(scope, run).map_err(Failure::of_thread)
            };
            let threads: Vec<_> = slaves.iter().map(start).collect();
            let result = |thread: Result<ScopedJoinHandle<'_, Result<T>>>| {
                thread?.join().unwrap_or_else(|panic| resume_unwind(panic))
            };
            threads.into_iter().map(result).collect()
        })
    }

    /// The library, for a command that runs a cycle of its own.
    pub fn ecrt(&self) -> Result<&Ecrt> {
        match &self.path {
            Path::Library(ecrt) => Ok(ecrt),
            Path::Service(connection) => Err(Failure::Master(format!(
                "this command runs a cycle of its own, and {} holds master {}; end that program, \
                 or use --via direct if it does not run a cycle",
                connection.program(),
                self.master
            ))),
        }
    }

    /// The service through which the bus is reached.
    pub fn service(&self) -> Option<&ServiceConnection> {
        match &self.path {
            Path::Library(_) => None,
            Path::Service(connection) => Some(connection),
        }
    }

    pub fn master(&self) -> u32 {
        self.master
    }

    pub fn is_simulated(&self) -> bool {
        match &self.path {
            Path::Library(ecrt) => ecrt.is_simulated(),
            Path::Service(connection) => connection.hello().is_simulated,
        }
    }

    /// The library, or the service.
    pub fn origin(&self) -> String {
        match &self.path {
            Path::Library(ecrt) => ecrt.origin().to_string(),
            Path::Service(connection) => connection.to_string(),
        }
    }

    pub fn diagnostics(&self) -> &Diagnostics {
        &self.diagnostics
    }

    pub fn clock(&self) -> &dyn Clock {
        self.diagnostics.clock()
    }

    pub fn sleep_ns(&self, duration_ns: u64) {
        self.clock().sleep_until_ns(self.clock().now_ns().saturating_add(duration_ns));
    }

    /// Repeats an action every `interval_ns` until it succeeds; returns its error after `limit_ns`.
    pub fn retry<T, E>(
        &self,
        interval_ns: u64,
        limit_ns: u64,
        mut action: impl FnMut() -> Result<T, E>,
    ) -> Result<T, E> {
        let deadline_ns = self.clock().now_ns().saturating_add(limit_ns);
        loop {
            match action() {
                Err(_) if self.clock().now_ns() < deadline_ns => self.sleep_ns(interval_ns),
                outcome => return outcome,
            }
        }
    }

    pub fn slaves(&self) -> Result<Vec<SlaveInfo>> {
        let infos = (0..self.diagnostics.slave_count()).map(|at| self.diagnostics.slave_info(at));
        infos.collect::<Result<_, _>>().map_err(Failure::Device)
    }

    pub fn kinds(&self) -> Vec<SlaveKind<Error>> {
        self.diagnostics.slave_kinds()
    }

    pub fn is_chosen(&self) -> bool {
        self.choice.is_some()
    }

    /// Returns the selected slave, or the only gateway.
    pub fn slave(&self) -> Result<usize> {
        choose(self, self.choice)
    }

    pub fn chosen_or_every_gateway(&self) -> Result<Vec<usize>> {
        match self.choice {
            Some(_) => Ok(vec![self.slave()?]),
            None => every_gateway(self),
        }
    }

    /// Returns the selected or only gateway, or all gateways with `--all`.
    pub fn one_or_all(&self, all: bool) -> Result<Recognised> {
        one_or_all(self, self.choice, all)
    }

    pub fn serial(&self, slave: usize) -> Result<u64> {
        serial_number(|subindex| self.read(slave, Capabilities::INDEX, subindex))
    }

    pub fn firmware_version(&self, slave: usize) -> Result<FirmwareVersion> {
        let text = match self.text(slave, 0x100A) {
            Err(Failure::Device(error)) if self.diagnostics.is_denial(&error) => None,
            read => Some(read?),
        };
        FirmwareVersion::read(text, |subindex| self.read(slave, Capabilities::INDEX, subindex))
    }

    /// Uploads an object of at most 4 bytes.
    pub fn read(&self, slave: usize, index: u16, subindex: u8) -> Result<u32> {
        output::step();
        self.diagnostics.sdo_upload_u32(slave, index, subindex).map_err(Failure::Device)
    }

    /// Downloads a number, in the size of the object in the table.
    pub fn write(&self, slave: usize, index: u16, subindex: u8, value: u32) -> Result {
        let entry = ecan_protocol::object::lookup(index, subindex).map(|(_, entry)| entry);
        let size = entry.and_then(|entry| entry.ty.size_bytes()).unwrap_or(4);
        output::step();
        let bytes = value.to_le_bytes();
        let data = bytes.get(..size).unwrap_or(&bytes);
        self.diagnostics.sdo_download(slave, index, subindex, data).map_err(Failure::Device)
    }

    pub fn text(&self, slave: usize, index: u16) -> Result<String> {
        let mut bytes = [0; 64];
        let length = self.diagnostics.sdo_upload(slave, index, 0, &mut bytes);
        let read = bytes.get(..length?).unwrap_or_default();
        Ok(String::from_utf8_lossy(read).trim_end_matches('\0').to_owned())
    }
}

impl Candidates for Bus {
    fn positions(&self) -> Result<Vec<(usize, u16)>> {
        Ok(self.slaves()?.iter().map(|slave| slave.alias).enumerate().collect())
    }

    fn recognised(&self) -> Result<Recognised> {
        // Without the service no slave can be identified, and none can be selected.
        let kinds = self.kinds().into_iter().map(|kind| match kind {
            SlaveKind::Unknown(IdentificationError::Silent(end @ Error::Disconnected { .. })) => {
                Err(end)
            }
            kind => Ok(kind),
        });
        let kinds: Vec<_> = kinds.collect::<Result<_, _>>()?;
        Ok(Recognised::new(kinds.into_iter().enumerate()))
    }

    fn serial(&self, slave: usize) -> Result<u64> {
        Bus::serial(self, slave)
    }
}

/// Bus of a simulation in a test.
#[cfg(test)]
impl Bus {
    pub fn over(ecrt: &Ecrt) -> Self {
        Self::on(&Path::Library(ecrt.clone()), 0, None).unwrap()
    }
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FirmwareVersion {
    /// 0x100A, if the gateway has it.
    pub firmware: Option<String>,
    /// 0xF000:05 and :06 as MAJOR.MINOR.BUILD.
    pub numbers: String,
    /// 0xF000:05, the high byte is major, the low byte minor.
    pub version: u16,
    /// 0xF000:06.
    pub build: u16,
}

impl FirmwareVersion {
    /// Builds the version from 0x100A and the numbers of 0xF000; `number` reads a subindex.
    pub fn read<E>(
        firmware: Option<String>,
        mut number: impl FnMut(u8) -> Result<u32, E>,
    ) -> Result<Self, E> {
        let (version, build) = (number(5)? as u16, number(6)? as u16);
        let [major, minor] = version.to_be_bytes();
        Ok(Self { firmware, numbers: format!("{major}.{minor}.{build}"), version, build })
    }

    /// Returns whether `named` is this version, as text of 0x100A or as numbers.
    pub fn is_version(&self, named: &str) -> bool {
        Some(named) == self.firmware.as_deref() || named == self.numbers
    }
}

impl fmt::Display for FirmwareVersion {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.firmware {
            Some(text) if *text != self.numbers => write!(formatter, "{text} ({})", self.numbers),
            _ => formatter.write_str(&self.numbers),
        }
    }
}

/// Reads the serial number of 0xF000:07 and :08; `number` reads a subindex.
pub fn serial_number<E>(mut number: impl FnMut(u8) -> Result<u32, E>) -> Result<u64, E> {
    Ok(u64::from(number(7)?) | u64::from(number(8)?) << 32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn version_matches_text_or_numbers() {
        let read = |text: Option<&str>| {
            let number = |subindex| Ok::<_, ()>(if subindex == 5 { 0x0E04 } else { 94 });
            FirmwareVersion::read(text.map(str::to_owned), number).unwrap()
        };
        let named = read(Some("v140494"));
        assert_eq!(named.to_string(), "v140494 (14.4.94)");
        assert!(named.is_version("v140494") && named.is_version("14.4.94"));
        assert!(!named.is_version("14.4.9"));
        assert_eq!(read(Some("14.4.94")).to_string(), "14.4.94");
        assert_eq!(read(None).to_string(), "14.4.94");
    }

    #[test]
    fn serial_number_combines_two_halves() {
        let halves = |subindex| if subindex == 7 { Ok(2) } else { Err(subindex) };
        assert_eq!(serial_number(halves), Err(8));
        assert_eq!(serial_number(|subindex| Ok::<_, ()>(subindex.into())), Ok(0x8_0000_0007));
    }
}
