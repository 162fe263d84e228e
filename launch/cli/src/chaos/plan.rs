//! The plan of faults: kinds, targets and moments, drawn from a seed before the start.

use std::fmt;

use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sg_proto::keys::role;

/// Share of the session's steps that have a fault. The other steps show that the stack has recovered.
const DENSITY: f64 = 0.75;
/// Shortest and longest pause of a stopped process, milliseconds. Both are below any sensible `liveness`.
const PAUSE_MS: std::ops::Range<u64> = 30..700;
/// Shortest and longest time for which the supervisor stands still, milliseconds. Both are above the `liveness` of a run,
/// and above the time after which the bus takes a connection for dead.
const STANDSTILL_MS: std::ops::Range<u64> = 3000..7500;
/// Shortest and longest time for which the disk takes no write, milliseconds. After 3 s the journal refuses a command.
const STALL_MS: std::ops::Range<u64> = 1000..6000;

/// Kind of a fault.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) enum Kind {
    /// `kill -9` of one service.
    #[default]
    Kill,
    /// SIGTERM to one service.
    Terminate,
    /// `supergaussian restart` of one service.
    Restart,
    /// `supergaussian swap` of one service for its own executable.
    Swap,
    /// SIGSTOP of one service, without an end. The supervisor must notice.
    Hang,
    /// SIGSTOP and an early SIGCONT, so that no deadline passes.
    Pause,
    /// `kill -9` of two services at once.
    Two,
    /// `kill -9`, and a second one during the restart.
    AtStart,
    /// `kill -9` of the supervisor.
    Supervisor,
    /// `kill -9` of the supervisor and all services.
    Everything,
    /// The scene's process cannot write to disk.
    NoRoom,
    /// SIGSTOP of the supervisor for longer than any sign of life may take. No service may be restarted.
    Standstill,
    /// The same as at a suspended terminal: SIGTSTP to the supervisor's process group, as by Ctrl-Z, and SIGCONT, as by `fg`.
    Suspended,
    /// The supervisor stands still in the middle of a swap. The swap must be done afterwards, and nobody else restarted.
    SwapStandstill,
    /// SIGSTOP of the supervisor and all services, as of a suspended machine or container. No service may be restarted.
    Frozen,
    /// The disk under the project takes no write for a while.
    Stalled,
}

impl Kind {
    /// All kinds, with their numbers in one deck.
    const DECK: [(Self, usize); 16] = [
        (Self::Kill, 7),
        (Self::Terminate, 2),
        (Self::Restart, 2),
        (Self::Swap, 2),
        (Self::Hang, 1),
        (Self::Pause, 3),
        (Self::Two, 2),
        (Self::AtStart, 2),
        (Self::Supervisor, 1),
        (Self::Everything, 1),
        (Self::NoRoom, 2),
        (Self::Standstill, 1),
        (Self::Suspended, 1),
        (Self::SwapStandstill, 1),
        (Self::Frozen, 1),
        (Self::Stalled, 2),
    ];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Kill => "kill -9",
            Self::Terminate => "SIGTERM",
            Self::Restart => "restart",
            Self::Swap => "swap",
            Self::Hang => "SIGSTOP",
            Self::Pause => "SIGSTOP, SIGCONT",
            Self::Two => "kill -9 two",
            Self::AtStart => "kill -9 twice",
            Self::Supervisor => "kill -9 supervisor",
            Self::Everything => "kill -9 everything",
            Self::NoRoom => "disk full",
            Self::Standstill => "SIGSTOP supervisor",
            Self::Suspended => "Ctrl-Z, fg",
            Self::SwapStandstill => "swap, SIGSTOP supervisor",
            Self::Frozen => "SIGSTOP everything",
            Self::Stalled => "disk stalled",
        }
    }

    /// Whether it needs a step that is one scene command.
    fn needs_command(self) -> bool {
        matches!(self, Self::NoRoom | Self::Stalled)
    }
}

/// One fault.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Fault {
    pub(super) kind: Kind,
    /// Targets: services, or [`role::SUPERVISOR`].
    pub(super) targets: Vec<String>,
    /// Step of the session, from 0.
    pub(super) step: usize,
    /// Moment within the step, as a share of its duration without faults.
    pub(super) moment: f64,
    /// Length of a pause in milliseconds. For a second kill, the time after the new process appeared.
    pub(super) pause_ms: u64,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { kind, targets, step, moment, pause_ms } = self;
        write!(f, "step {}, {:.0} % in: {}", step + 1, 100.0 * moment, kind.name())?;
        match kind {
            Kind::Supervisor | Kind::Everything => Ok(()),
            Kind::Standstill | Kind::Suspended | Kind::Frozen => write!(f, " ({pause_ms} ms)"),
            Kind::SwapStandstill | Kind::Stalled => write!(f, " {} ({pause_ms} ms)", targets.join(", ")),
            Kind::Pause | Kind::AtStart => write!(f, " {} ({pause_ms} ms between)", targets.join(", ")),
            _ => write!(f, " {}", targets.join(", ")),
        }
    }
}

/// Shape of a session.
pub(super) struct Session<'a> {
    /// For each step of one round, whether it is a scene command whose refusal the sender sees.
    pub(super) round: &'a [bool],
    /// The same for the steps between two rounds.
    pub(super) between: &'a [bool],
    pub(super) services: &'a [String],
    /// The service with the journal.
    pub(super) scene: &'a str,
}

/// The number of rounds, and the faults in order. Each step has at most one fault.
pub(super) fn plan(session: &Session<'_>, faults: usize, seed: u64) -> (usize, Vec<Fault>) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let deck: Vec<_> = Kind::DECK.iter().flat_map(|(kind, n)| std::iter::repeat_n(*kind, *n)).collect();
    let mut kinds = Deck::of(deck);
    let kinds: Vec<_> = (0..faults).map(|_| kinds.draw(&mut random)).collect();
    let picky = kinds.iter().filter(|k| k.needs_command()).count();

    let mut rounds = 1;
    let steps = loop {
        let steps = session.steps(rounds);
        let commands = steps.iter().filter(|c| **c).count();
        // A session without scene commands has no steps between its rounds.
        let enough = commands >= picky || (rounds > picky && commands == 0);
        if enough && steps.len() as f64 * DENSITY >= faults as f64 {
            break steps;
        }
        rounds += 1;
    };
    let mut places: Vec<_> = (0..steps.len()).collect();
    places.shuffle(&mut random);
    let mut services = Deck::of(session.services.to_vec());
    let mut everyone = session.services.to_vec();
    everyone.push(role::SUPERVISOR.to_owned());
    let mut everyone = Deck::of(everyone);

    let mut plan = Vec::with_capacity(faults);
    // Place the kinds with few possible steps first.
    let (picky, others): (Vec<_>, Vec<_>) = kinds.into_iter().partition(|k| k.needs_command());
    for kind in picky.into_iter().chain(others) {
        let fits = |step: &usize| !kind.needs_command() || steps.get(*step).is_some_and(|command| *command);
        let Some(place) = places.iter().position(fits) else { continue };
        let mut targets = match kind {
            Kind::Kill | Kind::Terminate | Kind::Restart | Kind::Swap | Kind::Hang | Kind::SwapStandstill => {
                vec![services.draw(&mut random)]
            }
            Kind::Pause | Kind::AtStart => vec![everyone.draw(&mut random)],
            Kind::Two => {
                let one = services.draw(&mut random);
                let others = session.services.iter().filter(|s| **s != one).cloned().collect();
                let other = Deck::of(others).draw(&mut random);
                vec![one, other]
            }
            Kind::Supervisor | Kind::Everything | Kind::Standstill | Kind::Suspended | Kind::Frozen => {
                vec![role::SUPERVISOR.to_owned()]
            }
            Kind::NoRoom | Kind::Stalled => vec![session.scene.to_owned()],
        };
        // A stack of one service has no second target.
        targets.retain(|name| !name.is_empty());
        plan.push(Fault {
            kind,
            targets,
            step: places.swap_remove(place),
            moment: if kind.needs_command() { 0.0 } else { random.random_range(0.0..1.0) },
            pause_ms: match kind {
                Kind::Standstill | Kind::Suspended | Kind::SwapStandstill | Kind::Frozen => {
                    random.random_range(STANDSTILL_MS)
                }
                Kind::Stalled => random.random_range(STALL_MS),
                _ => random.random_range(PAUSE_MS),
            },
        });
    }
    plan.sort_by_key(|fault| fault.step);
    (rounds, plan)
}

impl Session<'_> {
    fn steps(&self, rounds: usize) -> Vec<bool> {
        let first = self.round.iter().copied();
        let further = self.between.iter().chain(self.round).copied();
        first.chain(std::iter::repeat_n(further, rounds.saturating_sub(1)).flatten()).collect()
    }
}

/// A deck of cards: shuffled, dealt to the last card, and shuffled again.
struct Deck<T> {
    cards: Vec<T>,
    left: Vec<T>,
}

impl<T: Clone + Default> Deck<T> {
    fn of(cards: Vec<T>) -> Self {
        Self { cards, left: Vec::new() }
    }

    fn draw(&mut self, random: &mut ChaCha8Rng) -> T {
        if self.left.is_empty() {
            self.left.clone_from(&self.cards);
            self.left.shuffle(random);
        }
        self.left.pop().unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::{BTreeMap, BTreeSet};

    fn drawn(faults: usize, seed: u64) -> (usize, Vec<Fault>) {
        let services = ["scene", "view", "talk"].map(str::to_owned);
        let session =
            Session { round: &[false, false, true, false], between: &[true], services: &services, scene: "scene" };
        plan(&session, faults, seed)
    }

    #[test]
    fn a_plan_repeats_for_a_seed_and_differs_for_another() {
        assert_eq!(drawn(100, 7), drawn(100, 7));
        assert_ne!(drawn(100, 7), drawn(100, 8));
    }

    #[test]
    fn all_kinds_and_services_are_drawn_once_per_step() {
        let two_decks = 2 * Kind::DECK.iter().map(|(_, n)| n).sum::<usize>();
        let (rounds, faults) = drawn(two_decks, 3);
        assert_eq!(faults.len(), two_decks);
        let steps: BTreeSet<_> = faults.iter().map(|f| f.step).collect();
        assert_eq!(steps.len(), two_decks);
        assert!(steps.iter().all(|s| *s < 4 + 5 * (rounds - 1)));
        let mut kinds = BTreeMap::new();
        for fault in &faults {
            *kinds.entry(fault.kind).or_insert(0) += 1;
        }
        assert_eq!(kinds, Kind::DECK.iter().map(|(kind, n)| (*kind, 2 * n)).collect());
        for name in ["scene", "view", "talk", role::SUPERVISOR] {
            assert!(faults.iter().any(|f| f.targets.iter().any(|w| w == name)), "{name} was spared");
        }
        assert!(
            faults.iter().filter(|f| f.kind == Kind::Two).all(|f| f.targets.len() == 2 && f.targets[0] != f.targets[1])
        );
        // Of five steps, 3 and 5 are scene commands. Only those can be refused on a full disk or stalled.
        assert!(faults.iter().filter(|f| f.kind.needs_command()).all(|f| matches!(f.step % 5, 2 | 4)));
    }
}
