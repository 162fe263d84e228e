//! `capture`: one picture of the scene of a running stack.

use std::path::{Path, PathBuf};
use std::time::Duration;

use sg_formats::staged_file::{self, StagedFile};
use sg_proto::keys;
use sg_proto::render::CaptureRequest;
use sg_runtime::blobs::{BlobError, Blobs, StoredFile};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_runtime::session::SessionDir;

use crate::supervisor_client;
use crate::terminal::{self, CommandResult, Failure, format_time};

/// Longest time to draw, and to receive each part of the picture.
const TIMEOUT: Duration = Duration::from_secs(60);

#[derive(Debug, clap::Args)]
pub(crate) struct CaptureArgs {
    /// Output file: `.png`, or `.npy` for float32 (height, width, 4) with RGB and coverage
    #[arg(value_name = "OUT")]
    out: PathBuf,
    /// Width in pixels
    #[arg(long, default_value_t = 1024)]
    width: u32,
    /// Height in pixels
    #[arg(long, default_value_t = 1024)]
    height: u32,
    /// Highlight the selection
    #[arg(long)]
    highlight: bool,
}

pub(crate) async fn capture(session: Option<&str>, arguments: &CaptureArgs) -> CommandResult {
    let CaptureArgs { out, width, height, highlight } = arguments;
    let extension = out.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    let floats = match extension.as_deref() {
        Some("png") => false,
        Some("npy") => true,
        _ => return Err(Failure::Input(format!("{}: the name must end with .png or .npy", out.display()))),
    };
    staged_file::check_outputs([out.as_path()], []).map_err(|e| Failure::Input(e.to_string()))?;
    let (session, bus) = supervisor_client::join(session).await?;
    let context = Context::root().deadline_in(TIMEOUT);
    let request =
        CaptureRequest { width: *width, height: *height, highlight_selection: *highlight, ..CaptureRequest::default() };
    let asked = bus.ask_identified(&keys::CAPTURE, &request, &context).await;
    let (frame, sender) = asked.map_err(supervisor_client::refused)?;
    let (path, hash) = if floats { (&frame.npy_path, &frame.hash) } else { (&frame.png_path, &frame.png_hash) };
    keep_picture(&bus, &session, StoredFile { path, hash, sender: sender.as_ref() }, out).await?;
    bus.close().await;
    terminal::print_line(&format!(
        "{}: {} x {}, revision {}, drawn in {}",
        out.display(),
        frame.width,
        frame.height,
        frame.revision,
        format_time(frame.render_ms)
    ));
    Ok(())
}

/// Copies a picture of the capture process, from this machine or another one, and checks it against its hash.
pub(crate) async fn keep_picture(
    bus: &Bus,
    session: &SessionDir,
    picture: StoredFile<'_>,
    out: &Path,
) -> CommandResult {
    let path = local_picture(bus, session, picture).await?;
    keep(&path, out).map_err(|e| Failure::Work(e.to_string()))
}

/// A path of a picture of the capture process on this machine, with the content that its hash promises.
pub(crate) async fn local_picture(
    bus: &Bus,
    session: &SessionDir,
    picture: StoredFile<'_>,
) -> Result<PathBuf, Failure> {
    let blobs = Blobs::open(&session.path().join("blobs")).map_err(|e| Failure::Work(e.to_string()))?;
    let context = Context::root().deadline_in(TIMEOUT);
    Ok(blobs.fetch(bus, &keys::CAPTURE_CONTENT, picture, &context).await?)
}

/// Copies a file. A failed copy leaves no file.
fn keep(from: &Path, to: &Path) -> Result<(), BlobError> {
    let copy = || {
        let mut out = StagedFile::create(to)?;
        std::io::copy(&mut sg_input::file::open(from)?.file, &mut out)?;
        out.commit()
    };
    copy().map(|_| ()).map_err(|source| BlobError { path: to.to_owned(), source })
}
