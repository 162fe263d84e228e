//! Messages as bytes, well formed or not: for conformance tests and for inspecting a session from outside.

use std::time::Duration;

use prost::Name as _;
use serde::Deserialize;
use sg_proto::bus::Error;
use sg_proto::keys;
use zenoh::query::{QueryTarget, ReplyKeyExpr};

use super::{Bus, BusError};

/// A message to send, byte for byte.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RawMessage {
    /// Encoding, such as `application/protobuf;supergaussian.scene.v1.Command`.
    pub encoding: String,
    /// Payload; absent for a query of a retained value.
    pub payload: Option<Vec<u8>>,
    /// Attachment in place of an encoded envelope; absent for none.
    pub attachment: Option<Vec<u8>>,
}

/// The outcome of a raw query.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RawReply {
    /// A reply.
    Reply {
        /// Encoding.
        encoding: String,
        /// Payload.
        payload: Vec<u8>,
    },
    /// An error reply.
    Refusal {
        /// Encoding.
        encoding: String,
        /// Payload.
        payload: Vec<u8>,
    },
    /// No reply in time.
    Nothing,
}

/// A declared key, as the router reports it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DeclaredKey {
    /// Key expression.
    pub key: String,
    /// Ids of the connections that have declared it.
    pub clients: Vec<String>,
}

/// Declaration of a key in the router's admin space.
#[derive(Deserialize)]
struct Declaration {
    #[serde(default)]
    clients: Vec<String>,
}

/// Longest time for the router's list of declarations.
const LIST_TIMEOUT: Duration = Duration::from_secs(2);

impl Bus {
    /// Sends a query byte for byte. `segment` replaces the role in the key, also on a node.
    pub async fn ask_raw(&self, segment: &str, name: &str, raw: &RawMessage, timeout: Duration) -> RawReply {
        let key = keys::key(self.session(), segment, name);
        let mut get = self.inner.zenoh.get(&key).target(QueryTarget::BestMatching).timeout(timeout);
        // A process on a node replies under its own key.
        get = get.accept_replies(ReplyKeyExpr::Any);
        if let Some(payload) = &raw.payload {
            get = get.payload(payload.clone()).encoding(raw.encoding.as_str());
        }
        if let Some(attachment) = &raw.attachment {
            get = get.attachment(attachment.clone());
        }
        let Ok(replies) = get.await else { return RawReply::Nothing };
        // The bus also ends a query at its timeout, but its clock is coarse.
        let first = tokio::time::timeout(timeout + Duration::from_millis(500), replies.recv_async()).await;
        let Ok(Ok(reply)) = first else { return RawReply::Nothing };
        match reply.result() {
            Ok(sample) => {
                let (encoding, payload) = (sample.encoding().to_string(), sample.payload().to_bytes().into_owned());
                // So a process on a node sends its errors.
                let is_error = crate::wire::message_name(sample.encoding()).is_some_and(|n| n == Error::full_name());
                if is_error { RawReply::Refusal { encoding, payload } } else { RawReply::Reply { encoding, payload } }
            }
            // The bus reports its own timeout as an error in its own encoding.
            Err(error) if crate::wire::message_name(error.encoding()).is_none() => RawReply::Nothing,
            Err(error) => RawReply::Refusal {
                encoding: error.encoding().to_string(),
                payload: error.payload().to_bytes().into_owned(),
            },
        }
    }

    /// Publishes a message byte for byte, under any key of the session.
    ///
    /// # Errors
    /// [`BusError::Declare`] if the bus refuses it.
    pub async fn put_raw(&self, segment: &str, name: &str, raw: &RawMessage) -> Result<(), BusError> {
        let key = keys::key(self.session(), segment, name);
        let mut put =
            self.inner.zenoh.put(&key, raw.payload.clone().unwrap_or_default()).encoding(raw.encoding.as_str());
        if let Some(attachment) = &raw.attachment {
            put = put.attachment(attachment.clone());
        }
        put.await.map_err(|e| BusError::Declare { key, reason: e.to_string() })
    }

    /// Lists the keys that processes of this session answer under their roles, as the router reports them.
    ///
    /// Keys under instances are not listed.
    pub async fn declared_keys(&self) -> Vec<DeclaredKey> {
        let selector = format!("@/*/router/queryable/{}/{}/**", keys::ROOT, self.session());
        let mut all = Vec::new();
        let Ok(replies) = self.inner.zenoh.get(selector).timeout(LIST_TIMEOUT).await else { return all };
        while let Ok(Ok(reply)) = tokio::time::timeout(LIST_TIMEOUT, replies.recv_async()).await {
            let Ok(sample) = reply.result() else { continue };
            let listed = sample.key_expr().as_str();
            let Some(at) = listed.find(&format!("/{}/{}/", keys::ROOT, self.session())) else { continue };
            let key = listed.get(at + 1..).unwrap_or_default().to_owned();
            if let Ok(Declaration { clients }) = serde_json::from_slice(&sample.payload().to_bytes()) {
                all.push(DeclaredKey { key, clients });
            }
        }
        all
    }
}
