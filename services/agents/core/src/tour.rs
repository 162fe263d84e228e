//! Tours: from unit to unit, each in its best view, with a sentence that is shown and spoken.
//!
//! A tour runs beside the utterances. It asks the function agent for each view and description, and the speech service for the
//! voice. Somebody who speaks stops the voice, and the tour waits then.

use std::sync::Arc;
use std::time::{Duration, Instant};

use sg_language::prompt::clip;
use sg_language::{grammar, request_ids};
use sg_proto::keys;
use sg_proto::language::{Act, Clause, Plan, Reference, Reply, Source, Tour, TourStep, Utterance};
use sg_proto::speech::{Control, ControlRequest, SpeakReply, SpeakRequest};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use tokio::sync::{mpsc, watch};

use crate::published_state::PublishedState;
use crate::publishing::publish;

/// Changes that wait for a tour. More at once are dropped.
const STEPS: usize = 8;
/// Time for the view and the description of one stop: a large unit takes seconds to draw.
const STOP_TIME: Duration = Duration::from_secs(30);
/// Longest time for the voice of one stop.
const VOICE_TIME: Duration = Duration::from_secs(90);
/// Time for the speech service to end a voice.
const CONTROL_TIME: Duration = Duration::from_secs(1);
/// Shortest and longest time to read a stop, and the time for one of its characters.
const READING: [Duration; 2] = [Duration::from_secs(4), Duration::from_secs(20)];
const READING_PER_CHARACTER: Duration = Duration::from_millis(55);
/// Silence after the voice.
const SILENCE: Duration = Duration::from_secs(1);
/// Time after which a tour that waits ends by itself.
const PATIENCE: Duration = Duration::from_secs(30 * 60);
/// Longest spoken text, as the speech service takes it.
const MAX_SPOKEN_BYTES: usize = 4000;

/// Begins tours, and changes the one that is under way.
pub(crate) struct TourGuide {
    bus: Bus,
    /// Number of live speech services.
    voices: watch::Receiver<usize>,
    state: Arc<PublishedState>,
    under_way: Option<mpsc::Sender<TourStep>>,
}

impl TourGuide {
    pub(crate) fn new(bus: Bus, voices: watch::Receiver<usize>, state: Arc<PublishedState>) -> Self {
        Self { bus, voices, state, under_way: None }
    }

    /// Carries out a change. The sentence says what follows, or why nothing does. A tour that begins speaks for itself.
    pub(crate) async fn change(
        &mut self,
        step: TourStep,
        stops: &[String],
    ) -> Result<Option<&'static str>, &'static str> {
        let text = match step {
            TourStep::Start | TourStep::Unspecified => {
                self.begin(stops.to_vec()).await;
                return Ok(None);
            }
            TourStep::Pause => "The tour waits here. Say “go on” to continue.",
            TourStep::Resume => "The tour goes on.",
            TourStep::Next => "On to the next stop.",
            TourStep::Previous => "Back to the previous stop.",
            TourStep::End => "The tour ends.",
        };
        let steps = self.under_way.as_ref().filter(|steps| !steps.is_closed());
        let steps = steps.ok_or("No tour is under way. Say “give me a tour” to begin one.")?;
        steps.try_send(step).map_err(|_| "The tour is still on its way to the last stop that you asked for.")?;
        Ok(Some(text))
    }

    /// Lets the tour wait, since somebody does something else. Returns whether it did not wait already.
    pub(crate) fn interrupt(&self) -> bool {
        let is_moving = self.state.tour().is_some_and(|tour| !tour.paused);
        let steps = self.under_way.as_ref().filter(|steps| is_moving && !steps.is_closed());
        steps.is_some_and(|steps| steps.try_send(TourStep::Pause).is_ok())
    }

    /// Begins a tour. One that is under way ends.
    async fn begin(&mut self, stops: Vec<String>) {
        let (sender, steps) = mpsc::channel(STEPS);
        // The former tour sees that its sender is gone.
        self.under_way = Some(sender);
        let tour = Tour { stops, at: 0, paused: false };
        self.state.set_tour(Some(tour.clone())).await;
        let walk = Walk { bus: self.bus.clone(), voices: self.voices.clone(), state: Arc::clone(&self.state), tour };
        tokio::spawn(walk.run(steps));
    }
}

/// What a stop ended with.
enum Visited {
    /// It was read or heard to its end.
    Whole,
    /// Somebody spoke, or an agent is away.
    Interrupted,
}

/// A tour under way.
struct Walk {
    bus: Bus,
    voices: watch::Receiver<usize>,
    state: Arc<PublishedState>,
    tour: Tour,
}

impl Walk {
    /// Goes from stop to stop. The first one is published already: whoever began the tour may ask for it at once.
    async fn run(mut self, mut steps: mpsc::Receiver<TourStep>) {
        while let Some(stop) = self.stop() {
            let step = {
                let visit = self.visit(&stop);
                tokio::pin!(visit);
                tokio::select! {
                    visited = &mut visit => match visited {
                        Visited::Whole => Some(TourStep::Next),
                        Visited::Interrupted => Some(TourStep::Pause),
                    },
                    step = steps.recv() => {
                        self.end_voice().await;
                        step
                    }
                }
            };
            let step = match step {
                Some(TourStep::Pause) => self.wait(&mut steps).await,
                other => other,
            };
            match step {
                Some(TourStep::Next | TourStep::Resume) => self.tour.at += 1,
                Some(TourStep::Previous) => self.tour.at = self.tour.at.saturating_sub(1),
                Some(TourStep::Pause | TourStep::Start | TourStep::Unspecified) => {}
                Some(TourStep::End) => break,
                // Another tour has begun, or the agent ends.
                None => return,
            }
            if self.stop().is_some() {
                self.publish_tour().await;
            }
        }
        let whole = self.tour.at as usize >= self.tour.stops.len();
        self.state.set_tour(None).await;
        if whole {
            self.tell("Tour", "The tour ends here.", true, Vec::new(), 0).await;
        }
    }

    /// Waits at a stop until somebody says more. A change that goes on is returned.
    async fn wait(&mut self, steps: &mut mpsc::Receiver<TourStep>) -> Option<TourStep> {
        self.tour.paused = true;
        self.publish_tour().await;
        let step = loop {
            match tokio::time::timeout(PATIENCE, steps.recv()).await {
                Ok(Some(TourStep::Pause)) => {}
                Ok(step) => break step,
                Err(_) => break Some(TourStep::End),
            }
        };
        self.tour.paused = false;
        step
    }

    /// The present stop. `None`: the tour is over.
    fn stop(&self) -> Option<String> {
        self.tour.stops.get(self.tour.at as usize).cloned()
    }

    async fn publish_tour(&self) {
        self.state.set_tour(Some(self.tour.clone())).await;
    }

    /// Shows a stop, describes it, and waits until it is heard or read.
    async fn visit(&self, stop: &str) -> Visited {
        let context = Context::root().deadline_in(STOP_TIME);
        let title = format!("Tour, stop {} of {}: {stop}", self.tour.at + 1, self.tour.stops.len());
        let clause = |act: Act| Clause {
            act: act.into(),
            target: Some(Reference { names: vec![stop.to_owned()], ..Reference::default() }),
            words: stop.to_owned(),
            ..Clause::default()
        };
        let plan = Plan { clauses: vec![clause(Act::BestView), clause(Act::Describe)], observation: None };
        let execute = context.next().with_id(request_ids::plan(&context.id));
        let outcome = self.bus.ask(&keys::EXECUTE, &plan, &execute).await;
        let (text, ok, actions, revision) = match outcome {
            Ok(outcome) => {
                let ok = outcome.actions.iter().all(|action| action.ok);
                // What it is comes before how it is seen.
                let texts: Vec<&str> = outcome.actions.iter().rev().map(|action| action.text.as_str()).collect();
                (texts.join(" "), ok, outcome.actions, outcome.revision)
            }
            Err(fault) => {
                self.tell(&title, &format!("{} The tour waits.", fault.message), false, Vec::new(), 0).await;
                return Visited::Interrupted;
            }
        };
        let begun = Instant::now();
        self.tell(&title, &text, ok, actions, revision).await;
        if let Some(spoken) = self.speak(&text).await {
            if spoken.stopped {
                return Visited::Interrupted;
            }
            tokio::time::sleep(SILENCE).await;
        }
        tokio::time::sleep(reading_time(&text).saturating_sub(begun.elapsed())).await;
        Visited::Whole
    }

    /// Has a text spoken to its end, where somebody has a voice.
    async fn speak(&self, text: &str) -> Option<SpeakReply> {
        if *self.voices.borrow() == 0 {
            return None;
        }
        let request = SpeakRequest { text: clip(text, MAX_SPOKEN_BYTES).to_owned() };
        let context = Context::root().deadline_in(VOICE_TIME);
        let spoken = self.bus.ask(&keys::SPEECH_SPEAK, &request, &context).await;
        spoken.inspect_err(|fault| tracing::debug!(%fault, "a stop of a tour is silent")).ok()
    }

    /// Ends the voice of a stop that is left.
    async fn end_voice(&self) {
        if *self.voices.borrow() == 0 {
            return;
        }
        let request = ControlRequest { control: Control::StopSpeaking.into() };
        let context = Context::root().deadline_in(CONTROL_TIME);
        if let Err(fault) = self.bus.ask(&keys::SPEECH_CONTROL, &request, &context).await {
            tracing::debug!(%fault, "the voice of a stop goes on");
        }
    }

    /// Publishes a turn of the conversation.
    async fn tell(
        &self,
        title: &str,
        text: &str,
        ok: bool,
        actions: Vec<sg_proto::language::ActionResult>,
        revision: u64,
    ) {
        let context = Context::root();
        let turn = |step| context.next().at_step(context.id.clone(), step);
        let utterance = Utterance { text: title.to_owned(), source: Source::Text.into(), ..Utterance::default() };
        publish(&self.bus, &keys::UTTERANCE, &utterance, &turn(1)).await;
        let reply = Reply {
            text: text.to_owned(),
            facts: text.to_owned(),
            backend: grammar::NAME.to_owned(),
            ok,
            revision,
            actions,
            ..Reply::default()
        };
        publish(&self.bus, &keys::REPLY, &reply, &turn(2)).await;
    }
}

/// How long a person takes to read a text.
fn reading_time(text: &str) -> Duration {
    let characters = u32::try_from(text.chars().count()).unwrap_or(u32::MAX);
    let [least, most] = READING;
    READING_PER_CHARACTER.saturating_mul(characters).clamp(least, most)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn longer_texts_take_longer_to_read_within_bounds() {
        let time = |characters: usize| reading_time(&"x".repeat(characters));
        assert_eq!((time(0), time(100), time(10_000)), (READING[0], Duration::from_millis(5500), READING[1]));
    }
}
