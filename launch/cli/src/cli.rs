//! The command line.

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use sg_runtime::process::{EXIT_FAILED, parse_words};
use sg_stack::{descendants, spawn};

use crate::terminal::{self, CommandResult, Failure};
use crate::{
    capture, certificates, chaos, contract, demo, doctor, join, mcp, metrics, open, projects, say, subcommands,
    supervisor_client, swap, up, watch,
};

/// Edit scientific volumes as 3D Gaussians: start the services, watch them, talk to them
#[derive(Debug, Parser)]
#[command(name = "supergaussian", version, disable_help_subcommand = true, after_help = subcommands::HELP.as_str())]
struct Cli {
    /// Name of the session; by default the only running one
    #[arg(long, global = true, value_name = "NAME")]
    session: Option<String>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Play the demo: make or load a scene, start the full stack, save pictures and a transcript
    #[command(after_help = "Example: supergaussian demo bonsai_256x256x256_uint8.raw.zst --out bonsai-demo")]
    Demo(demo::DemoArgs),
    /// Open a scene or volume in its own window and session
    ///
    /// A volume is turned into Gaussians first. Edits are kept in a project of the scene (`supergaussian projects`) and found
    /// again at the next start. A file dropped on a window opens the same way.
    #[command(after_help = "Example: supergaussian open skull/scene.toml\n         supergaussian open ct/slices")]
    Open(open::OpenArgs),
    /// List, open and delete the projects that keep the edits of scenes
    ///
    /// They lie in the user's data folder, one for each scene. A launch file can name another project file.
    #[command(after_help = "Example: supergaussian projects")]
    Projects(projects::ProjectsArgs),
    /// Start a launch file and supervise its services; reload it if it runs already
    ///
    /// A reload applies the difference. Added services start, and removed services stop. A changed executable,
    /// parameter or environment swaps the service. All other changes take effect in place. The file must be the one
    /// that started the stack, or contain the session's name (`name = "…"`).
    #[command(
        after_help = "Example: supergaussian up launch/headless.toml --set service.scene.params.scene=skull/scene.toml"
    )]
    Up(up::UpArgs),
    /// Stop a running stack
    #[command(after_help = "Example: supergaussian down --session headless")]
    Down,
    /// List the services and their states
    #[command(after_help = "Example: supergaussian ps --json")]
    Ps {
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Show the logs of services
    #[command(after_help = "Example: supergaussian logs -f scene")]
    Logs {
        /// Follow until Ctrl-C or the end of the stack
        #[arg(short, long)]
        follow: bool,
        /// Only this service
        service: Option<String>,
    },
    /// Restart one service
    #[command(after_help = "Example: supergaussian restart selection")]
    Restart {
        /// Name in the launch file
        service: String,
    },
    /// Replace the executable of one running service
    ///
    /// The candidate loads beside the service and proves that it speaks the contract of the role. It takes over when
    /// the old process has finished its accepted work. If the candidate fails, the service continues unchanged.
    #[command(
        after_help = "Example: supergaussian swap agent-intent ./my-intent-agent --params '{\"language\": \"en\"}'"
    )]
    Swap(swap::SwapArgs),
    /// Run services on this machine for a stack of another machine
    ///
    /// The stack's launch file has a table for this machine (`[node.gpu1]`), an endpoint (`[bus]`) and services with
    /// `on = "gpu1"`. Executables are looked up beside this program, then on PATH. The command runs until Ctrl-C and
    /// survives restarts of the stack. If the stack does not answer for the lease, its services here end.
    #[command(
        after_help = "Example: supergaussian join tls/lab.example.org:7447 --session headless --name gpu1 --authority authority.pem --certificate gpu1.pem --key gpu1-key.pem"
    )]
    Join(join::JoinArgs),
    /// Create TLS certificates for machines that share a stack
    #[command(
        after_help = "Example: supergaussian certificates tls --home lab.example.org,10.0.0.1 --node gpu1 --node gpu2"
    )]
    Certificates(certificates::CertificatesArgs),
    /// Check this machine and this installation: executables, folders, graphics device, display, headset
    #[command(after_help = "Example: supergaussian doctor launch/desktop.toml")]
    Doctor(doctor::DoctorArgs),
    /// Check a launch file
    #[command(after_help = "Example: supergaussian check launch/headless.toml")]
    Check(up::FileArgs),
    /// Show the start order of a launch file
    #[command(after_help = "Example: supergaussian graph launch/headless.toml --dot | dot -Tsvg > stack.svg")]
    Graph {
        #[command(flatten)]
        file: up::FileArgs,
        /// Print Graphviz DOT
        #[arg(long)]
        dot: bool,
    },
    /// Send an utterance to the running stack
    #[command(after_help = "Example: supergaussian say \"make the sac red and fade everything else to 20 percent\"")]
    Say {
        /// The utterance
        text: String,
        /// Print JSON
        #[arg(long)]
        json: bool,
        /// Seconds to wait for the answer
        #[arg(long, default_value_t = 30.0, value_name = "SECONDS")]
        timeout: f64,
    },
    /// Save one picture of the running stack's scene
    #[command(after_help = "Example: supergaussian capture selection.png --highlight --session headless")]
    Capture(capture::CaptureArgs),
    /// Serve the commands and the picture of the running stack to an MCP client
    ///
    /// The client is a program with a language model. It gets the tools `command`, `say`, `scene`, `screenshot`, `undo` and
    /// `redo` on standard input and output, and no way to files, network or shell. The stack may start and restart meanwhile.
    #[command(after_help = mcp::HELP)]
    Mcp,
    /// Print every conversation and scene message until Ctrl-C
    #[command(after_help = "Example: supergaussian watch --session headless")]
    Watch {
        /// Print one JSON object per line
        #[arg(long)]
        json: bool,
        /// Include the health messages of every second
        #[arg(long)]
        all: bool,
    },
    /// Play a session with random faults and compare the result with a session without faults
    #[command(after_help = "Example: supergaussian chaos --faults 50 --seed 1 --out /tmp/chaos")]
    Chaos(chaos::ChaosArgs),
    /// Print the metrics of all processes in Prometheus' text format
    #[command(after_help = "Example: supergaussian metrics --listen 127.0.0.1:9464")]
    Metrics {
        /// Serve the metrics over HTTP under /metrics until Ctrl-C; loopback addresses only
        #[arg(long, value_name = "ADDRESS")]
        listen: Option<std::net::SocketAddr>,
    },
    /// Describe, check and release the contract between services
    #[command(subcommand)]
    Contract(contract::ContractCommand),
    #[command(external_subcommand)]
    Other(Vec<OsString>),
}

pub(crate) fn main() -> ExitCode {
    let mut arguments = std::env::args_os().skip(1).peekable();
    if arguments.next_if(|a| a == spawn::BECOME_CHILD).is_some() {
        terminal::print_status(&spawn::become_child(arguments).to_string());
        return ExitCode::from(EXIT_FAILED);
    }
    if arguments.next_if(|a| a == descendants::REAP_AFTER).is_some() {
        spawn::close_inherited();
        descendants::reap_after(arguments);
        return ExitCode::SUCCESS;
    }
    if arguments.next_if(|a| a == spawn::DETACHED).is_some() {
        spawn::close_inherited();
    }
    let cli: Cli = parse_words(std::iter::once(OsString::from("supergaussian")).chain(arguments));
    sg_runtime::telemetry::init_command();
    terminal::exit_code(run(cli))
}

fn run(cli: Cli) -> CommandResult {
    let session = cli.session.as_deref();
    match cli.command {
        Command::Demo(arguments) => wait(demo::demo(arguments, session)),
        Command::Open(arguments) => wait(open::open(&arguments, session)),
        Command::Projects(arguments) => wait(projects::projects(&arguments, session)),
        Command::Up(arguments) => wait(up::up(&arguments, session)),
        Command::Down => wait(supervisor_client::down(session)),
        Command::Ps { json } => wait(supervisor_client::ps(session, json)),
        Command::Logs { follow, service } => supervisor_client::logs(session, service.as_deref(), follow),
        Command::Restart { service } => wait(supervisor_client::restart(session, &service)),
        Command::Swap(arguments) => wait(swap::swap(session, &arguments)),
        Command::Join(arguments) => wait(join::join(session, &arguments)),
        Command::Certificates(arguments) => certificates::certificates(&arguments),
        Command::Doctor(arguments) => doctor::doctor(&arguments),
        Command::Check(file) => up::check(&file),
        Command::Graph { file, dot } => up::graph(&file, dot),
        Command::Say { text, json, timeout } => wait(say::say(session, text, json, timeout)),
        Command::Capture(arguments) => wait(capture::capture(session, &arguments)),
        Command::Mcp => wait(mcp::serve(session)),
        Command::Watch { json, all } => wait(watch::watch(session, json, all)),
        Command::Chaos(arguments) => wait(chaos::chaos(arguments, session)),
        Command::Metrics { listen } => wait(metrics::metrics(session, listen)),
        Command::Contract(command) => wait(contract::run(command, session)),
        Command::Other(words) => subcommands::run(&words, &commands()),
    }
}

/// The bus needs a multi-threaded runtime. The future itself stays on this thread (see [`spawn::tied_to_parent`]).
fn wait(future: impl Future<Output = CommandResult>) -> CommandResult {
    match sg_runtime::process::block_on(future) {
        Ok(done) => done,
        Err(error) => Err(Failure::Work(format!("the async runtime could not be started: {error}"))),
    }
}

/// Names of the built-in commands.
fn commands() -> Vec<String> {
    use clap::CommandFactory;
    Cli::command().get_subcommands().map(|c| c.get_name().to_owned()).collect()
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_command_line_is_well_formed() {
        use clap::CommandFactory;
        super::Cli::command().debug_assert();
    }

    #[test]
    fn every_command_shows_an_example() {
        use clap::CommandFactory;
        fn visit(command: &clap::Command) {
            for inner in command.get_subcommands() {
                let shown = inner.get_after_help().map(ToString::to_string).unwrap_or_default();
                assert!(inner.has_subcommands() || shown.contains("Example: supergaussian "), "{}", inner.get_name());
                visit(inner);
            }
        }
        visit(&super::Cli::command());
    }
}
