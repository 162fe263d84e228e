//! Pictures put onto a target, against their PNG.

use glam::{DVec3, Vec3};
use sg_gpu::{Gpu, Present, Vignette};
use sg_raster::finish::{Backdrop, Finish, Gradient};
use sg_raster::image::Image;
use sg_scene::camera::Camera;

use crate::support::device;

/// The bytes of a presented picture, RGBA row by row. Widths must be multiples of 64.
fn presented(gpu: &Gpu, image: &Image, format: wgpu::TextureFormat, size: [u32; 2], area: [u32; 4]) -> Vec<u8> {
    presented_under(gpu, image, format, (size, area), |_, _| ())
}

/// The bytes of a presented picture with a last step over the background `plain`.
fn finished(gpu: &Gpu, image: &Image, format: wgpu::TextureFormat, plain: Vec3, finish: &Finish) -> Vec<u8> {
    let size = [image.width, image.height];
    let mut present = Present::new(gpu, format);
    present.set_finish(plain, finish);
    presented_by(&mut present, gpu, image, format, (size, [0, 0, size[0], size[1]]), |_, _| ())
}

/// As [`presented`], with the drawing of `over` on top.
pub(crate) fn presented_under(
    gpu: &Gpu,
    image: &Image,
    format: wgpu::TextureFormat,
    ([width, height], area): ([u32; 2], [u32; 4]),
    over: impl FnOnce(&mut wgpu::CommandEncoder, &wgpu::TextureView),
) -> Vec<u8> {
    presented_by(&mut Present::new(gpu, format), gpu, image, format, ([width, height], area), over)
}

fn presented_by(
    present: &mut Present,
    gpu: &Gpu,
    image: &Image,
    format: wgpu::TextureFormat,
    ([width, height], area): ([u32; 2], [u32; 4]),
    over: impl FnOnce(&mut wgpu::CommandEncoder, &wgpu::TextureView),
) -> Vec<u8> {
    let target = gpu.device().create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let read = gpu.device().create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(4 * width * height),
        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let picture = present.upload(image);
    let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let view = target.create_view(&wgpu::TextureViewDescriptor::default());
    present.encode(&mut encoder, &picture, &view, area, wgpu::LoadOp::Clear(wgpu::Color::BLACK));
    over(&mut encoder, &view);
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * width), rows_per_image: None };
    encoder.copy_texture_to_buffer(
        target.as_image_copy(),
        wgpu::TexelCopyBufferInfo { buffer: &read, layout },
        target.size(),
    );
    gpu.queue().submit([encoder.finish()]);
    read.map_async(wgpu::MapMode::Read, .., Result::unwrap);
    gpu.device().poll(wgpu::PollType::wait_indefinitely()).unwrap();
    gpu.check().unwrap();
    read.get_mapped_range(..).unwrap().to_vec()
}

/// Every byte value, halves between them, and values outside 0 to 1.
fn ramp() -> Image {
    let value = |k: u32| (k as f32 / 2.0 - 8.0) / 255.0;
    let rgba = (0..64 * 9).flat_map(|k| [value(k), value(576 - k), 0.2, 0.5]).collect();
    Image { width: 64, height: 9, rgba }
}

#[test]
fn a_last_step_stores_what_the_finished_png_does() {
    let Some(gpu) = device() else { return };
    let mut image = ramp();
    // Every coverage beside every value.
    image.rgba.chunks_exact_mut(4).zip(0_u32..).for_each(|(pixel, k)| pixel[3] = (k * 7 % 64) as f32 / 63.0);
    let plain = Vec3::new(0.1, 0.0, 0.3);
    let gradient = Gradient { top: Vec3::new(0.4, 0.45, 0.5), bottom: Vec3::splat(0.02) };
    let both = Finish { backdrop: Backdrop::Gradient(gradient), dither: true };
    for finish in [both, Finish { dither: false, ..both }, Finish { backdrop: Backdrop::Plain, ..both }] {
        let wanted = image.finished_rgb8(plain, &finish);
        for format in [wgpu::TextureFormat::Rgba8Unorm, wgpu::TextureFormat::Rgba8UnormSrgb] {
            let stored = finished(&gpu, &image, format, plain, &finish);
            let pairs = stored.chunks_exact(4).zip(wanted.chunks_exact(3));
            let off: Vec<u8> =
                pairs.flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).collect::<Vec<_>>()).collect();
            let different = off.iter().filter(|d| **d > 0).count();
            // A value at a threshold goes either way: every second one of the ramp lies halfway. Linear values of an sRGB target are
            // rounded twice.
            let most = if format.is_srgb() { off.len() / 8 } else { off.len() / 25 };
            assert!(off.iter().all(|d| *d <= 1), "{format:?} {finish:?}");
            assert!(different <= most, "{format:?} {finish:?}: {different} of {} differ", off.len());
        }
    }
}

#[test]
fn a_target_of_the_pictures_size_stores_what_its_png_does() {
    let Some(gpu) = device() else { return };
    let image = ramp();
    let png = image.rgb8();
    for format in [wgpu::TextureFormat::Rgba8Unorm, wgpu::TextureFormat::Rgba8UnormSrgb] {
        let stored = presented(&gpu, &image, format, [64, 9], [0, 0, 64, 9]);
        for (k, (pixel, wanted)) in stored.chunks_exact(4).zip(png.chunks_exact(3)).enumerate() {
            // Halves are rounded either way; the curve and its inverse in f32 add less than that.
            let off = pixel.iter().zip(wanted).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
            let whole = k % 2 == 0;
            assert!(off <= u8::from(!whole || format.is_srgb()), "{format:?} {k}: {pixel:?}, not {wanted:?}");
            assert_eq!(pixel[3], 255);
        }
    }
}

#[test]
fn an_area_of_another_size_is_filled_and_the_rest_is_cleared() {
    let Some(gpu) = device() else { return };
    let rgba = [[0.0, 0.2, 1.0, 1.0], [1.0, 0.2, 0.0, 1.0]].concat();
    let image = Image { width: 2, height: 1, rgba };
    let stored = presented(&gpu, &image, wgpu::TextureFormat::Rgba8Unorm, [64, 32], [8, 4, 32, 16]);
    let pixel = |x: usize, y: usize| &stored[4 * (64 * y + x)..][..3];
    for (x, y) in [(7, 10), (40, 10), (20, 3), (20, 20)] {
        assert_eq!(pixel(x, y), [0, 0, 0], "{x}, {y}");
    }
    assert_eq!(pixel(8, 4), [0, 51, 255]);
    assert_eq!(pixel(39, 19), [255, 51, 0]);
    // Between the two pixels' middles the colour goes evenly.
    let across: Vec<u8> = (8..40).map(|x| pixel(x, 10)[0]).collect();
    assert!(across.is_sorted(), "{across:?}");
    assert!(across[15].abs_diff(127) < 9 && across[16].abs_diff(127) < 9, "{across:?}");
}

#[test]
fn an_image_with_fewer_numbers_than_its_size_is_one_black_pixel() {
    let Some(gpu) = device() else { return };
    let image = Image { width: 8, height: 8, rgba: vec![1.0; 12] };
    let stored = presented(&gpu, &image, wgpu::TextureFormat::Rgba8Unorm, [64, 2], [0, 0, 64, 2]);
    assert!(stored.chunks_exact(4).all(|p| p == [0, 0, 0, 255]));
}

#[test]
fn a_vignette_darkens_the_edge_and_not_the_centre() {
    let Some(gpu) = device() else { return };
    let image = Image { width: 1, height: 1, rgba: vec![1.0; 4] };
    // Straight ahead is off the middle, as for eyes in a headset; the picture reaches to 63° on its right.
    let camera = Camera {
        cx: 24.0,
        cy: 32.0,
        fx: 20.0,
        fy: 20.0,
        ..Camera::look_at(DVec3::ZERO, DVec3::Z, DVec3::Y, 90.0, 64, 64)
    };
    let format = wgpu::TextureFormat::Rgba8UnormSrgb;
    let vignette = Vignette::new(&gpu, format);
    let seen = |strength: f64| {
        presented_under(&gpu, &image, format, ([64, 64], [0, 0, 64, 64]), |encoder, view| {
            vignette.encode(encoder, view, &camera, true, strength);
        })
    };
    let pixel = |bytes: &[u8], x: usize| -> [u8; 4] { bytes[4 * (64 * 32 + x)..][..4].try_into().unwrap() };
    for nothing in [0.0, -1.0, f64::NAN] {
        assert!(seen(nothing).iter().all(|b| *b == 255));
    }
    let (whole, half) = (seen(1.0), seen(0.5));
    assert_eq!(pixel(&whole, 24), [255; 4], "straight ahead");
    assert_eq!(pixel(&whole, 30), [255; 4], "17 degrees off");
    assert_eq!(pixel(&whole, 60), [0, 0, 0, 255], "61 degrees off");
    // In linear light half is left. The curve stores it as 188.
    assert!(pixel(&half, 60)[..3].iter().all(|b| b.abs_diff(188) <= 1), "{:?}", pixel(&half, 60));
    let across: Vec<u8> = (24..64).map(|x| pixel(&whole, x)[0]).collect();
    assert!(across.is_sorted_by(|a, b| a >= b), "{across:?}");
}
