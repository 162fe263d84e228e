//! Errors of a headset session.

use openxr::sys::Result as Code;

/// Errors of a headset session.
#[derive(Debug, thiserror::Error)]
pub enum XrError {
    /// No part of OpenXR is installed.
    #[error(
        "no OpenXR loader was found ({reason}); install one and the headset's runtime (Debian: libopenxr-loader1), or use the window"
    )]
    NoLoader {
        /// The system's message.
        reason: String,
    },
    /// A loader without a runtime.
    #[error(
        "no OpenXR runtime answers ({code}); start the headset's own, SteamVR or Monado (XR_RUNTIME_JSON names a runtime's manifest), or use the window"
    )]
    NoRuntime {
        /// The loader's error.
        code: Code,
    },
    /// The runtime timed out.
    #[error("the OpenXR runtime does not answer ({reason}): it hangs or is stopped; start it anew, or use the window")]
    Silent {
        /// The call that timed out.
        reason: String,
    },
    /// There is a runtime without a headset.
    #[error("{runtime} has no headset ({code}); connect it or wake it, or use the window")]
    NoHeadset {
        /// The runtime's name.
        runtime: String,
        /// Its error code.
        code: Code,
    },
    /// The runtime cannot do something that is needed.
    #[error("{runtime} lacks {what}; update it, or use the window")]
    Lacks {
        /// The runtime's name.
        runtime: String,
        /// The missing feature.
        what: &'static str,
    },
    /// The graphics device that the runtime wants.
    #[error("the headset's graphics device: {reason}")]
    Device {
        /// The message of the driver or of wgpu.
        reason: String,
    },
    /// A call that the runtime refused.
    #[error("the OpenXR runtime refused: {what}: {code}")]
    Call {
        /// The refused call.
        what: &'static str,
        /// Its error code.
        code: Code,
    },
    /// It went away and did not come back.
    #[error("the OpenXR runtime went away and was not there again after {tries} tries: {reason}")]
    Gone {
        /// How often it was looked for.
        tries: u32,
        /// The last error.
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
