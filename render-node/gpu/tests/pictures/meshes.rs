//! Meshes of the room in front of a picture and behind it, and holes in it.

use glam::{DMat4, DVec3, Vec3};
use sg_gpu::{DEPTH_FAR, DEPTH_NEAR, DepthLayer, Gpu, MeshCorner, MeshEye, MeshLayer, MeshLook, PlacedMesh, Present};
use sg_raster::image::Image;
use sg_scene::camera::Camera;

use crate::present::presented_under;
use crate::support::device;

/// Width and height of everything.
const SIZE: [u32; 2] = [64, 64];

/// A square from −½ to ½, facing +z.
fn square() -> Vec<MeshCorner> {
    let corner = |x: f32, y: f32| MeshCorner { position: Vec3::new(x, y, 0.0), normal: Vec3::Z };
    let [a, b, c, d] = [corner(-0.5, -0.5), corner(0.5, -0.5), corner(0.5, 0.5), corner(-0.5, 0.5)];
    vec![a, b, c, a, c, d]
}

/// A square at −z before the eye, this wide, facing it.
fn placed(look: MeshLook, z: f64, width: f64) -> PlacedMesh {
    PlacedMesh {
        mesh: 0,
        look,
        to_room: DMat4::from_translation(DVec3::new(0.0, 0.0, -z)) * DMat4::from_scale(DVec3::new(width, width, 1.0)),
        color: [0.8, 0.4, 0.0, 1.0],
        size: [width as f32; 2],
        softness: 0.01,
        ghost: 0.0,
        corner: 0.0,
    }
}

/// A grey picture of this opacity.
fn picture(opacity: f32) -> Image {
    Image { width: SIZE[0], height: SIZE[1], rgba: [0.5, 0.5, 0.5, opacity].repeat(64 * 64) }
}

/// Depths of the left and the right half.
fn depths(gpu: &Gpu, [left, right]: [f32; 2]) -> wgpu::Texture {
    let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
    let texture = gpu.texture("depths", (SIZE, 1), wgpu::TextureFormat::R32Float, usage);
    let row: Vec<u8> = (0..64).flat_map(|x| if x < 32 { left } else { right }.to_le_bytes()).collect();
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * 64), rows_per_image: None };
    gpu.queue().write_texture(texture.as_image_copy(), &row.repeat(64), layout, texture.size());
    texture
}

/// An eye at the room's origin that looks along −z, 90° wide.
fn camera() -> Camera {
    Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 90.0, SIZE[0], SIZE[1])
}

/// A scene to draw over: its opacity, its depths left and right, whether the surroundings are seen.
struct Case {
    opacity: f32,
    depths: [f32; 2],
    reveals: bool,
}

const SOLID_SCENE: Case = Case { opacity: 1.0, depths: [1.0, 3.0], reveals: false };

/// RGBA of a pixel in the middle of the left and of the right half, and of the right one in the upper right corner.
fn drawn(gpu: &Gpu, case: &Case, meshes: &[PlacedMesh]) -> [[u8; 4]; 3] {
    let (format, image) = (wgpu::TextureFormat::Rgba8Unorm, picture(case.opacity));
    let layer = MeshLayer::new(gpu, format, None, SIZE, &[square()]);
    let texture = Present::new(gpu, format).upload(&image);
    let (depths, camera) = (depths(gpu, case.depths), camera());
    let eye = MeshEye {
        camera: &camera,
        right: false,
        picture: &texture,
        depths: (&depths, SIZE),
        scale: 1.0,
        middle: DVec3::new(0.0, 0.0, -2.5),
        reveals: case.reveals,
    };
    let bytes = presented_under(gpu, &image, format, (SIZE, [0, 0, 64, 64]), |encoder, target| {
        layer.encode(encoder, target, &eye, meshes);
    });
    let at = |x: usize, y: usize| {
        let start = 4 * (64 * y + x);
        [0, 1, 2, 3].map(|k| bytes[start + k])
    };
    [at(16, 32), at(48, 32), at(62, 1)]
}

fn near(a: [u8; 4], b: [u8; 4]) -> bool {
    a.iter().zip(&b).all(|(a, b)| a.abs_diff(*b) <= 2)
}

const GREY: [u8; 4] = [128, 128, 128, 255];

#[test]
fn a_mesh_behind_the_scene_is_hidden_and_one_before_it_is_seen() {
    let Some(gpu) = device() else { return };
    let [left, right, corner] = drawn(&gpu, &SOLID_SCENE, &[placed(MeshLook::Solid, 2.0, 3.6)]);
    assert!(near(left, GREY) && near(corner, GREY), "{left:?} {corner:?}");
    // Lit from the eye: 0.45 + 0.3 of its colour, and a little less aside.
    assert!((140..=153).contains(&right[0]) && right[1].abs_diff(right[0] / 2) <= 1, "{right:?}");
    assert!(right[2] == 0 && right[3] == 255, "{right:?}");
    let ghost = PlacedMesh { ghost: 0.25, ..placed(MeshLook::Solid, 2.0, 3.6) };
    let [left, seen, _] = drawn(&gpu, &SOLID_SCENE, &[ghost]);
    assert_eq!(seen, right);
    assert!(near(left, [132, 114, 96, 255]), "a quarter of it over three of grey: {left:?}");
    // The nearer of two is in front in any order.
    let [far, close] = [2.5, 1.5].map(|z| placed(MeshLook::Solid, z, 4.0));
    let close = PlacedMesh { color: [0.0, 0.0, 1.0, 1.0], ..close };
    let orders = [[far, close], [close, far]].map(|meshes| drawn(&gpu, &SOLID_SCENE, &meshes)[1]);
    assert_eq!(orders[0], orders[1]);
    assert!(orders[0][0] == 0 && orders[0][2] > 170, "{orders:?}");
}

#[test]
fn a_hole_opens_the_picture_where_nothing_hides_it() {
    let Some(gpu) = device() else { return };
    let hole = placed(MeshLook::Hole, 2.0, 3.6);
    let [left, right, corner] = drawn(&gpu, &SOLID_SCENE, &[hole]);
    assert!(near(left, GREY) && near(corner, GREY), "{left:?} {corner:?}");
    assert_eq!(right, [0; 4]);
    // Through haze it shows by the transmittance; haze without a front lies at the scene's middle, here behind it.
    let haze = |depths| drawn(&gpu, &Case { opacity: 0.4, depths, reveals: false }, &[hole]);
    let [left, right, _] = haze([1.0, 0.0]);
    assert!(near(left, [51, 51, 51, 102]) && right == [0; 4], "{left:?} {right:?}");
    // At the same depth it is half open, and a mesh behind a hole does not close it.
    let soft = PlacedMesh { softness: 0.1, ..hole };
    let behind = placed(MeshLook::Solid, 2.4, 4.5);
    let [half, open, _] = drawn(&gpu, &Case { depths: [2.0, 3.0], ..SOLID_SCENE }, &[behind, soft]);
    assert!(near(half, [64, 64, 64, 127]) && open == [0; 4], "{half:?} {open:?}");
    // A rounded corner stays closed: this hole is a disc.
    let disc = PlacedMesh { corner: 2.0, ..placed(MeshLook::Hole, 2.0, 4.0) };
    let [_, open, corner] = drawn(&gpu, &SOLID_SCENE, &[disc]);
    assert!(open == [0; 4] && near(corner, GREY), "{open:?} {corner:?}");
}

#[test]
fn a_ball_shines_where_it_meets_the_scene_and_meshes_that_are_not_there_draw_nothing() {
    let Some(gpu) = device() else { return };
    let ball = |z| PlacedMesh { size: [1.0, 1.0], softness: 0.5, ..placed(MeshLook::Ball, z, 6.0) };
    let [_, away, _] = drawn(&gpu, &SOLID_SCENE, &[ball(2.0)]);
    let [_, meets, _] = drawn(&gpu, &SOLID_SCENE, &[ball(3.0)]);
    assert!(away[0].abs_diff(128) < 20 && meets[0] > away[0] + 10, "{away:?} {meets:?}");
    let none = PlacedMesh { mesh: 7, ..placed(MeshLook::Solid, 0.5, 9.0) };
    let broken = PlacedMesh { to_room: DMat4::NAN, ..placed(MeshLook::Solid, 0.5, 9.0) };
    assert!(drawn(&gpu, &SOLID_SCENE, &[none, broken]).into_iter().all(|pixel| near(pixel, GREY)));
    let many = vec![placed(MeshLook::Solid, 2.0, 3.6); sg_gpu::MOST_MESHES + 50];
    assert_eq!(drawn(&gpu, &SOLID_SCENE, &many), drawn(&gpu, &SOLID_SCENE, &many[..1]));
}

#[test]
fn the_surroundings_show_where_the_scene_is_not() {
    let Some(gpu) = device() else { return };
    let case = Case { opacity: 0.25, depths: [1.0, 3.0], reveals: true };
    let [left, right, _] = drawn(&gpu, &case, &[]);
    assert!(near(left, [128, 128, 128, 64]) && left == right, "{left:?} {right:?}");
    let [left, right, _] = drawn(&gpu, &case, &[placed(MeshLook::Solid, 2.0, 3.6)]);
    assert!(right[3] == 255 && near([0, 0, 0, left[3]], [0, 0, 0, 207]), "a hand is seen too: {left:?} {right:?}");
}

#[test]
fn depths_for_the_headset_have_the_meshes_before_the_scene() {
    let Some(gpu) = device() else { return };
    let format = wgpu::TextureFormat::Depth32Float;
    let layer = MeshLayer::new(&gpu, wgpu::TextureFormat::Rgba8Unorm, Some(format), SIZE, &[square()]);
    let image = picture(1.0);
    let texture = Present::new(&gpu, wgpu::TextureFormat::Rgba8Unorm).upload(&image);
    let (of_scene, camera) = (depths(&gpu, [1.0, 3.0]), camera());
    let eye = MeshEye {
        camera: &camera,
        right: true,
        picture: &texture,
        depths: (&of_scene, SIZE),
        scale: 1.0,
        middle: DVec3::new(0.0, 0.0, -2.5),
        reveals: false,
    };
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
    let target = gpu.texture("depth image", (SIZE, 1), format, usage);
    let color = gpu.texture("picture", (SIZE, 1), wgpu::TextureFormat::Rgba8Unorm, usage);
    let [view, color] = [&target, &color].map(|t| t.create_view(&wgpu::TextureViewDescriptor::default()));
    let read = gpu.device().create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: 4 * 64 * 64,
        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let meshes = [placed(MeshLook::Solid, 2.0, 3.6), placed(MeshLook::Beam, 0.5, 9.0)];
    let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    layer.encode(&mut encoder, &color, &eye, &meshes);
    DepthLayer::new(&gpu, format).encode(&mut encoder, (&of_scene, SIZE), (&view, SIZE), 1.0);
    layer.encode_depths(&mut encoder, &view, &eye, &meshes);
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * 64), rows_per_image: None };
    let to = wgpu::TexelCopyBufferInfo { buffer: &read, layout };
    encoder.copy_texture_to_buffer(target.as_image_copy(), to, target.size());
    gpu.submit([encoder.finish()]);
    read.map_async(wgpu::MapMode::Read, .., Result::unwrap);
    gpu.device().poll(wgpu::PollType::wait_indefinitely()).unwrap();
    gpu.check().unwrap();
    let values: Vec<f32> = bytemuck::pod_collect_to_vec(&read.get_mapped_range(..).unwrap());
    let stored = |metres: f32| DEPTH_FAR / (DEPTH_FAR - DEPTH_NEAR) * (1.0 - DEPTH_NEAR / metres);
    for (x, y, metres) in [(16, 32, 1.0), (48, 32, 2.0), (62, 1, 3.0)] {
        let value = values[64 * y + x];
        assert!((value - stored(metres)).abs() < 1e-5, "{x}, {y}: {value}, not {}", stored(metres));
    }
}
