//! The life of a session, as the runtime's events tell it.

use openxr::SessionState;

/// What an event asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Do {
    Nothing,
    /// Frames begin.
    Begin,
    /// Frames end; the session may begin anew.
    End,
    /// The session is over because somebody wants it to be.
    Leave,
    /// The session is over because the runtime goes away.
    Lose,
}

/// Where a session is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Life {
    state: SessionState,
    running: bool,
}

impl Life {
    pub(super) fn new() -> Self {
        Self { state: SessionState::UNKNOWN, running: false }
    }

    /// Takes in a new state. A runtime that repeats itself does not begin twice.
    pub(super) fn enter(&mut self, state: SessionState) -> Do {
        self.state = state;
        match state {
            SessionState::READY if !self.running => {
                self.running = true;
                Do::Begin
            }
            SessionState::STOPPING if self.running => {
                self.running = false;
                Do::End
            }
            SessionState::EXITING => {
                self.running = false;
                Do::Leave
            }
            SessionState::LOSS_PENDING => {
                self.running = false;
                Do::Lose
            }
            _ => Do::Nothing,
        }
    }

    /// Whether frames are waited for, begun and ended.
    pub(super) fn is_running(&self) -> bool {
        self.running
    }

    /// Whether hands are this session's.
    pub(super) fn is_focused(&self) -> bool {
        self.state == SessionState::FOCUSED
    }

    pub(super) fn state(&self) -> SessionState {
        self.state
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [SessionState; 8] = [
        SessionState::IDLE,
        SessionState::READY,
        SessionState::SYNCHRONIZED,
        SessionState::VISIBLE,
        SessionState::FOCUSED,
        SessionState::STOPPING,
        SessionState::LOSS_PENDING,
        SessionState::EXITING,
    ];

    #[test]
    fn a_session_goes_there_and_back() {
        let mut life = Life::new();
        let told = |life: &mut Life, states: &[usize]| states.iter().map(|k| life.enter(ALL[*k])).collect::<Vec<_>>();
        assert_eq!(told(&mut life, &[0, 1, 2, 3, 4]), [Do::Nothing, Do::Begin, Do::Nothing, Do::Nothing, Do::Nothing]);
        assert!(life.is_running() && life.is_focused());
        assert_eq!(told(&mut life, &[3, 2, 5, 0, 1]), [Do::Nothing, Do::Nothing, Do::End, Do::Nothing, Do::Begin]);
        assert_eq!(told(&mut life, &[5, 0, 7]), [Do::End, Do::Nothing, Do::Leave]);
        assert!(!life.is_running());
    }

    #[test]
    fn whatever_the_order_begin_and_end_alternate() {
        for code in 0..8_usize.pow(5) {
            let mut life = Life::new();
            let mut running = false;
            for k in 0..5 {
                match life.enter(ALL[code / 8_usize.pow(k) % 8]) {
                    Do::Begin => {
                        assert!(!running);
                        running = true;
                    }
                    Do::End => {
                        assert!(running);
                        running = false;
                    }
                    Do::Leave | Do::Lose => running = false,
                    Do::Nothing => {}
                }
                assert_eq!(life.is_running(), running);
            }
        }
    }
}
