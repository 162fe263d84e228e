//! Files that are not ONNX Runtime, in a process of their own: a process loads one library.

#![allow(
    clippy::unwrap_used,
    clippy::print_stderr,
    reason = "a test fails by panicking, and one that is skipped says so"
)]

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use sg_encoders::OnnxRuntime;

fn error(path: &Path) -> String {
    let began = Instant::now();
    let error = OnnxRuntime::load(path).unwrap_err().to_string();
    assert!(began.elapsed() < Duration::from_secs(5), "{error}");
    assert!(!error.contains('\n') && error.starts_with(&format!("{}: ", path.display())), "{error}");
    error
}

/// The C library, which this process has loaded.
fn c_library() -> PathBuf {
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    let paths = maps.lines().filter_map(|line| line.split_whitespace().last());
    paths.map(PathBuf::from).find(|path| path.to_string_lossy().contains("/libc")).unwrap()
}

#[test]
fn other_files_are_refused_and_the_library_loads_once() {
    let folder = tempfile::tempdir().unwrap();
    let text = folder.path().join("libonnxruntime.so");
    std::fs::write(&text, "not a library\n".repeat(1000)).unwrap();
    let remedy = "`pip download onnxruntime` gets a wheel";
    for (path, problem) in [
        (folder.path().join("absent.so"), "No such file"),
        (folder.path().to_owned(), "it is a folder"),
        (text, "not a library that this machine can load: "),
        (c_library(), "it has no `OrtGetApiBase`"),
    ] {
        let error = error(&path);
        assert!(error.contains(problem) && error.contains(remedy), "{error}");
        // The loader's own reason, not only that it failed.
        assert!(!error.contains("dlopen failed"), "{error}");
    }

    let cache = directories::ProjectDirs::from("", "", "supergaussian").unwrap().cache_dir().to_owned();
    let named = std::env::var_os("SUPERGAUSSIAN_ONNXRUNTIME").map(PathBuf::from);
    let library = named.unwrap_or_else(|| cache.join("models/onnxruntime/libonnxruntime.so"));
    if !library.is_file() {
        let required = std::env::var("SUPERGAUSSIAN_REQUIRE_TOOLS").is_ok_and(|v| v == "1");
        assert!(!required, "no ONNX Runtime, and SUPERGAUSSIAN_REQUIRE_TOOLS=1; run ops/models.sh");
        eprintln!("SKIPPED: no ONNX Runtime, run ops/models.sh");
        return;
    }
    let runtime = OnnxRuntime::load(&library).unwrap();
    let is_version =
        |text: &str| text.split('.').count() >= 2 && text.split('.').all(|part| part.parse::<u32>().is_ok());
    assert!(is_version(runtime.version()), "{}", runtime.version());
    // Another name of the same file is the same library.
    let link = folder.path().join("link.so");
    std::os::unix::fs::symlink(&library, &link).unwrap();
    assert_eq!(OnnxRuntime::load(&link).unwrap().version(), runtime.version());
    let error = error(&c_library());
    assert!(error.contains(&format!("{} is loaded already", library.display())), "{error}");
}
