//! Good and bad launch files, with the exact messages.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::*;

struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    /// A folder with two executables and one file without execute permission.
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        for (name, mode) in [("supergaussian-scene", 0o755), ("worker", 0o755), ("plain", 0o644)] {
            let path = folder.path().join(name);
            std::fs::write(&path, "").unwrap();
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
        }
        Self { folder }
    }

    fn read(&self, text: &str, overrides: &[&str]) -> Result<LaunchFile, Problems> {
        let search = ExecutableSearch::in_folders(vec![self.folder.path().to_owned()]);
        let overrides: Vec<_> = overrides.iter().map(ToString::to_string).collect();
        let path = self.folder.path().join("x.toml");
        read(Source { path: &path, text, overrides: &overrides }, &search)
    }

    /// The messages about a bad file, without the folder's name.
    fn complaints(&self, text: &str, overrides: &[&str]) -> Vec<String> {
        let said = self.read(text, overrides).unwrap_err().to_string();
        let folder = format!("{}/", self.folder.path().display());
        said.replace(&folder, "").lines().map(str::to_owned).collect()
    }
}

const HEAD: &str = "schema = 1\n";

#[test]
fn full_file_is_read() {
    let bench = Bench::new();
    let text = r#"
schema = 1
name = "full"
[defaults]
stop = 3
restart = "always"
env = { A = "1", B = "2" }
[service.view]
exec = "worker"
role = "render-view"
after = { scene = "ready" }
[service.scene]
exec = "supergaussian-scene"
params = { scene = "a.ply", deep = { list = [1, 2.5, true] } }
restart = "never"
backoff = { initial_ms = 50, max_ms = 400 }
intensity = { restarts = 2, within_s = 1.5 }
ready = 0.5
liveness = 2
progress = 7
stop = 1
critical = true
memory_mib = 512
env = { B = "3" }
"#;
    let file = bench.read(text, &[]).unwrap();
    assert_eq!(file.name.as_deref(), Some("full"));
    let [scene, view] = file.services.as_slice() else { panic!("{file:?}") };
    assert_eq!((scene.name.as_str(), scene.role.as_str(), view.role.as_str()), ("scene", "scene", "render-view"));
    assert_eq!(scene.start.executable, bench.folder.path().join("supergaussian-scene"));
    assert_eq!(
        serde_json::Value::Object(scene.start.params.clone()),
        serde_json::json!({"scene": "a.ply", "deep": {"list": [1, 2.5, true]}})
    );
    assert_eq!(view.after, ["scene"]);
    let pairs = |p: &[(&str, &str)]| p.iter().map(|(a, b)| ((*a).to_owned(), (*b).to_owned())).collect::<Vec<_>>();
    let millis = Duration::from_millis;
    assert_eq!(
        scene.policy,
        Policy {
            restart: Restart::Never,
            backoff_initial: millis(50),
            backoff_max: millis(400),
            restarts: 2,
            within: millis(1500),
            ready: millis(500),
            liveness: millis(2000),
            progress: millis(7000),
            stop: millis(1000),
            critical: true,
            memory_bytes: Some(512 << 20),
        }
    );
    assert_eq!(scene.start.env, pairs(&[("A", "1"), ("B", "3")]));
    assert_eq!(view.start.env, pairs(&[("A", "1"), ("B", "2")]));
    assert_eq!(view.policy, Policy { restart: Restart::Always, stop: millis(3000), ..Policy::default() });
}

#[test]
fn every_mistake_is_one_line_with_place_and_remedy() {
    let bench = Bench::new();
    let cases: &[(&str, &[&str])] = &[
        ("[service.a]\nexec = \"worker\"\n", &["x.toml:1:1: `schema` is missing; begin the file with `schema = 1`"]),
        ("schema = 2\n[service.a]\nexec = \"worker\"\n", &["x.toml:1:10: this version reads schema 1 only"]),
        (
            "schema = 1\n[service.supervisor]\nexec = \"worker\"\nrole = \"scene\"\n",
            &["x.toml:2:10: service `supervisor`: the supervisor's own log has this name; choose another one"],
        ),
        (HEAD, &["x.toml:1:1: no service; add a table such as `[service.scene]`"]),
        ("schema = 1\nschema = 1\n", &["x.toml:2:1: duplicate key"]),
        (
            "schema = 1\nservices = 3\n[service.a]\nexec = \"worker\"\n",
            &["x.toml:2:1: unknown key `services` in the file; did you mean `service`?"],
        ),
        (
            "schema = 1\n[service.a]\nexce = \"worker\"\n",
            &[
                "x.toml:2:10: service `a` has no `exec`",
                "x.toml:3:1: unknown key `exce` in [service.a]; did you mean `exec`?",
            ],
        ),
        (
            "schema = 1\n[service.a]\nexec = \"worker\"\nafter = { b = \"redy\" }\n[service.b]\nexec = 3\n",
            &[
                "x.toml:4:15: unknown condition `redy`; did you mean `ready`?",
                "x.toml:6:8: `exec` must be a string, not an integer",
            ],
        ),
        (
            "schema = 1\n[service.scene]\nexec = \"worker\"\n[service.view]\nexec = \"worker\"\nafter = { scence = \"ready\" }\n",
            &["x.toml:6:11: `view` comes after `scence`, which is no service; did you mean `scene`?"],
        ),
        (
            "schema = 1\n[service.a]\nexec = \"worker\"\nafter = { b = \"ready\" }\n[service.b]\nexec = \"worker\"\nafter = { c = \"ready\" }\n[service.c]\nexec = \"worker\"\nafter = { a = \"ready\" }\n",
            &[
                "x.toml:10:11: `a` comes after `b`, which comes after `c`, which comes after `a`: a cycle; take one `after` away",
            ],
        ),
        (
            "schema = 1\n[service.a]\nexec = \"worker\"\nafter = { a = \"ready\" }\n",
            &["x.toml:4:11: `a` comes after `a`: a cycle; take one `after` away"],
        ),
        (
            "schema = 1\n[service.a]\nexec = \"supergaussian-scenes\"\n",
            &[
                "x.toml:3:8: executable `supergaussian-scenes` is neither beside the launcher nor on PATH; build it with `cargo build --release`; did you mean `supergaussian-scene`?",
            ],
        ),
        (
            "schema = 1\n[service.a]\nexec = \"./plain\"\n",
            &["x.toml:3:8: executable `./plain`: plain is not an executable file"],
        ),
        (
            "schema = 1\n[service.a]\nexec = \"./none\"\n",
            &["x.toml:3:8: executable `./none`: none: No such file or directory (os error 2)"],
        ),
        (
            "schema = 1\n[service.a]\nexec = \"worker\"\nrole = \"r\"\n[service.b]\nexec = \"worker\"\nrole = \"r\"\n",
            &["x.toml:5:10: services `a` and `b` both serve role `r`; only one service may hold a role"],
        ),
        (
            "schema = 1\n[service.a]\nexec = \"worker\"\nrole = \"cli\"\n",
            &["x.toml:4:8: role `cli`: use letters, digits, `-` or `_`, and none of `supervisor`, `cli`, `node`"],
        ),
        (
            "schema = 1\n[service.\"a/b\"]\nexec = \"worker\"\nrole = \"r\"\n",
            &["x.toml:2:10: service `a/b`: use 1 to 100 letters, digits, `-` or `_`"],
        ),
        (
            "schema = 1\nname = \"a b\"\n[service.a]\nexec = \"worker\"\n",
            &["x.toml:2:8: session name `a b`: use 1 to 128 letters, digits, `-` or `_`"],
        ),
        (
            "schema = 1\n[defaults]\nexec = \"worker\"\nrestart = \"alway\"\nstop = -1\nready = \"5\"\ncritical = 1\n[service.a]\nexec = \"worker\"\nbackoff = { initial_ms = 900, max_ms = 100 }\nintensity = { restart = 3, restarts = -1 }\nliveness = nan\n",
            &[
                "x.toml:3:1: unknown key `exec` in [defaults]; there are `restart`, `backoff`, `intensity`, `env`, `ready`, `liveness`, `progress`, `stop`, `critical`, `memory_mib`",
                "x.toml:4:11: `restart` is `alway`; did you mean `always`?",
                "x.toml:5:8: `stop` is -1 seconds; it must be above 0 and at most a day",
                "x.toml:6:9: `ready` must be a number of seconds, not a string",
                "x.toml:7:12: `critical` must be true or false, not an integer",
                "x.toml:10:11: `initial_ms` is above `max_ms`",
                "x.toml:11:15: unknown key `restart` in `intensity`; did you mean `restarts`?",
                "x.toml:11:39: `restarts` is -1; it must lie between 0 and 1000",
                "x.toml:12:12: `liveness` is NaN seconds; it must be above 0 and at most a day",
            ],
        ),
    ];
    for (text, expected) in cases {
        assert_eq!(bench.complaints(text, &[]), *expected, "{text}");
    }
}

#[test]
fn truncated_file_is_reported_with_its_place() {
    let bench = Bench::new();
    let said = bench.complaints("schema = 1\n[service.a\nexec = \"worker\"\n", &[]);
    assert!(said[0].starts_with("x.toml:2:"), "{said:?}");
}

#[test]
fn overrides_are_checked_like_the_file() {
    let bench = Bench::new();
    let text = "schema = 1\n[service.a]\nexec = \"worker\"\n";
    let file = bench.read(text, &["service.a.params.scene=/x/scene.toml", "service.a.stop=0.5"]).unwrap();
    assert_eq!(file.services[0].start.params["scene"], "/x/scene.toml");
    assert_eq!(file.services[0].policy.stop, Duration::from_millis(500));
    assert_eq!(
        bench.complaints(text, &["service.a.stpo=1"]),
        ["--set service.a.stpo=1: unknown key `stpo` in [service.a]; did you mean `stop`?"]
    );
    assert_eq!(
        bench.complaints(text, &["service.a.stop"]),
        ["--set service.a.stop: write it as a.b=c, such as service.scene.params.scene=skull.ply"]
    );
}

#[test]
fn only_some_services_can_be_started() {
    let bench = Bench::new();
    let text =
        "schema = 1\n[service.a]\nexec = \"worker\"\n[service.b]\nexec = \"worker\"\nafter = { a = \"ready\" }\n";
    let file = bench.read(text, &[]).unwrap();
    let only = file.clone().only(&["b".to_owned()]).unwrap();
    assert_eq!(only.services.len(), 1);
    assert!(only.services[0].after.is_empty());
    assert_eq!(file.only(&["bb".to_owned()]).unwrap_err().to_string(), "--only bb: no such service; did you mean `b`?");
}

const MACHINES: &str = r#"schema = 1
[bus]
listen = "tls/0.0.0.0:7447"
authority = "plain"
certificate = "plain"
key = "plain"
[node.gpu1]
lease = 3
[service.scene]
exec = "supergaussian-scene"
[service.view]
exec = "not-on-this-machine"
role = "render-view"
on = "gpu1"
"#;

#[test]
fn services_may_run_on_other_machines() {
    let bench = Bench::new();
    let file = bench.read(MACHINES, &[]).unwrap();
    let listen = file.listen.as_ref().unwrap();
    assert_eq!((listen.endpoint.as_str(), listen.key.clone()), ("tls/0.0.0.0:7447", bench.folder.path().join("plain")));
    assert_eq!(file.nodes, [crate::file::Node { name: "gpu1".into(), lease: Duration::from_secs(3) }]);
    let view = &file.services[1].start;
    assert_eq!((view.node.as_deref(), view.executable.as_path()), (Some("gpu1"), Path::new("not-on-this-machine")));
    assert_eq!(file.roles_on("gpu1").map(|s| s.role.as_str()).collect::<Vec<_>>(), ["render-view"]);
}

#[test]
fn nodes_connect_by_tls_and_are_known_by_name() {
    let bench = Bench::new();
    let said = |set: &str| bench.complaints(MACHINES, &[set]);
    let tcp = said("bus.listen=tcp/0.0.0.0:7447");
    assert!(tcp[0].contains("over TLS only"), "{tcp:?}");
    let portless = said("bus.listen=tls/lab");
    assert!(portless[0].contains("write `tls/ADDRESS:PORT`"), "{portless:?}");
    let missing = said("bus.key=none.pem");
    assert!(missing[0].contains("none.pem: no such file; make it with `supergaussian certificates`"), "{missing:?}");
    let unknown = said("service.view.on=gpu2");
    assert!(unknown[0].contains("`on` names `gpu2`") && unknown[0].contains("did you mean `gpu1`?"), "{unknown:?}");
    let path = said("service.view.exec=./view");
    assert!(path[0].contains("needs a name without a path"), "{path:?}");
    let hasty = said("node.gpu1.lease=0.5");
    assert!(hasty[0].contains("at least 2 seconds"), "{hasty:?}");
    let nowhere = bench.complaints("schema = 1\n[node.a]\n[service.scene]\nexec = \"worker\"\n", &[]);
    assert_eq!(nowhere, ["x.toml:2:7: node `a` cannot join without an endpoint; add `[bus]` with `listen`"]);
    let partly = bench.complaints("schema = 1\n[bus]\nlisten = \"tls/a:1\"\n[service.scene]\nexec = \"worker\"\n", &[]);
    assert_eq!(partly.len(), 3, "{partly:?}");
}

#[test]
fn shipped_file_is_valid() {
    let path = Path::new("headless.toml");
    let names =
        ["scene", "selection", "labeling", "speech", "render-node", "agent-core", "agent-intent", "agent-function"];
    let folder = tempfile::tempdir().unwrap();
    for name in names {
        let path = folder.path().join(format!("supergaussian-{name}"));
        std::fs::write(&path, "").unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    }
    let search = ExecutableSearch::in_folders(vec![PathBuf::from(folder.path())]);
    let file = read(Source { path, text: include_str!("../../../headless.toml"), overrides: &[] }, &search).unwrap();
    let mut roles: Vec<_> = file.services.iter().map(|s| s.role.as_str()).collect();
    roles.sort_unstable();
    let mut all: Vec<_> = role::ALL.to_vec();
    all.retain(|r| !role::NON_SERVICES.contains(r));
    all.sort_unstable();
    assert_eq!(roles, all);
    assert!(file.services.iter().all(|s| s.name == s.role), "services are called like their roles");
}
