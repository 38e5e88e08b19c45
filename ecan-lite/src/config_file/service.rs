//! The table `[service]`: access to the service of a bus.

use crate::config_file::document::Table;

/// Settings of a service, by `ecan serve`. `None` for its default.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ServiceSettings {
    /// No client may send frames or change something.
    pub read_only: Option<bool>,
    /// Group whose members may.
    pub control_group: Option<String>,
    /// Most clients at a time.
    pub max_clients: Option<u16>,
}

pub(crate) fn read(mut table: Table<'_, '_>) -> ServiceSettings {
    let read_only = table.flag("read_only");
    let control_group = table.text("control_group").map(str::to_owned);
    if read_only == Some(true) && control_group.is_some() {
        table.fault("control_group", "`control_group` and `read_only` exclude each other");
    }
    ServiceSettings {
        read_only,
        control_group,
        max_clients: table.unsigned("max_clients", (1, 1000)),
    }
}
