//! Half resolution far from the optical axis: the device against the cores.

use sg_gpu::{Options, Renderer, Settings};
use sg_raster::foveation::Foveation;
use sg_raster::image::Image;
use sg_raster::image_error::Difference;
use sg_raster::render::{Options as OnCores, Projection, Quality, render};
use sg_scene::camera::Camera;

use crate::cases;
use crate::support::device;

/// Cases of other kinds: rays beside ellipses, needles, opaque and faint layers.
const CASES: [&str; 5] =
    ["eye touches a surface, near distance", "needles", "110 degrees", "thousand layers", "two moved units"];

/// An eccentricity that leaves about a third of a picture's tiles in the middle.
fn foveation(camera: &Camera) -> Foveation {
    let slope = 0.5 * f64::from(camera.width.min(camera.height)) / camera.fx.min(camera.fy);
    Foveation::beyond((0.6 * slope).atan().to_degrees().clamp(1.0, 89.0) as u8).unwrap()
}

/// The pixels of a picture that keep the whole resolution; all of them without foveation.
fn whole_pixels(image: &Image, camera: &Camera, foveation: Option<Foveation>) -> Vec<[f32; 4]> {
    let all = image.rgba.as_chunks::<4>().0.iter().enumerate();
    let width = image.width as usize;
    let is = |k: usize| {
        let at = [(k % width) as u32, (k / width) as u32];
        foveation.is_none_or(|foveation| !foveation.is_coarse(camera, at))
    };
    all.filter(|(k, _)| is(*k)).map(|(_, pixel)| *pixel).collect()
}

#[test]
fn tiles_of_half_resolution_are_those_of_the_cores() {
    let Some(gpu) = device() else { return };
    for case in cases::all().into_iter().filter(|case| CASES.contains(&case.name)) {
        let foveation = foveation(&case.camera);
        // Other sizes than those of the picture before: tiles and blocks that the edges cut.
        let odd = Camera { width: case.camera.width - 3, height: case.camera.height - 5, ..case.camera.clone() };
        let mut renderer = Renderer::new(&gpu, &case.scene).unwrap();
        let short = Options { listed_pairs: 2048, ..Options::default() };
        let mut in_windows = Renderer::with_options(&gpu, &case.scene, short).unwrap();
        for camera in [&case.camera, &odd] {
            for quality in [Quality::Standard, Quality::Fast] {
                let options = OnCores { quality, foveation: Some(foveation), ..OnCores::default() };
                let cores = render(&case.scene, &case.appearance, camera, options).unwrap().image;
                let settings = Settings { quality, foveation: Some(foveation), ..Settings::default() };
                let cameras = std::slice::from_ref(camera);
                let (images, _) = renderer.picture(cameras, &case.appearance, settings).unwrap();
                let d = Difference::between(&images[0], &cores).unwrap();
                let (whole, _) =
                    renderer.picture(cameras, &case.appearance, Settings { foveation: None, ..settings }).unwrap();
                let [middle, before] =
                    [&images[0], &whole[0]].map(|image| whole_pixels(image, camera, Some(foveation)));
                let all = whole_pixels(&whole[0], camera, None);
                println!(
                    "{:30} {quality:?}, {} degrees, {} of {} pixels whole: {:.1} dB to the cores, {:.1} dB to all pixels",
                    case.name,
                    foveation.degrees(),
                    middle.len(),
                    all.len(),
                    d.footprint_psnr_db,
                    Difference::between(&images[0], &whole[0]).unwrap().footprint_psnr_db,
                );
                assert!(!middle.is_empty() && middle.len() < all.len(), "{}", case.name);
                assert_eq!(middle, before, "{}: the middle changes", case.name);
                let least = if quality == Quality::Standard { 80.0 } else { 55.0 };
                assert!(d.psnr_db.min(d.footprint_psnr_db) > least, "{}: {d:?}", case.name);
                let (windowed, _) = in_windows.picture(cameras, &case.appearance, settings).unwrap();
                let d = Difference::between(&windowed[0], &images[0]).unwrap();
                assert!(d.psnr_db > 60.0, "{}, in windows: {d:?}", case.name);
            }
        }
    }
}

/// Depths of a block are those of its evaluation; rays draw every pixel.
#[test]
fn blocks_have_one_depth_and_rays_have_no_blocks() {
    let Some(gpu) = device() else { return };
    let case = cases::all().into_iter().find(|case| case.name == "two moved units").unwrap();
    let foveation = foveation(&case.camera);
    let mut renderer = Renderer::new(&gpu, &case.scene).unwrap();
    let cameras = [case.camera.clone()];
    let settings = Settings { depths: true, foveation: Some(foveation), ..Settings::default() };
    let mut draw = |settings| {
        let (images, _) = renderer.picture(&cameras, &case.appearance, settings).unwrap();
        (images, renderer.read_depths().unwrap().remove(0))
    };
    let (_, depths) = draw(settings);
    let (_, whole) = draw(Settings { foveation: None, ..settings });
    let (width, height) = (case.camera.width, case.camera.height);
    let (mut blocks, mut fronts) = (0, 0);
    for y in 0..height {
        for x in 0..width {
            let at = |x: u32, y: u32| (y * width + x) as usize;
            if foveation.is_coarse(&case.camera, [x, y]) {
                assert_eq!(depths[at(x, y)], depths[at(x / 2 * 2, y / 2 * 2)], "{x}, {y}");
                blocks += 1;
                fronts += usize::from(depths[at(x, y)] > 0.0);
            } else {
                assert_eq!(depths[at(x, y)], whole[at(x, y)], "{x}, {y}");
            }
        }
    }
    println!("{blocks} coarse pixels, {fronts} with a front");
    assert!(fronts > 0 && fronts < blocks, "{fronts} of {blocks}");
    let by_ray = Settings { projection: Projection::PerRay, ..settings };
    let [foveated, whole] = [by_ray, Settings { foveation: None, ..by_ray }].map(|settings| draw(settings).0);
    assert!(foveated[0].rgba == whole[0].rgba);
}
