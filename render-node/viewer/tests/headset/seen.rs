//! A person's view: the runtime's composited picture of a real scene and a panel, against one that was looked at.

use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::{DQuat, DVec2, DVec3};
use sg_formats::load::{LoadOptions, load};
use sg_gpu::{Present, Rasterizer, Renderer, Settings};
use sg_raster::render::Quality;
use sg_scene::appearance::Appearance;
use sg_scene::camera::Light;
use sg_scene::framing;
use sg_viewer::hands::{Placement, Pose, Rectangle, Stance};
use sg_viewer::xr::{FrameOutcome, Headset, Options, PAUSE, PanelLayer, XrError};

use winit::event_loop::EventLoop;
use winit::platform::x11::EventLoopBuilderExtX11;

use crate::NEAR;
use crate::monado::{Display, Puppet, Runtime, Screen, is_inside, is_there, run_inside, run_inside_beside};

/// Of the screen, and so of the committed picture. The runtime fills it with both eyes.
const SIZE: [u32; 2] = [960, 540];

pub(crate) fn data() -> Option<PathBuf> {
    let folder = std::env::var_os("SUPERGAUSSIAN_DATA").map(PathBuf::from);
    if folder.is_none() {
        let required = std::env::var("SUPERGAUSSIAN_REQUIRE_DATA").is_ok_and(|v| v == "1");
        assert!(!required, "SUPERGAUSSIAN_DATA must name the folder of the real data");
        println!("SKIPPED: a real scene in a headset; set SUPERGAUSSIAN_DATA to the folder of the real data");
    }
    folder
}

#[test]
fn a_real_scene_and_a_panel_are_composited() {
    if data().is_some() {
        run_inside("seen::inside_a_real_scene_and_a_panel_are_composited");
    }
}

#[test]
#[ignore = "run by the test without `inside`"]
fn inside_a_real_scene_and_a_panel_are_composited() {
    if !is_inside() {
        return;
    }
    let path = data().unwrap().join("splats/donut_fused.ply");
    let scene = load(&path, &LoadOptions::default()).unwrap().scene;
    let screen = Screen::start(SIZE);
    let _runtime = Runtime::start(&Display::X(&screen));
    let _puppet = Puppet::connect();
    let mut headset = Headset::open(Options { resolution: 0.3, ..Options::default() }).unwrap();
    let gpu = headset.gpu().unwrap().clone();
    let format = headset.format().unwrap();
    println!("{:?}, {} Gaussians, {:?} pixels each eye, {format:?}", headset.names(), scene.len(), headset.size());

    let mut renderer = Renderer::new(&gpu, &scene).unwrap();
    let present = Present::new(&gpu, format);
    let mut appearance = Appearance::of(&scene);
    appearance.background = glam::Vec3::splat(0.2);
    let bounds = framing::visible_box(&scene);
    let placement = Placement::fit(bounds, DVec3::NEG_Y, DVec3::NEG_Z, Stance::Standing, headset.origin()).turned(
        DVec3::new(0.0, 1.2, -0.8),
        DVec3::X,
        0.3,
    );
    let settings = Settings { quality: Quality::Standard, rasterizer: Rasterizer::Quads, ..Settings::default() };
    let pose = Pose { position: DVec3::new(0.3, 1.72, -0.8), orientation: DQuat::from_rotation_y(-0.3) };
    let mut board = PanelLayer::new(egui::vec2(240.0, 160.0), 1.5, Rectangle { pose, size: DVec2::new(0.6, 0.4) });
    let mut opacity = 0.7;

    let begun = Instant::now();
    let mut shown = 0;
    while shown < 3 {
        assert!(begun.elapsed().as_secs() < 60, "{shown} frames in a minute");
        let step = headset.frame(|frame| {
            let cameras = frame.eyes.map(|eye| {
                eye.camera(frame.size(), &placement, NEAR, appearance.background.to_array(), Light::default())
            });
            renderer.draw(&cameras, &appearance, settings).unwrap();
            let [width, height] = frame.size();
            frame.draw_eyes(|targets| {
                let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
                let clear = wgpu::LoadOp::Clear(wgpu::Color::BLACK);
                for (picture, target) in renderer.pictures().iter().zip(targets) {
                    present.encode(&mut encoder, picture, target, [0, 0, width, height], clear);
                }
                gpu.queue().submit([encoder.finish()]);
            })?;
            board.show(frame, None, Vec::new(), false, |ui| {
                egui::Frame::central_panel(ui.style()).show(ui, |ui| {
                    ui.heading("Super-Gaussian");
                    ui.label("Icing, with an opacity of");
                    ui.add(egui::Slider::new(&mut opacity, 0.0..=1.0));
                    let _ = ui.button("Save the unit");
                    ui.take_available_space();
                });
            })?;
            Ok::<(), XrError>(())
        });
        match step.unwrap() {
            FrameOutcome::Shown => shown += 1,
            _ => std::thread::sleep(PAUSE),
        }
    }
    println!("{shown} frames in {:?}; {:?}", begun.elapsed(), headset.timing());
    std::thread::sleep(std::time::Duration::from_millis(200));
    let (width, height, rgb) = screen.picture();
    assert_eq!([width, height], SIZE);
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/headset/seen.png");
    if std::env::var_os("SUPERGAUSSIAN_PICTURES").is_some_and(|v| v == "write") {
        write(&committed, SIZE, &rgb);
    }
    compare(&committed, &rgb);
}

/// The runtime shows the drawn part of the images over the whole view, and nothing of the rest.
#[test]
fn a_part_of_the_images_fills_the_view() {
    run_inside("seen::inside_a_part_of_the_images_fills_the_view");
}

#[test]
#[ignore = "run by the test without `inside`"]
fn inside_a_part_of_the_images_fills_the_view() {
    if !is_inside() {
        return;
    }
    let screen = Screen::start(SIZE);
    let _runtime = Runtime::start(&Display::X(&screen));
    let _puppet = Puppet::connect();
    let mut headset = Headset::open(Options { resolution: 0.3, ..Options::default() }).unwrap();
    let gpu = headset.gpu().unwrap().clone();
    let mut present = Present::new(&gpu, headset.format().unwrap());
    // Makes frames until the screen shows them, and counts the pixels of a colour and those of the rest of the images.
    let mut seen = |channel: usize, part: fn(u32) -> u32| {
        let rgba = [0, 1, 2, 3].map(|k| if k == channel || k == 3 { 1.0 } else { 0.0 }).to_vec();
        let picture = present.upload(&sg_raster::image::Image { width: 1, height: 1, rgba });
        let begun = Instant::now();
        let mut after = 0;
        loop {
            assert!(begun.elapsed().as_secs() < 90, "the screen shows something else");
            let step = headset.frame(|frame| {
                let part = frame.size().map(part);
                frame.draw_eyes_and_depths(part, |targets, _| {
                    let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
                    for target in targets {
                        let rest = wgpu::LoadOp::Clear(wgpu::Color::RED);
                        present.encode(&mut encoder, &picture, target, [0, 0, part[0], part[1]], rest);
                    }
                    gpu.submit([encoder.finish()]);
                })?;
                assert_eq!(frame.part(), part);
                Ok::<(), XrError>(())
            });
            if step.unwrap() != FrameOutcome::Shown {
                std::thread::sleep(PAUSE);
                continue;
            }
            let (_, _, rgb) = screen.picture();
            let count = |is: &dyn Fn(&[u8]) -> bool| rgb.chunks_exact(3).filter(|p| is(p)).count();
            let counts = [count(&|p| p[channel] > 200 && p[0] < 50), count(&|p| p[0] > 100)];
            after += u32::from(counts[0] > 50_000);
            if after > 3 {
                return counts;
            }
        }
    };
    let [whole, none] = seen(1, |pixels| pixels);
    let [half, red] = seen(2, |pixels| pixels / 2);
    println!("{whole} pixels of whole images, {half} of halves; {none} and {red} of the rest");
    // The edge of the part may be blended with what lies beyond it.
    let edge = (SIZE[0] + SIZE[1]) as usize * 4;
    assert!(none == 0 && red <= edge && half + edge >= whole && half <= whole + edge);
    gpu.check().unwrap();
}

/// A window shows the headset's content on the headset's own device.
#[test]
fn a_window_mirrors_the_headset() {
    if !is_there() {
        return;
    }
    let screen = Screen::start([320, 240]);
    run_inside_beside("seen::inside_a_window_mirrors_the_headset", Some(&screen));
}

#[test]
#[ignore = "run by the test without `inside`"]
#[allow(deprecated, reason = "a window without a loop of its own is all that is needed here")]
fn inside_a_window_mirrors_the_headset() {
    if !is_inside() {
        return;
    }
    let _runtime = Runtime::start(&Display::None);
    let _puppet = Puppet::connect();
    let mut headset = Headset::open(Options::default()).unwrap();
    let gpu = headset.gpu().unwrap().clone();
    let events = EventLoop::builder().with_any_thread(true).build().unwrap();
    let size = winit::dpi::PhysicalSize::new(320, 240);
    let window = events.create_window(winit::window::Window::default_attributes().with_inner_size(size)).unwrap();
    let (instance, adapter) = headset.instance_and_adapter().unwrap();
    let surface = instance.create_surface(std::sync::Arc::new(window)).unwrap();
    let mut config = surface.get_default_config(adapter, 320, 240).unwrap();
    config.usage |= wgpu::TextureUsages::COPY_SRC;
    surface.configure(gpu.device(), &config);
    let present = Present::new(&gpu, headset.format().unwrap());
    let mirror = Present::new(&gpu, config.format);
    let mut upload = Present::new(&gpu, config.format);
    let picture = upload.upload(&sg_raster::image::Image { width: 1, height: 1, rgba: vec![0.2, 0.4, 0.6, 1.0] });
    let clear = wgpu::LoadOp::Clear(wgpu::Color::BLACK);
    let mut shown = None;
    let begun = Instant::now();
    while shown.is_none() {
        assert!(begun.elapsed().as_secs() < 20, "nothing to mirror");
        let step = headset.frame(|frame| {
            let [width, height] = frame.size();
            frame.draw_eyes(|targets| {
                let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
                for target in targets {
                    present.encode(&mut encoder, &picture, target, [0, 0, width, height], clear);
                }
                gpu.queue().submit([encoder.finish()]);
            })?;
            let wgpu::CurrentSurfaceTexture::Success(image) = surface.get_current_texture() else { return Ok(()) };
            let view = image.texture.create_view(&wgpu::TextureViewDescriptor::default());
            let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            mirror.encode(&mut encoder, &picture, &view, [0, 0, config.width, config.height], clear);
            let read = gpu.device().create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size: 256,
                usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            encoder.copy_texture_to_buffer(
                image.texture.as_image_copy(),
                wgpu::TexelCopyBufferInfo { buffer: &read, layout: wgpu::TexelCopyBufferLayout::default() },
                wgpu::Extent3d { width: 1, height: 1, depth_or_array_layers: 1 },
            );
            gpu.queue().submit([encoder.finish()]);
            read.map_async(wgpu::MapMode::Read, .., Result::unwrap);
            gpu.device().poll(wgpu::PollType::wait_indefinitely()).unwrap();
            let pixel: [u8; 4] = read.get_mapped_range(..).unwrap()[..4].try_into().unwrap();
            gpu.queue().present(image);
            shown = Some(pixel);
            Ok::<(), XrError>(())
        });
        if step.unwrap() != FrameOutcome::Shown {
            std::thread::sleep(PAUSE);
        }
    }
    let pixel = shown.unwrap();
    println!("{:?}: {pixel:?}", config.format);
    assert!(pixel == [51, 102, 153, 255] || pixel == [153, 102, 51, 255], "{pixel:?}");
    gpu.check().unwrap();
}

pub(crate) fn write(path: &Path, [width, height]: [u32; 2], rgb: &[u8]) {
    let file = std::fs::File::create(path).unwrap();
    let mut encoder = png::Encoder::new(file, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    encoder.write_header().unwrap().write_image_data(rgb).unwrap();
}

/// Whether the picture is the committed one. The mean difference over all numbers is at most 1 of 255. At most one number in a
/// hundred is off by more than 12. Drivers round differently, and the runtime warps a picture to the newest head pose.
pub(crate) fn compare(committed: &Path, rgb: &[u8]) {
    let mut reader =
        png::Decoder::new(std::io::BufReader::new(std::fs::File::open(committed).unwrap())).read_info().unwrap();
    let mut wanted = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut wanted).unwrap();
    assert_eq!(wanted.len(), rgb.len());
    let off = |(a, b): (&u8, &u8)| u64::from(a.abs_diff(*b));
    let sum: u64 = rgb.iter().zip(&wanted).map(off).sum();
    let far = rgb.iter().zip(&wanted).map(off).filter(|d| *d > 12).count();
    let (mean, share) = (sum as f64 / rgb.len() as f64, far as f64 / rgb.len() as f64);
    println!("composited picture: mean difference {mean:.4} of 255, {:.4} % off by more than 12", 100.0 * share);
    assert!(mean <= 1.0 && share <= 0.01, "mean {mean}, {share} far off; see SUPERGAUSSIAN_PICTURES=write");
}
