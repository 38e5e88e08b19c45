//! Arguments of `ecan serve`, and the access of its clients.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use ecan_lite::config::ServiceSettings;
use ecan_service::server::{Control, MetricsAddress, MetricsConfig};
use ecan_tool_support::command_line::options::seconds;

use crate::frames::GatewayOptions;

const MAX_CLIENTS: u16 = 64;

/// Options of the gateways and of the thread of the cycle.
const OF_THE_CYCLE: [&str; 14] = [
    "config",
    "bitrate",
    "data_bitrate",
    "sample_point",
    "data_sample_point",
    "pdo_n",
    "large_pdos",
    "cycle_us",
    "rt_priority",
    "cpu",
    "lock_memory",
    "rt_required",
    "cpu_latency_us",
    "spin_us",
];

#[derive(Debug, Args)]
pub struct ServeArguments {
    /// Socket for clients [default: master<N>.sock in $RUNTIME_DIRECTORY, otherwise in /run/ecan for
    /// root and in $XDG_RUNTIME_DIR/ecan for other users]
    #[arg(long, value_name = "PATH")]
    pub socket: Option<PathBuf>,
    /// Group of the socket [default: of this process]
    #[arg(long, value_name = "GROUP")]
    pub group: Option<String>,
    #[command(flatten)]
    pub access: Access,
    /// Metrics for Prometheus at a loopback address or Unix socket, for example 127.0.0.1:9464 or
    /// unix:PATH
    #[arg(long, value_name = "ADDRESS")]
    metrics: Option<MetricsAddress>,
    /// Permit an address of --metrics that other hosts reach
    #[arg(long, requires = "metrics")]
    metrics_remote: bool,
    /// Read error counters of the gateways (0x9000, 0x9020) for --metrics in this interval, 1s to 3600s
    /// [default: not read]
    #[arg(long, value_name = "TIME", requires = "metrics", value_parser = seconds::<u64>(1..=3600))]
    metrics_objects: Option<u64>,
    /// Run no cycle; serve the state of the bus and SDO transfers only
    #[arg(long, conflicts_with_all = OF_THE_CYCLE)]
    pub idle: bool,
    #[command(flatten)]
    pub options: GatewayOptions,
}

impl ServeArguments {
    pub fn metrics(&self) -> Option<MetricsConfig> {
        let address = self.metrics.clone()?;
        Some(MetricsConfig {
            allows_remote: self.metrics_remote,
            object_interval: self.metrics_objects.map(Duration::from_secs),
            ..MetricsConfig::new(address)
        })
    }
}

/// Access of the clients; what is not given comes from the table `[service]` of the file.
#[derive(Clone, Debug, Args)]
pub struct Access {
    /// Reject requests that send frames or change something
    #[arg(long)]
    read_only: bool,
    /// Permit control to the members of a group [default: to this user and root]
    #[arg(long, value_name = "GROUP", conflicts_with = "read_only")]
    control_group: Option<String>,
    /// Maximum number of clients [default: 64]
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u16).range(1..=1000))]
    max_clients: Option<u16>,
}

impl Access {
    /// Control and limit of clients, with the settings of a file.
    pub fn with(&self, file: &ServiceSettings) -> (Control, u16) {
        let own = (self.read_only, &self.control_group);
        let of_file = (file.read_only == Some(true), &file.control_group);
        let control = match (own, of_file) {
            ((true, _), _) => Control::Nobody,
            ((_, Some(group)), _) => Control::Group(group.clone()),
            (_, (true, _)) => Control::Nobody,
            (_, (_, Some(group))) => Control::Group(group.clone()),
            _ => Control::Owner,
        };
        (control, self.max_clients.or(file.max_clients).unwrap_or(MAX_CLIENTS))
    }
}

pub fn access_text(control: &Control) -> String {
    match control {
        Control::Nobody => "read-only".to_owned(),
        Control::Group(group) => format!("control for group {group}"),
        _ => "control for this user".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_override_the_table_of_the_file() {
        let access = |read_only, group: Option<&str>, max_clients| Access {
            read_only,
            control_group: group.map(str::to_owned),
            max_clients,
        };
        let none = ServiceSettings::default();
        let group = ServiceSettings {
            control_group: Some("file".to_owned()),
            max_clients: Some(3),
            ..none.clone()
        };
        let read_only = ServiceSettings { read_only: Some(true), ..none.clone() };
        let of = |name: &str| Control::Group(name.to_owned());
        let cases = [
            (access(false, None, None), &none, Control::Owner, MAX_CLIENTS),
            (access(false, None, None), &group, of("file"), 3),
            (access(false, Some("own"), Some(9)), &group, of("own"), 9),
            (access(true, None, None), &group, Control::Nobody, 3),
            (access(false, None, None), &read_only, Control::Nobody, MAX_CLIENTS),
            (access(false, Some("own"), None), &read_only, of("own"), MAX_CLIENTS),
        ];
        for (access, file, control, max_clients) in cases {
            assert_eq!(access.with(file), (control, max_clients), "{access:?} {file:?}");
        }
    }
}
