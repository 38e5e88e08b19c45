//! Reports to the user and to the service manager (systemd): readiness, state, watchdog; and the reload of the
//! configuration file on SIGHUP, with what gateways in OP permit.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::thread;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ecan_lite::config::ServiceSettings;
use ecan_mcan_port::{BusChange, BusEvent, Config};
use ecan_protocol::text::Printable;
use ecan_service::server::{Control, Service};
use sd_notify::NotifyState;

use super::arguments::{Access, access_text};
use super::methods::Command;
use crate::config_changes::{Change, changes};
use crate::config_file;
use crate::context::{Failure, GlobalOptions, Result, note};
use crate::frames::{GatewayRequirements, of_file_offline};

/// Time until the service counts as started without gateways that could be configured.
const START_LIMIT: Duration = Duration::from_secs(10);
/// Longest time without a cycle while gateways are configured: each step has its own limit.
const CONFIGURATION_LIMIT: Duration = Duration::from_secs(600);
/// Time that the end of the command waits for the service manager.
const END_LIMIT: Duration = Duration::from_secs(1);
const MAX_INTERVAL: Duration = Duration::from_secs(1);

/// An event for the reporter.
#[derive(Debug)]
pub enum Event {
    /// Gateways at these positions start; the time that this may take.
    Start(Vec<usize>, Duration),
    /// A change of a gateway or channel.
    Change(BusChange),
    /// The state without gateways.
    State(String),
    /// The service runs no cycle.
    Idle,
    /// SIGHUP.
    HangUp,
    End,
}

/// Decides whether the watchdog is pinged.
#[derive(Debug)]
struct Watchdog {
    interval: Duration,
    /// Last step of the cycle's thread, and its time.
    seen: (u64, Instant),
}

impl Watchdog {
    /// Returns whether the thread of the cycle has made progress.
    fn is_alive(&mut self, steps: u64, is_cycle: bool, now: Instant) -> bool {
        if steps != self.seen.0 {
            self.seen = (steps, now);
        }
        let limit = if is_cycle { self.interval / 2 } else { CONFIGURATION_LIMIT };
        now.saturating_duration_since(self.seen.1) < limit
    }
}

/// Progress of the thread of the cycle.
#[derive(Debug, Default)]
struct Progress {
    steps: AtomicU64,
    is_cycle: AtomicBool,
}

/// Sends events to the reporter, without waiting for it.
#[derive(Clone, Debug)]
pub struct Notifier {
    events: Sender<Event>,
    progress: Arc<Progress>,
}

impl Notifier {
    /// The notifier, and its events for [`start`](Self::start).
    pub fn new() -> (Self, Receiver<Event>) {
        let (events, receiver) = channel();
        (Self { events, progress: Arc::default() }, receiver)
    }

    /// Starts the reporter.
    pub fn start(&self, events: Receiver<Event>, reloader: Reloader) -> Result<JoinHandle<()>> {
        let now = Instant::now();
        let watchdog = sd_notify::watchdog_enabled();
        let watchdog = watchdog.map(|interval| Watchdog { interval, seen: (0, now) });
        let reporter = Reporter {
            events,
            progress: self.progress.clone(),
            reloader,
            watchdog,
            ready_at: Some(now + START_LIMIT),
            is_first: true,
            positions: Vec::new(),
            are_ready: Vec::new(),
            status: String::new(),
        };
        let builder = thread::Builder::new().name("notification".to_owned());
        builder.spawn(move || reporter.run()).map_err(Failure::of_thread)
    }

    pub fn send(&self, event: Event) {
        // The reporter ends after the command only.
        let _ = self.events.send(event);
    }

    /// Ends the reporter. It may wait for a service manager that does not read.
    pub fn end(&self, reporter: &JoinHandle<()>) {
        self.send(Event::End);
        let end = Instant::now() + END_LIMIT;
        while !reporter.is_finished() && Instant::now() < end {
            thread::sleep(Duration::from_millis(1));
        }
    }

    /// A cycle has ended; real-time safe.
    pub fn cycle(&self) {
        self.progress.is_cycle.store(true, Ordering::Relaxed);
        self.progress.steps.fetch_add(1, Ordering::Relaxed);
    }

    /// The thread begins something that takes longer than a cycle.
    pub fn no_cycle(&self) {
        self.progress.is_cycle.store(false, Ordering::Relaxed);
        self.progress.steps.fetch_add(1, Ordering::Relaxed);
    }
}

struct Reporter {
    events: Receiver<Event>,
    progress: Arc<Progress>,
    reloader: Reloader,
    watchdog: Option<Watchdog>,
    /// Time at which the service counts as started; `None` after it.
    ready_at: Option<Instant>,
    is_first: bool,
    positions: Vec<usize>,
    are_ready: Vec<bool>,
    status: String,
}

impl Reporter {
    fn run(mut self) {
        let watchdog = self.watchdog.as_ref();
        let interval =
            watchdog.map_or(MAX_INTERVAL, |watchdog| (watchdog.interval / 4).min(MAX_INTERVAL));
        loop {
            match self.events.recv_timeout(interval) {
                Ok(Event::End) | Err(RecvTimeoutError::Disconnected) => break,
                Ok(event) => self.take(event),
                Err(RecvTimeoutError::Timeout) => {}
            }
            self.report_start();
            self.ping();
        }
        notify(&[NotifyState::Stopping]);
    }

    fn take(&mut self, event: Event) {
        match event {
            Event::Start(positions, timeout) => {
                // The first start only: without one that succeeds it would never be over.
                if std::mem::take(&mut self.is_first) && self.ready_at.is_some() {
                    self.ready_at = Some(Instant::now() + timeout);
                }
                self.are_ready = vec![false; positions.len()];
                self.positions = positions;
            }
            Event::Change(BusChange { gateway, event, .. }) => {
                let index = gateway.slave();
                let position = self.positions.get(index).copied().unwrap_or_default();
                note(format_args!("slave {position}: {event}"));
                // The service does not see the fault of a verification.
                if let BusEvent::Failed(Some(fault)) = event {
                    self.record(format!("slave {position}: {fault}"));
                }
                if let Some(is_ready) = self.are_ready.get_mut(index) {
                    *is_ready = matches!(event, BusEvent::Ready(_) | BusEvent::Channel(..));
                }
            }
            Event::State(text) => {
                self.positions.clear();
                self.are_ready.clear();
                self.record(text.clone());
                return self.set_status(text);
            }
            Event::Idle => {
                self.ready_at = Some(Instant::now());
                return self.set_status("no cycle: state of the bus and SDO transfers".to_owned());
            }
            Event::HangUp => {
                let now = NotifyState::monotonic_usec_now().ok();
                notify(&std::iter::once(NotifyState::Reloading).chain(now).collect::<Vec<_>>());
                let end = match self.reloader.reload() {
                    Ok(()) => "",
                    Err(error) => {
                        note(format_args!("reload: nothing was changed: {error}"));
                        "; the last reload failed"
                    }
                };
                let status = format!("{}{end}", self.status);
                notify(&[NotifyState::Ready, NotifyState::Status(&status)]);
                return;
            }
            Event::End => {}
        }
        self.set_status(self.text());
    }

    fn record(&self, text: String) {
        if let Some(service) = self.reloader.service.upgrade() {
            service.record_event(text);
        }
    }

    fn text(&self) -> String {
        let missing: Vec<_> = self.positions.iter().zip(&self.are_ready).collect();
        let missing = missing.iter().filter(|(_, is_ready)| !**is_ready);
        let missing: Vec<_> = missing.map(|(position, _)| position.to_string()).collect();
        let total = self.positions.len();
        let ready = total - missing.len();
        match missing.is_empty() {
            true => format!("{ready} of {total} gateways ready"),
            false => {
                format!(
                    "{ready} of {total} gateways ready; not ready: slave {}",
                    missing.join(", ")
                )
            }
        }
    }

    fn set_status(&mut self, status: String) {
        if self.status != status {
            notify(&[NotifyState::Status(&status)]);
            self.status = status;
        }
    }

    fn report_start(&mut self) {
        let Some(ready_at) = self.ready_at else { return };
        let are_ready =
            !self.are_ready.is_empty() && self.are_ready.iter().all(|is_ready| *is_ready);
        if are_ready || Instant::now() >= ready_at {
            notify(&[NotifyState::Ready, NotifyState::Status(&self.status)]);
            self.ready_at = None;
        }
    }

    fn ping(&mut self) {
        let Some(watchdog) = &mut self.watchdog else { return };
        let steps = self.progress.steps.load(Ordering::Relaxed);
        let is_cycle = self.progress.is_cycle.load(Ordering::Relaxed);
        if watchdog.is_alive(steps, is_cycle, Instant::now()) {
            notify(&[NotifyState::Watchdog]);
        }
    }
}

fn notify(states: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(states) {
        tracing::warn!("service manager not notified: {error}");
    }
}

/// Configuration of the gateways now; `None` before the first one.
pub type ActiveConfig = Arc<Mutex<Option<Config>>>;

/// Settings that concern the host only, with the names of [`changes`].
const LIMITS: [&str; 3] = [".paced", ".hold_limit", ".input_limit"];

pub struct Reloader {
    pub path: Option<PathBuf>,
    pub global: GlobalOptions,
    pub access: Access,
    pub last_access: (Control, u16),
    pub active: ActiveConfig,
    pub service: Weak<Service>,
    pub commands: Sender<Command>,
}

impl Reloader {
    /// Prints what it has applied and what needs another step. A faulty file changes nothing.
    pub fn reload(&mut self) -> Result {
        let Some(service) = self.service.upgrade() else { return Ok(()) };
        let Some(path) = self.path.clone() else {
            self.set_access(&service, &ServiceSettings::default())?;
            note("reload: no --config; the users of the control group were read again");
            return Ok(());
        };
        let file = config_file::read(&path)?;
        let settings = config_file::service(&path)?;
        let planned =
            of_file_offline(&path, &file, GatewayRequirements::of_service(), &self.global)?;
        self.set_access(&service, &settings)?;
        let name = Printable(path.display());
        let Some((limits, others)) = self.apply(&(planned.adapter, planned.config).into()) else {
            note(format_args!("reload {name}: read; no gateway has started yet"));
            return Ok(());
        };
        for change in &others {
            let action = match change.setting.as_str() {
                "master_index" => "needs a restart of the service".to_owned(),
                _ => format!("needs `ecan config apply {name}`, for which the gateways leave OP"),
            };
            note(format_args!("reload {name}: {change}: {action}"));
        }
        for change in &limits {
            note(format_args!("reload {name}: {change}: active now"));
        }
        if others.is_empty() && limits.is_empty() {
            note(format_args!("reload {name}: no setting of the gateways differs"));
        }
        Ok(())
    }

    /// Applies the limits; returns their changes and the others, `None` before the first start.
    fn apply(&self, new: &Config) -> Option<(Vec<Change>, Vec<Change>)> {
        let mut active = self.active.lock().unwrap_or_else(PoisonError::into_inner);
        let active = active.as_mut()?;
        // Gateways are compared by their index.
        let is_same_bus = active.adapter.slaves.len() == new.adapter.slaves.len();
        let is_limit = |setting: &str| LIMITS.iter().any(|end| setting.ends_with(end));
        let (limits, others): (Vec<_>, Vec<_>) = changes(active, new)
            .into_iter()
            .partition(|change| is_same_bus && is_limit(&change.setting));
        if !limits.is_empty() {
            let gateways = active.port.gateways.iter_mut().zip(&new.port.gateways);
            gateways.for_each(|(active, new)| active.set_limits(new));
            // The thread of the cycle ends after this one.
            let _ = self.commands.send(Command::Limits(Box::new(new.port)));
        }
        Some((limits, others))
    }

    /// Sets the access, also if it is the same: users may have joined or left the group.
    fn set_access(&mut self, service: &Service, settings: &ServiceSettings) -> Result {
        let access = self.access.with(settings);
        let (control, max_clients) = access.clone();
        service.set_control(control).map_err(|error| Failure::Host(error.to_string()))?;
        service.set_max_clients(max_clients.into());
        if self.last_access != access {
            let control = access_text(&access.0);
            note(format_args!("reload: {control}, at most {max_clients} clients: active now"));
            self.last_access = access;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stuck_cycle_ends_the_pings() {
        let start = Instant::now();
        let mut watchdog = Watchdog { interval: Duration::from_secs(10), seen: (0, start) };
        let mut is_alive = |steps, is_cycle, seconds| {
            watchdog.is_alive(steps, is_cycle, start + Duration::from_secs(seconds))
        };
        assert!(is_alive(0, false, 30), "gateways are being configured");
        assert!(is_alive(1000, true, 31));
        assert!(is_alive(1000, true, 35), "a late thread of notification");
        assert!(!is_alive(1000, true, 36));
        assert!(is_alive(1001, true, 37));
        assert!(is_alive(1002, false, 38));
        assert!(is_alive(1002, false, 637));
        assert!(!is_alive(1002, false, 638), "configuration without end");
    }
}
