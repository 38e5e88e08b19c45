//! What the Port reports against what the simulator knows.

use ecan_mcan_port::SlaveStatistics;
use ecan_sim::TransmitLosses;

use super::{Check, Trial, call, counters};
use crate::finding::Rule;

impl Trial {
    pub(super) fn update(&mut self) -> Check {
        let Some(application) = &mut self.application else { return Ok(()) };
        for (slave, images) in self.gateways.iter_mut().enumerate() {
            let statistics = application.statistics(slave).map_err(call)?;
            let SlaveStatistics { txpdo_lost, txpdo_unknown, parse_errors, .. } = statistics;
            images.now = txpdo_lost + txpdo_unknown + parse_errors;
            for side in self.accounts.iter_mut().filter(|side| side.slave == slave) {
                side.discarded_images = statistics.txpdo_discarded;
                let columns = statistics.channels[usize::from(side.channel)];
                let update = side.account.update(columns);
                update.map_err(|text| (Rule::Transmit, side.named(&text)))?;
            }
            let counters = counters(&self.simulation, slave);
            let sides = self.accounts.iter().filter(|side| side.slave == slave);
            let (mut delivered, mut most) = (0, 0);
            for side in sides {
                delivered += side.account.delivered();
                most += side.account.perhaps_taken();
            }
            let parsed = counters.frames_parsed;
            if parsed < delivered || parsed > most {
                let text = format!(
                    "slave {slave}: {parsed} frames parsed, {delivered} delivered, {most} perhaps taken"
                );
                return Err((Rule::Transmit, text));
            }
        }
        Ok(())
    }

    pub(super) fn drain_buses(&mut self) -> Check {
        let Self { simulation, accounts, .. } = self;
        let mut check = Ok(());
        simulation.with_world(|world| {
            world.drain_recorded(|bus, frame| {
                for side in accounts.iter_mut().filter(|side| side.bus == bus) {
                    let is_own = frame.channel == Some((side.slave, side.channel.into()));
                    let result = match is_own {
                        true => side.account.sent_on_bus(&frame.frame),
                        false => side.account.sent_by_other(&frame.frame),
                    };
                    if let (Ok(()), Err(text)) = (&check, result) {
                        check = Err((Rule::Transmit, side.named(&text)));
                    }
                }
            });
        });
        check
    }

    /// Frames wait in a gateway, for example for the answers of an echo node whose bus was overloaded.
    pub(super) fn awaits_bus(&self) -> bool {
        let mut slaves = 0..self.gateways.len();
        self.is_undisturbed
            && slaves.any(|slave| {
                let mut sides = self.accounts.iter().filter(|side| side.slave == slave);
                let counters = counters(&self.simulation, slave);
                sides.all(|side| side.has_partner)
                    && counters.transmit_losses == TransmitLosses::default()
                    && counters.frames_parsed > counters.frames_on_bus
            })
    }

    pub(super) fn check_sums(&self) -> Check {
        self.firmware.check(&self.simulation).map_err(|text| (Rule::Firmware, text))?;
        for (slave, images) in self.gateways.iter().enumerate() {
            let counters = counters(&self.simulation, slave);
            let sides = || self.accounts.iter().filter(|side| side.slave == slave);
            let arrived: u64 = sides().map(|side| side.account.arrived()).sum();
            let missing = images.now + images.ended;
            let most = counters.frames_to_master;
            let least = if missing == 0 { images.at_end - images.before } else { 0 };
            if !(least..=most).contains(&arrived) {
                let text = format!(
                    "slave {slave}: {arrived} frames arrived of {least} to {most} in images, {missing} images missing"
                );
                return Err((Rule::Receive, text));
            }
            for side in sides() {
                let (pending, accepted) = (side.account.pending(), side.account.accepted_so_far());
                if pending > 0 {
                    return Err((Rule::Transmit, side.named(&format!("{pending} frames pending"))));
                }
                // What the gateway did not send, it counts.
                let (on_bus, losses) = (side.account.on_bus(), counters.transmit_losses);
                let is_complete = on_bus == accepted || losses != TransmitLosses::default();
                if self.is_undisturbed && side.has_partner && !is_complete {
                    let text = format!(
                        "{on_bus} frames on the bus of {accepted} accepted, undisturbed: {counters:?}"
                    );
                    return Err((Rule::Transmit, side.named(&text)));
                }
            }
        }
        let log = self.simulation.kernel_log();
        match log.iter().find(|line| line.starts_with("simulator:")) {
            Some(line) => Err((Rule::Master, line.clone())),
            None => Ok(()),
        }
    }
}
