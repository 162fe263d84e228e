//! The life cycle of a session, from the runtime's events.

use openxr::SessionState;

/// A transition of the session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Transition {
    Nothing,
    /// Frames begin.
    Begin,
    /// Frames end; the session may begin again.
    End,
    /// The session ends on request.
    Leave,
    /// The session has ended because the runtime goes away.
    Lose,
}

/// State of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct StateMachine {
    state: SessionState,
    running: bool,
}

impl StateMachine {
    pub(super) fn new() -> Self {
        Self { state: SessionState::UNKNOWN, running: false }
    }

    /// Takes in a new state. A repeated state does not begin the session twice.
    pub(super) fn enter(&mut self, state: SessionState) -> Transition {
        self.state = state;
        match state {
            SessionState::READY if !self.running => {
                self.running = true;
                Transition::Begin
            }
            SessionState::STOPPING if self.running => {
                self.running = false;
                Transition::End
            }
            SessionState::EXITING => {
                self.running = false;
                Transition::Leave
            }
            SessionState::LOSS_PENDING => {
                self.running = false;
                Transition::Lose
            }
            _ => Transition::Nothing,
        }
    }

    /// Whether frames are waited for, begun and ended.
    pub(super) fn is_running(&self) -> bool {
        self.running
    }

    /// Whether the session's pictures are seen. A runtime may ask for pictures that nobody sees: Monado does so behind another
    /// program.
    pub(super) fn is_visible(&self) -> bool {
        matches!(self.state, SessionState::VISIBLE | SessionState::FOCUSED)
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
        let mut state_machine = StateMachine::new();
        let told = |state_machine: &mut StateMachine, states: &[usize]| {
            states.iter().map(|k| state_machine.enter(ALL[*k])).collect::<Vec<_>>()
        };
        assert_eq!(
            told(&mut state_machine, &[0, 1, 2, 3, 4]),
            [Transition::Nothing, Transition::Begin, Transition::Nothing, Transition::Nothing, Transition::Nothing]
        );
        assert!(state_machine.is_running() && state_machine.is_focused());
        assert_eq!(
            told(&mut state_machine, &[3, 2, 5, 0, 1]),
            [Transition::Nothing, Transition::Nothing, Transition::End, Transition::Nothing, Transition::Begin]
        );
        assert_eq!(told(&mut state_machine, &[5, 0, 7]), [Transition::End, Transition::Nothing, Transition::Leave]);
        assert!(!state_machine.is_running());
    }

    #[test]
    fn whatever_the_order_begin_and_end_alternate() {
        for code in 0..8_usize.pow(5) {
            let mut state_machine = StateMachine::new();
            let mut running = false;
            for k in 0..5 {
                match state_machine.enter(ALL[code / 8_usize.pow(k) % 8]) {
                    Transition::Begin => {
                        assert!(!running);
                        running = true;
                    }
                    Transition::End => {
                        assert!(running);
                        running = false;
                    }
                    Transition::Leave | Transition::Lose => running = false,
                    Transition::Nothing => {}
                }
                assert_eq!(state_machine.is_running(), running);
            }
        }
    }
}
