//! What both hands do to a scene in the room, frame by frame: hold it, brush it, press buttons.

use std::sync::Arc;

use glam::DVec3;
use sg_proto::scene::{Redo, Undo, command::Action};
use sg_scene::mask::Mask;
use sg_scene::model::Scene;
use sg_selection::brush::Brush;

use crate::display::{BrushMode, Hand, Request, Scrub, Scrubs, Sense, Shown, Tip, Tools, Turns};
use crate::hands::{HandInput, Handling, Placement, Side, Switch, Turning};

/// How far before the controller its tip is, metres.
const REACH: f64 = 0.08;

/// Factor on the brush's radius in a second of a stick at its end.
const WIDENS: f64 = 3.0;

/// Share of the range of a walk's leak or threshold that a stick at its end goes through in a second.
const SCRUBS: f64 = 0.35;

/// A stick is pushed aside beyond this.
const PUSHED: f64 = 0.7;

/// A stick at rest is within this of its middle.
const REST: f64 = 0.3;

/// Degrees that a scene turns evenly in a second of a stick at its end.
const EVENLY: f64 = 45.0;

/// Strength of what a hand feels when its stroke hits more.
const TICK: f32 = 0.3;

/// What hands did in one frame.
#[derive(Debug, Default)]
pub struct Did {
    /// To be handed to the seat, in this order.
    pub requests: Vec<Request>,
    /// Which hands feel something, and how strongly.
    pub felt: Vec<(Side, f32)>,
    /// Whether panels are to be shown where they were hidden, and the other way round.
    pub panels: bool,
    /// Whether the scene was put elsewhere at once: by a snap turn, or back to where it was fitted.
    pub jumped: bool,
}

/// A brush as it is seen in the room.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenTip {
    /// Its middle, in the room.
    pub at: DVec3,
    /// Its radius in metres.
    pub radius: f64,
    /// Which way it acts.
    pub sense: Sense,
}

/// What of the hands belongs to panels in this frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Taken {
    /// Triggers, left and right.
    pub triggers: [bool; 2],
    /// Grips, left and right.
    pub grips: [bool; 2],
}

/// Buttons of a hand as they were.
#[derive(Debug, Clone, Copy, Default)]
struct Buttons {
    primary: bool,
    secondary: bool,
    stick: bool,
    menu: bool,
}

/// Both hands over one scene.
#[derive(Debug)]
pub struct Acts {
    handling: Handling,
    brushes: [Hand; 2],
    triggers: [Switch; 2],
    buttons: [Buttons; 2],
    tips: [Option<Tip>; 2],
    hits: [usize; 2],
    /// The last walk under the stick of the hand that adds.
    scrub: Scrub,
    /// Whether the other hand's stick is pushed aside.
    pushed: bool,
}

impl Acts {
    /// Hands over a scene that stands at `home`.
    #[must_use]
    pub fn new(scene: &Scene, home: Placement) -> Self {
        let brush = Arc::new(Brush::of_scene(scene));
        let pid = std::process::id();
        let hand = |name: &str| Hand::new(scene, Arc::clone(&brush), format!("{name}-{pid}"));
        Self {
            handling: Handling::new(home, 0.5 * (scene.bounds.min + scene.bounds.max)),
            brushes: [hand("left"), hand("right")],
            triggers: [Switch::default(); 2],
            buttons: [Buttons::default(); 2],
            tips: [None; 2],
            hits: [0; 2],
            scrub: Scrub::default(),
            pushed: false,
        }
    }

    /// Where the scene stands.
    #[must_use]
    pub fn placement(&self) -> Placement {
        self.handling.placement()
    }

    /// Brings the scene back to where it was fitted, or elsewhere.
    pub fn go(&mut self, to: Option<Placement>) {
        match to {
            Some(placement) => self.handling.go(placement),
            None => self.handling.reset(),
        }
    }

    /// Gives the scene another first place, and brings it there.
    pub fn refit(&mut self, home: Placement, middle: DVec3) {
        self.handling.refit(home, middle);
    }

    /// The hand that adds; the other one takes away.
    #[must_use]
    pub fn adds(tools: &Tools) -> Side {
        if tools.left_handed { Side::Left } else { Side::Right }
    }

    fn sense(side: Side, tools: &Tools) -> Sense {
        if side == Self::adds(tools) { Sense::Add } else { Sense::Remove }
    }

    /// Takes in what both hands do after `seconds`; `head` is where it is in the room.
    pub fn step(
        &mut self,
        hands: &[HandInput; 2],
        taken: Taken,
        (head, seconds): (DVec3, f64),
        tools: &mut Tools,
        shown: &Shown,
    ) -> Did {
        let adds = Self::adds(tools);
        let mut did = Did::default();
        let may_grab = taken.grips.map(|taken| !taken);
        let before = self.placement();
        let turning = match tools.turns {
            Turns::AtOnce => Turning::default(),
            Turns::Evenly => Turning::Smooth(EVENLY),
            Turns::Never => Turning::Off,
        };
        self.handling.step(hands, may_grab, (head, turning, adds), seconds);
        // What no hand holds moves by the stick alone.
        did.jumped = tools.turns == Turns::AtOnce && !self.handling.is_held() && before != self.placement();
        if seconds.is_finite() {
            self.sticks(hands, taken, seconds.clamp(0.0, 0.1), tools, shown, &mut did);
        }
        for side in Side::BOTH {
            self.press(side, &hands[side.index()], tools, shown, &mut did);
            self.brush(side, &hands[side.index()], taken, tools, shown, &mut did);
        }
        did
    }

    /// What sticks do up and down: the hand that adds scrubs the last walk while strokes mean walks, else both say how wide the
    /// brush is. The other one aside: which number of the walk that is.
    fn sticks(
        &mut self,
        hands: &[HandInput; 2],
        taken: Taken,
        seconds: f64,
        tools: &mut Tools,
        shown: &Shown,
        did: &mut Did,
    ) {
        let adds = Self::adds(tools);
        let scrubs = Self::scrubs(tools, shown) && !self.brushes.iter().any(Hand::draws);
        let mut goes_on = false;
        for side in Side::BOTH {
            let k = side.index();
            let stick = hands[k].stick.y;
            // A stick sizes the panel that its hand carries, and scrolls the one that it points at.
            if stick.abs() <= REST || taken.triggers[k] || taken.grips[k] {
                continue;
            }
            if side == adds && scrubs {
                goes_on = true;
                did.requests.extend(self.scrub.turn(tools.scrubs, SCRUBS * stick * seconds, shown));
            } else {
                tools.widen(WIDENS.powf(stick * seconds));
            }
        }
        if self.scrub.is_held() && !goes_on {
            did.requests.extend(self.scrub.release(shown.scene.revision()));
        }
        let aside = hands[adds.other().index()].stick.x;
        let was = std::mem::replace(&mut self.pushed, aside.abs() > PUSHED);
        if self.pushed && !was && !taken.triggers[adds.other().index()] && Self::scrubs(tools, shown) {
            tools.scrubs = if aside < 0.0 { Scrubs::Leak } else { Scrubs::Threshold };
        }
    }

    /// Whether the stick changes the last walk rather than the brush.
    fn scrubs(tools: &Tools, shown: &Shown) -> bool {
        tools.mode == BrushMode::Walk && shown.tuning().is_some()
    }

    fn press(&mut self, side: Side, hand: &HandInput, tools: &mut Tools, shown: &Shown, did: &mut Did) {
        let was = std::mem::replace(
            &mut self.buttons[side.index()],
            Buttons { primary: hand.primary, secondary: hand.secondary, stick: hand.stick_click, menu: hand.menu },
        );
        let change = |action| Request::Change(Box::new(action));
        let adds = side == Self::adds(tools);
        if hand.primary && !was.primary {
            match adds {
                true => tools.mode = tools.mode.next(),
                false if shown.offered.scene => did.requests.push(change(Action::Redo(Redo { steps: 1 }))),
                false => (),
            }
        }
        if hand.secondary && !was.secondary {
            match adds {
                true if shown.offered.scene => did.requests.push(change(Action::Undo(Undo { steps: 1 }))),
                true => (),
                false => did.panels = true,
            }
        }
        did.panels |= hand.menu && !was.menu;
        if hand.stick_click && !was.stick {
            self.handling.reset();
            did.jumped = true;
        }
    }

    fn brush(&mut self, side: Side, hand: &HandInput, taken: Taken, tools: &Tools, shown: &Shown, did: &mut Did) {
        let k = side.index();
        let was = self.triggers[k].is_on();
        let pulled = self.triggers[k].press(hand.trigger);
        let placement = self.placement();
        let holds = self.handling.is_held() && self.handling.is_squeezed(side);
        let free = shown.offered.selection && !taken.triggers[k] && !holds;
        let pressure = if tools.pressure { hand.trigger.clamp(0.0, 1.0) } else { 1.0 };
        let aim = hand.aim.or(hand.grip).filter(|_| free || self.brushes[k].draws());
        self.tips[k] = aim.map(|aim| Tip { at: placement.to_scene(aim.position + REACH * aim.forward()), pressure });
        let brush = &mut self.brushes[k];
        match self.tips[k] {
            Some(tip) if pulled && brush.draws() => brush.sample(tip),
            Some(tip) if pulled && !was => {
                brush.press(tools, tip, Self::sense(side, tools));
                self.hits[k] = 0;
            }
            _ => (),
        }
        did.requests.extend(brush.news());
        let hits = brush.hits();
        if brush.draws() && hits > self.hits[k] {
            did.felt.push((side, TICK));
        }
        self.hits[k] = hits;
        if brush.draws() && !pulled {
            did.requests.extend(brush.release());
        }
    }

    /// What is highlighted: what is selected, with strokes under way, or with what they would change if they were begun here.
    #[must_use]
    pub fn highlighted(&self, shown: &Shown, tools: &Tools) -> Arc<Mask> {
        let clusters = shown.clusters.as_deref();
        let mut selected = Arc::clone(&shown.selected);
        for side in Side::BOTH {
            let (brush, tip) = (&self.brushes[side.index()], self.tips[side.index()]);
            if brush.draws() {
                selected = brush.selects(&selected, clusters);
            } else if let Some(tip) = tip {
                let sense = Self::sense(side, tools);
                selected = Arc::new(brush.would_select(tools, tip, sense, &selected, clusters));
            }
        }
        selected
    }

    /// The brushes as they are seen in the room, left and right.
    #[must_use]
    pub fn tips(&self, tools: &Tools) -> [Option<SeenTip>; 2] {
        Side::BOTH.map(|side| {
            let tip = self.tips[side.index()]?;
            let placement = self.placement();
            let radius = self.brushes[side.index()].radius(tools) * tip.pressure * placement.scale;
            Some(SeenTip { at: placement.to_room(tip.at), radius, sense: Self::sense(side, tools) })
        })
    }

    /// What each control does now, for the legend of one hand.
    #[must_use]
    pub fn legend(side: Side, tools: &Tools, shown: &Shown) -> Vec<(&'static str, String)> {
        let adds = side == Self::adds(tools);
        let [one, two, two_or_menu] = if side == Side::Right { ["A", "B", "B, menu"] } else { ["X", "Y", "Y, menu"] };
        let mut lines = Vec::new();
        if shown.offered.selection {
            let what = if adds { "adds" } else { "takes away" };
            lines.push(("trigger", format!("{what}: {}", tools.mode.name())));
        }
        lines.push(("grip", "holds the scene; both scale it".to_owned()));
        if adds {
            let changes = match shown.tuning().filter(|_| Self::scrubs(tools, shown)) {
                Some(tuning) => format!("{} {}", tools.scrubs.name(), tools.scrubs.written(tuning)),
                None => "width".to_owned(),
            };
            let turns = if tools.turns == Turns::Never { "" } else { "turns; " };
            lines.push(("stick", format!("{turns}up and down: {changes}")));
            lines.push((one, format!("next mode: {}", tools.mode.next().name())));
        }
        if shown.offered.scene {
            let line = |what: &str, lines: &[String]| match lines.first() {
                Some(line) => format!("{what} {line}"),
                None => format!("nothing to {what}"),
            };
            lines.push(if adds { (two, line("undo", &shown.undo)) } else { (one, line("redo", &shown.redo)) });
        }
        if !adds {
            lines.push(("stick", "up and down: width".to_owned()));
            if Self::scrubs(tools, shown) {
                lines.push(("stick aside", "left: leak, right: threshold".to_owned()));
            }
            lines.push((two_or_menu, "panels".to_owned()));
            lines.push(("palm to the eyes", "a menu".to_owned()));
        }
        lines.push(("stick pressed", "back to the first place".to_owned()));
        lines
    }
}
