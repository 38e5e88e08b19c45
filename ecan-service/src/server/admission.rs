//! Which connections become clients, and the log of those that do not.

use super::client::Client;
use super::service::{Control, ServiceError};
use super::workers::Permission;
use crate::protocol::{Access, NOT_AVAILABLE};
use nix::unistd::{Gid, Group, Uid, User, getgrouplist};
use std::ffi::CString;
use std::fmt;
use std::os::fd::AsFd;

/// Checks of [`SilentClients`] that a client may take for its `hello`: 5 s at 50 ms each.
const MAX_SILENT_CHECKS: u32 = 100;
/// User ID of a client whose user the system does not report.
pub(crate) const UNKNOWN_USER: u32 = u32::MAX;

/// Places of a service. One place is for root and the user of the service, and another user has at most half
/// of the places: no user locks all others out.
#[derive(Debug)]
pub(crate) struct Admission {
    pub(crate) max_clients: usize,
    owner: u32,
    rejected: IncidentLog,
    silent: IncidentLog,
    broken: IncidentLog,
}

impl Admission {
    pub(crate) fn new(max_clients: usize) -> Self {
        Self {
            max_clients,
            owner: Uid::effective().as_raw(),
            rejected: IncidentLog::new("rejected clients"),
            silent: IncidentLog::new("clients without a hello"),
            broken: IncidentLog::new("clients that broke the protocol"),
        }
    }

    /// Checks whether another client has a place; `users` are those of the connected ones.
    pub(crate) fn check(&self, user: u32, users: impl Iterator<Item = u32>) -> Result<(), String> {
        let (mut all, mut own) = (0, 0);
        for other in users {
            all += 1;
            own += usize::from(other == user);
        }
        let max = self.max_clients;
        if all >= max {
            return Err(format!("{all} clients are connected; close one, or raise max_clients"));
        }
        if [0, self.owner].contains(&user) || max < 2 {
            return Ok(());
        }
        if own >= max / 2 {
            return Err(format!(
                "user {} has {own} connections; allowed: {}, half of max_clients; close one, or raise \
                 max_clients",
                user_name(user),
                max / 2
            ));
        }
        if all + 1 >= max {
            return Err(format!(
                "{all} clients are connected, and the last place is for root and user {}; close one, or \
                 raise max_clients",
                user_name(self.owner)
            ));
        }
        Ok(())
    }

    /// Logs a client that has no place.
    pub(crate) fn log_rejection(&mut self, peer: Option<Peer>, reason: &str) {
        let process = peer.map_or(0, |peer| peer.pid);
        self.rejected.report(format_args!("client of process {process} rejected: {reason}"));
    }

    /// Ends the clients that sent no `hello` in time and returns their number. Called in a fixed interval: a
    /// service that was stopped counts one check.
    pub(crate) fn end_silent<'a>(&mut self, clients: impl Iterator<Item = &'a mut Client>) -> u64 {
        let mut ended = 0;
        for client in clients.filter(|client| !client.session.has_hello()) {
            client.silent_checks += 1;
            if client.silent_checks < MAX_SILENT_CHECKS || client.session.is_ended() {
                continue;
            }
            ended += 1;
            let process = client.peer.map_or(0, |peer| peer.pid);
            let text = "no hello within 5 s; send hello first";
            client.session.end(NOT_AVAILABLE, text.into());
            client.session.take_end();
            let number = client.session.id;
            self.silent.report(format_args!("client {number} (process {process}) ended: {text}"));
        }
        ended
    }

    /// Logs clients that broke the protocol.
    pub(crate) fn log_ends<'a>(&mut self, clients: impl Iterator<Item = &'a mut Client>) {
        for session in clients.map(|client| &mut client.session) {
            let (number, name) = (session.id, session.name.clone());
            if let Some(text) = session.take_end() {
                self.broken.report(format_args!("client {number} ({name}) disconnected: {text}"));
            }
        }
    }

    /// Ends the incidents that did not continue. Called once per second.
    pub(crate) fn end_incidents(&mut self) {
        for log in [&mut self.rejected, &mut self.silent, &mut self.broken] {
            log.end_interval();
        }
    }
}

/// Log of an event that another program can repeat at will: its first time, and the number of repetitions
/// once it pauses.
#[derive(Debug)]
struct IncidentLog {
    subject: &'static str,
    is_active: bool,
    is_seen: bool,
    repetitions: u64,
}

impl IncidentLog {
    const fn new(subject: &'static str) -> Self {
        Self { subject, is_active: false, is_seen: false, repetitions: 0 }
    }

    fn report(&mut self, text: fmt::Arguments<'_>) {
        if std::mem::replace(&mut self.is_active, true) {
            self.repetitions += 1;
        } else {
            tracing::warn!("service: {text}");
        }
        self.is_seen = true;
    }

    fn end_interval(&mut self) {
        if std::mem::take(&mut self.is_seen) || !std::mem::take(&mut self.is_active) {
            return;
        }
        let repetitions = std::mem::take(&mut self.repetitions);
        if repetitions > 0 {
            tracing::warn!("service: {}: {repetitions} further ones since the first", self.subject);
        }
    }
}

/// Process and user of a client.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Peer {
    pub(crate) pid: u32,
    pub(crate) uid: u32,
    pub(crate) gid: u32,
}

impl Peer {
    pub(crate) fn of(socket: impl AsFd) -> Option<Self> {
        let credentials = rustix::net::sockopt::socket_peercred(socket).ok()?;
        let pid = credentials.pid.as_raw_nonzero().get();
        Some(Self {
            pid: u32::try_from(pid).ok()?,
            uid: credentials.uid.as_raw(),
            gid: credentials.gid.as_raw(),
        })
    }
}

/// The group with this name.
pub(crate) fn group_id(name: &str) -> Result<u32, ServiceError> {
    let group = Group::from_name(name).ok().flatten();
    group.map(|group| group.gid.as_raw()).ok_or_else(|| ServiceError::NoSuchGroup(name.into()))
}

/// Decides the access of clients.
#[derive(Debug)]
pub(crate) struct AccessRule {
    control: Control,
    group: Option<u32>,
    owner: u32,
}

impl AccessRule {
    pub(crate) fn new(control: Control) -> Result<Self, ServiceError> {
        let group = match &control {
            Control::Group(name) => Some(group_id(name)?),
            _ => None,
        };
        Ok(Self { control, group, owner: Uid::effective().as_raw() })
    }

    pub(crate) fn permission(&self, peer: Option<Peer>) -> Permission {
        let is_owner = peer.is_some_and(|peer| [0, self.owner].contains(&peer.uid));
        let reason = match &self.control {
            Control::Everyone => return control(),
            Control::Nobody => "the service is read-only".into(),
            Control::Owner | Control::Group(_) if is_owner => return control(),
            Control::Owner => {
                format!("control is for user {} and root", user_name(self.owner))
            }
            Control::Group(name) => match peer {
                Some(peer) if self.group.is_some_and(|group| is_member(peer, group)) => {
                    return control();
                }
                Some(peer) => format!(
                    "user {} is not in group {name}; add it (usermod -aG {name} USER)",
                    user_name(peer.uid)
                ),
                None => "the system reports no user of the client".into(),
            },
        };
        Permission { access: Access::Read, reason: Some(reason) }
    }
}

const fn control() -> Permission {
    Permission { access: Access::Control, reason: None }
}

pub(crate) fn user_name(uid: u32) -> String {
    let user = User::from_uid(Uid::from_raw(uid)).ok().flatten();
    user.map_or_else(|| uid.to_string(), |user| user.name)
}

fn is_member(peer: Peer, group: u32) -> bool {
    if peer.gid == group {
        return true;
    }
    let groups = || {
        let user = User::from_uid(Uid::from_raw(peer.uid)).ok()??;
        getgrouplist(&CString::new(user.name).ok()?, Gid::from_raw(peer.gid)).ok()
    };
    groups().is_some_and(|groups| groups.iter().any(|found| found.as_raw() == group))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(admission: &Admission, user: u32, users: &[(u32, usize)]) -> Result<(), String> {
        let users = users.iter().flat_map(|(user, count)| std::iter::repeat_n(*user, *count));
        admission.check(user, users)
    }

    #[test]
    fn users_leave_places_to_each_other_and_to_the_owner() {
        let admission = Admission { owner: 900, ..Admission::new(64) };
        assert_eq!(check(&admission, 1, &[(1, 31), (2, 31)]), Ok(()));
        let error = check(&admission, 1, &[(1, 32)]).unwrap_err();
        assert!(error.contains("has 32 connections; allowed: 32"), "{error}");
        assert_eq!(check(&admission, 3, &[(1, 32)]), Ok(()));
        let full = [(1, 32), (2, 31)];
        let error = check(&admission, 3, &full).unwrap_err();
        assert!(error.contains("the last place is for root and user 900"), "{error}");
        for user in [0, 900] {
            assert_eq!(check(&admission, user, &full), Ok(()));
            let error = check(&admission, user, &[(1, 32), (2, 32)]).unwrap_err();
            assert!(error.starts_with("64 clients are connected"), "{error}");
            assert_eq!(
                check(&admission, user, &[(user, 63)]),
                Ok(()),
                "without a limit of its own"
            );
        }
        assert_eq!(check(&Admission { owner: 900, ..Admission::new(1) }, 5, &[]), Ok(()));
    }

    #[test]
    fn repeated_incident_is_counted_until_it_pauses() {
        let mut log = IncidentLog::new("incidents");
        (0..5).for_each(|_| log.report(format_args!("one")));
        log.end_interval();
        assert!(log.is_active && log.repetitions == 4);
        log.end_interval();
        assert!(!log.is_active && log.repetitions == 0);
    }

    fn permission(control: Control, uid: u32) -> Permission {
        let peer = Peer { pid: 1, uid, gid: 54_321 };
        AccessRule::new(control).unwrap().permission(Some(peer))
    }

    #[test]
    fn control_depends_on_the_user() {
        let own = Uid::effective().as_raw();
        assert_eq!(permission(Control::Everyone, 12_345).access, Access::Control);
        assert_eq!(permission(Control::Owner, own).access, Access::Control);
        assert_eq!(permission(Control::Owner, 0).access, Access::Control);
        let other = permission(Control::Owner, 12_345);
        assert_eq!(other.access, Access::Read);
        assert!(other.reason.unwrap().starts_with("control is for user "));
        let nobody = permission(Control::Nobody, 0);
        assert_eq!(nobody.reason.as_deref(), Some("the service is read-only"));
        let error = nobody.need_control("sdo.download").unwrap_err();
        assert_eq!(error.message, "sdo.download is not permitted: the service is read-only");
    }

    #[test]
    fn group_gives_control_to_its_members() {
        let group = Group::from_gid(Gid::from_raw(0)).unwrap().unwrap().name;
        let rule = AccessRule::new(Control::Group(group.clone())).unwrap();
        let peer = |uid, gid| rule.permission(Some(Peer { pid: 1, uid, gid }));
        assert_eq!(peer(12_345, 0).access, Access::Control, "primary group");
        let reason = peer(12_345, 54_321).reason.unwrap();
        assert!(reason.starts_with(&format!("user 12345 is not in group {group}")), "{reason}");
        assert_eq!(rule.permission(None).access, Access::Read);
        let missing = AccessRule::new(Control::Group("no-such-group".into()));
        assert!(matches!(missing, Err(ServiceError::NoSuchGroup(_))));
    }
}
