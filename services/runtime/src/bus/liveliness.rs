//! Liveliness: which instances are connected.

use sg_proto::keys;
use tokio::sync::mpsc;
use zenoh::sample::{Sample, SampleKind};

use super::{BoxFuture, Bus, BusError};

/// Key under which dropped changes are counted.
const KEY: &str = "@alive";

impl Bus {
    /// Declares that an instance of this role is alive, until the token is dropped or the process dies.
    ///
    /// # Errors
    /// [`BusError::Declare`].
    pub fn declare_liveliness<'a>(&'a self, instance: &'a str) -> BoxFuture<'a, Result<LivelinessToken, BusError>> {
        Box::pin(async move {
            let key = keys::alive(&self.inner.session, &self.inner.role, instance);
            let token = self.inner.zenoh.liveliness().declare_token(&key).await;
            Ok(LivelinessToken { _token: token.map_err(|e| BusError::Declare { key, reason: e.to_string() })? })
        })
    }

    /// Subscribes to the liveliness of all instances. Instances that are alive already come first.
    ///
    /// # Errors
    /// [`BusError::Declare`].
    pub fn watch_liveliness(
        &self,
        capacity: usize,
    ) -> BoxFuture<'_, Result<mpsc::Receiver<LivelinessChange>, BusError>> {
        Box::pin(async move {
            let key = keys::alive(&self.inner.session, "*", "*");
            let (sender, receiver) = mpsc::channel(capacity);
            let bus = self.clone();
            let receive = move |sample: Sample| {
                let key = sample.key_expr().to_string();
                let mut parts = key.rsplit('/');
                if let (Some(instance), Some(role)) = (parts.next(), parts.next()) {
                    let alive = sample.kind() == SampleKind::Put;
                    let change = LivelinessChange { role: role.to_owned(), instance: instance.to_owned(), alive };
                    if sender.try_send(change).is_err() {
                        bus.inner.counters.drop(KEY, 1);
                    }
                }
            };
            let liveliness = self.inner.zenoh.liveliness();
            let declared = liveliness.declare_subscriber(&key).history(true).callback(receive).background().await;
            declared.map_err(|e| BusError::Declare { key, reason: e.to_string() })?;
            Ok(receiver)
        })
    }
}

/// A declared liveliness token.
#[derive(Debug)]
pub struct LivelinessToken {
    _token: zenoh::liveliness::LivelinessToken,
}

/// An instance connected or disconnected.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LivelinessChange {
    /// Role.
    pub role: String,
    /// Instance.
    pub instance: String,
    /// Whether the instance is alive now.
    pub alive: bool,
}
