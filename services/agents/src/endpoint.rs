//! Where a language model answers, and whether a prompt may go there.

use std::fmt;
use std::net::IpAddr;
use std::path::PathBuf;

use reqwest::Url;

/// An address that a prompt may be sent to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Endpoint {
    /// By HTTP, with a host; `https` goes through TLS.
    Url(Url),
    /// A unix socket on this machine.
    Unix(PathBuf),
}

/// An address that is none, or that a prompt must not be sent to.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Unfit {
    /// Not understood.
    #[error("`endpoint`: `{0}` is no address; write http://127.0.0.1:PORT, https://HOST/PATH or unix:/PATH")]
    Form(String),
    /// Something secret or superfluous in it. The address itself is not repeated: it may hold a password.
    #[error("`endpoint` holds a user, a password or a query; name a key by `key_env` and leave the rest out")]
    Extra,
    /// Readable on the way.
    #[error("`endpoint`: {0} is beyond this machine and not encrypted; use https, or set `insecure = true`")]
    Open(String),
    /// A socket's path that depends on where a process was started.
    #[error("`endpoint`: `{0}` is no absolute path; write unix:/PATH")]
    Relative(String),
}

impl Endpoint {
    /// Reads an address. One beyond this machine has to be encrypted, unless `insecure` says that it need not.
    ///
    /// # Errors
    /// [`Unfit`].
    pub fn parse(text: &str, insecure: bool) -> Result<Self, Unfit> {
        if let Some(path) = text.strip_prefix("unix:") {
            let path = PathBuf::from(path.strip_prefix("//").unwrap_or(path));
            return if path.is_absolute() { Ok(Self::Unix(path)) } else { Err(Unfit::Relative(text.to_owned())) };
        }
        let url = Url::parse(text).map_err(|_| Unfit::Form(text.to_owned()))?;
        if !url.username().is_empty() || url.password().is_some() || url.query().is_some() || url.fragment().is_some() {
            return Err(Unfit::Extra);
        }
        let host = url.host_str().unwrap_or_default();
        if host.is_empty() || !matches!(url.scheme(), "http" | "https") {
            return Err(Unfit::Form(text.to_owned()));
        }
        if url.scheme() == "http" && !is_loopback(host) && !insecure {
            return Err(Unfit::Open(host.to_owned()));
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
    fn this_machine_needs_no_encryption_and_others_do() {
        for here in ["http://127.0.0.1:8080/v1", "http://localhost:1", "http://[::1]:9", "http://127.3.2.1"] {
            assert!(matches!(Endpoint::parse(here, false), Ok(Endpoint::Url(_))), "{here}");
        }
        for there in ["http://10.0.0.7:8080/v1", "http://example.com", "http://127.0.0.1.example.com", "http://[::2]"] {
            assert!(matches!(Endpoint::parse(there, false), Err(Unfit::Open(_))), "{there}");
            assert!(Endpoint::parse(there, true).is_ok(), "{there}");
        }
        assert!(Endpoint::parse("https://example.com/v1", false).is_ok());
    }

    #[test]
    fn sockets_have_absolute_paths() {
        let socket = Ok(Endpoint::Unix("/run/model.sock".into()));
        assert_eq!(Endpoint::parse("unix:/run/model.sock", false), socket);
        assert_eq!(Endpoint::parse("unix:///run/model.sock", false), socket);
        assert!(matches!(Endpoint::parse("unix:model.sock", false), Err(Unfit::Relative(_))));
    }

    #[test]
    fn what_is_no_address_or_holds_a_secret_is_refused() {
        for bad in ["", "localhost:8080", "ftp://127.0.0.1", "http://", "model"] {
            assert!(matches!(Endpoint::parse(bad, true), Err(Unfit::Form(_))), "{bad}");
        }
        for bad in ["https://me:secret@example.com", "https://example.com/v1?key=secret"] {
            let unfit = Endpoint::parse(bad, true).unwrap_err();
            assert_eq!(unfit, Unfit::Extra, "{bad}");
            assert!(!unfit.to_string().contains("secret"));
        }
    }
}
