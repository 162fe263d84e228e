//! Revoked and rotated certificates, over TLS on the loopback device.

use std::net::TcpListener;
use std::process::{Child, Stdio};
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use crate::sandbox::{Sandbox, TIMEOUT, pid};

/// A running `supergaussian join`.
struct Join(Child);

impl Join {
    fn start(sandbox: &Sandbox, port: u16, node: &str, files: &str) -> Self {
        let tls = sandbox.path().join("tls");
        let pem = |name: &str| tls.join(name).display().to_string();
        let mut command =
            sandbox.command(&["join", &format!("tls/127.0.0.1:{port}"), "--session", "f", "--name", node]);
        command.args(["--authority", &pem("authority.pem")]);
        command.args(["--certificate", &pem(&format!("{files}.pem")), "--key", &pem(&format!("{files}-key.pem"))]);
        let path = std::env::join_paths(
            std::iter::once(sandbox.path().to_owned())
                .chain(std::env::split_paths(command.get_envs().find(|(n, _)| *n == "PATH").unwrap().1.unwrap())),
        );
        command.env("PATH", path.unwrap()).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        Self(command.spawn().unwrap())
    }

    fn end(mut self) {
        kill(Pid::from_raw(self.0.id().cast_signed()), Signal::SIGTERM).unwrap();
        self.0.wait().unwrap();
    }
}

impl Drop for Join {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn a_revoked_node_is_refused_and_a_rotated_certificate_works() {
    let sandbox = Sandbox::new();
    let tls = sandbox.path().join("tls").display().to_string();
    let certificates = |more: &[&str]| {
        let (status, _, errors) = sandbox.run(&[&["certificates", &tls], more].concat());
        assert_eq!(status, 0, "{errors}");
    };
    certificates(&["--home", "127.0.0.1", "--node", "gpu1,gpu2"]);
    // The port is free at this moment; the stack takes it at once.
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let text = format!(
        r#"
schema = 1
[bus]
listen = "tls/127.0.0.1:{port}"
authority = "tls/authority.pem"
certificate = "tls/home.pem"
key = "tls/home-key.pem"
[node.gpu1]
lease = 2
[node.gpu2]
lease = 2
[service.one]
exec = "fixture"
on = "gpu1"
[service.two]
exec = "fixture"
restart = "always"
on = "gpu2"
[service.home]
exec = "./fixture"
"#
    );
    let file = sandbox.file("f.toml", &text);
    let file = file.to_str().unwrap();
    let mut up = sandbox.up(&[file]);
    sandbox.ready("f", "home");
    let revoked = Join::start(&sandbox, port, "gpu1", "gpu1");
    let other = Join::start(&sandbox, port, "gpu2", "gpu2");
    let (one, two) = (sandbox.ready("f", "one"), sandbox.ready("f", "two"));

    certificates(&["--revoke", "gpu1"]);
    // The list alone changes nothing in a running stack; the command says so.
    assert_eq!(sandbox.ready("f", "one")["pid"], one["pid"]);
    // The command follows all services to their readiness, which one of them does not reach any more.
    let mut again = sandbox.command(&["up", file]);
    let mut again = again.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let waits = |s: &serde_json::Value| s["state"] == "WAITING" && s["reason"].as_str().unwrap_or("").contains("gpu1");
    sandbox.wait("f", "one", waits);
    assert!(up.errors().contains("node gpu1: its certificate is revoked"), "{}", up.errors());
    again.kill().unwrap();
    again.wait().unwrap();
    // Its machine, which hears nothing more, ends the service after its lease.
    sandbox.gone(pid(&one));
    std::thread::sleep(Duration::from_secs(3));
    sandbox.wait("f", "one", waits);
    let after = sandbox.ready("f", "two");
    assert_eq!((&after["pid"], &after["restarts"]), (&two["pid"], &two["restarts"]), "another node goes on");
    revoked.end();
    let _again = Join::start(&sandbox, port, "gpu1", "gpu1");
    std::thread::sleep(Duration::from_secs(3));
    sandbox.wait("f", "one", waits);

    // A new key takes over from the old one, without a change of the stack.
    certificates(&["--node", "gpu2", "--new-key"]);
    other.end();
    let _rotated = Join::start(&sandbox, port, "gpu2", "gpu2.2");
    let rotated = sandbox.wait("f", "two", |s| s["state"] == "READY" && s["pid"] != two["pid"]);
    assert_ne!(pid(&rotated), pid(&two));
    up.signal(Signal::SIGTERM);
    assert_eq!(up.end().0, 0, "within {TIMEOUT:?}");

    // So it is from the start.
    let _up = sandbox.up(&[file]);
    sandbox.wait("f", "two", |s| s["state"] == "READY");
    sandbox.wait("f", "one", waits);
}
