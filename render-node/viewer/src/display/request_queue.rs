//! Queue of a display's requests; the executor takes one after another.

use std::collections::VecDeque;
use std::sync::mpsc::Receiver;

use super::channel::REQUESTS;
use super::request::Request;

/// Requests in their order. A newer trial replaces an older one.
#[derive(Debug)]
pub struct RequestQueue {
    requests: Receiver<Request>,
    waiting: VecDeque<Request>,
    superseded: u64,
}

impl RequestQueue {
    /// Takes requests from a [`super::Backend`].
    #[must_use]
    pub fn new(requests: Receiver<Request>) -> Self {
        Self { requests, waiting: VecDeque::new(), superseded: 0 }
    }

    /// Number of superseded requests.
    #[must_use]
    pub fn superseded(&self) -> u64 {
        self.superseded
    }
}

impl Iterator for RequestQueue {
    type Item = Request;

    /// Waits for the next request; `None` once the display is closed.
    fn next(&mut self) -> Option<Request> {
        if self.waiting.is_empty() {
            self.waiting.push_back(self.requests.recv().ok()?);
        }
        loop {
            while self.waiting.len() < REQUESTS
                && let Ok(request) = self.requests.try_recv()
            {
                self.waiting.push_back(request);
            }
            let request = self.waiting.pop_front()?;
            if self.waiting.iter().any(|later| request.is_superseded_by(later)) {
                self.superseded += 1;
            } else {
                return Some(request);
            }
        }
    }
}
