//! Liveliness: which instances are connected.

use sg_proto::keys::{self, Identity};
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
            let key = self.sending_key(&format!("@alive/{}", self.role()), instance);
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
            let (sender, receiver) = mpsc::channel(capacity);
            for key in [keys::alive(self.session(), "*", "*"), keys::from_nodes(self.session(), "@alive/*/*")] {
                let (bus, sender) = (self.clone(), sender.clone());
                let receive = move |sample: Sample| {
                    let alive = sample.kind() == SampleKind::Put;
                    let change = liveliness_change(bus.session(), sample.key_expr().as_str(), alive);
                    let Some(change) = change else { return bus.inner.counters.refuse(KEY) };
                    // Nodes leave a quarter of the queue to the supervisor's machine.
                    let is_full = change.identity.is_some() && sender.capacity() <= sender.max_capacity() / 4;
                    if is_full || sender.try_send(change).is_err() {
                        bus.inner.counters.drop(KEY, 1);
                    }
                };
                let liveliness = self.inner.zenoh.liveliness();
                let declared = liveliness.declare_subscriber(&key).history(true).callback(receive).background().await;
                declared.map_err(|e| BusError::Declare { key, reason: e.to_string() })?;
            }
            Ok(receiver)
        })
    }
}

/// The change that a token means; `None` for a token of another process than its sender.
fn liveliness_change(session: &str, key: &str, alive: bool) -> Option<LivelinessChange> {
    let (identity, rest) = keys::split(session, key)?;
    let (role, instance) = rest.strip_prefix("@alive/")?.split_once('/')?;
    let is_own = identity.as_ref().is_none_or(|i| (i.role.as_str(), i.instance.as_str()) == (role, instance));
    let change = LivelinessChange { role: role.to_owned(), instance: instance.to_owned(), alive, identity };
    is_own.then_some(change)
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
    /// The process, if it runs on a node.
    pub identity: Option<Identity>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_node_is_alive_for_itself_only() {
        let change = |key| liveliness_change("s", key, true);
        assert_eq!(change("sg/s/@alive/scene/scene.1").unwrap().identity, None);
        let own = change("sg/s/@node/gpu1/render-view/view.1/@alive/render-view/view.1").unwrap();
        assert_eq!((own.role.as_str(), own.identity.unwrap().node.as_str()), ("render-view", "gpu1"));
        assert_eq!(change("sg/s/@node/gpu1/render-view/view.1/@alive/scene/scene.1"), None);
        assert_eq!(change("sg/s/@node/gpu1/render-view/view.1/@alive/render-view/view.2"), None);
    }
}
