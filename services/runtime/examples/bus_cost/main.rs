//! Cost of the runtime over plain zenoh, gRPC and a unix socket, in one run:
//!
//! ```text
//! cargo run --release --workspace --example bus_cost            # all of it, about a minute
//! cargo run --release --workspace --example bus_cost -- --rounds 3
//! ```
//!
//! Two processes exchange protobuf messages: an echo of one size, and messages in one direction. The four transports
//! alternate within every round, so that other load on the machine affects all of them.

#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
    clippy::panic,
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a bench prints, and ends where something fails"
)]

mod bare_bus;
mod grpc;
mod ours;
mod socket;

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use clap::Parser;
use sg_proto::{render, scene};
use sg_runtime::bus::Bus;
use sg_runtime::process::block_on;

/// Sizes of the echo, bytes of text in the message.
const SIZES: [(usize, &str); 3] = [(100, "100 B"), (10_000, "10 kB"), (1_000_000, "1 MB")];
/// Duration of the one-way test.
const SENDING: Duration = Duration::from_millis(500);

#[derive(Parser)]
struct Arguments {
    /// Rounds; each takes about two seconds
    #[arg(long, default_value_t = 20)]
    rounds: usize,
    /// Internal: transport that this process serves
    #[arg(long, hide = true)]
    serve: Option<String>,
    /// Internal
    #[arg(long, hide = true)]
    folder: Option<PathBuf>,
}

/// A transport between two processes.
trait Link {
    /// Sends a text and gets it back.
    async fn echo(&mut self, text: &str);
    /// Sends small messages for a while. Returns the number that arrived.
    async fn flood(&mut self, time: Duration) -> u64;
}

/// Times and counts of one transport.
#[derive(Default)]
struct Samples {
    echo: [Vec<f64>; SIZES.len()],
    per_second: Vec<f64>,
}

impl Samples {
    async fn round(&mut self, link: &mut impl Link) {
        for (times, (size, _)) in self.echo.iter_mut().zip(SIZES) {
            let text = "x".repeat(size);
            let count = if size > 100_000 { 20 } else { 200 };
            for i in 0..count {
                let begun = Instant::now();
                link.echo(&text).await;
                // The first requests of a round have cold caches.
                if i >= count / 10 {
                    times.push(begun.elapsed().as_secs_f64() * 1e6);
                }
            }
        }
        let begun = Instant::now();
        let arrived = link.flood(SENDING).await;
        self.per_second.push(arrived as f64 / begun.elapsed().as_secs_f64());
    }
}

fn quantile(values: &[f64], q: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[((sorted.len() - 1) as f64 * q).round() as usize]
}

/// The message of the echo.
fn command(text: &str) -> scene::Command {
    scene::Command { id: text.to_owned(), ..Default::default() }
}

/// The message of the one-way test.
fn small() -> render::Frame {
    render::Frame { png_path: "x".repeat(100), ..Default::default() }
}

fn main() {
    let arguments = Arguments::parse();
    if let (Some(kind), Some(folder)) = (&arguments.serve, &arguments.folder) {
        block_on(serve(kind, folder)).unwrap();
        return;
    }
    block_on(measure(arguments.rounds)).unwrap();
}

async fn serve(kind: &str, folder: &Path) {
    match kind {
        "router" => {
            let _router = Bus::open_router("bench", "supervisor", &folder.join("bus.sock"), None).await.unwrap();
            std::future::pending::<()>().await;
        }
        "ours" => ours::serve(folder).await,
        "bare" => bare_bus::serve(folder).await,
        "grpc" => grpc::serve(folder).await,
        "socket" => socket::serve(folder).await,
        other => panic!("nothing serves `{other}`"),
    }
}

/// A child process of the benchmark, killed at its end.
struct Served(Child);

impl Served {
    fn start(kind: &str, folder: &Path) -> Self {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["--serve", kind, "--folder"]).arg(folder).stdin(Stdio::null());
        Self(command.spawn().unwrap())
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Waits for a socket to appear.
async fn appears(path: &Path) {
    let begun = Instant::now();
    while !path.exists() {
        assert!(begun.elapsed() < Duration::from_secs(20), "{} did not appear", path.display());
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}

async fn measure(rounds: usize) {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let _router = Served::start("router", folder);
    appears(&folder.join("bus.sock")).await;
    let _served: Vec<_> = ["ours", "bare", "grpc", "socket"].map(|kind| Served::start(kind, folder)).into();
    let mut ours = ours::Ours::connect(folder).await;
    let mut bare = bare_bus::BareBus::connect(folder).await;
    let mut grpc = grpc::Grpc::connect(folder).await;
    let mut socket = socket::Socket::connect(folder).await;
    let mut samples: [Samples; 4] = Default::default();
    for _ in 0..rounds {
        let [a, b, c, d] = &mut samples;
        a.round(&mut ours).await;
        b.round(&mut bare).await;
        c.round(&mut grpc).await;
        d.round(&mut socket).await;
    }
    let names = ["our runtime", "bare zenoh, same link", "gRPC (tonic), unix socket", "bare unix socket"];
    let sizes: Vec<_> = SIZES.iter().map(|(_, name)| format!("{name}: p50 / p99 µs (× bare zenoh)")).collect();
    println!("| {rounds} rounds | {} | one way 100 B, thousand/s |", sizes.join(" | "));
    println!("| --- | --- | --- | --- | --- |");
    for (name, of) in names.iter().zip(&samples) {
        let cells: Vec<_> = of
            .echo
            .iter()
            .zip(&samples[1].echo)
            .map(|(times, bare)| {
                let ratio = quantile(times, 0.5) / quantile(bare, 0.5);
                format!("{:.0} / {:.0} (×{ratio:.2})", quantile(times, 0.5), quantile(times, 0.99))
            })
            .collect();
        println!("| {name} | {} | {:.0} |", cells.join(" | "), quantile(&of.per_second, 0.5) / 1e3);
    }
}
