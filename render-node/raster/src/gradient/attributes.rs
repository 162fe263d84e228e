//! From derivatives by ellipse, opacity and colour on the picture to those by the stored attributes of a Gaussian.

use glam::{DMat3, DVec2, DVec3};
use sg_scene::affine::NormalTransform;
use sg_scene::appearance::{Appearance, BaseAppearance};
use sg_scene::camera::{Camera, LightMode};
use sg_scene::model::{BaseUnit, ShadingModel};

use crate::cut::{Cutter, Shape};
use crate::gradient::cut::{ByShape, backward};
use crate::gradient::lighting::by_surface;
use crate::gradient::tile::SUMS;
use crate::gradient::{GaussianGradient, is_compensated};
use crate::project::Ellipse;
use crate::ray_consistent::Pinhole;
use crate::shading::Surface;

/// What the Gaussians of one base unit share in one picture.
pub(super) struct UnitChain<'a> {
    unit: &'a BaseUnit,
    palette: DVec3,
    /// Where the shading model holds the palette within 0 and 1, a palette outside has no derivative.
    palette_open: DVec3,
    opacity: f64,
    multipliers: [f64; 4],
    light: Option<DVec3>,
    eye: DVec3,
    linear: DMat3,
    scene_to_view: DMat3,
    local_to_view: DMat3,
    cutter: Cutter,
    normals: NormalTransform,
    focal: DVec2,
    /// Variance in px² that the opacity makes up for; `None` with the plain filter.
    compensated: Option<f64>,
}

impl<'a> UnitChain<'a> {
    pub(super) fn new(unit: &'a BaseUnit, base: BaseAppearance, appearance: &Appearance, camera: &Camera) -> Self {
        let (light, palette) = (&appearance.light, base.palette.as_dvec3());
        let (palette, palette_open) = match unit.shading {
            ShadingModel::Paper => (palette, DVec3::ONE),
            ShadingModel::IvrgsTrain | ShadingModel::IvrgsViewer => {
                let held = palette.clamp(DVec3::ZERO, DVec3::ONE);
                (held, DVec3::select(held.cmpeq(palette), DVec3::ONE, DVec3::ZERO))
            }
        };
        let linear = DMat3::from_mat4(unit.transform);
        let scene_to_view = DMat3::from_mat4(camera.view());
        let [ka, kd, ks, shininess] = base.multipliers.map(f64::from);
        Self {
            unit,
            palette,
            palette_open,
            opacity: f64::from(base.opacity),
            multipliers: [
                ka * f64::from(light.ka),
                kd * f64::from(light.kd),
                ks * f64::from(light.ks),
                shininess * f64::from(light.shininess),
            ],
            light: match light.mode {
                LightMode::Headlight => None,
                LightMode::Direction => Some(DVec3::from_array(light.direction.map(f64::from)).normalize_or_zero()),
            },
            eye: camera.eye(),
            linear,
            scene_to_view,
            local_to_view: scene_to_view * linear,
            cutter: Cutter::of(appearance, scene_to_view, camera.eye()),
            normals: NormalTransform::of(linear),
            focal: Pinhole::of(camera).focal,
            compensated: is_compensated(unit, appearance).then(|| Pinhole::of(camera).dilation),
        }
    }

    /// The derivatives of the unit's Gaussian `i`, and those by the palette. `None` if a column does not have it.
    pub(super) fn gradient(
        &self,
        i: usize,
        ellipse: &Ellipse,
        sums: &[f64; SUMS],
    ) -> Option<(GaussianGradient, DVec3)> {
        let gaussians = &self.unit.gaussians;
        let position = self.unit.transform.transform_point3(gaussians.position.get(i)?.as_dvec3());
        let [.., red, green, blue] = *sums;
        let mut found = GaussianGradient::default();
        // ∂ ln o/∂ logit = 1 − σ, unless the factor of the unit has reached opacity 1.
        let sigmoid = 1.0 / (1.0 + (-f64::from(*gaussians.opacity_logit.get(i)?)).exp());
        let opacity = self.opacity * sigmoid;
        let (by_place, by_log_opacity) = self.shape(i, position, opacity.min(1.0), ellipse, sums, &mut found)?;
        let by_color = DVec3::new(red, green, blue);
        let (by_position, by_palette) = self.shading(i, position, by_color, &mut found)?;
        found.position = self.linear.transpose() * (self.scene_to_view.transpose() * by_place + by_position);
        found.opacity_logit = if opacity < 1.0 { by_log_opacity * (1.0 - sigmoid) } else { 0.0 };
        Some((found, by_palette))
    }

    /// Rotation and scale; returns the derivatives by the centre in view axes, and that by the logarithm of the opacity.
    fn shape(
        &self,
        i: usize,
        position: DVec3,
        opacity: f64,
        ellipse: &Ellipse,
        [g, gu, gv, guu, guv, gvv, ..]: &[f64; SUMS],
        found: &mut GaussianGradient,
    ) -> Option<(DVec3, f64)> {
        let Ellipse { slope, along_row, over_rows, .. } = *ellipse;
        let c = over_rows * over_rows;
        // With ln α = ln o − ½(u² + v²), v = (y − my)/σ and u = (x − mx − slope·(y − my))/ρ.
        let by_center = DVec2::new(gu / along_row, gv / over_rows - slope * gu / along_row);
        let on_screen = by_center.length();
        let by_slope = guv * over_rows / along_row;
        let (by_along, by_over) = (guu / along_row, gvv / over_rows);
        // Of the covariance ((a, b), (b, c)): σ² = c, slope = b/c, ρ² = a − b²/c.
        let by_a = by_along / (2.0 * along_row);
        let by_b = by_slope / c - by_along * slope / along_row;
        let by_c = by_over / (2.0 * over_rows) - by_slope * slope / c + by_along * slope * slope / (2.0 * along_row);

        let gaussians = &self.unit.gaussians;
        let scale = gaussians.log_scale.get(i)?.as_dvec3().exp();
        let axes = DMat3::from_quat(gaussians.unit_rotation(i));
        let scaled = DMat3::from_cols(axes.x_axis * scale.x, axes.y_axis * scale.y, axes.z_axis * scale.z);
        let DMat3 { x_axis, y_axis, z_axis } = (self.local_to_view * scaled).transpose();
        let whole = Shape { center: self.scene_to_view * (position - self.eye), rows: [x_axis, y_axis, z_axis] };
        let cut = self.cutter.cut(whole)?;
        let Shape { center, rows: [x, y, z] } = cut.shape;
        let (on_plane, pixels) = (center.truncate() / center.z, self.focal / center.z);
        let m = [pixels.x * (x - on_plane.x * z), pixels.y * (y - on_plane.y * z)];
        let mut by_m = [2.0 * by_a * m[0] + by_b * m[1], 2.0 * by_c * m[1] + by_b * m[0]];
        if let Some(variance) = self.compensated {
            // The opacity has the factor √(det S / det(S + εI)) with S = m·mᵀ, and ∂ ln det S/∂m = 2·S⁻¹·m.
            let dilated = inverse_times(m, variance);
            by_m.iter_mut().zip(inverse_times(m, 0.0)).zip(dilated).for_each(|((by, own), dilated)| {
                *by += g * (own - dilated);
            });
        }
        let by_rows = [
            pixels.x * by_m[0],
            pixels.y * by_m[1],
            -pixels.x * on_plane.x * by_m[0] - pixels.y * on_plane.y * by_m[1],
        ];
        let by_on_plane = self.focal * by_center - pixels * DVec2::new(by_m[0].dot(z), by_m[1].dot(z));
        let by_depth = -(by_m[0].dot(m[0]) + by_m[1].dot(m[1])) / center.z - by_on_plane.dot(on_plane) / center.z;
        let by_center = by_on_plane.extend(by_depth * center.z) / center.z;
        let by_kept = ByShape { center: by_center, rows: by_rows, log_opacity: *g };
        let by_whole = backward(&cut, opacity, by_kept);

        // A = L·R·S with the linear map L of local to view.
        let by_a = DMat3::from_cols(by_whole.rows[0], by_whole.rows[1], by_whole.rows[2]).transpose();
        let by_scaled = self.local_to_view.transpose() * by_a;
        let columns = |m: &DMat3| [m.x_axis, m.y_axis, m.z_axis];
        let (axis, by_axis) = (columns(&axes), columns(&by_scaled));
        let scales = scale.to_array();
        found.log_scale = DVec3::from_array(std::array::from_fn(|k| scales[k] * axis[k].dot(by_axis[k])));
        let by_rotation = std::array::from_fn(|k| scales[k] * by_axis[k]);
        found.rotation = by_quaternion(gaussians.rotation.get(i)?.map(f64::from), by_rotation);
        found.on_screen = on_screen;
        Some((by_whole.center, by_whole.log_opacity))
    }

    /// The shading attributes; returns the derivatives by the position in the scene frame and by the palette.
    fn shading(
        &self,
        i: usize,
        position: DVec3,
        by_color: DVec3,
        found: &mut GaussianGradient,
    ) -> Option<(DVec3, DVec3)> {
        let columns = self.unit.gaussians.shading.as_ref()?;
        let [ka, kd, ks, shininess] = self.multipliers;
        let column = |values: &[f32]| values.get(i).copied().map(f64::from);
        let normal = columns.normal.get(i)?.as_dvec3();
        let surface = Surface {
            diffuse_color: self.palette + columns.offset_color.get(i)?.as_dvec3(),
            normal: self.normals.apply(normal),
            ambient: ka * column(&columns.ambient)?,
            diffuse: kd * column(&columns.diffuse)?,
            specular: ks * column(&columns.specular)?,
            shininess: shininess * column(&columns.shininess)?,
        };
        let away = self.eye - position;
        let to_eye = away.normalize_or_zero();
        let by = by_surface(self.unit.shading, &surface, to_eye, self.light.unwrap_or(to_eye), by_color);
        found.offset_color = by.diffuse_color;
        found.normal = self.normals.gradient(normal, by.normal);
        found.ambient = ka * by.ambient;
        found.diffuse = kd * by.diffuse;
        found.specular = ks * by.specular;
        found.shininess = shininess * by.shininess;
        let by_to_eye = if self.light.is_some() { by.to_eye } else { by.to_eye + by.to_light };
        let distance = away.length();
        let by_position =
            if distance > 0.0 { (to_eye * to_eye.dot(by_to_eye) - by_to_eye) / distance } else { DVec3::ZERO };
        Some((by_position, self.palette_open * by.diffuse_color))
    }
}

/// (m·mᵀ + variance·I)⁻¹·m, by rows. Zero where m·mᵀ has no inverse: the Gaussian has no area and is not drawn.
fn inverse_times([x, y]: [DVec3; 2], variance: f64) -> [DVec3; 2] {
    let (a, b, c) = (x.length_squared() + variance, x.dot(y), y.length_squared() + variance);
    // |x × y|² has no cancellation where the Gaussian is thin.
    let determinant = x.cross(y).length_squared() + variance * (a + c - variance);
    if determinant > 0.0 { [(c * x - b * y) / determinant, (a * y - b * x) / determinant] } else { [DVec3::ZERO; 2] }
}

/// Derivatives by a quaternion `[w, x, y, z]` of any length, from those by the columns of the rotation matrix.
fn by_quaternion(quaternion: [f64; 4], by_columns: [DVec3; 3]) -> [f64; 4] {
    let length = quaternion.iter().map(|q| q * q).sum::<f64>().sqrt();
    if !(length > 0.0 && length.is_finite()) {
        return [0.0; 4];
    }
    let unit = quaternion.map(|q| q / length);
    let [w, x, y, z] = unit;
    let [a, b, c] = by_columns;
    let by_unit = [
        2.0 * (z * (a.y - b.x) + y * (c.x - a.z) + x * (b.z - c.y)),
        2.0 * (y * (b.x + a.y) + z * (c.x + a.z) + w * (b.z - c.y) - 2.0 * x * (b.y + c.z)),
        2.0 * (x * (b.x + a.y) + z * (c.y + b.z) + w * (c.x - a.z) - 2.0 * y * (a.x + c.z)),
        2.0 * (x * (c.x + a.z) + y * (c.y + b.z) + w * (a.y - b.x) - 2.0 * z * (a.x + b.y)),
    ];
    // Lengths have no effect.
    let along: f64 = unit.iter().zip(&by_unit).map(|(q, by)| q * by).sum();
    std::array::from_fn(|k| (by_unit[k] - along * unit[k]) / length)
}
