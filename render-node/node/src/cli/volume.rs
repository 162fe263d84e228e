//! Pictures of a volume or a mesh by ray marching, with the options of pictures of a scene.

use std::path::Path;
use std::time::Instant;

use glam::DVec3;
use serde::Serialize;
use sg_formats::Format;
use sg_input::number_format::grouped;
use sg_input::print;
use sg_raster::image::Image;
use sg_raster::volume::{empty_scene, fast_march, march, region};
use sg_scene::appearance::Clip;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;
use sg_volume::{
    Dataset, Limits, Marcher, ReadOptions, ScalarField, TransferFunction, WorldFrame, is_volume, read_dataset,
};

use super::failure::Failure;
use super::look::{self, Look};
use super::names::{BackendName, FilterName, ProjectionName, QualityName, RasterizerName, TermName};
use super::transfer_function::read_transfer_function;
use super::{Picture, print_json};

/// Name of the method in reports.
pub(super) const BACKEND: &str = "ray marching on the cores";

/// The volume of the command, under its transfer function.
pub(super) struct SeenVolume {
    field: ScalarField,
    function: TransferFunction,
    frame: WorldFrame,
    step: f64,
    quality: QualityName,
}

/// The JSON report.
#[derive(Debug, Serialize)]
struct VolumeReport<'a> {
    out: &'a Path,
    volume: &'a Path,
    /// The file; null for an automatic transfer function.
    transfer_function: Option<&'a Path>,
    backend: &'static str,
    quality: QualityName,
    /// Voxels between two samples; of a mesh, 1/256 of its diagonal.
    step: f64,
    threads: usize,
    /// Voxels along x, y and z; null for a mesh.
    dims: Option<[usize; 3]>,
    /// Tetrahedra of a mesh; null for voxels.
    tetrahedra: Option<usize>,
    camera: &'a Camera,
    read_seconds: f64,
    seconds: f64,
}

/// Whether the command draws a volume.
pub(super) fn is_asked(picture: &Picture) -> bool {
    let is_named = picture.transfer_function.is_some() && !Format::is_scene_path(&picture.scene);
    is_named || is_volume(&picture.scene)
}

impl SeenVolume {
    /// Reads the volume and its transfer function. `None` where the command draws a scene.
    pub(super) fn read(picture: &Picture) -> Result<Option<Self>, Failure> {
        let path = &picture.scene;
        if !is_asked(picture) {
            let given = [
                picture.step.is_some(),
                picture.spacing.is_some(),
                picture.variable.is_some(),
                picture.series.is_some(),
            ];
            if given.contains(&true) {
                let what = "--step, --spacing, --variable and --series are of volumes, and this is a scene";
                let line = format!("{}: {what}", path.display());
                return Err(Failure::input(line));
            }
            return Ok(None);
        }
        refuse_options_of_scenes(picture)?;
        let limits = Limits { own_folder: true, ..Limits::default() };
        let spacing = picture.spacing.map(DVec3::from_array);
        let given = picture.transfer_function.as_deref().map(read_transfer_function).transpose()?;
        let preferred = given.as_ref().and_then(|function| function.variable.clone());
        let (variable, series) = (picture.variable.clone(), picture.series);
        let options = ReadOptions { spacing, variable, preferred, series, limits };
        let volume = read_dataset(path, &options).map_err(Failure::input)?;
        if let Dataset::Volume(volume) = &volume {
            volume.notes().iter().for_each(|note| print::status(&format!("note: {}: {note}", path.display())));
        }
        let field = volume.to_field();
        let function = match given {
            Some(given) => given,
            None => field
                .as_ref()
                .automatic_transfer_function(volume.variable())
                .map_err(|e| Failure::input(format!("{}: {e}", path.display())))?,
        };
        Ok(Some(Self {
            field,
            function,
            frame: volume.frame(),
            step: picture.step.unwrap_or(0.5),
            quality: picture.quality,
        }))
    }

    /// The volume, ready for any number of pictures, and a scene without Gaussians in its place.
    pub(super) fn marcher(&self, clips: &[Clip]) -> Result<(Marcher<'_>, Scene), Failure> {
        let field = self.field.as_ref();
        let classifier = self.function.classifier(field.range()).map_err(Failure::input)?;
        let place = empty_scene(field, &classifier, self.frame);
        let marcher = field.marcher(classifier, self.step);
        Ok((marcher.clipped(clips.iter().map(region).collect()), place))
    }

    /// The picture at the quality of the options.
    pub(super) fn draw(&self, marcher: &Marcher<'_>, camera: &Camera) -> Image {
        match self.quality {
            QualityName::Exact => march(marcher, camera),
            QualityName::Standard | QualityName::Fast => fast_march(marcher, camera),
        }
    }
}

/// Draws one picture of a volume.
pub(super) fn draw(picture: &Picture, volume: &SeenVolume, camera: Option<Camera>, read: f64) -> Result<(), Failure> {
    let Some(out) = &picture.out else { return Err(Failure::input("name the picture to write with --out")) };
    let (marcher, place) = volume.marcher(&look::clips(picture))?;
    let appearance = look::clipped(picture, &place);
    let camera = look::camera(picture, &place, &appearance, camera);
    let look = Look::new(picture, &place, &camera, appearance)?;
    let clock = Instant::now();
    let image = volume.draw(&marcher, &camera);
    let seconds = clock.elapsed().as_secs_f64();
    let (plain, finish) = look.finish(picture);
    image.save_finished(out, plain, &finish).map_err(Failure::work)?;
    let dims = match &volume.field {
        ScalarField::Grid(field) => Some(field.grid().dims()),
        ScalarField::Mesh(_) => None,
    };
    let field = volume.field.as_ref();
    let (count, elements) = (field.elements(), field.elements_name());
    print::status(&format!(
        "{}: {} x {} pixels of {} {elements}, {seconds:.3} s",
        out.display(),
        image.width,
        image.height,
        grouped(count as u64),
    ));
    if picture.json {
        print_json(&VolumeReport {
            out,
            volume: &picture.scene,
            transfer_function: picture.transfer_function.as_deref(),
            backend: BACKEND,
            quality: picture.quality,
            step: volume.step,
            threads: rayon::current_num_threads(),
            dims,
            tetrahedra: dims.is_none().then_some(count),
            camera: &camera,
            read_seconds: read,
            seconds,
        })?;
    }
    Ok(())
}

/// Options that speak of Gaussians do nothing to a volume. Silence would let a person believe otherwise.
fn refuse_options_of_scenes(picture: &Picture) -> Result<(), Failure> {
    let given = [
        ("--mask", picture.mask.is_some()),
        ("--clusters", picture.clusters.is_some()),
        ("--outlines", picture.outlines.is_some()),
        ("--show", picture.show.is_some()),
        ("--pick", picture.pick.is_some()),
        ("--counts", picture.counts),
        ("--palette", picture.palette.is_some()),
        ("--shading", picture.shading.is_some()),
        ("--convention", picture.convention.is_some()),
        ("--term", !matches!(picture.term, TermName::Full)),
        ("--filter", !matches!(picture.filter, FilterName::FromFile)),
        ("--projection", !matches!(picture.projection, ProjectionName::Affine)),
        ("--rasterizer", !matches!(picture.rasterizer, RasterizerName::Tiles)),
        ("--backend gpu", matches!(picture.backend, BackendName::Gpu)),
        ("--foveation", picture.foveation.is_some()),
        ("--near", picture.near.is_some()),
        ("--ambient-occlusion", picture.ambient_occlusion),
    ];
    match given.iter().find(|(_, is_given)| *is_given) {
        Some((name, _)) => Err(Failure::input(format!(
            "{}: {name} is of Gaussians, and this is a volume; leave it out, or make a scene with `supergaussian fit`",
            picture.scene.display()
        ))),
        None => Ok(()),
    }
}
