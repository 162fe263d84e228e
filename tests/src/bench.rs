//! Shared parts of the benches: arguments, resource use of a process, and one-number summaries of lists.

use std::path::{Path, PathBuf};
use std::time::Duration;

/// The number behind `--name` on the command line, else another one.
///
/// # Panics
/// The argument is not a number.
#[must_use]
#[allow(clippy::expect_used, reason = "a bench that was asked for something else than numbers has nothing to measure")]
pub fn argument(name: &str, otherwise: u32) -> u32 {
    let mut behind = std::env::args().skip_while(|a| a != name).skip(1);
    behind.next().map_or(otherwise, |text| text.parse().expect("a number"))
}

/// The smallest value that at least this share of all does not exceed, 0 of none. Sorts the list.
pub fn quantile(list: &mut [f64], share: f64) -> f64 {
    list.sort_by(f64::total_cmp);
    let rank = (share * list.len() as f64).ceil() as usize;
    list.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
}

/// Processor time that all threads of a process have used so far, to the nanosecond; 0 for one that is gone.
#[must_use]
pub fn processor_time(pid: u64) -> Duration {
    schedule(pid, 0, |_| true)
}

/// Processor time that the threads of this name of a process have used so far, to the nanosecond; 0 if there are none.
#[must_use]
pub fn thread_time(pid: u64, name: &str) -> Duration {
    let is_named = |path: &Path| std::fs::read_to_string(path.join("comm")).is_ok_and(|comm| comm.trim_end() == name);
    schedule(pid, 0, is_named)
}

/// The time that the threads of a process have stood ready to run so far and waited for a core. It is exact to the nanosecond; 0
/// for a process that is gone.
#[must_use]
pub fn waiting_time(pid: u64) -> Duration {
    schedule(pid, 1, |_| true)
}

/// Name and scheduler niceness of each thread of a process; none for a process that is gone.
#[must_use]
pub fn niceness(pid: u64) -> Vec<(String, i32)> {
    let threads = std::fs::read_dir(format!("/proc/{pid}/task")).into_iter().flatten().flatten();
    let told = |path: PathBuf| {
        let stat = std::fs::read_to_string(path.join("stat")).ok()?;
        // `TID (NAME) STATE …`: a name may hold spaces and brackets, and niceness is the 17th word behind it.
        let (head, tail) = stat.rsplit_once(')')?;
        let (_, name) = head.split_once('(')?;
        Some((name.to_owned(), tail.split_whitespace().nth(16)?.parse().ok()?))
    };
    threads.filter_map(|t| told(t.path())).collect()
}

/// Sum over some of a process's threads of one of the numbers of `/proc/PID/task/TID/schedstat`, in nanoseconds.
fn schedule(pid: u64, column: usize, counts: impl Fn(&Path) -> bool) -> Duration {
    let threads = std::fs::read_dir(format!("/proc/{pid}/task")).into_iter().flatten().flatten();
    let told = |path: PathBuf| -> Option<u64> {
        std::fs::read_to_string(path.join("schedstat")).ok()?.split_whitespace().nth(column)?.parse().ok()
    };
    Duration::from_nanos(threads.map(|t| t.path()).filter(|path| counts(path)).filter_map(told).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quantile_is_a_value_of_the_list() {
        let mut list = [3.0, 1.0, 2.0, 4.0];
        assert_eq!([0.0, 0.25, 0.5, 0.99, 1.0].map(|share| quantile(&mut list, share)), [1.0, 1.0, 2.0, 4.0, 4.0]);
        assert_eq!(quantile(&mut [], 0.5), 0.0);
    }

    #[test]
    fn time_is_used_while_one_works() {
        let (pid, before) = (u64::from(std::process::id()), processor_time(u64::from(std::process::id())));
        let mut x = 1.0_f64;
        while processor_time(pid) == before {
            (0..100_000).for_each(|_| x = std::hint::black_box(x.sqrt() + 1.0));
        }
        assert_eq!(processor_time(u64::MAX), Duration::ZERO);
        let named = std::thread::Builder::new().name("counted-alone".to_owned()).spawn(move || {
            // Told from time to time alone.
            while thread_time(pid, "counted-alone").is_zero() {
                (0..100_000).for_each(|_| x = std::hint::black_box(x.sqrt() + 1.0));
            }
            thread_time(pid, "counted-alone")
        });
        let used = named.unwrap().join().unwrap();
        assert!(used < processor_time(pid), "{used:?}");
        assert_eq!(thread_time(pid, "no-such-thread"), Duration::ZERO);
        let all = niceness(pid);
        assert!(!all.is_empty() && all.iter().all(|(_, nice)| (-20..20).contains(nice)), "{all:?}");
    }
}
