//! Lines that a supervisor writes to its terminal, and its own ones to its log.
//!
//! A bounded queue and a thread of its own carry the lines. A blocked terminal (Ctrl-S, a pipe without a reader) must
//! not block supervision. Lines beyond the queue's capacity are dropped and counted.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use humantime::format_rfc3339_millis;

use crate::log_file::LogFile;
use crate::log_line::{Level, LogLine};
use crate::spawn::LineSink;
use crate::terminal::{self, Color, paint};

/// Most lines that wait at a time.
const CAPACITY: usize = 1024;

/// How long a supervisor waits at its end for its last lines to be written.
const FLUSH_TIME: Duration = Duration::from_secs(1);

/// How much a supervisor writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verbosity {
    /// Every line that services write.
    Full,
    /// Warnings and failures.
    Quiet,
}

/// The sending end. Cheap to clone.
#[derive(Debug, Clone)]
pub(crate) struct Console {
    sender: SyncSender<String>,
    dropped: Arc<AtomicU64>,
    verbosity: Verbosity,
    colored: bool,
    /// The supervisor's own log.
    log: Arc<Mutex<LogFile>>,
}

/// The writing thread.
#[derive(Debug)]
pub(crate) struct Writer(Receiver<()>);

impl Console {
    /// Starts the writing thread. `log` gets the supervisor's own lines.
    pub(crate) fn open(verbosity: Verbosity, log: LogFile) -> (Self, Writer) {
        let (sender, lines) = sync_channel::<String>(CAPACITY);
        let (ended, end) = sync_channel(1);
        let dropped = Arc::new(AtomicU64::new(0));
        let missed = Arc::clone(&dropped);
        std::thread::spawn(move || {
            for line in lines {
                terminal::print_status(&line);
                let missed = missed.swap(0, Ordering::Relaxed);
                if missed > 0 {
                    terminal::print_status(&format!("… {missed} lines not shown; they are in the logs"));
                }
            }
            // Nothing waits for the end any more. Ignore the error.
            let _ = ended.send(());
        });
        let (log, colored) = (Arc::new(Mutex::new(log)), terminal::may_color(&std::io::stderr()));
        (Self { sender, dropped, verbosity, colored, log }, Writer(end))
    }

    /// Writes a line.
    pub(crate) fn print(&self, line: String) {
        self.note(&line);
        self.send(line);
    }

    /// Writes a line that a quiet supervisor omits at its terminal.
    pub(crate) fn print_detail(&self, line: String) {
        self.note(&line);
        if self.verbosity == Verbosity::Full {
            self.send(line);
        }
    }

    fn send(&self, line: String) {
        if self.sender.try_send(line).is_err() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Writes a line to the supervisor's log, as services do.
    fn note(&self, line: &str) {
        let message = terminal::without_color(line);
        let entry = serde_json::json!({
            "timestamp": format_rfc3339_millis(SystemTime::now()).to_string(), "level": "INFO", "message": message.trim(),
        });
        let mut log = self.log.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        // On a full disk the services' logs already give the warning.
        let _ = log.line(&entry.to_string());
    }

    /// Whether lines may be coloured.
    pub(crate) fn colored(&self) -> bool {
        self.colored
    }

    fn log(&self, service: &str, width: usize, color: Color, line: &str) {
        let parsed = LogLine::parse(line);
        let least = if self.verbosity == Verbosity::Full { Level::Trace } else { Level::Warn };
        if parsed.level >= least {
            let time = if parsed.timestamp.is_empty() { clock() } else { parsed.time().to_owned() };
            self.send(format_line(&time, service, width, color, &parsed, self.colored));
        }
    }
}

impl Writer {
    /// Waits up to a second until all lines are written. Drop every [`Console`] first.
    pub(crate) fn flush(self) {
        let _ = self.0.recv_timeout(FLUSH_TIME);
    }
}

/// `HH:MM:SS service LEVEL message k=v`.
pub fn format_line(time: &str, service: &str, width: usize, color: Color, line: &LogLine, colored: bool) -> String {
    let level = match line.level {
        Level::Error => paint(Color::Red, "ERROR", colored),
        Level::Warn => paint(Color::Yellow, "WARN ", colored),
        other => paint(Color::Faint, &format!("{:<5}", other.name()), colored),
    };
    let service = paint(color, &format!("{service:<width$}"), colored);
    format!("{} {service} {level} {}", paint(Color::Faint, &format!("{time:<8}"), colored), line.text())
}

/// The time of day in UTC, as in the logs of services.
fn clock() -> String {
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs() % 86_400;
    format!("{:02}:{:02}:{:02}", seconds / 3600, seconds / 60 % 60, seconds % 60)
}

/// A colour for each service, in turn.
pub fn color_of(position: usize) -> Color {
    const COLORS: [Color; 4] = [Color::Cyan, Color::Magenta, Color::Blue, Color::Green];
    COLORS.get(position % COLORS.len()).copied().unwrap_or(Color::Cyan)
}

/// Destination of one service's lines: its log file and the console.
#[derive(Debug, Clone)]
pub(crate) struct ServiceLog {
    pub(crate) service: String,
    /// Characters that the name of the service takes.
    pub(crate) width: usize,
    pub(crate) color: Color,
    pub(crate) file: Arc<Mutex<LogFile>>,
    pub(crate) console: Console,
}

impl LineSink for ServiceLog {
    fn line(&self, line: &str) {
        let written = self.file.lock().unwrap_or_else(std::sync::PoisonError::into_inner).line(line);
        // Warn once: a full disk loses every following line.
        if written == Err(1) {
            self.console.print(format!("the log of {} cannot be written; is the disk full?", self.service));
        }
        self.console.log(&self.service, self.width, self.color, line);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_for_people_has_time_service_level_and_text() {
        let line = LogLine::parse(
            r#"{"timestamp":"2026-11-21T09:30:05.1Z","level":"INFO","message":"ready","start_ms":12,"target":"x"}"#,
        );
        assert_eq!(
            format_line(line.time(), "scene", 7, Color::Cyan, &line, false),
            "09:30:05 scene   INFO  ready start_ms=12"
        );
        let colored = format_line(line.time(), "scene", 7, Color::Cyan, &line, true);
        assert!(terminal::rendered_lines(&colored).contains("\u{1b}[36mscene  \u{1b}[0m"));
    }

    #[test]
    fn excess_lines_are_dropped() {
        let (sender, _unread) = sync_channel(1);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("supervisor.log");
        let log = Arc::new(Mutex::new(LogFile::create(path.clone())));
        let console = Console { sender, dropped: Arc::default(), verbosity: Verbosity::Quiet, colored: false, log };
        for _ in 0..3 {
            console.print(format!("  {} y", paint(Color::Green, "x", true)));
        }
        console.print_detail("more".into());
        assert_eq!(console.dropped.load(Ordering::Relaxed), 2);
        // The log has them all, without colours.
        let text = std::fs::read_to_string(&path).unwrap();
        let lines: Vec<_> = text.lines().map(LogLine::parse).collect();
        let messages: Vec<_> = lines.iter().map(|l| l.message.as_str()).collect();
        assert_eq!(messages, ["x y", "x y", "x y", "more"]);
        assert!(lines.iter().all(|l| l.timestamp.len() == 24 && l.time().len() == 8), "{text}");
    }

    #[test]
    fn times_are_those_of_the_calendar() {
        let at = |seconds: u64| format_rfc3339_millis(UNIX_EPOCH + Duration::from_secs(seconds)).to_string();
        assert_eq!(at(0), "1970-01-01T00:00:00.000Z");
        assert_eq!(at(951_827_696), "2000-02-29T12:34:56.000Z");
        assert_eq!(at(1_795_391_999), "2026-11-22T23:59:59.000Z");
        assert_eq!(at(4_107_542_400), "2100-03-01T00:00:00.000Z");
    }
}
