//! Access to the slaves through the service of a program that holds the master.

use std::fmt;
#[cfg(feature = "zenoh")]
use std::path::Path;
use std::path::PathBuf;
use std::sync::Arc;

#[cfg(feature = "zenoh")]
use crate::failure::{Failure, Result};
use ecan_host::{
    AssignedPdo, Clock, Errno, Error, LinkState, MasterInfo, MasterState, MonotonicClock, PdoEntry,
    PortInfo, PortKind, SdoDirection, SlaveAccess, SlaveInfo,
};
use ecan_mcan_port::{GatewayCondition, PendingStep, SessionState as PortSession, SlaveStatistics};
use ecan_protocol::image::ChannelStatus;
use ecan_protocol::object::AbortCode;
use ecan_protocol::text::Printable;
use ecan_service::client::{Client, ClientError};
use ecan_service::protocol::{
    Access, BusError, DownloadParams, GatewayState, Hello, NOT_PERMITTED, PortKind as KindOfPort,
    SdoDirection as DirectionOfSdo, SessionState, Slave, SlavePort, UploadParams,
};
#[cfg(feature = "zenoh")]
use ecan_service_zenoh::{Keys, PublicationError, RemoteService};

/// Where a service is.
#[derive(Clone, Debug)]
pub enum ServiceAddress {
    Socket(PathBuf),
    /// On another host, with the prefix of its keys.
    #[cfg(feature = "zenoh")]
    Remote(Arc<RemoteService>, String),
}

impl ServiceAddress {
    pub fn connect(&self, name: &str) -> Result<Client, ClientError> {
        match self {
            Self::Socket(path) => Client::connect(path, name),
            #[cfg(feature = "zenoh")]
            Self::Remote(service, _) => service.connect(name),
        }
    }
}

impl fmt::Display for ServiceAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Socket(path) => Printable(path.display()).fmt(f),
            #[cfg(feature = "zenoh")]
            Self::Remote(_, prefix) => write!(f, "zenoh:{prefix}"),
        }
    }
}

/// Variable with the configuration of Zenoh for `--via zenoh:PREFIX`, as of other programs with Zenoh.
#[cfg(feature = "zenoh")]
const CONFIG_VARIABLE: &str = "ZENOH_CONFIG";
/// Variable with the name by which publishers know this program.
#[cfg(feature = "zenoh")]
const CLIENT_VARIABLE: &str = "ECAN_CLIENT";

/// A published service of another host.
#[cfg(feature = "zenoh")]
pub fn remote_service(keys: &Keys) -> Result<ServiceAddress> {
    let file = std::env::var_os(CONFIG_VARIABLE).filter(|file| !file.is_empty());
    let client = match std::env::var(CLIENT_VARIABLE) {
        Ok(name) => name,
        Err(_) => client_of(host_name().trim()),
    };
    let opened = RemoteService::open(file.as_ref().map(Path::new), keys.clone(), &client);
    let service = opened.map_err(|error| match error {
        PublicationError::ClientName { .. } => {
            Failure::Usage(format!("{CLIENT_VARIABLE}=\"{}\": {error}", Printable(&client)))
        }
        PublicationError::Open { .. } if file.is_none() => Failure::Publication(format!(
            "{error}; {CONFIG_VARIABLE} names no configuration, so that the router of this host is used"
        )),
        error => Failure::Publication(error.to_string()),
    })?;
    Ok(ServiceAddress::Remote(Arc::new(service), keys.prefix().to_owned()))
}

/// Name of this program for a publisher: programs of one host share their turn.
#[cfg(feature = "zenoh")]
fn client_of(host: &str) -> String {
    let is_allowed =
        |character: &char| character.is_ascii_alphanumeric() || "-_.@".contains(*character);
    format!("ecan@{}", host.chars().filter(is_allowed).take(50).collect::<String>())
}

/// Name of this host; empty if it is not available.
#[cfg(feature = "zenoh")]
pub fn host_name() -> String {
    std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default()
}

/// A service that responds. Clones use the same connection.
#[derive(Clone, Debug)]
pub struct ServiceConnection {
    client: Arc<Client>,
    address: ServiceAddress,
}

impl ServiceConnection {
    pub fn new(client: Client, address: ServiceAddress) -> Self {
        Self { client: Arc::new(client), address }
    }

    pub fn hello(&self) -> &Hello {
        self.client.hello()
    }

    pub fn client(&self) -> &Client {
        &self.client
    }

    pub fn address(&self) -> &ServiceAddress {
        &self.address
    }

    /// Name, version and process.
    pub fn program(&self) -> String {
        program(self.hello())
    }

    /// Reason why this client may only read.
    pub fn read_only_reason(&self) -> &str {
        self.hello().access_reason.as_deref().unwrap_or("it is read-only")
    }

    fn failure_of(&self, call: &'static str) -> impl FnOnce(ClientError) -> Error {
        move |error| self.error(call, &error)
    }

    pub fn error(&self, call: &'static str, error: &ClientError) -> Error {
        let Some(rpc) = error.rpc() else {
            let reason = format!("{}: {error}", self.address);
            return Error::Disconnected { reason };
        };
        let index = |slave| usize::try_from(slave).unwrap_or(usize::MAX);
        match rpc.bus_error() {
            Some(BusError::Sdo {
                slave,
                direction,
                index: object,
                subindex,
                errno,
                abort_code,
                attempts,
            }) => Error::Sdo {
                slave: index(slave),
                direction: match direction {
                    DirectionOfSdo::Upload => SdoDirection::Upload,
                    DirectionOfSdo::Download => SdoDirection::Download,
                },
                index: object,
                subindex,
                errno: Errno::new(errno),
                abort_code: abort_code.map(AbortCode),
                attempts,
            },
            Some(BusError::NoSuchSlave { slave, alias, position, responding, is_scanning }) => {
                Error::NoSuchSlave { slave: index(slave), alias, position, responding, is_scanning }
            }
            Some(BusError::SlaveIndex { slave, count }) => {
                Error::SlaveIndex { slave: index(slave), count: index(count) }
            }
            Some(BusError::Library { slave, errno, .. }) => {
                Error::Library { call, slave: slave.map(index), errno: Errno::new(errno) }
            }
            Some(BusError::Other) | None => {
                let reason = format!("{}: {rpc}", self.program());
                match rpc.code {
                    NOT_PERMITTED => Error::NotPermitted { reason },
                    _ => Error::Disconnected { reason },
                }
            }
        }
    }

    fn download(&self, params: &DownloadParams) -> Result<(), Error> {
        self.client.sdo_download(params).map_err(self.failure_of("ecrt_master_sdo_download"))
    }
}

impl fmt::Display for ServiceConnection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Hello { master, access, is_simulated, .. } = self.hello();
        let access = match access {
            Access::Read => "read-only",
            Access::Control => "control",
        };
        let (address, program) = (&self.address, self.program());
        let simulated = if *is_simulated { ", SIMULATED" } else { "" };
        write!(f, "via {address}: {program}, master {master}, {access}{simulated}")
    }
}

/// Name, version and process of a service.
pub fn program(hello: &Hello) -> String {
    let Hello { server, server_version, pid, .. } = hello;
    format!("{} {} (pid {pid})", Printable(server), Printable(server_version))
}

/// Counters of a gateway; `None` if those of another version cannot be read.
pub fn statistics(state: &GatewayState) -> Option<SlaveStatistics> {
    serde_json::from_value(serde_json::Value::Object(state.statistics.clone())).ok()
}

/// A gateway in the state of a service, which does not have the fault of a failed verification.
pub fn condition(state: &GatewayState) -> GatewayCondition {
    GatewayCondition {
        session: match state.session {
            SessionState::Waiting => PortSession::Waiting,
            SessionState::Verifying => PortSession::Verifying,
            SessionState::Ready => PortSession::Ready,
            SessionState::Failed => PortSession::Failed,
        },
        fault: None,
        waiting_for: PendingStep::decode(state.waiting_code),
        channels: state.channel_status.map(|status| status.map(ChannelStatus::from_raw)),
        statistics: statistics(state).unwrap_or_default(),
    }
}

impl SlaveAccess for ServiceConnection {
    fn clock(&self) -> &dyn Clock {
        &MonotonicClock
    }

    fn master_info(&self) -> Result<MasterInfo, Error> {
        let state = self.client.bus_state().map_err(self.failure_of("ecrt_master"))?;
        Ok(MasterInfo {
            slave_count: state.slave_count,
            link_up: state.main_link_up,
            scan_busy: state.scan_busy,
            app_time_ns: state.app_time_ns,
        })
    }

    fn master_state(&self) -> Result<MasterState, Error> {
        let state = self.client.bus_state().map_err(self.failure_of("ecrt_master_state"))?;
        Ok(MasterState {
            slaves_responding: state.slaves_responding,
            al_states: state.al_states,
            link_up: state.link_up,
        })
    }

    fn link_state(&self, device: u32) -> Result<LinkState, Error> {
        let link = self.client.link(device).map_err(self.failure_of("ecrt_master_link_state"))?;
        Ok(LinkState {
            slaves_responding: link.slaves_responding,
            al_states: link.al_states,
            link_up: link.link_up,
        })
    }

    fn slave_info(&self, position: u16) -> Result<SlaveInfo, Error> {
        let slave = self.client.slave(position);
        slave.map(slave_info).map_err(self.failure_of("ecrt_master_get_slave"))
    }

    fn assigned_pdos(&self, position: u16, sync: u8) -> Result<Vec<AssignedPdo>, Error> {
        let assigned = self.client.assigned_pdos(position, sync);
        let assigned = assigned.map_err(self.failure_of("ecrt_master_get_sync_manager"))?;
        let pdos = assigned.into_iter().map(|pdo| AssignedPdo {
            index: pdo.index,
            entries: pdo
                .entries
                .into_iter()
                .map(|entry| PdoEntry {
                    index: entry.index,
                    subindex: entry.subindex,
                    bits: entry.bits,
                })
                .collect(),
        });
        Ok(pdos.collect())
    }

    fn sdo_upload(
        &self,
        position: u16,
        index: u16,
        subindex: u8,
        data: &mut [u8],
    ) -> Result<usize, Error> {
        let params = UploadParams {
            slave: position,
            index,
            subindex,
            max_bytes: u32::try_from(data.len()).ok(),
            once: true,
        };
        let call = "ecrt_master_sdo_upload";
        let read = self.client.sdo_upload(&params).map_err(self.failure_of(call))?;
        data.fill(0);
        match data.get_mut(..read.len()) {
            Some(part) => part.copy_from_slice(&read),
            None => {
                let slave = Some(usize::from(position));
                return Err(Error::Library { call, slave, errno: Errno::EOVERFLOW });
            }
        }
        Ok(read.len())
    }

    fn sdo_download(
        &self,
        position: u16,
        index: u16,
        subindex: u8,
        data: &[u8],
    ) -> Result<(), Error> {
        let (slave, data) = (position, data.to_vec());
        self.download(&DownloadParams { slave, index, subindex, data, once: true, complete: false })
    }

    fn sdo_download_complete(&self, position: u16, index: u16, data: &[u8]) -> Result<(), Error> {
        let (slave, data) = (position, data.to_vec());
        self.download(&DownloadParams {
            slave,
            index,
            subindex: 0,
            data,
            once: true,
            complete: true,
        })
    }
}

fn slave_info(slave: Slave) -> SlaveInfo {
    SlaveInfo {
        position: slave.position,
        vendor_id: slave.vendor_id,
        product_code: slave.product_code,
        revision_number: slave.revision_number,
        serial_number: slave.serial_number,
        alias: slave.alias,
        current_on_ebus_ma: slave.current_on_ebus_ma,
        al_state: slave.al_state,
        error_flag: slave.error_flag,
        sync_count: slave.sync_count,
        sdo_count: slave.sdo_count,
        name: slave.name,
        ports: slave.ports.map(port_info),
    }
}

fn port_info(port: SlavePort) -> PortInfo {
    PortInfo {
        kind: match port.kind {
            KindOfPort::NotImplemented => PortKind::NotImplemented,
            KindOfPort::NotConfigured => PortKind::NotConfigured,
            KindOfPort::Ebus => PortKind::EBus,
            KindOfPort::Mii => PortKind::Mii,
        },
        link_up: port.link_up,
        loop_closed: port.loop_closed,
        signal_detected: port.signal_detected,
        receive_time_ns: port.receive_time_ns,
        next_slave: port.next_slave,
        delay_to_next_dc_ns: port.delay_to_next_dc_ns,
    }
}
