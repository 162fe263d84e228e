//! The table of passes and the counts of the cores against a device.

use glam::DVec3;
use sg_raster::foveation::Foveation;
use sg_scene::framing;
use sg_scene::synthetic::test_scene;

use super::*;
use crate::barriers::{Access, Kind};
use crate::depth_layer::DepthLayer;
use crate::device::{Gpu, test_device};
use crate::pipeline::{DrawPipeline, Kernel};
use crate::present::Present;
use crate::readback::texture_bytes;
use crate::recorded::{RecordedCommand, record_commands, recorded};
use crate::renderer::Renderer;
use crate::resources::Resources;
use crate::shader::Shader;
use crate::shader_layout::{Dispatches, Stretch};
use crate::textures::PicturePrecision;

const SIZE: [u32; 2] = [200, 150];

fn scene() -> Scene {
    test_scene(&[("vessel", 3000), ("cloud", 1000)])
}

/// Poses from outside and from within a scene.
fn poses(scene: &Scene) -> [Camera; 2] {
    let outside = framing::default_camera(scene, SIZE[0], SIZE[1]);
    let bounds = framing::visible_box(scene);
    let middle = 0.5 * (bounds.min + bounds.max);
    let near = 0.02 * bounds.size().max_element();
    let target = middle + DVec3::new(0.3, 0.4, 0.1) * bounds.size();
    let inside = Camera { near, ..Camera::look_at(middle, target, DVec3::Z, 80.0, SIZE[0], SIZE[1]) };
    [Camera { near, ..outside }, inside]
}

/// Two parallel eyes at a pose.
fn eyes(camera: &Camera) -> [Camera; 2] {
    sg_raster::counts::headset(camera, 20.0 * camera.near, SIZE)
}

fn options(rasterizer: Rasterizer, depths: bool) -> WorkOptions {
    WorkOptions {
        settings: Settings { rasterizer, depths, ..Settings::default() },
        renderer: Options { multiview: Some(false), staged_blending: Some(false), ..Options::default() },
        ..WorkOptions::default()
    }
}

/// Draws once for the sizes of the lists, and then records a frame.
fn record(renderer: &mut Renderer, cameras: &[Camera], settings: Settings) -> Vec<RecordedCommand> {
    let look = Appearance::of(&scene());
    renderer.draw_complete(cameras, &look, settings).unwrap();
    let (drawn, commands) = recorded(|| renderer.draw(cameras, &look, settings));
    drawn.unwrap();
    renderer.finish().unwrap();
    commands
}

/// Records the copies to images of a headset.
fn record_present(gpu: &Gpu, renderer: &Renderer, depths: bool) -> Vec<RecordedCommand> {
    let attachment = wgpu::TextureUsages::RENDER_ATTACHMENT;
    let (color, depth) = (wgpu::TextureFormat::Rgba8UnormSrgb, wgpu::TextureFormat::Depth32Float);
    let image = |format| gpu.texture("image", (SIZE, 1), format, attachment).create_view(&Default::default());
    let (present, layer) = (Present::new(gpu, color), DepthLayer::new(gpu, depth));
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let ((), commands) = recorded(|| {
        for picture in renderer.pictures() {
            let load = wgpu::LoadOp::Clear(wgpu::Color::BLACK);
            present.encode(&mut encoder, picture, &image(color), [0, 0, SIZE[0], SIZE[1]], load);
        }
        for picture in renderer.depths().iter().filter(|_| depths) {
            layer.encode(&mut encoder, (picture, [picture.width(), picture.height()]), (&image(depth), SIZE), 1.0);
        }
    });
    gpu.submit([encoder.finish()]);
    commands
}

/// Whether both lists have the same commands, variables and barriers between buffers. Prints the first difference.
fn agree(described: &[pass_table::Command], recorded: &[RecordedCommand], what: &str) {
    let names = |list: &[&'static str]| list.join(" ");
    let described_names: Vec<&str> = described.iter().map(|c| c.entry).collect();
    let recorded_names: Vec<&str> = recorded.iter().map(|c| c.entry).collect();
    assert_eq!(names(&described_names), names(&recorded_names), "{what}");
    for (want, got) in described.iter().zip(recorded) {
        let what = format!("{what}: {}", want.entry);
        assert_eq!((want.kind, want.opens_pass), (got.kind, got.opens_pass), "{what}");
        let mut wanted: Vec<String> = want
            .resources
            .iter()
            .filter(|r| !matches!(r.access, Access::Sampled | Access::Attachment))
            .map(|r| format!("{} {:?}", r.variable, r.access))
            .collect();
        let mut gotten: Vec<String> = got
            .buffers
            .iter()
            .filter(|b| b.access != Access::Uniform)
            .map(|b| format!("{} {:?}", b.variable, b.access))
            .collect();
        wanted.sort();
        gotten.sort();
        assert_eq!(wanted, gotten, "{what}");
    }
    let of_described = described.iter().map(|command| {
        let buffers = command.resources.iter().filter(|r| !matches!(r.access, Access::Sampled | Access::Attachment));
        let uses = buffers.map(|r| Use { resource: r.name, access: r.access });
        (command.opens_pass, command.kind, uses.collect())
    });
    let of_recorded = recorded.iter().map(|command| {
        let uses = command.buffers.iter().map(|b| Use { resource: b.buffer.clone(), access: b.access });
        (command.opens_pass, command.kind, uses.collect())
    });
    for validates in [false, true] {
        let want = Commands::count(of_described.clone().collect(), validates);
        let got = Commands::count(of_recorded.clone().collect(), validates);
        for ((want, got), name) in want.iter().zip(&got).zip(&described_names) {
            assert_eq!(want, got, "{what}, validated: {validates}: {name}");
        }
    }
}

#[test]
fn described_frames_are_those_that_are_recorded() {
    let Some(gpu) = test_device() else { return };
    let scene = scene();
    let look = Appearance::of(&scene);
    let mut renderer = Renderer::new(&gpu, &scene).unwrap();
    let [outside, _] = poses(&scene);
    let [left, right] = eyes(&outside);
    let blends_quads = renderer.blends_quads();
    for cameras in [vec![outside], vec![left, right]] {
        for rasterizer in Rasterizer::ALL.into_iter().filter(|r| *r == Rasterizer::Tiles || blends_quads) {
            for depths in [false, true] {
                let options = WorkOptions { presented: true, ..options(rasterizer, depths) };
                let counting = Counting { depth_edge: COARSE, ..Counting::default() };
                let counts = count(&scene, &look, &cameras, counting).unwrap();
                let described = pass_table::commands(&Frame::of(&scene, &look, &cameras, &options), &counts);
                let (frame, copies): (Vec<_>, Vec<_>) =
                    described.into_iter().partition(|c| !matches!(c.pass, Pass::Present | Pass::DepthLayer));
                let what = format!("{rasterizer:?}, {} views, depths {depths}", cameras.len());
                agree(&frame, &record(&mut renderer, &cameras, options.settings), &what);
                let (drawn, commands) =
                    record_commands(options.validates, || renderer.draw(&cameras, &look, options.settings));
                drawn.unwrap();
                let work = frame_work(&scene, &look, &cameras, WorkOptions { presented: false, ..options }).unwrap();
                let Commands { barriers, .. } = commands;
                // Those of textures are not recorded.
                assert_eq!(Commands { barriers, ..work.commands() }, commands, "{what}");
                assert!(barriers <= work.commands().barriers, "{what}");
                agree(&copies, &record_present(&gpu, &renderer, depths), &format!("{what}, presented"));
            }
        }
    }
}

#[test]
fn lists_in_windows_are_described_too() {
    let Some(gpu) = test_device() else { return };
    let scene = scene();
    let look = Appearance::of(&scene);
    let short =
        Options { listed_pairs: 4096, multiview: Some(false), staged_blending: Some(true), ..Options::default() };
    let mut renderer = Renderer::with_options(&gpu, &scene, short).unwrap();
    let [outside, _] = poses(&scene).map(|camera| [camera]);
    let options = WorkOptions { renderer: short, ..options(Rasterizer::Tiles, false) };
    let counts = count(&scene, &look, &outside, Counting::default()).unwrap();
    let frame = Frame::of(&scene, &look, &outside, &options);
    assert!(frame.windows(&counts) > 2, "{counts:?}");
    let recorded = record(&mut renderer, &outside, options.settings);
    agree(&pass_table::commands(&frame, &counts), &recorded, "in windows");
}

/// With half resolution the commands stay, and the device evaluates what the cores count.
#[test]
fn half_resolution_changes_evaluations_and_no_command() {
    let Some(gpu) = test_device() else { return };
    let scene = scene();
    let look = Appearance::of(&scene);
    let mut renderer = Renderer::new(&gpu, &scene).unwrap();
    let [_, inside] = poses(&scene);
    let cameras = eyes(&inside);
    let foveation = Foveation::beyond(20);
    let whole = options(Rasterizer::Tiles, true);
    let foveated = WorkOptions { settings: Settings { foveation, ..whole.settings }, ..whole };
    let [before, after] = [whole, foveated].map(|o| frame_work(&scene, &look, &cameras, o).unwrap());
    let commands = record(&mut renderer, &cameras, foveated.settings);
    let frame = Frame::of(&scene, &look, &cameras, &foveated);
    agree(&pass_table::commands(&frame, &after.counts), &commands, "half resolution");
    assert_eq!(before.commands(), after.commands());
    assert!(after.counts.evaluated < before.counts.evaluated / 2, "{:?}", after.counts);
    let pixels = pixels_of_tiles(&gpu, commands.last_blend(), cameras.len());
    let evaluated: f64 = pixels.iter().map(|[steps, ..]| f64::from(*steps)).sum();
    close(evaluated as u64, after.counts.evaluated, 5e-3, "evaluated");
    let seconds = |work: &FrameWork| work.seconds(&Card::ALL[0]).iter().sum::<f64>();
    assert!(seconds(&after) < seconds(&before));
}

/// Whether two numbers agree within a share.
fn close(want: u64, got: u64, share: f64, what: &str) {
    let error = (want as f64 - got as f64).abs() / (want.max(1) as f64);
    assert!(error <= share, "{what}: the device {want}, the cores {got}, {:.3} % off", 100.0 * error);
}

#[test]
fn the_cores_count_what_a_device_lists_evaluates_and_blends() {
    let Some(gpu) = test_device() else { return };
    let scene = scene();
    let look = Appearance::of(&scene);
    let mut renderer = Renderer::new(&gpu, &scene).unwrap();
    for (camera, place) in poses(&scene).iter().zip(["outside", "inside"]) {
        for cameras in [vec![camera.clone()], eyes(camera).to_vec()] {
            let what = |what: &str| format!("{what}, {place}, {} views", cameras.len());
            let settings = options(Rasterizer::Tiles, false).settings;
            let stats = renderer.draw_complete(&cameras, &look, settings).unwrap();
            let counts = count(&scene, &look, &cameras, Counting::default()).unwrap();
            close(stats.listed.into(), counts.listed, 1e-3, &what("listed"));
            close(stats.tile_pairs.into(), counts.tile_pairs, 5e-3, &what("pairs"));
            let commands = record(&mut renderer, &cameras, settings);
            let pixels = pixels_of_tiles(&gpu, commands.last_blend(), cameras.len());
            let evaluated: f64 = pixels.iter().map(|[steps, ..]| f64::from(*steps)).sum();
            close(evaluated as u64, counts.evaluated, 5e-3, &what("evaluated"));
            if !renderer.blends_quads() {
                continue;
            }
            let counting = Counting { blending: Blending::Quads, ..Counting::default() };
            let counts = count(&scene, &look, &cameras, counting).unwrap();
            let commands = record(&mut renderer, &cameras, options(Rasterizer::Quads, false).settings);
            let fragments: f64 = (0..cameras.len()).map(|view| fragments(&gpu, commands.last_blend(), view)).sum();
            close(fragments as u64, counts.fragments, 5e-3, &what("fragments"));
        }
    }
}

#[test]
fn a_quarter_of_the_tiles_tells_the_evaluations_of_all() {
    let scene = scene();
    let look = Appearance::of(&scene);
    let camera = framing::default_camera(&scene, 1024, 768);
    let [all, some] = [1, 4].map(|sample| {
        let counting = Counting { sample, ..Counting::default() };
        count(&scene, &look, std::slice::from_ref(&camera), counting).unwrap()
    });
    assert_eq!((all.tile_pairs, all.longest_list), (some.tile_pairs, some.longest_list));
    close(all.evaluated, some.evaluated, 0.05, "all tiles and a quarter of them, evaluated");
    close(all.visited, some.visited, 0.05, "all tiles and a quarter of them, visited");
}

trait LastBlend {
    fn last_blend(&self) -> &RecordedCommand;
}

impl LastBlend for Vec<RecordedCommand> {
    fn last_blend(&self) -> &RecordedCommand {
        self.iter().rev().find(|command| command.entry == "blend").unwrap()
    }
}

/// The buffers of a recorded command by name. Names of other commands are leaked: they are few, and this is a test.
fn resources(command: &RecordedCommand) -> Resources<'_> {
    let buffers = command.buffers.iter().filter(|b| !b.variable.is_empty());
    buffers.fold(Resources::default(), |all, b| {
        let name: &'static str = Box::leak(Box::<str>::from(&*b.variable));
        all.and(&Resources::of([(name, &b.buffer)]))
    })
}

/// Blends the tiles again with a shader that stores the evaluations of each pixel in the place of red.
fn pixels_of_tiles(gpu: &Gpu, blend: &RecordedCommand, views: usize) -> Vec<[f32; 4]> {
    let text = crate::tile_shader::source(sg_raster::TILE as u32, PicturePrecision::Full);
    // The twin with copies in workgroup memory follows.
    let text = &text[..text.find("const STAGED").unwrap()];
    let changes = [
        ("    let part = part_of_list(group);", "    var steps = 0.0;\n    let part = part_of_list(group);"),
        ("let splat = pair_splats[k];", "let splat = pair_splats[k];\n        steps += 1.0;"),
        (
            "store_block(group.z, place, blended);",
            "pixels[pixel_of(group.z, place.at)] = vec4(steps, blended.color.xy, blended.transmittance);",
        ),
    ];
    let text = changes.iter().fold(text.to_owned(), |text, (from, to)| {
        assert_eq!(text.matches(from).count(), 1, "`{from}` in the text of tiles");
        text.replace(from, to)
    });
    let shader = Shader::new(gpu, "counting tiles", &[&text]);
    let kernel = Kernel::new(gpu, &shader, "blend", &[]);
    let stretch = gpu.uniform("stretch", &Stretch { index: 0, first_item: 0 });
    let count = views * (SIZE[0] * SIZE[1]) as usize;
    let pixels = gpu.storage("pixels", 16 * count as u64);
    let bound = kernel.bind(gpu, &resources(blend).with([("stretch", &stretch), ("pixels", &pixels)]));
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let [across, down] = SIZE.map(|pixels| pixels.div_ceil(sg_raster::TILE as u32));
    bound.run(&mut encoder.begin_compute_pass(&Default::default()), [across, down, views as u32]);
    gpu.submit([encoder.finish()]);
    bytemuck::pod_collect_to_vec(&gpu.read(&pixels, 16 * count as u64).unwrap())
}

/// Draws the quadrilaterals of a view again, each fragment as a one that is added. Returns their sum.
fn fragments(gpu: &Gpu, blend: &RecordedCommand, view: usize) -> f64 {
    let one = "@fragment fn one(in: Corner) -> @location(0) vec4<f32> { return vec4(1.0); }";
    let shader = Shader::new(gpu, "counting quads", &[include_str!("../shaders/quads.wgsl"), one]);
    let add = wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::One,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    };
    let format = wgpu::TextureFormat::R32Float;
    let target = wgpu::ColorTargetState {
        blend: Some(wgpu::BlendState { color: add, alpha: add }),
        ..wgpu::ColorTargetState::from(format)
    };
    let strip = wgpu::PrimitiveTopology::TriangleStrip;
    let constants = [("VIEW", view as f64)];
    let pipeline = DrawPipeline::new(gpu, (&shader, ["corner", "one"]), &constants, strip, target.into());
    let bound = pipeline.bind(gpu, &resources(blend));
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
    let texture = gpu.texture("fragments", (SIZE, 1), format, usage);
    let target = texture.create_view(&wgpu::TextureViewDescriptor::default());
    let arguments = &blend.buffers.iter().find(|b| b.access == Access::Indirect).unwrap().buffer;
    assert_eq!(blend.kind, Kind::DrawIndirect);
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Store },
            })],
            ..wgpu::RenderPassDescriptor::default()
        });
        bound.draw_indirect(&mut pass, arguments, std::mem::offset_of!(Dispatches, all_quads));
    }
    gpu.submit([encoder.finish()]);
    let bytes = texture_bytes(gpu, &texture, SIZE, 4).unwrap();
    bytemuck::pod_collect_to_vec::<u8, f32>(&bytes).iter().map(|x| f64::from(*x)).sum()
}
