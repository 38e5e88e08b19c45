//! The service of the application and its clients.

use std::time::Duration;

use ecan_mcan_port::Port;
use ecan_service::client::{Client, Event};
use ecan_service::server::{Control, Service, ServiceConfig};
use tempfile::TempDir;

use crate::draw::chance;
use crate::frame_number::Stream;
use crate::service_client::{ServiceClient, Turn, wait_for_service};
use crate::service_plan::ServicePlan;
use crate::side::Side;

/// Cycles after which the service has read what the cycle wrote, so that nothing is lost before it is read.
const READ_CYCLES: u64 = 16;

pub struct ServiceClients {
    plan: Option<ServicePlan>,
    directory: Option<TempDir>,
    service: Option<Service>,
    /// Connection without a subscription, to wait until the service has read what the cycle wrote.
    observer: Option<Client>,
    clients: Vec<ServiceClient>,
    is_settled: bool,
    /// Cycle in which another service begins.
    service_at: u64,
    /// A violation at the begin or the end of a service.
    violation: Option<String>,
}

impl ServiceClients {
    pub fn new(plan: Option<ServicePlan>) -> Result<Self, String> {
        let directory = plan.as_ref().map(|_| tempfile::tempdir()).transpose();
        let count = plan.as_ref().map_or(0, |plan| usize::from(plan.clients));
        let streams = Stream::OF_CLIENTS.into_iter().take(count);
        Ok(Self {
            directory: directory.map_err(|error| error.to_string())?,
            service: None,
            observer: None,
            clients: streams.map(ServiceClient::new).collect(),
            is_settled: false,
            service_at: 0,
            violation: None,
            plan,
        })
    }

    /// The application serves its Port, which was opened or configured again.
    pub fn attach(&mut self, port: &mut Port) {
        if let Err(text) = self.begin_service(port) {
            self.violation.get_or_insert(text);
        }
    }

    fn begin_service(&mut self, port: &mut Port) -> Result<(), String> {
        let (Some(plan), Some(directory)) = (&self.plan, &self.directory) else { return Ok(()) };
        self.is_settled = false;
        if let Some(service) = &self.service {
            service.attach(port);
            return Ok(());
        }
        let path = directory.path().join("service");
        let config = ServiceConfig {
            queue_bytes: plan.queue_bytes,
            window: plan.window,
            ..ServiceConfig::new(&path).with_control(Control::Owner)
        };
        let ecrt = port.adapter().ecrt().clone();
        let service = Service::of_bus(&ecrt, 0, config).map_err(|error| error.to_string())?;
        service.attach(port);
        self.service = Some(service);
        let observer = Client::connect(&path, "observer").map_err(|error| error.to_string())?;
        self.observer = Some(observer);
        self.read_cycles()
    }

    /// The service ends, perhaps with its application.
    pub fn end_service(&mut self, sides: &mut [Side]) {
        let Some(service) = self.service.take() else { return };
        drop(service);
        self.observer = None;
        for client in &mut self.clients {
            if let Err(text) = client.end_of_service(sides) {
                self.violation.get_or_insert(text);
            }
        }
    }

    /// Returns whether the application has ended the service and begins another one now.
    pub fn is_due(&self, cycle: u64) -> bool {
        self.plan.is_some() && self.service.is_none() && cycle >= self.service_at
    }

    /// Every client may act. The service may end while the application runs on.
    pub fn act(&mut self, turn: &mut Turn<'_>) -> Result<(), String> {
        if let Some(text) = self.violation.take() {
            return Err(text);
        }
        let (Some(plan), Some(service)) = (&self.plan, &self.service) else { return Ok(()) };
        turn.is_settled = std::mem::replace(&mut self.is_settled, true);
        if !turn.is_settled {
            let mut clients = self.clients.iter_mut();
            clients.try_for_each(|client| client.read_until_attached(turn.sides))?;
        }
        for client in &mut self.clients {
            if client.is_awake(turn.cycle) && chance(turn.random, plan.activity) {
                client.act(plan, service.path(), turn)?;
            }
        }
        if turn.cycle.is_multiple_of(READ_CYCLES) {
            self.read_cycles()?;
        }
        if turn.random.u16(..1_000) == 0 {
            self.service_at = turn.cycle + turn.random.u64(..50);
            self.end_service(turn.sides);
        }
        Ok(())
    }

    /// All clients read what waits for them; returns whether no frame is without result.
    pub fn settle(&mut self, sides: &mut [Side]) -> Result<bool, String> {
        let Some(observer) = &self.observer else { return Ok(true) };
        self.clients.iter_mut().try_for_each(|client| client.read_all(sides))?;
        let stats = observer.service_stats().map_err(|error| error.to_string())?;
        self.clients.iter().try_for_each(|client| client.check_stats(&stats))?;
        Ok(self.clients.iter().all(|client| !client.has_unresolved(sides)))
    }

    /// Waits until the service has read what the cycle wrote.
    fn read_cycles(&mut self) -> Result<(), String> {
        let Some(observer) = &self.observer else { return Ok(()) };
        wait_for_service(observer)?;
        while let Some(event) = observer.poll(Duration::ZERO).map_err(|error| error.to_string())? {
            // The state of a channel is for every client.
            let is_channel =
                matches!(&event, Event::Notification { method, .. } if method == "channel");
            if !is_channel && !matches!(event, Event::Gateways(_)) {
                return Err(format!("an event without a subscription: {event:?}"));
            }
        }
        Ok(())
    }
}
