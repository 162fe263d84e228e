//! Recordings of the frame times of real sessions under Monado. With `SUPERGAUSSIAN_TRACES=write` longer ones are kept in
//! `tests/traces`.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use glam::DVec3;
use sg_viewer::display::frame_trace::{FrameTrace, SessionVisibility, TraceRow};
use sg_viewer::display::{Tools, ViewPort};
use sg_viewer::vr::{Setup, VrView};
use sg_viewer::xr::{Frame, FrameOutcome, Headset, Options, PAUSE};

use crate::monado::{Display, Puppet, Runtime, folder, is_inside, run_inside};
use crate::rooms::shown_of;
use crate::scenes;

const PATIENCE: Duration = Duration::from_secs(120);

/// Seconds of the other program, for it.
const SECONDS: &str = "SUPERGAUSSIAN_TEST_SECONDS";

/// What happens to a session.
#[derive(Debug, Clone, Copy)]
enum Act {
    /// The person stands two metres from the scene.
    Far,
    /// The scene fills the view.
    Near,
    /// The same as far, while the machine's cores are busy for 0.2 s every two seconds.
    Bursts,
    /// Another program is shown, as when the headset shows its home.
    Elsewhere,
}

/// A session: the edge of the eyes' images over the recommended one, and its acts with their seconds.
struct Play {
    name: &'static str,
    resolution: f64,
    gaussians: usize,
    acts: &'static [(f64, Act)],
}

/// Longer recordings, kept on request.
const PLAYS: [Play; 4] = [
    Play { name: "steady", resolution: 0.3, gaussians: 400, acts: &[(20.0, Act::Far)] },
    Play { name: "spikes", resolution: 0.3, gaussians: 400, acts: &[(20.0, Act::Bursts)] },
    Play {
        name: "overload",
        resolution: 1.0,
        gaussians: 3000,
        acts: &[(8.0, Act::Far), (10.0, Act::Near), (10.0, Act::Far)],
    },
    Play {
        name: "hidden",
        resolution: 0.6,
        gaussians: 1500,
        acts: &[(6.0, Act::Near), (5.0, Act::Elsewhere), (6.0, Act::Near)],
    },
];

/// A short one for every run.
const SHORT: Play = Play {
    name: "short",
    resolution: 0.3,
    gaussians: 400,
    acts: &[(1.5, Act::Far), (1.5, Act::Near), (1.0, Act::Elsewhere), (1.0, Act::Bursts)],
};

#[test]
fn a_session_records_its_frames() {
    run_inside("traces::inside_a_session_records_its_frames");
}

#[test]
#[ignore = "run by the test without `inside`"]
fn inside_a_session_records_its_frames() {
    if !is_inside() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let trace = FrameTrace::read(&record(&SHORT, folder.path())).unwrap();
    summarize(&SHORT, &trace);
    let states = trace.rows.iter().map(|r| r.state).collect::<Vec<_>>();
    let find = |from: usize, state| states[from..].iter().position(|s| *s == state).map(|k| from + k);
    let focused = find(0, SessionVisibility::Focused).expect("a session with focus");
    let hidden = find(focused, SessionVisibility::Hidden).expect("a hidden session");
    assert!(find(hidden, SessionVisibility::Focused).is_some(), "shown again");
    let measured: Vec<&TraceRow> = trace.rows.iter().filter(|r| r.cost.is_some()).collect();
    assert!(measured.len() >= 5, "{} of {} pictures were measured", measured.len(), states.len());
    for row in measured {
        let cost = row.cost.unwrap();
        assert!(row.level.is_some() && row.period > 0.0 && cost.seconds > 0.0 && cost.delay < 30.0, "{row:?}");
        assert!(cost.pixel_seconds.is_none_or(|pixels| pixels <= 1.001 * cost.seconds), "{row:?}");
    }
    if std::env::var_os("SUPERGAUSSIAN_TRACES").is_none_or(|v| v != "write") {
        return;
    }
    let committed = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/traces");
    std::fs::create_dir_all(&committed).unwrap();
    for play in &PLAYS {
        let path = record(play, folder.path());
        summarize(play, &FrameTrace::read(&path).unwrap());
        std::fs::copy(path, committed.join(play.name).with_extension("csv")).unwrap();
    }
}

fn summarize(play: &Play, trace: &FrameTrace) {
    let rows = &trace.rows;
    let mut costs: Vec<f64> = rows.iter().filter_map(|r| r.cost.map(|c| 1e3 * c.seconds)).collect();
    costs.sort_by(f64::total_cmp);
    let missed: u64 = rows.iter().map(|r| r.missed).sum();
    let levels = rows.iter().filter_map(|r| r.level);
    println!(
        "{}: {} rows, {} measured, {:?} ms at least, in the median and at most, {missed} frames missed, levels {:?} to {:?}",
        play.name,
        rows.len(),
        costs.len(),
        [0, costs.len() / 2, costs.len() - 1].map(|k| costs[k]),
        levels.clone().min(),
        levels.max()
    );
}

/// Another program with a session, ended with this.
struct Elsewhere(Child);

impl Elsewhere {
    fn begin(seconds: f64) -> Self {
        // Within the folder, this process is the folder's dynamic loader with the test as its argument.
        let program = std::env::args().next().unwrap();
        let child = Command::new(folder().unwrap().join("run"))
            .arg(program)
            .args(["--exact", "traces::inside_another_program", "--ignored", "--nocapture"])
            .env(SECONDS, seconds.to_string())
            .stdin(Stdio::null())
            .spawn();
        Self(child.unwrap())
    }
}

impl Drop for Elsewhere {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
#[ignore = "run by the recording of a session"]
fn inside_another_program() {
    let Some(seconds) = std::env::var(SECONDS).ok().and_then(|s| s.parse().ok()).map(Duration::from_secs_f64) else {
        return;
    };
    let mut headset = Headset::open(Options::default()).unwrap();
    let (begun, mut leaves) = (Instant::now(), false);
    loop {
        match headset.frame(|frame: &mut Frame<'_>| frame.draw_eyes(|_| ())).unwrap() {
            FrameOutcome::Ended => return,
            FrameOutcome::Shown | FrameOutcome::Hidden => {}
            _ => std::thread::sleep(PAUSE),
        }
        if begun.elapsed() > seconds && !leaves {
            leaves = true;
            headset.leave();
        }
        assert!(begun.elapsed() < PATIENCE);
    }
}

/// Keeps all cores busy for 0.2 s every two seconds.
struct Bursts(Arc<AtomicBool>);

impl Bursts {
    fn begin() -> Self {
        let ends = Arc::new(AtomicBool::new(false));
        let stop = Arc::clone(&ends);
        std::thread::spawn(move || {
            while !stop.load(Ordering::Relaxed) {
                let until = Instant::now() + Duration::from_millis(200);
                let spin = || while Instant::now() < until {};
                std::thread::scope(|scope| (0..16).for_each(|_| drop(scope.spawn(spin))));
                std::thread::sleep(Duration::from_millis(1800));
            }
        });
        Self(ends)
    }
}

impl Drop for Bursts {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Plays a session and returns its recording.
fn record(play: &Play, folder: &Path) -> PathBuf {
    let folder = folder.join(play.name);
    let _runtime = Runtime::start(&Display::None);
    let mut puppet = Puppet::connect();
    let mut headset = Headset::open(Options { resolution: play.resolution, ..Options::default() }).unwrap();
    let scene = Arc::new(scenes::scene(&scenes::surface(play.gaussians, 7)));
    let (view_port, _service) = ViewPort::new(shown_of(&scene));
    let setup = Setup {
        scene: Arc::clone(&scene),
        view_port,
        tools: Tools::default(),
        near: None,
        settings: None,
        opened: "scene.ply".into(),
        mirror: false,
        rasterizer: None,
        pictures: folder.clone(),
        frame_traces: Some(folder.clone()),
    };
    let mut room = VrView::new(setup, &headset);
    let mut until = |what: &str, done: &mut dyn FnMut(&VrView, FrameOutcome) -> bool| {
        let begun = Instant::now();
        loop {
            assert!(begun.elapsed() < PATIENCE, "waited in vain for: {what}");
            let step = room.step(&mut headset).unwrap();
            if done(&room, step) {
                return;
            }
            if !matches!(step, FrameOutcome::Shown | FrameOutcome::Hidden) {
                std::thread::sleep(PAUSE);
            }
        }
    };
    until("a picture", &mut |room, _| room.level().is_some());
    for (seconds, act) in play.acts {
        let head = match act {
            Act::Near => DVec3::new(0.0, 1.2, -0.25),
            Act::Far | Act::Bursts | Act::Elsewhere => DVec3::new(0.0, 1.4, 1.2),
        };
        if !matches!(act, Act::Elsewhere) {
            puppet.head = head.as_vec3().to_array();
            puppet.send();
        }
        let mut elsewhere = matches!(act, Act::Elsewhere).then(|| Elsewhere::begin(*seconds));
        let bursts = matches!(act, Act::Bursts).then(Bursts::begin);
        let (begun, mut was_hidden) = (Instant::now(), false);
        until("an act", &mut |_, step| match &mut elsewhere {
            None => begun.elapsed().as_secs_f64() > *seconds,
            Some(other) => {
                was_hidden |= step == FrameOutcome::Hidden;
                let ended = other.0.try_wait().unwrap().is_some();
                ended && step == FrameOutcome::Shown
            }
        });
        assert_eq!(was_hidden, elsewhere.is_some(), "a session behind another program is hidden");
        drop(bursts);
    }
    drop(room);
    folder.join("frames-0001.csv")
}
