//! Views that show most of a region: pictures of it alone from all sides, and the best of them among the rest of the scene.
//!
//! The pictures are small, so the cores of this process draw them. A render process would have to draw, store, hash and send
//! each one, and takes no choice of Gaussians other than units. No window and no headset has a part in it.

use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;
use sg_edit::wire::{encode_vector, encode_view};
use sg_edit::{EditError, EditState};
use sg_labeling::entropy::{AlphaError, AlphaPicture, EntropyForm};
use sg_labeling::frame::Frame;
use sg_labeling::region::{Region, RegionError};
use sg_labeling::views::{Sphere, ViewsError, choose};
use sg_proto::bus::Code;
use sg_proto::labeling;
use sg_raster::render::{Quality, RenderError, render};
use sg_runtime::fault::Fault;
use sg_scene::appearance::Appearance;
use sg_scene::mask::Mask;
use sg_scene::model::{BaseUnit, Scene};
use sg_scene::orientation::Side;
use sg_scene::view::View;

/// Views without a number in the request.
const USUAL_COUNT: u32 = 4;
/// Most views in a reply.
const MAX_COUNT: u32 = 32;
/// Side of the pictures without a number in the request.
const USUAL_PIXELS: u32 = 128;
/// Sides of pictures.
const PIXELS: std::ops::RangeInclusive<u32> = 32..=512;
/// Most Gaussians whose ball is computed, evenly in the order of the scene.
const SAMPLES: usize = 16_384;
/// Least radius of a region, as a share of the longest edge of the scene.
const LEAST_RADIUS: f64 = 1e-3;
/// Extent of a Gaussian in standard deviations.
const DEVIATIONS: f64 = 2.0;
/// Least angle between two views of a reply, degrees.
const APART: f64 = 30.0;

/// What the views of a region are ordered by, on pictures of the region alone. The greatest comes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ViewOrder {
    /// An entropy of the opacity.
    Entropy(EntropyForm),
    /// The share of the picture that the region covers.
    VisibleArea,
}

impl Default for ViewOrder {
    fn default() -> Self {
        Self::Entropy(EntropyForm::Normalized)
    }
}

/// Options of a request for views.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ViewsOptions {
    pub(crate) count: usize,
    pub(crate) pixels: u32,
    pub(crate) order: ViewOrder,
    /// Whether the pictures are in the reply.
    pub(crate) pictures: bool,
}

/// Why a region has no views.
#[derive(Debug, thiserror::Error)]
pub(crate) enum RegionViewsError {
    /// A number of the request is out of range.
    #[error("{0}")]
    Request(String),
    /// The region has no ball.
    #[error(transparent)]
    Region(#[from] RegionError),
    /// The Gaussians could not be collected.
    #[error(transparent)]
    Edit(#[from] EditError),
    /// No camera stands around the region.
    #[error(transparent)]
    Views(#[from] ViewsError),
    /// A picture could not be drawn.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A picture has no valid opacities.
    #[error(transparent)]
    Alpha(#[from] AlphaError),
    /// A picture could not be encoded.
    #[error("a picture: {0}")]
    Picture(#[from] std::io::Error),
    /// The region has changed since.
    #[error("the region has changed")]
    Superseded,
    /// The deadline passed between two pictures.
    #[error("the views were not ready in time; ask for smaller pictures, or wait longer")]
    Late,
}

impl From<RegionViewsError> for Fault {
    fn from(error: RegionViewsError) -> Self {
        match &error {
            RegionViewsError::Request(_) => Self::invalid(error.to_string()),
            RegionViewsError::Region(_) => Self::precondition(error.to_string()),
            RegionViewsError::Late => Self::new(Code::DeadlineExceeded, error.to_string()),
            RegionViewsError::Edit(edit) => Self::new(edit.code(), error.to_string()).with_details(edit.details()),
            _ => Self::new(Code::Internal, error.to_string()),
        }
    }
}

impl ViewsOptions {
    /// The numbers of a request.
    pub(crate) fn of(request: &labeling::ViewsRequest) -> Result<Self, RegionViewsError> {
        let count = if request.count == 0 { USUAL_COUNT } else { request.count };
        if count > MAX_COUNT {
            return Err(RegionViewsError::Request(format!("{count} views are asked for; the limit is {MAX_COUNT}")));
        }
        let pixels = if request.pixels == 0 { USUAL_PIXELS } else { request.pixels };
        if !PIXELS.contains(&pixels) {
            let (least, most) = (PIXELS.start(), PIXELS.end());
            let problem = format!("a side of {pixels} pixels is asked for; it must be {least} to {most}");
            return Err(RegionViewsError::Request(problem));
        }
        let form = match request.form() {
            labeling::EntropyForm::Unspecified | labeling::EntropyForm::Normalized => EntropyForm::Normalized,
            labeling::EntropyForm::Literal => EntropyForm::Literal,
        };
        let order = ViewOrder::Entropy(form);
        Ok(Self { count: count as usize, pixels, order, pictures: request.pictures })
    }
}

/// What is measured on a picture of the region alone.
pub(crate) struct Measured {
    entropy: f64,
    literal: f64,
    area: f64,
    /// The sum of the opacities.
    opacity: f64,
}

/// How the pictures are drawn by which views are chosen.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ChoicePictures {
    /// Their side.
    pub(crate) pixels: u32,
    pub(crate) quality: Quality,
    /// Most Gaussians in them.
    pub(crate) gaussians: usize,
}

/// A region alone, with all views around it that were measured.
pub(crate) struct MeasuredViews {
    /// Its Gaussians with their looks now.
    pub(crate) alone: Scene,
    /// Their usual look, whatever light and background the scene has.
    pub(crate) look: Appearance,
    region: Region,
    views: Vec<View>,
    /// The measures of each view's picture.
    measured: Vec<Measured>,
}

impl MeasuredViews {
    /// Measures the views around a region. `between` is called before each picture, and may end the work.
    ///
    /// # Errors
    /// [`RegionViewsError`].
    pub(crate) fn of(
        alone: Scene,
        (edge, frame): (f64, &Frame),
        pictures: ChoicePictures,
        between: &dyn Fn() -> Result<(), RegionViewsError>,
    ) -> Result<Self, RegionViewsError> {
        let region = ball(&alone, edge)?;
        let views = Sphere::default().views(&region, frame)?;
        let look = Appearance::of(&alone);
        let thin = thinned(&alone, pictures.gaussians);
        let (drawn, drawn_look) = thin.as_ref().map_or((&alone, look.clone()), |thin| (thin, Appearance::of(thin)));
        let measured: Result<Vec<Measured>, RegionViewsError> =
            views.iter().map(|view| between().and_then(|()| measured(drawn, &drawn_look, view, pictures))).collect();
        Ok(Self { measured: measured?, alone, look, region, views })
    }

    /// The `count` best views by an order, the best first.
    ///
    /// # Errors
    /// [`ViewsError`] if a measure is not a number.
    pub(crate) fn best(&self, order: ViewOrder, count: usize) -> Result<Vec<(&View, &Measured)>, ViewsError> {
        let score = |picture: &Measured| match order {
            ViewOrder::Entropy(EntropyForm::Normalized) => picture.entropy,
            ViewOrder::Entropy(EntropyForm::Literal) => picture.literal,
            ViewOrder::VisibleArea => picture.area,
        };
        let scores: Vec<f64> = self.measured.iter().map(score).collect();
        let chosen = choose(&self.views, &scores, count, APART)?;
        Ok(chosen.into_iter().filter_map(|at| Some((self.views.get(at)?, self.measured.get(at)?))).collect())
    }
}

/// The views of some Gaussians of a state, of which `placed` is the placed scene. Hidden ones are drawn. `between` is called
/// before each picture, and may end the work.
///
/// # Errors
/// [`RegionViewsError`].
pub(crate) fn region_views(
    placed: &Scene,
    state: &EditState,
    members: &Mask,
    options: ViewsOptions,
    between: &dyn Fn() -> Result<(), RegionViewsError>,
) -> Result<labeling::ViewsReply, RegionViewsError> {
    let start = Instant::now();
    let alone = state.edited_placed(placed, members)?;
    let pictures = ChoicePictures { pixels: options.pixels, quality: Quality::Standard, gaussians: usize::MAX };
    let measured =
        MeasuredViews::of(alone, (placed.bounds.longest_edge(), &upright(placed, state)), pictures, between)?;
    let among = marked(state, members);
    let look = Appearance { background: state.appearance().background, ..measured.look.clone() };
    let found: Result<Vec<labeling::RegionView>, RegionViewsError> = measured
        .best(options.order, options.count)?
        .into_iter()
        .map(|(view, alone)| {
            between()?;
            let camera = view.camera(options.pixels, options.pixels);
            let shown = render(placed, &among, &camera, Quality::Standard)?.image;
            // The region is white and the rest is black.
            let seen: f64 = shown.pixels().filter_map(|pixel| pixel.first()).map(|red| f64::from(*red)).sum();
            let unhidden = if alone.opacity > 0.0 { (seen / alone.opacity).clamp(0.0, 1.0) } else { 0.0 };
            let mut picture = Vec::new();
            if options.pictures {
                render(&measured.alone, &look, &camera, Quality::Standard)?.image.write_png(&mut picture)?;
            }
            Ok(labeling::RegionView {
                view: Some(encode_view(view)),
                entropy: alone.entropy,
                literal_entropy: alone.literal,
                visible_area: alone.area,
                unhidden,
                picture,
            })
        })
        .collect();
    Ok(labeling::ViewsReply {
        views: found?,
        measured: measured.views.len() as u32,
        center: Some(encode_vector(measured.region.center)),
        radius: measured.region.radius,
        tiny: measured.region.is_tiny,
        render_ms: start.elapsed().as_secs_f64() * 1e3,
        revision: state.revision(),
    })
}

/// The frame of the scene as seen from its front, with the direction up that somebody chose. So the views of a region do not depend
/// on the present one, and stand upright.
fn upright(placed: &Scene, state: &EditState) -> Frame {
    let (direction, up) = placed.orientation.with_up(state.up()).direction_and_up(Side::Front);
    Frame::new(direction.cross(up), up, -direction).unwrap_or(Frame::XYZ)
}

/// The ball of the Gaussians of a scene.
fn ball(scene: &Scene, edge: f64) -> Result<Region, RegionError> {
    let step = scene.len().div_ceil(SAMPLES).max(1);
    let (mut positions, mut weights, mut extents) = (Vec::new(), Vec::new(), Vec::new());
    let all = scene.units.iter().flat_map(|unit| (0..unit.gaussians.len()).map(move |i| (unit, i)));
    for (unit, i) in all.step_by(step) {
        let stretch = unit.transform.determinant().abs().cbrt();
        positions.push(unit.transform.transform_point3(unit.gaussians.position[i].as_dvec3()));
        weights.push(f64::from(unit.gaussians.opacity(i) * unit.opacity));
        extents.push(DEVIATIONS * stretch * f64::from(unit.gaussians.log_scale[i].max_element()).exp());
    }
    let least = LEAST_RADIUS * edge;
    Region::of_gaussians(&positions, &weights, &extents, if least > 0.0 { least } else { f64::MIN_POSITIVE.sqrt() })
}

/// A scene of `most` of its Gaussians, evenly in their order. Each covers more by as much as there are fewer, so that all cover about
/// the same. `None` for a scene that has no more.
fn thinned(scene: &Scene, most: usize) -> Option<Scene> {
    let count = scene.len();
    if count <= most || most == 0 {
        return None;
    }
    let longer = (0.5 * (count as f64 / most as f64).ln()) as f32;
    let is_taken = |i: usize| i * most / count != (i + 1) * most / count;
    let units = scene.units.iter().map(|unit| {
        let rows: Vec<usize> = (0..unit.gaussians.len()).filter(|row| is_taken(unit.first + row)).collect();
        let mut gaussians = unit.gaussians.rows(&rows);
        gaussians.log_scale.iter_mut().for_each(|scale| *scale += Vec3::splat(longer));
        BaseUnit { gaussians, ..unit.without_gaussians() }
    });
    Some(Scene::compose(units.collect(), Some(scene.bounds)))
}

fn measured(
    scene: &Scene,
    look: &Appearance,
    view: &View,
    ChoicePictures { pixels, quality, .. }: ChoicePictures,
) -> Result<Measured, RegionViewsError> {
    let image = render(scene, look, &view.camera(pixels, pixels), quality)?.image;
    let alpha: Vec<f32> = image.pixels().filter_map(|pixel| pixel.get(3).copied()).collect();
    let picture = AlphaPicture::new(&alpha, pixels, pixels)?;
    Ok(Measured {
        entropy: picture.entropy(EntropyForm::Normalized),
        literal: picture.entropy(EntropyForm::Literal),
        area: picture.visible_area(),
        opacity: alpha.iter().map(|a| f64::from(*a)).sum(),
    })
}

/// The look of a state with some Gaussians white and all others black, on black.
fn marked(state: &EditState, members: &Mask) -> Appearance {
    let color = |i| if members.get(i) { Vec3::ONE } else { Vec3::ZERO };
    let colors: Arc<[Vec3]> = (0..members.len()).map(color).collect();
    Appearance { colors: Some(colors), background: Vec3::ZERO, overlay: None, ..state.appearance() }
}

#[cfg(test)]
mod tests {
    #![allow(
        clippy::unwrap_used,
        clippy::print_stdout,
        reason = "a test fails by panicking and tells what it measured"
    )]

    use glam::DVec3;
    use sg_edit::UnitRef;
    use sg_edit::wire::decode_view;
    use sg_scene::synthetic::test_scene;

    use super::*;

    const USUAL: ViewsOptions =
        ViewsOptions { count: 4, pixels: 64, order: ViewOrder::Entropy(EntropyForm::Normalized), pictures: false };

    fn views(scene: &Scene, members: &Mask, options: ViewsOptions) -> labeling::ViewsReply {
        let state = EditState::of_scene(scene, "", "");
        region_views(scene, &state, members, options, &|| Ok(())).unwrap()
    }

    fn direction(found: &labeling::RegionView) -> DVec3 {
        let view = decode_view(found.view.as_ref().unwrap()).unwrap();
        (view.eye - view.target).normalize()
    }

    #[test]
    fn a_flat_region_is_seen_from_its_flat_side() {
        let mut scene = test_scene(&[("disk", 2000)]);
        for position in &mut scene.units[0].gaussians.position {
            position.y *= 1e-3;
        }
        for scale in &mut scene.units[0].gaussians.log_scale {
            *scale = Vec3::splat(scale.min_element());
        }
        let entropies = [EntropyForm::Normalized, EntropyForm::Literal].map(ViewOrder::Entropy);
        for order in entropies.into_iter().chain([ViewOrder::VisibleArea]) {
            let found = views(&scene, &Mask::full(scene.len()), ViewsOptions { order, ..USUAL });
            let up = direction(&found.views[0]).y.abs();
            assert!(up > 0.7, "{order:?}: {up}, {found:?}");
        }
    }

    #[test]
    fn views_fall_by_what_orders_them() {
        let scene = test_scene(&[("bone", 300), ("skin", 900)]);
        let state = EditState::of_scene(&scene, "", "");
        let bone = state.members(UnitRef::Base(0));
        assert_eq!(ViewOrder::default(), USUAL.order);
        let measure = |order: ViewOrder, view: &labeling::RegionView| match order {
            ViewOrder::Entropy(EntropyForm::Normalized) => view.entropy,
            ViewOrder::Entropy(EntropyForm::Literal) => view.literal_entropy,
            ViewOrder::VisibleArea => view.visible_area,
        };
        for order in [ViewOrder::default(), ViewOrder::Entropy(EntropyForm::Literal), ViewOrder::VisibleArea] {
            let all = views(&scene, &bone, ViewsOptions { count: 32, order, ..USUAL });
            let best = all.views.iter().map(|view| measure(order, view)).fold(f64::NEG_INFINITY, f64::max);
            let few = views(&scene, &bone, ViewsOptions { order, ..USUAL });
            assert_eq!(measure(order, &few.views[0]), best, "{order:?}");
            assert!(few.views.windows(2).all(|pair| measure(order, &pair[0]) >= measure(order, &pair[1])), "{order:?}");
        }
    }

    #[test]
    fn the_best_views_come_first_apart_and_always_the_same() {
        let scene = test_scene(&[("bone", 300), ("skin", 900)]);
        let state = EditState::of_scene(&scene, "", "");
        let found = views(&scene, &state.members(UnitRef::Base(0)), USUAL);
        assert_eq!(found.views.len(), 4);
        assert!(found.views.windows(2).all(|pair| pair[0].entropy >= pair[1].entropy), "{found:?}");
        let eyes: Vec<DVec3> = found.views.iter().map(direction).collect();
        assert!(eyes[1..].iter().all(|eye| eye.angle_between(eyes[0]) > 0.25), "{eyes:?}");
        let again = views(&scene, &state.members(UnitRef::Base(0)), USUAL);
        assert_eq!(found.views, again.views);
        let whole = views(&scene, &Mask::full(scene.len()), USUAL);
        assert!(whole.views.iter().all(|found| found.unhidden > 0.97), "nothing hides the whole: {whole:?}");
        assert!(found.views.iter().all(|view| (0.0..=1.0).contains(&view.unhidden)));
    }

    #[test]
    fn pictures_come_when_asked_for() {
        let scene = test_scene(&[("bone", 300), ("skin", 900)]);
        let state = EditState::of_scene(&scene, "", "");
        let bone = state.members(UnitRef::Base(0));
        assert!(views(&scene, &bone, USUAL).views.iter().all(|view| view.picture.is_empty()));
        let found = views(&scene, &bone, ViewsOptions { pictures: true, ..USUAL });
        for view in &found.views {
            let mut reader = png::Decoder::new(std::io::Cursor::new(&view.picture)).read_info().unwrap();
            let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut pixels).unwrap();
            assert_eq!((reader.info().width, reader.info().height), (USUAL.pixels, USUAL.pixels));
            // The bone stands out from the background in the corner.
            let corner = &pixels[..3];
            assert!(pixels.chunks_exact(3).any(|pixel| pixel.iter().zip(corner).any(|(a, b)| a.abs_diff(*b) > 40)));
        }
        assert_eq!(found.views.len(), 4);
    }

    #[test]
    fn tiny_regions_and_ties_have_views_and_empty_ones_an_error() {
        let mut scene = test_scene(&[("dot", 3), ("skin", 900)]);
        let edge = scene.bounds.longest_edge() as f32;
        for i in 0..3 {
            scene.units[0].gaussians.position[i] = Vec3::ZERO;
            scene.units[0].gaussians.log_scale[i] = Vec3::splat((1e-6 * edge).ln());
        }
        let state = EditState::of_scene(&scene, "", "");
        let found = views(&scene, &state.members(UnitRef::Base(0)), USUAL);
        assert!(found.tiny && found.views.len() == 4 && found.radius > 0.0, "{found:?}");
        let none = region_views(&scene, &state, &Mask::empty(scene.len()), USUAL, &|| Ok(()));
        assert!(matches!(none, Err(RegionViewsError::Region(RegionError::Empty))), "{none:?}");
        let drawn = std::cell::Cell::new(0);
        let after_two = || {
            drawn.set(drawn.get() + 1);
            if drawn.get() <= 2 { Ok(()) } else { Err(RegionViewsError::Late) }
        };
        let late = region_views(&scene, &state, &state.members(UnitRef::Base(0)), USUAL, &after_two);
        assert!(matches!(late, Err(RegionViewsError::Late)) && drawn.get() == 3, "{late:?}");
    }

    #[test]
    fn the_views_do_not_depend_on_the_present_one() {
        use sg_proto::scene::command::Action;
        use sg_proto::scene::{Orbit, SetView, set_view};
        let scene = Arc::new(test_scene(&[("bone", 300), ("skin", 900)]));
        let state = EditState::of_scene(&scene, "", "");
        let orbit = Orbit { azimuth_degrees: 50.0, elevation_degrees: 40.0 };
        let turn = Action::SetView(SetView { change: Some(set_view::Change::Orbit(orbit)) });
        let turned = state.after(&scene, turn).unwrap();
        let members = state.members(UnitRef::Base(0));
        let views = |state: &EditState| region_views(&scene, state, &members, USUAL, &|| Ok(())).unwrap().views;
        assert_eq!(views(&turned), views(&state));
    }

    #[test]
    fn fewer_gaussians_cover_about_the_same() {
        let scene = test_scene(&[("bone", 3000), ("skin", 5000)]);
        assert!(thinned(&scene, 8000).is_none());
        let thin = thinned(&scene, 1000).unwrap();
        assert_eq!((thin.len(), thin.units[0].gaussians.len(), thin.bounds), (1000, 375, scene.bounds));
        let area = |scene: &Scene| {
            let of = |pixels, gaussians| ChoicePictures { pixels, quality: Quality::Standard, gaussians };
            let views = MeasuredViews::of(scene.clone(), (10.0, &Frame::XYZ), of(64, usize::MAX), &|| Ok(())).unwrap();
            views.measured.iter().map(|picture| picture.area).sum::<f64>() / views.measured.len() as f64
        };
        let (whole, fewer) = (area(&scene), area(&thin));
        // In a volume they lie over each other a little more often.
        assert!((fewer / whole - 1.0).abs() < 0.2, "{whole} {fewer}");
    }

    #[test]
    fn requests_out_of_range_are_refused() {
        let of = |count, pixels| {
            let request = labeling::ViewsRequest { count, pixels, ..labeling::ViewsRequest::default() };
            ViewsOptions::of(&request).map_err(|e| e.to_string())
        };
        assert_eq!(of(0, 0).unwrap(), ViewsOptions { pixels: 128, ..USUAL });
        assert!(of(33, 0).unwrap_err().contains("the limit is 32"));
        assert!(of(1, 31).unwrap_err().contains("32 to 512") && of(1, 513).is_err());
    }

    #[test]
    #[ignore = "a measurement for docs/labeling.md"]
    fn views_of_large_regions_take_what_drawing_takes() {
        for count in [100, 1000, 10_000, 100_000] {
            let scene = test_scene(&[("part", count), ("rest", count)]);
            let state = EditState::of_scene(&scene, "", "");
            let members = state.members(UnitRef::Base(0));
            let mut best = labeling::ViewsReply { render_ms: f64::INFINITY, ..labeling::ViewsReply::default() };
            for _ in 0..3 {
                let found = views(&scene, &members, ViewsOptions { pixels: 128, ..USUAL });
                if found.render_ms < best.render_ms {
                    best = found;
                }
            }
            println!("{count} Gaussians: {} views of 128 x 128 in {:.1} ms", best.measured, best.render_ms);
        }
    }

    /// What smaller pictures of fewer Gaussians cost: milliseconds, and the entropy in large pictures of the views that they choose.
    #[test]
    #[ignore = "a measurement for docs/labeling.md"]
    fn views_chosen_by_smaller_pictures() {
        let Some(data) = std::env::var_os("SUPERGAUSSIAN_DATA").map(std::path::PathBuf::from) else { return };
        let of = |pixels, quality, gaussians| ChoicePictures { pixels, quality, gaussians };
        let large = of(512, Quality::Standard, usize::MAX);
        let choices = [
            of(128, Quality::Standard, usize::MAX),
            of(64, Quality::Fast, usize::MAX),
            of(128, Quality::Fast, 8192),
            of(64, Quality::Fast, 8192),
            of(64, Quality::Fast, 4096),
            of(64, Quality::Fast, 2048),
            of(64, Quality::Fast, 1024),
        ];
        for file in ["splats/biker.compressed.ply", "splats/donut_fused.ply"] {
            let loaded = sg_formats::load(&data.join(file), &sg_formats::LoadOptions::default()).unwrap();
            let scene = Arc::new(loaded.scene);
            let state = EditState::of_scene(&scene, "", "");
            let placed = sg_edit::PlacedScene::new(Arc::clone(&scene)).of(&state);
            let regions = octants(&placed);
            let (mut lost, mut worst, mut milliseconds) = ([0.0_f64; 7], [0.0_f64; 7], [0.0_f64; 7]);
            for members in &regions {
                let alone = state.edited_placed(&placed, members).unwrap();
                let edge = placed.bounds.longest_edge();
                let measured_by =
                    |pictures| MeasuredViews::of(alone.clone(), (edge, &Frame::XYZ), pictures, &|| Ok(())).unwrap();
                let truth = measured_by(large);
                let entropy = |view: &View| {
                    let at = truth.views.iter().position(|known| known == view).unwrap();
                    truth.measured[at].entropy
                };
                let all: Vec<f64> = truth.measured.iter().map(|m| m.entropy).collect();
                let spread = all.iter().fold(0.0_f64, |a, b| a.max(*b)) - all.iter().fold(1.0_f64, |a, b| a.min(*b));
                let mean = |views: &MeasuredViews| {
                    let best = views.best(ViewOrder::default(), 5).unwrap();
                    best.iter().map(|(view, _)| entropy(view)).sum::<f64>() / best.len() as f64
                };
                let exact = mean(&truth);
                for (at, choice) in choices.into_iter().enumerate() {
                    let start = Instant::now();
                    let views = measured_by(choice);
                    milliseconds[at] += start.elapsed().as_secs_f64() * 1e3;
                    let loss = (exact - mean(&views)) / spread;
                    lost[at] += loss;
                    worst[at] = worst[at].max(loss);
                }
            }
            println!("{file}: {} regions of a scene of {}", regions.len(), scene.len());
            for (at, choice) in choices.iter().enumerate() {
                let n = regions.len() as f64;
                let (ms, lost, worst) = (milliseconds[at] / n, lost[at] / n, worst[at]);
                println!(
                    "  {choice:?}: {ms:.0} ms, share of the range of entropies lost: mean {lost:.4}, most {worst:.4}"
                );
            }
        }
    }

    /// The eight parts of a scene about the medians of its coordinates.
    fn octants(scene: &Scene) -> Vec<Mask> {
        let places: Vec<DVec3> = (0..scene.len()).map(|i| scene.position(i).unwrap()).collect();
        let median = |of: &dyn Fn(&DVec3) -> f64| {
            let mut values: Vec<f64> = places.iter().map(of).collect();
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        let middle = DVec3::new(median(&|p| p.x), median(&|p| p.y), median(&|p| p.z));
        let octant = |p: &DVec3| p.cmpge(middle).bitmask();
        let of = |octant_of: u32| {
            let mut mask = Mask::empty(scene.len());
            places.iter().enumerate().filter(|(_, p)| octant(p) == octant_of).for_each(|(i, _)| mask.set(i, true));
            mask
        };
        (0..8).map(of).filter(|mask| mask.count() > 50).collect()
    }
}
