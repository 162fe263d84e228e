//! The runtime of every process: bus, actors, lifecycle, health, telemetry.
//!
//! Only this package names zenoh. A service uses these modules:
//!
//! - [`bus::Bus`]: requests, streams, retained values, liveliness.
//! - [`actor::Actor`]: a bounded mailbox, typed messages, an observable state.
//! - [`process::Host`]: one lifecycle for every process.
//! - [`progress::Progress`]: signs of progress of long work.
//! - [`scene_replica::SceneReplica`]: a copy of the scene that stays current.
//! - [`fault::Fault`]: a typed error of a request.
//!
//! # Example
//!
//! A router, a service that answers one key, and a client, in one process:
//!
//! ```
//! use sg_proto::keys::{self, role};
//! use sg_proto::scene::{Command, CommandResult};
//! use sg_runtime::bus::{Bus, endpoint_of};
//! use sg_runtime::context::Context;
//! use sg_runtime::process::block_on;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! block_on(async {
//!     let folder = tempfile::tempdir()?;
//!     let socket = folder.path().join("bus.sock");
//!     let endpoint = endpoint_of(&socket);
//!     let _router = Bus::open_router("example", role::SUPERVISOR, &socket, None).await?;
//!
//!     let scene = Bus::connect("example", role::SCENE, &endpoint).await?;
//!     let apply = |command: Command, _context| async move { Ok(CommandResult { id: command.id, ..Default::default() }) };
//!     let _server = scene.serve(&keys::SCENE_APPLY, 8, apply).await?;
//!
//!     let client = Bus::connect("example", role::CLI, &endpoint).await?;
//!     let command = Command { id: "first".to_owned(), ..Default::default() };
//!     let result = client.ask(&keys::SCENE_APPLY, &command, &Context::root()).await?;
//!     assert_eq!(result.id, "first");
//!     Ok(())
//! })?
//! # }
//! ```

pub mod actor;
pub mod blobs;
pub mod bus;
pub mod context;
pub mod fault;
pub mod metrics;
pub mod process;
pub mod progress;
mod scene_feed;
mod scene_files;
pub mod scene_replica;
pub mod session;
pub mod telemetry;
pub mod trace;
pub mod wire;
