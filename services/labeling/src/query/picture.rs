//! Which items a picture is like.

use super::outcome::{Outcome, Ranked, Why};
use super::rank::unranked;

/// Most items that are listed.
const MAX_ALIKE: usize = 5;

/// The items whose pictures are most like a picture, by its cosines with their pictures, −1 to 1, in the order of the items.
/// `None` and NaN: an item without pictures. `model` names the encoder for a person.
///
/// The score is (1 + cosine)/2. It orders the items, and is no share of queries: nothing says from which cosine on a picture
/// shows the item. So the outcome is a question, and never a match.
#[must_use]
pub fn like_picture(cosines: &[Option<f64>], model: &str) -> Outcome {
    let nothing = |why| Outcome::NothingMatches { best: None, why };
    if cosines.is_empty() {
        return nothing(Why::NoItems);
    }
    let candidate = |(item, cosine): (usize, &Option<f64>)| {
        let cosine = cosine.filter(|cosine| !cosine.is_nan())?;
        let pictures = Some(format!("alike by {model} (cosine {cosine:.2})"));
        Some(Ranked { score: (0.5 * (1.0 + cosine)).clamp(0.0, 1.0), pictures, ..unranked(item) })
    };
    let mut candidates: Vec<Ranked> = cosines.iter().enumerate().filter_map(candidate).collect();
    candidates.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.item.cmp(&b.item)));
    candidates.truncate(MAX_ALIKE);
    if candidates.is_empty() { nothing(Why::NoPictures) } else { Outcome::Ambiguous { candidates } }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_most_alike_come_first_and_never_as_a_match() {
        let cosines = [Some(0.2), None, Some(0.83), Some(-1.0), Some(0.2), Some(f64::NAN), Some(0.1), Some(0.0)];
        let Outcome::Ambiguous { candidates } = like_picture(&cosines, "clip") else { panic!("no question") };
        assert_eq!(candidates.iter().map(|r| r.item).collect::<Vec<_>>(), [2, 0, 4, 6, 7]);
        assert!((candidates[0].score - 0.915).abs() < 1e-12);
        assert_eq!(candidates[0].explanation(), "pictures: alike by clip (cosine 0.83)");
        assert!(candidates[0].is_inferred());
        // Even the very same picture is a question.
        assert!(
            matches!(like_picture(&[Some(1.0)], "clip"), Outcome::Ambiguous { candidates } if candidates[0].score == 1.0)
        );
    }

    #[test]
    fn without_pictures_nothing_is_alike() {
        let why = |cosines: &[Option<f64>]| match like_picture(cosines, "clip") {
            Outcome::NothingMatches { best: None, why } => why.to_string(),
            other => panic!("{other:?}"),
        };
        assert_eq!(why(&[]), "there is nothing to find");
        assert_eq!(why(&[None, Some(f64::NAN)]), "the pictures of the units are not embedded yet");
    }
}
