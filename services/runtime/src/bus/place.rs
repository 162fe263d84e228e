//! Under which keys a process serves: those of its role, those of its instance, or both; and since when.

use std::collections::HashMap;
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError, RwLock, Weak};

use sg_proto::bus::{Code, Envelope};
use sg_proto::keys;
use zenoh::query::{Query, Queryable};

use super::{Boxed, Bus, BusError};
use crate::fault::Fault;

/// Where a process stands in its session.
#[derive(Debug)]
pub(super) struct Place {
    /// Absent for those who are no service: people at a terminal, the supervisor.
    instance: Option<String>,
    now: RwLock<Now>,
    declared: Mutex<Vec<Weak<Declared>>>,
}

#[derive(Debug, Clone, Copy)]
struct Now {
    epoch: u64,
    standby: bool,
}

impl Place {
    pub(super) fn of_role() -> Self {
        Self::new(None, 0, false)
    }

    pub(super) fn of_instance(instance: &str, epoch: u64, standby: bool) -> Self {
        Self::new(Some(instance.to_owned()), epoch, standby)
    }

    fn new(instance: Option<String>, epoch: u64, standby: bool) -> Self {
        Self { instance, now: RwLock::new(Now { epoch, standby }), declared: Mutex::default() }
    }

    fn now(&self) -> Now {
        *self.now.read().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What takes the requests of a row.
pub(super) type Callback = Arc<dyn Fn(Query) + Send + Sync>;

/// A row that is answered under every key that this process may serve at present.
pub(super) struct Declared {
    name: &'static str,
    /// Absent once the row is withdrawn: whoever waits for the end of what it feeds must not wait for ever.
    callback: Mutex<Option<Callback>>,
    queryables: Mutex<Vec<Queryable<()>>>,
}

impl fmt::Debug for Declared {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Declared").field("name", &self.name).finish_non_exhaustive()
    }
}

impl Declared {
    /// Answers nothing new.
    pub(super) fn withdraw(&self) -> Boxed<'_, ()> {
        Box::pin(async {
            self.callback.lock().unwrap_or_else(PoisonError::into_inner).take();
            let queryables = std::mem::take(&mut *self.queryables.lock().unwrap_or_else(PoisonError::into_inner));
            for queryable in queryables {
                // A bus that is closed has withdrawn it already.
                let _ = queryable.undeclare().await;
            }
        })
    }
}

impl Bus {
    /// Epoch under which this process sends; 0 where it has none, and while it stands by.
    #[must_use]
    pub fn epoch(&self) -> u64 {
        let now = self.inner.place.now();
        if now.standby { 0 } else { now.epoch }
    }

    /// Whether this process has loaded but not its role.
    #[must_use]
    pub fn stands_by(&self) -> bool {
        self.inner.place.now().standby
    }

    /// What stands in place of the role in the keys under which this process publishes: the role, or its instance while it
    /// stands by.
    pub(super) fn segment(&self) -> String {
        match &self.inner.place.instance {
            Some(instance) if self.stands_by() => keys::instance(instance),
            _ => self.role().to_owned(),
        }
    }

    /// Takes the role: from now on this process serves its keys, under this epoch, and still those of its instance.
    ///
    /// # Errors
    /// [`BusError::Declare`]; then some keys may have been taken, and the process should end.
    pub async fn promote(&self, epoch: u64) -> Result<(), BusError> {
        *self.inner.place.now.write().unwrap_or_else(PoisonError::into_inner) = Now { epoch, standby: false };
        for row in self.rows() {
            self.declare_at(self.role(), &row).await?;
        }
        Ok(())
    }

    /// Names of the rows that this process answers or owns, sorted.
    #[must_use]
    pub fn declares(&self) -> Vec<&'static str> {
        let mut names: Vec<_> = self.rows().iter().map(|d| d.name).collect();
        names.sort_unstable();
        names
    }

    fn rows(&self) -> Vec<Arc<Declared>> {
        let mut declared = self.inner.place.declared.lock().unwrap_or_else(PoisonError::into_inner);
        declared.retain(|d| d.strong_count() > 0);
        declared.iter().filter_map(Weak::upgrade).collect()
    }

    /// Answers a row of this process's role under every key that it may serve, now and after a promotion.
    pub(super) async fn declare(
        &self,
        role: &str,
        name: &'static str,
        callback: Callback,
    ) -> Result<Arc<Declared>, BusError> {
        self.own_row(role, name)
            .map_err(|reason| BusError::Declare { key: keys::key(self.session(), role, name), reason })?;
        let declared = Arc::new(Declared { name, callback: Mutex::new(Some(callback)), queryables: Mutex::default() });
        let place = &self.inner.place;
        place.declared.lock().unwrap_or_else(PoisonError::into_inner).push(Arc::downgrade(&declared));
        if let Some(instance) = &place.instance {
            self.declare_at(&keys::instance(instance), &declared).await?;
        }
        if !self.stands_by() {
            self.declare_at(self.role(), &declared).await?;
        }
        Ok(declared)
    }

    fn declare_at<'a>(&'a self, segment: &'a str, declared: &'a Declared) -> Boxed<'a, Result<(), BusError>> {
        Box::pin(async move {
            let key = keys::key(self.session(), segment, declared.name);
            let Some(callback) = declared.callback.lock().unwrap_or_else(PoisonError::into_inner).clone() else {
                return Ok(());
            };
            let queryable = self
                .inner
                .zenoh
                .declare_queryable(&key)
                .complete(true)
                .callback(move |query| callback(query))
                .await
                .map_err(|e| BusError::Declare { key, reason: e.to_string() })?;
            declared.queryables.lock().unwrap_or_else(PoisonError::into_inner).push(queryable);
            Ok(())
        })
    }

    /// Refuses what an instance says whose role has passed to another.
    pub(super) fn check_epoch(&self, envelope: &Envelope) -> Result<(), Fault> {
        self.inner.epochs.check(&envelope.sender, envelope.epoch)
    }
}

/// The newest epoch of each role that was heard of.
#[derive(Debug, Default)]
pub(super) struct Epochs(Mutex<HashMap<String, u64>>);

/// Roles that are remembered; senders say themselves who they are, so their number is not ours to know.
const ROLES: usize = 256;

impl Epochs {
    fn check(&self, role: &str, epoch: u64) -> Result<(), Fault> {
        if epoch == 0 {
            return Ok(());
        }
        let mut newest = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match newest.get_mut(role) {
            Some(seen) if epoch < *seen => Err(Fault::new(
                Code::Aborted,
                format!("`{role}` has passed to another instance (epoch {seen}; this message is of epoch {epoch})"),
            )),
            Some(seen) => {
                *seen = epoch;
                Ok(())
            }
            None => {
                if newest.len() < ROLES {
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
    fn an_epoch_never_goes_back() {
        let epochs = Epochs::default();
        assert!(epochs.check("scene", 5).is_ok());
        assert!(epochs.check("scene", 7).is_ok());
        assert!(epochs.check("scene", 7).is_ok());
        let refused = epochs.check("scene", 6).unwrap_err();
        assert_eq!(refused.code, Code::Aborted);
        assert!(refused.message.contains("epoch 7"), "{refused}");
        assert!(epochs.check("selection", 1).is_ok(), "each role has its own");
        assert!(epochs.check("scene", 0).is_ok(), "no epoch, no claim");
    }
}
