//! Names of services, roles and nodes.

/// Longest name of a service, bytes. The name of an instance appends a number.
pub(super) const MAX_SERVICE_NAME: usize = 100;

/// Whether a name is valid: 1 to [`MAX_SERVICE_NAME`] ASCII letters, digits, `-` or `_`.
pub(super) fn is_name(name: &str) -> bool {
    (1..=MAX_SERVICE_NAME).contains(&name.len())
        && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_')
}
