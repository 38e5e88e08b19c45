//! A plan as text, for the log of a trial.

use std::fmt;

use ecan_sim::Topology;

use super::{MS, Plan};

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "seed {}: {} gateways{}{}, clock {:?}, cycle {} ms, motion_div {}, SYNC every {} cycles, {}",
            self.seed,
            self.gateways,
            if self.topology == Topology::Star { " in a star" } else { "" },
            if self.has_aliases { " with aliases" } else { "" },
            self.clock,
            self.cycle_ns / MS,
            self.table.motion_div,
            self.table.sync.every_cycles,
            if self.table.network.host_heartbeat.is_some() { "heartbeat" } else { "no heartbeat" },
        )?;
        for (variant, alternative) in &self.variants {
            writeln!(f, "gateways: {} = {}", variant.key, alternative.value)?;
        }
        let app = &self.app;
        writeln!(
            f,
            "application: {}, {:?}, operator {:?} ms by {}, skips {}/{} per mille, commands first: {}, end {:?}",
            if app.steps { "steps" } else { "targets" },
            self.table.takeover,
            app.operator_ns.map(|ns| ns / MS),
            if app.recovers { "recover" } else { "steps" },
            app.skips_rx,
            app.skips_send,
            app.commands_first,
            app.end,
        )?;
        for (n, axis) in self.axes.iter().enumerate() {
            let (config, drive) = (&axis.config, &axis.drive);
            writeln!(
                f,
                "axis {n}: {}{} {}, limit {}, bounds {:?}, window {}, ramp {}, {:?}, outputs {:?}, \
                 {:?}, buffer {:?}, 0x605A {:?}, resume {}, enable {} ms, friction {}, quirks: old target {}, ignores quick stop {}, \
                 missing {:04X?}",
                axis.node_name(),
                if config.node_axis > 0 { ", second axis," } else { "" },
                config.mode,
                config.step_limit,
                config.bounds,
                config.following_window,
                config.ramp,
                axis.style,
                config.pdos.outputs,
                config.feed_forward,
                config.drive.interpolation_buffer,
                config.drive.quick_stop,
                config.auto_resume,
                drive.enable_ms,
                drive.motor.friction,
                drive.quirks.follows_old_target,
                drive.quirks.ignores_quick_stop,
                drive.quirks.missing,
            )?;
        }
        Ok(())
    }
}
