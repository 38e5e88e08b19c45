//! The Port with its master: its own, or one of an application that serves an I/O slave, too.

use ecan_host::{Adapter, DomainId, Errno, Master, WcState};
use ecan_mcan_port::{Config, PendingStep, Port};
use ecan_sim::{Backend, IoSpec};

/// Longest time until all gateways of an attached Port are ready.
const READY_NS: u64 = 120_000_000_000;

/// Interval of the requests for another startup.
const RETRY_NS: u64 = 10_000_000_000;

/// A Port, and the owner of its master if it is attached.
pub struct Connection {
    // Before its owner, which must be dropped after it.
    pub port: Port,
    owner: Option<Owner>,
}

/// The application that owns the master.
struct Owner {
    master: Master,
    io: Option<Io>,
}

/// An I/O slave in a domain of the owner.
struct Io {
    domain: DomainId,
    output: usize,
    input: usize,
    value: u8,
    /// It responded in the last cycle.
    is_complete: bool,
}

impl Connection {
    pub fn open(backend: &Backend, config: Config) -> Result<Self, String> {
        let port = Port::open(&backend.ecrt, config).map_err(|error| error.to_string())?;
        Ok(Self { port, owner: None })
    }

    /// The application reserves the master, configures its I/O slave and lets the Port add the gateways.
    pub fn attach(backend: &Backend, config: Config, io: Option<&IoSpec>) -> Result<Self, String> {
        let mut master = Master::request(&backend.ecrt, 0).map_err(|error| error.to_string())?;
        let io = io.map(|io| Io::configure(&mut master, io)).transpose();
        let io = io.map_err(|error| error.to_string())?;
        #[allow(unsafe_code)]
        // SAFETY: a `Connection` drops its Port before its owner, and both are used by one thread only.
        let shared = unsafe { Master::from_raw(backend.ecrt.clone(), master.as_raw()) };
        let shared = shared.map_err(|error| error.to_string())?;
        let Config { adapter, port, .. } = config;
        let cycle_us = (adapter.cycle_ns() / 1_000) as usize;
        let startup = port.startup_plan(&adapter);
        let adapter = Adapter::attach(&backend.ecrt, shared, adapter, startup);
        let adapter = adapter.map_err(|error| error.to_string())?;
        let mut port = Port::new(adapter, port).map_err(|error| error.to_string())?;
        master.set_send_interval(cycle_us).map_err(|error| error.to_string())?;
        master.activate().map_err(|error| error.to_string())?;
        port.adapter_mut().owner_activated().map_err(|error| error.to_string())?;
        Ok(Self { port, owner: Some(Owner { master, io }) })
    }

    /// Waits until all gateways are ready.
    pub fn wait_ready(&mut self) -> Result<(), String> {
        if self.owner.is_none() {
            return self.port.wait_ready().map_err(|error| error.to_string());
        }
        let now_ns = |connection: &Self| connection.port.adapter().clock().now_ns();
        let begin = now_ns(self);
        let mut retry_at = begin;
        while !self.port.is_ready() {
            self.begin();
            let _ = self.port.begin_cycle().finish();
            self.end();
            let now = now_ns(self);
            if now - begin > READY_NS {
                return Err(self.status());
            }
            if self.waits_for_startup() && now > retry_at {
                retry_at = now + RETRY_NS;
                self.retry_startup();
            }
        }
        Ok(())
    }

    /// State of the gateways.
    pub fn status(&self) -> String {
        let states = self.port.gateways().map(|gateway| {
            let waits = self.port.waiting_for(gateway);
            let waits = waits.map_or_else(String::new, |step| format!(" (waits for {step})"));
            let fault = self.port.last_verification_fault(gateway);
            let fault = fault.map_or_else(String::new, |fault| format!(", last fault: {fault}"));
            format!("{}{waits}{fault}", self.port.session(gateway))
        });
        let io = if self.has_io() { "" } else { "; the I/O slave is missing" };
        states.collect::<Vec<_>>().join("; ") + io
    }

    /// Waits for the next cycle, and receives if that is left to the owner.
    pub fn begin(&mut self) {
        self.port.wait_next_cycle();
        let deadline_ns = self.port.adapter().cycle_start().deadline_ns;
        if let Some(owner) = &mut self.owner {
            owner.receive(deadline_ns);
        }
    }

    /// After the end of the Port's cycle: sends if that is left to the owner.
    pub fn end(&mut self) {
        if let Some(owner) = &mut self.owner {
            owner.send();
        }
    }

    /// Returns whether the I/O slave of the owner, if there is one, responds.
    pub fn has_io(&self) -> bool {
        self.owner.as_ref().and_then(|owner| owner.io.as_ref()).is_none_or(|io| io.is_complete)
    }

    /// Requests the startup of all slaves that are not in OP.
    pub fn retry_startup(&mut self) {
        // One that fails is repeated by the caller.
        let _ = match &mut self.owner {
            Some(owner) => owner.master.reset().map_err(|error| error.to_string()),
            None => self.port.retry_startup().map_err(|error| error.to_string()),
        };
    }

    /// Returns whether a gateway waits for another attempt of its startup.
    pub fn waits_for_startup(&self) -> bool {
        let mut gateways = self.port.gateways();
        gateways.any(|gateway| self.port.waiting_for(gateway) == Some(PendingStep::StartupRetry))
    }
}

impl Owner {
    // Errors are those of injected faults: the next cycle tries again, as the Port does.

    fn receive(&mut self, deadline_ns: u64) {
        let _ = self.master.application_time(deadline_ns);
        let _ = self.master.receive();
        if let Some(io) = &mut self.io {
            io.receive(&mut self.master);
        }
    }

    fn send(&mut self) {
        if let Some(io) = &self.io {
            let _ = self.master.domain_queue(io.domain);
        }
        let _ = self.master.sync_reference_clock();
        let _ = self.master.sync_slave_clocks();
        let _ = self.master.send();
    }
}

impl Io {
    fn configure(master: &mut Master, io: &IoSpec) -> Result<Self, Errno> {
        let position = io.position as u16;
        let slave = master.slave_config(0, position, io.vendor_id, io.product_code)?;
        let domain = master.create_domain()?;
        let output = master.config_reg_pdo_entry(slave, 0x7000, 1, domain)?;
        let input = master.config_reg_pdo_entry(slave, 0x6000, 1, domain)?;
        Ok(Self { domain, output, input, value: 0, is_complete: false })
    }

    /// A new output each time the input has shown the last one.
    fn receive(&mut self, master: &mut Master) {
        let processed = master.domain_process(self.domain);
        let state = processed.and_then(|()| master.domain_state(self.domain));
        self.is_complete = state.is_ok_and(|state| state.wc_state == WcState::Complete);
        let data = master.domain_data_mut(self.domain);
        if self.is_complete && data[self.input] == self.value {
            self.value = self.value.wrapping_add(1);
        }
        data[self.output] = self.value;
    }
}
