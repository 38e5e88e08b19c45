//! The object that the contexts of one master name: the Adapter, a Port on it, axes on the Port.

use ecan_c_boundary::Call;
use ecan_c_boundary::result::ecan_result_t;
use ecan_canopen::NodeConfig;
use ecan_cia402::{Cia402, Cia402Error, SendSummary};
use ecan_host::{Adapter, SdoRequestId};
use ecan_mcan_port::{BusChange, BusWatch, Cycle, Port, PortConfig, SendTicket};
use ecan_service::server::Service;

use crate::callback::ProgressCallback;
use crate::handle::{self, Entered, Kind, Pool, Pooled, Words};
use crate::{callback, errors};

#[derive(Debug)]
pub(crate) enum Layer {
    Adapter(Box<Adapter>),
    Port(Box<Port>),
    /// The Adapter is being moved between layers.
    Between,
}

#[derive(Debug)]
pub(crate) struct Bus {
    /// Ends before the Port.
    pub(crate) service: Option<Service>,
    layer: Layer,
    /// Number of all Ports and axes so far, so that an old context names none.
    contexts: u64,
    port_serial: u64,
    /// Addresses of the contexts of the Port and of the axes.
    port_address: usize,
    axes_address: usize,
    axes: Option<Axes>,
    pub(crate) requests: Vec<Request>,
    pub(crate) last_ticket: Option<LastTicket>,
    /// Configuration of the gateways' startup SDOs.
    pub(crate) applied: Option<PortConfig>,
    /// Simulated time passes only while the program waits.
    pub(crate) is_stepped: bool,
    /// Of igh_mcan_port_next_change().
    watch: Option<BusWatch>,
    /// Of which only the length was asked.
    kept_change: Option<BusChange>,
}

/// The axes on a Port, with the state of their C context.
#[derive(Debug)]
pub(crate) struct Axes {
    serial: u64,
    cia402: Box<Cia402>,
    /// Of the last sent targets.
    pub(crate) summary: SendSummary,
    pub(crate) progress: Option<ProgressCallback>,
    pub(crate) boot_progress: Option<ProgressCallback>,
    /// Configuration of nodes that are added.
    pub(crate) node: NodeConfig,
}

/// Ticket of the last frame.
///
/// Its fields are wide: narrow ones would be copied as one word, which waits for the stores of its
/// parts in every send.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LastTicket {
    pub(crate) slave: u32,
    pub(crate) sequence: u32,
    pub(crate) index: u32,
}

impl From<SendTicket> for LastTicket {
    #[inline]
    fn from(ticket: SendTicket) -> Self {
        Self {
            slave: ticket.slave as u32,
            sequence: ticket.sequence.into(),
            index: ticket.index.into(),
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Request {
    pub(crate) id: SdoRequestId,
    pub(crate) size: usize,
}

static POOL: Pool<Bus> = Pool::new();

impl Pooled for Bus {
    fn pool() -> &'static Pool<Self> {
        &POOL
    }

    #[inline]
    fn has_open_cycle(&self) -> bool {
        matches!(&self.layer, Layer::Port(port) if port.has_open_cycle())
    }
}

impl Bus {
    pub(crate) fn new(adapter: Adapter, applied: Option<PortConfig>, is_stepped: bool) -> Self {
        Self {
            service: None,
            layer: Layer::Adapter(Box::new(adapter)),
            contexts: 0,
            port_serial: 0,
            port_address: 0,
            axes_address: 0,
            axes: None,
            requests: Vec::new(),
            last_ticket: None,
            applied,
            is_stepped,
            watch: None,
            kept_change: None,
        }
    }

    /// The Adapter, alone or below a Port.
    pub(crate) fn adapter(&self) -> Option<&Adapter> {
        match &self.layer {
            Layer::Adapter(adapter) => Some(adapter),
            Layer::Port(port) => Some(port.adapter()),
            Layer::Between => None,
        }
    }

    /// The next change of the gateways; `is_kept` leaves it for the next call.
    pub(crate) fn next_change(&mut self, is_kept: bool) -> Option<BusChange> {
        let (Layer::Port(port), Some(watch)) = (&self.layer, &mut self.watch) else { return None };
        let change = self.kept_change.take().or_else(|| watch.changes(port).next());
        self.kept_change = change.filter(|_| is_kept);
        change
    }

    /// Changes of the gateways count from now on.
    pub(crate) fn watch_port(&mut self) {
        self.kept_change = None;
        self.watch =
            if let Layer::Port(port) = &self.layer { Some(BusWatch::new(port)) } else { None };
    }

    pub(crate) fn adapter_mut(&mut self) -> Option<&mut Adapter> {
        match &mut self.layer {
            Layer::Adapter(adapter) => Some(adapter),
            Layer::Port(port) => Some(port.adapter_mut()),
            Layer::Between => None,
        }
    }

    #[inline]
    pub(crate) fn port_mut(&mut self) -> Option<&mut Port> {
        if let Layer::Port(port) = &mut self.layer { Some(port) } else { None }
    }

    /// Opens a Port on the Adapter. An error does not change the Adapter.
    pub(crate) fn add_port(
        &mut self,
        call: Call,
        make: impl FnOnce(Adapter) -> Result<Port, (ecan_result_t, Box<Adapter>)>,
    ) -> Result<u64, ecan_result_t> {
        match std::mem::replace(&mut self.layer, Layer::Between) {
            Layer::Adapter(adapter) => match make(*adapter) {
                Ok(port) => {
                    self.watch = Some(BusWatch::new(&port));
                    self.layer = Layer::Port(Box::new(port));
                    self.contexts += 1;
                    self.port_serial = self.contexts;
                    Ok(self.contexts)
                }
                Err((code, adapter)) => {
                    self.layer = Layer::Adapter(adapter);
                    Err(code)
                }
            },
            other => {
                self.layer = other;
                Err(handle::not_initialised(call, Kind::Adapter))
            }
        }
    }

    /// Requires that there is no Port. One whose context was overwritten ends.
    ///
    /// # Safety
    /// `context` is valid for reading, with any content.
    pub(crate) unsafe fn need_no_port(
        &mut self,
        call: Call,
        context: *const Words,
    ) -> Result<(), ecan_result_t> {
        if !matches!(self.layer, Layer::Port(_)) {
            return Ok(());
        }
        let named = || {
            // SAFETY: the caller's promise. Only memory that was a context is read.
            unsafe { handle::serial::<Self>(context, Kind::Port) }
        };
        if context.addr() == self.port_address && named() != Some(self.port_serial) {
            self.remove_port();
            return Ok(());
        }
        let text = format_args!("there is a Port on this master already: deinit it first");
        Err(call.fail(ecan_result_t::ECAN_ERR_ORDER, text))
    }

    /// Requires that there are no axes. Axes whose context was overwritten end.
    ///
    /// # Safety
    /// `context` is valid for reading, with any content.
    pub(crate) unsafe fn need_no_axes(
        &mut self,
        call: Call,
        context: *const Words,
    ) -> Result<(), ecan_result_t> {
        let Some(axes) = &self.axes else { return Ok(()) };
        let named = || {
            // SAFETY: the caller's promise. Only memory that was a context is read.
            unsafe { handle::serial::<Self>(context, Kind::Cia402) }
        };
        if context.addr() == self.axes_address && named() != Some(axes.serial) {
            self.remove_cia402();
            return Ok(());
        }
        let text = format_args!("there are axes on this Port already: deinit them first");
        Err(call.fail(ecan_result_t::ECAN_ERR_ORDER, text))
    }

    pub(crate) fn remove_port(&mut self) {
        self.service = None;
        self.axes = None;
        self.last_ticket = None;
        (self.watch, self.kept_change) = (None, None);
        self.port_serial = 0;
        self.layer = match std::mem::replace(&mut self.layer, Layer::Between) {
            Layer::Port(port) => Layer::Adapter(Box::new(port.into_adapter())),
            other => other,
        };
    }

    pub(crate) fn add_cia402(
        &mut self,
        call: Call,
        node: NodeConfig,
        make: impl FnOnce(&Port) -> Result<Cia402, ecan_result_t>,
    ) -> Result<u64, ecan_result_t> {
        let Layer::Port(port) = &self.layer else {
            return Err(handle::not_initialised(call, Kind::Port));
        };
        let cia402 = make(port)?;
        self.contexts += 1;
        self.axes = Some(Axes {
            serial: self.contexts,
            cia402: Box::new(cia402),
            summary: SendSummary::default(),
            progress: None,
            boot_progress: None,
            node,
        });
        Ok(self.contexts)
    }

    /// Drops what a reconfiguration ends: axes, requests, and the applied configuration.
    pub(crate) fn forget_configuration(&mut self) {
        if let (Some(service), Layer::Port(port)) = (&self.service, &mut self.layer) {
            service.attach(port);
        }
        self.remove_cia402();
        self.requests.clear();
        (self.last_ticket, self.applied) = (None, None);
    }

    /// Stops axes that may move, within their stop time. The error names those that may still move, which a
    /// line on standard error does, too: few programs check the result of a deinit.
    pub(crate) fn stop_axes(&mut self) -> Result<(), Cia402Error> {
        let (Some(axes), Layer::Port(port)) = (&mut self.axes, &mut self.layer) else {
            return Ok(());
        };
        axes.cia402.stop_before_end(port).inspect_err(|error| {
            callback::write_line(&format!("ecan: {error}"));
        })
    }

    /// Closes the axes without sending anything.
    pub(crate) fn remove_cia402(&mut self) {
        self.axes = None;
    }

    pub(crate) fn axes_mut(&mut self) -> Option<&mut Axes> {
        self.axes.as_mut()
    }
}

impl Entered<Bus> {
    /// Writes the context of the Port.
    ///
    /// # Safety
    /// `context` is valid for writing.
    pub(crate) unsafe fn add_port_context(&mut self, context: *mut Words, serial: u64) {
        self.port_address = context.addr();
        // SAFETY: the caller's promise.
        unsafe { self.add_context(context, Kind::Port, serial) };
    }

    /// Writes the context of the axes.
    ///
    /// # Safety
    /// `context` is valid for writing.
    pub(crate) unsafe fn add_axes_context(&mut self, context: *mut Words, serial: u64) {
        self.axes_address = context.addr();
        // SAFETY: the caller's promise.
        unsafe { self.add_context(context, Kind::Cia402, serial) };
    }

    /// Returns true if it was entered through the context of the Port.
    #[inline]
    pub(crate) fn names_port(&self) -> bool {
        self.port_serial == self.serial
    }

    /// Returns true if it was entered through the context of the axes.
    pub(crate) fn names_axes(&self) -> bool {
        self.axes.as_ref().is_some_and(|axes| axes.serial == self.serial)
    }

    pub(crate) fn need_adapter(&mut self, call: Call) -> Result<&mut Adapter, ecan_result_t> {
        self.adapter_mut().ok_or_else(|| handle::not_initialised(call, Kind::Adapter))
    }

    #[inline]
    pub(crate) fn need_port(&mut self, call: Call) -> Result<&mut Port, ecan_result_t> {
        self.port_mut().ok_or_else(|| handle::not_initialised(call, Kind::Port))
    }

    #[inline]
    pub(crate) fn need_cycle(&mut self, call: Call) -> Result<Cycle<'_>, ecan_result_t> {
        open_cycle(call, self.need_port(call)?)
    }

    pub(crate) fn need_axes(
        &mut self,
        call: Call,
    ) -> Result<(&mut Cia402, &mut Port), ecan_result_t> {
        let bus = &mut **self;
        match (&mut bus.axes, &mut bus.layer) {
            (Some(axes), Layer::Port(port)) => Ok((&mut axes.cia402, port)),
            _ => Err(handle::not_initialised(call, Kind::Cia402)),
        }
    }

    /// Prepares a call that runs the cycle until it ends: rejects it on a master of another owner.
    pub(crate) fn run_to_end(&self, call: Call) -> Result<(), ecan_result_t> {
        match self.adapter() {
            Some(adapter) if adapter.is_attached() => Err(errors::reject_attached(call)),
            // The thread of the cycle waits for this call, instead of losing its cycle to it.
            _ => self.end_cycle(call),
        }
    }

    /// Sleeps until the next deadline; other threads may use the bus during the sleep.
    pub(crate) fn wait_next_cycle(&mut self, call: Call) -> Result<(), ecan_result_t> {
        self.begin_cycle(call)?;
        let wait = match &mut self.layer {
            Layer::Adapter(adapter) => adapter.begin_wait(),
            Layer::Port(port) => port.begin_wait(),
            Layer::Between => return Err(handle::not_initialised(call, Kind::Adapter)),
        };
        let start = self.sleep(|| wait.sleep());
        match &mut self.layer {
            Layer::Adapter(adapter) => adapter.end_wait(start),
            Layer::Port(port) => port.end_wait(start),
            Layer::Between => 0,
        };
        Ok(())
    }
}

#[inline]
pub(crate) fn open_cycle(call: Call, port: &mut Port) -> Result<Cycle<'_>, ecan_result_t> {
    port.open_cycle().ok_or_else(|| {
        let text = format_args!("no cycle is open; call igh_mcan_port_cycle_begin() first");
        call.fail(ecan_result_t::ECAN_ERR_ORDER, text)
    })
}
