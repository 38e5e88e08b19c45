//! Access to the slaves through the service of a program that holds the master.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ecan_host::{
    AssignedPdo, Clock, Errno, Error, LinkState, MasterInfo, MasterState, MonotonicClock, PdoEntry,
    PortInfo, PortKind, SdoDirection, SlaveAccess, SlaveInfo,
};
use ecan_protocol::object::AbortCode;
use ecan_protocol::text::Printable;
use ecan_service::client::{Client, ClientError};
use ecan_service::protocol::{
    Access, BusError, DownloadParams, Hello, NOT_PERMITTED, PortKind as KindOfPort,
    SdoDirection as DirectionOfSdo, Slave, SlavePort, UploadParams,
};

/// A service that responds. Clones use the same connection.
#[derive(Clone, Debug)]
pub struct ServiceConnection {
    client: Arc<Client>,
    path: PathBuf,
}

impl ServiceConnection {
    pub fn new(client: Client, path: &Path) -> Self {
        Self { client: Arc::new(client), path: path.to_owned() }
    }

    pub fn hello(&self) -> &Hello {
        self.client.hello()
    }

    pub fn client(&self) -> &Client {
        &self.client
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Name, version and process.
    pub fn program(&self) -> String {
        let Hello { server, server_version, pid, .. } = self.hello();
        format!("{} {} (pid {pid})", Printable(server), Printable(server_version))
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
            let reason = format!("{}: {error}", Printable(self.path.display()));
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
        let Hello { master, access, .. } = self.hello();
        let access = match access {
            Access::Read => "read-only",
            Access::Control => "control",
        };
        let (path, program) = (Printable(self.path.display()), self.program());
        write!(f, "via {path}: {program}, master {master}, {access}")
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
