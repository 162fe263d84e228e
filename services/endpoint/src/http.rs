//! HTTP client for servers that speak OpenAI's protocols.

use reqwest::header::{AUTHORIZATION, CONTENT_TYPE, HeaderValue};
use reqwest::multipart::{self, Form};
use reqwest::redirect::Policy;
use reqwest::{RequestBuilder, Url};
use serde_json::Value;

use crate::CONNECT;
use crate::address::Endpoint;
use crate::api_key::ApiKey;
use crate::error::{CallError, ClientError, error_chain, one_line};

/// A client of one HTTP endpoint.
pub struct HttpClient {
    client: reqwest::Client,
    endpoint: Url,
    key: Option<ApiKey>,
}

/// A part of a form.
#[derive(Debug, Clone)]
pub enum Part {
    /// A field.
    Text {
        /// Its name.
        name: &'static str,
        /// Its value.
        value: String,
    },
    /// A file.
    File {
        /// Name of the field.
        name: &'static str,
        /// Name of the file.
        file_name: &'static str,
        /// Media type of the content.
        media_type: &'static str,
        /// The content.
        bytes: Vec<u8>,
    },
}

impl HttpClient {
    /// A client that connects with its first request, so the server may start later.
    ///
    /// # Errors
    /// [`ClientError`]: the endpoint is a socket, or the client cannot be created.
    pub fn new(endpoint: &Endpoint, key: Option<ApiKey>) -> Result<Self, ClientError> {
        // The call fails if the provider is installed already; it is the same one.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let Endpoint::Url(endpoint) = endpoint.clone() else { return Err(ClientError::Socket) };
        // Data and the key go only to the configured endpoint: no proxy, no redirect.
        let client = reqwest::Client::builder().no_proxy().redirect(Policy::none()).connect_timeout(CONNECT).build();
        let client = client.map_err(|e| ClientError::Http(error_chain(&e)))?;
        Ok(Self { client, endpoint, key })
    }

    /// Sends a JSON text to a path below the endpoint. Returns the body of the answer, of at most `most` bytes.
    ///
    /// # Errors
    /// [`CallError`], without the key.
    pub async fn post_json(&self, path: &str, json: String, most: usize) -> Result<Vec<u8>, CallError> {
        let request = self.post(path).header(CONTENT_TYPE, "application/json").body(json);
        self.answer(request, most).await
    }

    /// Sends a form of several parts. Returns the body of the answer, of at most `most` bytes.
    ///
    /// # Errors
    /// [`CallError`], without the key.
    pub async fn post_form(&self, path: &str, parts: Vec<Part>, most: usize) -> Result<Vec<u8>, CallError> {
        let mut form = Form::new();
        for part in parts {
            form = match part {
                Part::Text { name, value } => form.text(name, value),
                Part::File { name, file_name, media_type, bytes } => {
                    let mut headers = reqwest::header::HeaderMap::new();
                    headers.insert(CONTENT_TYPE, HeaderValue::from_static(media_type));
                    form.part(name, multipart::Part::bytes(bytes).file_name(file_name).headers(headers))
                }
            };
        }
        self.answer(self.post(path).multipart(form), most).await
    }

    fn post(&self, path: &str) -> RequestBuilder {
        let mut url = self.endpoint.clone();
        if let Ok(mut segments) = url.path_segments_mut() {
            segments.pop_if_empty().extend(path.split('/'));
        }
        let request = self.client.post(url);
        match &self.key {
            Some(key) => request.header(AUTHORIZATION, key.header()),
            None => request,
        }
    }

    async fn answer(&self, request: RequestBuilder, most: usize) -> Result<Vec<u8>, CallError> {
        let unavailable = |e: reqwest::Error| CallError::Unavailable(self.redacted(&error_chain(&e.without_url())));
        let mut response = request.send().await.map_err(unavailable)?;
        let status = response.status();
        let mut body = Vec::new();
        while let Some(chunk) = response.chunk().await.map_err(unavailable)? {
            if body.len() + chunk.len() > most {
                return Err(CallError::Invalid(format!("it has over {most} bytes")));
            }
            body.extend_from_slice(&chunk);
        }
        if status.is_success() { Ok(body) } else { Err(self.error(status.as_u16(), &body)) }
    }

    /// The error in the body of an answer with another status.
    fn error(&self, status: u16, body: &[u8]) -> CallError {
        // Redacted before it is cut, so that no part of a key is left.
        let text = one_line(&self.redacted(&status_text(status, body)));
        // Timeouts, rate limits and server errors are transient.
        let is_transient = status == 408 || status == 429 || status >= 500;
        if is_transient { CallError::Unavailable(text) } else { CallError::Refused(text) }
    }

    /// A text without the key, in case the server repeated it.
    #[must_use]
    pub fn redacted(&self, text: &str) -> String {
        self.key.as_ref().map_or_else(|| text.to_owned(), |key| key.redact(text))
    }
}

fn status_text(status: u16, body: &[u8]) -> String {
    let json: Option<Value> = serde_json::from_slice(body).ok();
    let message = json.as_ref().and_then(|b| {
        let error = b.get("error")?;
        error.get("message").unwrap_or(error).as_str()
    });
    let message = message.map_or_else(String::new, |m| format!(": {m}"));
    format!("status {status}{message}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_transient_by_status() {
        let endpoint = Endpoint::parse("http://127.0.0.1:1/v1", false).unwrap();
        let client = HttpClient::new(&endpoint, None).unwrap();
        let body = br#"{"error": {"message": "no such\nmodel", "type": "x"}}"#;
        assert_eq!(client.error(404, body), CallError::Refused("status 404: no such model".into()));
        assert_eq!(client.error(503, b"<html>"), CallError::Unavailable("status 503".into()));
        let slow = br#"{"error": "slow down"}"#;
        assert_eq!(client.error(429, slow), CallError::Unavailable("status 429: slow down".into()));
        let socket = Endpoint::parse("unix:/s", false).unwrap();
        assert_eq!(HttpClient::new(&socket, None).err(), Some(ClientError::Socket));
    }
}
