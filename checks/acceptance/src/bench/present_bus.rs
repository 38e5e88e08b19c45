//! The bus of the running step: simulated gateways on the wire, connected ones, or a scenario.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use super::{Bench, Kind};
use crate::bus::{BusSpec, Nodes};
use crate::slave::{Slave, SlaveReport};
use crate::stop::Stop;

/// Time limit for simulated gateways to start, and to end.
const SLAVE_LIMIT: Duration = Duration::from_secs(60);
/// File with the bus of simulated gateways.
const SCENARIO: &str = "scenario.toml";

impl Bench {
    pub(super) fn scenario_path(&self) -> PathBuf {
        self.work.join(SCENARIO)
    }

    /// Provides a bus. Simulated gateways are started again only if another bus is needed.
    ///
    /// # Errors
    /// Skips the step if there is no such bus.
    pub fn bus(&mut self, mut spec: BusSpec) -> Result<(), Stop> {
        if self.kind != Kind::Device && spec.nodes == Nodes::Any {
            spec.nodes = Nodes::Echo;
        }
        let is_running = self.slave.as_mut().is_some_and(Slave::is_running);
        let is_present = self.kind != Kind::Wire || is_running;
        if self.spec.as_ref() == Some(&spec) && is_present {
            return Ok(());
        }
        match self.kind {
            Kind::Device => self.check_device(&spec)?,
            Kind::Library => {}
            Kind::Wire => {
                let most = self.arguments.gateways;
                if spec.gateways > most {
                    let text = format!("needs {} gateways, --gateways is {most}", spec.gateways);
                    return Err(Stop::Skipped(text));
                }
            }
        }
        self.stop_slave()?;
        let head = if self.arguments.like_igh { "[master]\nlike = \"igh\"\n" } else { "" };
        self.write_file(SCENARIO, spec.scenario(head, &self.gateway_keys))?;
        self.spec = Some(spec);
        if self.kind == Kind::Wire {
            self.wait_for_slaves(0)?;
            self.start_slave()?;
        }
        if self.kind != Kind::Library {
            let begin = Instant::now();
            self.wait_for_slaves(self.gateway_count())?;
            self.figure("bus_scan_s", begin.elapsed().as_secs_f64());
        }
        Ok(())
    }

    /// As [`bus`](Self::bus), with gateways that have just been switched on, if they are simulated.
    pub fn fresh_bus(&mut self, spec: BusSpec) -> Result<(), Stop> {
        self.spec = None;
        self.bus(spec)
    }

    fn check_device(&self, spec: &BusSpec) -> Result<(), Stop> {
        let present = self.arguments.gateways;
        let reason = if spec.needs_simulation() {
            "needs faults of simulated gateways".to_owned()
        } else if spec.nodes == Nodes::Drives {
            "needs simulated drives".to_owned()
        } else if spec.nodes == Nodes::Echo && !self.arguments.echo_nodes {
            "needs nodes that return every frame; connect them and give --echo-nodes".to_owned()
        } else if spec.gateways > present {
            format!("needs {} gateways, --gateways is {present}", spec.gateways)
        } else {
            return Ok(());
        };
        Err(Stop::Skipped(reason))
    }

    /// Number of gateways on the present bus.
    pub fn gateway_count(&self) -> u16 {
        match (self.kind, &self.spec) {
            (Kind::Device, _) => self.arguments.gateways,
            (_, Some(spec)) => spec.gateways,
            (_, None) => 0,
        }
    }

    /// Starts the simulated gateways on the wire.
    pub fn start_slave(&mut self) -> Result<(), Stop> {
        let interface = self.arguments.interface.clone().unwrap_or_default();
        let mut command = self.plain("ecan-sim", ["wire", "--interface", &interface, "--scenario"]);
        command.arg(self.scenario_path()).args(self.real_time_options());
        let gateways = self.gateway_count();
        let limit = self.limit(SLAVE_LIMIT);
        self.slave = Some(Slave::start(command, gateways, limit, &self.interrupt)?);
        Ok(())
    }

    /// Ends the simulated gateways on the wire; `None` if there are none.
    pub fn stop_slave(&mut self) -> Result<Option<SlaveReport>, Stop> {
        let Some(mut slave) = self.slave.take() else { return Ok(None) };
        if !slave.is_running() {
            self.note(slave.ended()?);
            return Ok(None);
        }
        let report = slave.stop(self.limit(SLAVE_LIMIT))?;
        self.note(report.0.clone());
        Ok(Some(report))
    }

    /// The simulated gateways on the wire.
    pub fn slave(&mut self) -> Result<&mut Slave, Stop> {
        self.slave
            .as_mut()
            .ok_or_else(|| Stop::Skipped("no simulated gateways on the wire".to_owned()))
    }

    /// Switches the gateways off for this time and on again, while programs run.
    pub fn power_cycle(&mut self, off: Duration) -> Result<(), Stop> {
        match self.kind {
            Kind::Wire => {
                self.stop_slave()?;
                self.pause(off)?;
                self.start_slave()
            }
            Kind::Device => {
                let Some(command) = self.arguments.power_cycle.clone() else {
                    return Err(Stop::Skipped("needs --power-cycle COMMAND".to_owned()));
                };
                let command = self.system("sh", ["-c", &command]);
                self.restore(command)?.expect(0).map(drop)
            }
            Kind::Library => {
                Err(Stop::Skipped("a simulated library has no power switch".to_owned()))
            }
        }
    }

    /// Waits until the simulated gateways on the wire are in PREOP. After the end of a program their
    /// watchdog may report an AL error before the master takes them there.
    pub fn wait_for_preop(&mut self) -> Result<(), Stop> {
        let gateways = self.gateway_count();
        self.poll("the gateways are in PREOP", SLAVE_LIMIT, |bench| {
            let Some(slave) = &mut bench.slave else { return Ok(Some(())) };
            Ok((0..gateways).all(|gateway| slave.is_in_preop(gateway)).then_some(()))
        })
    }

    /// Number of AL errors that the simulated gateways on the wire have reported; 0 for others.
    pub fn al_errors(&mut self) -> usize {
        self.slave.as_mut().map_or(0, |slave| slave.count_lines("AL error"))
    }

    /// # Errors
    /// The gateways are lost.
    pub fn check_slave(&mut self) -> Result<(), Stop> {
        let Some(slave) = self.slave.take_if(|slave| !slave.is_running()) else { return Ok(()) };
        let end = self.note(slave.ended()?).end_text();
        Err(Stop::Failed(format!("the simulated gateways have ended unexpectedly: {end}")))
    }
}
