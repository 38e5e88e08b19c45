//! Access of a client by its credentials.

use std::ffi::CString;
use std::os::fd::AsFd;

use nix::unistd::{Gid, Group, Uid, User, getgrouplist};

use super::config::Permission;
use crate::protocol::Access;
use crate::server::config::{Control, ServiceError};

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
