//! A client of the service, with the account of what it sent and got.

use std::collections::HashMap;
use std::path::Path;
use std::time::Duration;

use ecan_service::client::{
    Client, ClientError, Event, EventKind, FrameEvent, FrameReport, IdFilter, ImageSubscription,
    RejectReason, ServiceStats, Subscription, Tag,
};
use fastrand::Rng;

use crate::account::Received;
use crate::draw::{chance, pick};
use crate::frame_number::{FrameNumber, Stream};
use crate::service_plan::ServicePlan;
use crate::side::Side;

/// Longest time until the end of a connection arrives.
const END_LIMIT: Duration = Duration::from_secs(60);

/// State of the trial in a turn of the clients, between two cycles.
pub struct Turn<'a> {
    pub sides: &'a mut [Side],
    pub random: &'a mut Rng,
    pub cycle: u64,
    /// The clients may send.
    pub sends: bool,
    /// The service has served the Port since a whole cycle.
    pub is_settled: bool,
}

pub struct ServiceClient {
    stream: Stream,
    /// Connections so far.
    connections: u32,
    connection: Option<Connection>,
    /// Cycle until which it does nothing, not even read.
    asleep_until: u64,
}

/// A connection, with what belongs to it.
struct Connection {
    client: Client,
    name: String,
    subscription: Option<Subscription>,
    /// Own frames without result, with the index of their side.
    unresolved: HashMap<Tag, (usize, FrameNumber)>,
    /// Its events of each side.
    sides: Vec<SideEvents>,
    /// Frame events that it got, without rejections of own frames, and those that it lost.
    delivered: u64,
    lost: u64,
    /// The same of PDO images.
    images_delivered: u64,
    images_lost: u64,
    has_images: bool,
    arrivals: Option<Arrivals>,
}

#[derive(Clone, Default)]
struct SideEvents {
    received: Received,
    results: Received,
}

/// Frames of a subscription to received frames: they arrive at the Port, and at the client or are lost.
struct Arrivals {
    /// Frames that the Port had received on the subscribed channels, and images that it had discarded.
    before: (u64, u64),
    got: u64,
    lost_before: u64,
}

impl ServiceClient {
    pub fn new(stream: Stream) -> Self {
        Self { stream, connections: 0, connection: None, asleep_until: 0 }
    }

    pub fn is_awake(&self, cycle: u64) -> bool {
        cycle >= self.asleep_until
    }

    /// Returns whether frames have no result. Those for a bus where nobody acknowledges may wait without end.
    pub fn has_unresolved(&self, sides: &[Side]) -> bool {
        let is_open = |(side, _): &(usize, FrameNumber)| sides[*side].has_partner;
        self.connection.as_ref().is_some_and(|requests| requests.unresolved.values().any(is_open))
    }

    /// Connects, or reads, sends and changes its subscription; leaves or sleeps afterwards.
    pub fn act(
        &mut self,
        plan: &ServicePlan,
        path: &Path,
        turn: &mut Turn<'_>,
    ) -> Result<(), String> {
        let Some(connection) = &mut self.connection else {
            self.connections += 1;
            let name = format!("{:?} {}", self.stream, self.connections);
            self.connection = Some(Connection::open(path, name, turn.sides.len())?);
            return Ok(());
        };
        // What the last cycles wrote.
        wait_for_service(&connection.client)?;
        if turn.sends {
            connection.send(self.stream, plan, turn)?;
        }
        // The service has queued the frames before the next cycle.
        wait_for_service(&connection.client)?;
        connection.read(turn.sides)?;
        connection.check_arrivals(turn.sides)?;
        let percent = if connection.subscription.is_some() { 5 } else { 60 };
        if turn.is_settled && chance(turn.random, percent) {
            connection.subscribe(turn)?;
        }
        match turn.random.u8(..100) {
            0 => connection.ask()?,
            1..6 => {
                let longest = pick(turn.random, &[20, 500, 4_000]);
                self.asleep_until = turn.cycle + turn.random.u64(..longest);
            }
            6 => {
                self.connection = None;
                self.asleep_until = turn.cycle + pick(turn.random, &[0, 0, 10, 200]);
            }
            _ => {}
        }
        Ok(())
    }

    /// Reads everything, and checks it as a whole.
    pub fn read_all(&mut self, sides: &mut [Side]) -> Result<(), String> {
        let Some(connection) = &mut self.connection else { return Ok(()) };
        wait_for_service(&connection.client)?;
        connection.read(sides)?;
        connection.check_arrivals(sides)
    }

    /// The service serves another Port, or the same one with another configuration: the frames of the one before
    /// have results.
    pub fn read_until_attached(&mut self, sides: &mut [Side]) -> Result<(), String> {
        let Some(connection) = &mut self.connection else { return Ok(()) };
        // The Port received frames while nobody served it.
        connection.arrivals = None;
        wait_for_service(&connection.client)?;
        connection.read(sides)?;
        match connection.unresolved.len() {
            0 => Ok(()),
            count => Err(format!("{}: {count} frames without result", connection.name)),
        }
    }

    /// The service has ended: what it sent before is read.
    pub fn end_of_service(&mut self, sides: &mut [Side]) -> Result<(), String> {
        let Some(mut connection) = self.connection.take() else { return Ok(()) };
        match connection.read_within(END_LIMIT, sides) {
            Err(text) if text == ClientError::Closed.to_string() => Ok(()),
            Err(text) => Err(text),
            Ok(()) => Err(format!("{}: the connection has not ended", connection.name)),
        }
    }

    /// The counters of the service are those of the client, which has read everything.
    pub fn check_stats(&self, stats: &ServiceStats) -> Result<(), String> {
        if stats.frames_lost_in_ring != 0 {
            return Err(format!("the service did not read the cycle in time: {stats:?}"));
        }
        let Some(connection) = &self.connection else { return Ok(()) };
        let name = &connection.name;
        let found = stats.clients.iter().find(|client| client.name == *name);
        let found = found.ok_or_else(|| format!("{name} is missing: {stats:?}"))?;
        let counted = (found.frames_delivered, found.frames_lost, found.frames_pending);
        let pending = connection.unresolved.len() as u64;
        let own = (connection.delivered, connection.lost, pending);
        let images = (found.images_delivered, found.images_lost);
        let own_images = (connection.images_delivered, connection.images_lost);
        // Lost images are reported with the next one.
        let is_equal = images.0 == own_images.0 && images.1 >= own_images.1;
        match is_equal && counted == own {
            true => Ok(()),
            false => Err(format!("{name} counts {own:?} and {own_images:?} images: {found:?}")),
        }
    }
}

impl Connection {
    fn open(path: &Path, name: String, sides: usize) -> Result<Self, String> {
        let client = Client::connect(path, &name).map_err(|error| error.to_string())?;
        Ok(Self {
            client,
            name,
            subscription: None,
            unresolved: HashMap::new(),
            sides: vec![SideEvents::default(); sides],
            delivered: 0,
            lost: 0,
            images_delivered: 0,
            images_lost: 0,
            has_images: false,
            arrivals: None,
        })
    }

    fn send(
        &mut self,
        stream: Stream,
        plan: &ServicePlan,
        turn: &mut Turn<'_>,
    ) -> Result<(), String> {
        let index = turn.random.usize(..turn.sides.len());
        let side = &mut turn.sides[index];
        let of_side = self.unresolved.values().filter(|(at, _)| *at == index).count();
        let count = turn.random.u32(..=plan.frames).min(plan.window - of_side as u32);
        for _ in 0..count {
            if !side.account.has_numbers() || !side.sends {
                return Ok(());
            }
            let (number, frame) = side.account.next_frame(stream);
            let sent = self.client.send(side.slave as u16, side.channel, &frame);
            let tag = sent.map_err(|error| error.to_string())?;
            side.account.accepted(stream);
            if self.unresolved.insert(tag, (index, number)).is_some() {
                return Err(format!("{}: tag {tag} is in use", self.name));
            }
        }
        Ok(())
    }

    fn subscribe(&mut self, turn: &mut Turn<'_>) -> Result<(), String> {
        let error = |error: ClientError| error.to_string();
        self.has_images = chance(turn.random, 30);
        match self.has_images {
            true => self.client.subscribe_images(&ImageSubscription::default()),
            false => self.client.unsubscribe_images(),
        }
        .map_err(error)?;
        self.arrivals = None;
        self.subscription = draw_subscription(turn.random, turn.sides);
        let Some(subscription) = &self.subscription else {
            return self.client.unsubscribe().map_err(error);
        };
        self.client.subscribe(subscription).map_err(error)?;
        if subscription.kinds == [EventKind::Received] && subscription.filters.is_empty() {
            let before = arrived(subscription, turn.sides);
            self.arrivals = Some(Arrivals { before, got: 0, lost_before: self.lost });
        }
        Ok(())
    }

    /// Requests that the service answers without the bus.
    fn ask(&self) -> Result<(), String> {
        self.client.state().map_err(|error| error.to_string())?;
        self.client.config().map_err(|error| error.to_string())?;
        match self.client.axes() {
            Err(error) if error.rpc().is_none() => Err(error.to_string()),
            _ => Ok(()),
        }
    }

    /// Takes the events that have arrived.
    fn read(&mut self, sides: &mut [Side]) -> Result<(), String> {
        self.read_within(Duration::ZERO, sides)
    }

    /// Takes events until none comes for a time.
    fn read_within(&mut self, limit: Duration, sides: &mut [Side]) -> Result<(), String> {
        while let Some(event) = self.client.poll(limit).map_err(|error| error.to_string())? {
            match event {
                Event::Frame(report) => {
                    let result = self.take(&report, sides);
                    result.map_err(|text| format!("{}: {text}", self.name))?;
                }
                Event::Image(_) if self.has_images => self.images_delivered += 1,
                Event::Lost(lost) => {
                    self.lost += lost.frames + lost.frames_in_client;
                    self.images_lost += lost.images + lost.images_in_client;
                }
                Event::Gateways(_) => {}
                Event::Notification { method, .. } if method == "channel" => {}
                other => return Err(format!("{}: {other:?}", self.name)),
            }
        }
        Ok(())
    }

    fn take(&mut self, report: &FrameReport, sides: &mut [Side]) -> Result<(), String> {
        let FrameReport { gateway, channel, tag, event, frame, .. } = *report;
        let place = (usize::from(gateway), channel);
        let index = sides.iter().position(|side| (side.slave, side.channel) == place);
        let Some(index) = index else { return Err(format!("another channel: {report:?}")) };
        let side = &mut sides[index];
        self.delivered += u64::from(!is_rejected_by_session(event));
        if tag != 0 {
            let sent = self.unresolved.remove(&tag);
            let (at, number) = sent.ok_or_else(|| format!("no such frame: {report:?}"))?;
            if at != index || FrameNumber::of(&frame, side.account.kinds) != Some(number) {
                return Err(format!("{number:?} was sent: {report:?}"));
            }
            let result = side.account.result_of_client(&number, event);
            return result.map_err(|text| side.named(&text));
        }
        let selects =
            |subscription: &Subscription| subscription.selects(gateway, channel, event, &frame);
        if !self.subscription.as_ref().is_some_and(selects) {
            return Err(format!("not subscribed: {report:?}"));
        }
        if let Some(arrivals) = &mut self.arrivals {
            arrivals.got += 1;
        }
        let SideEvents { received, results } = &mut self.sides[index];
        if event == FrameEvent::Received {
            side.check_filter(&frame)?;
        }
        let result = side.account.event_for_client(&frame, event, received, results);
        result.map_err(|text| side.named(&text))
    }

    /// Each frame that arrived at the Port has reached the client, or counts as lost.
    fn check_arrivals(&self, sides: &[Side]) -> Result<(), String> {
        let (Some(arrivals), Some(subscription)) = (&self.arrivals, &self.subscription) else {
            return Ok(());
        };
        let (arrived, discarded) = arrived(subscription, sides);
        let expected = arrived - arrivals.before.0;
        let (got, lost) = (arrivals.got, self.lost - arrivals.lost_before);
        // The service gets no images of a gateway that is not ready.
        let is_partial = discarded != arrivals.before.1;
        if got + lost == expected || is_partial && got + lost < expected {
            return Ok(());
        }
        let name = &self.name;
        Err(format!("{name}: {got} frames received and {lost} lost, of {expected} that arrived"))
    }
}

/// Rejections at once, which the service does not count as delivered.
fn is_rejected_by_session(event: FrameEvent) -> bool {
    matches!(event, FrameEvent::Rejected(reason)
        if !matches!(reason, RejectReason::NotReady | RejectReason::Closed | RejectReason::Expired))
}

/// Frames that arrived in images, on the channels of a subscription, and the images that were discarded.
fn arrived(subscription: &Subscription, sides: &[Side]) -> (u64, u64) {
    let Subscription { gateways, channels, .. } = subscription;
    let is_selected = |side: &&Side| {
        (gateways.is_empty() || gateways.contains(&(side.slave as u16)))
            && (channels.is_empty() || channels.contains(&side.channel))
    };
    let sides = sides.iter().filter(is_selected);
    sides.fold((0, 0), |(arrived, discarded), side| {
        (arrived + side.account.arrived(), discarded + side.discarded_images)
    })
}

fn draw_subscription(r: &mut Rng, sides: &[Side]) -> Option<Subscription> {
    if chance(r, 10) {
        return None;
    }
    let mut subscription = Subscription::default();
    let side = &sides[r.usize(..sides.len())];
    if chance(r, 50) {
        subscription.kinds = vec![EventKind::Received];
    } else if chance(r, 50) {
        let kinds = [EventKind::Received, EventKind::Transmitted, EventKind::Published];
        subscription.kinds = kinds.into_iter().filter(|_| r.bool()).collect();
    }
    if chance(r, 30) {
        subscription.gateways = vec![side.slave as u16];
    }
    if chance(r, 30) {
        subscription.channels = vec![side.channel];
    }
    if chance(r, 20) {
        subscription.filters = vec![IdFilter { id: r.u32(..), mask: 3 << r.u8(..10) }];
    }
    Some(subscription)
}

/// Returns after the service has read what the cycle wrote before this call and has delivered it before its
/// response: its loop reads the cycle once between two requests.
pub fn wait_for_service(client: &Client) -> Result<(), String> {
    for _ in 0..2 {
        client.service_stats().map_err(|error| error.to_string())?;
    }
    Ok(())
}
