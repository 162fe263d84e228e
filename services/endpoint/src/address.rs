//! Addresses of models, and the rule that data leave this machine only encrypted.

use std::fmt;
use std::net::IpAddr;
use std::path::PathBuf;

use reqwest::Url;

/// The address of a model in another program.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Endpoint {
    /// An HTTP address with a host. `https` uses TLS.
    Url(Url),
    /// A unix socket on this machine.
    Unix(PathBuf),
}

/// An invalid endpoint.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum EndpointError {
    /// The text is not an address.
    #[error("`endpoint`: `{0}` is not an address; write http://127.0.0.1:PORT, https://HOST/PATH or unix:/PATH")]
    Malformed(String),
    /// The address holds a user, a password or a query. The message does not repeat it: it may hold a secret.
    #[error("`endpoint` holds a user, a password or a query; remove it, and name an API key with `key_env`")]
    Credentials,
    /// The address is on another machine and not encrypted.
    #[error(
        "`endpoint`: {0} is another machine and the connection is not encrypted; use https or set `insecure = true`"
    )]
    Unencrypted(String),
    /// The path of a unix socket is relative.
    #[error("`endpoint`: `{0}` is not an absolute path; write unix:/PATH")]
    RelativePath(String),
}

impl Endpoint {
    /// Whether the address is on this machine.
    #[must_use]
    pub fn is_local(&self) -> bool {
        match self {
            Self::Url(url) => url.host_str().is_some_and(is_loopback),
            Self::Unix(_) => true,
        }
    }

    /// Parses an address. Other machines need `https`, unless `insecure` is set.
    ///
    /// # Errors
    /// [`EndpointError`].
    pub fn parse(text: &str, insecure: bool) -> Result<Self, EndpointError> {
        if let Some(path) = text.strip_prefix("unix:") {
            let path = PathBuf::from(path.strip_prefix("//").unwrap_or(path));
            return if path.is_absolute() {
                Ok(Self::Unix(path))
            } else {
                Err(EndpointError::RelativePath(text.to_owned()))
            };
        }
        let url = Url::parse(text).map_err(|_| EndpointError::Malformed(text.to_owned()))?;
        if !url.username().is_empty() || url.password().is_some() || url.query().is_some() || url.fragment().is_some() {
            return Err(EndpointError::Credentials);
        }
        let host = url.host_str().unwrap_or_default();
        if host.is_empty() || !matches!(url.scheme(), "http" | "https") {
            return Err(EndpointError::Malformed(text.to_owned()));
        }
        if url.scheme() == "http" && !is_loopback(host) && !insecure {
            return Err(EndpointError::Unencrypted(host.to_owned()));
        }
        Ok(Self::Url(url))
    }
}

impl fmt::Display for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Url(url) => f.write_str(url.as_str()),
            Self::Unix(path) => write!(f, "unix:{}", path.display()),
        }
    }
}

fn is_loopback(host: &str) -> bool {
    let address = host.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>();
    host.eq_ignore_ascii_case("localhost") || address.is_ok_and(|a| a.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_other_machines_need_encryption() {
        for here in ["http://127.0.0.1:8080/v1", "http://localhost:1", "http://[::1]:9", "http://127.3.2.1"] {
            assert!(matches!(Endpoint::parse(here, false), Ok(Endpoint::Url(_))), "{here}");
        }
        for there in ["http://10.0.0.7:8080/v1", "http://example.com", "http://127.0.0.1.example.com", "http://[::2]"] {
            assert!(matches!(Endpoint::parse(there, false), Err(EndpointError::Unencrypted(_))), "{there}");
            assert!(Endpoint::parse(there, true).is_ok(), "{there}");
        }
        assert!(Endpoint::parse("https://example.com/v1", false).is_ok());
    }

    #[test]
    fn sockets_have_absolute_paths() {
        let socket = Ok(Endpoint::Unix("/run/model.sock".into()));
        assert_eq!(Endpoint::parse("unix:/run/model.sock", false), socket);
        assert_eq!(Endpoint::parse("unix:///run/model.sock", false), socket);
        assert!(matches!(Endpoint::parse("unix:model.sock", false), Err(EndpointError::RelativePath(_))));
    }

    #[test]
    fn malformed_addresses_and_credentials_are_refused() {
        for bad in ["", "localhost:8080", "ftp://127.0.0.1", "http://", "model"] {
            assert!(matches!(Endpoint::parse(bad, true), Err(EndpointError::Malformed(_))), "{bad}");
        }
        for bad in ["https://me:secret@example.com", "https://example.com/v1?key=secret"] {
            let error = Endpoint::parse(bad, true).unwrap_err();
            assert_eq!(error, EndpointError::Credentials, "{bad}");
            assert!(!error.to_string().contains("secret"));
        }
    }
}
