//! Structs and numbers that Rust shares with the shaders, each declared once.
//!
//! [`declarations`] is their WGSL text, the beginning of every shader.

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DMat4, DVec3, Mat3, UVec2, Vec2, Vec3, Vec4};
use sg_raster::{foveation, nearness};
use sg_scene::appearance::ShadingTerm;
use sg_scene::camera::Camera;
use sg_scene::model::ShadingModel;

use crate::wgsl::{shared_constants, shared_structs};

/// All declarations in WGSL.
pub(super) fn declarations() -> String {
    [constant_declarations(), struct_declarations()].concat()
}

shared_constants! {
    /// Lanes of a workgroup. Passes with another size say so.
    LANES: u32 = 256;
    /// Number of Gaussians in one block of the list: one workgroup marks it.
    BLOCK: u32 = 1024;
    /// Words of the marks of one block, a bit for each Gaussian.
    MARK_WORDS: u32 = BLOCK / u32::BITS;
    /// Lanes of a workgroup of the projection.
    PROJECT_LANES: u32 = 64;
    /// Number of keys that one workgroup sorts.
    SORT_BLOCK: u32 = 4096;
    /// Bits of a key that one pass sorts by.
    SORT_BITS: u32 = 4;
    /// Number of pairs of a Gaussian and a tile that one workgroup goes through.
    PAIR_BLOCK: u32 = 1024;
    /// Numbers that one workgroup sums at a time.
    SCAN_BLOCK: u32 = 4096;
    /// Tiles beyond which a workgroup lists a splat's pairs, not one lane.
    LARGE_TILES: u32 = 256;
    /// Most splats of which a workgroup lists the pairs, as many as one dispatch has. One lane each lists those beyond.
    LARGE_ITEMS: u32 = 65_535;
    /// Splats of one tile that one dispatch blends. A software device silently leaves a loop after 65,535 iterations.
    STRETCH: u32 = 32_768;
    /// Number of bands of quadrilaterals, near to far. Each band except the first is as long as all bands before it.
    BANDS: u32 = 5;
    /// Edge in picture pixels of one depth pixel of the quadrilaterals.
    COARSE: u32 = 4;
    /// [`foveation::BLOCK`].
    FOVEAL_BLOCK: u32 = foveation::BLOCK as u32;
    /// [`foveation::BLOCK_VARIANCE`] in the units of `Ellipse` and `Level`: √(½·log₂e) over `per_row` is a standard deviation.
    FOVEAL_VARIANCE: f32 = (foveation::BLOCK_VARIANCE / (0.5 * std::f64::consts::LOG2_E)) as f32;
    /// Accumulated opacity at which a pixel has a surface.
    SURFACE: f32 = sg_raster::pick::SURFACE as f32;
    /// Numbers of a Gaussian's shading columns: offset color, normal, ka, kd, ks, exponent.
    SURFACE_NUMBERS: u32 = 10;

    /// [`nearness::NEAR_BLUR`].
    NEAR_BLUR: f32 = nearness::NEAR_BLUR as f32;
    /// [`nearness::FADE_WIDTH`].
    FADE_WIDTH: f32 = nearness::FADE_WIDTH as f32;
    /// [`nearness::FADE_REACH`].
    FADE_REACH: f32 = nearness::FADE_REACH as f32;
    /// [`nearness::AFFINE_SIZE`].
    AFFINE_SIZE: f32 = nearness::AFFINE_SIZE as f32;
    /// [`sg_raster::CUT_REACH`].
    CUT_REACH: f32 = sg_raster::CUT_REACH as f32;
    /// [`nearness::STEEP`].
    STEEP: f32 = nearness::STEEP as f32;
    /// Start of [`nearness::RAY_RANGE`].
    RAY_BEGINS: f32 = nearness::RAY_RANGE[0] as f32;
    /// End of [`nearness::RAY_RANGE`].
    RAY_ENDS: f32 = nearness::RAY_RANGE[1] as f32;

    /// [`ShadingModel::Paper`].
    SHADING_PAPER: u32 = 0;
    /// [`ShadingModel::IvrgsTrain`].
    SHADING_IVRGS_TRAIN: u32 = 1;
    /// [`ShadingModel::IvrgsViewer`].
    SHADING_IVRGS_VIEWER: u32 = 2;

    /// [`ShadingTerm::Full`].
    TERM_FULL: u32 = 0;
    /// [`ShadingTerm::Normal`].
    TERM_NORMAL: u32 = 1;
    /// [`ShadingTerm::Ambient`].
    TERM_AMBIENT: u32 = 2;
    /// [`ShadingTerm::Diffuse`].
    TERM_DIFFUSE: u32 = 3;
    /// [`ShadingTerm::Specular`].
    TERM_SPECULAR: u32 = 4;

    /// A lit surface.
    MESH_SOLID: u32 = 0;
    /// A bright beam.
    MESH_BEAM: u32 = 1;
    /// A transparent ball.
    MESH_BALL: u32 = 2;
    /// A floor.
    MESH_FLOOR: u32 = 3;
    /// A hole in the picture.
    MESH_HOLE: u32 = 4;

    /// A base unit's colors are its palette color.
    COLOR_PALETTE: u32 = 0;
    /// A base unit's colors come from shading columns.
    COLOR_LIT: u32 = 1;
    /// A base unit's colors come from spherical harmonics.
    COLOR_HARMONICS: u32 = 2;
}

/// Number of a shading model in the shaders.
pub(super) fn shading_model_number(model: ShadingModel) -> u32 {
    match model {
        ShadingModel::Paper => SHADING_PAPER,
        ShadingModel::IvrgsTrain => SHADING_IVRGS_TRAIN,
        ShadingModel::IvrgsViewer => SHADING_IVRGS_VIEWER,
    }
}

/// Number of a shading term in the shaders.
pub(super) fn shading_term_number(term: ShadingTerm) -> u32 {
    match term {
        ShadingTerm::Full => TERM_FULL,
        ShadingTerm::Normal => TERM_NORMAL,
        ShadingTerm::Ambient => TERM_AMBIENT,
        ShadingTerm::Diffuse => TERM_DIFFUSE,
        ShadingTerm::Specular => TERM_SPECULAR,
    }
}

// Truth values are 1 and 0: a buffer cannot hold a bool.
shared_structs! {
    /// One camera.
    pub(super) struct View {
        /// Rows of the rotation from the scene frame to the camera frame: x right.
        right: Vec3,
        /// y down.
        down: Vec3,
        /// z forward.
        forward: Vec3,
        /// Position of the eye relative to the origin of the stored centers.
        eye: Vec3,
        /// Rounding rest of that position.
        eye_rest: Vec3,
        /// Focal lengths in pixels.
        focal: Vec2,
        /// Principal point in pixels.
        principal: Vec2,
    }

    /// The numbers of a frame for every pass.
    pub(super) struct Frame {
        views: [View; 2],
        /// Eye of the shared shading, relative to the origin of the stored centers.
        shading_eye: Vec3,
        /// Whether all views have the shading of that eye.
        shared_shading: u32,
        /// Unit vector towards the light, or zero; unused for a headlight.
        light: Vec3,
        view_count: u32,
        highlight_color: Vec3,
        /// Share of the highlight's color.
        highlight_mix: f32,
        background: Vec3,
        /// The highlight's factor on the opacity.
        highlight_opacity: f32,
        /// Least alpha that is drawn.
        least_alpha: f32,
        /// Ratio of that alpha to the opacity of a faint Gaussian.
        alpha_ratio: f32,
        /// Transmittance at which a pixel is finished.
        least_transmittance: f32,
        /// Least depth of an ellipse's center.
        near_plane: f32,
        /// Distance from the eye within which Gaussians fade.
        near: f32,
        /// Variance of the dilation on the optical axis, px².
        dilation: f32,
        /// Share of it whose area the opacity keeps: 1, and less in a preview.
        kept_dilation: f32,
        /// Width and height of the picture.
        size: UVec2,
        /// Tiles across and down.
        tiles: UVec2,
        /// Number of Gaussians that can be listed at once.
        capacity: u32,
        /// Number of pairs of a Gaussian and a tile that can be listed at once.
        pair_capacity: u32,
        /// Number of editable units with a mask.
        edit_count: u32,
        /// Words of one mask.
        mask_words: u32,
        /// Number of half-spaces of all clips.
        clip_side_count: u32,
        /// Eye of the first view: 0 left, 1 right.
        first_eye: u32,
        /// Whether the visibility mask may hide tiles.
        hides_tiles: u32,
        /// Least bits of a depth in the order.
        order_begins: u32,
        /// Lowest bits of a depth that the order leaves out.
        order_shift: u32,
        /// Squared slope of rays beyond which tiles have half the resolution.
        foveal_squared_slope: f32,
    }

    /// The last step of a presented picture: [`sg_raster::finish::Finish`].
    pub(super) struct LastStep {
        /// Background at the upper edge.
        top: Vec3,
        /// Whether a gradient replaces the background.
        gradient: u32,
        /// Background at the lower edge.
        bottom: Vec3,
        /// Whether colors are dithered.
        dither: u32,
        /// Background over which the picture was drawn.
        plain: Vec3,
    }

    /// A range of Gaussians with buffers of its own.
    pub(super) struct Part {
        /// Scene-wide index of the first Gaussian.
        first: u32,
        count: u32,
        index: u32,
        /// Index of the first block.
        first_block: u32,
    }

    /// A base unit.
    pub(super) struct Unit {
        /// Linear part of its transform.
        linear: Mat3,
        /// Inverse of that part, for the direction that its harmonics are seen from.
        inverse: Mat3,
        palette: Vec3,
        /// Factor on the opacity.
        opacity: f32,
        /// Factors on ka, kd, ks and the exponent.
        multipliers: Vec4,
        /// Greatest stretch of the transform.
        stretch: f32,
        /// `SHADING_…`.
        shading_model: u32,
        /// `COLOR_…`.
        color_source: u32,
        visible: u32,
        /// Whether the dilation takes as much opacity as it adds area.
        compensated: u32,
    }

    /// An editable unit.
    pub(super) struct Edit {
        color: Vec3,
        /// Factor on the opacity.
        opacity: f32,
        /// Whether the color replaces those of the Gaussians.
        colored: u32,
        visible: u32,
        /// Factors on saturation and brightness, and temperature.
        tone: Vec3,
    }

    /// A half-space of a clip, relative to the origin of the stored centers.
    pub(super) struct ClipSide {
        /// Inner normal, of unit length.
        normal: Vec3,
        /// Least product of the normal and a point inside.
        offset: f32,
        /// Whether the clip keeps its inside.
        keep_inside: u32,
        /// Whether this is the clip's last side.
        last: u32,
    }

    /// Center of a Gaussian, relative to the origin of the stored centers.
    #[derive(Pod, Zeroable)]
    pub(super) struct Center {
        position: Vec3,
        opacity: f32,
    }

    /// Shape of a Gaussian.
    #[derive(Pod, Zeroable)]
    pub(super) struct Shape {
        /// Unit quaternion: x, y, z, w.
        rotation: Vec4,
        /// Standard deviations along its axes.
        scale: Vec3,
        /// Index of its base unit.
        unit: u32,
    }

    /// The listed Gaussians of a part.
    pub(super) struct PartRange {
        /// First place in the list.
        first: u32,
        count: u32,
    }

    /// Counts of a frame.
    pub(super) struct Totals {
        /// Number of Gaussians in the list.
        listed: u32,
        /// Number of Gaussians that may be visible, listed or not.
        marked: u32,
        /// Number of pairs of a Gaussian and a tile in the current window.
        window_pairs: u32,
        /// Number of such pairs in all.
        pairs: u32,
    }

    /// Arguments of an indirect dispatch: workgroups each way.
    pub(super) struct DispatchArguments {
        x: u32,
        y: u32,
        z: u32,
    }

    /// Arguments of an indirect draw.
    pub(super) struct DrawArguments {
        vertex_count: u32,
        instance_count: u32,
        first_vertex: u32,
        first_instance: u32,
    }

    /// Indirect arguments of a frame.
    pub(super) struct Dispatches {
        /// Sort by depth.
        depth_sort: DispatchArguments,
        /// Passes that list pairs.
        tile_lists: DispatchArguments,
        /// All quadrilaterals.
        all_quads: DrawArguments,
        /// The bands of quadrilaterals.
        bands: [DrawArguments; BANDS as usize],
    }

    /// Indirect arguments of a window of pairs.
    pub(super) struct PairDispatches {
        /// Sort by tile.
        sort: DispatchArguments,
        /// Passes over all pairs.
        pairs: DispatchArguments,
        /// Pass over the large splats.
        large: DispatchArguments,
    }

    /// Outline of a projected Gaussian: a disc of (u, v), u = per_column·(x − slope·y) and v = per_row·y, x and y in pixels from
    /// the center.
    pub(super) struct Ellipse {
        /// Pixels.
        center: Vec2,
        slope: f32,
        per_column: f32,
    }

    /// Opacity of a projected Gaussian.
    pub(super) struct Level {
        per_row: f32,
        /// log2 of the opacity.
        log_opacity: f32,
        /// log2 of the opacity over the least alpha: the squared radius of the disc. Below 0 it is not drawn.
        range: f32,
        /// View z, at least 0. In the ray-consistent mode the value of V at the stored pixel.
        depth: f32,
    }

    /// Color of a projected Gaussian.
    pub(super) struct Tint {
        color: Vec3,
        /// V of a ray per row of pixels, in the ray-consistent mode. In the affine mode the place of its [`NearRay`] from 1 on,
        /// or 0 for an ellipse.
        over_per_row: f32,
    }

    /// Coefficients of a Gaussian's rays in the ray-consistent mode. The depth is depth_factor·a / (a² + U² + V²). The
    /// depth factor of one that may fade is negative.
    pub(super) struct RayCoefficients {
        /// a: its value at the stored pixel, per column, per row.
        along: Vec3,
        /// ½·log2(e)·|u|².
        fall: f32,
        /// U: its value at the stored pixel, per column, per row.
        across: Vec3,
        depth_factor: f32,
    }

    /// A Gaussian of the affine mode that rays evaluate: [`RayCoefficients`], and V at the stored pixel and per row. The depth
    /// factor of one that may fade is negative.
    pub(super) struct NearRay {
        along: Vec3,
        fall: f32,
        across: Vec3,
        depth_factor: f32,
        over: Vec2,
    }

    /// A window of pairs of a splat and a tile: one that the buffers hold.
    pub(super) struct Window {
        /// Index of the first pair.
        first_pair: u32,
        index: u32,
    }

    /// A dispatch that blends a stretch of each tile's list.
    pub(super) struct Stretch {
        /// Number of dispatches before this one. From the second on, blending continues with the stored pixels.
        index: u32,
        /// First place in the list.
        first_item: u32,
    }

    /// The pairs of one tile.
    pub(super) struct TileList {
        first: u32,
        end: u32,
    }

    /// A pass of a sort.
    pub(super) struct SortPass {
        /// Number of lower bits.
        shift: u32,
    }

    /// A corner of a triangle of the visibility mask.
    pub(super) struct MaskCorner {
        /// Shares of the picture's width and height from the upper left.
        at: Vec2,
        view: u32,
    }

    /// Conversion of depths to a headset's depth image.
    pub(super) struct DepthRange {
        /// Metres for each unit of the scene.
        scale: f32,
        /// Near plane in metres.
        nearest: f32,
        /// Far plane in metres.
        farthest: f32,
    }

    /// A vignette of an eye.
    pub(super) struct VignetteShape {
        /// Pixel of the straight-ahead direction.
        middle: Vec2,
        /// Pixels for each unit of the tangent of the angle from there.
        focal: Vec2,
        /// Tangent of the angle at which it begins.
        begins: f32,
        /// Tangent of the angle from which on it is whole.
        whole: f32,
        /// Share of the light that it takes there.
        strength: f32,
    }

    /// An eye that meshes of the room are drawn for. Lengths in metres.
    pub(super) struct MeshEye {
        /// Direction upwards in the axes of the eye: x right, y down, z forward.
        up: Vec3,
        /// Twice the focal lengths over the picture's width and height.
        focal: Vec2,
        /// Shift of the straight-ahead direction from the picture's middle, in halves of its width and height.
        middle: Vec2,
        /// Width and height of the drawn part of the picture, and of that of its depths.
        part: UVec2,
        depth_part: UVec2,
        /// Metres for each unit of depth.
        scale: f32,
        /// Depth of a scene without a front.
        haze: f32,
        nearest: f32,
        farthest: f32,
    }

    /// A corner of a triangle of a mesh.
    pub(super) struct MeshCorner {
        position: Vec3,
        normal: Vec3,
    }

    /// One placed mesh.
    pub(super) struct MeshItem {
        /// Rows of the transform from the mesh to the axes of the eye.
        right: Vec4,
        down: Vec4,
        forward: Vec4,
        /// Red, green, blue as a picture stores them, and opacity.
        color: Vec4,
        /// Width and height of a rectangle, or the radius.
        size: Vec2,
        /// `MESH_…`.
        look: u32,
        /// Metres around the scene's front within which it fades.
        softness: f32,
        /// Share of it that is seen through the scene.
        ghost: f32,
        /// Radius of a rectangle's corners.
        corner: f32,
    }
}

impl View {
    /// The camera relative to `origin`, the origin of the stored centers. The difference is taken in f64.
    pub(super) fn of(camera: &Camera, origin: DVec3) -> Self {
        let rotation = DMat3::from_mat4(camera.view()).transpose();
        let exact = camera.eye() - origin;
        let eye = exact.as_vec3();
        Self {
            right: rotation.x_axis.as_vec3(),
            down: rotation.y_axis.as_vec3(),
            forward: rotation.z_axis.as_vec3(),
            eye,
            eye_rest: (exact - eye.as_dvec3()).as_vec3(),
            focal: Vec2::new(camera.fx as f32, camera.fy as f32),
            principal: Vec2::new(camera.cx as f32, camera.cy as f32),
        }
    }
}

impl Unit {
    /// The linear part of an affine transform, its greatest stretch, and its inverse. As in the CPU renderer, a singular
    /// transform has the identity as its inverse.
    pub(super) fn of_transform(transform: DMat4) -> Self {
        let linear = DMat3::from_mat4(transform);
        let determinant = linear.determinant();
        let inverse = if determinant != 0.0 && determinant.is_finite() { linear.inverse() } else { DMat3::IDENTITY };
        // At least the greatest singular value: the Frobenius norm.
        let stretch =
            (linear.x_axis.length_squared() + linear.y_axis.length_squared() + linear.z_axis.length_squared()).sqrt();
        Self {
            linear: linear.as_mat3(),
            inverse: inverse.as_mat3(),
            stretch: if linear == DMat3::IDENTITY { 1.0 } else { stretch as f32 },
            ..Self::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use wgpu::naga::front::wgsl::parse_str;
    use wgpu::naga::{Module, TypeInner};

    use super::*;

    fn struct_of(module: &Module, name: &str) -> (Vec<(String, u64)>, u64) {
        let found = module.types.iter().find(|(_, kind)| kind.name.as_deref() == Some(name));
        let TypeInner::Struct { members, span } = &found.unwrap().1.inner else { panic!("{name} is no struct") };
        (members.iter().map(|m| (m.name.clone().unwrap(), m.offset.into())).collect(), u64::from(*span))
    }

    #[test]
    fn both_sides_agree_on_every_offset() {
        let module = parse_str(&declarations()).unwrap();
        for layout in struct_layouts() {
            let (members, span) = struct_of(&module, layout.name);
            let ours: Vec<(String, u64)> = layout.members.iter().map(|(m, at)| ((*m).to_owned(), *at)).collect();
            assert_eq!((members, span), (ours, layout.size), "{}", layout.name);
        }
    }

    /// The device reads indirect arguments, and Rust uploads columns, without encase.
    #[test]
    fn structs_without_padding_have_the_layout_of_rust() {
        let same = |rust: usize, wgsl: std::num::NonZeroU64| assert_eq!(rust as u64, wgsl.get());
        same(size_of::<Dispatches>(), <Dispatches as encase::ShaderSize>::SHADER_SIZE);
        same(size_of::<PairDispatches>(), <PairDispatches as encase::ShaderSize>::SHADER_SIZE);
        let center = Center { position: Vec3::new(1.0, 2.0, 3.0), opacity: 0.5 };
        let bytes = encase::StorageBuffer::<Vec<u8>>::content_of::<_, Vec<u8>>(&center).unwrap();
        assert_eq!(bytes, bytemuck::bytes_of(&center));
        let shape = Shape { rotation: Vec4::new(0.1, 0.2, 0.3, 0.4), scale: Vec3::new(5.0, 6.0, 7.0), unit: 8 };
        let bytes = encase::StorageBuffer::<Vec<u8>>::content_of::<_, Vec<u8>>(&shape).unwrap();
        assert_eq!(bytes, bytemuck::bytes_of(&shape));
    }
}
