//! Enforcement by the kernel.

use std::collections::BTreeSet;
use std::fmt;
use std::path::{Path, PathBuf};

use landlock::{
    ABI, Access, AccessFs, AccessNet, BitFlags, LandlockStatus, NetPort, PathBeneath, PathFd, PathFdError, Ruleset,
    RulesetAttr as _, RulesetCreated, RulesetCreatedAttr as _, RulesetError, RulesetStatus, Scope, make_bitflags,
};

use crate::rights::Rights;

/// The version whose rights on files are refused unless granted. Older kernels know fewer of them.
const FILES: ABI = ABI::V5;

/// The system's error for a link that leads to itself (`ELOOP`).
const LINK_LOOP: i32 = 40;

/// What the running kernel offers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Support {
    /// Landlock of this version.
    Version(u32),
    /// Built into the kernel, but not enabled at its start.
    Disabled,
    /// Not built into the kernel.
    Missing,
}

impl fmt::Display for Support {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Version(version) => write!(f, "Landlock, version {version}"),
            Self::Disabled => f.write_str("Landlock is not enabled; add it to the kernel's parameter `lsm=`"),
            Self::Missing => f.write_str("this kernel has no Landlock; Linux 5.13 or later has it"),
        }
    }
}

/// How far the kernel enforces the rights.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Enforcement {
    /// All of them.
    Full,
    /// Those that the kernel knows; an older kernel knows fewer.
    Partial,
    /// None.
    None,
}

/// Rights could not be enforced.
#[derive(Debug, thiserror::Error)]
pub enum ConfinementError {
    /// A path of the rights cannot be opened.
    #[error("{}: {source}", .path.display())]
    Path {
        /// The path.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The kernel refused the rules.
    #[error("the kernel refused the rules: {0}")]
    Kernel(#[from] RulesetError),
}

/// Confines this thread, and all threads and processes that it starts from now on, to these rights.
///
/// Call it before other threads run: they keep their rights. The thread gives up the right to gain privileges too.
///
/// # Errors
/// [`ConfinementError`] if the kernel has Landlock and refuses the rules. Nothing is confined then.
pub fn confine(rights: &Rights) -> Result<Enforcement, ConfinementError> {
    let mut rules = Ruleset::default().handle_access(AccessFs::from_all(FILES))?;
    rules = match rights.connect {
        Some(_) => rules.handle_access(AccessNet::BindTcp | AccessNet::ConnectTcp)?,
        None => rules.handle_access(AccessNet::BindTcp)?,
    };
    rules = if rights.abstract_sockets {
        rules.scope(Scope::Signal)?
    } else {
        rules.scope(Scope::Signal | Scope::AbstractUnixSocket)?
    };
    let mut rules = rules.create()?;
    let read = make_bitflags!(AccessFs::{ReadFile | ReadDir});
    let change = make_bitflags!(AccessFs::{
        WriteFile | Truncate | MakeReg | MakeDir | RemoveFile | RemoveDir | Refer
    });
    for (paths, access) in [
        (&rights.read, read),
        (&rights.run, read | AccessFs::Execute),
        (&rights.write, read | change),
        (&rights.remove_folders, AccessFs::RemoveDir.into()),
        (&rights.devices, read | AccessFs::WriteFile | AccessFs::IoctlDev),
    ] {
        rules = grant(rules, paths, access)?;
    }
    for port in rights.connect.iter().flatten() {
        rules = rules.add_rule(NetPort::new(*port, AccessNet::ConnectTcp))?;
    }
    Ok(match rules.restrict_self()?.ruleset {
        RulesetStatus::FullyEnforced => Enforcement::Full,
        RulesetStatus::PartiallyEnforced => Enforcement::Partial,
        RulesetStatus::NotEnforced => Enforcement::None,
    })
}

fn grant(
    mut rules: RulesetCreated,
    paths: &BTreeSet<PathBuf>,
    access: BitFlags<AccessFs>,
) -> Result<RulesetCreated, ConfinementError> {
    for path in paths {
        if let Some(opened) = open(path)? {
            rules = rules.add_rule(PathBeneath::new(opened, access))?;
        }
    }
    Ok(rules)
}

/// A path of the rights, unless nothing is there or this user cannot reach it: then it could not be used anyway.
fn open(path: &Path) -> Result<Option<PathFd>, ConfinementError> {
    match PathFd::new(path) {
        Ok(opened) => Ok(Some(opened)),
        Err(PathFdError::OpenCall { source, .. }) => {
            use std::io::ErrorKind::{InvalidFilename, NotADirectory, NotFound, PermissionDenied};
            let unreachable = matches!(source.kind(), NotFound | NotADirectory | PermissionDenied | InvalidFilename);
            if unreachable || source.raw_os_error() == Some(LINK_LOOP) {
                return Ok(None);
            }
            Err(ConfinementError::Path { path: path.to_owned(), source })
        }
        Err(error) => {
            Err(ConfinementError::Path { path: path.to_owned(), source: std::io::Error::other(error.to_string()) })
        }
    }
}

/// What the running kernel offers. Confines nothing.
#[must_use]
pub fn support() -> Support {
    // The status comes with a restriction, so a thread that ends at once is restricted.
    let asked = std::thread::spawn(|| {
        let rules = Ruleset::default().handle_access(AccessFs::Execute).and_then(Ruleset::create);
        rules.and_then(RulesetCreated::restrict_self).map(|status| status.landlock)
    });
    match asked.join() {
        Ok(Ok(LandlockStatus::Available { effective_abi, kernel_abi })) => {
            let newer = kernel_abi.and_then(|version| u32::try_from(version).ok());
            Support::Version(newer.unwrap_or(effective_abi as u32))
        }
        Ok(Ok(LandlockStatus::NotEnabled)) => Support::Disabled,
        _ => Support::Missing,
    }
}
