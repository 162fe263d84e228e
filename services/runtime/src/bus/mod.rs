//! The bus: requests, streams, retained values and liveliness.
//!
//! Every receive path is bounded. A full request queue refuses at once, and a slow stream reader loses the oldest messages.
//! Both are counted.

mod access;
mod addressing;
mod client;
mod config;
mod counters;
mod epochs;
mod identity;
mod link;
mod liveliness;
mod quotas;
mod raw;
mod retained;
mod route;
mod server;
mod stream;

use std::future::Future;
use std::path::Path;
use std::pin::Pin;
use std::sync::Arc;
use std::time::{Duration, Instant};

pub use counters::Counters;
pub use link::{
    CertificateContent, CertificateError, Certificates, Link, RemoteMachine, RemoteService, TLS_PREFIX, TlsListener,
    endpoint_of,
};
pub use liveliness::{LivelinessChange, LivelinessToken};
pub use raw::{DeclaredKey, RawMessage, RawReply};
pub use retained::RetainedValue;
pub use server::ServerHandle;
pub use stream::{SessionWatch, Subscription, WatchedMessage};

use crate::fault::Fault;
use addressing::Address;
use epochs::Epochs;
use quotas::Quotas;
use server::PendingRequests;
use sg_proto::keys::Identity;
use stream::Sequences;

/// A boxed future, so that its code is compiled once, in this package.
///
/// An `async fn` is compiled into each executable that awaits it, together with its share of zenoh. That costs minutes of
/// build time and megabytes per executable.
pub type BoxFuture<'a, T> = Pin<Box<dyn Future<Output = T> + Send + 'a>>;

/// A connection to the bus of one session, under one role. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Bus {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    zenoh: zenoh::Session,
    session: String,
    role: String,
    counters: Counters,
    address: Address,
    epochs: Epochs,
    /// Absent on the supervisor's machine.
    identity: Option<Identity>,
    quotas: Quotas,
    pending: PendingRequests,
    sequences: Sequences,
    /// The router of other machines, in the process that opened the session's.
    nodes: tokio::sync::Mutex<Option<zenoh::Session>>,
}

/// A failed connection or declaration.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// The endpoint could not be reached or opened.
    #[error("bus of session `{session}` at {endpoint}: {reason}")]
    Open {
        /// Session.
        session: String,
        /// Endpoint.
        endpoint: String,
        /// Reason from the bus.
        reason: String,
    },
    /// A key could not be declared.
    #[error("key `{key}` could not be declared: {reason}")]
    Declare {
        /// The key expression.
        key: String,
        /// Reason from the bus, or from a check before it.
        reason: String,
    },
}

/// Longest time for a connection to the router.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);

/// Longest time in which the address for other machines may be in use still.
const LISTEN_TIMEOUT: Duration = Duration::from_secs(3);

/// Pause between two attempts to listen.
const LISTEN_PAUSE: Duration = Duration::from_millis(50);

/// Longest time for a disconnection.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(2);

impl Bus {
    /// Connects to the router of a session, as a client of the same machine.
    ///
    /// # Errors
    /// [`BusError::Open`] if the router does not answer within five seconds, or a certificate is unusable.
    pub async fn connect(session: &str, role: &str, link: impl Into<Link>) -> Result<Self, BusError> {
        Self::join(session, role, link.into(), Address::of_role()).await
    }

    /// Connects as one instance of a role, which it serves under this epoch.
    ///
    /// With `standby` it serves under its instance only, until [`Bus::promote`].
    ///
    /// # Errors
    /// As in [`Bus::connect`].
    pub async fn connect_instance(
        session: &str,
        role: &str,
        instance: &str,
        epoch: u64,
        standby: bool,
        link: impl Into<Link>,
    ) -> Result<Self, BusError> {
        Self::join(session, role, link.into(), Address::of_instance(instance, epoch, standby)).await
    }

    /// Opens the router of a session on a unix socket, and for other machines at `listener`.
    ///
    /// # Errors
    /// [`BusError::Open`] if the socket or address cannot be opened, or a certificate is unusable.
    pub async fn open_router(
        session: &str,
        role: &str,
        socket: &Path,
        listener: Option<&TlsListener>,
    ) -> Result<Self, BusError> {
        let endpoint = endpoint_of(socket);
        let bus = Self::open(session, role, endpoint, config::router(socket), Address::of_role(), None).await?;
        if let Some(listener) = listener
            && let Err(error) = bus.open_to_machines(socket, listener).await
        {
            bus.close().await;
            return Err(error);
        }
        Ok(bus)
    }

    /// Opens the session for these machines of the listener and no others.
    ///
    /// On a session that is open for machines already, their connections are closed. Those of the listener connect
    /// again by themselves, with the same rights as at the start.
    ///
    /// # Errors
    /// [`BusError::Open`] if the address cannot be opened, or a certificate is unusable. Then no machine is admitted.
    pub fn open_to_machines<'a>(
        &'a self,
        socket: &'a Path,
        listener: &'a TlsListener,
    ) -> BoxFuture<'a, Result<(), BusError>> {
        Box::pin(async move {
            let fail = |reason: String| BusError::Open {
                session: self.session().into(),
                endpoint: listener.endpoint.clone(),
                reason,
            };
            let config = config::node_router(self.session(), socket, listener).map_err(&fail)?;
            let mut nodes = self.inner.nodes.lock().await;
            let reopened = close(nodes.take()).await;
            let began = Instant::now();
            loop {
                match tokio::time::timeout(CONNECT_TIMEOUT, zenoh::open(config.clone())).await {
                    Ok(Ok(opened)) => {
                        *nodes = Some(opened);
                        return Ok(());
                    }
                    // The system may not have freed the address yet.
                    Ok(Err(_)) if reopened && began.elapsed() < LISTEN_TIMEOUT => {
                        tokio::time::sleep(LISTEN_PAUSE).await;
                    }
                    Ok(Err(e)) => return Err(fail(without_source_locations(&e.to_string()))),
                    Err(_) => return Err(fail(format!("no answer within {} s", CONNECT_TIMEOUT.as_secs()))),
                }
            }
        })
    }

    fn join<'a>(
        session: &'a str,
        role: &'a str,
        link: Link,
        address: Address,
    ) -> BoxFuture<'a, Result<Self, BusError>> {
        Box::pin(async move {
            let identity = link.identity(role, address.instance());
            let (identity, config) = match identity {
                Ok(identity) => (identity, config::client(&link)),
                Err(reason) => (None, Err(reason)),
            };
            Self::open(session, role, link.endpoint, config, address, identity).await
        })
    }

    fn open<'a>(
        session: &'a str,
        role: &'a str,
        endpoint: String,
        config: Result<zenoh::Config, String>,
        address: Address,
        identity: Option<Identity>,
    ) -> BoxFuture<'a, Result<Self, BusError>> {
        Box::pin(async move {
            let fail = |reason: String| BusError::Open { session: session.into(), endpoint: endpoint.clone(), reason };
            let config = config.map_err(&fail)?;
            let opening = tokio::time::timeout(CONNECT_TIMEOUT, zenoh::open(config));
            let zenoh = match opening.await {
                Ok(Ok(zenoh)) => zenoh,
                Ok(Err(e)) => return Err(fail(without_source_locations(&e.to_string()))),
                Err(_) => return Err(fail(format!("no answer within {} s", CONNECT_TIMEOUT.as_secs()))),
            };
            crate::trace::start(role);
            let inner = Inner {
                zenoh,
                session: session.into(),
                role: role.into(),
                counters: Counters::default(),
                address,
                epochs: Epochs::default(),
                identity,
                quotas: Quotas::default(),
                pending: PendingRequests::default(),
                sequences: Sequences::default(),
                nodes: tokio::sync::Mutex::new(None),
            };
            Ok(Self { inner: Arc::new(inner) })
        })
    }

    /// Name of the session.
    #[must_use]
    pub fn session(&self) -> &str {
        &self.inner.session
    }

    /// Role under which this process sends.
    #[must_use]
    pub fn role(&self) -> &str {
        &self.inner.role
    }

    /// Counters of this connection.
    #[must_use]
    pub fn counters(&self) -> &Counters {
        &self.inner.counters
    }

    /// Counts a message that its receiver has refused for its content, such as one about another instance than its sender.
    pub fn refuse_message(&self, row: &'static str) {
        self.inner.counters.refuse(row);
    }

    /// Disconnects within two seconds. Unsent messages are lost after that.
    pub fn close(&self) -> BoxFuture<'_, ()> {
        Box::pin(async {
            close(self.inner.nodes.lock().await.take()).await;
            let _ = tokio::time::timeout(CLOSE_TIMEOUT, self.inner.zenoh.close()).await;
            crate::trace::finish().await;
        })
    }

    /// Checks that this process may declare or publish a row of `role`.
    fn check_role(&self, role: &str, name: &str) -> Result<(), String> {
        if role == sg_proto::keys::ANY || role == self.role() {
            return Ok(());
        }
        Err(format!("`{name}` belongs to `{role}`, this process serves `{}`", self.role()))
    }

    fn counted<T>(&self, key: &'static str, outcome: Result<T, Fault>) -> Result<T, Fault> {
        if outcome.is_err() {
            self.inner.counters.refuse(key);
        }
        outcome
    }
}

/// Closes a router of other machines within two seconds. Returns whether there was one.
async fn close(router: Option<zenoh::Session>) -> bool {
    let Some(router) = router else { return false };
    let _ = tokio::time::timeout(CLOSE_TIMEOUT, router.close()).await;
    true
}

/// Removes the `at file.rs:line` parts from an error text of the bus.
fn without_source_locations(text: &str) -> String {
    let words: Vec<&str> = text.split_whitespace().collect();
    let mut kept: Vec<&str> = Vec::new();
    for word in words {
        let is_location = word
            .trim_end_matches('.')
            .rsplit_once(':')
            .is_some_and(|(file, line)| file.ends_with(".rs") && line.chars().all(|c| c.is_ascii_digit()));
        if is_location {
            kept.pop_if(|before| *before == "at");
        } else {
            kept.push(word);
        }
    }
    kept.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn source_locations_are_removed_from_bus_errors() {
        let text = "Unable to connect to any of [x]!  at src/net/orchestrator.rs:447. - Caused by refused at b.rs:7.";
        assert_eq!(without_source_locations(text), "Unable to connect to any of [x]! - Caused by refused");
    }
}
