//! Liveliness: who is there.

use sg_proto::keys;
use tokio::sync::mpsc;
use zenoh::sample::{Sample, SampleKind};

use super::{Boxed, Bus, BusError};

/// What is counted where a sign of life finds no room.
const KEY: &str = "@alive";

impl Bus {
    /// Declares that an instance of this role is alive, until the token is dropped or the process dies.
    ///
    /// # Errors
    /// [`BusError::Declare`].
    pub fn declare_alive<'a>(&'a self, instance: &'a str) -> Boxed<'a, Result<Alive, BusError>> {
        Box::pin(async move {
            let key = keys::alive(&self.inner.session, &self.inner.role, instance);
            let token = self.inner.zenoh.liveliness().declare_token(&key).await;
            Ok(Alive { _token: token.map_err(|e| BusError::Declare { key, reason: e.to_string() })? })
        })
    }

    /// Watches who comes and goes: role, instance, and whether it is alive; who is there already comes first.
    ///
    /// # Errors
    /// [`BusError::Declare`].
    pub fn watch_alive(&self, capacity: usize) -> Boxed<'_, Result<mpsc::Receiver<Liveliness>, BusError>> {
        Box::pin(async move {
            let key = keys::alive(&self.inner.session, "*", "*");
            let (sender, receiver) = mpsc::channel(capacity);
            let bus = self.clone();
            let take = move |sample: Sample| {
                let key = sample.key_expr().to_string();
                let mut parts = key.rsplit('/');
                if let (Some(instance), Some(role)) = (parts.next(), parts.next()) {
                    let alive = sample.kind() == SampleKind::Put;
                    let seen = Liveliness { role: role.to_owned(), instance: instance.to_owned(), alive };
                    if sender.try_send(seen).is_err() {
                        bus.inner.counters.drop(KEY, 1);
                    }
                }
            };
            let liveliness = self.inner.zenoh.liveliness();
            let declared = liveliness.declare_subscriber(&key).history(true).callback(take).background().await;
            declared.map_err(|e| BusError::Declare { key, reason: e.to_string() })?;
            Ok(receiver)
        })
    }
}

/// A declared liveliness token.
#[derive(Debug)]
pub struct Alive {
    _token: zenoh::liveliness::LivelinessToken,
}

/// Somebody came or went.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Liveliness {
    /// Role.
    pub role: String,
    /// Instance.
    pub instance: String,
    /// Whether it came (true) or went.
    pub alive: bool,
}
