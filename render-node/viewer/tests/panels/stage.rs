//! A made scene and a panel that is shown of it.

use std::sync::Arc;

use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::Vec3;
use sg_edit::EditState;
use sg_edit::wire::encode_mask;
use sg_proto::scene::command::Action;
use sg_proto::scene::{Color, CommitSelection, SaveUnit, SetColor, Stroke, StrokeKind, StrokeMode, Target, WalkTuning};
use sg_proto::selection::{Answer, Answers, Proposal, ProposalsReply};
use sg_proto::speech::{self, Phase};
use sg_scene::mask::Mask;
use sg_scene::model::Scene;
use sg_scene::synthetic::test_scene;
use sg_viewer::display::{
    Clusters, Conversation, Entry, Notice, ServiceAvailability, Tools, ViewState, WalkCapabilities,
};
use sg_viewer::panels::{Output, Panel, PanelHost, Panels, legend, theme};
use sg_volume::phantom;

use crate::picture::Textures;

/// A scene of two base units, made without files.
pub(crate) fn scene() -> Arc<Scene> {
    let mut units = test_scene(&[("vessel", 700), ("tissue", 300)]).units;
    for (unit, palette) in units.iter_mut().zip([Vec3::new(0.835, 0.369, 0.0), Vec3::new(0.8, 0.475, 0.655)]) {
        unit.palette = palette;
        unit.transfer_function = Some("tf.json".into());
    }
    Arc::new(Scene::compose(units, None))
}

/// Panels that a window docks.
pub(crate) fn docked() -> Vec<Panel> {
    Panel::ALL.iter().copied().filter(|panel| panel.dock.is_some()).collect()
}

/// A state after these actions, as the scene's owner would make it.
pub(crate) fn after(scene: &Arc<Scene>, actions: impl IntoIterator<Item = Action>) -> Arc<EditState> {
    let opened = EditState::of_scene(scene, "scene.toml", "hash");
    Arc::new(actions.into_iter().fold(opened, |state, action| state.after(scene, action).unwrap()))
}

/// Selects the Gaussians of a range.
pub(crate) fn select(scene: &Arc<Scene>, range: std::ops::Range<usize>) -> Action {
    let mask = Mask::from_fn(scene.len(), |i| range.contains(&i));
    Action::CommitSelection(CommitSelection { mask: Some(encode_mask(&mask)), ..CommitSelection::default() })
}

/// Saves the selection.
pub(crate) fn save(name: &str) -> Action {
    Action::SaveUnit(SaveUnit { name: name.to_owned(), replace: false })
}

/// A microphone that waits for a button, after something that was no command.
pub(crate) fn microphone(phase: Phase) -> speech::State {
    speech::State {
        phase: phase.into(),
        trigger: speech::Trigger::Held.into(),
        input: "pipe /tmp/microphone".to_owned(),
        output: "pipe /tmp/loudspeaker".to_owned(),
        recognizer: "whisper".to_owned(),
        synthesizer: "espeak".to_owned(),
        notice: "“what a nice day” is no command".to_owned(),
        ..speech::State::default()
    }
}

/// A scene in the middle of work: a saved unit "sac" with a colour, a selection, a history, a conversation.
pub(crate) fn shown() -> ViewState {
    let scene = scene();
    let target = Some(Target { units: vec!["sac".to_owned()], ..Target::default() });
    let red = Action::SetColor(SetColor { target, color: Some(Color { red: 0.0, green: 0.447, blue: 0.698 }) });
    let state = after(&scene, [select(&scene, 40..220), save("sac"), red, select(&scene, 40..120), save("neck")]);
    let mut talk = Conversation::default();
    talk.say("1", "make the sac blue and fade everything else to 20 percent");
    let turn = talk.turn("1").unwrap();
    turn.add(Entry::Command("set the colour of sac to blue".to_owned()));
    turn.add(Entry::Result("coloured sac #0072b2".to_owned(), true));
    turn.add(Entry::Command("set the opacity of everything else to 20 %".to_owned()));
    turn.add(Entry::Result("opacity of everything but sac to 20 %".to_owned(), true));
    turn.answer = Some(("The sac is blue now, and everything else shows through at 20 %.".to_owned(), true));
    talk.say("2", "how large is the neck?");
    talk.turn("2").unwrap().add(Entry::Command("measure neck".to_owned()));
    ViewState {
        selected: Arc::clone(state.selection().mask()),
        undo: ["saved the selection as neck: 80 Gaussians", "coloured sac #0072b2"].map(str::to_owned).into(),
        redo: ["hid tissue".to_owned()].into(),
        clusters: Some(Arc::new(Clusters::new((0..scene.len()).map(|i| (i / 50) as u32).collect()))),
        conversation: Arc::new(talk),
        speech: Some(Arc::new(microphone(Phase::Idle))),
        services: ServiceAvailability { scene: true, selection: true, agents: true, labeling: false },
        notices: [
            Notice { number: 1, text: "reading the scene took 1.2 s".to_owned(), refused: false },
            Notice { number: 2, text: "there is no unit `sack`; did you mean `sac`?".to_owned(), refused: true },
        ]
        .into(),
        ..ViewState::of(state)
    }
}

/// The surroundings of a test's panel.
pub(crate) struct Stage {
    pub(crate) panels: Panels,
    pub(crate) shown: ViewState,
    pub(crate) tools: Tools,
    /// All requests, oldest first.
    pub(crate) asked: Vec<Output>,
    pub(crate) show: Vec<Panel>,
    /// Height of its panels, if not their own.
    pub(crate) height: Option<f32>,
    /// Width of its panels, if not their own.
    pub(crate) width: Option<f32>,
    /// Whether the legend and the notices are shown too.
    pub(crate) beside: bool,
    pub(crate) pixels_per_point: f32,
    pub(crate) textures: Textures,
}

impl Stage {
    pub(crate) fn new(panel: Panel) -> Self {
        let mut panels = Panels::new(PanelHost::Headset);
        let scene = scene();
        let folder = tempfile::tempdir().unwrap();
        let mut function = phantom::transfer_function();
        function.base_units.truncate(2);
        for (unit, name) in function.base_units.iter_mut().zip(["vessel", "tissue"]) {
            unit.name = name.to_owned();
        }
        std::fs::write(folder.path().join("tf.json"), function.to_json().unwrap()).unwrap();
        let problems = panels.behind(&scene, &folder.path().join("scene.toml"));
        assert_eq!(problems, Vec::<String>::new());
        Self {
            panels,
            shown: shown(),
            tools: Tools::default(),
            asked: Vec::new(),
            show: vec![panel],
            height: None,
            width: None,
            beside: false,
            pixels_per_point: 1.0,
            textures: Textures::default(),
        }
    }

    /// The walk has three answers, of which this one is taken.
    pub(crate) fn answers(&mut self, taken: u32) {
        let step = |(leak, gaussians)| Answer { leak, gaussians, conductance: 0.1 };
        let steps = [(0.4, 10), (0.05, 30), (0.002, 70)].map(step).to_vec();
        self.shown.answers = Some(Arc::new(Answers { steps, first: 1, taken, tuning: None }));
    }

    /// The selection is one of a walk, and the next places to brush have been requested.
    pub(crate) fn walk(&mut self) {
        let (mode, kind) = (StrokeMode::Walk.into(), StrokeKind::Foreground.into());
        let stroke = Stroke { mode, kind, radius: 0.02, points: vec![0.5; 3], pressure: Vec::new(), depth: None };
        let mask = Some(encode_mask(&self.shown.selected));
        let commit = CommitSelection { mask, strokes: vec![stroke], ..CommitSelection::default() };
        self.shown.scene = Arc::new(self.shown.scene.after(&scene(), Action::CommitSelection(commit)).unwrap());
        let tuning = Some(WalkTuning { leak: 0.03, threshold: 1e-12 });
        self.shown.walk_capabilities = Some(WalkCapabilities { tuning, most_proposals: 16 });
        let place = |gaussians, uncertainty, expected_change| Proposal {
            point: vec![0.5; 3],
            gaussians,
            uncertainty,
            expected_change,
            ..Proposal::default()
        };
        let proposals = vec![place(42, 0.93, 1210.4), place(17, 0.41, 88.0), place(3, 0.2, 0.4)];
        let selection_hash = self.shown.scene.selection().hash().to_owned();
        self.shown.proposals = Some(Arc::new(ProposalsReply { proposals, selection_hash, proposals_ms: 2.0 }));
    }

    /// Shows its panels side by side, each of its own size.
    pub(crate) fn show(&mut self, ui: &mut egui::Ui) {
        ui.spacing_mut().item_spacing = egui::Vec2::ZERO;
        let mut left = egui::Pos2::ZERO;
        for panel in self.show.clone() {
            let mut size = panel.size * self.tools.scale;
            size.y = self.height.unwrap_or(size.y);
            size.x = self.width.unwrap_or(size.x);
            let mut child = ui.new_child(egui::UiBuilder::new().max_rect(egui::Rect::from_min_size(left, size)));
            child.reset_style();
            let asked = self.panels.show(panel, &mut child, &self.shown, &mut self.tools);
            if asked != Output::default() {
                self.asked.push(asked);
            }
            left.x += size.x;
        }
        if self.beside {
            ui.reset_style();
            let does = [
                ("right trigger", "brush: Region, adds"),
                ("left trigger", "brush: Region, removes"),
                ("grip", "take hold of the scene"),
            ];
            legend(ui, &does);
            self.panels.notices(ui, &self.shown);
        }
    }
}

/// A harness for a stage's panels.
pub(crate) fn harness(stage: Stage) -> Harness<'static, Stage> {
    let sizes: Vec<_> = stage.show.iter().map(|p| p.size * stage.tools.scale).collect();
    let size = egui::vec2(sizes.iter().map(|s| s.x).sum(), sizes.iter().map(|s| s.y).fold(0.0, f32::max));
    let looks = stage.tools.clone();
    Harness::builder()
        .with_size(size)
        .with_pixels_per_point(stage.pixels_per_point)
        .renderer(stage.textures.clone())
        .with_max_steps(12)
        .with_theme(if looks.light_panels { egui::Theme::Light } else { egui::Theme::Dark })
        .with_context_setup(move |ctx| theme::apply(ctx, &looks))
        .build_ui_state(
            |ui, stage: &mut Stage| {
                theme::apply(ui.ctx(), &stage.tools);
                stage.show(ui);
            },
            stage,
        )
}

/// Presses the widget with this label and lets the panels come to rest.
pub(crate) fn press(harness: &mut Harness<'_, Stage>, label: &str) {
    harness.get_by_label(label).click();
    harness.run();
}
