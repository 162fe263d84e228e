//! Tiles blended from copies in workgroup memory, as graphics cards do: pictures and depths, bit by bit.

use sg_gpu::{Options, Renderer, Settings};
use sg_raster::foveation::Foveation;
use sg_scene::camera::Camera;

use crate::cases;
use crate::support::device;

/// Cases of other kinds: rays beside ellipses, needles, large Gaussians, opaque and faint layers, edits.
const CASES: [&str; 8] = [
    "eye touches a surface, near distance",
    "near distance, 140 degrees",
    "needles",
    "huge",
    "110 degrees",
    "opacity 1",
    "thousand layers",
    "two moved units",
];

#[test]
fn copies_in_workgroup_memory_change_no_bit() {
    let Some(gpu) = device() else { return };
    for case in cases::all().into_iter().filter(|case| CASES.contains(&case.name)) {
        for listed_pairs in [1 << 20, 1024] {
            let mut renderers = [false, true].map(|staged| {
                let options = Options { listed_pairs, staged_blending: Some(staged), ..Options::default() };
                Renderer::with_options(&gpu, &case.scene, options).unwrap()
            });
            // Tiles that the edges cut.
            let odd = Camera { width: case.camera.width - 3, height: case.camera.height - 5, ..case.camera.clone() };
            for (camera, foveation) in [(&case.camera, None), (&odd, Foveation::beyond(5))] {
                let settings = Settings { foveation, depths: true, ..Settings::default() };
                let cameras = std::slice::from_ref(camera);
                let [plain, staged] = renderers.each_mut().map(|renderer| {
                    let (images, stats) = renderer.picture(cameras, &case.appearance, settings).unwrap();
                    (images, stats.tile_pairs, renderer.read_depths().unwrap())
                });
                assert!(plain.0 == staged.0, "{}: another picture", case.name);
                assert_eq!((plain.1, plain.2), (staged.1, staged.2), "{}", case.name);
            }
        }
    }
}
