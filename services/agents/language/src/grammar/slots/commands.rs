//! The commands that a set of slots can mean, as sentences of the grammar.

use super::cues::Cue::{
    self, Above, Add, Ambient, And, Back, Background, Behind, Below, Best, Bright, By, ColorNoun, Cool, Dark, Degrees,
    Deselect, Diffuse, Double, Down, Dull, Except, Fade, Faint, Farther, Frame, Front, Half, Headlight, Hide, Initial,
    Inverse, Left, Less, Light, Lock, More, Much, Nearer, Normals, Nothing, Only, Opacity, Opaque, Paint, Reset, Right,
    Rotate, Select, Selection, Set, Shading, Shiny, Show, Slightly, Specular, Swap, Transparency, Transparent, Unlock,
    Up, View, Vivid, Warm,
};
use super::{Amount, Part, Slots};

/// Directions.
const WAYS: [Cue; 9] = [Left, Right, Above, Below, Behind, Front, Back, Up, Down];

/// Degrees of a change.
const STEPS: [Cue; 8] = [More, Less, Up, Down, Slightly, Much, Half, Double];

/// A command: the cues of which it needs one, those that may stand beside it, and its sentence.
struct Command {
    needs: &'static [Cue],
    allows: &'static [&'static [Cue]],
    sentence: fn(&Slots) -> Option<String>,
}

/// All commands. The first that fits is taken, so the more special ones come first.
const COMMANDS: [Command; 19] = [
    Command { needs: &[Deselect], allows: &[&[Set, Selection]], sentence: |s| s.alone("clear the selection") },
    Command { needs: &[Background], allows: &[&[Set, Paint, ColorNoun, View]], sentence: background },
    Command {
        needs: &[Normals],
        allows: &[&[Set, Show, Only, View, Shading]],
        sentence: |s| s.alone("show the normals"),
    },
    Command {
        needs: &[Ambient, Diffuse, Specular, Shiny],
        allows: &[&STEPS, &[Set, Hide, Light, Show, Only, Shading]],
        sentence: light_part,
    },
    Command { needs: &[Headlight], allows: &[&[Set, Back, Show, Light]], sentence: |s| s.alone("use a headlight") },
    Command { needs: &[Light], allows: &[&WAYS, &STEPS, &[Set, Bright, Dark, Show, By]], sentence: light },
    Command { needs: &[Best], allows: &[&[Set, View, Rotate, Show, Frame, Hide, Select]], sentence: best_view },
    Command { needs: &[Initial], allows: &[&[Set, View, Back, Reset, Show]], sentence: initial },
    Command {
        needs: &[Select, Selection, Inverse, Add],
        allows: &[&[Set, Except, And, Show, Only, Swap]],
        sentence: select,
    },
    Command { needs: &[Lock, Unlock], allows: &[&[Set, Except, And]], sentence: lock },
    Command {
        needs: &[Nearer, Farther, Frame],
        allows: &[&STEPS, &[Set, View, Show, And, Back, Hide]],
        sentence: zoom,
    },
    Command { needs: &[Rotate, View], allows: &[&WAYS, &[Set, Degrees, By, Show, Slightly]], sentence: turn },
    Command {
        needs: &[Opacity, Transparency, Opaque, Transparent, Faint, Fade],
        allows: &[&STEPS, &[Set, By, Except, And, Show]],
        sentence: opacity,
    },
    Command { needs: &[Only, Nothing], allows: &[&[Set, Show, Hide, And, Except, View]], sentence: only },
    Command {
        needs: &[Vivid, Dull, Warm, Cool, Bright, Dark],
        allows: &[&STEPS, &[Set, ColorNoun, Paint, Except, And]],
        sentence: tone,
    },
    Command {
        needs: &[Hide],
        allows: &[&[Set, And, Except]],
        sentence: |s| Some(format!("hide {}", s.target()?)).filter(|_| s.is_plain()),
    },
    Command { needs: &[Show], allows: &[&[Set, And, Except, Back]], sentence: show },
    // "Bring it back but at 40 percent". "Put it back" alone is about its place.
    Command {
        needs: &[Back],
        allows: &[&[Set, Except, Show]],
        sentence: |s| if s.amounts.is_empty() { None } else { show(s) },
    },
    Command { needs: &[], allows: &[&[Set, Paint, ColorNoun, Swap, And, Except, By, Up, Down]], sentence: plain },
];

/// The sentence of the first command that has these slots.
pub(super) fn of(slots: &Slots) -> Option<String> {
    let fits = |command: &&Command| {
        let has_need = command.needs.is_empty() || slots.cues.iter().any(|cue| command.needs.contains(cue));
        let is_covered =
            |cue: &Cue| command.needs.contains(cue) || command.allows.iter().any(|list| list.contains(cue));
        has_need && slots.cues.iter().all(is_covered)
    };
    COMMANDS.iter().filter(fits).find_map(|command| (command.sentence)(slots))
}

impl Slots {
    fn has(&self, cue: Cue) -> bool {
        self.cues.contains(&cue)
    }

    fn has_any(&self, cues: &[Cue]) -> bool {
        self.cues.iter().any(|cue| cues.contains(cue))
    }

    fn things(&self) -> Vec<&str> {
        self.parts
            .iter()
            .filter_map(|part| if let Part::Thing(name) = part { Some(name.as_str()) } else { None })
            .collect()
    }

    fn colors(&self) -> Vec<&str> {
        self.parts
            .iter()
            .filter_map(|part| if let Part::Color(name) = part { Some(name.as_str()) } else { None })
            .collect()
    }

    /// Whether it has neither colours nor amounts.
    fn is_plain(&self) -> bool {
        self.colors().is_empty() && self.amounts.is_empty()
    }

    /// Whether it names nothing in particular, so that it is about the whole picture.
    fn is_general(&self) -> bool {
        self.things().is_empty() && self.exceptions.is_empty() && !self.rest
    }

    fn alone(&self, sentence: &str) -> Option<String> {
        (self.is_general() && self.is_plain()).then(|| sentence.to_owned())
    }

    /// What the command is about.
    fn target(&self) -> Option<String> {
        let things = self.things();
        if things.len() > super::MOST_THINGS || self.is_scattered {
            return None;
        }
        match (things.is_empty(), self.exceptions.is_empty()) {
            (false, true) if !self.everything && !self.rest => Some(things.join(" and ")),
            (true, false) if self.everything || self.rest => {
                Some(format!("everything but {}", self.exceptions.join(" and ")))
            }
            (true, true) if self.rest => Some("everything else".to_owned()),
            (true, true) if self.everything => Some("everything".to_owned()),
            (true, true) if self.pronoun => Some("it".to_owned()),
            (true, true) if self.has(Selection) => Some("the selection".to_owned()),
            _ => None,
        }
    }

    /// "A bit", "much", or nothing, with a space behind it.
    fn degree(&self) -> &'static str {
        if self.has(Slightly) {
            "a bit "
        } else if self.has(Much) {
            "much "
        } else {
            ""
        }
    }

    /// The direction, in the words of the grammar.
    fn way(&self, up: &'static str, down: &'static str) -> Option<String> {
        let side = match (self.has(Left), self.has(Right)) {
            (true, false) => Some("left"),
            (false, true) => Some("right"),
            (false, false) => None,
            (true, true) => return None,
        };
        let height = match (self.has_any(&[Above, Up]), self.has_any(&[Below, Down])) {
            (true, false) => Some(true),
            (false, true) => Some(false),
            (false, false) => None,
            (true, true) => return None,
        };
        let depth = match (self.has_any(&[Behind, Back]), self.has(Front)) {
            (true, false) => Some("behind"),
            (false, true) => Some("the front"),
            (false, false) => None,
            (true, true) => return None,
        };
        match (side, height, depth) {
            (Some(side), None, None) => Some(format!("the {side}")),
            (Some(side), Some(true), None) => Some(format!("the upper {side}")),
            (Some(side), Some(false), None) => Some(format!("the lower {side}")),
            (None, Some(above), None) => Some(if above { up } else { down }.to_owned()),
            (None, None, Some(depth)) => Some(depth.to_owned()),
            _ => None,
        }
    }

    fn only_amount(&self) -> Option<&Amount> {
        if let [amount] = self.amounts.as_slice() { Some(amount) } else { None }
    }
}

/// A number above 1 is a percentage.
fn share(amount: &Amount) -> Option<String> {
    match (amount.is_share, amount.value) {
        (true, _) => Some(amount.text.clone()),
        (false, 0.0..=1.0) => Some(amount.text.clone()),
        (false, 1.0..=100.0) => Some(format!("{} percent", amount.value)),
        _ => None,
    }
}

fn background(slots: &Slots) -> Option<String> {
    // What the background was is said first: "too black, make it blue".
    let color = slots.colors().last().copied()?;
    let is_plain = slots.things().is_empty() && slots.exceptions.is_empty() && slots.amounts.is_empty();
    is_plain.then(|| format!("make the background {color}"))
}

fn light_part(slots: &Slots) -> Option<String> {
    if !slots.is_general() || !slots.is_plain() {
        return None;
    }
    let part = if slots.has(Ambient) {
        "ambient"
    } else if slots.has(Diffuse) {
        "diffuse"
    } else {
        "specular"
    };
    if slots.has(Only) || slots.has(Shading) {
        return Some(format!("show only the {part} term"));
    }
    if slots.has(Hide) {
        return Some(format!("no {part}"));
    }
    let more = slots.has_any(&[More, Up]);
    let less = slots.has_any(&[Less, Down]);
    match (more, less) {
        (_, true) if more => None,
        (_, true) => Some(format!("{}less {part}", slots.degree())),
        (true, _) => Some(format!("{}more {part}", slots.degree())),
        _ if slots.has(Shiny) => Some("make it shinier".to_owned()),
        _ => None,
    }
}

fn light(slots: &Slots) -> Option<String> {
    if !slots.colors().is_empty() || !slots.exceptions.is_empty() || slots.rest {
        return None;
    }
    if let Some(amount) = slots.only_amount().filter(|amount| amount.is_share && slots.is_general()) {
        let verb = match (slots.has_any(&[Bright, Up]), slots.has_any(&[Dark, Down])) {
            (true, false) => "turn up",
            (false, true) => "turn down",
            _ => return None,
        };
        return Some(format!("{verb} the light by {}", amount.text));
    }
    if !slots.amounts.is_empty() {
        return None;
    }
    let brighter = slots.has_any(&[Bright, More]);
    let darker = slots.has_any(&[Dark, Less]);
    if let Some(way) = slots.way("above", "below") {
        // "Turn up the light" is about its strength.
        let strength = (slots.has(Up) || slots.has(Down)) && !slots.has_any(&[Left, Right]);
        if !strength && !brighter && !darker {
            return Some(format!("light from {way}"));
        }
    }
    if !slots.is_general() {
        return None;
    }
    match (brighter || slots.has(Up), darker || slots.has(Down)) {
        // "Too dark, more light": the change is said last.
        (true, true) => {
            let last = slots.cues.iter().rev().find(|cue| [More, Up, Bright, Dark, Less, Down].contains(cue))?;
            Some(if [More, Up, Bright].contains(last) { "brighter" } else { "darker" }.to_owned())
        }
        (true, false) => Some(format!("{}brighter", slots.degree())),
        (false, true) => Some(format!("{}darker", slots.degree())),
        (false, false) => None,
    }
}

fn initial(slots: &Slots) -> Option<String> {
    let resets_all = slots.has(Reset) && slots.everything;
    slots.alone(if resets_all { "reset" } else { "reset the view" })
}

fn show(slots: &Slots) -> Option<String> {
    let target = slots.target().filter(|_| slots.colors().is_empty())?;
    if slots.amounts.is_empty() {
        return Some(format!("show {target}"));
    }
    let share = share(slots.only_amount().filter(|amount| amount.is_share)?)?;
    Some(format!("show {target} and set the opacity of {target} to {share}"))
}

fn best_view(slots: &Slots) -> Option<String> {
    if !slots.is_plain() || !slots.exceptions.is_empty() {
        return None;
    }
    match slots.target() {
        Some(target) if target != "everything" => Some(format!("show me the best view of {target}")),
        _ => slots.is_general().then(|| "the best view".to_owned()),
    }
}

fn select(slots: &Slots) -> Option<String> {
    if !slots.is_plain() {
        return None;
    }
    if slots.has(Inverse) {
        return slots.things().is_empty().then(|| "invert the selection".to_owned());
    }
    let target = slots.target()?;
    if slots.has(Add) {
        return slots.has_any(&[Selection, Select]).then(|| format!("add {target} to the selection"));
    }
    (target != "the selection").then(|| format!("select {target}"))
}

fn lock(slots: &Slots) -> Option<String> {
    let target = slots.target().filter(|_| slots.is_plain())?;
    match (slots.has(Lock), slots.has(Unlock)) {
        (true, false) => Some(format!("lock {target}")),
        (false, true) => Some(format!("unlock {target}")),
        _ => None,
    }
}

fn zoom(slots: &Slots) -> Option<String> {
    if !slots.is_plain() || !slots.exceptions.is_empty() {
        return None;
    }
    if !slots.things().is_empty() {
        let target = slots.target().filter(|_| !slots.has(Farther))?;
        return Some(format!("frame {target}"));
    }
    let degree = if slots.has(Slightly) { " a bit" } else { "" };
    match (slots.has(Nearer), slots.has(Farther)) {
        // "I am too near, go away": both say farther.
        (true, false) if slots.has(Double) => Some("zoom in twice".to_owned()),
        (true, false) => Some(format!("zoom in{degree}")),
        (false, true) => Some(format!("zoom out{degree}")),
        _ => None,
    }
}

fn turn(slots: &Slots) -> Option<String> {
    if !slots.colors().is_empty() || !slots.is_general() {
        return None;
    }
    let way = slots.way("the top", "below")?;
    // The rear and the front are no directions to turn in.
    let is_depth = matches!(way.as_str(), "behind" | "the front");
    if (slots.has(View) || is_depth) && slots.amounts.is_empty() {
        return Some(format!("view from {way}"));
    }
    let amount = slots.only_amount().filter(|a| !a.is_share && (slots.has(Degrees) || a.value > 1.0));
    let way = match slots.way("up", "down")?.as_str() {
        "the left" => "left",
        "the right" => "right",
        "up" => "up",
        "down" => "down",
        _ => return None,
    };
    match (amount, slots.amounts.is_empty()) {
        (Some(amount), _) => Some(format!("rotate {way} {} degrees", amount.value)),
        (None, true) => Some(format!("rotate {way}")),
        (None, false) => None,
    }
}

fn opacity(slots: &Slots) -> Option<String> {
    if !slots.colors().is_empty() {
        return None;
    }
    let target = slots.target()?;
    let is_clear = slots.has_any(&[Transparency, Transparent]);
    if let Some(amount) = slots.only_amount() {
        let share = share(amount)?;
        let by = slots.has(By);
        return match (by, is_clear) {
            (false, false) => Some(format!("set the opacity of {target} to {share}")),
            (false, true) => Some(format!("set the transparency of {target} to {share}")),
            (true, _) if is_clear => None,
            (true, _) if slots.has_any(&[Up, More]) => Some(format!("increase the opacity of {target} by {share}")),
            (true, _) => Some(format!("reduce the opacity of {target} by {share}")),
        };
    }
    if !slots.amounts.is_empty() {
        return None;
    }
    let degree = slots.degree();
    let more = slots.has_any(&[More, Up]);
    let less = slots.has_any(&[Less, Down]);
    if more && less {
        return None;
    }
    if slots.has(Faint) && !more && !less {
        return Some(format!("ghost {target}"));
    }
    if slots.has(Fade) && !more && !less {
        return Some(format!("fade {target}"));
    }
    let adjective = if is_clear { "transparent" } else { "opaque" };
    if slots.has(Half) {
        return Some(format!("make {target} half {adjective}"));
    }
    let grows = slots.has_any(&[Opaque, Transparent]) && (more || slots.has_any(&[Slightly, Much]));
    match (more || grows, less) {
        (true, false) => Some(format!("make {target} {degree}more {adjective}")),
        (false, true) => Some(format!("make {target} {degree}less {adjective}")),
        _ if slots.has_any(&[Opaque, Transparent]) => Some(format!("make {target} {adjective}")),
        _ => None,
    }
}

fn only(slots: &Slots) -> Option<String> {
    if !slots.is_plain() {
        return None;
    }
    let exceptions = &slots.exceptions;
    // "Everything off, only the bone": the things are those that stay.
    if !slots.things().is_empty() && exceptions.is_empty() && !slots.is_scattered && slots.has(Only) {
        let hides = slots.has(Hide) && !slots.everything && !slots.rest;
        return (!hides).then(|| format!("show only {}", slots.things().join(" and ")));
    }
    if slots.things().is_empty() && !exceptions.is_empty() && slots.has_any(&[Nothing, Only]) {
        return Some(format!("show only {}", exceptions.join(" and ")));
    }
    None
}

fn tone(slots: &Slots) -> Option<String> {
    let target = slots.target().filter(|_| slots.amounts.is_empty() && slots.colors().is_empty())?;
    let less = slots.has_any(&[Less, Down]);
    let degree = if slots.has(Slightly) { "a bit " } else { "" };
    let adjective = match (slots.has(Vivid), slots.has(Dull), slots.has(Warm), slots.has(Cool)) {
        (true, false, false, false) if less => "less saturated",
        (true, _, false, false) => "more saturated",
        (false, true, false, false) if less => "more saturated",
        (false, true, false, false) => "less saturated",
        (false, false, true, false) => "warmer",
        (false, false, false, true) => "cooler",
        (false, false, false, false) => match (slots.has(Bright), slots.has(Dark)) {
            (true, false) if less => "darker",
            (true, false) => "brighter",
            (false, true) if less => "brighter",
            (false, true) => "darker",
            _ => return None,
        },
        _ => return None,
    };
    Some(format!("make {target} {degree}{adjective}"))
}

/// A thing with a colour or with an amount, and no other word.
fn plain(slots: &Slots) -> Option<String> {
    if let (Some(pairs), true) = (pairs(slots), slots.is_scattered) {
        return Some(pairs);
    }
    let target = slots.target()?;
    if let ([.., color], true) = (slots.colors().as_slice(), slots.amounts.is_empty()) {
        let is_one = slots.colors().len() == 1 || slots.has(Swap);
        let moves = slots.has_any(&[Up, Down, By]);
        return (is_one && !moves).then(|| format!("make {target} {color}"));
    }
    let share = share(slots.only_amount().filter(|a| a.is_share || slots.has_any(&[Up, Down]))?)?;
    let is_plain = slots.colors().is_empty() && !slots.has_any(&[Paint, ColorNoun, Swap, By]);
    is_plain.then(|| format!("set the opacity of {target} to {share}"))
}

/// Things that alternate with their colours: "vessels green bone blue".
fn pairs(slots: &Slots) -> Option<String> {
    if !slots.amounts.is_empty() || !slots.exceptions.is_empty() || slots.everything || slots.rest {
        return None;
    }
    let commands: Option<Vec<String>> = slots
        .parts
        .chunks(2)
        .map(|pair| match pair {
            [Part::Thing(name), Part::Color(color)] => Some(format!("make {name} {color}")),
            _ => None,
        })
        .collect();
    commands.filter(|all| all.len() > 1).map(|all| all.join(" and "))
}
