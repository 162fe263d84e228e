//! Ends of the validity of certificates, and the warning before one is reached.

use std::path::Path;
use std::time::{Duration, SystemTime};

use sg_input::file::read_text;
use sg_input::limits::SMALL_TEXT_BYTES;
use sg_runtime::bus::CertificateContent;

use crate::terminal::{self, Failure};

/// A day.
const DAY: Duration = Duration::from_secs(24 * 3600);
/// Time before its end at which a certificate is worth a warning.
const WARNING: Duration = Duration::from_secs(30 * 24 * 3600);

/// The end of the validity of a certificate in PEM form.
pub(crate) fn expiry(pem: &str) -> Result<SystemTime, String> {
    CertificateContent::of_pem(pem.as_bytes()).map(|content| content.expires)
}

/// Warns of certificates that end within thirty days.
///
/// # Errors
/// A file that cannot be read or has no certificate, or a certificate that has expired.
pub(crate) fn check_expiry<'a>(files: impl IntoIterator<Item = &'a Path>) -> Result<(), Failure> {
    for file in files {
        let refuse = |problem: String| Failure::Input(format!("{}: {problem}", file.display()));
        let pem = read_text(file, SMALL_TEXT_BYTES).map_err(|e| refuse(e.to_string()))?;
        let end = expiry(&pem).map_err(refuse)?;
        if let Some(warning) = time_left(end, SystemTime::now()).map_err(refuse)? {
            terminal::print_status(&format!("warning: {}: {warning}", file.display()));
        }
    }
    Ok(())
}

/// The warning of a certificate with this end of validity, if its end is near.
fn time_left(end: SystemTime, now: SystemTime) -> Result<Option<String>, String> {
    let days = |time: Duration| time.as_secs() / DAY.as_secs();
    let counted = |number: u64| if number == 1 { "1 day".to_owned() } else { format!("{number} days") };
    match end.duration_since(now) {
        Ok(left) if left > WARNING => Ok(None),
        Ok(left) => Ok(Some(format!(
            "expires in {}; renew it with `supergaussian certificates` on the machine of the authority",
            counted(days(left))
        ))),
        Err(past) => Err(format!(
            "expired {} ago; renew it with `supergaussian certificates` on the machine of the authority",
            counted(days(past.duration()))
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_near_end_is_a_warning_and_a_past_one_an_error() {
        let now = SystemTime::UNIX_EPOCH + 20_000 * DAY;
        assert_eq!(time_left(now + 31 * DAY, now), Ok(None));
        let soon = time_left(now + 12 * DAY, now).unwrap().unwrap();
        assert!(soon.starts_with("expires in 12 days; renew it"), "{soon}");
        let past = time_left(now - DAY, now).unwrap_err();
        assert!(past.starts_with("expired 1 day ago; renew it"), "{past}");
    }

    #[test]
    fn a_file_without_a_certificate_is_an_error_with_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("home.pem");
        assert!(check_expiry([file.as_path()]).is_err());
        std::fs::write(&file, "notes").unwrap();
        assert!(matches!(check_expiry([file.as_path()]), Err(Failure::Input(text)) if text.contains("home.pem")));
    }
}
