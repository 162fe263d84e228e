//! Times submitted work on devices without timestamps.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::device::Gpu;

/// Pause between two looks at the device while work is under way.
const POLL_INTERVAL: Duration = Duration::from_micros(250);

/// Most times that wait to be taken; the oldest goes.
const KEPT: usize = 16;

/// Measures how long the device takes for the submitted work of each picture.
///
/// A time begins with the submission, or with the end of the work before it if that comes later. It ends when the device
/// reports the end. It includes all other work of the device meanwhile. A device reports only when it is asked, so a
/// thread polls it while work is under way. So a time is up to a quarter of a millisecond too long.
pub struct WorkTimer {
    gpu: Gpu,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    /// Submissions under way.
    pending: usize,
    /// End of the work before.
    ended: Option<Instant>,
    /// Pictures with their seconds, oldest first.
    times: VecDeque<(u64, f64)>,
    stopped: bool,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl WorkTimer {
    /// A timer for a device.
    ///
    /// # Errors
    /// The system's error if it cannot start a thread.
    pub fn new(gpu: &Gpu) -> std::io::Result<Self> {
        let shared = Arc::<Shared>::default();
        let (here, device) = (Arc::clone(&shared), gpu.clone());
        let thread = std::thread::Builder::new().name("work timer".to_owned()).spawn(move || {
            loop {
                let idle = |state: &mut State| state.pending == 0 && !state.stopped;
                let waited = here.changed.wait_while(here.state(), idle);
                if waited.unwrap_or_else(PoisonError::into_inner).stopped {
                    return;
                }
                if device.device().poll(wgpu::PollType::Poll).is_err() || device.is_lost() {
                    // A lost device reports no end.
                    here.state().pending = 0;
                }
                std::thread::sleep(POLL_INTERVAL);
            }
        })?;
        Ok(Self { gpu: gpu.clone(), shared, thread: Some(thread) })
    }

    /// Times the work that was submitted for a picture. Call it right after the submission.
    pub fn begin(&self, picture: u64) {
        let submitted = Instant::now();
        self.shared.state().pending += 1;
        self.shared.changed.notify_one();
        let shared = Arc::clone(&self.shared);
        self.gpu.when_done(move || {
            let (now, mut state) = (Instant::now(), shared.state());
            let begun = state.ended.replace(now).map_or(submitted, |before| before.max(submitted));
            state.pending = state.pending.saturating_sub(1);
            if state.times.len() == KEPT {
                state.times.pop_front();
            }
            state.times.push_back((picture, now.saturating_duration_since(begun).as_secs_f64()));
        });
    }

    /// The oldest finished picture and its seconds, once.
    #[must_use]
    pub fn take(&self) -> Option<(u64, f64)> {
        self.shared.state().times.pop_front()
    }
}

impl Drop for WorkTimer {
    fn drop(&mut self) {
        self.shared.state().stopped = true;
        self.shared.changed.notify_one();
        if let Some(thread) = self.thread.take() {
            // A panic has already been reported; there is nothing left to end.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::test_device;

    #[test]
    fn each_submission_has_one_time() {
        let Some(gpu) = test_device() else { return };
        let timer = WorkTimer::new(&gpu).unwrap();
        let buffers = [(); 2].map(|()| gpu.storage("test", 1 << 20));
        for picture in 1..=3 {
            let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            encoder.copy_buffer_to_buffer(&buffers[0], 0, &buffers[1], 0, 1 << 20);
            gpu.submit([encoder.finish()]);
            timer.begin(picture);
        }
        let begun = Instant::now();
        let mut times = Vec::new();
        while times.len() < 3 {
            assert!(begun.elapsed() < Duration::from_secs(60), "{times:?}");
            times.extend(timer.take());
            std::thread::sleep(Duration::from_millis(1));
        }
        assert_eq!(times.iter().map(|(picture, _)| *picture).collect::<Vec<_>>(), [1, 2, 3]);
        let sum: f64 = times.iter().map(|(_, seconds)| *seconds).sum();
        assert!(times.iter().all(|(_, s)| *s >= 0.0) && sum < begun.elapsed().as_secs_f64() + 60.0);
        assert!(timer.take().is_none());
    }
}
