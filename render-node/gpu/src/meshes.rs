//! Meshes in the room around a scene: hands, pointers, brushes, a floor, and holes for panels behind the picture.
//!
//! One pass for each eye draws over its finished picture. A depth buffer orders the meshes among themselves. Against the
//! scene each fragment compares its depth with the picture's depths ([`crate::Renderer::depths`]). A fragment behind the
//! scene's front keeps the share that the scene's opacity leaves over.

use std::ops::Range;
use std::sync::Arc;

use glam::{DMat4, DVec3, UVec2, Vec2, Vec3, Vec4};
use sg_scene::camera::Camera;

use crate::depth_layer::{DEPTH_FAR, DEPTH_NEAR};
use crate::device::Gpu;
use crate::kept_bindings::KeptBindings;
use crate::pipeline::{BoundDraw, DrawPipeline, DrawTargets, depth_state};
use crate::resources::Resources;
use crate::shader::Shader;
use crate::shader_layout::{
    self, MESH_BALL, MESH_BEAM, MESH_FLOOR, MESH_HOLE, MESH_SOLID, MeshCorner as Corner, MeshItem,
};

/// Most placed meshes of one frame; further ones are not drawn.
pub const MOST_MESHES: usize = 256;

/// Format of the depth buffer of the meshes.
const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// A corner of a triangle of a mesh, in the mesh's own unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshCorner {
    /// Position.
    pub position: Vec3,
    /// Direction away from the surface; any length above 0.
    pub normal: Vec3,
}

/// The look of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeshLook {
    /// A lit surface that hides meshes behind it.
    Solid,
    /// A bright beam whose edges fade. It hides nothing.
    Beam,
    /// A transparent ball with a bright rim, brighter where it meets the scene. It hides nothing.
    Ball,
    /// A floor of the rectangle from −½ to ½ in x and y of its mesh. It has lines every 25 cm and every metre, which fade with the
    /// distance from its middle, and a tint up to the horizon. It hides nothing.
    Floor,
    /// A hole in the picture of the rectangle from −½ to ½ in x and y of its mesh. A layer behind the picture shows there.
    /// It hides meshes behind it.
    Hole,
}

impl MeshLook {
    fn number(self) -> u32 {
        match self {
            Self::Solid => MESH_SOLID,
            Self::Beam => MESH_BEAM,
            Self::Ball => MESH_BALL,
            Self::Floor => MESH_FLOOR,
            Self::Hole => MESH_HOLE,
        }
    }

    /// Whether it hides meshes behind it.
    fn hides(self) -> bool {
        matches!(self, Self::Solid | Self::Hole)
    }
}

/// A mesh at a place of the room. Lengths in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacedMesh {
    /// Number of the mesh, as given to [`MeshLayer::new`].
    pub mesh: usize,
    /// Its look.
    pub look: MeshLook,
    /// Transform from the mesh to the room.
    pub to_room: DMat4,
    /// Red, green, blue as a picture stores them, and opacity, 0 to 1.
    pub color: [f32; 4],
    /// Width and height of a floor or a hole; the radius of a ball, twice.
    pub size: [f32; 2],
    /// Half the depth around the scene's front over which it fades out.
    pub softness: f32,
    /// Least share of it that is seen through the scene, 0 to 1.
    pub ghost: f32,
    /// Radius of a hole's corners.
    pub corner: f32,
}

/// An eye to draw meshes for, and its finished picture.
#[derive(Debug, Clone, Copy)]
pub struct MeshEye<'a> {
    /// The eye as a camera of the room: the world is the room, in metres. Its size is that of the drawn part of the picture.
    pub camera: &'a Camera,
    /// Whether it is the right eye. Encode each eye once for each submission.
    pub right: bool,
    /// The picture as [`crate::Renderer::pictures`] has it: its fourth number is the scene's opacity.
    pub picture: &'a wgpu::Texture,
    /// The depths as [`crate::Renderer::depths`] has them, and the width and height of their drawn part.
    pub depths: (&'a wgpu::Texture, [u32; 2]),
    /// Metres for each unit of depth.
    pub scale: f64,
    /// The scene's middle in the room. Haze without a front counts as lying there.
    pub middle: DVec3,
    /// Whether the target's opacity becomes that of the scene, for a headset that shows the surroundings.
    pub reveals: bool,
}

/// Draws meshes over both eyes' pictures on targets of one format.
///
/// The target's opacity is 1 after [`crate::Present`], and less where a hole was made. Colours have premultiplied opacity.
#[derive(Debug)]
pub struct MeshLayer {
    gpu: Gpu,
    corners: wgpu::Buffer,
    /// Corners of each mesh.
    meshes: Vec<Range<u32>>,
    /// Pipelines of what hides meshes behind it, of what does not, and of holes.
    solid: DrawPipeline,
    clear: DrawPipeline,
    hole: DrawPipeline,
    reveal: DrawPipeline,
    /// Stores depths in a headset's depth image.
    keep_depth: Option<DrawPipeline>,
    /// Uniform and items of each eye.
    eyes: [(wgpu::Buffer, wgpu::Buffer); 2],
    /// The pipelines of each eye, bound to its picture and its depths.
    bindings: [KeptBindings<2, MeshBindings>; 2],
    depth_buffer: wgpu::TextureView,
}

/// The pipelines of [`MeshLayer`], bound.
#[derive(Debug)]
struct MeshBindings {
    solid: BoundDraw,
    clear: BoundDraw,
    hole: BoundDraw,
    reveal: BoundDraw,
    keep_depth: Option<BoundDraw>,
}

/// Successive items with one mesh and one pipeline.
struct Batch {
    items: Range<u32>,
    mesh: usize,
    look: MeshLook,
}

impl MeshLayer {
    /// Uploads meshes, each a list of triangles. `format` is the target's, a blendable format, `depth_format` that of the
    /// headset's depth images, if there are any. `size` is the greatest width and height of a target.
    #[must_use]
    pub fn new(
        gpu: &Gpu,
        format: wgpu::TextureFormat,
        depth_format: Option<wgpu::TextureFormat>,
        size: [u32; 2],
        meshes: &[Vec<MeshCorner>],
    ) -> Self {
        let shader = Shader::new(gpu, "meshes", &[include_str!("shaders/meshes.wgsl")]);
        let constants = [("CURVED", f64::from(u8::from(format.is_srgb())))];
        let triangles = wgpu::PrimitiveTopology::TriangleList;
        let pipeline = |entries, targets| DrawPipeline::new(gpu, (&shader, entries), &constants, triangles, targets);
        let color = |blend, write_mask| Some(wgpu::ColorTargetState { format, blend, write_mask });
        let depth = |write| Some(depth_state(DEPTH_FORMAT, write, wgpu::CompareFunction::Less));
        let over = Some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING);
        let all = wgpu::ColorWrites::ALL;
        let drawn = |write| DrawTargets { color: color(over, all), depth: depth(write), ..DrawTargets::default() };
        let away = wgpu::BlendComponent {
            src_factor: wgpu::BlendFactor::Zero,
            dst_factor: wgpu::BlendFactor::OneMinusSrcAlpha,
            operation: wgpu::BlendOperation::Add,
        };
        let away = Some(wgpu::BlendState { color: away, alpha: away });
        let ranges = meshes.iter().scan(0, |first, mesh| {
            let range = *first..*first + mesh.len() as u32;
            *first = range.end;
            Some(range)
        });
        let corners: Vec<Corner> =
            meshes.iter().flatten().map(|c| Corner { position: c.position, normal: c.normal }).collect();
        let eyes = [0, 1].map(|_| {
            let items = vec![MeshItem::default(); MOST_MESHES];
            (gpu.uniform("eye of meshes", &shader_layout::MeshEye::default()), gpu.table("placed meshes", &items))
        });
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let depth_buffer = gpu.texture("depths of meshes", (size.map(|s| s.max(1)), 1), DEPTH_FORMAT, usage);
        Self {
            gpu: gpu.clone(),
            corners: gpu.table("meshes", &corners),
            meshes: ranges.collect(),
            solid: pipeline(["place", "shade"], drawn(true)),
            clear: pipeline(["place", "shade"], drawn(false)),
            hole: pipeline(
                ["place", "open"],
                DrawTargets { color: color(away, all), depth: depth(true), ..DrawTargets::default() },
            ),
            reveal: pipeline(
                ["cover", "reveal"],
                DrawTargets { color: color(None, wgpu::ColorWrites::ALPHA), ..DrawTargets::default() },
            ),
            keep_depth: depth_format.map(|format| {
                let depth = Some(depth_state(format, true, wgpu::CompareFunction::Less));
                pipeline(["place", "keep_depth"], DrawTargets { depth, ..DrawTargets::default() })
            }),
            eyes,
            bindings: Default::default(),
            depth_buffer: depth_buffer.create_view(&wgpu::TextureViewDescriptor::default()),
        }
    }

    /// Draws `placed` over the upper left part of `target`, in their order. The caller puts a floor first, then solids, then
    /// holes, then beams and balls. A mesh that is not there or not finite is not drawn.
    pub fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        target: &wgpu::TextureView,
        eye: &MeshEye<'_>,
        placed: &[PlacedMesh],
    ) {
        let batches = self.write(eye, placed);
        let bound = self.bound(eye);
        if eye.reveals {
            let mut pass = begin(encoder, "coverage", Some(target), None);
            pass.set_scissor_rect(0, 0, eye.camera.width, eye.camera.height);
            bound.reveal.draw_full_screen(&mut pass);
        }
        let mut batches = batches.peekable();
        if batches.peek().is_none() {
            return;
        }
        let ops = wgpu::Operations { load: wgpu::LoadOp::Clear(1.0), store: wgpu::StoreOp::Discard };
        let depth = Some((&self.depth_buffer, ops));
        let draws = |look| match look {
            MeshLook::Solid => &bound.solid,
            MeshLook::Hole => &bound.hole,
            MeshLook::Beam | MeshLook::Ball | MeshLook::Floor => &bound.clear,
        };
        self.draw(begin(encoder, "meshes", Some(target), depth), eye, batches, draws);
    }

    /// Stores the depths of the meshes of the last [`Self::encode`] of this eye in a headset's depth image, where they are in
    /// front of the scene. That image holds the scene's depths already ([`crate::DepthLayer`]).
    pub fn encode_depths(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        target: &wgpu::TextureView,
        eye: &MeshEye<'_>,
        placed: &[PlacedMesh],
    ) {
        let bound = self.bound(eye);
        let Some(draw) = &bound.keep_depth else { return };
        let mut batches = self.batches(placed).filter(|b| b.look.hides()).peekable();
        if batches.peek().is_none() {
            return;
        }
        let ops = wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store };
        self.draw(begin(encoder, "depths of meshes", None, Some((target, ops))), eye, batches, |_| draw);
    }

    /// The pipelines, bound to the picture and the depths of an eye.
    fn bound(&self, eye: &MeshEye<'_>) -> Arc<MeshBindings> {
        let k = usize::from(eye.right);
        self.bindings[k].get([eye.picture, eye.depths.0], |[picture, depths]| {
            let (uniform, items) = &self.eyes[k];
            let resources = Resources::of([("eye", uniform), ("corners", &self.corners), ("items", items)])
                .and(&Resources::of_textures([("picture", &picture), ("depths", &depths)]));
            let bind = |pipeline: &DrawPipeline| pipeline.bind(&self.gpu, &resources);
            MeshBindings {
                solid: bind(&self.solid),
                clear: bind(&self.clear),
                hole: bind(&self.hole),
                reveal: bind(&self.reveal),
                keep_depth: self.keep_depth.as_ref().map(bind),
            }
        })
    }

    fn draw<'a>(
        &self,
        mut pass: wgpu::RenderPass<'_>,
        eye: &MeshEye<'_>,
        batches: impl Iterator<Item = Batch>,
        draw: impl Fn(MeshLook) -> &'a BoundDraw,
    ) {
        let (width, height) = (eye.camera.width, eye.camera.height);
        pass.set_viewport(0.0, 0.0, width as f32, height as f32, 0.0, 1.0);
        pass.set_scissor_rect(0, 0, width, height);
        for Batch { items, mesh, look } in batches {
            if let Some(corners) = self.meshes.get(mesh) {
                draw(look).draw_instances(&mut pass, corners.clone(), items);
            }
        }
    }

    /// Writes an eye and its items for the device.
    fn write<'a>(&self, eye: &MeshEye<'_>, placed: &'a [PlacedMesh]) -> impl Iterator<Item = Batch> + use<'a> {
        let camera = eye.camera;
        let view = camera.view();
        let size = |n: u32| f64::from(n.max(1));
        let (width, height) = (size(camera.width), size(camera.height));
        let uniform = shader_layout::MeshEye {
            up: view.transform_vector3(DVec3::Y).as_vec3(),
            focal: Vec2::new((2.0 * camera.fx / width) as f32, (2.0 * camera.fy / height) as f32),
            middle: Vec2::new((2.0 * camera.cx / width - 1.0) as f32, (2.0 * camera.cy / height - 1.0) as f32),
            part: UVec2::new(camera.width, camera.height),
            depth_part: UVec2::from(eye.depths.1),
            scale: eye.scale as f32,
            haze: view.transform_point3(eye.middle).z as f32,
            nearest: DEPTH_NEAR,
            farthest: DEPTH_FAR,
        };
        let (to, table) = &self.eyes[usize::from(eye.right)];
        self.gpu.write_uniform(to, &uniform);
        self.gpu.write_table(table, self.drawn(placed).map(|mesh| item(&view, mesh)));
        self.batches(placed)
    }

    /// Those that are drawn, in their order.
    fn drawn<'a>(&self, placed: &'a [PlacedMesh]) -> impl Iterator<Item = &'a PlacedMesh> + use<'a> {
        let count = self.meshes.len();
        placed.iter().filter(move |mesh| mesh.mesh < count && mesh.to_room.is_finite()).take(MOST_MESHES)
    }

    fn batches<'a>(&self, placed: &'a [PlacedMesh]) -> impl Iterator<Item = Batch> + use<'a> {
        let mut drawn = (0_u32..).zip(self.drawn(placed)).peekable();
        std::iter::from_fn(move || {
            let (first, &PlacedMesh { mesh, look, .. }) = drawn.next()?;
            let mut items = first..first + 1;
            while drawn.next_if(|(_, next)| next.mesh == mesh && next.look == look).is_some() {
                items.end += 1;
            }
            Some(Batch { items, mesh, look })
        })
    }
}

/// A mesh relative to an eye. The products are made in f64.
fn item(view: &DMat4, mesh: &PlacedMesh) -> MeshItem {
    let to_eye = (*view * mesh.to_room).transpose();
    MeshItem {
        right: to_eye.x_axis.as_vec4(),
        down: to_eye.y_axis.as_vec4(),
        forward: to_eye.z_axis.as_vec4(),
        color: Vec4::from(mesh.color),
        size: Vec2::from(mesh.size),
        look: mesh.look.number(),
        softness: mesh.softness.max(1e-5),
        ghost: mesh.ghost.clamp(0.0, 1.0),
        corner: mesh.corner,
    }
}

fn begin<'e>(
    encoder: &'e mut wgpu::CommandEncoder,
    label: &'static str,
    target: Option<&wgpu::TextureView>,
    depth: Option<(&wgpu::TextureView, wgpu::Operations<f32>)>,
) -> wgpu::RenderPass<'e> {
    let color = target.map(|view| wgpu::RenderPassColorAttachment {
        view,
        depth_slice: None,
        resolve_target: None,
        ops: wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store },
    });
    let colors = [color];
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some(label),
        color_attachments: if target.is_some() { &colors } else { &[] },
        depth_stencil_attachment: depth.map(|(view, ops)| wgpu::RenderPassDepthStencilAttachment {
            view,
            depth_ops: Some(ops),
            stencil_ops: None,
        }),
        ..wgpu::RenderPassDescriptor::default()
    })
}
