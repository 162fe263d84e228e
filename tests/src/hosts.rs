//! Hosts in network namespaces of their own, each joined to this machine by a cable and to nothing else.

use std::net::Ipv4Addr;
use std::path::Path;
use std::process::Command;

use crate::said;

/// A host; gone with all its addresses when dropped. Processes on it are not.
#[derive(Debug)]
pub struct Host {
    namespace: String,
    /// This machine's end of the cable.
    cable: String,
    /// Its address.
    pub address: Ipv4Addr,
    /// This machine's address on its cable: the only one that it reaches.
    pub gateway: Ipv4Addr,
}

impl Host {
    /// Two of them.
    ///
    /// # Errors
    /// A line that names the failed action.
    pub fn two() -> Result<[Self; 2], String> {
        Ok([Self::plug("a", 1)?, Self::plug("b", 2)?])
    }

    fn plug(letter: &str, number: u8) -> Result<Self, String> {
        let id = std::process::id();
        let host = Self {
            namespace: format!("sg-{id}-{letter}"),
            cable: format!("sg{id}{letter}"),
            // Of the block that is set aside for benchmarks of networks (RFC 2544).
            address: Ipv4Addr::new(198, 18, number, 2),
            gateway: Ipv4Addr::new(198, 18, number, 1),
        };
        let Self { namespace, cable, address, gateway } = &host;
        let far = "eth0";
        for line in [
            format!("netns add {namespace}"),
            format!("link add {cable} type veth peer name {far} netns {namespace}"),
            format!("addr add {gateway}/24 dev {cable}"),
            format!("link set {cable} up"),
            format!("-n {namespace} addr add {address}/24 dev {far}"),
            format!("-n {namespace} link set {far} up"),
            format!("-n {namespace} link set lo up"),
        ] {
            ip(&line)?;
        }
        Ok(host)
    }

    /// A command to be run on this host. Each of `hidden` is an empty folder there.
    #[must_use]
    pub fn on(&self, command: &Command, hidden: &[&Path]) -> Command {
        let mut there = Command::new("ip");
        there.args(["netns", "exec", self.namespace.as_str(), "sh", "-c"]);
        // `ip netns exec` gives it mounts of its own, so folders hidden there are hidden there alone.
        let hide: String = hidden.iter().map(|p| format!("mount -t tmpfs none '{}' && ", p.display())).collect();
        there.arg(format!("{hide}exec \"$0\" \"$@\"")).arg(command.get_program()).args(command.get_args());
        for (name, value) in command.get_envs() {
            match value {
                Some(value) => there.env(name, value),
                None => there.env_remove(name),
            };
        }
        there
    }

    /// Name of its network namespace.
    #[must_use]
    pub fn namespace(&self) -> &str {
        &self.namespace
    }

    /// Whether a process is on this host.
    #[must_use]
    pub fn runs(&self, pid: u32) -> bool {
        let output = Command::new("ip").args(["netns", "identify", &pid.to_string()]).output();
        output.is_ok_and(|o| String::from_utf8_lossy(&o.stdout).trim() == self.namespace)
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        // It may never have been made whole.
        let _ = ip(&format!("link del {}", self.cable));
        let _ = ip(&format!("netns del {}", self.namespace));
    }
}

fn ip(line: &str) -> Result<(), String> {
    let output = Command::new("ip").args(line.split(' ')).output();
    let output = output.map_err(|e| format!("`ip` of iproute2 cannot be run: {e}"))?;
    if output.status.success() { Ok(()) } else { Err(format!("`ip {line}`: {}", said(&output).trim())) }
}
