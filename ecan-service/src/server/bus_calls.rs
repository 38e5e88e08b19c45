//! Requests about the EtherCAT bus, on handles of their own. They block.

use ecan_host::{
    Diagnostics, Ecrt, Error, Master, PortKind as HostPortKind, SdoDirection as HostDirection,
    SlaveAccess, SlaveInfo,
};
use serde_json::Value;

use super::config::result_value;
use crate::protocol::{
    AssignedParams, AssignedPdo, BusError, BusState, DownloadParams, Empty, Link, LinkParams,
    Method, PdoEntry, PortKind, RawRequest, RpcError, SdoDirection, Slave, SlaveParams, SlavePort,
    Upload, UploadParams, methods,
};

/// A request about the bus, whose parameters are checked.
#[derive(Debug)]
pub(crate) enum BusCall {
    State,
    Link(LinkParams),
    Slaves,
    Slave(SlaveParams),
    Assigned(AssignedParams),
    Upload(UploadParams),
    Download(DownloadParams),
}

impl BusCall {
    /// Reads a request; `None` if the method is another one.
    pub(crate) fn read(request: &RawRequest) -> Option<Result<Self, RpcError>> {
        let without = |call: Self| request.params::<Empty>().map(|_| call);
        Some(match request.method.as_str() {
            methods::ReadBusState::NAME => without(Self::State),
            methods::ReadLink::NAME => request.params().map(Self::Link),
            methods::ReadSlaves::NAME => without(Self::Slaves),
            methods::ReadSlave::NAME => request.params().map(Self::Slave),
            methods::ReadAssigned::NAME => request.params().map(Self::Assigned),
            methods::UploadSdo::NAME => request
                .params()
                .and_then(|params: UploadParams| params.checked_max_bytes().map(|_| params))
                .map(Self::Upload),
            methods::DownloadSdo::NAME => request
                .params()
                .and_then(|params: DownloadParams| params.check().map(|()| params))
                .map(Self::Download),
            _ => return None,
        })
    }

    /// Slave whose mailbox the call needs.
    pub(crate) const fn mailbox(&self) -> Option<u16> {
        match self {
            Self::Upload(params) => Some(params.slave),
            Self::Download(params) => Some(params.slave),
            _ => None,
        }
    }

    /// Bytes of its data and of those that it returns.
    pub(crate) fn bytes(&self) -> usize {
        match self {
            Self::Upload(params) => params.checked_max_bytes().unwrap_or_default(),
            Self::Download(params) => params.data.len(),
            _ => 0,
        }
    }
}

/// Requests about the bus of a master, each with a handle of its own: an idle one would keep IgH's
/// module loaded, and stepped time waits for the threads that have one.
#[derive(Debug)]
pub(crate) struct BusCalls {
    ecrt: Ecrt,
    master_index: u32,
}

impl BusCalls {
    pub(crate) fn new(ecrt: Ecrt, master_index: u32) -> Self {
        Self { ecrt, master_index }
    }

    /// Executes a request.
    pub(crate) fn execute(&self, call: &BusCall) -> Result<Value, RpcError> {
        match *call {
            BusCall::State => self.with(bus_state),
            BusCall::Link(params) => self.with(|bus| link(bus, params)),
            BusCall::Slaves => self.with(slaves),
            BusCall::Slave(params) => {
                self.with(|bus| Ok(slave(SlaveAccess::slave_info(bus, params.slave)?)))
            }
            BusCall::Assigned(params) => self.with(|bus| assigned(bus, params)),
            BusCall::Upload(params) => self.upload(params),
            BusCall::Download(ref params) => self.download(params),
        }
    }

    /// State of the bus.
    pub(crate) fn bus_state(&self) -> Result<BusState, Error> {
        bus_state(&self.master()?)
    }

    fn master(&self) -> Result<Master, Error> {
        Ok(Master::open(&self.ecrt, self.master_index)?)
    }

    fn with<R: serde::Serialize>(
        &self,
        call: impl FnOnce(&Master) -> Result<R, Error>,
    ) -> Result<Value, RpcError> {
        let result = self.master().and_then(|master| call(&master));
        result_value(&result.map_err(|error| rpc_error(&error))?)
    }

    /// Handle that repeats transfers without response. A new one for each transfer, because it fixes the
    /// number of slaves.
    fn repeating(&self) -> Result<Diagnostics, Error> {
        Diagnostics::of_bus(&self.ecrt, self.master_index)
    }

    fn upload(&self, params: UploadParams) -> Result<Value, RpcError> {
        let UploadParams { slave, index, subindex, once, .. } = params;
        let mut data = vec![0; params.checked_max_bytes()?];
        let result = if once {
            self.master()
                .and_then(|bus| SlaveAccess::sdo_upload(&bus, slave, index, subindex, &mut data))
        } else {
            self.repeating()
                .and_then(|bus| bus.sdo_upload(slave.into(), index, subindex, &mut data))
        };
        data.truncate(result.map_err(|error| rpc_error(&error))?);
        result_value(&Upload { data })
    }

    fn download(&self, params: &DownloadParams) -> Result<Value, RpcError> {
        let DownloadParams { slave, index, subindex, ref data, once, complete } = *params;
        let result = if complete {
            self.master()
                .and_then(|bus| SlaveAccess::sdo_download_complete(&bus, slave, index, data))
        } else if once {
            self.master()
                .and_then(|bus| SlaveAccess::sdo_download(&bus, slave, index, subindex, data))
        } else {
            self.repeating().and_then(|bus| bus.sdo_download(slave.into(), index, subindex, data))
        };
        result.map_err(|error| rpc_error(&error))?;
        result_value(&Empty {})
    }
}

fn bus_state(bus: &Master) -> Result<BusState, Error> {
    let (info, state) = (bus.master_info()?, bus.master_state()?);
    Ok(BusState {
        slave_count: info.slave_count,
        slaves_responding: state.slaves_responding,
        al_states: state.al_states,
        link_up: state.link_up,
        main_link_up: info.link_up,
        scan_busy: info.scan_busy,
        app_time_ns: info.app_time_ns,
    })
}

fn link(bus: &Master, params: LinkParams) -> Result<Link, Error> {
    let state = SlaveAccess::link_state(bus, params.device)?;
    Ok(Link {
        slaves_responding: state.slaves_responding,
        al_states: state.al_states,
        link_up: state.link_up,
    })
}

fn slaves(bus: &Master) -> Result<Vec<Slave>, Error> {
    let count = bus.master_state()?.slaves_responding;
    let count = u16::try_from(count).unwrap_or(u16::MAX);
    (0..count).map(|position| Ok(slave(SlaveAccess::slave_info(bus, position)?))).collect()
}

fn slave(info: SlaveInfo) -> Slave {
    Slave {
        position: info.position,
        vendor_id: info.vendor_id,
        product_code: info.product_code,
        revision_number: info.revision_number,
        serial_number: info.serial_number,
        alias: info.alias,
        current_on_ebus_ma: info.current_on_ebus_ma,
        al_state: info.al_state,
        error_flag: info.error_flag,
        sync_count: info.sync_count,
        sdo_count: info.sdo_count,
        name: info.name,
        ports: info.ports.map(|port| SlavePort {
            kind: match port.kind {
                HostPortKind::NotImplemented => PortKind::NotImplemented,
                HostPortKind::NotConfigured => PortKind::NotConfigured,
                HostPortKind::EBus => PortKind::Ebus,
                HostPortKind::Mii => PortKind::Mii,
            },
            link_up: port.link_up,
            loop_closed: port.loop_closed,
            signal_detected: port.signal_detected,
            receive_time_ns: port.receive_time_ns,
            next_slave: port.next_slave,
            delay_to_next_dc_ns: port.delay_to_next_dc_ns,
        }),
    }
}

fn assigned(bus: &Master, params: AssignedParams) -> Result<Vec<AssignedPdo>, Error> {
    let found = SlaveAccess::assigned_pdos(bus, params.slave, params.sync)?;
    let entry = |entry: &ecan_host::PdoEntry| PdoEntry {
        index: entry.index,
        subindex: entry.subindex,
        bits: entry.bits,
    };
    let pdo = |pdo: &ecan_host::AssignedPdo| AssignedPdo {
        index: pdo.index,
        entries: pdo.entries.iter().map(entry).collect(),
    };
    Ok(found.iter().map(pdo).collect())
}

/// The error of a client's request, with the fields from which the client restores the error.
pub(crate) fn rpc_error(error: &Error) -> RpcError {
    let fields = match *error {
        Error::Sdo { slave, direction, index, subindex, errno, abort_code, attempts } => {
            BusError::Sdo {
                slave: slave as u32,
                direction: match direction {
                    HostDirection::Upload => SdoDirection::Upload,
                    HostDirection::Download => SdoDirection::Download,
                },
                index,
                subindex,
                errno: errno.code(),
                abort_code: abort_code.map(|code| code.0),
                attempts,
            }
        }
        Error::NoSuchSlave { slave, alias, position, responding, is_scanning } => {
            BusError::NoSuchSlave { slave: slave as u32, alias, position, responding, is_scanning }
        }
        Error::SlaveIndex { slave, count } => {
            BusError::SlaveIndex { slave: slave as u32, count: count as u32 }
        }
        Error::Library { call, slave, errno } => BusError::Library {
            call: call.into(),
            slave: slave.map(|slave| slave as u32),
            errno: errno.code(),
        },
        _ => BusError::Other,
    };
    RpcError::bus(error.to_string(), &fields)
}
