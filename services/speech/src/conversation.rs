//! The state of a spoken conversation, as panels show it. A pure state machine: `step(event, now) → actions`.
//!
//! Every state but idle and muted has a deadline, so a lost reply or a hanging program leaves it again.

use std::time::Duration;

/// What panels show.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// Nobody speaks.
    Idle,
    /// An utterance is heard.
    Listening,
    /// It is recognised, or its reply is awaited.
    Thinking,
    /// A reply sounds.
    Speaking,
    /// The microphone is closed, and nothing else happens.
    Muted,
}

/// Longest times in a state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Deadlines {
    /// Of an utterance.
    pub listening: Duration,
    /// Of its recognition.
    pub recognition: Duration,
    /// Of its answer.
    pub reply: Duration,
    /// Of the spoken reply.
    pub speaking: Duration,
}

impl Default for Deadlines {
    fn default() -> Self {
        Self {
            listening: Duration::from_secs(20),
            recognition: Duration::from_secs(10),
            reply: Duration::from_secs(60),
            speaking: Duration::from_secs(120),
        }
    }
}

/// Counts utterances, so that a late reply to an earlier one is not spoken.
pub type Turn = u64;

/// What happened.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Event {
    /// An utterance has begun.
    SpeechStarted,
    /// It is complete.
    SpeechEnded,
    /// It was none.
    SpeechDropped,
    /// It was recognised, sure enough to act.
    Understood {
        /// Turn of [`Action::Recognize`].
        turn: Turn,
        /// As it is written.
        text: String,
    },
    /// It was not recognised, or not surely.
    NotUnderstood {
        /// Turn of [`Action::Recognize`].
        turn: Turn,
    },
    /// An answer has come.
    Reply {
        /// Turn of [`Action::Submit`].
        turn: Turn,
        /// As it is written.
        text: String,
    },
    /// The spoken reply has ended by itself.
    ReplyEnded {
        /// Turn of [`Action::Speak`].
        turn: Turn,
    },
    /// The microphone is closed.
    Mute,
    /// It is open again.
    Unmute,
    /// Time has passed. Needed at [`Conversation::deadline`].
    Tick,
}

/// What to do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Action {
    /// Recognise the utterance that has ended.
    Recognize {
        /// The new turn.
        turn: Turn,
    },
    /// Give up its recognition.
    CancelRecognition {
        /// Its turn.
        turn: Turn,
    },
    /// Send the text to the agents.
    Submit {
        /// Its turn.
        turn: Turn,
        /// As it is written.
        text: String,
    },
    /// Speak the answer.
    Speak {
        /// Its turn.
        turn: Turn,
        /// As it is written.
        text: String,
    },
    /// Stop the spoken reply at once.
    StopSpeaking {
        /// Its turn.
        turn: Turn,
    },
    /// Give up the utterance that is heard.
    CancelSpeech,
    /// Tell the user that nothing was understood.
    SayNotUnderstood,
    /// Tell the user that no answer came in time.
    SayNoAnswer,
    /// Show another state.
    Show(State),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    Idle,
    Listening,
    Recognizing,
    Awaiting,
    Speaking,
}

/// A conversation. Times are durations since any fixed moment of a clock that does not jump.
#[derive(Debug, Clone)]
pub struct Conversation {
    deadlines: Deadlines,
    phase: Phase,
    entered: Duration,
    muted: bool,
    turn: Turn,
    shown: State,
}

impl Conversation {
    /// An idle conversation.
    #[must_use]
    pub fn new(deadlines: Deadlines) -> Self {
        let (phase, entered) = (Phase::Idle, Duration::ZERO);
        Self { deadlines, phase, entered, muted: false, turn: 0, shown: State::Idle }
    }

    /// What panels show now.
    #[must_use]
    pub fn state(&self) -> State {
        match self.phase {
            Phase::Idle if self.muted => State::Muted,
            Phase::Idle => State::Idle,
            Phase::Listening => State::Listening,
            Phase::Recognizing | Phase::Awaiting => State::Thinking,
            Phase::Speaking => State::Speaking,
        }
    }

    /// Whether the microphone is closed, in any state.
    #[must_use]
    pub fn is_muted(&self) -> bool {
        self.muted
    }

    /// When a [`Event::Tick`] is needed at the latest.
    #[must_use]
    pub fn deadline(&self) -> Option<Duration> {
        let longest = match self.phase {
            Phase::Idle => return None,
            Phase::Listening => self.deadlines.listening,
            Phase::Recognizing => self.deadlines.recognition,
            Phase::Awaiting => self.deadlines.reply,
            Phase::Speaking => self.deadlines.speaking,
        };
        Some(self.entered.saturating_add(longest))
    }

    fn enter(&mut self, phase: Phase, now: Duration) {
        (self.phase, self.entered) = (phase, now);
    }

    /// Takes an event, and returns what to do, in order. Events of earlier turns do nothing.
    pub fn step(&mut self, event: Event, now: Duration) -> Vec<Action> {
        let mut actions = Vec::new();
        if self.deadline().is_some_and(|deadline| now >= deadline) {
            self.leave(&mut actions, now);
        }
        self.take(event, now, &mut actions);
        if self.shown != self.state() {
            self.shown = self.state();
            actions.push(Action::Show(self.shown));
        }
        actions
    }

    /// Leaves a state whose time is over.
    fn leave(&mut self, actions: &mut Vec<Action>, now: Duration) {
        let turn = self.turn;
        match self.phase {
            Phase::Idle => {}
            Phase::Listening => actions.push(Action::CancelSpeech),
            Phase::Recognizing => actions.extend([Action::CancelRecognition { turn }, Action::SayNotUnderstood]),
            Phase::Awaiting => actions.push(Action::SayNoAnswer),
            Phase::Speaking => actions.push(Action::StopSpeaking { turn }),
        }
        self.enter(Phase::Idle, now);
    }

    fn take(&mut self, event: Event, now: Duration, actions: &mut Vec<Action>) {
        match (event, self.phase) {
            (Event::SpeechStarted, phase) if !self.muted && phase != Phase::Listening => {
                let turn = self.turn;
                match phase {
                    // Barge-in, and a second thought before the first one was understood. An answer that is awaited may come;
                    // it is shown but not spoken.
                    Phase::Speaking => actions.push(Action::StopSpeaking { turn }),
                    Phase::Recognizing => actions.push(Action::CancelRecognition { turn }),
                    Phase::Idle | Phase::Listening | Phase::Awaiting => {}
                }
                self.enter(Phase::Listening, now);
            }
            (Event::SpeechEnded, Phase::Listening) => {
                self.turn += 1;
                self.enter(Phase::Recognizing, now);
                actions.push(Action::Recognize { turn: self.turn });
            }
            (Event::SpeechDropped, Phase::Listening) => self.enter(Phase::Idle, now),
            (Event::Understood { turn, text }, Phase::Recognizing) if turn == self.turn => {
                self.enter(Phase::Awaiting, now);
                actions.push(Action::Submit { turn, text });
            }
            (Event::NotUnderstood { turn }, Phase::Recognizing) if turn == self.turn => {
                self.enter(Phase::Idle, now);
                actions.push(Action::SayNotUnderstood);
            }
            (Event::Reply { turn, text }, Phase::Awaiting) if turn == self.turn => {
                self.enter(Phase::Speaking, now);
                actions.push(Action::Speak { turn, text });
            }
            (Event::ReplyEnded { turn }, Phase::Speaking) if turn == self.turn => self.enter(Phase::Idle, now),
            (Event::Mute, phase) => {
                self.muted = true;
                if phase == Phase::Listening {
                    self.enter(Phase::Idle, now);
                    actions.push(Action::CancelSpeech);
                }
            }
            (Event::Unmute, _) => self.muted = false,
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const S: Duration = Duration::from_secs(1);

    fn run(conversation: &mut Conversation, events: &[(u32, Event)]) -> Vec<Action> {
        events.iter().flat_map(|(at, event)| conversation.step(event.clone(), S * *at)).collect()
    }

    fn understood(turn: Turn) -> Event {
        Event::Understood { turn, text: "hide the sac".into() }
    }

    fn reply(turn: Turn) -> Event {
        Event::Reply { turn, text: "The sac is hidden.".into() }
    }

    #[test]
    fn a_turn_goes_through_all_states() {
        let mut conversation = Conversation::new(Deadlines::default());
        let events = [
            (1, Event::SpeechStarted),
            (2, Event::SpeechEnded),
            (3, understood(1)),
            (4, reply(1)),
            (5, Event::ReplyEnded { turn: 1 }),
        ];
        let shown = |actions: Vec<Action>| -> Vec<Action> { actions };
        assert_eq!(
            shown(run(&mut conversation, &events)),
            [
                Action::Show(State::Listening),
                Action::Recognize { turn: 1 },
                Action::Show(State::Thinking),
                Action::Submit { turn: 1, text: "hide the sac".into() },
                Action::Speak { turn: 1, text: "The sac is hidden.".into() },
                Action::Show(State::Speaking),
                Action::Show(State::Idle),
            ]
        );
    }

    #[test]
    fn speech_stops_a_reply_and_its_late_end_does_nothing() {
        let mut conversation = Conversation::new(Deadlines::default());
        run(
            &mut conversation,
            &[(1, Event::SpeechStarted), (2, Event::SpeechEnded), (3, understood(1)), (4, reply(1))],
        );
        let actions = run(&mut conversation, &[(5, Event::SpeechStarted), (5, Event::ReplyEnded { turn: 1 })]);
        assert_eq!(actions, [Action::StopSpeaking { turn: 1 }, Action::Show(State::Listening)]);
        let actions = run(&mut conversation, &[(6, Event::SpeechEnded), (6, understood(1)), (6, reply(1))]);
        assert_eq!(actions, [Action::Recognize { turn: 2 }, Action::Show(State::Thinking)]);
    }

    #[test]
    fn every_wait_ends_at_its_deadline() {
        let mut conversation = Conversation::new(Deadlines::default());
        let actions = run(&mut conversation, &[(0, Event::SpeechStarted), (1, Event::SpeechEnded), (12, Event::Tick)]);
        let end = [Action::CancelRecognition { turn: 1 }, Action::SayNotUnderstood, Action::Show(State::Idle)];
        assert_eq!(actions[3..], end);
        run(&mut conversation, &[(20, Event::SpeechStarted), (21, Event::SpeechEnded), (22, understood(2))]);
        let actions = run(&mut conversation, &[(90, reply(2))]);
        assert_eq!(actions, [Action::SayNoAnswer, Action::Show(State::Idle)], "too late");
    }

    #[test]
    fn a_mute_hears_nothing_and_lets_the_reply_sound() {
        let mut conversation = Conversation::new(Deadlines::default());
        let muted = [(1, Event::Mute), (2, Event::SpeechStarted), (3, Event::SpeechEnded)];
        assert_eq!(run(&mut conversation, &muted), [Action::Show(State::Muted)]);
        let open = [(4, Event::Unmute), (5, Event::SpeechStarted), (6, Event::Mute)];
        let actions = run(&mut conversation, &open);
        assert_eq!(actions[2..], [Action::CancelSpeech, Action::Show(State::Muted)]);
        run(&mut conversation, &[(7, Event::Unmute), (8, Event::SpeechStarted), (9, Event::SpeechEnded)]);
        run(&mut conversation, &[(10, understood(1)), (10, Event::Mute), (11, reply(1))]);
        assert_eq!((conversation.state(), conversation.is_muted()), (State::Speaking, true));
    }

    fn event() -> impl Strategy<Value = Event> {
        let turn = 0_u64..6;
        prop_oneof![
            3 => Just(Event::SpeechStarted),
            3 => Just(Event::SpeechEnded),
            1 => Just(Event::SpeechDropped),
            3 => turn.clone().prop_map(understood),
            1 => turn.clone().prop_map(|turn| Event::NotUnderstood { turn }),
            3 => turn.clone().prop_map(reply),
            2 => turn.prop_map(|turn| Event::ReplyEnded { turn }),
            1 => Just(Event::Mute),
            2 => Just(Event::Unmute),
            2 => Just(Event::Tick),
        ]
    }

    proptest! {
        #[test]
        fn any_events_keep_the_promises(events in proptest::collection::vec((0_u32..9, event()), 0..200)) {
            let mut conversation = Conversation::new(Deadlines::default());
            let (mut now, mut shown, mut speaking) = (0, State::Idle, None);
            let (mut recognized, mut submitted) = (0, 0);
            for (pause, event) in events {
                now += pause;
                let muted = conversation.is_muted();
                for action in conversation.step(event.clone(), S * now) {
                    match action {
                        Action::Show(state) => {
                            prop_assert_ne!(state, shown, "shown twice");
                            shown = state;
                        }
                        Action::Recognize { turn } => {
                            prop_assert!(turn == recognized + 1 && !muted);
                            recognized = turn;
                        }
                        Action::Submit { turn, .. } => {
                            prop_assert!(turn == recognized && turn > submitted, "submitted twice");
                            submitted = turn;
                        }
                        Action::Speak { turn, .. } => {
                            prop_assert!(turn == submitted && speaking.is_none(), "two replies at once");
                            speaking = Some(turn);
                        }
                        Action::StopSpeaking { turn } => prop_assert_eq!(speaking.take(), Some(turn)),
                        _ => {}
                    }
                }
                if matches!(event, Event::ReplyEnded { turn } if Some(turn) == speaking) {
                    speaking = None;
                }
                prop_assert_eq!(shown, conversation.state());
                prop_assert_eq!(speaking.is_some(), shown == State::Speaking);
                let waits = !matches!(shown, State::Idle | State::Muted);
                prop_assert_eq!(conversation.deadline().is_some(), waits);
                prop_assert!(conversation.deadline().is_none_or(|deadline| deadline > S * now));
            }
        }
    }
}
