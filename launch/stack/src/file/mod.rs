//! The launch-file language.
//!
//! ```toml
//! schema = 1
//! name = "demo"                       # session; by default the file's name
//!
//! [defaults]                          # any key of a service that says how it is watched
//! stop = 3
//!
//! [service.scene]
//! exec = "supergaussian-scene"        # beside the launcher, else on PATH; with a slash: from the file's folder
//! role = "scene"                      # by default the service's name
//! params = { scene = "skull.ply" }    # the service's own parameters
//! after = { other = "ready" }         # start order
//! restart = "always"                  # always | on-failure | never
//! backoff = { initial_ms = 100, max_ms = 5000 }
//! intensity = { restarts = 5, within_s = 30 }
//! ready = 60                          # seconds from start to readiness
//! liveness = 5                        # seconds of silence after which a ready service counts as hung
//! stop = 5                            # seconds between the request to stop and the kill
//! critical = true                     # when it ends for good, failed or done, the stack stops
//! memory_mib = 4096                   # resident memory above which it is restarted, as after a failure; by default none
//! env = { SUPERGAUSSIAN_LOG = "debug" }
//! on = "gpu1"                         # the machine it runs on; by default the launcher's own
//!
//! [bus]                               # other machines: only where this table is, and only with certificates of both sides
//! listen = "tls/0.0.0.0:7447"
//! authority = "tls/authority.pem"     # from the file's folder; `supergaussian certificates` makes them
//! certificate = "tls/home.pem"
//! key = "tls/home-key.pem"
//!
//! [node.gpu1]                         # a machine that may join, known by its certificate: `supergaussian join`
//! lease = 5                           # seconds without word from it, or to it, after which what it runs is over
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
pub use model::{LaunchFile, ListenSettings, Node, Policy, Restart, Service, Start, UnknownService};
pub use read::{Source, read};
