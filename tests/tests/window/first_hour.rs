//! A person's first hour with files that nobody tuned for, in a real window under a window manager.
//!
//! Each file is opened, oriented and brushed. The structure is named, recoloured, measured, deleted and exported. Keys and the
//! mouse do all of it. At the end the file is opened again.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use sg_formats::load::{LoadOptions, load};
use sg_proto::keys::{self, role};
use sg_proto::scene::State;
use sg_proto::selection::Answers;
use sg_runtime::bus::{Bus, endpoint_of};
use sg_tests::screen::{SIZE, Screen};
use sg_tests::until::{PATIENCE, scene, selected, soon, view};

/// How long a volume may take until its window shows a picture: the fit of 100,000 Gaussians and their clusters.
const OPENING: Duration = Duration::from_secs(240);

/// A file of the user's.
struct UserFile {
    /// Below the folder of real data.
    path: &'static str,
    /// Millimetres between voxels, where the file cannot say.
    spacing: Option<&'static str>,
    /// The user's name for the brushed structure.
    name: &'static str,
    /// The unit of lengths in replies.
    unit: Option<&'static str>,
}

const HEAD: UserFile = UserFile {
    path: "volumes/headsq_quarter_64x64x93_int16.raw.zst",
    spacing: Some("3.2,3.2,1.5"),
    name: "skin",
    unit: Some("mm"),
};
const PLAYBOT: UserFile =
    UserFile { path: "splats/playbot_lod4_8406.ply.zst", spacing: None, name: "plate", unit: None };

/// The files of the whole hour: four volumes, two splats.
const ALL: [UserFile; 6] = [
    HEAD,
    UserFile { path: "containers/tooth.nrrd", spacing: None, name: "crown", unit: None },
    UserFile { path: "containers/aneurism.vti", spacing: None, name: "sac", unit: None },
    UserFile {
        path: "volumes/bonsai_256x256x256_uint8.raw.zst",
        spacing: Some("1,1,1"),
        name: "foliage",
        unit: Some("mm"),
    },
    UserFile { path: "splats/donut_fused.ply", spacing: None, name: "icing", unit: None },
    UserFile { path: "splats/biker.compressed.ply", spacing: None, name: "jacket", unit: None },
];

/// One user with a home folder, before one screen.
struct Desk {
    screen: Screen,
    home: tempfile::TempDir,
    /// Folder of the pictures of each step, where they are wanted.
    pictures: Option<PathBuf>,
}

/// An open window of a file.
struct Window<'a> {
    desk: &'a Desk,
    file: &'a UserFile,
    process: Child,
    bus: Bus,
    /// Left, top, width and height on the screen, pixels.
    place: [i32; 4],
}

impl Desk {
    fn open(pictures: Option<PathBuf>) -> Option<Self> {
        let screen = Screen::open_managed().unwrap()?;
        Some(Self { screen, home: tempfile::tempdir().unwrap(), pictures })
    }

    fn run_root(&self) -> PathBuf {
        self.home.path().join("run")
    }

    fn command(&self) -> Command {
        let mut command = sg_tests::command(&self.run_root()).unwrap();
        let home = self.home.path();
        command.env("DISPLAY", self.screen.display()).env("HOME", home).env("XDG_CONFIG_HOME", home);
        command.env("XDG_PICTURES_DIR", home).env_remove("DBUS_SESSION_BUS_ADDRESS");
        command.stdin(Stdio::null());
        command
    }

    /// Opens a file as a person does in a terminal, and waits for its picture.
    async fn window<'a>(&'a self, data: &Path, file: &'a UserFile) -> Window<'a> {
        let path = self.own(&data.join(file.path));
        let log = self.home.path().join("open.log");
        let mut open = self.command();
        open.arg("open").arg(&path);
        if let Some(spacing) = file.spacing {
            open.args(["--spacing", spacing]);
        }
        let log_file = std::fs::File::create(&log).unwrap();
        open.stdout(log_file.try_clone().unwrap()).stderr(log_file);
        let mut process = open.spawn().unwrap();
        let title = path.file_name().unwrap().to_str().unwrap();
        let begun = Instant::now();
        let window = loop {
            if let Ok(window) = self.screen.window(title, Duration::from_secs(1)) {
                break window;
            }
            let ended = process.try_wait().unwrap();
            let said = || std::fs::read_to_string(&log).unwrap();
            assert!(ended.is_none() && begun.elapsed() < OPENING, "no window of {title}, {ended:?}: {}", said());
        };
        let bus = self.bus().await;
        view(&bus, "a picture in the window", |v| v.display == "window" && v.frames > 0).await;
        eprintln!("{title}: a window after {:.1} s", begun.elapsed().as_secs_f64());
        // The whole window is on the screen, its status line too.
        let begun = Instant::now();
        let place = loop {
            let [left, top, width, height] = self.screen.place(&window).unwrap();
            if left + width <= SIZE[0] as i32 && top + height <= SIZE[1] as i32 {
                break [left, top, width, height];
            }
            assert!(begun.elapsed() < PATIENCE, "{title} is larger than the screen: {left} {top} {width} {height}");
            tokio::time::sleep(Duration::from_millis(50)).await;
        };
        Window { desk: self, file, process, bus, place }
    }

    /// Folder of the user's files.
    fn files(&self) -> PathBuf {
        self.home.path().join("files")
    }

    /// The user's own copy of a file, unpacked if it was packed for the folder of data alone.
    fn own(&self, path: &Path) -> PathBuf {
        let name = path.file_name().unwrap().to_str().unwrap();
        let scene = name.strip_suffix(".ply.zst").map(|scene| format!("{scene}.ply"));
        let target = self.files().join(scene.as_deref().unwrap_or(name));
        if !target.exists() {
            std::fs::create_dir_all(self.files()).unwrap();
            let content = std::fs::read(path).unwrap();
            let content = if scene.is_some() { zstd::decode_all(&content[..]).unwrap() } else { content };
            std::fs::write(&target, content).unwrap();
        }
        target
    }

    /// Joins the one session that runs.
    async fn bus(&self) -> Bus {
        let ps = |name: &str| self.command().args(["ps", "--session", name]).output().unwrap().status.success();
        let folders = std::fs::read_dir(self.run_root()).unwrap().flatten();
        let names = folders.map(|f| f.file_name().into_string().unwrap()).filter(|name| !name.starts_with('.'));
        let running: Vec<_> = names.filter(|name| ps(name)).collect();
        let [session] = &running[..] else { panic!("{running:?} run") };
        let socket = self.run_root().join(session).join("bus.sock");
        Bus::connect(session, role::CLI, &endpoint_of(&socket)).await.unwrap()
    }
}

impl Window<'_> {
    fn key(&self, key: &str) {
        self.desk.screen.act(&["key", key]).unwrap();
    }

    async fn type_line(&self, text: &str) {
        // A text field takes letters from the frame after its key on.
        tokio::time::sleep(Duration::from_millis(500)).await;
        self.desk.screen.act(&["type", "--delay", "30", text]).unwrap();
        self.key("Return");
    }

    /// Keeps a picture of the screen, where pictures are wanted.
    async fn picture(&self, step: &str) {
        let Some(folder) = &self.desk.pictures else { return };
        // What lies still is sharp by then, on two cores too.
        tokio::time::sleep(Duration::from_secs(4)).await;
        let name = Path::new(self.file.path).file_name().unwrap().to_str().unwrap();
        let name = name.split(['.', '_']).next().unwrap();
        std::fs::create_dir_all(folder).unwrap();
        self.desk.screen.shot().unwrap().save(&folder.join(format!("{name}-{step}.png"))).unwrap();
    }

    async fn scene(&self, what: &str, holds: impl Fn(&State) -> bool) -> State {
        scene(&self.bus, &format!("{}: {what}", self.file.path), holds).await
    }

    /// Asks the agents for something: the reply.
    async fn say(&self, sentence: &str) -> String {
        let mut replies = self.bus.subscribe(&keys::REPLY, role::AGENT_CORE, 8).await.unwrap();
        self.key("Escape");
        self.key("Return");
        self.type_line(sentence).await;
        let (reply, _) = tokio::time::timeout(PATIENCE, replies.next()).await.expect(sentence).unwrap();
        eprintln!("{}: {sentence} -> {}", self.file.path, reply.text);
        assert!(reply.ok, "{sentence}: {}", reply.text);
        reply.text
    }

    /// Brushes about the middle of the window until something is selected: a person sees where the structure is.
    async fn brush(&self) -> State {
        self.key("b");
        let [left, top, width, height] = self.place;
        let middle = [left + width / 2, top + height / 2];
        let begun = Instant::now();
        for turn in 0.. {
            // Outwards on a spiral.
            let (angle, reach) = (f64::from(turn) * 2.4, 14.0 * f64::from(turn).sqrt());
            let at = [middle[0] + (reach * angle.cos()) as i32, middle[1] + (reach * angle.sin()) as i32];
            let stroke: Vec<[i32; 2]> = (0..6).map(|k| [at[0] + 5 * k, at[1] + 2 * k]).collect();
            self.desk.screen.drag(&stroke).unwrap();
            if super::selected_soon(&self.bus, Duration::from_secs(3)).await.is_some() {
                break;
            }
            assert!(begun.elapsed() < 2 * PATIENCE, "{}: a stroke selects nothing", self.file.path);
        }
        // The region is there when the selection rests.
        let mut before = 0;
        loop {
            tokio::time::sleep(Duration::from_millis(700)).await;
            let state = self.bus.newest(&keys::SCENE_STATE, &soon()).await.unwrap();
            if selected(&state) == before {
                return state;
            }
            before = selected(&state);
        }
    }

    fn close(mut self) {
        self.key("ctrl+q");
        let begun = Instant::now();
        while self.process.try_wait().unwrap().is_none() {
            assert!(begun.elapsed() < PATIENCE, "{} does not close", self.file.path);
            std::thread::sleep(Duration::from_millis(50));
        }
        assert!(self.process.wait().unwrap().success(), "{}", self.file.path);
    }
}

impl Drop for Window<'_> {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// What a person does with a file in their first hour.
async fn hour(desk: &Desk, data: &Path, file: &UserFile) {
    let window = desk.window(data, file).await;
    let begun = window.scene("the scene", |s| s.count > 0).await;
    window.picture("1-open").await;

    window.key("u");
    let turned = window.scene("another axis up", |s| s.up != begun.up).await;
    window.picture("2-turned").await;
    window.key("ctrl+z");
    window.scene("the file's axis up", |s| s.revision > turned.revision && s.up == begun.up).await;

    let brushed = window.brush().await;
    assert!(selected(&brushed) < brushed.count, "a stroke selects everything: {brushed:?}");
    window.picture("3-brushed").await;
    window.less_and_more(&brushed).await;

    window.key("ctrl+s");
    window.type_line(file.name).await;
    window.scene("a named unit", |s| s.units.iter().any(|u| u.name == file.name)).await;
    window.say(&format!("make the {} red", file.name)).await;
    let is_red = |s: &State| s.units.iter().any(|u| u.color.is_some_and(|c| c.red > 0.8 && c.blue < 0.3));
    let red = window.scene("a red unit", is_red).await;
    view(&window.bus, "a red picture", |v| v.revision >= red.revision).await;
    window.picture("4-red").await;

    let size = window.say(&format!("how big is the {}?", file.name)).await;
    if let Some(unit) = file.unit {
        assert!(size.contains(&format!(" {unit}")), "{size}");
    }
    window.picture("5-measured").await;

    window.say(&format!("select the {}", file.name)).await;
    let chosen = window.scene("a selection", |s| selected(s) > 0).await;
    window.key("Escape");
    window.duplicate(&chosen).await;
    window.key("Delete");
    let deleted = window.scene("deleted Gaussians", |s| s.deleted.is_some() || selected(s) == 0).await;
    window.picture("7-deleted").await;
    window.key("ctrl+z");
    window.scene("they are back", |s| s.revision > deleted.revision && selected(s) == selected(&chosen)).await;

    window.edit_by_words().await;

    let exported = window.export(selected(&chosen)).await;
    eprintln!("{}: {} exported", file.path, exported.display());
    window.export_by_words(selected(&chosen)).await;
    window.close();

    let window = desk.window(data, file).await;
    let kept = window.scene("the edits of before", is_red).await;
    assert!(kept.units.iter().any(|u| u.name == file.name), "{kept:?}");
    window.picture("9-reopened").await;
    window.close();
}

impl Window<'_> {
    /// The answers to the strokes of the selection at this revision of the scene.
    async fn answers(&self, at: &State) -> Answers {
        let context = soon();
        loop {
            let state = self.bus.newest(&keys::SELECTION_STATE, &context).await.unwrap();
            if state.revision >= at.revision {
                return state.answers.unwrap_or_default();
            }
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }

    /// Duplicates the selection by its key, colours the copy alone by words, and takes both back.
    async fn duplicate(&self, chosen: &State) {
        self.key("shift+d");
        let copies = selected(chosen);
        let is_copied = |s: &State| s.count == chosen.count + copies && selected(s) == copies;
        let copied = self.scene("selected copies", is_copied).await;
        let copy = copied.base_units.last().unwrap();
        assert!(copy.duplicated && copy.count == copies, "{copy:?}");
        self.say("make the selection blue").await;
        let blue = self.scene("blue copies", |s| s.revision > copied.revision && s.count == copied.count).await;
        view(&self.bus, "a picture with the copies", |v| v.revision >= blue.revision).await;
        self.picture("6-duplicated").await;
        self.key("Escape");
        self.key("ctrl+z");
        self.key("ctrl+z");
        let back = self.scene("no copy", |s| s.count == chosen.count && selected(s) == copies).await;
        view(&self.bus, "a picture without the copies", |v| v.revision >= back.revision).await;
    }

    /// Takes another answer to the stroke by a key, and one by words, and takes both back.
    async fn less_and_more(&self, brushed: &State) {
        let first = self.answers(brushed).await;
        eprintln!("{}: {:?}, answer {} taken", self.file.path, first.steps, first.taken);
        let another = |s: &State| s.revision > brushed.revision && selected(s) != selected(brushed);
        let back = |at: u64| move |s: &State| s.revision > at && selected(s) == selected(brushed);
        assert!(first.steps.len() > 1, "{}: one answer alone: {first:?}", self.file.path);
        let (key, words) = if first.taken > 0 { ("comma", "only this part") } else { ("period", "the whole thing") };
        self.key(key);
        let stepped = self.scene("another answer by a key", another).await;
        let taken = self.answers(&stepped).await;
        assert_eq!((&taken.steps, taken.first), (&first.steps, first.first));
        assert_eq!(taken.taken.abs_diff(first.taken), 1, "{taken:?}");
        self.picture(&format!("3-{key}")).await;
        self.key("ctrl+z");
        let undone = self.scene("the first answer", back(stepped.revision)).await;
        assert_eq!(self.answers(&undone).await, first);
        let said = self.say(words).await;
        assert!(said.contains(&format!("of {} answers", first.steps.len())), "{said}");
        let by_words = self.scene("another answer by words", |s| s.revision > undone.revision && another(s)).await;
        self.picture("3-by-words").await;
        self.key("Escape");
        self.key("ctrl+z");
        self.scene("the first answer again", back(by_words.revision)).await;
    }

    /// Moves, turns, scales and recolours the named structure by words, merges it with a second one, and takes each back.
    async fn edit_by_words(&self) {
        let name = self.file.name;
        let distance = if self.file.unit.is_some() { "5 mm" } else { "2 units" };
        let made = |s: &State| (s.undo.clone(), s.units.clone());
        let before = self.scene("the scene", |_| true).await;
        for (sentence, reply, step) in [
            (format!("move the {name} {distance} to the left"), format!("{distance} to the left"), "moved"),
            (format!("turn the {name} by 30 degrees around z"), "30° around z".to_owned(), "turned"),
            (format!("make the {name} twice as big"), "200 %".to_owned(), "scaled"),
            (format!("make the {name} less saturated"), "50 % saturation".to_owned(), "saturation"),
        ] {
            let said = self.say(&sentence).await;
            assert!(said.contains(&reply), "{said}");
            let done = self.scene(&sentence, |s| s.undo.first().is_some_and(|line| line.contains(step))).await;
            assert_eq!(done.undo.get(1..6), before.undo.get(..5), "{sentence}: one step");
            self.picture(&format!("6-{step}")).await;
            self.key("Escape");
            self.key("ctrl+z");
            self.scene("taken back", |s| made(s) == made(&before)).await;
        }
        // The selection under a second name, merged and taken apart again.
        self.key("ctrl+s");
        self.type_line("second").await;
        self.scene("a second unit", |s| s.units.iter().any(|u| u.name == "second")).await;
        let said = self.say(&format!("merge the {name} and the second as both")).await;
        assert!(said.starts_with("Merged") && said.contains("both"), "{said}");
        self.scene("one unit of two", |s| {
            let names: Vec<&str> = s.units.iter().map(|u| u.name.as_str()).collect();
            names.contains(&"both") && !names.contains(&name) && !names.contains(&"second")
        })
        .await;
        self.key("Escape");
        self.key("ctrl+z");
        self.key("ctrl+z");
        self.scene("the units of before", |s| made(s) == made(&before)).await;
    }

    /// Exports the selection by Ctrl+E and a typed path: a file that holds as many Gaussians.
    async fn export(&self, count: u64) -> PathBuf {
        let path = self.desk.files().join(format!("{}-selection.splat", self.file.name));
        self.key("ctrl+e");
        tokio::time::sleep(Duration::from_millis(700)).await;
        self.key("ctrl+a");
        self.picture("7-export").await;
        self.type_line(path.to_str().unwrap()).await;
        let begun = Instant::now();
        while !path.exists() {
            assert!(begun.elapsed() < PATIENCE, "{}: no file of the selection", self.file.path);
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
        let exported = load(&path, &LoadOptions::default()).unwrap().scene;
        assert_eq!(exported.len() as u64, count, "{}", path.display());
        path
    }

    /// Exports the named structure and the picture by words: they are beside the opened file.
    async fn export_by_words(&self, count: u64) {
        let at = |name: &str| self.desk.files().join(name);
        let name = self.file.name;
        let said = self.say(&format!("export the {name} as {name}.ply")).await;
        assert!(said.contains(&format!("{name}.ply")), "{said}");
        let exported = load(&at(&format!("{name}.ply")), &LoadOptions::default()).unwrap().scene;
        assert_eq!(exported.len() as u64, count);
        self.say(&format!("save a picture as {name}.png at twice the size")).await;
        let picture = std::fs::read(at(&format!("{name}.png"))).unwrap();
        let edge = |at: usize| u32::from_be_bytes(picture[at..at + 4].try_into().unwrap());
        let window = view(&self.bus, "the picture in the window", |v| v.width > 0).await;
        assert_eq!([edge(16), edge(20)], [2 * window.width, 2 * window.height]);
        self.picture("8-exported").await;
    }
}

fn run(files: &[UserFile], pictures: Option<PathBuf>) {
    let Some(data) = sg_tests::real_data().unwrap() else {
        eprintln!("SKIPPED the first hour: SUPERGAUSSIAN_DATA names no folder of real data");
        return;
    };
    let Some(desk) = Desk::open(pictures) else { return };
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    for file in files {
        runtime.block_on(hour(&desk, &data, file));
    }
}

#[test]
fn a_first_hour_in_short() {
    run(&[HEAD, PLAYBOT], None);
}

#[test]
#[ignore = "a campaign by hand: SUPERGAUSSIAN_FIRST_HOUR=FOLDER for the pictures"]
fn a_first_hour() {
    run(&ALL, std::env::var_os("SUPERGAUSSIAN_FIRST_HOUR").map(PathBuf::from));
}
