//! Pictures of a mesh: rays through its tetrahedra, without a grid between.
//!
//! The tetrahedra are sorted into tiles of the picture. In each tile a ray is cut by each tetrahedron into the piece between its
//! four faces (the barycentric coordinates are linear along the ray). The pieces of a ray are sorted by depth. This needs no
//! neighbours, so gaps, overlaps and hanging nodes of a mesh do no harm. Garrity (1990, "Raytracing irregular volume data")
//! walks from neighbour to neighbour in its place.
//!
//! Along a piece the value is linear. It is cut again where the transfer function bends, so that no thin peak is missed, and then
//! sampled at the middles of steps.

use std::ops::Range;

use glam::{DMat4, DVec3, Vec3};
use rayon::prelude::*;

use super::MeshField;
use super::field::ends;
use crate::classifier::Classifier;
use crate::dvr::{ClipRegion, CollectedLight, Image, Lighting, Pinhole, VolumeRenderer, kept_parts};
use crate::opacity::correct_opacity;
use crate::surfaceness::Surfaceness;

/// Transmittance at which a ray ends, in the exact picture and in the fast one.
const LEAST_TRANSMITTANCE: [f64; 2] = [1e-5, 5e-4];
/// Edge of a tile in pixels.
const TILE: usize = 16;
/// Distance of the nearest visible place from the eye, relative to the diagonal of the mesh.
const NEAR: f64 = 1e-6;
/// Most samples of one part of a piece.
const MOST_SAMPLES: f64 = 1e4;

/// A mesh under a transfer function, ready for any number of pictures.
pub struct MeshMarcher<'a> {
    field: &'a MeshField,
    classifier: Classifier,
    surfaceness: Surfaceness,
    clips: Vec<ClipRegion>,
    visible: Vec<u32>,
    step: f64,
    reference: f64,
}

/// The part of a ray in one tetrahedron.
#[derive(Debug, Clone, Copy)]
struct Piece {
    /// Distances from the eye at which it begins and ends.
    ends: [f64; 2],
    /// Raw values there.
    values: [f64; 2],
    /// Barycentric coordinates there, without the first one.
    coordinates: [[f32; 3]; 2],
    cell: u32,
    /// Pixel within the tile.
    pixel: u16,
}

impl<'a> MeshMarcher<'a> {
    /// Finds the tetrahedra in which the transfer function shows something. `step` is the sampling distance in units of the reference
    /// length, 1/256 of the diagonal; ½ is a good value.
    #[must_use]
    pub fn new(field: &'a MeshField, classifier: Classifier, step: f64) -> Self {
        let reference = field.reference_length();
        let range = field.range();
        Self {
            visible: field.visible_cells(&classifier),
            surfaceness: Surfaceness::of_range([range.low, range.high], reference, &classifier),
            field,
            classifier,
            clips: Vec::new(),
            step: step.max(1e-3) * reference,
            reference,
        }
    }

    /// Shows only what all these regions keep.
    #[must_use]
    pub fn clipped(self, clips: Vec<ClipRegion>) -> Self {
        Self { clips, ..self }
    }

    fn render(&self, camera: &Pinhole, lighting: Lighting, background: Vec3, least_transmittance: f64) -> Image {
        let (width, height) = (camera.width, camera.height);
        let tiles = [width.div_ceil(TILE).max(1), height.div_ceil(TILE)];
        let view = camera.world_to_camera * DMat4::from_translation(self.field.middle());
        let rays = Rays::new(camera, &view);
        let boxes = self.pixel_boxes(camera, &view);
        let lists = Groups::new(boxes.len(), tiles[0] * tiles[1], |place| boxes[place].tiles(tiles[0]));
        let tile = |index: usize| {
            let first = [index % tiles[0] * TILE, index / tiles[0] * TILE];
            let size = [(width - first[0]).min(TILE), (height - first[1]).min(TILE)];
            self.tile(&rays, lists.members(index), &boxes, (first, size), lighting, background, least_transmittance)
        };
        let mut pixels = vec![[0.0; 4]; width * height];
        pixels.par_chunks_mut(TILE * width.max(1)).enumerate().for_each(|(band, rows)| {
            for column in 0..tiles[0] {
                let left = column * TILE;
                let drawn = tile(band * tiles[0] + column);
                let across = (width - left).min(TILE);
                for (row, drawn) in rows.chunks_mut(width).zip(drawn.chunks(across.max(1))) {
                    row[left..left + across].copy_from_slice(drawn);
                }
            }
        });
        Image { width, height, pixels }
    }

    /// The pixels that each visible tetrahedron may cover, in the order of their depths.
    fn pixel_boxes(&self, camera: &Pinhole, view: &DMat4) -> Vec<PixelBox> {
        let points: Vec<DVec3> =
            self.field.points().par_iter().with_min_len(4096).map(|p| view.transform_point3(*p)).collect();
        let near = NEAR * self.field.diagonal();
        let mut boxes: Vec<PixelBox> = self
            .visible
            .par_iter()
            .with_min_len(1024)
            .filter_map(|&cell| {
                let corners = self.field.cells()[cell as usize].map(|point| points[point as usize]);
                PixelBox::of(cell, &corners, camera, near)
            })
            .collect();
        // Pieces of a ray then come almost sorted.
        boxes.par_sort_by(|a, b| a.depth.total_cmp(&b.depth).then(a.cell.cmp(&b.cell)));
        boxes
    }

    /// The pixels of one tile, row by row.
    #[expect(clippy::too_many_arguments, reason = "one call, from the loop over tiles")]
    fn tile(
        &self,
        rays: &Rays<'_>,
        members: &[u32],
        boxes: &[PixelBox],
        (first, size): ([usize; 2], [usize; 2]),
        lighting: Lighting,
        background: Vec3,
        least_transmittance: f64,
    ) -> Vec<[f32; 4]> {
        let count = size[0] * size[1];
        let directions: Vec<DVec3> =
            (0..count).map(|pixel| rays.direction(first[0] + pixel % size[0], first[1] + pixel / size[0])).collect();
        let mut pieces: Vec<Piece> = Vec::new();
        for &member in members {
            let Some(pixels) = boxes.get(member as usize) else { continue };
            self.cut(pixels, rays.eye, &directions, (first, size), &mut pieces);
        }
        let by_pixel = Groups::new(pieces.len(), count, |place| std::iter::once(usize::from(pieces[place].pixel)));
        let eye = rays.eye + self.field.middle();
        let mut own: Vec<Piece> = Vec::new();
        let mut drawn = Vec::with_capacity(count);
        for (pixel, direction) in directions.iter().enumerate() {
            own.clear();
            own.extend(by_pixel.members(pixel).iter().map(|&place| pieces[place as usize]));
            own.sort_by(|a, b| a.ends[0].total_cmp(&b.ends[0]));
            let kept: Vec<(f64, f64)> = kept_parts(&self.clips, eye, *direction, 0.0, f64::INFINITY).collect();
            let mut light = CollectedLight::NONE;
            for piece in &own {
                for (begin, end) in &kept {
                    let (near, far) = (piece.ends[0].max(*begin), piece.ends[1].min(*end));
                    if near < far {
                        self.add(piece, [near, far], *direction, lighting, &mut light);
                    }
                }
                if light.transmittance < least_transmittance {
                    break;
                }
            }
            drawn.push(light.over(background));
        }
        drawn
    }

    /// Adds the pieces of the rays of a tile in one tetrahedron.
    fn cut(
        &self,
        pixels: &PixelBox,
        eye: DVec3,
        directions: &[DVec3],
        (first, size): ([usize; 2], [usize; 2]),
        pieces: &mut Vec<Piece>,
    ) {
        let cell = self.field.cell(pixels.cell as usize);
        let slopes = cell.coordinate_gradients();
        let at_eye = cell.coordinates_by(&slopes, eye);
        let [low, high] = ends(cell.values);
        // Rounding must not lead out of the values of the corners.
        let value = |c: [f64; 4]| c.iter().zip(cell.values).map(|(c, v)| c * v).sum::<f64>().clamp(low, high);
        let covered = |axis: usize| -> Range<usize> {
            let [low, high] = pixels.pixels[axis].map(|pixel| pixel as usize);
            low.saturating_sub(first[axis])..(high + 1).saturating_sub(first[axis]).min(size[axis])
        };
        for y in covered(1) {
            for x in covered(0) {
                let pixel = x + y * size[0];
                let Some(direction) = directions.get(pixel) else { continue };
                let along = slopes.map(|slope| slope.dot(*direction));
                let (mut near, mut far) = (0.0_f64, f64::INFINITY);
                for (start, slope) in at_eye.into_iter().zip(along) {
                    if slope > 0.0 {
                        near = near.max(-start / slope);
                    } else if slope < 0.0 {
                        far = far.min(-start / slope);
                    } else if start < 0.0 {
                        far = f64::NEG_INFINITY;
                    }
                }
                if near < far && far.is_finite() {
                    let at = |t: f64| [0, 1, 2, 3].map(|i| at_eye[i] + t * along[i]);
                    let [from, to] = [at(near), at(far)];
                    pieces.push(Piece {
                        ends: [near, far],
                        values: [value(from), value(to)],
                        coordinates: [from, to].map(|c| [c[1] as f32, c[2] as f32, c[3] as f32]),
                        cell: pixels.cell,
                        pixel: pixel as u16,
                    });
                }
            }
        }
    }

    /// Adds the light of a piece between two distances.
    fn add(
        &self,
        piece: &Piece,
        [near, far]: [f64; 2],
        direction: DVec3,
        lighting: Lighting,
        light: &mut CollectedLight,
    ) {
        let length = piece.ends[1] - piece.ends[0];
        let place = |t: f64| ((t - piece.ends[0]) / length).clamp(0.0, 1.0);
        let [v0, v1] = piece.values;
        let value = |s: f64| v0 + s * (v1 - v0);
        let (from, to) = (place(near), place(far));
        let gradients = match lighting {
            Lighting::Unlit => [Vec3::ZERO; 4],
            Lighting::Lit(..) => self.field.corner_gradients(piece.cell as usize),
        };
        let mut part = |from: f64, to: f64| {
            let way = (to - from) * length;
            let samples = (way / self.step).ceil().clamp(1.0, MOST_SAMPLES);
            for k in 0..samples as usize {
                let s = from + (to - from) * ((k as f64 + 0.5) / samples);
                let raw = value(s);
                let (color, opacity) = self.classifier.evaluate(raw);
                if opacity > 0.0 {
                    let alpha = correct_opacity(f64::from(opacity), way / samples, self.reference);
                    let shaded = self.shade(color, raw, piece, s as f32, &gradients, direction, lighting);
                    light.add(alpha, shaded);
                }
            }
        };
        let (low, high) = (value(from).min(value(to)), value(from).max(value(to)));
        let bends = self.classifier.bends();
        let between = bends.partition_point(|b| *b <= low)..bends.partition_point(|b| *b < high);
        let within = bends.get(between).unwrap_or_default();
        let mut begin = from;
        let mut until = |bend: f64| {
            let s = ((bend - v0) / (v1 - v0)).clamp(begin, to);
            part(begin, s);
            begin = s;
        };
        if v1 >= v0 {
            within.iter().for_each(|bend| until(*bend));
        } else {
            within.iter().rev().for_each(|bend| until(*bend));
        }
        part(begin, to);
    }

    #[expect(clippy::too_many_arguments, reason = "a sample of a piece")]
    fn shade(
        &self,
        color: Vec3,
        raw: f64,
        piece: &Piece,
        s: f32,
        gradients: &[Vec3; 4],
        direction: DVec3,
        lighting: Lighting,
    ) -> Vec3 {
        let Lighting::Lit(material, illumination) = lighting else { return color };
        let [a, b] = piece.coordinates;
        let c = [0, 1, 2].map(|i| a[i] + s * (b[i] - a[i]));
        let first = 1.0 - c[0] - c[1] - c[2];
        let gradient = gradients[0] * first + gradients[1] * c[0] + gradients[2] * c[1] + gradients[3] * c[2];
        let surfaceness = self.surfaceness.at(raw, gradient.length());
        material.lit(color, gradient, surfaceness, -direction.as_vec3(), illumination)
    }
}

impl VolumeRenderer for MeshMarcher<'_> {
    fn picture(&self, camera: &Pinhole, lighting: Lighting, background: Vec3) -> Image {
        self.render(camera, lighting, background, LEAST_TRANSMITTANCE[0])
    }

    fn fast_picture(&self, camera: &Pinhole, lighting: Lighting, background: Vec3) -> Image {
        self.render(camera, lighting, background, LEAST_TRANSMITTANCE[1])
    }
}

/// The rays of a picture, from the middle of the mesh.
struct Rays<'a> {
    camera: &'a Pinhole,
    camera_to_mesh: DMat4,
    eye: DVec3,
}

impl<'a> Rays<'a> {
    fn new(camera: &'a Pinhole, view: &DMat4) -> Self {
        let camera_to_mesh = view.inverse();
        Self { camera, camera_to_mesh, eye: camera_to_mesh.transform_point3(DVec3::ZERO) }
    }

    /// The unit direction through the middle of a pixel.
    fn direction(&self, x: usize, y: usize) -> DVec3 {
        self.camera.direction(&self.camera_to_mesh, x, y)
    }
}

/// The pixels that a tetrahedron may cover: first and last along each axis.
#[derive(Debug, Clone, Copy)]
struct PixelBox {
    pixels: [[u32; 2]; 2],
    cell: u32,
    /// Distance of its middle along the axis of the camera.
    depth: f64,
}

impl PixelBox {
    /// The box of a tetrahedron in the coordinates of the camera, as far as it is before the near plane; `None` outside the picture.
    fn of(cell: u32, corners: &[DVec3; 4], camera: &Pinhole, near: f64) -> Option<Self> {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let mut add = |p: DVec3| {
            for k in 0..2 {
                // Middles of pixels are at halves.
                let at = camera.focal[k] * p[k] / p.z + camera.center[k] - 0.5;
                low[k] = low[k].min(at);
                high[k] = high[k].max(at);
            }
        };
        for (i, p) in corners.iter().enumerate() {
            if p.z >= near {
                add(*p);
            }
            for q in corners.iter().skip(i + 1) {
                if (p.z >= near) != (q.z >= near) {
                    let mut cut = p.lerp(*q, (near - p.z) / (q.z - p.z));
                    cut.z = near;
                    add(cut);
                }
            }
        }
        // A thousandth of a pixel more, so that rounding loses no ray along an edge.
        let range = |k: usize, size: usize| -> Option<[u32; 2]> {
            let (first, last) = ((low[k] - 1e-3).ceil().max(0.0), (high[k] + 1e-3).floor().min(size as f64 - 1.0));
            (first <= last).then_some([first as u32, last as u32])
        };
        let pixels = [range(0, camera.width)?, range(1, camera.height)?];
        let depth = corners.iter().map(|p| p.z).sum::<f64>() / 4.0;
        Some(Self { pixels, cell, depth })
    }

    /// The tiles that it touches, in a picture of `across` tiles side by side.
    fn tiles(&self, across: usize) -> impl Iterator<Item = usize> {
        let [[left, right], [top, bottom]] = self.pixels.map(|of| of.map(|pixel| pixel as usize / TILE));
        (top..=bottom).flat_map(move |y| (left..=right).map(move |x| x + across * y))
    }
}

/// Items by group: their places in a list, in its order. An item can be in several groups.
struct Groups {
    starts: Vec<usize>,
    places: Vec<u32>,
}

impl Groups {
    /// `groups_of` gives the groups of an item, each below `groups`.
    fn new<I: Iterator<Item = usize>>(items: usize, groups: usize, groups_of: impl Fn(usize) -> I) -> Self {
        let mut starts = vec![0_usize; groups + 1];
        (0..items).flat_map(&groups_of).for_each(|group| starts[group + 1] += 1);
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut next = starts.clone();
        let mut places = vec![0_u32; starts[groups]];
        for item in 0..items {
            for group in groups_of(item) {
                places[next[group]] = item as u32;
                next[group] += 1;
            }
        }
        Self { starts, places }
    }

    fn members(&self, group: usize) -> &[u32] {
        &self.places[self.starts[group]..self.starts[group + 1]]
    }
}
