//! Deadlines do not use the time of day, which jumps: a person, a time server or a virtual machine sets it.

use super::{File, complaints_about, hold, lines_against};

/// Files that name the time of day, and what for. None of these is a wait.
const TIMES_OF_DAY: [(&str, &str); 16] = [
    ("launch/cli/src/certificate_expiry.rs", "the end of a certificate"),
    ("launch/cli/src/certificates.rs", "the validity of new certificates"),
    ("launch/cli/src/doctor.rs", "a name that is not there"),
    ("launch/cli/src/projects.rs", "the age of a project, for people"),
    ("launch/stack/src/console.rs", "the time of a line"),
    ("launch/stack/src/run_folder.rs", "the age of files"),
    ("launch/stack/src/supervisor/event_loop.rs", "the first epoch, beside that of the last run"),
    ("services/fit/service/src/kept_scenes.rs", "the age of files"),
    ("services/runtime/src/bus/client.rs", "the begin of a span"),
    ("services/runtime/src/bus/link.rs", "the end of a certificate"),
    ("services/runtime/src/bus/server.rs", "the begin of a span"),
    ("services/runtime/src/bus/stream.rs", "the begin of a span"),
    ("services/runtime/src/scene_files.rs", "the age of files"),
    ("services/runtime/src/trace.rs", "spans"),
    ("services/scene/service/src/kept_scenes.rs", "the age of files"),
    ("services/scene/service/src/project_folder.rs", "the age of files"),
];

fn deadlines_use_no_time_of_day(files: &[File]) -> Vec<String> {
    let may = |f: &&File| f.is_test() || TIMES_OF_DAY.iter().any(|(path, _)| f.path == *path);
    let rooms = files.iter().filter(|f| f.is_rust() && !may(f));
    let names = |line: &str| line.contains("SystemTime") || line.contains("CLOCK_REALTIME");
    lines_against(rooms, "no deadline uses the time of day; add what it is for to the table in clocks.rs", names)
}

#[test]
fn no_deadline_uses_the_time_of_day() {
    hold(deadlines_use_no_time_of_day);
    let wait = "let deadline = SystemTime::now() + TIMEOUT;";
    assert_eq!(complaints_about(deadlines_use_no_time_of_day, &[("launch/stack/src/probe.rs", wait)]), 1);
    assert_eq!(complaints_about(deadlines_use_no_time_of_day, &[("launch/stack/src/console.rs", wait)]), 0);
}
