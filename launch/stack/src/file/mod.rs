//! The launch-file language.
//!
//! ```toml
//! schema = 1
//! name = "demo"                       # session; by default the file's name
//!
//! [defaults]                          # policy keys for every service
//! stop = 3
//!
//! [service.scene]
//! exec = "supergaussian-scene"        # beside the launcher, else on PATH; with a slash: relative to the file
//! role = "scene"                      # by default the service's name
//! params = { scene = "skull.ply" }    # the service's own parameters
//! after = { other = "ready" }         # start order
//! restart = "always"                  # always | on-failure | never
//! backoff = { initial_ms = 100, max_ms = 5000 }
//! intensity = { restarts = 5, within_s = 30 }
//! ready = 60                          # longest time from start to readiness, or without progress before it, seconds
//! liveness = 5                        # silence after which a ready service counts as hung, seconds
//! progress = 300                      # work without progress after which it counts as hung too, seconds
//! stop = 5                            # time between SIGTERM and SIGKILL, seconds
//! critical = true                     # the stack stops when this service ends for good
//! memory_mib = 4096                   # resident memory that triggers a restart; by default no limit
//! env = { SUPERGAUSSIAN_LOG = "debug" }
//! on = "gpu1"                         # the node it runs on; by default the launcher's machine
//! read = ["../models"]                # what it may read and run beyond its role's needs; relative to the file
//! write = ["../results"]              # what it may change beyond them
//! confined = true                     # false: it may do what its user may
//!
//! [bus]                               # for other machines only; both sides need certificates
//! listen = "tls/0.0.0.0:7447"
//! authority = "tls/authority.pem"     # relative to the file; made by `supergaussian certificates`
//! certificate = "tls/home.pem"
//! key = "tls/home-key.pem"
//!
//! [node.gpu1]                         # a machine that may join (`supergaussian join`), known by its certificate
//! lease = 5                           # silence after which its processes count as ended, seconds
//! ```

mod executables;
mod load;
mod model;
mod names;
mod nodes;
mod order;
mod read;

pub use executables::{ExecutableError, ExecutableSearch};
pub use load::{LoadError, load};
pub use model::{Confinement, LaunchFile, ListenSettings, Node, Policy, Restart, Service, Start, UnknownService};
pub use read::{Source, read};
