//! The sender of a message: read from its key, and compared with its envelope.

use std::time::Instant;

use sg_proto::bus::{Code, Envelope};
use sg_proto::keys::{self, Identity};

use super::Bus;
use crate::fault::Fault;

/// Sender and address of a received message, from its key.
pub(super) struct Origin<'a> {
    /// Absent for a process of the supervisor's machine. The router lets no node send under such a key.
    pub(super) identity: Option<Identity>,
    /// Role or instance in the key.
    pub(super) segment: &'a str,
}

impl Bus {
    /// Node of this process; `None` on the supervisor's machine.
    #[must_use]
    pub fn node(&self) -> Option<&str> {
        self.inner.identity.as_ref().map(|i| i.node.as_str())
    }

    /// Key under which this process sends.
    pub(super) fn sending_key(&self, segment: &str, name: &str) -> String {
        match &self.inner.identity {
            Some(identity) => identity.key(self.session(), &format!("{segment}/{name}")),
            None => keys::key(self.session(), segment, name),
        }
    }

    /// Reads sender and address from the key of a message.
    pub(super) fn origin<'a>(&self, key: &'a str, name: &str) -> Result<Origin<'a>, Fault> {
        keys::split(self.session(), key)
            .and_then(|(identity, rest)| {
                let segment = rest.strip_suffix(name)?.strip_suffix('/')?;
                Some(Origin { identity, segment })
            })
            .ok_or_else(|| Fault::invalid(format!("`{key}` is no key of a single sender of {name}")))
    }

    /// Compares an envelope with the sender in the key, then checks its epoch.
    ///
    /// Only a sender that the router has confirmed can raise the epoch of a role.
    pub(super) fn check_sender(&self, identity: Option<&Identity>, envelope: &Envelope) -> Result<(), Fault> {
        if let Some(identity) = identity
            && envelope.sender != identity.role
        {
            return Err(Fault::new(
                Code::PermissionDenied,
                format!("`{}` on node `{}` may not send as `{}`", identity.instance, identity.node, envelope.sender),
            ));
        }
        self.check_epoch(envelope)
    }

    /// Takes a message out of its sender's quota. Messages of the supervisor's machine have none.
    pub(super) fn check_quota(&self, identity: Option<&Identity>, bytes: usize) -> Result<(), Fault> {
        match identity {
            Some(identity) if !self.inner.quotas.take(&identity.node, bytes, Instant::now()) => {
                Err(Fault::exhausted(format!("node `{}` sends too much; try again in a moment", identity.node)))
            }
            _ => Ok(()),
        }
    }
}
