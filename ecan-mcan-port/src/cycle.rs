//! The cycle of the Port: begin, receive, end.

use ecan_host::{Adapter, CycleError, DomainReport, Phase};
use ecan_protocol::image::ParseDiagnosis;

use crate::port::{Gateway, Port};
use crate::received::{Received, ReceivedView};
use crate::schedule_watch;
use crate::session::Event;

/// What became of the TxPDO image of a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ImageReport {
    /// The gateway is not in service.
    #[default]
    None,
    /// A new image.
    New {
        /// Images that were lost before it, by the sequence.
        lost: u16,
        /// The gateway marked it as incomplete (truncated or overflowed, manual 6.1).
        is_incomplete: bool,
        /// Its layout is not the configured one: its frames may be misread.
        layout_changed: bool,
    },
    /// The image of an earlier cycle again: nothing new arrived.
    Repeated,
    /// An image that cannot be used, or only up to the fault.
    Fault(ParseDiagnosis),
}

/// One cycle with one gateway.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CycleReport {
    /// The working counter and what it tells.
    pub domain: DomainReport,
    /// The TxPDO image.
    pub image: ImageReport,
    /// The last RxPDO image may not have arrived and is published again; frames sent now wait.
    pub is_holding: bool,
}

impl Port {
    /// First in the cycle: fetches the process images, judges them, and goes on with bringing
    /// gateways into service.
    ///
    /// Real-time safe: no allocation, no lock of the SDK, no call beyond the master's own. What
    /// the last cycle brought and was not received is gone. Nothing happens while a cycle is
    /// open already.
    ///
    /// # Errors
    /// A [`CycleError`] of the library. The cycle is open all the same, so that
    /// [`cycle_end`](Self::cycle_end) can keep the bus alive; call it in any case.
    pub fn cycle_begin(&mut self) -> Result<(), CycleError> {
        if self.cycle_open {
            return Ok(());
        }
        let result = self.adapter.receive();
        if self.adapter.phase() == Phase::Active {
            let time_ns = self.adapter.cycle_time_ns();
            self.since_first_ns = self.cycle_place.begin(time_ns, self.adapter.config());
        }
        let place_ns = self.cycle_point_ns.map(|_| self.since_first_ns);
        for (slave, gateway) in self.gateways.iter_mut().enumerate() {
            begin_gateway(&mut self.adapter, slave, gateway, place_ns);
        }
        self.cycle_open = true;
        result
    }

    /// Takes what came back into `received` and gives the number taken, in the order of the
    /// images and of the slaves. What does not fit stays for another call in the same cycle.
    ///
    /// Real-time safe; between `cycle_begin` and `cycle_end`.
    pub fn receive(&mut self, received: &mut [Received]) -> usize {
        let mut count = 0;
        let capacity = received.len();
        if capacity == 0 {
            return 0;
        }
        self.receive_views(|item| {
            if let Some(place) = received.get_mut(count) {
                *place = item.to_owned();
                count += 1;
            }
            count < capacity
        });
        count
    }

    /// Hands everything that came back to `take`, without a buffer between.
    ///
    /// Real-time safe as far as `take` is; between `cycle_begin` and `cycle_end`.
    pub fn receive_each(&mut self, mut take: impl FnMut(Received)) {
        self.receive_views(|item| {
            take(item.to_owned());
            true
        });
    }

    /// Hands what came back to `take`, where it lies in the images, until that returns false; the
    /// rest stays for another call in the same cycle.
    ///
    /// Real-time safe as far as `take` is; between `cycle_begin` and `cycle_end`.
    #[inline]
    pub fn receive_views(&mut self, mut take: impl FnMut(ReceivedView<'_>) -> bool) {
        let mut goes_on = true;
        for (slave, gateway) in self.gateways.iter_mut().enumerate() {
            let image = self.adapter.tx_pdo(slave);
            let Gateway { receiver, transmitter, statistics, .. } = gateway;
            receiver.drain(slave, image, transmitter, statistics, |item| {
                goes_on = take(item);
                goes_on
            });
            if !goes_on {
                return;
            }
        }
    }

    /// Last in the cycle: publishes the RxPDO images, or held ones once more, and sends.
    ///
    /// Real-time safe, as [`cycle_begin`](Self::cycle_begin).
    ///
    /// # Errors
    /// A [`CycleError`] of the library; the cycle may go on with the next call.
    pub fn cycle_end(&mut self) -> Result<(), CycleError> {
        self.cycle_open = false;
        if let Some(point_ns) = self.cycle_point_ns.take() {
            withdraw_late(&mut self.adapter, &mut self.gateways, point_ns, self.since_first_ns);
        }
        end(&mut self.adapter, &mut self.gateways)
    }
}

/// One gateway's part; `place_ns` is the application time since the first cycle, where it is known.
fn begin_gateway(
    adapter: &mut Adapter,
    slave: usize,
    gateway: &mut Gateway,
    place_ns: Option<u64>,
) {
    let report = adapter.domain_report(slave);
    let limits = (gateway.hold_limit, gateway.input_limit);
    let Gateway { session, transmitter, receiver, statistics, watch, .. } = gateway;
    if statistics.sessions > 0 {
        statistics.cycles += 1;
        statistics.incomplete_cycles += u64::from(!report.is_complete());
    }
    let pulse_ns = place_ns.and_then(|ns| gateway.schedule_times.pulse_of(ns));
    let last_ns = std::mem::replace(&mut gateway.pulse_ns, pulse_ns);
    let is_same_pulse = pulse_ns.is_some() && last_ns == pulse_ns;
    transmitter.begin(adapter.rx_pdo_mut(slave), report.outputs, is_same_pulse, statistics);
    let no_input = limits.1 > 0 && receiver.misses() > limits.1;
    let is_lost = transmitter.misses() > limits.0 || no_input;
    match session.step(adapter, is_lost) {
        Event::None => {}
        Event::Started => transmitter.reset(statistics),
        Event::Ready => {
            receiver.reset();
            transmitter.reset(statistics);
            watch.reset();
            statistics.sessions += 1;
        }
        Event::Failed => statistics.verification_failures += 1,
        Event::Lost => {
            receiver.reset();
            transmitter.reset(statistics);
            statistics.sessions_lost += 1;
        }
    }
    let is_ready = session.is_ready();
    if is_ready {
        schedule_watch::step(adapter, gateway);
    }
    let Gateway { transmitter, receiver, statistics, .. } = gateway;
    if is_ready && receiver.begin(adapter.tx_pdo(slave), report.inputs, statistics) {
        for (channel, status) in receiver.status().iter().enumerate() {
            transmitter.window(channel as u8).status(*status);
        }
    }
}

/// Takes scheduled frames back whose image would arrive behind their pulse: they would go out a
/// period late.
fn withdraw_late(
    adapter: &mut Adapter,
    gateways: &mut [Gateway],
    point_ns: u64,
    since_first_ns: u64,
) {
    let gateways = gateways.iter_mut().enumerate();
    for (slave, gateway) in gateways.filter(|(_, gateway)| gateway.transmitter.has_scheduled()) {
        let sent_ns = adapter.clock().now_ns().saturating_sub(point_ns);
        if gateway.schedule_times.misses_pulse(since_first_ns, sent_ns) {
            let image = adapter.rx_pdo_mut(slave);
            gateway.transmitter.withdraw_late(image, &mut gateway.statistics);
        }
    }
}

pub(crate) fn end(adapter: &mut Adapter, gateways: &mut [Gateway]) -> Result<(), CycleError> {
    for (slave, gateway) in gateways.iter_mut().enumerate() {
        let image = adapter.rx_pdo_mut(slave);
        gateway.transmitter.end(image, &mut gateway.statistics);
    }
    adapter.send()
}
