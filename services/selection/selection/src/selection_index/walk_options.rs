//! Parameters of walks.

use serde::{Deserialize, Serialize};
use sg_clusters::cluster_graph::GraphForm;
use sg_clusters::creases::CREASE;
use sg_walk::{Precision, Solver};

/// Source of background when the user has drawn none.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Background {
    /// Every unseeded node leaks to the background.
    #[default]
    Leak,
    /// In each component, the twentieth of the nodes farthest from the foreground along the graph is background.
    Farthest,
}

/// Parameters of walks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WalkOptions {
    /// Form of the cluster graph.
    pub form: GraphForm,
    /// Factor on σ_s, the median length of the edges.
    pub sigma_s: f64,
    /// Factor on σ_f, the median feature distance of the edges.
    pub sigma_f: f64,
    /// κ of creases ([`sg_clusters::creases`]); `None` for the published weights without them. Walks on clusters alone have
    /// creases.
    pub crease: Option<f64>,
    /// ε of the leak.
    pub leak: f64,
    /// Whether the first answer of a selection without a tuning takes its leak from the family of walks
    /// ([`crate::answers`]) and not from `leak`.
    pub every_scale: bool,
    /// Automatic background.
    pub background: Background,
    /// Algorithm of walks on clusters.
    pub solver: Solver,
    /// Arithmetic of the solver.
    pub precision: Precision,
}

impl Default for WalkOptions {
    fn default() -> Self {
        Self {
            form: GraphForm::Contact,
            sigma_s: 1.0,
            sigma_f: 1.0,
            crease: None,
            leak: 0.03,
            every_scale: false,
            background: Background::Leak,
            solver: Solver::Gth,
            precision: Precision::F64,
        }
    }
}

impl WalkOptions {
    /// The walk of the product: creases weaken edges, and one stroke is answered at every scale. The default is the
    /// published walk with a leak of .03.
    #[must_use]
    pub fn every_scale() -> Self {
        Self { crease: Some(CREASE), every_scale: true, ..Self::default() }
    }
}

/// A parameter outside its range. The text begins with the name of the command-line option.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum WalkOptionsError {
    /// A factor on σ_s or σ_f.
    #[error("{name} is {value}; it must be finite and above 0")]
    Sigma {
        /// `sigma-s` or `sigma-f`.
        name: &'static str,
        /// The factor.
        value: f64,
    },
    /// κ of creases.
    #[error("crease is {0}; it must be finite and above 0")]
    Crease(f64),
    /// The leak.
    #[error("leak is {0}; it must be finite and at least 0")]
    Leak(f64),
}

impl WalkOptions {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`WalkOptionsError`] with the first wrong number.
    pub fn check(&self) -> Result<(), WalkOptionsError> {
        for (name, value) in [("sigma-s", self.sigma_s), ("sigma-f", self.sigma_f)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(WalkOptionsError::Sigma { name, value });
            }
        }
        if let Some(kappa) = self.crease.filter(|kappa| !(*kappa > 0.0 && kappa.is_finite())) {
            return Err(WalkOptionsError::Crease(kappa));
        }
        if !(self.leak >= 0.0 && self.leak.is_finite()) {
            return Err(WalkOptionsError::Leak(self.leak));
        }
        Ok(())
    }
}
