//! Messages as bytes, well formed or not: for tests of what services refuse, and for looking at a session from outside.

use std::time::Duration;

use serde::Deserialize;
use sg_proto::keys;
use zenoh::query::QueryTarget;

use super::{Bus, BusError};

/// What is sent, byte for byte.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Raw {
    /// Encoding, such as `application/protobuf;supergaussian.scene.v1.Command`.
    pub encoding: String,
    /// Payload; absent for a question without one.
    pub payload: Option<Vec<u8>>,
    /// Attachment, where an envelope is expected; absent for none.
    pub attachment: Option<Vec<u8>>,
}

/// What came back.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Heard {
    /// A reply.
    Reply {
        /// Encoding.
        encoding: String,
        /// Payload.
        payload: Vec<u8>,
    },
    /// A refusal.
    Refusal {
        /// Encoding.
        encoding: String,
        /// Payload.
        payload: Vec<u8>,
    },
    /// Nothing, within the time: nobody is there, or who is there is silent.
    Nothing,
}

/// A row that somebody answers, as the router sees it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Declared {
    /// Key expression.
    pub key: String,
    /// Connections of those who have declared it.
    pub clients: Vec<String>,
}

/// How the router tells of a declaration.
#[derive(Deserialize)]
struct Sources {
    #[serde(default)]
    clients: Vec<String>,
}

/// How long the router may take to list what is declared.
const LISTING: Duration = Duration::from_secs(2);

impl Bus {
    /// Puts a question byte for byte. `segment` stands in place of the role.
    pub async fn ask_raw(&self, segment: &str, name: &str, raw: &Raw, within: Duration) -> Heard {
        let key = keys::key(self.session(), segment, name);
        let mut get = self.inner.zenoh.get(&key).target(QueryTarget::BestMatching).timeout(within);
        if let Some(payload) = &raw.payload {
            get = get.payload(payload.clone()).encoding(raw.encoding.as_str());
        }
        if let Some(attachment) = &raw.attachment {
            get = get.attachment(attachment.clone());
        }
        let Ok(replies) = get.await else { return Heard::Nothing };
        // The bus ends a question by itself at its time-out, but its clock is coarse.
        let first = tokio::time::timeout(within + Duration::from_millis(500), replies.recv_async()).await;
        let Ok(Ok(reply)) = first else { return Heard::Nothing };
        match reply.result() {
            Ok(sample) => Heard::Reply {
                encoding: sample.encoding().to_string(),
                payload: sample.payload().to_bytes().into_owned(),
            },
            // The bus reports its own time-out as a refusal in its own encoding.
            Err(error) if crate::wire::message_name(error.encoding()).is_none() => Heard::Nothing,
            Err(error) => Heard::Refusal {
                encoding: error.encoding().to_string(),
                payload: error.payload().to_bytes().into_owned(),
            },
        }
    }

    /// Publishes byte for byte, under any key of the session.
    ///
    /// # Errors
    /// [`BusError::Declare`] if the bus does not take it.
    pub async fn put_raw(&self, segment: &str, name: &str, raw: &Raw) -> Result<(), BusError> {
        let key = keys::key(self.session(), segment, name);
        let mut put =
            self.inner.zenoh.put(&key, raw.payload.clone().unwrap_or_default()).encoding(raw.encoding.as_str());
        if let Some(attachment) = &raw.attachment {
            put = put.attachment(attachment.clone());
        }
        put.await.map_err(|e| BusError::Declare { key, reason: e.to_string() })
    }

    /// The rows that processes of this session answer under their roles, as the router sees it. What they answer under their
    /// instances it does not tell.
    pub async fn declared_rows(&self) -> Vec<Declared> {
        let selector = format!("@/*/router/queryable/{}/{}/**", keys::ROOT, self.session());
        let mut all = Vec::new();
        let Ok(replies) = self.inner.zenoh.get(selector).timeout(LISTING).await else { return all };
        while let Ok(Ok(reply)) = tokio::time::timeout(LISTING, replies.recv_async()).await {
            let Ok(sample) = reply.result() else { continue };
            let listed = sample.key_expr().as_str();
            let Some(at) = listed.find(&format!("/{}/{}/", keys::ROOT, self.session())) else { continue };
            let key = listed.get(at + 1..).unwrap_or_default().to_owned();
            if let Ok(Sources { clients }) = serde_json::from_slice(&sample.payload().to_bytes()) {
                all.push(Declared { key, clients });
            }
        }
        all
    }
}
