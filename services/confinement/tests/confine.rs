//! The kernel refuses whatever the rights do not name.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stderr, reason = "a test's helpers fail the test")]

use std::fs;
use std::net::{TcpListener, TcpStream};
use std::os::linux::net::SocketAddrExt as _;
use std::os::unix::net::{SocketAddr, UnixListener, UnixStream};
use std::path::Path;

use sg_confinement::{Enforcement, Rights, Support, confine, support};

/// Version of the kernel's Landlock. Without one the test says loudly that it tests nothing.
fn version() -> Option<u32> {
    match support() {
        Support::Version(version) => Some(version),
        other => {
            eprintln!("SKIPPED: {other}; nothing is confined here");
            None
        }
    }
}

/// Does something in a thread of its own with these rights.
fn confined<T: Send>(rights: &Rights, does: impl FnOnce() -> T + Send) -> T {
    std::thread::scope(|scope| {
        let thread = scope.spawn(|| {
            assert_ne!(confine(rights).unwrap(), Enforcement::None);
            does()
        });
        thread.join().unwrap()
    })
}

fn refused<T>(outcome: std::io::Result<T>) -> bool {
    outcome
        .is_err_and(|e| matches!(e.kind(), std::io::ErrorKind::PermissionDenied | std::io::ErrorKind::CrossesDevices))
}

#[test]
fn files_are_read_and_written_where_the_rights_say() {
    let Some(version) = version() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (input, output, secret) =
        (folder.path().join("input"), folder.path().join("output"), folder.path().join(".ssh"));
    for place in [&input, &output, &secret] {
        fs::create_dir(place).unwrap();
        fs::write(place.join("file"), "text").unwrap();
    }
    std::os::unix::fs::symlink(secret.join("file"), input.join("link")).unwrap();
    let mut rights = Rights::none();
    rights.read.insert(input.clone());
    rights.read.insert(folder.path().join("missing"));
    rights.write.insert(output.clone());
    confined(&rights, || {
        assert_eq!(fs::read_to_string(input.join("file")).unwrap(), "text");
        assert_eq!(fs::read_dir(&input).unwrap().count(), 2);
        assert!(refused(fs::read(secret.join("file"))) && refused(fs::read(input.join("link"))));
        assert!(refused(fs::read_dir(folder.path())));
        assert!(refused(fs::write(input.join("file"), "")) && refused(fs::write(input.join("new"), "")));
        assert!(refused(fs::remove_file(input.join("file"))));
        fs::create_dir_all(output.join("a/b")).unwrap();
        fs::write(output.join("a/new"), "1").unwrap();
        fs::rename(output.join("a/new"), output.join("new")).unwrap_or_else(|e| assert!(version < 2, "{e}"));
        assert!(refused(fs::rename(output.join("file"), input.join("moved"))));
        assert!(refused(fs::hard_link(secret.join("file"), output.join("stolen"))));
        fs::remove_dir_all(output.join("a")).unwrap();
    });
    assert_eq!(fs::read_to_string(secret.join("file")).unwrap(), "text");
    // The rights were those of one thread.
    assert!(fs::read(secret.join("file")).is_ok());
}

#[test]
fn programs_run_where_the_rights_say() {
    if version().is_none() {
        return;
    }
    let system = ["/usr", "/bin", "/lib", "/lib64", "/etc"].map(Into::into);
    let mut rights = Rights::none();
    rights.read.extend(system.clone());
    rights.devices.insert("/dev/null".into());
    // The second file is outside of the rights, which the programs inherit.
    let run =
        || std::process::Command::new("/bin/sh").args(["-c", "cat /etc/passwd && ! cat /proc/self/stat"]).output();
    assert!(refused(confined(&rights, run)));
    rights.run.extend(system);
    let ran = confined(&rights, run).unwrap();
    assert!(ran.status.success(), "{ran:?}");
}

#[test]
fn empty_folders_alone_go_by_the_right_to_remove_folders() {
    if version().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("empty")).unwrap();
    fs::write(folder.path().join("file"), "text").unwrap();
    let mut rights = Rights::none();
    rights.remove_folders.insert(folder.path().to_owned());
    confined(&rights, || {
        fs::remove_dir(folder.path().join("empty")).unwrap();
        assert!(refused(fs::remove_file(folder.path().join("file"))));
        assert!(refused(fs::create_dir(folder.path().join("new"))));
    });
}

#[test]
fn ports_are_connected_where_the_rights_say() {
    if version().is_none_or(|version| version < 4) {
        eprintln!("SKIPPED: Landlock before version 4 does not confine TCP");
        return;
    }
    let (known, other) = (TcpListener::bind("127.0.0.1:0").unwrap(), TcpListener::bind("127.0.0.1:0").unwrap());
    let (known, other) = (known.local_addr().unwrap(), other.local_addr().unwrap());
    let mut rights = Rights::none();
    rights.connect = Some([known.port()].into());
    let connect = |to: std::net::SocketAddr| TcpStream::connect(to);
    assert!(confined(&rights, || !refused(connect(known)) && refused(connect(other))));
    assert!(confined(&rights, || refused(TcpListener::bind("127.0.0.1:0"))));
    rights.connect = None;
    assert!(confined(&rights, || !refused(connect(other)) && refused(TcpListener::bind("127.0.0.1:0"))));
}

#[test]
fn sockets_with_paths_are_free_and_abstract_ones_by_right() {
    if version().is_none_or(|version| version < 6) {
        eprintln!("SKIPPED: Landlock before version 6 does not confine abstract sockets");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("socket");
    let _listening = UnixListener::bind(&path).unwrap();
    let name = format!("sg-confinement-{}", std::process::id());
    let address = SocketAddr::from_abstract_name(name).unwrap();
    let _abstract = UnixListener::bind_addr(&address).unwrap();
    let mut rights = Rights::none();
    let connect = |path: &Path| UnixStream::connect(path);
    confined(&rights, || {
        connect(&path).unwrap();
        assert!(refused(UnixStream::connect_addr(&address)));
    });
    rights.abstract_sockets = true;
    confined(&rights, || UnixStream::connect_addr(&address).unwrap());
}
