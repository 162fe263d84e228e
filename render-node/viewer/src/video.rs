//! A video of numbered pictures, made by an installed `ffmpeg`: the only program that displays and the command line start.

use std::ffi::OsStr;
use std::io::{BufRead as _, BufReader, Read};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process_group};

/// Longest time for a video of a turn of a window.
pub const VIDEO_TIMEOUT: Duration = Duration::from_secs(300);

/// Period of checks for the program's exit.
const POLL_PERIOD: Duration = Duration::from_millis(20);

/// Most bytes read of the program's error output.
const ERROR_BYTES: u64 = 4096;

/// Reason for a missing video.
#[derive(Debug, thiserror::Error)]
pub enum VideoError {
    /// The program cannot be started.
    #[error("ffmpeg does not start: {0}")]
    Start(std::io::Error),
    /// It did not make it.
    #[error("ffmpeg failed: {0}")]
    Failed(String),
    /// It took too long and was ended.
    #[error("ffmpeg was ended after {} s", .0.as_secs())]
    Late(Duration),
    /// The caller has stopped it.
    #[error("it was stopped")]
    Stopped,
    /// The finished video could not be moved to its path.
    #[error("{0}")]
    Place(String),
}

/// Path of `ffmpeg` in the folders of a search path such as `PATH`.
#[must_use]
pub fn found(path: Option<&OsStr>) -> Option<PathBuf> {
    let folders = std::env::split_paths(path?).filter(|folder| folder.is_absolute());
    folders.map(|folder| folder.join("ffmpeg")).find(|file| file.is_file())
}

/// Makes the video `to` of `0000.png`, `0001.png`, … in the folder `pictures`, at this number of pictures a second. Counts
/// encoded pictures in `done`. Ends when `stop` is set or after `timeout`. The result is a whole video or none. Of odd edges the
/// last pixel is left out, because the encoding stores colours for 2 × 2 pixels.
///
/// # Errors
/// [`VideoError`].
pub fn video(
    program: &Path,
    (pictures, to): (&Path, &Path),
    pictures_per_second: u32,
    (done, stop): (&AtomicU32, &AtomicBool),
    timeout: Duration,
) -> Result<(), VideoError> {
    let part = to.with_extension("part");
    let mut command = Command::new(program);
    command.args(["-nostdin", "-hide_banner", "-loglevel", "error", "-progress", "pipe:1", "-y"]);
    command.arg("-framerate").arg(pictures_per_second.to_string()).arg("-i").arg(pictures.join("%04d.png"));
    // Players assume BT.709 for large pictures without a tag, while `ffmpeg` defaults to BT.601. So the command tags the
    // matrix, and the PNGs' transfer function. The index stands first in the file, so that a web page can start playback
    // early.
    let filter = "crop=trunc(iw/2)*2:trunc(ih/2)*2:0:0,scale=out_color_matrix=bt709:out_range=tv";
    command.args(["-vf", filter, "-pix_fmt", "yuv420p", "-color_range", "tv"]);
    command.args(["-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "iec61966-2-1"]);
    command.args(["-movflags", "+faststart", "-f", "mp4"]).arg(&part);
    // Its own process group, so that its children end with it.
    command.process_group(0).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().map_err(VideoError::Start)?;
    let (progress, errors) = (child.stdout.take(), child.stderr.take());
    let outcome = std::thread::scope(|scope| {
        scope.spawn(move || follow(progress, done));
        let error_text = scope.spawn(move || {
            let mut said = String::new();
            // An unreadable error text is dropped.
            let _ = errors.map(|from| from.take(ERROR_BYTES).read_to_string(&mut said));
            said
        });
        let ended = wait(&mut child, stop, timeout);
        let said = error_text.join().unwrap_or_default();
        match ended {
            Ok(status) if status.success() => Ok(()),
            Ok(status) => {
                let line = said.lines().rfind(|line| !line.trim().is_empty());
                Err(VideoError::Failed(line.map_or_else(|| status.to_string(), |line| line.trim().to_owned())))
            }
            Err(error) => Err(error),
        }
    });
    let placed = outcome
        .and_then(|()| std::fs::rename(&part, to).map_err(|e| VideoError::Place(format!("{}: {e}", to.display()))));
    if placed.is_err() {
        // It may never have been begun.
        let _ = std::fs::remove_file(&part);
    }
    placed
}

/// Waits for the program's exit, and kills it when due.
fn wait(child: &mut Child, stop: &AtomicBool, timeout: Duration) -> Result<std::process::ExitStatus, VideoError> {
    let begun = Instant::now();
    let due = loop {
        match child.try_wait() {
            Ok(Some(status)) => return Ok(status),
            Ok(None) if stop.load(Ordering::Relaxed) => break VideoError::Stopped,
            Ok(None) if begun.elapsed() > timeout => break VideoError::Late(timeout),
            Ok(None) => std::thread::sleep(POLL_PERIOD),
            Err(error) => break VideoError::Start(error),
        }
    };
    if let Some(group) = Pid::from_raw(child.id().cast_signed()) {
        // A process that has just exited needs no kill.
        let _ = kill_process_group(group, Signal::KILL);
    }
    let _ = child.wait();
    Err(due)
}

/// Parses the program's progress.
fn follow(progress: Option<impl Read>, done: &AtomicU32) {
    for line in progress.into_iter().flat_map(|progress| BufReader::new(progress).lines().map_while(Result::ok)) {
        if let Some(frames) = line.strip_prefix("frame=").and_then(|n| n.trim().parse().ok()) {
            done.store(frames, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;
    use sg_raster::image::Image;

    /// A program named `ffmpeg` that does this; `$out` is its output file.
    fn program(folder: &Path, does: &str) -> PathBuf {
        let path = folder.join("ffmpeg");
        // The last argument is where the video goes.
        std::fs::write(&path, format!("#!/bin/sh\nfor out; do :; done\n{does}\n")).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
        path
    }

    fn made(does: &str, timeout: Duration, stop: bool) -> (Result<(), String>, u32, Option<String>) {
        let folder = tempfile::tempdir().unwrap();
        let program = program(folder.path(), does);
        let to = folder.path().join("turn.mp4");
        let (done, stop) = (AtomicU32::new(0), AtomicBool::new(stop));
        let outcome = video(&program, (folder.path(), &to), 30, (&done, &stop), timeout).map_err(|e| e.to_string());
        assert!(!folder.path().join("turn.part").exists(), "a part is left");
        (outcome, done.into_inner(), std::fs::read_to_string(to).ok())
    }

    const LONG: Duration = Duration::from_secs(60);

    #[test]
    fn a_video_is_there_whole_or_not_at_all() {
        let (outcome, done, video) = made("echo frame=7; echo frame=360; echo whole > \"$out\"", LONG, false);
        assert_eq!((outcome, done, video.as_deref()), (Ok(()), 360, Some("whole\n")));
        let (outcome, _, video) = made("echo half > \"$out\"; echo no room left >&2; exit 3", LONG, false);
        assert_eq!((outcome, video), (Err("ffmpeg failed: no room left".to_owned()), None));
        let (outcome, _, video) = made("exit 4", LONG, false);
        assert!(outcome.unwrap_err().contains("exit status: 4") && video.is_none());
    }

    #[test]
    fn a_program_that_does_not_end_is_ended_with_all_that_it_has_started() {
        let begun = Instant::now();
        let (outcome, _, video) = made("echo half > \"$out\"; sleep 50", Duration::from_millis(200), false);
        assert_eq!((outcome, video), (Err("ffmpeg was ended after 0 s".to_owned()), None));
        let (outcome, _, video) = made("sleep 50 & sleep 50", LONG, true);
        assert_eq!((outcome, video), (Err("it was stopped".to_owned()), None));
        assert!(begun.elapsed() < Duration::from_secs(20));
    }

    #[test]
    #[allow(clippy::print_stderr, reason = "a skipped test says so")]
    fn the_program_itself_makes_a_video_of_the_colours_that_the_pictures_have() {
        let Some(program) = found(std::env::var_os("PATH").as_deref()) else {
            let required = std::env::var("SUPERGAUSSIAN_REQUIRE_TOOLS").is_ok_and(|v| v == "1");
            assert!(!required, "ffmpeg is missing, and SUPERGAUSSIAN_REQUIRE_TOOLS=1");
            eprintln!("SKIPPED: ffmpeg is not installed");
            return;
        };
        let folder = tempfile::tempdir().unwrap();
        // As large as a turn's pictures: players guess other colours for small ones.
        let (width, height, color) = (1280, 720, [208_u8, 96, 32]);
        let rgba = [color[0], color[1], color[2], 255].map(|b| f32::from(b) / 255.0);
        let image = Image { width, height, rgba: rgba.repeat((width * height) as usize) };
        for k in 0..12 {
            image.write_png(std::fs::File::create(folder.path().join(format!("{k:04}.png"))).unwrap()).unwrap();
        }
        let to = folder.path().join("turn.mp4");
        let (done, stop) = (AtomicU32::new(0), AtomicBool::new(false));
        video(&program, (folder.path(), &to), 30, (&done, &stop), LONG).unwrap();
        assert_eq!(done.into_inner(), 12);
        let mut read = Command::new(&program);
        read.args(["-nostdin", "-v", "info", "-i"]).arg(&to);
        read.args(["-vf", "scale=in_color_matrix=bt709:in_range=tv", "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]);
        let read = read.output().unwrap();
        let progress = String::from_utf8_lossy(&read.stderr);
        assert!(
            progress.contains("yuv420p(tv, bt709") && progress.contains("1280x720") && progress.contains("30 fps"),
            "{progress}"
        );
        assert_eq!(read.stdout.len(), 12 * 3 * (width * height) as usize, "{progress}");
        let seen = read.stdout.chunks_exact(3).step_by(997);
        let off = seen.map(|p| p.iter().zip(color).map(|(a, b)| a.abs_diff(b)).max().unwrap_or(0)).max();
        assert!(off <= Some(3), "a colour is off by {off:?} of 255");
    }

    #[test]
    fn it_is_looked_for_where_programs_are() {
        let folder = tempfile::tempdir().unwrap();
        let path = program(folder.path(), "exit 0");
        let search = std::env::join_paths([Path::new("/no/such/folder"), Path::new("."), folder.path()]).unwrap();
        assert_eq!(found(Some(&search)), Some(path));
        assert_eq!(found(Some(OsStr::new("/no/such/folder"))), None);
        assert_eq!(found(None), None);
    }
}
