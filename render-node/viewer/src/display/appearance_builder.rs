//! Appearance of the scene in one display: its look, the highlight, and views of its structure.

use std::sync::{Arc, Weak};

use glam::Vec3;
use sg_edit::EditState;
use sg_scene::appearance::{Appearance, Overlay};
use sg_scene::mask::Mask;
use sg_scene::model::Scene;

use super::clusters::Clusters;
use super::tools::{DisplayMode, Tools};
use sg_raster::attributes::{AttributeColors, AttributeError, Legend, attribute_colors};
use sg_raster::color_map::ColorMap;
use sg_raster::structure::{ClusterColoring, cluster_colors};

/// Seed of the clusters' colours: the same from one start to the next.
const SEED: u64 = 1;

/// Colours, one a Gaussian, and their legend.
pub type Colors = (Option<Arc<[Vec3]>>, Option<Legend>);

/// Caches the displayed colours, which depend only on the scene and its clusters.
#[derive(Debug, Default)]
pub struct AppearanceBuilder {
    cached: Option<CachedColors>,
}

#[derive(Debug)]
struct CachedColors {
    /// The scene of the colours; a weak pointer keeps its address from another one.
    scene: Weak<Scene>,
    display_mode: DisplayMode,
    clusters: Option<Arc<[u32]>>,
    colors: Colors,
}

impl AppearanceBuilder {
    /// The look of `scene` in state `state` with `selected` highlighted, as `tools` say. A view of clusters that are not known
    /// shows the scene.
    #[must_use]
    pub fn build(
        &mut self,
        scene: &Arc<Scene>,
        state: &EditState,
        selected: &Arc<Mask>,
        clusters: Option<&Clusters>,
        tools: &Tools,
    ) -> Appearance {
        let clusters = clusters.map(Clusters::labels);
        let mut appearance = state.appearance();
        if !selected.is_none() {
            let Tools { highlight, highlight_mix, highlight_opacity, .. } = *tools;
            let mask = Arc::clone(selected);
            appearance.overlay =
                Some(Overlay { mask, color: highlight, mix: highlight_mix, opacity: highlight_opacity });
        }
        let shown = |k: &CachedColors| k.scene.as_ptr() == Arc::as_ptr(scene);
        let known =
            |k: &CachedColors| shown(k) && k.display_mode == tools.display_mode && same(k.clusters.as_ref(), clusters);
        if !self.cached.as_ref().is_some_and(known) {
            // A scene without the attribute keeps its own colours.
            let colors = colors_of(scene, clusters.map(AsRef::as_ref), tools.display_mode).unwrap_or_default();
            let (display_mode, clusters) = (tools.display_mode, clusters.cloned());
            self.cached = Some(CachedColors { scene: Arc::downgrade(scene), display_mode, clusters, colors });
        }
        appearance.colors = self.cached.as_ref().and_then(|k| k.colors.0.clone());
        appearance
    }

    /// Legend of the shown attribute's colours, if the attribute is numeric.
    #[must_use]
    pub fn legend(&self) -> Option<Legend> {
        self.cached.as_ref().and_then(|k| k.colors.1)
    }
}

fn same(a: Option<&Arc<[u32]>>, b: Option<&Arc<[u32]>>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => Arc::ptr_eq(a, b),
        (None, None) => true,
        _ => false,
    }
}

/// One colour per Gaussian, and a legend for a numeric attribute. `None` for the scene's own colours, and for unknown
/// clusters.
///
/// # Errors
/// [`AttributeError`] for an attribute that the scene does not carry.
pub fn colors_of(scene: &Scene, clusters: Option<&[u32]>, display_mode: DisplayMode) -> Result<Colors, AttributeError> {
    let of_clusters = |coloring| clusters.and_then(|labels| cluster_colors(scene, labels, coloring).ok());
    Ok(match display_mode {
        DisplayMode::Scene | DisplayMode::Outlines => (None, None),
        DisplayMode::Clusters => (of_clusters(ClusterColoring::Random { seed: SEED }), None),
        DisplayMode::FirstComponent => (of_clusters(ClusterColoring::FirstComponent(ColorMap::default())), None),
        DisplayMode::Attribute(attribute) => {
            let AttributeColors { colors, legend } = attribute_colors(scene, attribute, ColorMap::default(), None)?;
            (Some(colors), legend)
        }
    })
}
