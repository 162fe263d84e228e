//! Keys of a process: those of its role, of its instance, or both.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError, RwLock, Weak};

use sg_proto::bus::Envelope;
use sg_proto::keys;
use zenoh::query::{Query, Queryable};

use super::{BoxFuture, Bus, BusError};
use crate::fault::Fault;

/// Address of a process in its session, and the rows it has declared.
#[derive(Debug)]
pub(super) struct Address {
    /// Absent for processes that are not services, such as the command line and the supervisor.
    instance: Option<String>,
    assignment: RwLock<Assignment>,
    declared: Mutex<Vec<Weak<DeclaredRow>>>,
}

#[derive(Debug, Clone, Copy)]
struct Assignment {
    epoch: u64,
    standby: bool,
}

impl Address {
    pub(super) fn of_role() -> Self {
        Self::new(None, 0, false)
    }

    pub(super) fn of_instance(instance: &str, epoch: u64, standby: bool) -> Self {
        Self::new(Some(instance.to_owned()), epoch, standby)
    }

    fn new(instance: Option<String>, epoch: u64, standby: bool) -> Self {
        Self { instance, assignment: RwLock::new(Assignment { epoch, standby }), declared: Mutex::default() }
    }

    pub(super) fn instance(&self) -> Option<&str> {
        self.instance.as_deref()
    }

    fn assignment(&self) -> Assignment {
        *self.assignment.read().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Receives the queries of a row.
pub(super) type Callback = Arc<dyn Fn(Query) + Send + Sync>;

/// A row that is answered under every key of this process.
pub(super) struct DeclaredRow {
    name: &'static str,
    /// Whether processes on nodes may ask.
    for_nodes: bool,
    /// Absent once the row is undeclared: the callback feeds a queue, and a reader waits for the end of that queue.
    callback: Mutex<Option<Callback>>,
    queryables: Mutex<Vec<Queryable<()>>>,
}

impl fmt::Debug for DeclaredRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DeclaredRow").field("name", &self.name).finish_non_exhaustive()
    }
}

impl DeclaredRow {
    /// Stops new queries.
    pub(super) fn undeclare(&self) -> BoxFuture<'_, ()> {
        Box::pin(async {
            self.callback.lock().unwrap_or_else(PoisonError::into_inner).take();
            let queryables = std::mem::take(&mut *self.queryables.lock().unwrap_or_else(PoisonError::into_inner));
            for queryable in queryables {
                // A closed bus has undeclared it already.
                let _ = queryable.undeclare().await;
            }
        })
    }
}

impl Bus {
    /// Epoch under which this process sends; 0 without one and in standby.
    #[must_use]
    pub fn epoch(&self) -> u64 {
        let assignment = self.inner.address.assignment();
        if assignment.standby { 0 } else { assignment.epoch }
    }

    /// Whether this process waits for its role.
    #[must_use]
    pub fn is_standby(&self) -> bool {
        self.inner.address.assignment().standby
    }

    /// Segment of the role in the keys of this process: its role, or its instance in standby.
    pub(super) fn segment(&self) -> String {
        match &self.inner.address.instance {
            Some(instance) if self.is_standby() => keys::instance(instance),
            _ => self.role().to_owned(),
        }
    }

    /// Takes the role: the process serves the keys of its role under this epoch, and still those of its instance.
    ///
    /// # Errors
    /// [`BusError::Declare`]. Some keys may be declared by then, and the process should exit.
    pub async fn promote(&self, epoch: u64) -> Result<(), BusError> {
        *self.inner.address.assignment.write().unwrap_or_else(PoisonError::into_inner) =
            Assignment { epoch, standby: false };
        for row in self.own_rows() {
            self.declare_at(self.role(), &row).await?;
        }
        Ok(())
    }

    /// Names of the rows that this process answers or owns, sorted.
    #[must_use]
    pub fn declares(&self) -> Vec<&'static str> {
        let mut names: Vec<_> = self.own_rows().iter().map(|d| d.name).collect();
        names.sort_unstable();
        names
    }

    fn own_rows(&self) -> Vec<Arc<DeclaredRow>> {
        let mut declared = self.inner.address.declared.lock().unwrap_or_else(PoisonError::into_inner);
        declared.retain(|d| d.strong_count() > 0);
        declared.iter().filter_map(Weak::upgrade).collect()
    }

    /// Declares a row of this process's role under every key of the process, now and after a promotion.
    pub(super) async fn declare(
        &self,
        role: &str,
        name: &'static str,
        for_nodes: bool,
        callback: Callback,
    ) -> Result<Arc<DeclaredRow>, BusError> {
        self.check_role(role, name)
            .map_err(|reason| BusError::Declare { key: keys::key(self.session(), role, name), reason })?;
        let callback = Mutex::new(Some(callback));
        let declared = Arc::new(DeclaredRow { name, for_nodes, callback, queryables: Mutex::default() });
        let address = &self.inner.address;
        address.declared.lock().unwrap_or_else(PoisonError::into_inner).push(Arc::downgrade(&declared));
        if let Some(instance) = &address.instance {
            self.declare_at(&keys::instance(instance), &declared).await?;
        }
        if !self.is_standby() {
            self.declare_at(self.role(), &declared).await?;
        }
        Ok(declared)
    }

    fn declare_at<'a>(&'a self, segment: &'a str, declared: &'a DeclaredRow) -> BoxFuture<'a, Result<(), BusError>> {
        Box::pin(async move {
            let Some(callback) = declared.callback.lock().unwrap_or_else(PoisonError::into_inner).clone() else {
                return Ok(());
            };
            let home = keys::key(self.session(), segment, declared.name);
            let nodes = keys::from_nodes(self.session(), &format!("{segment}/{}", declared.name));
            for key in [Some(home), declared.for_nodes.then_some(nodes)].into_iter().flatten() {
                let callback = Arc::clone(&callback);
                let queryable = self
                    .inner
                    .zenoh
                    .declare_queryable(&key)
                    .complete(true)
                    .callback(move |query| callback(query))
                    .await
                    .map_err(|e| BusError::Declare { key, reason: e.to_string() })?;
                declared.queryables.lock().unwrap_or_else(PoisonError::into_inner).push(queryable);
            }
            Ok(())
        })
    }

    /// Refuses a message of an instance whose role has passed to another one.
    pub(super) fn check_epoch(&self, envelope: &Envelope) -> Result<(), Fault> {
        self.inner.epochs.check(&envelope.sender, envelope.epoch)
    }
}
