//! SIGHUP: reads the configuration file again and applies what gateways in OP permit.

use std::path::PathBuf;
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex, PoisonError, Weak};

use ecan_lite::config::ServiceSettings;
use ecan_mcan_port::Config;
use ecan_protocol::text::Printable;
use ecan_service::server::{Control, Service};

use crate::config_changes::{Change, changes};
use crate::config_file;
use crate::context::{Failure, GlobalOptions, Result, note};
use crate::frames::{GatewayRequirements, of_file_offline};

use super::arguments::{Access, access_text};
use super::command::Command;

/// Configuration of the gateways now; `None` before the first one.
pub type ActiveConfig = Arc<Mutex<Option<Config>>>;

/// Settings that concern the host only, with the names of [`changes`].
const LIMITS: [&str; 3] = [".paced", ".hold_limit", ".input_limit"];

pub struct Reloader {
    pub path: Option<PathBuf>,
    pub global: GlobalOptions,
    pub access: Access,
    pub last_access: (Control, u16),
    pub active: ActiveConfig,
    pub service: Weak<Service>,
    pub commands: Sender<Command>,
}

impl Reloader {
    /// Prints what it has applied and what needs another step. A faulty file changes nothing.
    pub fn reload(&mut self) -> Result {
        let Some(service) = self.service.upgrade() else { return Ok(()) };
        let Some(path) = self.path.clone() else {
            self.set_access(&service, &ServiceSettings::default())?;
            note("reload: no --config; the users of the control group were read again");
            return Ok(());
        };
        let file = config_file::read(&path)?;
        let settings = config_file::service(&path)?;
        let planned =
            of_file_offline(&path, &file, GatewayRequirements::of_service(), &self.global)?;
        self.set_access(&service, &settings)?;
        let name = Printable(path.display());
        let Some((limits, others)) = self.apply(&(planned.adapter, planned.config).into()) else {
            note(format_args!("reload {name}: read; no gateway has started yet"));
            return Ok(());
        };
        for change in &others {
            let action = match change.setting.as_str() {
                "master_index" => "needs a restart of the service".to_owned(),
                _ => format!("needs `ecan config apply {name}`, for which the gateways leave OP"),
            };
            note(format_args!("reload {name}: {change}: {action}"));
        }
        for change in &limits {
            note(format_args!("reload {name}: {change}: active now"));
        }
        if others.is_empty() && limits.is_empty() {
            note(format_args!("reload {name}: no setting of the gateways differs"));
        }
        Ok(())
    }

    /// Applies the limits; returns their changes and the others, `None` before the first start.
    fn apply(&self, new: &Config) -> Option<(Vec<Change>, Vec<Change>)> {
        let mut active = self.active.lock().unwrap_or_else(PoisonError::into_inner);
        let active = active.as_mut()?;
        // Gateways are compared by their index.
        let is_same_bus = active.adapter.slaves.len() == new.adapter.slaves.len();
        let is_limit = |setting: &str| LIMITS.iter().any(|end| setting.ends_with(end));
        let (limits, others): (Vec<_>, Vec<_>) =
            changes(active, new).into_iter().partition(|it| is_same_bus && is_limit(&it.setting));
        if !limits.is_empty() {
            let gateways = active.port.gateways.iter_mut().zip(&new.port.gateways);
            gateways.for_each(|(active, new)| active.set_limits(new));
            // The thread of the cycle ends after this one.
            let _ = self.commands.send(Command::Limits(Box::new(new.port)));
        }
        Some((limits, others))
    }

    /// Sets the access, also if it is the same: users may have joined or left the group.
    fn set_access(&mut self, service: &Service, settings: &ServiceSettings) -> Result {
        let access = self.access.with(settings);
        let (control, max_clients) = access.clone();
        service.set_control(control).map_err(|error| Failure::Host(error.to_string()))?;
        service.set_max_clients(max_clients.into());
        if self.last_access != access {
            let control = access_text(&access.0);
            note(format_args!("reload: {control}, at most {max_clients} clients: active now"));
            self.last_access = access;
        }
        Ok(())
    }
}
