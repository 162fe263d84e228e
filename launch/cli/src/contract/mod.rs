//! `contract`: the messages that services send and receive, and their compatibility.

mod buf;
mod check;
mod describe;
mod findings;
mod live;
mod release;
mod structure;

use std::path::PathBuf;

use clap::Subcommand;

use crate::terminal::CommandResult;
use check::CheckArgs;

#[derive(Debug, Subcommand)]
pub(crate) enum ContractCommand {
    /// Show the messages that each service may send and receive
    #[command(after_help = "Example: supergaussian contract describe scene")]
    Describe {
        /// Only this role
        service: Option<String>,
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Check that the contract is compatible with its last release
    #[command(after_help = "Example: supergaussian contract check --against proto/released/v0.1.0.binpb\n\n\
        With --session the processes of a running stack are looked at as well.")]
    Check(CheckArgs),
    /// Save the present contract as a release, for later checks
    #[command(after_help = "Example: supergaussian contract release 0.2.0")]
    Release {
        /// Version of the release, such as 0.2.0
        version: String,
        /// Folder of the schema; by default `proto` here or in a parent folder
        #[arg(long, value_name = "DIR")]
        proto: Option<PathBuf>,
    },
}

pub(crate) async fn run(command: ContractCommand, session: Option<&str>) -> CommandResult {
    match command {
        ContractCommand::Describe { service, json } => describe::describe(service.as_deref(), json),
        ContractCommand::Check(arguments) => check::check(&arguments, session).await,
        ContractCommand::Release { version, proto } => release::release(&version, proto),
    }
}
