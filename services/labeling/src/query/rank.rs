//! Scores of the items for a query, and the outcome.

use crate::attributes::Attributes;
use crate::attributes::judge::{FITS, Looks};
use crate::attributes::likeness::Likeness;
use crate::attributes::quality::{self, Constraint, Look};
use crate::lexical::{Index, LexicalMatch};
use crate::meaning::{CALIBRATION, Cosines, LabelCosines};
use crate::pictures::UnitPictures;
use crate::query::outcome::{LEAD, Outcome, Ranked, SPREAD, SURE_MEANING, THRESHOLD, Why};
use crate::query::parse::{Alike, Group, Model, Number, Query, alike, parse};
use crate::text::Phrase;

/// Least score of a noun for an item to be judged by its look.
const NAMED: f64 = 0.4;
/// Score of an item that only its look speaks for, at full membership.
const BY_LOOK: f64 = 0.95;
/// What a look counts that just fits, of one that fits fully.
const JUST_FITS: f64 = 0.75;
/// What is left of a score for each look that does not fit.
const UNFIT: f64 = 0.35;
/// Score by words from which a sentence encoder is not asked: the same word, another form of it, its usual synonym.
const SURE: f64 = 0.9;
/// Share of the best item's share from which another item contends with it.
const CONTENDER: f64 = 0.5;

/// What is known of the items.
#[derive(Clone, Copy)]
pub(super) struct Known<'k> {
    pub(super) index: &'k Index,
    pub(super) looks: &'k Looks,
    /// For each item, whether others have all of its Gaussians. Items beyond its end are not covered.
    pub(super) covered: &'k [bool],
    /// A sentence encoder, if there is one.
    pub(super) meaning: Option<&'k dyn LabelCosines>,
    /// An image-text model that has seen the items, if there is one.
    pub(super) pictures: Option<&'k dyn UnitPictures>,
    /// Measures the selection. It has no look if nothing is selected.
    pub(super) selection: Option<&'k dyn Fn() -> Option<Attributes>>,
}

/// The outcome of a text.
pub(super) fn find(known: Known<'_>, text: &str) -> Outcome {
    let nothing = |why| Outcome::NothingMatches { best: None, why };
    if known.index.is_empty() {
        return nothing(Why::NoItems);
    }
    match alike(text) {
        Some(Alike { model: Model::Kind(kind), number }) => find_named(known, &kind, Some(number)),
        Some(Alike { model: Model::Selection, number }) => match known.selection.and_then(|measure| measure()) {
            Some(selection) => {
                find_alike(known, &[Original { item: None, look: Some(&selection) }], "the selection", number)
            }
            None => nothing(Why::NothingSelected),
        },
        Some(Alike { model: Model::Named(name), number }) => match find_named(known, &name, None) {
            Outcome::Match { items } => {
                let originals: Vec<Original<'_>> = items.iter().map(|r| known.original(r.item)).collect();
                find_alike(known, &originals, &name, number)
            }
            other => other,
        },
        None => find_named(known, text, None),
    }
}

/// What things should be like.
struct Original<'o> {
    /// The item, unless it is the selection.
    item: Option<usize>,
    look: Option<&'o Attributes>,
}

impl<'k> Known<'k> {
    fn original(self, item: usize) -> Original<'k> {
        Original { item: Some(item), look: self.looks.of(item) }
    }
}

/// The items that are like one of some originals, by their looks or by the noun of its label. The originals are no answer.
fn find_alike(known: Known<'_>, originals: &[Original<'_>], name: &str, number: Number) -> Outcome {
    let Known { index, looks, .. } = known;
    let nouns: Vec<Vec<Ranked>> =
        originals.iter().filter_map(|original| Some(namesakes(index, looks, original.item?))).collect();
    let is_original = |item: usize| {
        let same = |original: &Original<'_>| match original.item {
            Some(own) => own == item,
            None => original.look.is_some() && original.look == looks.of(item),
        };
        originals.iter().any(same)
    };
    let ranked = (0..index.len()).filter(|item| !is_original(*item)).filter_map(|item| {
        let by_noun = nouns.iter().flatten().filter(|r| r.item == item).max_by(|a, b| a.score.total_cmp(&b.score));
        let by_look = originals.iter().filter_map(|original| Some(Likeness::of(original.look?, looks.of(item)?)));
        let by_look = by_look.max_by(|a, b| a.score.total_cmp(&b.score));
        let mut ranked = by_noun.cloned().unwrap_or_else(|| unranked(item));
        if let Some(by_look) = by_look {
            ranked.score = ranked.score.max(by_look.score);
            if by_look.score >= THRESHOLD {
                ranked.alike = Some(format!("{name} in {}", by_look.shared.join(", ")));
            }
        }
        (ranked.score > 0.0).then_some(ranked)
    });
    let mut ranked: Vec<Ranked> = ranked.collect();
    ranked.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.item.cmp(&b.item)));
    let best = ranked.first().map_or(0.0, |r| r.score);
    if best < THRESHOLD {
        return Outcome::NothingMatches { best: ranked.into_iter().next(), why: Why::NothingAlike(name.to_owned()) };
    }
    let least = if number == Number::Several { THRESHOLD } else { (best - LEAD).max(THRESHOLD) };
    let found: Vec<Ranked> = ranked.into_iter().filter(|r| r.score >= least).collect();
    if number == Number::One && found.len() > 1 {
        Outcome::Ambiguous { candidates: found }
    } else {
        Outcome::Match { items: found }
    }
}

/// The items that the nouns of an item's label suit: a right kidney for a left one.
fn namesakes(index: &Index, looks: &Looks, item: usize) -> Vec<Ranked> {
    let query = parse(&index.words_of(item).join(" "), index.net());
    query
        .groups
        .iter()
        .filter(|group| !group.nouns.is_empty())
        .flat_map(|group| {
            let group =
                Group { constraints: Vec::new(), whole: Phrase::default(), is_look: Vec::new(), ..group.clone() };
            by_words(index, looks, &group, None)
        })
        .collect()
}

/// The outcome of a text that names or describes things.
fn find_named(known: Known<'_>, text: &str, number: Option<Number>) -> Outcome {
    let Known { index, .. } = known;
    let nothing = |why| Outcome::NothingMatches { best: None, why };
    let mut query = parse(text, index.net());
    if number == Some(Number::Several) {
        query.number = Number::Several;
    }
    if query.groups.is_empty() {
        return nothing(Why::NoWords);
    }
    let mut ranked = wanted(known, &query);
    drop_covered(&mut ranked, known.covered);
    let is_excluded = excluded(known, &query, &ranked);
    let had_match = ranked.iter().any(|r| r.score >= THRESHOLD);
    ranked.retain(|r| !is_excluded.get(r.item).copied().unwrap_or_default());
    if query.excluded.is_empty() {
        let by_words = outcome(ranked, &query, index);
        // A model takes time, so it is asked only where words find nothing.
        match by_words {
            Outcome::NothingMatches { .. } => by_pictures(known, &query).unwrap_or(by_words),
            found => found,
        }
    } else if had_match && !ranked.iter().any(|r| r.score >= THRESHOLD) {
        Outcome::NothingMatches { best: ranked.into_iter().next(), why: Why::AllExcluded }
    } else {
        for item in &mut ranked {
            item.by_exclusion = true;
        }
        outcome(ranked, &query, index)
    }
}

/// Without the items that their look alone speaks for and whose Gaussians others have, if it speaks for others as well.
fn drop_covered(ranked: &mut Vec<Ranked>, covered: &[bool]) {
    let is_covered = |r: &Ranked| {
        covered.get(r.item) == Some(&true) && r.evidence.is_empty() && r.meaning.is_none() && !r.looks.is_empty()
    };
    if ranked.iter().any(|r| r.score >= THRESHOLD && !is_covered(r)) {
        ranked.retain(|r| !is_covered(r));
    }
}

/// The items whose pictures a text of one part names, as a question. Pictures are not asked about looks, which are measured.
fn by_pictures(known: Known<'_>, query: &Query) -> Option<Outcome> {
    let [group] = query.groups.as_slice() else { return None };
    if group.nouns.is_empty() {
        return None;
    }
    let shares = known.pictures?.shares(&group.text)?;
    let best = shares.units.iter().flatten().copied().fold(0.0, f64::max);
    let candidate = |(item, share): (usize, &Option<f64>)| {
        let score = share.filter(|share| *share >= (CONTENDER * best).max(THRESHOLD))?;
        let pictures = Some(format!("{} by {}", group.text, shares.model));
        (item < known.index.len()).then(|| Ranked { score, pictures, ..unranked(item) })
    };
    let mut candidates: Vec<Ranked> = shares.units.iter().enumerate().filter_map(candidate).collect();
    candidates.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.item.cmp(&b.item)));
    (!candidates.is_empty()).then_some(Outcome::Ambiguous { candidates })
}

/// The items by falling score, each by the group that suits it best.
fn wanted(known: Known<'_>, query: &Query) -> Vec<Ranked> {
    let mut best: Vec<Option<Ranked>> = vec![None; known.index.len()];
    for group in &query.groups {
        for ranked in of_group(known, group, query.number, None) {
            let at = ranked.item;
            if best.get(at).is_some_and(|b| b.as_ref().is_none_or(|b| ranked.score > b.score)) {
                best[at] = Some(ranked);
            }
        }
    }
    let mut ranked: Vec<Ranked> = best.into_iter().flatten().collect();
    ranked.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.item.cmp(&b.item)));
    ranked
}

/// For each item, whether the query excludes it. Places and sizes are judged among what the query asks for.
fn excluded(known: Known<'_>, query: &Query, ranked: &[Ranked]) -> Vec<bool> {
    let mut excluded = vec![false; known.index.len()];
    let mut asked: Vec<usize> = ranked.iter().filter(|r| r.score >= THRESHOLD).map(|r| r.item).collect();
    asked.sort_unstable();
    for group in &query.excluded {
        let found = of_group(known, group, Number::Several, Some(&asked));
        for item in found.into_iter().filter(|r| r.score >= THRESHOLD) {
            if let Some(own) = excluded.get_mut(item.item) {
                *own = true;
            }
        }
    }
    excluded
}

fn outcome(ranked: Vec<Ranked>, query: &Query, index: &Index) -> Outcome {
    let best = ranked.first().map_or(0.0, |r| r.score);
    if best < THRESHOLD {
        return Outcome::NothingMatches { why: why(&ranked, query, index), best: ranked.into_iter().next() };
    }
    let least = match query.number {
        Number::Several if query.groups.len() > 1 => THRESHOLD,
        Number::Several => best - SPREAD,
        Number::One => best - LEAD,
    };
    let found: Vec<Ranked> = ranked.into_iter().filter(|r| r.score >= least.max(THRESHOLD)).collect();
    let is_unsure = |found: &Ranked| found.meaning.is_some() && found.score < SURE_MEANING;
    let is_question = found.iter().any(is_unsure) || (query.number == Number::One && found.len() > 1);
    if is_question { Outcome::Ambiguous { candidates: found } } else { Outcome::Match { items: found } }
}

fn why(ranked: &[Ranked], query: &Query, index: &Index) -> Why {
    let Some(group) = query.groups.first() else { return Why::NoWords };
    let noun = group.nouns.words.join(" ");
    let is_named = || index.matches(&group.nouns).iter().flatten().any(|m| m.score >= THRESHOLD);
    if group.constraints.is_empty() || !(noun.is_empty() || ranked.iter().any(|r| !r.unfit.is_empty()) && is_named()) {
        Why::NoSuchLabel(if noun.is_empty() { group.look() } else { noun })
    } else {
        Why::NoSuchLook { noun, look: group.look() }
    }
}

/// The items that a group speaks for. `among` are the items that looks are judged among, in rising order; by default those that the noun suits.
fn of_group(known: Known<'_>, group: &Group, number: Number, among: Option<&[usize]>) -> Vec<Ranked> {
    let Known { index, looks, meaning, .. } = known;
    if group.universal {
        let all = |item| Ranked { score: 1.0, ..unranked(item) };
        return (0..index.len()).map(all).collect();
    }
    let named = by_words(index, looks, group, among);
    let best = named.iter().map(|r| r.score).fold(0.0, f64::max);
    let is_settled = best >= SURE || (best >= THRESHOLD && number == Number::Several) || !may_mean(&named, group);
    match meaning.filter(|_| !is_settled).and_then(|meaning| meaning.cosines(&group.text)) {
        Some(cosines) => by_meaning(index, &named, &cosines, (&group.text, number)),
        None => named,
    }
}

/// Whether a meaning beside the words may decide. Where a label has the noun but not the look, it may not: a vessel that is not
/// red is no "red vessel". Looks alone are measured.
fn may_mean(named: &[Ranked], group: &Group) -> bool {
    !group.nouns.is_empty() && !named.iter().any(|r| !r.unfit.is_empty() && r.score >= NAMED * UNFIT)
}

/// The items by what their words and a sentence encoder say together.
pub(super) fn by_meaning(
    index: &Index,
    named: &[Ranked],
    cosines: &Cosines,
    (text, number): (&str, Number),
) -> Vec<Ranked> {
    let shares = CALIBRATION.shares(cosines, &words_of(index, named));
    let best = shares.iter().copied().fold(0.0, f64::max);
    let is_contender = |share: f64| share >= CONTENDER * best && share > 0.0;
    // Several that share what none has alone: the text means one of them.
    let together: f64 = shares.iter().copied().filter(|share| is_contender(*share)).sum();
    let is_split = number == Number::One && best < THRESHOLD && together >= THRESHOLD;
    let score = |share: f64| if is_split && is_contender(share) { together.min(1.0) } else { share };
    let by_share = shares.iter().enumerate().filter_map(|(item, share)| {
        let own = named.iter().find(|r| r.item == item).cloned();
        // Words alone speak for a label that is not encoded.
        if cosines.labels.get(item).copied().flatten().is_none() {
            return own;
        }
        let own = own.unwrap_or_else(|| unranked(item));
        let label = index.words_of(item).join(" ");
        Some(Ranked { score: score(*share), meaning: Some(format!("{text} ~ {label}")), ..own })
    });
    by_share.collect()
}

/// The score of each item by its words, 0 where nothing relates them.
pub(super) fn words_of(index: &Index, named: &[Ranked]) -> Vec<f64> {
    let mut words = vec![0.0; index.len()];
    for ranked in named {
        if let Some(own) = words.get_mut(ranked.item) {
            *own = ranked.score;
        }
    }
    words
}

/// The items that the words and looks of a group speak for.
pub(super) fn by_words(index: &Index, looks: &Looks, group: &Group, among: Option<&[usize]>) -> Vec<Ranked> {
    let named = by_name(index, looks, group, among);
    let suits = |ranked: &[Ranked]| ranked.iter().any(|r| r.score >= THRESHOLD);
    match group.by_shape(index.net()) {
        Some(shape) if !suits(&named) => {
            let shaped = by_name(index, looks, &shape, among);
            if suits(&shaped) { shaped } else { named }
        }
        _ => named,
    }
}

/// An item that nothing speaks for yet.
pub(super) fn unranked(item: usize) -> Ranked {
    Ranked {
        item,
        score: 0.0,
        evidence: Vec::new(),
        looks: Vec::new(),
        unfit: Vec::new(),
        meaning: None,
        pictures: None,
        alike: None,
        by_exclusion: false,
    }
}

fn by_name(index: &Index, looks: &Looks, group: &Group, among: Option<&[usize]>) -> Vec<Ranked> {
    let mut ranked = by_noun_and_look(index, looks, group, among);
    if group.constraints.is_empty() || group.whole.is_empty() {
        return ranked;
    }
    // A label may contain the words of the looks: "grey matter", "left kidney".
    let whole = index.matches(&group.whole);
    for known in &mut ranked {
        let found = whole.get(known.item).and_then(Option::as_ref).filter(|f| covers_looks(f, group));
        if let Some(found) = found.filter(|f| f.score > known.score) {
            *known = Ranked { score: found.score, evidence: found.evidence.clone(), ..unranked(known.item) };
        }
    }
    let mut is_known = vec![false; index.len()];
    for own in &ranked {
        if let Some(known) = is_known.get_mut(own.item) {
            *known = true;
        }
    }
    for (item, found) in whole.into_iter().enumerate().filter(|(item, _)| is_known.get(*item) == Some(&false)) {
        if let Some(found) = found.filter(|f| covers_looks(f, group)) {
            ranked.push(Ranked { score: found.score, evidence: found.evidence, ..unranked(item) });
        }
    }
    ranked
}

/// Whether the label has every word that states a look.
fn covers_looks(found: &LexicalMatch, group: &Group) -> bool {
    group.is_look.iter().zip(&found.covered).all(|(is_look, covered)| !is_look || *covered)
}

/// Items that the noun suits, judged by their looks.
fn by_noun_and_look(index: &Index, looks: &Looks, group: &Group, among: Option<&[usize]>) -> Vec<Ranked> {
    let mut ranked: Vec<Ranked> = if group.nouns.is_empty() {
        if group.constraints.is_empty() {
            return if group.has_noun {
                (0..index.len()).map(|i| Ranked { score: THRESHOLD, ..unranked(i) }).collect()
            } else {
                Vec::new()
            };
        }
        (0..index.len()).map(|item| Ranked { score: BY_LOOK, ..unranked(item) }).collect()
    } else {
        let found = index.matches(&group.nouns).into_iter().enumerate();
        found
            .filter_map(|(item, found)| {
                let found = found?;
                Some(Ranked { score: found.score, evidence: found.evidence, ..unranked(item) })
            })
            .collect()
    };
    // First the looks of each alone, then those beside the others, at last the superlatives: "the largest small red one".
    let order = |c: &&Constraint| match (&c.look, c.superlative) {
        (_, true) => 2,
        (Look::Quality(quality), _) if !quality.is_absolute() => 1,
        _ => 0,
    };
    let mut constraints: Vec<&Constraint> = group.constraints.iter().collect();
    constraints.sort_by_key(order);
    for step in 0..=2 {
        let own: Vec<&Constraint> = constraints.iter().copied().filter(|c| order(c) == step).collect();
        let mut candidates: Vec<usize> =
            ranked.iter().filter(|r| r.score >= NAMED && r.unfit.is_empty()).map(|r| r.item).collect();
        if let Some(among) = among.filter(|_| step > 0) {
            candidates.retain(|item| among.binary_search(item).is_ok());
        }
        for constraint in own {
            let mut memberships = vec![None; index.len()];
            for (candidate, membership) in candidates.iter().zip(looks.memberships(constraint, &candidates)) {
                if let Some(own) = memberships.get_mut(*candidate) {
                    *own = Some(membership);
                }
            }
            for item in &mut ranked {
                let by_look = memberships.get(item.item).copied().flatten();
                let membership = by_label(index, item.item, constraint).or(by_look).unwrap_or(0.0);
                if membership >= FITS {
                    item.score *= JUST_FITS + (1.0 - JUST_FITS) * (membership - FITS) / (1.0 - FITS);
                    item.looks.push(constraint.words.clone());
                } else {
                    item.score *= UNFIT;
                    item.unfit.push(constraint.words.clone());
                }
            }
        }
    }
    ranked
}

/// What an item's label says about a place: a left kidney is left wherever it is drawn.
fn by_label(index: &Index, item: usize, constraint: &Constraint) -> Option<f64> {
    let Look::Quality(quality) = constraint.look else { return None };
    if constraint.superlative {
        return None;
    }
    index.words_of(item).iter().filter_map(|word| quality::place(word)).find_map(|place| {
        if place == quality {
            Some(1.0)
        } else if Some(place) == quality.opposite_place() {
            Some(0.0)
        } else {
            None
        }
    })
}
