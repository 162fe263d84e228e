//! The bus as services see it: ask, answer, publish, follow, newest value, liveliness.
//!
//! Every receive path is bounded: a request that finds its queue full is refused at once, a stream reader that falls
//! behind loses the oldest messages, and both are counted.

mod access;
mod alive;
mod ask;
mod config;
mod counters;
mod link;
mod place;
mod raw;
mod route;
mod serve;
mod slot;
mod stream;

use std::future::Future;
use std::path::Path;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

pub use alive::{Alive, Liveliness};
pub use counters::Counters;
pub use link::{Certificates, Guest, Link, Listen, TLS_PREFIX, endpoint_of};
pub use raw::{Declared, Heard, Raw};
pub use serve::Serving;
pub use slot::Owned;
pub use stream::{Following, Seen, Watching};

use crate::fault::Fault;
use place::{Epochs, Place};
use serve::Pending;
use stream::Sequences;

/// A future whose code stays in this package. That of an `async fn` is compiled anew into every executable that awaits it,
/// and with it its share of zenoh: minutes of building, megabytes each.
pub type Boxed<'a, T> = Pin<Box<dyn Future<Output = T> + Send + 'a>>;

/// A connection to one session's bus, under one role. Cheap to clone.
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
    place: Place,
    epochs: Epochs,
    pending: Pending,
    sequences: Sequences,
}

/// A bus that could not be joined or opened.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// The endpoint could not be reached or opened.
    #[error("bus of session `{session}` at {endpoint}: {reason}")]
    Open {
        /// Session.
        session: String,
        /// Endpoint.
        endpoint: String,
        /// What the bus said.
        reason: String,
    },
    /// A key could not be declared.
    #[error("key `{key}` could not be declared: {reason}")]
    Declare {
        /// The key expression.
        key: String,
        /// What the bus said, or why it was not tried.
        reason: String,
    },
}

/// How long a client tries to reach the router before it gives up.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);

impl Bus {
    /// Joins a session's bus as a client of the router that its supervisor embeds.
    ///
    /// # Errors
    /// [`BusError::Open`] if the router does not answer within five seconds, or certificates can't be used.
    pub async fn connect(session: &str, role: &str, link: impl Into<Link>) -> Result<Self, BusError> {
        Self::join(session, role, link.into(), Place::of_role()).await
    }

    /// Joins a session's bus as one instance of a role, which it serves under this epoch; with `standby` it serves under its
    /// instance alone until [`Bus::promote`].
    ///
    /// # Errors
    /// As [`Bus::connect`].
    pub async fn connect_instance(
        session: &str,
        role: &str,
        instance: &str,
        epoch: u64,
        standby: bool,
        link: impl Into<Link>,
    ) -> Result<Self, BusError> {
        Self::join(session, role, link.into(), Place::of_instance(instance, epoch, standby)).await
    }

    /// Opens a session's router on a unix socket, and to other machines where `listen` says so; everybody else is a client
    /// of it.
    ///
    /// # Errors
    /// [`BusError::Open`] if the socket or the address cannot be opened, or certificates can't be used.
    pub async fn open_router(
        session: &str,
        role: &str,
        socket: &Path,
        listen: Option<&Listen>,
    ) -> Result<Self, BusError> {
        let endpoint = listen.map_or_else(|| endpoint_of(socket), |l| l.endpoint.clone());
        let config = config::router(session, socket, listen);
        Self::open(session, role, endpoint, config, Place::of_role()).await
    }

    fn join<'a>(session: &'a str, role: &'a str, link: Link, place: Place) -> Boxed<'a, Result<Self, BusError>> {
        Box::pin(async move {
            let config = config::client(&link);
            Self::open(session, role, link.endpoint, config, place).await
        })
    }

    fn open<'a>(
        session: &'a str,
        role: &'a str,
        endpoint: String,
        config: Result<zenoh::Config, String>,
        place: Place,
    ) -> Boxed<'a, Result<Self, BusError>> {
        Box::pin(async move {
            let fail = |reason: String| BusError::Open { session: session.into(), endpoint: endpoint.clone(), reason };
            let config = config.map_err(&fail)?;
            let opening = tokio::time::timeout(CONNECT_TIMEOUT, zenoh::open(config));
            let zenoh = match opening.await {
                Ok(Ok(zenoh)) => zenoh,
                Ok(Err(e)) => return Err(fail(without_source(&e.to_string()))),
                Err(_) => return Err(fail(format!("no answer within {} s", CONNECT_TIMEOUT.as_secs()))),
            };
            crate::trace::start(role);
            let inner = Inner {
                zenoh,
                session: session.into(),
                role: role.into(),
                counters: Counters::default(),
                place,
                epochs: Epochs::default(),
                pending: Pending::default(),
                sequences: Sequences::default(),
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

    /// Leaves the bus. Bounded in time; what is still unsent then is lost, as it would be with the process.
    pub fn close(&self) -> Boxed<'_, ()> {
        Box::pin(async {
            let _ = tokio::time::timeout(Duration::from_secs(2), self.inner.zenoh.close()).await;
            crate::trace::finish().await;
        })
    }

    /// A row may be declared or sent under by its own role alone.
    fn own_row(&self, role: &str, name: &str) -> Result<(), String> {
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

/// An error of the bus without the places in its source that it tells of.
fn without_source(text: &str) -> String {
    let words: Vec<&str> = text.split_whitespace().collect();
    let mut kept: Vec<&str> = Vec::new();
    for word in words {
        let is_place = word
            .trim_end_matches('.')
            .rsplit_once(':')
            .is_some_and(|(file, line)| file.ends_with(".rs") && line.chars().all(|c| c.is_ascii_digit()));
        if is_place {
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
    fn an_error_of_the_bus_is_told_without_its_source() {
        let told = "Unable to connect to any of [x]!  at src/net/orchestrator.rs:447. - Caused by refused at b.rs:7.";
        assert_eq!(without_source(told), "Unable to connect to any of [x]! - Caused by refused");
    }
}
