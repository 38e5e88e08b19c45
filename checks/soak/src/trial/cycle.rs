//! One cycle of the application.

use ecan_mcan_port::{Received, ReceivedView, SendOptions, TransmitHint};
use ecan_protocol::can::CanFrame;
use ecan_protocol::image::Schedule;
use fastrand::Rng;

use super::{Check, Trial};
use crate::application::Application;
use crate::draw::{chance, pick};
use crate::finding::Rule;
use crate::frame_number::Stream;
use crate::side::Side;

/// Received frames with their gateways and channels.
type Frames = Vec<(usize, u8, CanFrame)>;

impl Trial {
    pub(super) fn cycle(&mut self, sends: bool) -> Check {
        self.operate();
        self.serve_clients(sends)?;
        let received = self.exchange(sends)?;
        self.drain_buses()?;
        for (slave, channel, frame) in received {
            let side = self
                .accounts
                .iter_mut()
                .find(|account| (account.slave, account.channel) == (slave, channel));
            let side = side.ok_or_else(|| {
                (Rule::Receive, format!("a frame of slave {slave} channel {channel}: {frame:?}"))
            })?;
            side.received(&frame).map_err(|text| (Rule::Receive, side.named(&text)))?;
        }
        self.axes.check(&self.simulation).map_err(|text| (Rule::Target, text))?;
        self.update()
    }

    /// Receives and sends.
    fn exchange(&mut self, sends: bool) -> Result<Frames, (Rule, String)> {
        let Some(application) = &mut self.application else { return Ok(Vec::new()) };
        let r = &mut self.random;
        let machine = &self.plan.machine;
        let sync0_ns = machine.sync0_shift_us.map(|_| machine.cycle_us * 1_000);
        let leaves = self.cycle < self.leave_until;
        let mut received = Vec::new();
        let sides = self.accounts.iter_mut().filter(|side| sends && side.sends);
        match application {
            Application::Rust(connection) => {
                connection.begin();
                let mut cycle = connection.port.begin_cycle();
                if self.axes.is_open() {
                    if !leaves || chance(r, 50) {
                        self.axes.receive(&mut cycle, |item| {
                            if let Received::Frame(frame) = item {
                                received.push((frame.slave, frame.channel, frame.frame));
                            }
                        });
                    }
                    self.axes.send(&mut cycle, r);
                } else {
                    let most = if leaves { r.usize(..4) } else { usize::MAX };
                    for item in cycle.received().take(most) {
                        if let ReceivedView::Frame { slave, packet } = item {
                            received.push((slave, packet.channel, packet.frame.to_owned()));
                        }
                    }
                }
                let sent = send(r, sides, sync0_ns, |_, side, frame, options| {
                    let Some(handle) = side.handle else { return Ok(false) };
                    match cycle.send_with(handle, frame, options) {
                        Ok(_) => Ok(true),
                        Err(error) if error.is_temporary() || options.schedule.is_some() => {
                            Ok(false)
                        }
                        Err(error) => Err(error.to_string()),
                    }
                });
                let _ = cycle.finish();
                connection.end();
                sent.map_err(|text| (Rule::Call, text))?;
            }
            Application::C(application) => {
                let take = |slave, channel, frame| received.push((slave, channel, frame));
                let exchange = || {
                    if !sends && !leaves {
                        return application.exchange(take);
                    }
                    application.begin()?;
                    let most = if leaves { r.usize(..4) } else { usize::MAX };
                    application.receive(r, most, take)?;
                    send(r, sides, sync0_ns, |r, side, frame, options| {
                        application.send(r, side.slave, side.channel, frame, options)
                    })?;
                    application.end()
                };
                exchange().map_err(|text| (Rule::Call, text))?;
            }
        }
        Ok(received)
    }
}

/// Sends the frames of a cycle: bursts, with the means of the channels. `send_one` returns false if the Port rejected
/// a frame.
fn send<'s>(
    r: &mut Rng,
    sides: impl Iterator<Item = &'s mut Side>,
    sync0_ns: Option<u32>,
    mut send_one: impl FnMut(&mut Rng, &Side, &CanFrame, SendOptions) -> Result<bool, String>,
) -> Result<(), String> {
    for side in sides {
        let mean = side.frames;
        let count = match r.u8(..8) {
            0..6 => mean / 1_000 + u32::from(r.u32(..1_000) < mean % 1_000),
            6 => 0,
            _ => mean * 2 / 1_000,
        };
        for _ in 0..count {
            if !side.account.has_numbers() {
                break;
            }
            let stream = match r.u8(..40) {
                0 if sync0_ns.is_some() => Stream::Scheduled,
                1 => Stream::Hinted,
                _ => Stream::Immediate,
            };
            let options = match (stream, sync0_ns) {
                (Stream::Scheduled, Some(period)) => {
                    Schedule { tag: r.u16(..), offset_ns: r.u32(..period) }.into()
                }
                (Stream::Hinted, _) => SendOptions {
                    hint: pick(
                        r,
                        &[
                            TransmitHint::HighPriority,
                            TransmitHint::DedicatedBuffer,
                            TransmitHint::Queue,
                        ],
                    ),
                    ..SendOptions::default()
                },
                _ => SendOptions::default(),
            };
            let (_, frame) = side.account.next_frame(stream);
            if !send_one(r, side, &frame, options)? {
                break;
            }
            side.account.accepted(stream);
        }
    }
    Ok(())
}
