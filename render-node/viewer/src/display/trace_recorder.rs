//! Writes a [`super::frame_trace`] beside the display's loop, on a thread of its own.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Instant;

use super::frame_trace::{COLUMNS, HEAD, MAX_BYTES, RecordedCost, SessionVisibility, TraceRow};

/// Most events that wait for the thread; more are dropped and counted.
const WAITING: usize = 1024;

/// Most rows that wait for their measurement.
const PENDING: usize = 32;

/// Bytes kept for the last remark.
const REMARK_BYTES: u64 = 128;

/// Most recordings in one folder.
const MAX_FILES: usize = 1000;

/// A frame as the loop knows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RecordedFrame {
    /// What the person sees of the session.
    pub state: SessionVisibility,
    /// Seconds from one frame of the display to the next.
    pub period: f64,
    /// Frames of the display without a new picture, since the session began.
    pub missed: u64,
    /// Number of the picture of the scene, and its level.
    pub picture: Option<(u64, usize)>,
}

/// What the loop tells the thread.
#[derive(Debug, Clone, Copy)]
enum Event {
    Frame { row: TraceRow, picture: Option<u64> },
    Measured { picture: u64, time: f64, seconds: f64, pixel_seconds: Option<f64> },
}

/// Records frames. The loop neither waits nor allocates for it.
#[derive(Debug)]
pub struct TraceRecorder {
    sender: Option<SyncSender<Event>>,
    thread: Option<JoinHandle<()>>,
    path: PathBuf,
    begun: Instant,
    newest: Option<SessionVisibility>,
    /// Missed frames so far.
    missed: u64,
    /// Events that found no room.
    dropped: u64,
}

impl TraceRecorder {
    /// Begins the file `frames-NNNN.csv` in a folder, with the first free number; makes the folder.
    ///
    /// # Errors
    /// The system's error, or a full folder.
    pub fn begin(folder: &Path) -> io::Result<Self> {
        std::fs::create_dir_all(folder)?;
        let (path, file) = create(folder)?;
        let (sender, events) = sync_channel(WAITING);
        let place = path.clone();
        let thread = std::thread::Builder::new().name("frame trace".to_owned()).spawn(move || {
            if let Err(error) = write(&events, BufWriter::new(file), MAX_BYTES) {
                tracing::warn!("{}: {error}; the recording ends here", place.display());
            }
        })?;
        tracing::info!("frames are recorded in {}", path.display());
        let (begun, sender, thread) = (Instant::now(), Some(sender), Some(thread));
        Ok(Self { sender, thread, path, begun, newest: None, missed: 0, dropped: 0 })
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Records a frame. Of a state without pictures only its begin is recorded.
    pub fn frame(&mut self, frame: RecordedFrame) {
        let RecordedFrame { state, period, missed, picture } = frame;
        let time = self.begun.elapsed().as_secs_f64();
        let is_new = self.newest.replace(state) != Some(state);
        if !is_new && !state.is_shown() {
            return;
        }
        // A session that begins anew counts from 0.
        let since = missed.checked_sub(self.missed).unwrap_or(missed);
        self.missed = missed;
        let row = TraceRow { time, state, period, missed: since, level: picture.map(|(_, level)| level), cost: None };
        self.send(Event::Frame { row, picture: picture.map(|(number, _)| number) });
    }

    /// Records the cost of a picture: its device seconds, and those of them that grow with pixels. Costs come in the order of
    /// their pictures.
    pub fn measured(&mut self, picture: u64, seconds: f64, pixel_seconds: Option<f64>) {
        let time = self.begun.elapsed().as_secs_f64();
        self.send(Event::Measured { picture, time, seconds, pixel_seconds });
    }

    fn send(&mut self, event: Event) {
        let Some(sender) = &self.sender else { return };
        // A thread that is done, since the file is full or cannot be written, has said so.
        if let Err(std::sync::mpsc::TrySendError::Full(_)) = sender.try_send(event) {
            self.dropped += 1;
        }
    }
}

impl Drop for TraceRecorder {
    fn drop(&mut self) {
        self.sender = None;
        if let Some(thread) = self.thread.take() {
            // A panic has already been reported.
            let _ = thread.join();
        }
        if self.dropped > 0 {
            tracing::warn!("{}: {} events of frames found no room", self.path.display(), self.dropped);
        }
    }
}

/// The first free file of a folder.
fn create(folder: &Path) -> io::Result<(PathBuf, File)> {
    for number in 1..=MAX_FILES {
        let path = folder.join(format!("frames-{number:04}.csv"));
        match File::create_new(&path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            made => return made.map(|file| (path, file)),
        }
    }
    Err(io::Error::new(io::ErrorKind::StorageFull, format!("{MAX_FILES} recordings are there already")))
}

/// Rows that wait for the measurement of their pictures.
#[derive(Default)]
struct PendingRows(VecDeque<(TraceRow, Option<u64>)>);

impl PendingRows {
    /// Takes in an event. The rows that are complete go to `out`.
    fn take(&mut self, event: Event, out: &mut impl FnMut(&TraceRow) -> io::Result<()>) -> io::Result<()> {
        match event {
            Event::Frame { row, picture } => {
                if !row.state.is_shown() {
                    // Pictures of a new session are counted anew.
                    self.flush(out)?;
                }
                self.0.push_back((row, picture));
            }
            Event::Measured { picture: measured, time, seconds, pixel_seconds } => {
                let found = self.0.iter_mut().find(|(_, picture)| *picture == Some(measured));
                let Some((row, picture)) = found else { return Ok(()) };
                let delay = (time - row.time).max(0.0);
                (row.cost, *picture) = (Some(RecordedCost { seconds, pixel_seconds, delay }), None);
                // Earlier pictures were not measured.
                let earlier = |picture: Option<u64>| picture.is_some_and(|picture| picture < measured);
                self.0.iter_mut().filter(|(_, p)| earlier(*p)).for_each(|(_, picture)| *picture = None);
            }
        }
        while self.0.len() > PENDING || self.0.front().is_some_and(|(_, picture)| picture.is_none()) {
            let Some((row, _)) = self.0.pop_front() else { break };
            out(&row)?;
        }
        Ok(())
    }

    fn flush(&mut self, out: &mut impl FnMut(&TraceRow) -> io::Result<()>) -> io::Result<()> {
        self.0.drain(..).try_for_each(|(row, _)| out(&row))
    }
}

/// Writes all events until the sender ends, and at most `most` bytes.
fn write(events: &Receiver<Event>, mut file: impl Write, most: u64) -> io::Result<()> {
    let mut bytes = (HEAD.len() + COLUMNS.len() + 2) as u64;
    writeln!(file, "{HEAD}\n{COLUMNS}")?;
    let mut full = false;
    let mut out = |row: &TraceRow| {
        let line = format!("{row}\n");
        full |= bytes + line.len() as u64 + REMARK_BYTES > most;
        if full {
            return Ok(());
        }
        bytes += line.len() as u64;
        file.write_all(line.as_bytes())
    };
    let mut pending = PendingRows::default();
    for event in events {
        pending.take(event, &mut out)?;
    }
    pending.flush(&mut out)?;
    if full {
        writeln!(file, "# the file is full; later frames are not recorded")?;
        tracing::warn!("the recording of frames is full");
    }
    file.flush()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::display::frame_trace::FrameTrace;

    fn shown(picture: Option<(u64, usize)>, missed: u64) -> RecordedFrame {
        RecordedFrame { state: SessionVisibility::Focused, period: 0.0111, missed, picture }
    }

    #[test]
    fn measurements_meet_their_frames() {
        let folder = tempfile::tempdir().unwrap();
        let mut recorder = TraceRecorder::begin(folder.path()).unwrap();
        let path = recorder.path().to_owned();
        recorder.frame(shown(None, 0));
        recorder.frame(shown(Some((1, 4)), 0));
        recorder.frame(shown(Some((2, 4)), 2));
        recorder.frame(shown(Some((3, 5)), 2));
        recorder.measured(2, 0.006, Some(0.004));
        for _ in 0..3 {
            recorder.frame(RecordedFrame { state: SessionVisibility::Hidden, ..shown(None, 2) });
        }
        // The runtime came back: pictures and missed frames are counted anew, and an old measurement is nobody's.
        recorder.measured(3, 1.0, None);
        recorder.frame(shown(Some((1, 5)), 1));
        recorder.measured(1, 0.008, None);
        drop(recorder);
        let rows = FrameTrace::read(&path).unwrap().rows;
        let told: Vec<_> =
            rows.iter().map(|r| (r.state.is_shown(), r.missed, r.level, r.cost.map(|c| c.seconds))).collect();
        let expected = [
            (true, 0, None, None),
            (true, 0, Some(4), None),
            (true, 2, Some(4), Some(0.006)),
            (true, 0, Some(5), None),
            (false, 0, None, None),
            (true, 1, Some(5), Some(0.008)),
        ];
        assert_eq!(told, expected);
        assert!(rows.iter().all(|r| (r.period - 0.0111).abs() < 1e-6));
        assert_eq!(rows[2].cost.unwrap().pixel_seconds, Some(0.004));
        let next = TraceRecorder::begin(folder.path()).unwrap();
        assert!(next.path() != path && next.path().ends_with("frames-0002.csv"));
    }

    #[test]
    fn a_file_is_bounded_and_stays_readable() {
        let (sender, events) = sync_channel(10_000);
        for picture in 0..5000 {
            let row = TraceRow {
                time: picture as f64,
                state: SessionVisibility::Visible,
                period: 0.011,
                missed: 0,
                level: Some(0),
                cost: None,
            };
            sender.send(Event::Frame { row, picture: Some(picture) }).unwrap();
        }
        drop(sender);
        let mut file = Vec::new();
        write(&events, &mut file, 10_000).unwrap();
        assert!((9000..=10_000).contains(&file.len()), "{}", file.len());
        let rows = FrameTrace::parse(std::str::from_utf8(&file).unwrap()).unwrap().rows;
        assert!(rows.len() > 200 && rows.iter().enumerate().all(|(k, row)| row.time == k as f64));
    }
}
