//! Who may come in: each client is known by what the system says of its process, told in the log, and, where the configuration
//! names a group, turned away if it does not belong there.
//!
//! The socket file's rights say as much, but whoever makes the file sets them: systemd, where it hands the socket over.

use std::ffi::CString;
use std::io;

use lantern_proto::ErrorBody;
use nix::unistd::{Gid, Group, Uid, User, getgrouplist};
use tokio::net::unix::UCred;

/// A group that clients cannot be held to.
#[derive(Debug, thiserror::Error)]
pub enum GroupError {
    /// Nobody of that name.
    #[error("there is no group `{name}` on this machine; hint: groupadd makes one, `getent group` lists them")]
    Unknown {
        /// As in the configuration.
        name: String,
    },
    /// The system cannot tell.
    #[error("the group `{name}` cannot be looked up: {source}; hint: give its number")]
    System {
        /// As in the configuration.
        name: String,
        /// What the system said.
        source: io::Error,
    },
}

/// Who may come in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Door {
    group: Option<Members>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Members {
    /// As in the configuration.
    name: String,
    gid: u32,
}

impl Door {
    /// For whoever can connect.
    pub fn open() -> Self {
        Self { group: None }
    }

    /// For root, the daemon's own user and the members of a group, by its name or its number.
    ///
    /// # Errors
    /// [`GroupError`] where the machine does not know that name.
    pub fn for_group(name: &str) -> Result<Self, GroupError> {
        // A number needs no name.
        let gid = match name.parse() {
            Ok(gid) => gid,
            Err(_) => {
                let found = Group::from_name(name);
                let failed = |error: nix::Error| GroupError::System { name: name.to_owned(), source: error.into() };
                let group = found.map_err(failed)?.ok_or_else(|| GroupError::Unknown { name: name.to_owned() })?;
                group.gid.as_raw()
            }
        };
        Ok(Self { group: Some(Members { name: name.to_owned(), gid }) })
    }

    /// The group's number, where there is one.
    pub fn gid(&self) -> Option<u32> {
        self.group.as_ref().map(|group| group.gid)
    }

    /// Lets a client in, or says why not. Asks the user database, and so may wait.
    ///
    /// A client belongs to the group if its process runs under it, or if its user is a member. What else a process has been given for
    /// itself alone (systemd's `SupplementaryGroups=`) does not count.
    ///
    /// # Errors
    /// `not-allowed`.
    pub(super) fn admit(&self, peer: UCred) -> Result<(), ErrorBody> {
        let (uid, gid, pid) = (peer.uid(), peer.gid(), peer.pid().unwrap_or_default());
        let user = User::from_uid(Uid::from_raw(uid)).unwrap_or_else(|error| {
            tracing::warn!(uid, %error, "the user of a client cannot be looked up");
            None
        });
        let name = user.as_ref().map_or("(nobody known)", |user| user.name.as_str());
        let Some(group) = self.group.as_ref().filter(|group| !group.holds(uid, gid, user.as_ref())) else {
            tracing::info!(pid, uid, gid, user = name, "a client has connected");
            return Ok(());
        };
        tracing::warn!(
            pid,
            uid,
            gid,
            user = name,
            group = group.name,
            "a client was turned away: it is not of the group"
        );
        let message = format!(
            "user {uid} ({name}) is not of the group `{}`; hint: root can say `adduser {name} {0}`, or name another daemon.group",
            group.name
        );
        Err(ErrorBody::new("not-allowed", message))
    }
}

impl Members {
    fn holds(&self, uid: u32, gid: u32, user: Option<&User>) -> bool {
        let is_ours = uid == 0 || uid == Uid::effective().as_raw() || gid == self.gid;
        is_ours || user.is_some_and(|user| self.lists(user))
    }

    fn lists(&self, user: &User) -> bool {
        // A name out of the database has no zero byte.
        let Ok(name) = CString::new(user.name.as_str()) else { return false };
        match getgrouplist(&name, user.gid) {
            Ok(groups) => groups.contains(&Gid::from_raw(self.gid)),
            Err(error) => {
                tracing::warn!(user = user.name, %error, "the groups of a client cannot be looked up");
                false
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn user(name: &str) -> Option<User> {
        User::from_name(name).unwrap()
    }

    #[test]
    fn groups_have_names_and_numbers() {
        assert_eq!(Door::open().gid(), None);
        assert_eq!(Door::for_group("root").unwrap().gid(), Some(0));
        // Nobody need have heard of a number.
        assert_eq!(Door::for_group("4242").unwrap().gid(), Some(4242));
        let error = Door::for_group("no such group").unwrap_err().to_string();
        assert!(error.contains("`no such group`") && error.contains("hint:"), "{error}");
    }

    #[test]
    fn members_are_those_of_the_process_and_those_of_the_database() {
        let group = Members { name: "some".to_owned(), gid: 4242 };
        let own = Uid::effective().as_raw();
        assert!(group.holds(0, 0, None) && group.holds(own, 1, None), "root and the daemon itself");
        assert!(group.holds(4243, 4242, None), "it runs under the group");
        assert!(!group.holds(4243, 4243, None) && !group.holds(4243, 0, None));
        // Every user is of its own first group, and Debian's `daemon` is of no other.
        let daemon = user("daemon");
        let gid = daemon.as_ref().unwrap().gid.as_raw();
        let of_daemon = Members { name: "daemon".to_owned(), gid };
        assert!(of_daemon.holds(4243, 4243, daemon.as_ref()) && !group.holds(4243, 4243, daemon.as_ref()));
    }
}
