//! Errors of a headset session.

use openxr::sys::Result as Code;

/// What stands between a person and the headset.
#[derive(Debug, thiserror::Error)]
pub enum XrError {
    /// Nothing of OpenXR is installed.
    #[error(
        "no OpenXR loader was found ({reason}); install one and the headset's runtime (Debian: libopenxr-loader1), or use the window"
    )]
    NoLoader {
        /// What the system said.
        reason: String,
    },
    /// There is a loader and nobody behind it.
    #[error(
        "no OpenXR runtime answers ({code}); start the headset's own, SteamVR or Monado (XR_RUNTIME_JSON names a runtime's manifest), or use the window"
    )]
    NoRuntime {
        /// What the loader said.
        code: Code,
    },
    /// Somebody is there who does not answer.
    #[error("the OpenXR runtime does not answer ({reason}): it hangs or is stopped; start it anew, or use the window")]
    Silent {
        /// What was waited for in vain.
        reason: String,
    },
    /// There is a runtime without a headset.
    #[error("{runtime} has no headset ({code}); connect it or wake it, or use the window")]
    NoHeadset {
        /// The runtime's name.
        runtime: String,
        /// What it said.
        code: Code,
    },
    /// The runtime cannot do something that is needed.
    #[error("{runtime} lacks {what}; update it, or use the window")]
    Lacks {
        /// The runtime's name.
        runtime: String,
        /// What is missing.
        what: &'static str,
    },
    /// The graphics device that the runtime wants.
    #[error("the headset's graphics device: {reason}")]
    Device {
        /// What the driver or wgpu said.
        reason: String,
    },
    /// A call that the runtime refused.
    #[error("the OpenXR runtime refused: {what}: {code}")]
    Call {
        /// What was asked for.
        what: &'static str,
        /// What it said.
        code: Code,
    },
    /// It went away and did not come back.
    #[error("the OpenXR runtime went away and was not there again after {tries} tries: {reason}")]
    Gone {
        /// How often it was looked for.
        tries: u32,
        /// What was in the way at last.
        reason: Box<XrError>,
    },
    /// A panel that was not made, or made before the runtime came back.
    #[error("there is no such panel; panels are made anew when the headset is back")]
    NoPanel,
}

impl XrError {
    pub(super) fn call(what: &'static str, code: Code) -> Self {
        Self::Call { what, code }
    }
}
