//! The command line.

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use sg_runtime::process::EXIT_FAILED;
use sg_stack::spawn;

use crate::terminal::{self, CommandResult, Failure};
use crate::{
    capture, certificates, chaos, contract, demo, join, metrics, open, say, subcommands, supervisor_client, swap, up,
    watch,
};

/// Edit volumes by talking to them: starts the services, watches them, speaks to them.
#[derive(Debug, Parser)]
#[command(name = "supergaussian", version, disable_help_subcommand = true, after_help = subcommands::HELP.as_str())]
struct Cli {
    /// Session to speak to, or to start; by default the only one that runs
    #[arg(long, global = true, value_name = "NAME")]
    session: Option<String>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Make or load a scene, start the full stack, play a script, leave pictures and a transcript
    #[command(after_help = "Example: supergaussian demo bonsai_256x256x256_uint8.raw.zst --out bonsai-demo")]
    Demo(demo::DemoArgs),
    /// Open a scene or volume in a window of its own, in a session of its own, until the window is closed
    ///
    /// Of a volume Gaussians are made first. What is edited is kept in the session's folder and found again when the same
    /// file is opened the next time. A file that is dropped on a window is opened so.
    #[command(after_help = "Example: supergaussian open skull/scene.toml")]
    Open(open::OpenArgs),
    /// Start every service of a launch file and watch over them until Ctrl-C; if it runs already, read the file again
    ///
    /// Of a stack that runs the difference is applied: services that were added start, removed ones stop, one with another
    /// executable, other parameters or another environment is swapped, and whatever else changed takes effect in place. The
    /// file must be the one that the stack was started from, or name the session itself (`name = "…"`).
    #[command(
        after_help = "Example: supergaussian up launch/headless.toml --set service.scene.params.scene=skull/scene.toml"
    )]
    Up(up::UpArgs),
    /// Stop a running stack
    #[command(after_help = "Example: supergaussian down --session headless")]
    Down,
    /// Show how the services are
    #[command(after_help = "Example: supergaussian ps --json")]
    Ps {
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Show what services have logged
    #[command(after_help = "Example: supergaussian logs -f scene")]
    Logs {
        /// Go on until Ctrl-C or the end of the stack
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
    /// Replace one service by another executable while it serves
    ///
    /// The newcomer loads beside the service, has to prove that it speaks the contract of the role, and takes over when the
    /// old process has finished what it had accepted. If it fails, the service goes on as before.
    #[command(
        after_help = "Example: supergaussian swap agent-intent ./my-intent-agent --params '{\"language\": \"en\"}'"
    )]
    Swap(swap::SwapArgs),
    /// Run services on this machine for a stack of another one
    ///
    /// The stack's launch file names this machine (`[node.gpu1]`), says where it listens (`[bus]`) and what runs here
    /// (`on = "gpu1"`). Executables are looked up beside this program, then on PATH. Goes on until Ctrl-C, over restarts of
    /// the stack; what runs here ends when the stack is away for longer than its lease.
    #[command(
        after_help = "Example: supergaussian join tls/lab.example.org:7447 --session headless --name gpu1 --authority authority.pem --certificate gpu1.pem --key gpu1-key.pem"
    )]
    Join(join::JoinArgs),
    /// Make the certificates by which machines that share a stack know each other
    #[command(
        after_help = "Example: supergaussian certificates tls --home lab.example.org,10.0.0.1 --node gpu1 --node gpu2"
    )]
    Certificates(certificates::CertificatesArgs),
    /// Check a launch file
    #[command(after_help = "Example: supergaussian check launch/headless.toml")]
    Check(up::FileArgs),
    /// Show what a launch file starts after what
    #[command(after_help = "Example: supergaussian graph launch/headless.toml --dot | dot -Tsvg > stack.svg")]
    Graph {
        #[command(flatten)]
        file: up::FileArgs,
        /// Print Graphviz
        #[arg(long)]
        dot: bool,
    },
    /// Say something to the running stack
    #[command(after_help = "Example: supergaussian say \"make the sac red and fade everything else to 20 percent\"")]
    Say {
        /// The words
        text: String,
        /// Print JSON
        #[arg(long)]
        json: bool,
        /// Seconds to wait for the answer
        #[arg(long, default_value_t = 30.0, value_name = "SECONDS")]
        timeout: f64,
    },
    /// Take one picture of the scene of the running stack
    #[command(after_help = "Example: supergaussian capture selection.png --highlight --session headless")]
    Capture(capture::CaptureArgs),
    /// Show every message of the conversation and of the scene, decoded, until Ctrl-C
    #[command(after_help = "Example: supergaussian watch --session headless")]
    Watch {
        /// One JSON object a line
        #[arg(long)]
        json: bool,
        /// Also the signs of life that every service gives each second
        #[arg(long)]
        all: bool,
    },
    /// Play a session under random faults and compare its end with that of the same session in peace
    #[command(after_help = "Example: supergaussian chaos --faults 50 --seed 1 --out /tmp/chaos")]
    Chaos(chaos::ChaosArgs),
    /// Show what all processes have counted, in Prometheus' text format
    #[command(after_help = "Example: supergaussian metrics --listen 127.0.0.1:9464")]
    Metrics {
        /// Serve it over HTTP under /metrics until Ctrl-C; this machine's own addresses only
        #[arg(long, value_name = "ADDRESS")]
        listen: Option<std::net::SocketAddr>,
    },
    /// Show, check and keep the contract between services
    #[command(subcommand)]
    Contract(contract::ContractCommand),
    #[command(external_subcommand)]
    Other(Vec<OsString>),
}

pub(crate) fn main() -> ExitCode {
    let mut arguments = std::env::args_os().skip(1).peekable();
    if arguments.next_if(|a| a == spawn::BECOME_CHILD).is_some() {
        terminal::print_status(&spawn::become_child(arguments));
        return ExitCode::from(EXIT_FAILED);
    }
    if arguments.next_if(|a| a == spawn::DETACHED).is_some() {
        spawn::close_inherited();
    }
    let cli = Cli::parse_from(std::iter::once(OsString::from("supergaussian")).chain(arguments));
    sg_runtime::telemetry::init_command();
    terminal::exit_code(run(cli))
}

fn run(cli: Cli) -> CommandResult {
    let session = cli.session.as_deref();
    match cli.command {
        Command::Demo(arguments) => wait(demo::demo(arguments, session)),
        Command::Open(arguments) => wait(open::open(&arguments, session)),
        Command::Up(arguments) => wait(up::up(&arguments, session)),
        Command::Down => wait(supervisor_client::down(session)),
        Command::Ps { json } => wait(supervisor_client::ps(session, json)),
        Command::Logs { follow, service } => supervisor_client::logs(session, service.as_deref(), follow),
        Command::Restart { service } => wait(supervisor_client::restart(session, &service)),
        Command::Swap(arguments) => wait(swap::swap(session, &arguments)),
        Command::Join(arguments) => wait(join::join(session, &arguments)),
        Command::Certificates(arguments) => certificates::certificates(&arguments),
        Command::Check(file) => up::check(&file),
        Command::Graph { file, dot } => up::graph(&file, dot),
        Command::Say { text, json, timeout } => wait(say::say(session, text, json, timeout)),
        Command::Capture(arguments) => wait(capture::capture(session, &arguments)),
        Command::Watch { json, all } => wait(watch::watch(session, json, all)),
        Command::Chaos(arguments) => wait(chaos::chaos(arguments, session)),
        Command::Metrics { listen } => wait(metrics::metrics(session, listen)),
        Command::Contract(command) => wait(contract::run(command, session)),
        Command::Other(words) => subcommands::run(&words, &commands()),
    }
}

/// The bus needs a runtime with several threads; the future itself stays on this one (see [`spawn::start`]).
fn wait(future: impl Future<Output = CommandResult>) -> CommandResult {
    match sg_runtime::process::block_on(future) {
        Ok(done) => done,
        Err(error) => Err(Failure::Work(format!("the async runtime could not be started: {error}"))),
    }
}

/// Names of the commands that this executable carries out itself.
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
