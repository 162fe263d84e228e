//! Epochs: messages of a replaced instance are refused.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use sg_proto::bus::Code;

use crate::fault::Fault;

/// Most roles to remember. Senders name their own role, so their number has no other bound.
const MAX_ROLES: usize = 256;

/// Newest known epoch of each role.
#[derive(Debug, Default)]
pub(super) struct Epochs(Mutex<HashMap<String, u64>>);

impl Epochs {
    /// Refuses an epoch below the newest one of its role. Epoch 0 is always accepted.
    pub(super) fn check(&self, role: &str, epoch: u64) -> Result<(), Fault> {
        if epoch == 0 {
            return Ok(());
        }
        let mut newest = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match newest.get_mut(role) {
            Some(known) if epoch < *known => Err(Fault::new(
                Code::Aborted,
                format!("`{role}` has passed to another instance (epoch {known}; this message is of epoch {epoch})"),
            )),
            Some(known) => {
                *known = epoch;
                Ok(())
            }
            None => {
                if newest.len() < MAX_ROLES {
                    newest.insert(role.to_owned(), epoch);
                }
                Ok(())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_older_epoch_is_refused() {
        let epochs = Epochs::default();
        assert!(epochs.check("scene", 5).is_ok());
        assert!(epochs.check("scene", 7).is_ok());
        assert!(epochs.check("scene", 7).is_ok());
        let refused = epochs.check("scene", 6).unwrap_err();
        assert_eq!(refused.code, Code::Aborted);
        assert!(refused.message.contains("epoch 7"), "{refused}");
        assert!(epochs.check("selection", 1).is_ok(), "each role has its own epoch");
        assert!(epochs.check("scene", 0).is_ok(), "a sender without epoch");
    }
}
