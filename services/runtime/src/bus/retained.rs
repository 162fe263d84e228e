//! Retained values: one role owns the newest value, subscribers get each new one, late readers ask for it.

use std::sync::Arc;

use prost::{Message, Name};
use sg_proto::keys::{Priority, Retained};
use tokio::sync::watch;
use zenoh::query::Query;

use super::addressing::DeclaredRow;
use super::{Bus, BusError};
use crate::context::Context;
use crate::fault::Fault;
use crate::wire;

impl Bus {
    /// Owns the value of a row: publishes every new value and answers late readers with the newest one.
    ///
    /// # Errors
    /// [`BusError::Declare`], also for a row of another role.
    pub async fn retain<M>(&self, row: &Retained<M>, initial: M) -> Result<RetainedValue<M>, BusError>
    where
        M: Message + Name + Clone + Sync + 'static,
    {
        let (sender, receiver) = watch::channel(initial);
        let (bus, name) = (self.clone(), row.name);
        let answer = move |query: Query| {
            let newest = match bus.admit(&query, name) {
                Ok(_) => wire::encode(&*receiver.borrow()),
                Err(fault) => Err(fault),
            };
            bus.reply(&query, newest.map(|bytes| (bytes, wire::encoding::<M>())));
        };
        let declared = self.declare(row.role, row.name, true, Arc::new(answer)).await?;
        Ok(RetainedValue { sender, bus: self.clone(), name: row.name, _declared: declared })
    }
}

/// A retained value, at its owner.
#[derive(Debug)]
pub struct RetainedValue<M> {
    sender: watch::Sender<M>,
    bus: Bus,
    name: &'static str,
    _declared: Arc<DeclaredRow>,
}

impl<M: Message + Name + Clone> RetainedValue<M> {
    /// Replaces the value and publishes it.
    ///
    /// # Errors
    /// As in [`Bus::publish`]. The value is replaced all the same, and late readers get it.
    pub async fn set(&self, value: M, context: &Context) -> Result<(), Fault> {
        self.sender.send_replace(value.clone());
        self.bus.put(self.name, Priority::Normal, &value, context)
    }
}
