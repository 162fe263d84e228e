//! Newest values: owned by one role, told to whoever follows, asked for by whoever comes late.

use std::sync::Arc;

use prost::{Message, Name};
use sg_proto::keys::{Slot, Urgency};
use tokio::sync::watch;
use zenoh::query::Query;

use super::place::Declared;
use super::serve::reply;
use super::{Bus, BusError};
use crate::context::Context;
use crate::fault::Fault;
use crate::wire;

impl Bus {
    /// Owns the newest value of a row: publishes every new one and hands the present one to late readers.
    ///
    /// # Errors
    /// [`BusError::Declare`], also for a row of another role.
    pub async fn own<M>(&self, row: &Slot<M>, initial: M) -> Result<Owned<M>, BusError>
    where
        M: Message + Name + Clone + Sync + 'static,
    {
        let (sender, receiver) = watch::channel(initial);
        let tell = move |query: Query| {
            let newest = wire::encode(&*receiver.borrow());
            reply(&query, newest.map(|bytes| (bytes, wire::encoding::<M>())));
        };
        let declared = self.declare(row.role, row.name, Arc::new(tell)).await?;
        Ok(Owned { sender, bus: self.clone(), name: row.name, _declared: declared })
    }
}

/// The owning end of a newest value.
#[derive(Debug)]
pub struct Owned<M> {
    sender: watch::Sender<M>,
    bus: Bus,
    name: &'static str,
    _declared: Arc<Declared>,
}

impl<M: Message + Name + Clone> Owned<M> {
    /// Replaces the value and tells whoever follows.
    ///
    /// # Errors
    /// As [`Bus::publish`]; the value is replaced all the same and late readers get it.
    pub async fn set(&self, value: M, context: &Context) -> Result<(), Fault> {
        self.sender.send_replace(value.clone());
        self.bus.put(self.name, Urgency::Ordinary, &value, context)
    }
}
