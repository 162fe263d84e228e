//! Saturation, brightness and temperature.

use sg_proto::scene::{Reset, SetTone, Undo};

use super::*;

fn tone(target: Target, mut change: SetTone) -> Action {
    change.target = Some(target);
    Action::SetTone(change)
}

fn saturation(factor: f32) -> SetTone {
    SetTone { saturation: Some(factor), ..SetTone::default() }
}

fn tones(editor: &Editor, at: [usize; 3]) -> [Tone; 3] {
    at.map(|i| drawn(editor.state(), i).tone)
}

#[test]
fn a_tone_changes_its_target_and_keeps_every_other_term() {
    let mut editor = editor();
    let plain = Tone::NEUTRAL;
    let grey = Tone { saturation: 0.5, ..plain };
    let applied = run(&mut editor, [tone(units(&["bone"]), saturation(0.5))]).unwrap();
    assert_eq!(applied.result.summary, "saturation to 50 % of bone");
    assert_eq!(tones(&editor, [3, 25, 40]), [grey, plain, plain]);
    assert_eq!(editor.state().appearance().units.len(), 1);
    // A relative change multiplies; temperatures add up and stay in their range.
    let more = SetTone { saturation: Some(3.0), temperature: Some(0.75), relative: true, ..SetTone::default() };
    run(&mut editor, [tone(units(&["bone"]), more.clone()), tone(units(&["bone"]), more)]);
    assert_eq!(tones(&editor, [3, 25, 40])[0], Tone { saturation: 4.0, temperature: 1.0, ..plain });
    run(&mut editor, [Action::Undo(Undo { steps: 3 })]);
    assert_eq!(tones(&editor, [3, 25, 40]), [plain; 3]);
    assert!(editor.state().appearance().units.is_empty(), "no term is left that costs anything");
}

#[test]
fn the_selection_and_the_rest_get_units_of_their_own_and_later_words_win() {
    let mut editor = editor();
    run(&mut editor, [commit(|i| i < 10), tone(selection(), saturation(0.0))]);
    assert_eq!(editor.state().units().map(|u| u.name.as_str()).collect::<Vec<_>>(), ["selection 1"]);
    let brighter = SetTone { brightness: Some(2.0), ..SetTone::default() };
    run(&mut editor, [tone(all_but(&["Vessel"]), brighter)]);
    let (plain, grey) = (Tone::NEUTRAL, Tone { saturation: 0.0, ..Tone::NEUTRAL });
    let bright = Tone { brightness: 2.0, ..plain };
    assert_eq!(tones(&editor, [3, 25, 40]), [grey.and(bright), bright, plain]);
    // The saturation of all of bone is set anew, its brightness stays.
    run(&mut editor, [tone(units(&["bone"]), saturation(1.0))]);
    assert_eq!(tones(&editor, [3, 25, 40]), [bright, bright, plain]);
    // A name keeps the tone that the selection had.
    run(&mut editor, [commit(|i| i > 50), tone(selection(), saturation(0.25)), save("tip")]);
    assert_eq!(editor.state().units().last().unwrap().tone.saturation, 0.25);
    run(&mut editor, [Action::Reset(Reset {})]);
    assert_eq!(tones(&editor, [3, 25, 55]), [plain; 3]);
}

#[test]
fn numbers_out_of_range_and_locked_targets_are_refused() {
    let mut editor = editor();
    let on = || units(&["bone"]);
    assert!(matches!(refused(&mut editor, tone(on(), SetTone::default())), EditError::Malformed { .. }));
    assert!(matches!(refused(&mut editor, tone(on(), saturation(f32::NAN))), EditError::NotFinite { .. }));
    for change in [
        saturation(-0.1),
        saturation(4.5),
        SetTone { brightness: Some(5.0), ..SetTone::default() },
        SetTone { temperature: Some(-1.1), ..SetTone::default() },
    ] {
        assert!(matches!(refused(&mut editor, tone(on(), change)), EditError::OutOfRange { .. }));
    }
    run(&mut editor, [lock(on(), true)]);
    assert_eq!(refused(&mut editor, tone(on(), saturation(0.5))), EditError::Locked("bone".into()));
    let reading = EditState::from_snapshot(&editor.message(true));
    assert_eq!(reading.as_ref(), Ok(editor.state()));
}
